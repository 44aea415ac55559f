# SPDX-License-Identifier: MIT
"""Set-up of contact problems with known solutions: choices, exact data, prescribed values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import read_mesh
from fenics_mortar.energies import lame
from meshes import mapped_grids
from meshes.mapped_grids import Grid

Field = Callable[[np.ndarray, np.ndarray], np.ndarray]
# Element by name: shape of the cells, degree
ELEMENTS = {
    "P1": ("triangle", 1),
    "Q1": ("quadrilateral", 1),
    "P2": ("triangle", 2),
    "Q2": ("quadrilateral", 2),
}


@dataclass(frozen=True)
class Choice:
    """Choices of a user.

    Attributes:
        element: One of ``ELEMENTS``.
        basis: "dual" or "standard".
        integration: "segments" or "elements".
        linearization: "full" or "frozen" (fixed point).
    """

    element: str = "P1"
    basis: str = "dual"
    integration: str = "segments"
    linearization: str = "full"


@dataclass
class Posed:
    """A problem and its known solution.

    Attributes:
        data: The mesh.
        u: Displacement.
        problem: The problem, to be solved.
        slave: Name of the body with the slave surface, for which fields take ``True``.
        displacement: Exact displacement (2, n) at reference positions (2, n) of the given body.
        gradient: Gradient of the displacement, shape (2, 2, n).
        pressure: Exact pressure (n,) at reference positions (2, n) of the slave surface.
        lame: Lame's parameters [stress] for the energy norm.
        half_width: Exact half-width of the contact [length], if there is one.
        shear: Exact z_tau (n,) at reference positions of the slave surface, with friction.
    """

    data: Any
    u: Any
    problem: Any
    slave: str
    displacement: Field
    gradient: Field
    pressure: Callable[[np.ndarray], np.ndarray]
    lame: tuple[float, float]
    half_width: float = field(default=np.nan)
    shear: Callable[[np.ndarray], np.ndarray] | None = None


def read(grids: list[Grid], cell: str, order: int) -> Any:
    """Create a mesh of grids."""
    return read_mesh(lambda: mapped_grids.build(grids, cell=cell, order=order), MPI.COMM_SELF)


def piola(H: np.ndarray, mu: float, lmbda: float) -> np.ndarray:
    """First Piola-Kirchhoff stress of ``neo_hookean``, of gradients of displacement (2, 2, n)."""
    F = np.moveaxis(np.eye(2)[:, :, None] + H, -1, 0)
    inverse = np.linalg.inv(F).swapaxes(1, 2)
    P = mu * (F - inverse) + lmbda * np.log(np.linalg.det(F))[:, None, None] * inverse
    return np.moveaxis(P, 0, -1)


def interpolate(u: Any, data: Any, bodies: dict[str, bool], values: Field) -> Any:
    """Set a function of some bodies to values; ``bodies`` marks the slave body."""
    for name, on in bodies.items():
        cells = data.cell_tags.find(data.body_tag(name))
        u.interpolate(lambda x, on=on: values(x[:2], np.full(x.shape[1], on)), cells)
    return u


def body_force(data: Any, bodies: dict[str, bool], stress: Field) -> Any:
    """-div P, by central differences of a smooth stress (2, 2, n), as a function of degree 2."""
    step = 1e-5

    def minus_divergence(x: np.ndarray, on: np.ndarray) -> np.ndarray:
        total = np.zeros_like(x)
        for J, h in enumerate(step * np.eye(2)[:, :, None]):
            total -= (stress(x + h, on)[:, J] - stress(x - h, on)[:, J]) / (2 * step)
        return total

    return interpolate(fem.Function(fm.vector_space(data.mesh, 2)), data, bodies, minus_divergence)


def prescribe(V: Any, data: Any, places: dict[str, bool], exact: Field) -> list[Any]:
    """Prescribe the exact displacement; ``places`` marks the boundaries of the slave body."""
    bcs = []
    for name, of_slave in places.items():
        value = fem.Function(V)
        value.interpolate(lambda x, on=of_slave: exact(x[:2], np.full(x.shape[1], on)))
        bcs.append(fm.dirichlet(V, data, name, value))
    return bcs


def pose(
    data: Any,
    choice: Choice,
    law: Any,
    exact: Any,
    slave: str,
    master: str,
    *,
    displacement: Field,
    prescribed_on: dict[str, bool],
    loads: Any = None,
    friction: Any = None,
    tied: bool = False,
) -> tuple[Any, Any]:
    """Set up the problem; ``loads`` returns the work of the loads for x, v, dx, ds."""
    degree = ELEMENTS[choice.element][1]
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    dx = ufl.Measure("dx", data.mesh, metadata={"quadrature_degree": 2 * degree})
    ds = ufl.Measure(
        "ds", data.mesh, subdomain_data=data.facet_tags, metadata={"quadrature_degree": 6}
    )
    residual = ufl.inner(law(u, *lame(exact.E, exact.nu)), ufl.grad(v)) * dx
    if loads is not None:
        residual -= loads(ufl.SpatialCoordinate(data.mesh), v, dx, ds)
    discretization = fm.Discretization(choice.basis, integration=choice.integration)
    pair = (fm.TiedPair if tied else fm.ContactPair)(
        data, slave, master, discretization=discretization, **({} if tied else {"law": friction})
    )
    problem = fm.ContactProblem(
        residual,
        u,
        [pair],
        bcs=prescribe(V, data, prescribed_on, displacement),
        petsc_options_prefix="accuracy_",
        linearization=choice.linearization,
        newton=fm.NewtonOptions(max_iterations=100),
        linear_bulk=False,  # choices are compared on the general path
    )
    return u, problem


def spread(count: int, density: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Divide [0, 1] into ``count`` parts with the given density; shape (count + 1,)."""
    middles = (np.arange(200_000) + 0.5) / 200_000
    share = np.cumsum(density(middles))
    share = np.append(0.0, share / share[-1])
    return np.interp(np.arange(count + 1) / count, share, np.linspace(0, 1, share.size))
