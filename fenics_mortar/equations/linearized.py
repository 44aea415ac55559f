# SPDX-License-Identifier: MIT
"""Linear solves with the tangent of all equations, or its transpose, at the present state.

The operator A is the derivative of these residuals with respect to displacement u, multipliers z
and places q of obstacles and remote loads, at fixed active sets and branches of the contact laws:

===============================  ================  =====================================  ==========
unknowns                         units             rows                                   units
===============================  ================  =====================================  ==========
u, free dofs                     length            forces of bodies and contact           stress
                                                   r + B^T z, r = f_int - f_ext           * length
u, dofs with prescribed values   length            u                                      length
z, multipliers of slave nodes    stress            rows of the contact law, as in         stress
                                                   ``Contact.rows``: blocks . u + A_z z   * length
q, driven motions                length, radian    forces and moment f_q of contact, in   stress
                                                   equilibrium with the push              * length,
                                                                                          * length^2
q, prescribed motions            length, radian    q                                      as q
===============================  ================  =====================================  ==========

The two rows of a slave node are Cartesian components. An active node has the row of its gap,
scaled by k_j / D_jj, along n, and the tangential row of the law, scaled by D_jj, along -tau; see
``contact.rows``. An open node has minus its nodal area times its multiplier, which exerts no force
on the bodies. A tied node has its jump, scaled by k_j / D_jj.

A does not contain the springs that regularize floating bodies and loose obstacles in Newton's
method. If contact leaves a rigid motion free, A is singular.

A change dR of the residuals changes the solution by -A^-1 dR. For a force f on the bodies this is
A^-1 f. The change of a prescribed displacement is the right-hand side of the row of its dof, the
change of a push that of the row of its motion. The gradient of a functional J with respect to a
parameter p is -y . dR/dp with A^T y = dJ/d(u, z, q) (adjoint method). For mixed functions u
contains all unknowns, each with its units and equations.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.contact.law_calls import raise_stored
from fenics_mortar.la.sparse import solve_bordered
from fenics_mortar.rigid.driven import border_of
from fenics_mortar.utils import errors, ranks

if TYPE_CHECKING:
    from fenics_mortar.equations.general import ContactEquations
    from fenics_mortar.utils.arrays import Array


@dataclass(frozen=True)
class LinearVector:
    """Right-hand side or solution of ``ContactProblem.linear_solve``.

    A solution of the tangent has the units of the unknowns, a right-hand side those of the rows;
    with the transpose it is the other way round, over the unit of the functional. The scaling of
    the rows is that of ``equations.linearized``.

    Attributes:
        u: Values of the owned dofs in the order of dolfinx, shape (owned dofs,): displacements
            [length]; in rows forces [stress length], at prescribed dofs displacements [length].
            ``None``: zero.
        z: Components at the slave nodes of each pair, in the order of the surface, shape (slave
            nodes, 2), in space (slave nodes, 3) each, replicated: multipliers [stress]; in rows
            those of the contact law [stress length]. Tied fields have further columns [flux].
            ``None``: zero.
        q: x, y and angle of the m obstacles and remote loads, in the order of
            ``problem.obstacles`` and of the argument ``remote``, shape (m, 3), replicated [length,
            length, radian], in space (m, 6) with spins as rotations; in rows of driven motions
            forces and moments [stress length, stress length^2]. ``None``: zero.
    """

    u: Array | None = None
    z: Sequence[Array] | None = None
    q: Array | None = None

    def __add__(self, other: LinearVector) -> LinearVector:
        """Sum of two vectors; parts that are ``None`` in both remain ``None`` (local)."""
        alike = None
        if self.z is not None and other.z is not None:
            alike = [a + b for a, b in zip(self.z, other.z, strict=True)]
        z = alike or self.z or other.z
        return LinearVector(_sum(self.u, other.u), z, _sum(self.q, other.q))

    def __mul__(self, factor: float) -> LinearVector:
        """Product with a number (local)."""
        z = None if self.z is None else [factor * values for values in self.z]
        u, q = (None if part is None else factor * part for part in (self.u, self.q))
        return LinearVector(u, z, q)

    def dot(self, other: LinearVector, comm: MPI.Comm) -> float:
        """Scalar product with another vector, each entry counted once (collective).

        Args:
            other: The other vector.
            comm: Communicator of the mesh.

        Returns:
            The sum [product of the units of both], equal on all ranks.
        """
        pairs = [(self.q, other.q), *zip(self.z or (), other.z or (), strict=False)]
        alike = sum(float(np.vdot(a, b)) for a, b in pairs if a is not None and b is not None)
        mine = 0.0 if self.u is None or other.u is None else float(self.u @ other.u)
        return comm.allreduce(mine) + alike


def _sum(one: Array | None, other: Array | None) -> Array | None:
    """Sum of two arrays; ``None`` is zero (local)."""
    if one is None or other is None:
        return other if one is None else one
    return one + other


# Largest number of solves with a tangent that has smaller conductances [1]. Errors of the equations
# with the present ones, finite or not, decrease by 0.01 to 0.001 in each: ``contact.fluxes.SOFT``.
SOLVES = 8
# Relative change of the bodies' unknowns in the last of these solves [1]: rounding.
LAST_CHANGE = 1e-15


class LinearizedEquations:
    """A at the last evaluated state, factorized in the first solve; all methods are collective.

    Valid until the next Newton iteration, since matrix and factors are those of the problem.

    Args:
        equations: The equations, evaluated.
    """

    def __init__(self, equations: ContactEquations) -> None:
        bulk, motions, tangent = equations.bulk, equations.motions, equations.reduced_tangent()
        self._bulk, self._contacts, self._system = bulk, equations.contacts, equations.system
        self._motions = motions
        self._tangent = tangent or self._system
        self._shape, self._driven = motions.scales.shape, motions.unknowns
        if tangent is None:
            bulk.assemble_tangent()
            for load in motions.boundaries:
                load.take_bulk_rows()
        with self._softened():
            self._tangent.assemble()
        border = border_of(motions, self._system)
        extra = np.ones(len(border.corner) - motions.scales.size)
        raise_stored(bulk.comm, self._contacts)
        self._border = border.scaled(np.append(motions.scales.ravel(), extra))

    @contextmanager
    def _softened(self) -> Iterator[None]:
        """Context in which smaller conductances replace large ones, see ``contact.fluxes``."""
        with ExitStack() as stack:
            for contact in self._contacts:
                for flux in contact.conductances:
                    stack.enter_context(flux.softened())
            yield

    def solve(self, rhs: LinearVector, *, transpose: bool = False) -> LinearVector:
        """Solve A x = rhs, or A^T x = rhs; see ``ContactProblem.linear_solve``."""
        with self._softened():
            found = change = self._solved(rhs, transpose)
            fluxes = [(i, flux) for i, c in enumerate(self._contacts) for flux in c.conductances]
            stiff = [(i, flux, np.zeros(len(flux.cells))) for i, flux in fluxes if flux.exceeds]
            for _ in range(SOLVES - 1 if stiff else 0):
                change = self._solved(self._remainder(change, stiff, transpose), transpose)
                found = found + change
                sizes = [np.sum(x.u**2) for x in (change, found) if x.u is not None]
                last, whole = ranks.sum_over_ranks(self._bulk.comm, sizes)
                if last <= LAST_CHANGE**2 * whole:
                    break
            return found

    def _remainder(self, change: LinearVector, fluxes: Any, transpose: bool) -> LinearVector:
        """Right-hand side of the next change, by conductances above that of the tangent.

        Args:
            change: The last change, at first the first solution.
            fluxes: Contact, flux and its last change d, see ``Flux.remainder``, changed in place.
            transpose: Whether the equations are transposed.
        """
        assert change.u is not None and change.z is not None and change.q is not None
        u, y = np.zeros_like(change.u), change.u.copy()
        z, q = [np.zeros_like(part) for part in change.z], np.zeros_like(change.q)
        y[self._bulk.prescribed_dofs] = 0.0
        for i, flux, d in fluxes:
            of_obstacle = partial(self._motions.of_obstacle, self._contacts[i])
            if not transpose:
                motion = of_obstacle(change.q * self._motions.scales)
                u += flux.remainder(change.u, change.z[i], motion, d)
                continue
            on_bodies, of_z, motion = flux.transposed_remainder(y, d)
            u, z[i] = u + on_bodies, z[i] + of_z
            of_obstacle(q)[...] += motion
        if not transpose:
            u[self._bulk.prescribed_dofs] = 0.0
        return LinearVector(u, z, q * self._motions.scales)

    def _solved(self, rhs: LinearVector, transpose: bool) -> LinearVector:
        """One solve; prescribed motions are eliminated first, of the transpose computed last."""
        b, c = self._read(rhs)
        driven, border, comm = self._driven, self._border, self._bulk.comm
        q = np.append(c, np.zeros(driven.size - c.size))
        inner, given, balance = border.restricted_to(driven), q[~driven], q[driven]
        columns, corner = border.columns[~driven], border.corner[np.ix_(driven, ~driven)]
        solve = partial(self._tangent.solve, transpose=transpose)
        if transpose:
            inner = inner.transposed
        else:
            b, balance = b - given @ columns, balance - corner @ given
        x, q[driven] = solve_bordered(solve, inner, solve(b), balance, comm)
        if transpose:
            q[~driven] -= comm.allreduce(columns @ x) + q[driven] @ corner
        u, z = self._system.split(x)
        return LinearVector(u, z, q[: c.size].reshape(self._shape))

    def _read(self, rhs: LinearVector) -> tuple[Array, Array]:
        """The right-hand side as a vector of the system, and values for the motions.

        Raises:
            ValueError: On all ranks, if shape or type is wrong.
            MortarError: On all ranks, if z or q differ between ranks.
        """
        with errors.together(self._bulk.comm, "linear_solve"):
            errors.check_kind("rhs", rhs, LinearVector, "a LinearVector")
            u = _checked("u", rhs.u, (self._bulk.num_owned,))
            if rhs.z is not None and len(rhs.z) != len(self._contacts):
                raise ValueError(
                    f"z has values of {len(rhs.z)} pairs: expected {len(self._contacts)}"
                )
            none: list[Array | None] = [None] * len(self._contacts)
            given: Sequence[Array | None] = none if rhs.z is None else rhs.z
            shapes = [contact.z.shape for contact in self._contacts]
            z = [_checked("z", values, shape) for values, shape in zip(given, shapes, strict=True)]
            q = _checked("q", rhs.q, self._shape)
        errors.check_same(self._bulk.comm, [*(("z", values) for values in z), ("q", q)])
        return self._system.join(u, z), q.ravel()


def _checked(name: str, values: Array | None, shape: tuple[int, ...]) -> Array:
    """Values as floats of the given shape, zero by default (local)."""
    if values is None:
        return np.zeros(shape)
    values = np.asarray(values, float)
    if values.shape != shape:
        raise ValueError(f"{name} has the shape {values.shape}: expected {shape}")
    if not np.isfinite(values).all():
        raise ValueError(f"{name} is not finite: expected numbers")
    return values
