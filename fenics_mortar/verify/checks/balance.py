# SPDX-License-Identifier: MIT
"""Balance of forces and moments of bodies, obstacles and pairs, and of fluxes across contact."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.utils.arrays import EPSILON, ROUNDING, TINY, Array, Indices, norms
from fenics_mortar.utils.ranks import largest_over_ranks, sum_over_ranks
from fenics_mortar.verify.finding import LIMITS, Finding, Measured

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.interface import Interface


# Error of fluxes above which a state is no solution [1]: below the error of usual meshes. Where
# forces decide on convergence, or its tolerance is large, fluxes have fewer digits: a remark.
WRONG_FLUX = 1e-3
# Smallest reference of fluxes, over contact pressures by the scale of Newton's residuals [1]: of
# smaller fluxes digits are missing after convergence, as of the first ones by heat of friction.
SMALL_FLUX = 0.01


def balance_of_bodies(
    bulk: Bulk, contacts: Sequence[Interface], labels: Indices, unbalanced: Array
) -> tuple[float, Array]:
    """Relative sums of reactions, loads and contact forces of bodies and obstacles [1].

    Collective. In space the sums of their moments are included, over the radius of the body. With
    axisymmetry only axial forces are summed: hoop stresses balance radial forces.

    Internal forces sum to zero, so the sum of r over a body is minus the load applied to it; the
    reaction at a prescribed dof is the remainder of r and contact forces. Each body may deviate by
    the rounding of its own internal forces, and no reference exceeds the stiffness of the softest
    body, whose forces are those of all that touch it.

    Args:
        bulk: The bodies, with ``r`` at the present state.
        contacts: The pairs, evaluated there.
        labels: Body of each local node, shape (local nodes,).
        unbalanced: Sums of all forces on the obstacles, equal on all ranks [stress length].

    Returns:
        Norm of the sum over the sum of the norms of all forces [1], the largest of a body or
        obstacle; of bodies beyond the tolerance, which rounding excuses, over the norms of contact
        forces, shape (bodies,), zero of others.
    """
    r = bulk.r.array_r[: bulk.num_owned]
    total = r.copy()
    for contact in contacts:
        contact.scatter_add(contact.now.forces, total)
    total[bulk.prescribed_dofs] = 0.0
    comm, dofs = bulk.comm, bulk.space.owned_dofs
    body = labels[: len(dofs)]
    num_bodies = comm.allreduce(int(labels.max(initial=0)), MPI.MAX) + 1
    components = total[dofs].T[1:] if bulk.space.is_axisymmetric else total[dofs].T
    if bulk.space.dim == 3:
        components = np.vstack([components, _moments(bulk, total[dofs], body, num_bodies)])
    mine = [np.bincount(body, component, num_bodies) for component in components]
    defects, size = sum_over_ranks(comm, mine), comm.allreduce(float(np.abs(r[dofs]).sum()))
    attainable, softest, motion = _attainable(bulk, body, num_bodies)
    stiffness = min(max((float(c.stiffness.max()) for c in contacts), default=np.inf), softest)
    extent = max((float(np.ptp(c.slave.X, axis=0).max()) for c in contacts), default=0.0)
    smallest = stiffness * max(LIMITS.min_force * motion, ROUNDING * extent)
    size += smallest
    of_bodies = np.abs(defects).max(axis=0)
    largest = (of_bodies / np.maximum(size + attainable / LIMITS.tolerance, TINY)).max()
    largest = max(largest, np.abs(unbalanced).max(initial=0.0) / positive_or_one(size))
    forces = sum(float(np.abs(contact.now.forces[0]).sum()) for contact in contacts)
    unexcused = LIMITS.tolerance * size
    excused = (unexcused < of_bodies) & (of_bodies <= unexcused + attainable) & (forces > 0.0)
    return float(largest), np.where(excused, of_bodies / positive_or_one(smallest + forces), 0.0)


def _attainable(bulk: Bulk, body: Indices, num_bodies: int) -> tuple[Array, float, float]:
    """Rounding of the sum of the internal forces of each body, and its ingredients (collective).

    Stresses are rounded like the strains from which they follow: gradients of displacements u in
    cells, and with finite strains one plus these. With n dofs and the extent L of a body, and the
    largest entry K of its diagonal, the sum is rounded by 4 EPSILON K (sqrt(n) u + L). Beside a
    soft body, the rounding of a stiff one may exceed all contact forces.

    Args:
        bulk: The bodies.
        body: Body of each owned node, shape (owned nodes,).
        num_bodies: Number of bodies on all ranks.

    Returns:
        Rounding of each body, shape (bodies,) [stress length]; the smallest K of a body [stress];
        the largest displacement [length].
    """
    dofs = bulk.space.owned_dofs
    X = bulk.cells.X[: len(body)]
    sizes = [bulk.diagonal[dofs].max(axis=1), np.abs(bulk.u.x.array[dofs]).max(axis=1)]
    found = np.full((2 + 2 * X.shape[1], num_bodies), -np.inf)
    for largest, values in zip(found, [*sizes, *X.T, *-X.T], strict=True):
        np.maximum.at(largest, body, values)
    stiffness, motion, *ends = largest_over_ranks(bulk.comm, found)
    extent = np.add(*np.split(np.array(ends), 2)).max(axis=0)
    count = sum_over_ranks(bulk.comm, dofs.shape[1] * np.bincount(body, minlength=num_bodies))
    rounding = 4.0 * EPSILON * stiffness * (np.sqrt(count) * motion + extent)
    return rounding, float(stiffness.min()), float(motion.max())


def _moments(bulk: Bulk, forces: Array, body: Indices, num_bodies: int) -> Array:
    """Moments of forces (n, 3) about the centre of their body over its radius, (3, n) [force].

    Collective. Levers are those at which stresses have no moment: undeformed ones of linear forms.
    """
    x = bulk.cells.X if bulk.is_linear else bulk.positions()
    x = x[: len(body)]
    rows = np.vstack([np.ones(len(x)), x.T, (x**2).sum(axis=1)])
    sums = np.array([np.bincount(body, row, num_bodies) for row in rows])
    count, *centre, square = sum_over_ranks(bulk.comm, sums)
    count = np.maximum(count, 1.0)
    centres = np.stack(centre, axis=1) / count[:, None]
    radius = np.sqrt(np.maximum(square / count - (centres**2).sum(axis=1), TINY))
    return np.cross((x - centres[body]) / radius[body, None], forces).T


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Balance of the forces and of the fluxes of a pair in contact (collective).

    Loads of both sides and sources are in balance for the fluxes of scalar fields across contact:
    the sum of all loads on the slave's and the master's dofs is that of the source, since D and M
    reproduce constants.

    By the law of conduction the flux of each slave node is its conductance times the jump of the
    field. Where the conductance exceeds that of the cells beside the node, jumps are compared
    instead, as the flux that they would cause in these cells; with perfect conduction, jumps are
    zero.
    """
    yield from _of_forces(measured.contact)
    yield from _of_fluxes(measured)
    yield from _of_conduction(measured)


def of_tie(tie: Any) -> Iterator[Finding]:
    """Balance of the forces and of the fluxes of a tied pair (collective)."""
    yield from _of_forces(tie)
    for field in tie.fluxes:
        yield _imbalance(field.field, np.concatenate(field.loads()), 0.0)


def _of_forces(contact: Interface) -> Iterator[Finding]:
    """Balance of the forces of both sides of a pair, in contact or tied (local).

    Yields:
        ``force``: sum of all contact forces over the sum of their norms, zero up to rounding;
        ``moment``: sum of their moments over forces times lever arms, of third order in the facet
        length, zero up to rounding for a tied pair without gap.
    """
    o, (on_slave, reaction) = contact.operators, contact.now.forces
    where = o.m
    if not len(where):
        where, reaction = o.reaction(contact.z_u)
    forces, x = np.concatenate([on_slave, reaction]), np.concatenate([o.x, where])
    lever = x - x.sum(axis=0) / len(x)
    moments = lever[:, 0] * forces[:, 1] - lever[:, 1] * forces[:, 0]
    sizes = np.abs(forces)
    arms = float((sizes.max(axis=1) * np.abs(lever).max(axis=1)).sum())
    yield Finding(
        "force", "imbalance of contact forces",
        float(np.abs(forces.sum(axis=0)).max()) / positive_or_one(float(sizes.sum())),
        limit=LIMITS.tolerance,
    )  # fmt: skip
    yield Finding(
        "moment", "imbalance of contact moments", abs(float(moments.sum())) / positive_or_one(arms)
    )


def positive_or_one(value: float) -> float:
    """Divisor of a ratio: ``value``, or one if it is not positive [unit of value] (local)."""
    return value if value > 0.0 else 1.0


def _of_fluxes(measured: Any) -> Iterator[Finding]:
    """Imbalance of each flux over the sum of its absolute loads (collective)."""
    contact = measured.contact
    for flux in contact.fluxes:
        if contact.obstacle is not None:
            continue  # what enters an obstacle leaves the system
        source = float(contact.operators.weight @ flux.nodal().heating)
        yield _imbalance(flux.law.field, np.concatenate(flux.loads()), source)


def _of_conduction(measured: Any) -> Iterator[Finding]:
    """Difference of the flux of each field from conductance times jump (collective)."""
    weight = np.maximum(measured.contact.operators.weight, 0.0)
    for flux in measured.contact.fluxes:
        if flux.is_separate:
            continue  # h [T] is all that its flux is
        now = flux.now
        h, stiffest = now.conductance, np.minimum(now.conductance, flux.cells)
        from_flux = np.where(h > 0.0, now.conduction / np.where(h > 0.0, h, 1.0), 0.0)
        wrong = np.where(h > 0.0, stiffest * (now.jump - from_flux), now.conduction)
        level = LIMITS.min_force * flux.cells * np.abs(flux.T).max(initial=0.0)
        level += SMALL_FLUX * norms(measured.contact.z) / flux.to_force
        size = float(weight @ (np.abs(now.conduction) + level))
        yield Finding(
            f"conduction of field {flux.law.field}",
            f"flux of field {flux.law.field} other than conductance times jump, over all fluxes",
            float(weight @ np.abs(wrong)) / positive_or_one(size),
            limit=WRONG_FLUX, remark=LIMITS.tolerance,
        )  # fmt: skip


def _imbalance(field: int, loads: Array, source: float) -> Finding:
    size = float(np.abs(loads).sum()) + abs(source)
    imbalance = abs(float(loads.sum()) + source)
    return Finding(
        f"balance of field {field}",
        f"imbalance of the flux of field {field} that leaves one side and enters the other",
        imbalance / size if size > 0.0 else 0.0, limit=ROUNDING,
    )  # fmt: skip
