# SPDX-License-Identifier: MIT
"""Solves that do not converge: remedies within the iteration, and messages on the reasons.

``Remedies`` keeps the active sets and residuals of the iterations, and treats cycles and loose
bodies. After a failure ``diagnose`` describes what may be wrong. ``check_diagonal`` and
``describe_isolated`` find what makes the equations singular: nodes without stiffness, and bodies on
which nothing determines the level of a scalar field, such as a temperature. All public functions
are collective.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import combinations
from typing import TYPE_CHECKING, Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk.bodies import join_bodies
from fenics_mortar.bulk.residual import Bulk, row_sizes
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.law import STICK, Branches
from fenics_mortar.contact.pair import Discretization
from fenics_mortar.contact.tied import Tie
from fenics_mortar.contact.tied_rows import rows_of
from fenics_mortar.contact.view import describe_overlap, or_other_weights
from fenics_mortar.equations.arguments import EQUATIONS
from fenics_mortar.interface.surfaces import MIN_SHARE
from fenics_mortar.newton.loop import UNSETTLED, decreased
from fenics_mortar.obstacles.obstacle import is_of_package
from fenics_mortar.obstacles.rigid_motion import RIGID, at_place
from fenics_mortar.rigid.body_motions import names_of, pairs_joined
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import ROUNDING, SMALL_ANGLE, Array, Flags, Indices
from fenics_mortar.utils.errors import MortarError, NotFiniteError, call_together, format_point
from fenics_mortar.utils.ranks import largest_over_ranks, sum_over_ranks

if TYPE_CHECKING:
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.rigid.floating import FloatingBodies

# Active set and branches of each pair in one iteration.
SetsOfPairs = list[tuple[Flags, Branches]]


class Remedies:
    """Sets and residuals of a solve, and remedies if it does not converge; methods are collective.

    Args:
        equations: The ``ContactEquations``.
        adopt_linearized_sets: Function that adopts the sets of the linearized contact problem, also
            beyond a turning point of the load path if its argument is true; returns whether they
            were found.

    Attributes:
        residuals: Norm of all residuals for each evaluation [stress length].
        num_changed: Number of nodes that changed in the last evaluation.
        num_linearized: Number of linearized contact problems in the solve.
    """

    def __init__(self, equations: Any, adopt_linearized_sets: Callable[[bool], bool]) -> None:
        self._contacts: Sequence[Interface] = equations.contacts
        self._floating, self._residual = equations.floating, equations.residual
        self._adopt_linearized_sets = adopt_linearized_sets
        self.begin()

    def begin(self) -> None:
        """Discard the data of the last solve."""
        self.residuals: list[float] = []
        self._sets: list[SetsOfPairs] = []
        self.num_changed = self.num_linearized = 0
        self._has_merged = False

    def record(self, residual: float, changed: int) -> None:
        """Add the present sets; ``changed``: number of nodes that changed."""
        self.residuals.append(residual)
        self._sets.append([(c.active, c.branch) for c in self._contacts])
        self.num_changed = changed

    @property
    def recent(self) -> list[SetsOfPairs]:
        """Sets of the last ``EQUATIONS.recent_sets`` iterations."""
        return self._sets[-EQUATIONS.recent_sets :]

    def replace_unsettled_sets(self) -> None:
        """Adopt the sets of the linearized problem if those of floating bodies cycle.

        That is if they change although the residual does not decrease, see ``decreased``.
        """
        last, exhausted = self.residuals[-2:], self.num_linearized == EQUATIONS.max_calls
        if self._floating.anchored or not self.num_changed or len(last) < 2 or exhausted:
            return
        if not decreased(last[1], last[0]):
            self._adopt_linearized_sets(False)

    def drifts(self) -> str:
        """Describe bodies that are moved by small residual forces only; "" if there are none.

        Contact forces act along averaged normals of facets. Their error drives smooth bodies
        without friction, which may have no equilibrium nearby.
        """
        slight = self.residuals[-1] <= RIGID.slight * self._residual.force  # not nan
        if self._floating.anchored or not slight:
            return ""
        names = names_of(self._floating.loose() or self._floating.bodies)
        return f"the remaining force is slight and moves {names}" if names else ""

    def merge_sets(self, period: int) -> str:
        """Leave a cycle of the active set or of branches; return a remark.

        All nodes that were active in the cycle are set active for one iteration. c_n is at most its
        default in this and later solves: a large c_n opens nodes for small gaps left by a step.
        Nodes that changed branch in the cycle stick for one iteration.

        If sets change without a period, or again in a cycle, the sets of the linearized problem are
        adopted. An example are thin plates that bend by more than their gap if a node opens. Beyond
        a turning point of the load path these sets are adopted only if nodes just open and close:
        the bodies snap through. If nodes change between sticking and sliding, the state after a
        snap-through is not determined. If bodies float, ``replace_unsettled_sets`` has adopted
        these sets before.
        """
        wavering, opening, c_n = 0, 0, Discretization.c_n
        for i, contact in enumerate(self._contacts):
            recent = [sets[i] for sets in self._sets[-period:]]
            active, branches = (np.array(sets) for sets in zip(*recent, strict=True))
            merged = active.any(axis=0) & contact.covered
            wavers = merged & (branches != branches[-1]).any(axis=0)
            branch = np.where(wavers, STICK, contact.branch)
            contact.change(active=merged, c_n=min(contact.c_n, c_n), branch=branch)
            wavering += int(wavers.sum())
            opening += int((active != active[-1]).any(axis=0).sum())
        again, self._has_merged, taken = self._has_merged, True, False
        if (again or period == UNSETTLED) and not self._floating.bodies:
            taken = self._adopt_linearized_sets(opening > 0 and not wavering)
        stuck = f"; {wavering} nodes between sticking and sliding stick in it" * bool(wavering)
        return (
            f"the active set does not converge (last {period} iterations); all nodes active in "
            f"them remain active for one iteration, and c_n is limited to {c_n:g}{stuck}"
        ) + "; that of the linearized problem is used" * taken


def describe_isolated(bulk: Bulk, contacts: Sequence[Interface], floating: FloatingBodies) -> str:
    """Name the bodies and fields whose level nothing determines; "" if none (collective).

    Args:
        bulk: The bodies.
        contacts: All pairs.
        floating: The bodies with their names.
    """
    found = []
    for field in range(bulk.space.whole.num_sub_spaces if bulk.space.is_mixed else 0):
        dofs = None if field == bulk.space.part else _part_of_dofs(bulk, floating, field)
        if dofs is None:
            continue
        count = floating.num_parts
        group, _ = join_bodies(count + 1, list(_conducting(contacts, floating, field)))
        inside, resistance = group[:count][group[:count] != group[count]], np.zeros(count + 1)
        for resists in (_prescribed_parts, _resist_themselves, _resist_by_displacements):
            if not resistance[inside].all():
                resistance += np.bincount(group, resists(bulk, *dofs, count), count + 1)
        for label in np.unique(group[:count]):
            if label != group[count] and resistance[label] == 0.0:
                parts = np.flatnonzero(group == label)
                names = " and ".join(
                    sorted(floating.name_of(int(p), floating.parts) for p in parts)
                )
                found.append(
                    f"nothing determines the level of field {field} of {names}: neither Dirichlet "
                    "conditions, nor its equation, nor conduction across contact"
                )
    return "; ".join(found)


def _part_of_dofs(bulk: Bulk, floating: FloatingBodies, field: int) -> tuple[Indices, Flags] | None:
    """Part of the mesh of each owned dof, and whether it is of the field; ``None`` for vectors.

    The part of dofs that are neither of the field nor of the displacement is -1.
    """
    Q, numbers = bulk.space.fields[field]
    if Q.dofmap.index_map_bs > 1 or Q.num_sub_spaces:
        return None
    cells = floating.parts[compat.dofmap(bulk.V)[:, :1]]
    part_of = np.full(bulk.u.x.array.size, -1)
    part_of[compat.dofmap(bulk.space.whole)] = cells
    part_of[bulk.space.dofs] = floating.parts[:, None]
    of_field = np.zeros(part_of.size, dtype=bool)
    dofs = numbers[compat.dofmap(Q)]
    part_of[dofs], of_field[dofs] = cells, True
    return part_of[: bulk.num_owned], of_field[: bulk.num_owned]


def _prescribed_parts(bulk: Bulk, part_of: Indices, of_field: Flags, count: int) -> Array:
    """1 for parts in which the field is prescribed somewhere, else 0, (count + 1,)."""
    prescribed = of_field & bulk.prescribed[: of_field.size]
    conditions = np.bincount(part_of[prescribed], minlength=count + 1)
    return np.where(sum_over_ranks(bulk.comm, conditions) > 0, 1.0, 0.0)


def _resist_themselves(bulk: Bulk, part_of: Indices, of_field: Flags, count: int) -> Array:
    """1 for parts where the equation of a field resists a constant, else 0, (count + 1,).

    The last entry is that of no part. With ``bulk.K`` assembled anew.
    """
    bulk.assemble_tangent()
    rows = compat.products(bulk.K, 1.0 * of_field[None])[0], bulk.K.getDiagonal().array_r
    (within,) = _above_rounding(bulk, part_of, count, [(of_field, *rows)])
    return np.where(within, 1.0, 0.0)


def _resist_by_displacements(bulk: Bulk, part_of: Indices, of_field: Flags, count: int) -> Array:
    """1 for parts where displacements resist a constant field, else 0, (count + 1,).

    A pressure is resisted by displacements that are not prescribed, on which it acts and which
    change its equations; temperatures only expand the bodies. Needs ``_resist_themselves`` before.
    """
    one, fixed = 1.0 * of_field, bulk.prescribed[: of_field.size]
    moved, transpose = (part_of >= 0) & ~of_field, bulk.K.transpose(PETSc.Mat())
    displaced = np.zeros(bulk.u.x.array.size, bool)
    displaced[bulk.space.dofs] = True
    acts, follows = (
        (compat.products(matrix, one[None])[0], row_sizes(matrix, one))
        for matrix in (bulk.K, transpose)
    )
    transpose.destroy()
    if bulk.comm.allreduce(bool(acts[1][of_field].any()), MPI.LOR):  # no multiplier
        moved &= displaced[: of_field.size]
    rows = [(moved, np.where(fixed, 0.0, sums), entries) for sums, entries in (acts, follows)]
    acts_on_free, follows_free = _above_rounding(bulk, part_of, count, rows)
    return np.where(acts_on_free & follows_free, 1.0, 0.0)


def _above_rounding(
    bulk: Bulk, part_of: Indices, count: int, rows: Sequence[tuple[Flags, Array, Array]]
) -> Flags:
    """Whether parts have rows whose sums are above rounding of the entries, (rows, count + 1).

    Args:
        bulk: The bodies.
        part_of: Part of each owned dof, shape (n,).
        count: Number of parts.
        rows: Which dofs count, and sums and entries of their rows, shape (n,) each.
    """
    sizes = np.zeros((len(rows), 2, count + 1))
    for size, (on, *values) in zip(sizes, rows, strict=True):
        for largest, value in zip(size, values, strict=True):
            np.maximum.at(largest, part_of[on], np.abs(value[on]))
    sums, entries = largest_over_ranks(bulk.comm, sizes).swapaxes(0, 1)
    return np.asarray(sums > ROUNDING * entries)


def _conducting(
    contacts: Sequence[Interface], floating: FloatingBodies, field: int
) -> Iterator[Indices]:
    """Pairs of parts between which a field flows, (k, 2) each; the number of parts: an obstacle."""
    for contact in contacts:
        for flux in contact.fluxes:
            slave, *master = (floating.parts_of(trace.surface) for trace in flux.traces)
            if isinstance(contact, Tie):
                if flux.field == field:
                    yield pairs_joined(flux.M, slave, master[0])
            elif flux.law.field == field:
                on = flux.nodal().conductance > 0.0
                none = np.full(slave[on].size, floating.num_parts)
                M = rows_of(on, contact.operators.matrices[1])
                yield pairs_joined(M, slave, *master) if master else np.stack([slave[on], none], 1)


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
    largest = np.full(floating.num_bodies, -np.inf)
    np.maximum.at(largest, labels, diagonal[dofs].max(axis=1))
    negative = np.flatnonzero(largest_over_ranks(bulk.comm, largest) < 0.0).tolist()
    if negative:
        names = ", ".join(map(floating.name_of, negative))
        which = f" of {names}" if len(negative) < floating.num_bodies else ""
        raise MortarError(
            f"all stiffnesses{which} are negative: check the signs of the residual, which is "
            "internal minus applied forces, of the jacobian, and of Young's modulus"
        )
    loose = np.zeros(diagonal.size, bool)
    loose[dofs] = (diagonal[dofs] == 0.0) & ~bulk.prescribed[dofs]
    count, where = bulk.input_data.count_nodes(loose)
    if count:
        mine = np.bincount(labels[loose[dofs].any(axis=1)], minlength=floating.num_bodies)
        bodies = np.flatnonzero(sum_over_ranks(bulk.comm, mine)).tolist()
        names = ", ".join(map(floating.name_of, bodies))
        raise MortarError(
            f"the bulk tangent has no stiffness at {count} nodes, one at {where}, of {names}: "
            "the residual form has to contain the stress of every body"
        )


def diagnose(equations: Any, recent: Sequence[SetsOfPairs]) -> str:
    """Describe inverted cells, few points, loose bodies, laws, edges and overlaps; "" if none.

    Args:
        equations: The ``ContactEquations``.
        recent: Sets of the last iterations.
    """
    bulk, contacts, floating = equations.bulk, equations.contacts, equations.floating
    first = describe_inverted(bulk)
    at_nodes = "" if first else bulk.describe_inverted_nodes()
    if not first:
        loose = [
            f"{body.name} can {body.describe(motion)}"
            for body in floating.loose()
            for motion in np.eye(len(body.motions))
        ]
        first = ", ".join(loose + equations.motions.describe(equations.residual.force))
        first = first or _describe_limits(contacts) or _describe_twice(contacts)
        first = first or _describe_slivers(contacts) or _describe_wavering(contacts, recent)
        first = first or describe_isolated(bulk, contacts, floating)
    few, behind = _describe_few_points(bulk), _describe_behind(equations)
    overlaps = [behind] if behind else map(describe_overlap, contacts)
    return "; ".join(filter(None, (first, at_nodes, few, *overlaps)))


def _describe_behind(equations: Any) -> str:
    """Describe a body that lay wholly behind an obstacle's surface at the start; "" if none."""
    outline, accepted = equations.crossings.outline, equations.crossings.accepted
    x, before = accepted.x, dict(zip(equations.motions.obstacles, accepted.places))
    for contact in equations.contacts:
        obstacle = contact.obstacle
        # A user's function need be finite beside its pairs only.
        if not isinstance(contact, Contact) or obstacle is None or not is_of_package(obstacle):
            continue
        at = x[np.isin(outline.bodies, np.unique(outline.bodies_of(contact.slave)))]
        what = f"the distance of '{obstacle.name}'"
        with at_place(obstacle, before.get(obstacle, obstacle.place)):
            depths = -call_together(outline.comm, what, partial(obstacle.evaluate, at))[0]
        if (depths > 0.0).all():
            least, most = int(depths.argmin()), int(depths.argmax())
            return (
                f"the whole body of '{contact.slave.name}' lies in the solid of obstacle "
                f"'{obstacle.name}' at the start of this solve, {depths[least]:.3g} to "
                f"{depths[most]:.3g} behind its surface, the latter at {format_point(at[most])}: "
                "the outward normal of an obstacle points to the body, which has to be on that "
                f"side; move the obstacle back by {depths[most]:.3g}, to where it touches the body"
            )
    return ""


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
    for one, other in combinations(pairs, 2):
        _, i, j = np.intersect1d(one.slave.nodes, other.slave.nodes, return_indices=True)
        cosine = (one.operators.n[i] * other.operators.n[j]).sum(axis=1)
        parallel = one.active[i] & other.active[j] & (cosine > np.cos(SMALL_ANGLE))
        if parallel.any():
            return (
                f"{parallel.sum()} nodes of '{one.slave.name}' are pressed along the same normal "
                f"by '{one.master.name}' and '{other.master.name}', {_one_of(one, i[parallel])}, "
                "so that their pressures are not unique; leave out one of these pairs there"
            )
    return ""


def _describe_slivers(contacts: Sequence[Interface]) -> str:
    """Describe pairs that touch only on hardly covered facets; "" if there are none (local)."""
    for contact in contacts:
        if not isinstance(contact, Contact) or contact.obstacle is not None:
            continue
        cover = contact.operators.cover / contact.slave.full_cover
        if contact.active.any() and (cover[contact.active] < MIN_SHARE).all():
            where = _one_of(contact, np.flatnonzero(contact.active))
            return (
                f"{contact.active.sum()} nodes of '{contact.slave.name}' touch on less than "
                f"{MIN_SHARE:.0%} of their facets, {where}, as where corners "
                "or edges with parallel sides stand on each other: this part vanishes as the gap "
                "closes, and no pressure on it may balance the loads; move one side along, round "
                "its edge, or refine both sides there"
            )
    return ""


def _describe_wavering(contacts: Sequence[Interface], recent: Sequence[SetsOfPairs]) -> str:
    """Describe nodes that open and close, and why; "" if none (local)."""
    for i, contact in enumerate(contacts):
        active = np.array([sets[i][0] for sets in recent])
        wavers = np.flatnonzero(active.any(axis=0) & ~active.all(axis=0))
        if not isinstance(contact, Contact) or not wavers.size:
            continue
        nodes, count = f"{wavers.size} nodes of '{contact.slave.name}'", len(active)
        bounds = contact.now.friction_limit(np.zeros(contact.slave.num_nodes))[wavers]
        peeled = wavers[(bounds > 0.0) & (bounds < np.inf)]
        where = _one_of(contact, peeled if peeled.size else wavers)
        if peeled.size:
            return (
                f"{nodes} close and open repeatedly, {where}: "
                f"{contact.pair.law!r} admits shear without pressure, which may peel them off each "
                "time they close; take smaller steps, or Coulomb(mu, max_shear=...), whose limit "
                "vanishes with the pressure"
            )
        if not any((active[: count - k] == active[k:]).all() for k in range(2, count)):
            continue
        jumping = [flux.law for flux in contact.conductances if flux.law.jumps]
        if jumping:
            why = (
                f"where {jumping[-1]!r} jumps at closing, bodies that shrink by what flows open "
                "again: there may be no such state; take a conductance that begins with the "
                "pressure, as PressureConductance"
            )
        else:
            exchange = ", exchange slave and master" * (contact.obstacle is None)
            why = (
                "neither set may be a solution on facets within which the sides bend apart, as at "
                f"a tip or an edge; refine '{contact.slave.name}' there{exchange}"
                f"{or_other_weights(contact)}"
            )
        return f"{nodes} open and close in turn, {where}: {why}"
    return ""


def _one_of(contact: Contact, nodes: Indices) -> str:
    """Position of the first of slave ``nodes`` (k,) by place, not by number, as text (local)."""
    first = nodes[np.lexsort(contact.slave.X[nodes].T)[0]]
    return f"one at {format_point(contact.operators.x[first])}"


def _describe_few_points(bulk: Bulk) -> str:
    """Remark on cells that the form does not hold; "" if there are none (collective)."""
    count, where = bulk.cells.count(bulk.form_points.too_few())
    return (
        f"the form has too few points in {count} cells, one at {where}, to resist all of their "
        "motions: raise quadrature_degree, for displacements of degree 2 to 4"
    ) * bool(count)
