# SPDX-License-Identifier: MIT
"""Messages on the reasons of a failed solve; all functions are collective."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.contact.messages import describe_overlap
from fenics_mortar.equations.isolated_fields import describe_isolated
from fenics_mortar.equations.set_record import SetsOfPairs
from fenics_mortar.rigid.driven import DrivenMotions
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError, NotFiniteError, format_point
from fenics_mortar.utils.rounding import ASSEMBLY_ROUNDING, ROUNDING, SMALL_ANGLE


def check_diagonal(diagonal: Array, bulk: Bulk, floating: FloatingBodies) -> None:
    """Check that the bulk tangent is finite and that each node has stiffness.

    Args:
        diagonal: Diagonal of the tangent, shape (owned dofs,) [stress].
        bulk: The bodies.
        floating: The bodies with their names.

    Raises:
        MortarError: On all ranks.
    """
    if bulk.comm.allreduce(not np.isfinite(diagonal).all(), MPI.LOR):
        reason = describe_inverted(bulk) or "check the residual form"
        raise MortarError(f"the bulk tangent is not finite at the initial displacement: {reason}")
    dofs = bulk.space.owned_dofs
    labels = floating.labels[: len(dofs)]
    of_body = dict[int, float]()
    for some in bulk.comm.allgather(
        {int(k): float(diagonal[dofs[labels == k]].max()) for k in np.unique(labels)}
    ):
        of_body |= {k: max(value, of_body.get(k, value)) for k, value in some.items()}
    negative = sorted(label for label, largest in of_body.items() if largest < 0.0)
    if negative:
        names = ", ".join(map(floating.name_of, negative))
        which = f" of {names}" if len(negative) < len(of_body) else ""
        raise MortarError(
            f"all stiffnesses{which} are negative: check the signs of the residual, which is "
            "internal minus applied forces, of the jacobian, and of Young's modulus"
        )
    loose = np.zeros(diagonal.size, bool)
    loose[dofs] = (diagonal[dofs] == 0.0) & ~bulk.prescribed[dofs]
    count, where = bulk.input_data.count_nodes(loose)
    if count:
        mine = set(floating.labels[: len(dofs)][loose[dofs].any(axis=1)].tolist())
        bodies = sorted(set().union(*bulk.comm.allgather(mine)))
        names = ", ".join(floating.name_of(label) for label in bodies)
        raise MortarError(
            f"the bulk tangent has no stiffness at {count} nodes, one at {where}, of {names}: "
            "the residual form has to contain the stress of every body"
        )


def diagnose(
    bulk: Bulk,
    contacts: Sequence[Interface],
    floating: FloatingBodies,
    motions: DrivenMotions,
    force: float,
    recent: Sequence[SetsOfPairs],
) -> str:
    """Describe inverted cells, loose bodies, wrong laws, edges and overlaps; "" if none.

    Args:
        bulk: The bodies.
        contacts: All pairs.
        floating: Bodies that Dirichlet conditions leave free to move rigidly.
        motions: The rigid motions.
        force: Size of the forces [stress length].
        recent: Sets of the last iterations.
    """
    first = describe_inverted(bulk)
    if not first:
        free = floating.describe(floating.loose()), motions.describe(force)
        first = ", ".join(filter(None, free)) or _describe_limits(contacts)
        first = first or _describe_twice(contacts) or _describe_peeling(contacts, recent)
        first = first or describe_isolated(bulk, contacts, floating)
    at_nodes = bulk.describe_inverted_nodes()
    return "; ".join(filter(None, (first, at_nodes, *map(describe_overlap, contacts))))


def describe_inverted(bulk: Bulk) -> str:
    """Number and position of inverted cells; "" if there are none."""
    count, where = bulk.inverted_cells()
    return f"{count} cells are inverted, one at {where}: try smaller load steps" * bool(count)


def _describe_limits(contacts: Sequence[Interface]) -> str:
    """Describe friction limits that are negative or nan at the last pressures; "" if none."""
    for contact in contacts:
        if not isinstance(contact, Contact) or not contact.pair.law.has_friction:
            continue
        calls, now = contact.law_calls, contact.now
        before, calls.error = calls.error, None
        now.friction_limit(np.where(contact.active, np.maximum(now.z_n, 0.0), 0.0))
        found, calls.error = calls.error, before
        if isinstance(found, NotFiniteError):
            return str(found)
    return ""


def _describe_twice(contacts: Sequence[Interface]) -> str:
    """Describe nodes whose gap two pairs close along the same normal; "" if none (local)."""
    pairs = [contact for contact in contacts if isinstance(contact, Contact)]
    for k, one in enumerate(pairs):
        for other in pairs[k + 1 :]:
            _, i, j = np.intersect1d(one.slave.nodes, other.slave.nodes, return_indices=True)
            cosine = (one.operators.n[i] * other.operators.n[j]).sum(axis=1)
            parallel = one.active[i] & other.active[j] & (cosine > np.cos(SMALL_ANGLE))
            if parallel.any():
                where = one.operators.x[i[np.argmax(parallel)]]
                return (
                    f"{parallel.sum()} nodes of '{one.slave.name}' are pressed along the same "
                    f"normal by '{one.master.name}' and '{other.master.name}', one at "
                    f"{format_point(where)}, so that their pressures are not unique; leave out one "
                    "of these pairs there"
                )
    return ""


def describe_idle(bulk: Bulk, floating: FloatingBodies, force: float) -> str:
    """Describe bodies that nothing supports, strains or touches; "" otherwise.

    Args:
        bulk: The bodies.
        floating: Those that Dirichlet conditions leave free to move rigidly.
        force: Size of contact forces and reactions in the state that was found [stress length].
    """
    size = max((body.size for body in floating.bodies), default=0.0)
    if not size or force > ASSEMBLY_ROUNDING * bulk.stiffness * size:
        return ""
    F = bulk.cells.deformation_gradients(bulk.positions())
    strain = np.abs(np.einsum("cki,ckj->cij", F, F) - np.eye(bulk.space.dim)).max(initial=0.0)
    if bulk.comm.allreduce(bool(bulk.prescribed.any() or strain > ROUNDING), MPI.LOR):
        return ""
    return (
        f"no Dirichlet condition supports {floating.names(floating.bodies)}, and no load or "
        "contact acts: any rigid motion would be a solution, and the initial one is returned; "
        "check bcs and the loads"
    )


def _describe_peeling(contacts: Sequence[Interface], recent: Sequence[SetsOfPairs]) -> str:
    """Describe nodes with shear without pressure that open and close; "" if none (local)."""
    for i, contact in enumerate(contacts):
        if not isinstance(contact, Contact):
            continue
        active = np.array([sets[i][0] for sets in recent])
        wavers = np.flatnonzero(active.any(axis=0) & ~active.all(axis=0))
        bound = contact.now.friction_limit(np.zeros(contact.slave.num_nodes))
        if wavers.size and 0.0 < bound[wavers[0]] < np.inf:
            return (
                f"{wavers.size} nodes of '{contact.slave.name}' close and open repeatedly, one at "
                f"{format_point(contact.operators.x[wavers[0]])}: {contact.pair.law!r} admits "
                "shear without pressure, which may peel them off each time they close; take "
                "smaller steps, or Coulomb(mu, max_shear=...), whose limit vanishes with the "
                "pressure"
            )
    return ""
