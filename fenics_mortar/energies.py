# SPDX-License-Identifier: MIT
"""Energies per undeformed volume, as UFL functions of a displacement or of a measure of strain.

>>> from mpi4py import MPI
>>> from dolfinx import fem, mesh
>>> import fenics_mortar as fm
>>> V = fm.vector_space(mesh.create_unit_square(MPI.COMM_SELF, 2, 2), 1)
>>> u, v = fem.Function(V), ufl.TestFunction(V)
>>> psi = fm.energies.neo_hookean(u, *fm.energies.lame(E=100.0, nu=0.3))
>>> residual = ufl.derivative(psi * ufl.dx(degree=3), u, v)

Each energy has one formula for all dimensions. A displacement stands for plane strain in 2D, and
for itself in 3D. For bodies of revolution take ``deformation_gradient(u, "axisymmetric")``, or
``strain``, of shape (3, 3), and the volume 2 pi r dx. A deformation gradient of shape (2, 2) stands
for one of shape (3, 3) without stretch out of the plane. It may be the elastic part of one, without
thermal expansion, for example.

Stress is a derivative: ``F = ufl.variable(deformation_gradient(u))``, ``P = ufl.diff(psi, F)`` for
the energy ``psi`` of ``F``, or ``stress``; Cauchy's is P F^T / J. Parameters are numbers, constants
or functions of dolfinx, or expressions of UFL. All functions are local.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import ufl

from fenics_mortar.utils import compat, errors

if TYPE_CHECKING:
    from fenics_mortar.mesh.space import Geometry

__all__ = [
    "deformation_gradient", "displacement_gradient", "lame", "linear_elastic",
    "mixed_linear_elastic", "mixed_neo_hookean", "mooney_rivlin", "neo_hookean",
    "st_venant_kirchhoff", "strain", "stress",
]  # fmt: skip


def lame(E: Any, nu: Any) -> tuple[Any, Any]:
    """Lame's parameters, of plane strain and of bodies in space [stress] (local).

    The bulk modulus is lambda + 2 mu / 3. For plane stress replace lambda by
    2 mu lambda / (lambda + 2 mu).

    Args:
        E: Young's modulus [stress].
        nu: Poisson's ratio, below 0.5 [1].

    Returns:
        mu, the shear modulus, and lambda.

    Raises:
        ValueError: If ``nu`` is a number that is not between -1 and 0.5, or ``E`` one that is not
            positive.
    """
    if isinstance(E, (int, float)) and not E > 0.0:
        raise ValueError(f"E={E:g}: expected a positive number")
    if isinstance(nu, (int, float)) and not -1.0 < nu < 0.5:
        raise ValueError(
            f"nu={nu:g}: expected a number above -1 and below 0.5; incompressible bodies have a "
            "pressure as second unknown, see mixed_neo_hookean and mixed_linear_elastic"
        )
    return E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))


def displacement_gradient(u: Any, geometry: Geometry = "plane") -> Any:
    """Gradient of a displacement, or of a test function for the virtual work of a stress (local).

    Args:
        u: Displacement, shape (d,) [length].
        geometry: "plane", also for bodies in space, or "axisymmetric" about x = 0, as in
            ``fm.ContactProblem``.

    Returns:
        Shape (d, d); (3, 3) with the hoop component u_r / r of bodies of revolution [1].

    Raises:
        ValueError: For another geometry.
        NotImplementedError: If a displacement in space is said to be axisymmetric.
    """
    errors.check_choice("geometry", geometry, ("plane", "axisymmetric"))
    H = ufl.grad(u)
    if geometry == "plane":
        return H
    if H.ufl_shape == (3, 3):
        errors.refuse_in_space("axisymmetric")
    r = ufl.SpatialCoordinate(compat.domain_of(u))[0]
    return ufl.as_tensor([[H[0, 0], H[0, 1], 0], [H[1, 0], H[1, 1], 0], [0, 0, u[0] / r]])


def deformation_gradient(u: Any, geometry: Geometry = "plane") -> Any:
    """Deformation gradient F = 1 + grad u (local).

    Args:
        u: Displacement, shape (d,) [length].
        geometry: As for ``displacement_gradient``.

    Returns:
        Shape (d, d), or (3, 3) for bodies of revolution [1].

    Raises:
        ValueError: For another geometry.
    """
    H = displacement_gradient(u, geometry)
    return ufl.Identity(H.ufl_shape[0]) + H


def strain(u: Any, geometry: Geometry = "plane") -> Any:
    """Linear strain, the symmetric part of the displacement gradient (local).

    Args:
        u: Displacement, or a test function, shape (d,) [length].
        geometry: As for ``displacement_gradient``.

    Returns:
        Shape (d, d), or (3, 3) for bodies of revolution [1].

    Raises:
        ValueError: For another geometry.
    """
    return ufl.sym(displacement_gradient(u, geometry))


def elastic_strain(u: Any, expansion: Any = 0.0, geometry: Geometry = "plane") -> Any:
    """Linear strain in space minus an isotropic expansion, as alpha (T - T_0) (local).

    In plane strain the expansion is hindered out of the plane. For virtual work the strain of a
    test function without expansion has the same shape.

    Args:
        u: Displacement, or a test function, shape (d,) [length].
        expansion: The expansion, a scalar expression [1].
        geometry: As for ``displacement_gradient``.

    Returns:
        Shape (3, 3) [1].

    Raises:
        ValueError: For another geometry.

    Example:
        Thermoelastic body, with a mixed function w of displacement and temperature::

            u, T = ufl.split(w)
            v, s = ufl.TestFunctions(W)
            e = fm.energies.elastic_strain(u, alpha * T)
            sigma = fm.energies.stress(fm.energies.linear_elastic, e, mu, lmbda)
            residual = ufl.inner(sigma, fm.energies.elastic_strain(v)) * dx
            residual += k * ufl.inner(ufl.grad(T), ufl.grad(s)) * dx
    """
    e = strain(u, geometry)
    if e.ufl_shape == (2, 2):
        e = ufl.as_tensor([[e[0, 0], e[0, 1], 0], [e[1, 0], e[1, 1], 0], [0, 0, 0]])
    return e - expansion * ufl.Identity(3)


def stress(energy: Callable[..., Any], measure: Any, *parameters: Any) -> Any:
    """Derivative of an energy by its measure of strain [stress] (local).

    Args:
        energy: A function of this module.
        measure: Deformation gradient, or strain for linear elasticity, shape (d, d) [1].
        parameters: The other arguments of the energy.

    Returns:
        Shape (d, d): first Piola-Kirchhoff stress of a deformation gradient, whose virtual work is
        ``ufl.inner(P, ufl.grad(v))``; Cauchy stress of a strain.
    """
    at = ufl.variable(measure)
    return ufl.diff(energy(at, *parameters), at)


def linear_elastic(e: Any, mu: Any, lmbda: Any) -> Any:
    """Linear isotropic elasticity: mu e : e + lambda / 2 (tr e)^2 (local).

    Args:
        e: Displacement, shape (d,) [length], or strain, shape (d, d) [1].
        mu: Shear modulus [stress].
        lmbda: Lame's parameter lambda [stress].

    Returns:
        A scalar expression [stress].

    Source: Bonet, Wood, Nonlinear Continuum Mechanics for Finite Element Analysis (2008), ch. 6.
    """
    e = _measure(e, strain)
    return mu * ufl.inner(e, e) + lmbda / 2 * ufl.tr(e) ** 2


def neo_hookean(F: Any, mu: Any, lmbda: Any) -> Any:
    """Compressible neo-Hookean law: mu / 2 (tr C - 3) - mu ln J + lambda / 2 (ln J)^2 (local).

    Args:
        F: Displacement, shape (d,) [length], or deformation gradient, shape (d, d) [1].
        mu: Shear modulus of small strains [stress].
        lmbda: Lame's parameter lambda of small strains [stress].

    Returns:
        A scalar expression [stress].

    Source: Bonet, Wood (2008), section 6.4.3.
    """
    F = _measure(F, deformation_gradient)
    J = ufl.det(F)
    return mu / 2 * (ufl.tr(F.T * F) - F.ufl_shape[0]) - mu * ufl.ln(J) + lmbda / 2 * ufl.ln(J) ** 2


def st_venant_kirchhoff(F: Any, mu: Any, lmbda: Any) -> Any:
    """St. Venant-Kirchhoff law, linear in Green's strain: mu G : G + lambda / 2 (tr G)^2 (local).

    G = (F^T F - 1) / 2. For large rotations and moderate strains: under compression to less than
    0.58 of a length the stress decreases again.

    Args:
        F: Displacement, shape (d,) [length], or deformation gradient, shape (d, d) [1].
        mu: Shear modulus [stress].
        lmbda: Lame's parameter lambda [stress].

    Returns:
        A scalar expression [stress].

    Source: Ciarlet, Mathematical Elasticity I (1988), ch. 3.
    """
    F = _measure(F, deformation_gradient)
    return linear_elastic((F.T * F - ufl.Identity(F.ufl_shape[0])) / 2, mu, lmbda)


def mooney_rivlin(F: Any, c_1: Any, c_2: Any, kappa: Any) -> Any:
    """Mooney-Rivlin law with a volumetric part (local).

    c_1 (I_1 J^(-2/3) - 3) + c_2 (I_2 J^(-4/3) - 3) + kappa / 2 (J - 1)^2

    with the invariants I_1 and I_2 of C = F^T F.

    Args:
        F: Displacement, shape (d,) [length], or deformation gradient, shape (d, d) [1].
        c_1: Constant of the first invariant [stress].
        c_2: Constant of the second one; the shear modulus is 2 (c_1 + c_2) [stress].
        kappa: Bulk modulus [stress].

    Returns:
        A scalar expression [stress].

    Source: Mooney, J. Appl. Phys. 11 (1940) 582-592; decoupled from the volume as in Holzapfel,
    Nonlinear Solid Mechanics (2000), ch. 6.
    """
    F = _measure(F, deformation_gradient)
    C, J, unstretched = F.T * F, ufl.det(F), 3 - F.ufl_shape[0]
    I_1 = ufl.tr(C) + unstretched
    I_2 = (I_1**2 - ufl.tr(C * C) - unstretched) / 2
    isochoric = c_1 * (I_1 * J ** (-2 / 3) - 3) + c_2 * (I_2 * J ** (-4 / 3) - 3)
    return isochoric + kappa / 2 * (J - 1) ** 2


def mixed_neo_hookean(F: Any, p: Any, mu: Any, compliance: Any = 0.0) -> Any:
    """Neo-Hookean law of nearly or fully incompressible bodies, with a pressure (local).

    mu / 2 (tr C - 3) - mu ln J + p (J - 1) - compliance / 2 p^2; its derivative by p is the
    equation J - 1 = compliance p.

    Args:
        F: Displacement, shape (d,) [length], or deformation gradient, shape (d, d) [1].
        p: Stress lambda (J - 1) of the change of volume, positive in tension, an unknown [stress].
        mu: Shear modulus [stress].
        compliance: 1 / lambda, 0 for incompressible bodies [1 / stress].

    Returns:
        A scalar expression [stress]; its derivative by both unknowns is the residual.

    Source: Sussman, Bathe, Comput. Struct. 26 (1987) 357-409.
    """
    F = _measure(F, deformation_gradient)
    return neo_hookean(F, mu, 0.0) + _volumetric(ufl.det(F) - 1, p, compliance)


def mixed_linear_elastic(e: Any, p: Any, mu: Any, compliance: Any = 0.0) -> Any:
    """Linear elasticity of nearly or fully incompressible bodies, as ``mixed_neo_hookean`` (local).

    mu e : e + p tr e - compliance / 2 p^2

    Args:
        e: Displacement, shape (d,) [length], or strain, shape (d, d) [1].
        p: Stress lambda tr e of the change of volume, positive in tension, an unknown [stress].
        mu: Shear modulus [stress].
        compliance: 1 / lambda, 0 for incompressible bodies [1 / stress].

    Returns:
        A scalar expression [stress].
    """
    e = _measure(e, strain)
    return linear_elastic(e, mu, 0.0) + _volumetric(ufl.tr(e), p, compliance)


def _volumetric(change: Any, p: Any, compliance: Any) -> Any:
    """Part of a mixed energy: a pressure that enforces a change of volume."""
    return p * change - compliance / 2 * p**2


def _measure(given: Any, of_displacement: Callable[[Any], Any]) -> Any:
    """A measure of strain, shape (d, d): that of a displacement, or as it is given."""
    return of_displacement(given) if len(given.ufl_shape) == 1 else given
