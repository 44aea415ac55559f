# SPDX-License-Identifier: MIT
"""Work of bulk, reactions and contact forces in a load step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fenics_mortar.contact.arcs import surface_rotation
from fenics_mortar.equations.general import State
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.rounding import TINY
from fenics_mortar.verify.checks.friction_work import work_along_arcs

Forces = tuple[Array, Array, Array, Array, Array]


class Work(NamedTuple):
    """Work done in a step, by the trapezoidal rule [stress length^2] (local).

    Attributes:
        bulk: Energy stored in the bodies, minus the work of applied loads.
        supports: Work of the reactions.
        contact: Work of the contact forces.
        friction: Work of their tangential parts: the energy dissipated by friction. On nodes, these
            forces turn with the surface, see ``verify.checks.friction_work``.
        largest: Upper bound of the work of contact forces: sum of the norms of forces times those
            of the motions of their nodes and obstacles.
        rotated: Work included in ``friction`` that the trapezoidal rule misses on turning surfaces.
    """

    bulk: float
    supports: float
    contact: float
    friction: float = 0.0
    largest: float = 0.0
    rotated: float = 0.0

    @property
    def pressure(self) -> float:
        """Work of the pressures [stress length^2].

        Pressures on closed gaps do no work: this is energy added by the discretization. It vanishes
        with the size of facets and steps, but slowly below a sliding corner, where the pressure is
        unbounded.
        """
        return self.contact - self.dissipated

    @property
    def imbalance(self) -> float:
        """Work of forces that are not in balance [stress length^2].

        At the start of a motion, nodes without mass need not be in balance.
        """
        return self.bulk + self.contact - self.supports

    @property
    def dissipated(self) -> float:
        """Work of friction by the trapezoidal rule alone [stress length^2].

        Bodies lose this energy in a time step, whose equations are those of straight paths.
        """
        return self.friction - self.rotated

    @property
    def defect(self) -> float:
        """Work of the pressures over the largest of all contributions [1].

        Under dead loads and fixed supports, ``bulk`` and ``supports`` consist of the work of
        contact alone. Therefore ``largest`` is included in the comparison: in sliding the ratio
        measures the friction added by the facets.
        """
        return abs(self.pressure) / max(*map(abs, self[:-1]), TINY)


def forces_of(problem: ContactProblem) -> Forces:
    """Forces of bulk and contact, on obstacles, and tangential parts of the last two (collective).

    Returns:
        Owned dofs of the bulk residual, of contact forces, forces and moments on obstacles,
        tangential contact forces and tangential forces and moments on obstacles [stress length,
        moments stress length^2].
    """
    shear, on_obstacles = problem.equations.residual.shear_forces()
    scales = problem.equations.motions.scales[: len(on_obstacles)]
    return *problem.forces(), shear, on_obstacles * scales


def work_of(
    problem: ContactProblem, start: State, end: State, before: Forces, after: Forces
) -> Work:
    """Work of the mean forces in a step; obstacles are treated as supports (collective).

    Args:
        problem: The problem.
        start: State at the start of the step.
        end: State at the end of the step.
        before: Forces at the start of the step, see ``forces_of``.
        after: Forces at the end of the step.
    """
    means = (0.5 * (a + b) for a, b in zip(before, after, strict=True))
    r, contact, on_obstacles, shear, shear_on_obstacles = means
    du, prescribed = (end.u - start.u)[: r.size], problem.equations.bulk.prescribed_dofs
    supports = (r + contact)[prescribed] @ du[prescribed]
    dofs, angles = problem.equations.bulk.space.owned_dofs, _rotations(problem, start, end)
    friction = work_along_arcs(before[3][dofs], after[3][dofs], du[dofs], angles).sum()
    work = np.array([r @ du, supports, contact @ du, friction, friction - shear @ du])
    work = problem.equations.comm.allreduce(work)
    moved = (end.places - start.places)[: len(on_obstacles)]
    work[1:3] += (on_obstacles * moved).sum()
    work[3] += (shear_on_obstacles * moved).sum()
    sizes = np.linalg.norm(contact[dofs], axis=1) @ np.linalg.norm(du[dofs], axis=1)
    largest = problem.equations.comm.allreduce(float(sizes)) + np.abs(on_obstacles * moved).sum()
    of_bulk, of_supports, of_contact, of_friction, rotated = map(float, work)
    return Work(of_bulk, of_supports, of_contact, of_friction, float(largest), rotated)


def _rotations(problem: ContactProblem, start: State, end: State) -> Array:
    """Rotations in a step of the surfaces at owned nodes, zero elsewhere, (nodes,) (collective).

    The mean of all surfaces of a node, as on both sides of a corner.
    """
    sums = np.zeros(problem.equations.bulk.num_owned)
    for contact in problem.equations.contacts:
        for surface in (contact.slave, contact.master):
            x_0, x = (surface.X + surface.gather(state.u) for state in (start, end))
            angles = surface_rotation(surface, x_0, x) if len(x) else np.zeros(0)
            surface.scatter_add(np.stack([angles, np.ones_like(angles)], axis=1), sums)
    angle, count = sums[problem.equations.bulk.space.owned_dofs].T
    return np.asarray(angle / np.maximum(count, 1.0))
