# SPDX-License-Identifier: MIT
"""The certificate of a solved state: what must hold, measured after the fact.

Newton says that the equations it was given are solved. Whether they are those of contact, is asked
here of the state alone: balance of slave and master and of reactions and loads, signs,
complementarity, penetration between the nodes, nodes inside another body that found no partner, and
outlines that cross, whether contact sees them or not.

All that may hold where a corner presses, and the force still be far off. That of a slave's corner
acts along its own averaged normal, not along that of the smooth surface it presses on: an error
like friction, and so it is judged against the friction there is. With the smooth surface as slave
the direction is right, but a master's corner between two slave nodes is felt up to a tenth of the
facet too early or too late. Neither is less on a finer mesh, in facets. What tells of both is that
the normals of the two sides are not opposite.

A held slave node carries no multiplier, its neighbours bear its part. If a body leans on the very
end of a held surface, all its force is at that neighbour, which gives way: too small a force by far
on any mesh. What tells of that is a peak of pressure there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fenics_mortar.asking import raise_noted
from fenics_mortar.bulk import Bulk
from fenics_mortar.contact import Contact
from fenics_mortar.crossing import Crossing
from fenics_mortar.errors import place
from fenics_mortar.interface import Interface
from fenics_mortar.resultant import beyond_cover
from fenics_mortar.surfaces import Array, Indices
from fenics_mortar.tied import Tie

# Pressures below the first part of the stiffness, and forces below the second of stiffness and
# displacement, are compared with these instead of each other: they may be rounding. Displacements
# below the third of the slave's extent count as that large: without loads all forces are rounding.
ROUNDING, FORCE_ROUNDING, STILL = 1e-6, 1e-4, 1e-5
# A node is inside an obstacle if it is deeper than this part of its length.
DEEP = 0.5
# Normals of slave and master may differ by this sine before that is told of.
SLANT = 0.1
# With friction, the error of H/V by the direction of a corner's normal is told of from this part of
# H/V on, but for what is not to be seen. Measured on wedges of 90 to 150 degrees: where it is 5 %,
# what is estimated is between 3.5 and 6 %.
OF_FRICTION, LEAST_SLANT = 0.04, 0.005
# Facets that turn by more than this stand for a corner, not for a curve [radian].
CORNER = 0.3
# So many facets of the master beside a corner tell which direction its surface has.
AROUND_CORNERS = 3
# So many times may the pressure beside held slave nodes be that of the next ones. Pressures below
# a part of the largest do not count.
LEANS, COUNTS = 2.0, 0.1
SAMPLES = np.linspace(-1.0, 1.0, 5)
# Facets stand for surfaces: what these do between the nodes is told of from so many facet lengths
# on. Curved bodies on coarse meshes overlap by less; dual functions feel corners from a tenth.
TOLD_PENETRATION, TOLD_DISTANCE = 0.2, 0.05


@dataclass(frozen=True)
class PairCertificate:
    """Measured defects of one pair; all are plain numbers, zero is perfect.

    Of a tied pair, what it may do (tension, shear) and cannot do (penetration) is zero.

    Attributes:
        pair: Names of slave and master.
        force: Sum of all contact forces over the sum of their sizes. Rounding.
        moment: Sum of their moments over forces times lever arms. Of third order in the facets; of
            a tied pair without gap rounding.
        tension: By how much the pull -z_n exceeds the adhesion of the contact law, if there is any,
            over the largest pressure or pull.
        shear: By how much the tangential multiplier exceeds what the contact law allows at most,
            over the largest pressure (or what the law allows, where that is more).
        overlap: Largest negative mean gap of a slave node over its length; of a tied pair how far
            the sides have moved apart.
        overlap_at: Where that is.
        reach: How far away partners are looked for, in words.
        complementarity: Largest |(z_n + a) g|, a: the adhesion, over largest pressure and length.
        penetration: Deepest point of a segment in the master over its facet's length: what the
            discretisation allows between the nodes, of second order in the facets.
        distance: Least distance of slave and master over the facet's length if a force acts.
        where: Place of the deepest point, in words.
        slant: Part of the forces along the slave's normals that acts along the master's facets; of
            first order in the facets where both surfaces are smooth.
        slant_at: Where most of it acts.
        misdirected: Part of the normal forces that acts along the surface, since a corner of the
            slave has an averaged normal: an error of the ratio of shear and normal force. Those of
            nodes side by side that press are added up with their signs.
        friction: Shear that the contact law allows at most over the pressure, mean of all nodes
            that press; inf where they stick whatever the shear.
        lean: Pressure beside a slave node that is held over that of the next nodes, the largest.
        lean_at: Where that is.
        beyond: How far the resultant of pressures side by side lies beyond the part of the slave
            that the master covers, the farthest, over the facet's length.
        beyond_at: Where that resultant acts.
        undecided_at: Where a node is covered by about as much as makes it carry a multiplier.
        overheld: Sticking nodes that other constraints hold as well: their shear is not unique, see
            ``redundancy``.
        overheld_at: Where one of them is.
        unpaired: Nodes of the two surfaces inside another body without any partner.
        uncovered: Slave nodes without a partner.
    """

    pair: str
    force: float
    moment: float
    tension: float = 0.0
    shear: float = 0.0
    overlap: float = 0.0
    overlap_at: str = ""
    reach: str = ""
    complementarity: float = 0.0
    penetration: float = 0.0
    distance: float = 0.0
    where: str = ""
    slant: float = 0.0
    slant_at: str = ""
    misdirected: float = 0.0
    friction: float = 0.0
    lean: float = 0.0
    lean_at: str = ""
    beyond: float = 0.0
    beyond_at: str = ""
    undecided_at: str = ""
    overheld: int = 0
    overheld_at: str = ""
    unpaired: int = 0
    uncovered: int = 0

    def violations(self, tolerance: float = 1e-6, penetration: float = 0.5) -> list[str]:
        """What does not hold, in words; empty for a sound state.

        Args:
            tolerance: For what the equations make zero.
            penetration: For what the mesh makes small, distance too [facet lengths].
        """
        return list(self._violations(tolerance, penetration))

    def _violations(self, tolerance: float, penetration: float) -> Iterator[str]:
        for name in ("force", "tension", "shear", "overlap", "complementarity"):
            value = getattr(self, name)
            if not value <= tolerance:
                where = f" {self.overlap_at}" if name == "overlap" else ""
                yield f"{self.pair}: {name} {value:.1e} (allowed {tolerance:.1e}){where}"
        if not self.penetration <= penetration:
            yield (
                f"{self.pair}: penetration of {self.penetration:.2f} facets between the nodes, at "
                f"{self.where}"
            )
        if not self.distance <= penetration:
            yield f"{self.pair}: a force acts, and the sides are {self.distance:.2f} facets apart"
        if not self.beyond <= penetration:
            yield self._beyond()
        if self.unpaired:
            yield (
                f"{self.pair}: {self.unpaired} nodes are inside another body and have no partner: "
                f"contact was missed, since partners are looked for {self.reach}; take smaller "
                "steps or a larger search_radius"
            )

    def _beyond(self) -> str:
        """Where a resultant acts that the surfaces do not allow."""
        return (
            f"{self.pair}: the resultant of the pressures acts at {self.beyond_at}, "
            f"{self.beyond:.2f} facets beyond the part of the slave that the master covers: more "
            "load may be borne here than finer facets bear"
        )

    def _remarks_on_corners(self) -> Iterator[str]:
        """What corners do, as against what friction may do where there is any."""
        most = min(SLANT, max(OF_FRICTION * self.friction, LEAST_SLANT))
        if self.friction > 0.0 and self.misdirected > most:
            slave, _, master = self.pair.partition(" - ")
            yield (
                f"{self.pair}: {self.misdirected:.1%} of the normal forces act along the surface, "
                f"beside a friction of {self.friction:.2g}: a corner of the slave presses at "
                f"{self.slant_at}, along its averaged normal; take '{master}' as slave and "
                f"'{slave}' as master, or round it"
            )
        if self.friction > 0.0 or not self.slant > SLANT:
            return
        is_slave = self.misdirected > 0.5 * SLANT
        known = "direction and depth are" if is_slave else "depth is"
        remedy = "take the other side as slave, round it" if is_slave else "round it"
        yield (
            f"{self.pair}: {self.slant:.0%} of the normal forces act along the master's facets, "
            f"most at {self.slant_at}: where a corner presses, {known} known up to a part of a "
            f"facet only; {remedy}, or make facets much finer"
        )

    def remarks(self) -> Iterator[str]:
        """What the mesh is too coarse for, in words."""
        if self.penetration > TOLD_PENETRATION:
            yield (
                f"{self.pair}: penetration of {self.penetration:.2f} facets between the nodes, at "
                f"{self.where}; finer facets lessen it"
            )
        if self.distance > TOLD_DISTANCE:
            yield (
                f"{self.pair}: a force acts, and the sides are {self.distance:.2f} facets apart; "
                "finer facets of the slave would bring them closer"
            )
        yield from self._remarks_on_corners()
        if self.beyond > TOLD_DISTANCE:
            yield self._beyond()
        if self.lean > LEANS:
            yield (
                f"{self.pair}: a body leans on a held slave node, at {self.lean_at}, which carries "
                "no multiplier: the force may be far too small; take the other body as slave"
            )
        if self.overheld:
            yield (
                f"{self.pair}: {self.overheld} sticking nodes are held by other pairs as well, one "
                f"at {self.overheld_at}: their shear is not unique, and stays as near as it can to "
                "that of the last state"
            )
        if self.undecided_at:
            yield (
                f"{self.pair}: the master ends just beside the node at {self.undecided_at}, where "
                "its multiplier goes to its neighbour or comes back: there may be two solutions, "
                "with and without; other steps may find the other one"
            )


@dataclass(frozen=True)
class Certificate:
    """Measured defects of a state; prints as a Markdown table.

    Attributes:
        pairs: Those of each pair.
        balance: Largest sum of reactions, loads and contact forces of a body or obstacle, over the
            sum of the sizes of all forces.
        inverted: Cells that are inverted.
        springs: Largest sum of the forces of springs on a body, over the contact force on it; zero
            but where the record of the solve tells of them.
        strayed: Of the report of a solve: how far an obstacle that forces drive slid in it, with
            all its nodes and beyond where what was prescribed took it, over the width of its
            contact. The state is in equilibrium; whether a path leads there was not seen.
    """

    pairs: list[PairCertificate]
    balance: float
    inverted: int
    springs: float = 0.0
    strayed: float = 0.0
    crossings: list[Crossing] = field(default_factory=list)
    passages: list[str] = field(default_factory=list)

    def violations(
        self, tolerance: float = 1e-6, penetration: float = 0.5, springs: float = 0.005
    ) -> list[str]:
        """What does not hold, in words; empty for a sound state.

        Args:
            tolerance: For what the equations make zero.
            penetration: For what the mesh makes small [facet lengths].
            springs: For what springs may hold, see ``release``.
        """
        found = [v for pair in self.pairs for v in pair.violations(tolerance, penetration)]
        if not self.balance <= tolerance:
            found.append(f"balance of a body {self.balance:.1e} (allowed {tolerance:.1e})")
        if not self.springs <= springs:
            found.append(
                f"springs hold {self.springs:.1e} of the contact force (allowed {springs:.1e})"
            )
        if not self.strayed <= 1.0:
            found.append(
                f"an obstacle that forces drive slid away, by {self.strayed:.1f} widths of its "
                "contact: this may be another equilibrium than the one it comes to; take smaller "
                "steps, or prescribe its motion"
            )
        if self.inverted:
            found.append(f"{self.inverted} cells are inverted")
        found += [str(crossing) for crossing in self.crossings if crossing.facets > penetration]
        return found + self.passages

    def remarks(self) -> list[str]:
        """What holds in the mean only, since the mesh is too coarse; in words."""
        return [remark for pair in self.pairs for remark in pair.remarks()]

    def __str__(self) -> str:
        """One row per measure, one column per pair."""
        names = [f.name for f in fields(PairCertificate) if f.type != "str"]
        lines = ["| | " + " | ".join(pair.pair for pair in self.pairs) + " |"]
        lines.append("|---|" + "---:|" * len(self.pairs))
        for name in names:
            cells = [f"{getattr(pair, name):.2g}" for pair in self.pairs]
            lines.append(f"| {name} | {' | '.join(cells)} |")
        lines.append(
            f"\nbalance of the bodies: {self.balance:.1e}; inverted cells: {self.inverted}"
        )
        return "\n".join([*lines, *(self.violations() or self.remarks())])


def certify(
    bulk: Bulk, contacts: Sequence[Contact | Tie], labels: Indices, unbalanced: Array
) -> Certificate:
    """Measure the present state (collective).

    Args:
        bulk: The bodies, with ``r`` at the present state.
        contacts: The pairs, evaluated there.
        labels: Body of each local node.
        unbalanced: Sums of all forces on the obstacles, equal on all ranks [stress length].
    """
    paired = np.unique(np.concatenate([np.empty(0, np.int64), *map(_paired_nodes, contacts)]))
    inverted, _ = bulk.inverted_cells()
    pairs = [
        _certify_tie(c) if isinstance(c, Tie) else _certify_pair(bulk, c, labels, paired)
        for c in contacts
    ]
    raise_noted(bulk.comm, contacts)
    return Certificate(pairs, _balance(bulk, contacts, labels, unbalanced), inverted)


def _balance(
    bulk: Bulk, contacts: Sequence[Contact | Tie], labels: Indices, unbalanced: Array
) -> float:
    """Largest sum of reactions, loads and contact forces of a body or obstacle, relative.

    Collective. Internal forces sum to zero, so the sum of r over a body is minus the load applied
    to it; a reaction is what is left of r and contact forces at a prescribed dof.
    """
    r = bulk.r.array_r[: bulk.num_owned]
    total = r.copy()
    for contact in contacts:
        on_slave, on_master = contact.operators.force(contact.z)
        contact.slave.scatter_add(on_slave, total)
        contact.master.scatter_add(on_master, total)
    total[bulk.held] = 0.0
    comm, dofs = bulk.comm, bulk.space.owned_dofs
    body = labels[: len(dofs)]
    num_bodies = comm.allreduce(int(labels.max(initial=0)), MPI.MAX) + 1
    sums = [np.bincount(body, component, num_bodies) for component in total[dofs].T]
    defects, size = comm.allreduce(np.array(sums)), comm.allreduce(float(np.abs(r[dofs]).sum()))
    motion = comm.allreduce(float(np.abs(bulk.u.x.array[dofs]).max(initial=0.0)), MPI.MAX)
    stiffness = max((float(c.stiffness.max()) for c in contacts), default=bulk.stiffness)
    extent = max((float(np.ptp(c.slave.X, axis=0).max()) for c in contacts), default=0.0)
    rounding = FORCE_ROUNDING * stiffness * max(motion, STILL * extent)
    defect = max(np.abs(defects).max(), np.abs(unbalanced).max(initial=0.0))
    return float(defect) / _positive(size + rounding)


def _certify_pair(
    bulk: Bulk, contact: Contact, labels: Indices, paired: Indices
) -> PairCertificate:
    """Measure one pair; ``paired``: global numbers of the nodes that have a partner in any pair."""
    pressure = np.einsum("jc,jc->j", contact.operators.n, contact.z)
    bound = contact.asker.bound(contact.pair.law, pressure, contact.operators.x)
    bound = np.where(contact.active, bound, 0.0)
    excess, tension = np.abs(contact.z_tau) - bound, contact.tension
    largest = max(float(np.abs(pressure).max()), ROUNDING * float(contact.stiffness.max()))
    gap = np.nan_to_num(contact.gap) / contact.nodal_lengths
    return PairCertificate(
        **_action_and_reaction(contact),
        tension=max(float(tension.max()), 0.0) / largest,
        shear=max(float(excess.max()), 0.0) / max(largest, float(bound.max())),
        overlap=max(-float(gap.min()), 0.0),
        overlap_at=f"at {place(contact.operators.x[gap.argmin()])}, in facets; partners are looked "
        f"for {contact.reach}",
        reach=contact.reach,
        complementarity=float(np.abs(tension * gap).max()) / largest,
        **_between_nodes(contact),
        **_slant(contact, pressure),
        friction=_friction(bound, pressure),
        **_lean(contact, pressure),
        **beyond_cover(contact, _runs(contact)),
        overheld=int(contact.overheld.sum()),
        overheld_at=place(contact.operators.x[contact.overheld.argmax()]),
        undecided_at=" and ".join(map(place, contact.operators.x[contact.undecided])),
        unpaired=_count_unpaired(bulk, contact, labels, paired),
        uncovered=int((contact.carries & ~contact.covered).sum()),
    )


def _certify_tie(tie: Tie) -> PairCertificate:
    """Measure one tied pair, which bears tension and shear as well."""
    return PairCertificate(
        **_action_and_reaction(tie),
        overlap=float(np.nanmax(tie.gap / tie.nodal_lengths)),
        uncovered=int((tie.operators.cover <= 0.0).sum()),
    )


def _action_and_reaction(contact: Interface) -> dict[str, Any]:
    """What the forces of a pair sum to."""
    o = contact.operators
    where, reaction = o.reaction(contact.z)
    forces, x = np.concatenate([o.force(contact.z)[0], reaction]), np.concatenate([o.x, where])
    lever = x - x.mean(axis=0)
    moments = lever[:, 0] * forces[:, 1] - lever[:, 1] * forces[:, 0]
    sizes = np.abs(forces)
    arms = float((sizes.max(axis=1) * np.abs(lever).max(axis=1)).sum())
    return {
        "pair": f"{contact.slave.name} - {contact.master.name}",
        "force": float(np.abs(forces.sum(axis=0)).max()) / _positive(float(sizes.sum())),
        "moment": abs(float(moments.sum())) / _positive(arms),
    }


def _positive(value: float) -> float:
    """``value``, or one where there is nothing to compare with."""
    return value if value > 0.0 else 1.0


def _between_nodes(contact: Contact) -> dict[str, Any]:
    """Deepest point of all segments, where, and least distance, over facet lengths (collective)."""
    o, s = contact.operators, contact.intersections()
    ends = o.x[s.slave[:, [0, -1]]]
    gaps = o.sample_gaps(o.x + contact.offset[:, None] * o.n, s, SAMPLES)
    gaps /= np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[:, None]
    least, where = np.inf, ""
    if gaps.size:
        deepest = gaps.min(axis=1).argmin()
        least, where = float(gaps[deepest].min()), place(ends[deepest].mean(axis=0))
    least, where = min(contact.slave.comm.allgather((least, where)))
    return {
        "penetration": max(-least, 0.0),
        "distance": max(least, 0.0) if contact.active.any() else 0.0,
        "where": where,
    }


def _slant(contact: Contact, pressure: Array) -> dict[str, Any]:
    """Which part of the normal forces acts along the master's facets, and where (collective)."""
    o, s = contact.operators, contact.operators.segments
    if contact.obstacle is not None:
        return {}
    chords = o.m[s.master[:, -1]] - o.m[s.master[:, 0]]
    chords /= np.linalg.norm(chords, axis=1)[:, None]
    forces = np.abs(o.M.sum(axis=2) * pressure[s.slave])
    along = forces * np.abs(np.einsum("sjc,sc->sj", o.n[s.slave], chords))
    nodal = np.zeros((2, contact.slave.num_nodes))
    for row, values in zip(nodal, (forces, along), strict=True):
        np.add.at(row, s.slave, values)
    contact.slave.comm.Allreduce(MPI.IN_PLACE, nodal)
    all_forces = _positive(float(nodal[0].sum()))
    return {
        "slant": float(nodal[1].sum()) / all_forces,
        "slant_at": place(o.x[nodal[1].argmax()]),
        "misdirected": _misdirected(contact, nodal[0]) / all_forces,
    }


def _friction(bound: Array, pressure: Array) -> float:
    """Sum of what the contact law lets nodes bear along the surface over that of pressures."""
    presses = (pressure > 0.0) & (bound > 0.0)
    return float(bound[presses].sum() / pressure[presses].sum()) if presses.any() else 0.0


def _misdirected(contact: Contact, forces: Array) -> float:
    """What of the normal forces acts along the surface where the slave has corners (collective).

    The force on a node acts along its averaged normal. Where the normal of the master around lies
    between those of the two slave facets at the node, a corner of the slave presses on the master,
    and that would be right; where it lies beyond, the normal of the nearer slave facet. Beyond the
    end of a slave surface its body may go on at any angle.

    Args:
        contact: The pair.
        forces: Sizes of the normal forces, shape (slave nodes,).
    """
    o, slave = contact.operators, contact.slave
    before, after = (
        np.where(beside < 0, end, _angle(o.n, _right_of(way * (o.x[beside] - o.x))))
        for beside, end, way in (
            (slave.previous, -np.pi / 2, -1.0),
            (slave.following, np.pi / 2, 1.0),
        )
    )
    corners = np.flatnonzero(contact.active & (after - before > CORNER))
    if not corners.size:
        return 0.0
    runs = np.where(contact.active, _runs(contact), -1)
    kept, labels = np.unique(runs[corners], return_inverse=True)
    low, high = np.minimum(before[corners], 0.0), np.maximum(after[corners], 0.0)
    normals = np.array([_master_normal(contact, runs == run) for run in kept])
    angle = np.clip(_angle(o.n[corners], -normals[labels]), low, high)
    return float(np.abs(np.bincount(labels, forces[corners] * np.sin(angle))).sum())


def _master_normal(contact: Contact, run: npt.NDArray[np.bool_]) -> Array:
    """Normal of the master around what some slave nodes face, of any length (collective).

    That of a chord which goes some facets beyond on either side: beneath a corner they are dented.

    Args:
        contact: The pair.
        run: The active nodes of a run, shape (slave nodes,), bool.
    """
    o, s, master = contact.operators, contact.operators.segments, contact.master
    faced = np.zeros(master.num_nodes, bool)
    faced[s.master[run[s.slave].any(axis=1)]] = True
    contact.slave.comm.Allreduce(MPI.IN_PLACE, faced, MPI.LOR)
    on_facet = faced[master.facets].all(axis=1)
    for _ in range(AROUND_CORNERS):
        faced[master.facets[on_facet]] = True
        on_facet = faced[master.facets].any(axis=1)
    ends = o.m[master.facets[on_facet]]
    return _right_of((ends[:, -1] - ends[:, 0]).sum(axis=0, keepdims=True))[0]


def _right_of(directions: Array) -> Array:
    """Vectors (n, 2) a quarter turn to the right of others."""
    return np.stack([directions[:, 1], -directions[:, 0]], axis=1)


def _angle(a: Array, b: Array) -> Array:
    """Angles from vectors ``a`` to ``b``, shapes (..., 2) [radian]."""
    turn = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return np.arctan2(turn, (a * b).sum(axis=-1))


def _runs(contact: Contact) -> Indices:
    """Number of the run of active nodes side by side that each slave node is in, (nodes,)."""
    slave, active = contact.slave, contact.active
    here = np.flatnonzero(active & (slave.following >= 0) & active[slave.following])
    count = slave.num_nodes
    links = coo_array((np.ones(here.size), (here, slave.following[here])), shape=(count, count))
    _, labels = connected_components(links, directed=False)
    return labels.astype(np.int64)


def _lean(contact: Contact, pressure: Array) -> dict[str, Any]:
    """Largest pressure beside a held slave node over that of the next nodes, and where."""
    slave, reach = contact.slave, contact.slave.degree
    held = (contact.free == 0.0).any(axis=1) & np.isin(slave.nodes, contact.idle_nodes)
    around = slave.along(np.flatnonzero(held), range(-3 * reach, 3 * reach + 1))
    there = np.where(around >= 0, pressure[around], 0.0)
    beside = there[:, 2 * reach : 4 * reach + 1].max(axis=1, initial=0.0)
    there[:, 2 * reach : 4 * reach + 1] = 0.0
    beside = np.where(beside > COUNTS * pressure.max(initial=0.0), beside, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        lean = np.nan_to_num(beside / there.max(axis=1, initial=0.0), posinf=np.inf)
    if not lean.any():
        return {}
    where = contact.operators.x[np.flatnonzero(held)[lean.argmax()]]
    return {"lean": float(lean.max()), "lean_at": place(where)}


def _paired_nodes(contact: Contact | Tie) -> Indices:
    """Global numbers of the nodes of both surfaces that have a partner (collective)."""
    o = contact.operators
    seen = np.zeros(contact.master.num_nodes, bool)
    seen[contact.intersections().master.ravel()] = True
    contact.slave.comm.Allreduce(MPI.IN_PLACE, seen, MPI.LOR)
    return np.concatenate([contact.slave.nodes[o.cover > 0.0], contact.master.nodes[seen]])


def _count_unpaired(bulk: Bulk, contact: Contact, labels: Indices, paired: Indices) -> int:
    """Nodes of both surfaces inside another body or obstacle that have no partner in any pair."""
    o = contact.operators
    mine = bulk.spread(labels)
    found = 0
    for surface, x in ((contact.slave, o.x), (contact.master, o.m)):
        alone = ~np.isin(surface.nodes, paired)
        own = surface.gather(mine)[:, 0]
        found += int(bulk.inside_other_body(x[alone], own[alone], labels).sum())
    if contact.obstacle is not None:
        phi = contact.on_obstacle.phi - contact.offset
        deep = phi < -DEEP * contact.nodal_lengths
        found += int((deep & ~np.isin(contact.slave.nodes, paired)).sum())
    return found
