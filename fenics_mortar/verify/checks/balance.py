# SPDX-License-Identifier: MIT
"""Balance of forces and moments of bodies and obstacles, and of the two sides of a pair."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.contact.tied import Tie
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.ranks import sum_over_ranks
from fenics_mortar.utils.rounding import ROUNDING
from fenics_mortar.verify.finding import Finding
from fenics_mortar.verify.limits import LIMITS
from fenics_mortar.verify.measured import Measured


def balance_of_bodies(
    bulk: Bulk, contacts: Sequence[Contact | Tie], labels: Indices, unbalanced: Array
) -> float:
    """Largest relative sum of reactions, loads and contact forces of a body or obstacle [1].

    Collective. With axisymmetry only axial forces are summed: hoop stresses balance radial forces.

    Internal forces sum to zero, so the sum of r over a body is minus the load applied to it; the
    reaction at a prescribed dof is the remainder of r and contact forces.

    Args:
        bulk: The bodies, with ``r`` at the present state.
        contacts: The pairs, evaluated there.
        labels: Body of each local node, shape (local nodes,).
        unbalanced: Sums of all forces on the obstacles, equal on all ranks [stress length].

    Returns:
        Norm of the sum over the sum of the norms of all forces [1].
    """
    r = bulk.r.array_r[: bulk.num_owned]
    total = r.copy()
    for contact in contacts:
        on_slave, on_master = contact.now.forces
        contact.slave.scatter_add(on_slave, total)
        contact.master.scatter_add(on_master, total)
    total[bulk.prescribed_dofs] = 0.0
    comm, dofs = bulk.comm, bulk.space.owned_dofs
    body = labels[: len(dofs)]
    num_bodies = comm.allreduce(int(labels.max(initial=0)), MPI.MAX) + 1
    components = total[dofs].T[1:] if bulk.space.is_axisymmetric else total[dofs].T
    mine = [np.bincount(body, component, num_bodies) for component in components]
    defects, size = sum_over_ranks(comm, mine), comm.allreduce(float(np.abs(r[dofs]).sum()))
    motion = comm.allreduce(float(np.abs(bulk.u.x.array[dofs]).max(initial=0.0)), MPI.MAX)
    stiffness = max((float(c.stiffness.max()) for c in contacts), default=bulk.stiffness)
    extent = max((float(np.ptp(c.slave.X, axis=0).max()) for c in contacts), default=0.0)
    rounding = stiffness * max(LIMITS.min_force * motion, ROUNDING * extent)
    defect = max(np.abs(defects).max(), np.abs(unbalanced).max(initial=0.0))
    return float(defect) / positive_or_one(size + rounding)


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Balance of a pair in contact (local)."""
    return of_tie(measured.contact)


def of_tie(contact: Interface) -> Iterator[Finding]:
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
        "force",
        "imbalance of contact forces",
        float(np.abs(forces.sum(axis=0)).max()) / positive_or_one(float(sizes.sum())),
        limit=LIMITS.tolerance,
    )
    yield Finding(
        "moment",
        "imbalance of contact moments",
        abs(float(moments.sum())) / positive_or_one(arms),
    )


def positive_or_one(value: float) -> float:
    """Divisor of a ratio: ``value``, or one if it is not positive [unit of value] (local)."""
    return value if value > 0.0 else 1.0
