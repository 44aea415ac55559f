# SPDX-License-Identifier: MIT
"""Certificate of a solved state: contact conditions, measured independently of the solver.

Convergence of Newton's method means that the discrete equations are solved. Whether the state
satisfies the conditions of contact is measured here from the state alone: balance of slave and
master and of reactions and loads, signs, complementarity, penetration between the nodes, nodes
inside another body without a partner, and crossing outlines, whether or not a pair covers them.
Errors at corners, which all these conditions may miss, are estimated in ``corners``.
``tipping_bodies`` finds bodies that pressures on the covered parts of their surfaces cannot
balance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.law_calls import raise_stored
from fenics_mortar.contact.rows import strength
from fenics_mortar.contact.tied import Tie
from fenics_mortar.interface.reference import tabulate
from fenics_mortar.interface.space_mortar import SpaceOperators
from fenics_mortar.obstacles.rigid_motion import RIGID
from fenics_mortar.rigid.body_motions import BodyMotions, names_of
from fenics_mortar.rigid.complementarity import Touching, nearly_touching
from fenics_mortar.rigid.floating import FloatingBodies, moved_by_loads
from fenics_mortar.utils import files, ranks
from fenics_mortar.utils.arrays import TINY, Array, Flags, Indices
from fenics_mortar.verify.checks import Kind, checks
from fenics_mortar.verify.checks.balance import balance_of_bodies
from fenics_mortar.verify.checks.surface_rotation import turned_bodies
from fenics_mortar.verify.finding import (
    INFINITE,
    LIMITS,
    Crossing,
    Finding,
    Measured,
    format_value,
    paired_nodes,
)
from fenics_mortar.verify.obstacle_passages import directions_across


@dataclass(frozen=True)
class PairCertificate:
    """Findings of the checks of one pair; all methods are local.

    ``pair["penetration"]`` is the finding of this name. Names and meanings are those of the modules
    in ``fenics_mortar.verify.checks``.

    Attributes:
        pair: Names of slave and master.
        findings: One finding for each quantity that is measured for this kind of pair.
    """

    pair: str
    findings: tuple[Finding, ...]

    def __getitem__(self, name: str) -> Finding:
        """The finding of this name.

        Raises:
            KeyError: If there is none.
        """
        for finding in self.findings:
            if finding.name == name:
                return finding
        names = ", ".join(finding.name for finding in self.findings)
        raise KeyError(f"'{name}' is not measured for {self.pair}; expected one of {names}")

    def violations(self) -> list[str]:
        """Describe violated conditions; empty for a sound state."""
        return self._messages("violation")

    def remarks(self) -> list[str]:
        """Describe where the mesh is too coarse or the solution may not be unique."""
        return self._messages("remark")

    def _messages(self, verdict: str) -> list[str]:
        return [f"{self.pair}: {f.message}" for f in self.findings if f.verdict == verdict]


# Advice for crossings that are no violation.
_SMALLER = ": smaller steps, finer facets, or a pair of these surfaces"
# Verdicts by increasing weight; the table states the largest one of each row.
VERDICTS = ("", "ok", "remark", "violation")


@dataclass(frozen=True)
class Certificate(files.Markdown):
    """Measured defects of a state; prints as a Markdown table, one row per check.

    Attributes:
        pairs: One certificate per pair.
        balance: Largest sum of reactions, loads and contact forces of a body or obstacle, over the
            sum of the norms of all forces [1].
        inverted: Number of cells inverted at a point where a form with finite strains is evaluated.
        springs: Largest sum of the forces of springs on a body over the contact force on it [1];
            zero without springs.
        held: Which bodies springs hold, and the motions that they prevent, as a message; "" for
            none.
        drift: From the report of a solve: sliding distance of an obstacle driven by forces over its
            contact width [1], common to all its nodes and beyond the prescribed motion. The state
            is in equilibrium, but may not be reached by a path of equilibria.
        crossings: Crossings of outlines.
        passages: Bodies that passed through each other during the step, as messages.
        possible_passages: Passages on motions that the ends of the step do not determine, likewise.
        uncertain_turns: Turns by prescribed values that these do not determine, likewise.
        tipping: Bodies that pressures on the covered surfaces cannot balance, as messages.
        unsupported: Bodies that nothing holds and their free motions, and those in which nothing
            determines the level of a scalar field, as messages.
        inverted_nodes: Remark on cells inverted at nodes alone, or with linear strains.
        rounded: Bodies whose reactions are inexact by rounding, as messages.
        turned: Turned bodies with linear strains, as messages.
        dim: Dimension of the bodies.
    """

    pairs: list[PairCertificate]
    balance: float
    inverted: int
    springs: float = 0.0
    held: str = ""
    drift: float = 0.0
    crossings: list[Crossing] = field(default_factory=list)
    passages: list[str] = field(default_factory=list)
    possible_passages: list[str] = field(default_factory=list)
    uncertain_turns: list[str] = field(default_factory=list)
    tipping: list[str] = field(default_factory=list)
    unsupported: list[str] = field(default_factory=list)
    inverted_nodes: str = ""
    rounded: list[str] = field(default_factory=list)
    turned: list[str] = field(default_factory=list)
    dim: int = 2

    @property
    def of_bodies(self) -> tuple[Finding, ...]:
        """Findings of all bodies and obstacles together (local)."""
        return tuple(self._of_bodies())

    def pairs_with(self, name: str) -> list[int]:
        """Numbers of the pairs of which a finding of this name is a remark or worse (local)."""
        return [
            number
            for number, pair in enumerate(self.pairs)
            if any(f.name == name and f.verdict in VERDICTS[2:] for f in pair.findings)
        ]

    def violations(self) -> list[str]:
        """Describe violated conditions; empty for a sound state (local)."""
        of_pairs = [message for pair in self.pairs for message in pair.violations()]
        return of_pairs + [f.message for f in self.of_bodies if f.verdict == "violation"]

    def remarks(self) -> list[str]:
        """Describe where the mesh is too coarse or the solution may not be unique (local)."""
        of_pairs = [message for pair in self.pairs for message in pair.remarks()]
        return of_pairs + [f.message for f in self.of_bodies if f.verdict == "remark"]

    def __str__(self) -> str:
        """Markdown table: a row per check, a column per pair and one of all bodies."""
        columns = [*(pair.findings for pair in self.pairs), self.of_bodies]
        names = [*(pair.pair for pair in self.pairs), "all bodies"]
        head = ["check", *names, "remark above", "violation above", "result"]
        rows: dict[str, list[tuple[int, Finding]]] = {}
        for column, findings in enumerate(columns):
            for finding in findings:
                rows.setdefault(finding.name, []).append((column, finding))
        with_limits_first = sorted(rows.values(), key=lambda row: _verdict(row) == "")
        cells = [_cells(row, len(columns)) for row in with_limits_first]
        table = files.markdown_table(head, cells, left=(0, len(head) - 1))
        return "\n\n".join([table, *(self.violations() or self.remarks())])

    def _of_bodies(self) -> Iterator[Finding]:
        """Findings of all bodies; of several findings of a name the table shows the largest."""
        yield Finding(
            "balance", "imbalance of all forces on a body", self.balance,
            f"balance of a body {self.balance:.1e} (allowed {LIMITS.tolerance:.1e})",
            limit=LIMITS.tolerance,
        )  # fmt: skip
        yield Finding(
            "springs", "force of springs on bodies / contact force", self.springs, self.held,
            limit=LIMITS.negligible, remark=RIGID.slight,
        )  # fmt: skip
        yield Finding(
            "drift", "sliding of an obstacle driven by forces / width of contact", self.drift,
            f"an obstacle driven by forces slid away, by {self.drift:.1f} widths of its contact: "
            "the path may lead to another equilibrium; take smaller steps, or prescribe its motion",
            limit=1.0,
        )  # fmt: skip
        yield Finding(
            "inverted", "inverted cells", self.inverted, f"{self.inverted} cells are inverted", 0
        )
        at_nodes = [self.inverted_nodes] * (self.inverted_nodes != "")
        yield from _counted("inverted_nodes", "cells inverted at nodes alone", at_nodes, remark=0)
        yield from _counted(
            "rounded", "bodies whose reactions are inexact by rounding", self.rounded, remark=0
        )
        yield from _counted("turned", "turned bodies with linear strains", self.turned, remark=0)
        yield from _counted("unsupported", "bodies that nothing holds", self.unsupported, remark=0)
        for crossing in self.crossings:
            limits = crossing.admitted, crossing.remark
            yield _crossed(crossing.facets, f"{crossing}", *limits, advised=crossing.hint != "")
        if not self.crossings:
            yield _crossed(0.0)
        yield from _counted("passages", "bodies passed through in the step", self.passages, limit=0)
        yield from _counted(
            "possible_passages", "bodies possibly passed through", self.possible_passages, remark=0
        )
        yield from _counted(
            "uncertain_turns", "turns whose sense is unknown", self.uncertain_turns, remark=0
        )
        yield from _counted(
            "tipping", "bodies that pressures cannot balance", self.tipping, limit=0
        )


def certify(
    contacts: Sequence[Contact | Tie], floating: FloatingBodies, unbalanced: Array,
    inside: Sequence[Indices], solved: float,
) -> Certificate:  # fmt: skip
    """Measure the present state (collective).

    Args:
        contacts: The pairs, evaluated there.
        floating: The bodies, with the residual of the bulk at the present state.
        unbalanced: Sums of all forces on the obstacles, equal on all ranks [stress length].
        inside: Global numbers of the nodes of each pair inside another body of it, ascending.
        solved: Force up to which the equations are solved [stress length].

    Raises:
        Exception: An error of a user's law, raised on all ranks.
    """
    bulk, pairs = floating.bulk, list[PairCertificate]()
    paired = np.unique(np.concatenate([np.empty(0, np.int64), *map(paired_nodes, contacts)]))
    inverted, _ = bulk.inverted_cells()
    for contact, nodes in zip(contacts, inside, strict=True):
        kind: Kind = "of_tie" if isinstance(contact, Tie) else "of_contact"
        measured: Any = contact
        if isinstance(contact, Contact):
            measured = Measured(contact, paired, nodes, solved)
        found = [each for check in checks(kind) for each in check(measured)]
        names = f"{contact.slave.name} - {contact.master.name}"
        pairs.append(PairCertificate(names, tuple(found)))
    raise_stored(bulk.comm, contacts)
    # tied bodies are not joined: springs may pull these against each other
    balance, of_bodies = balance_of_bodies(bulk, contacts, floating.parts, unbalanced)
    rounded = _rounded_bodies(floating, of_bodies)
    at_nodes, dim = bulk.describe_inverted_nodes(), bulk.space.dim
    whole = Certificate(
        pairs, balance, inverted, inverted_nodes=at_nodes, rounded=rounded,
        turned=turned_bodies(floating), dim=dim,
    )  # fmt: skip
    return ranks.agreed(bulk.comm, whole)


def _rounded_bodies(floating: FloatingBodies, imbalances: Array) -> list[str]:
    """Sentences on bodies out of balance by these numbers (bodies,) [1] (collective)."""
    comm = floating.bulk.comm
    labels, imbalances = comm.bcast((np.flatnonzero(imbalances > LIMITS.negligible), imbalances))
    return [
        f"forces on {floating.name_of(label, floating.parts)} balance to {imbalances[label]:.1g} "
        "of the contact forces only: it is so stiff that internal forces are rounded by as much. "
        "Its reactions are inexact, contact forces and reactions of softer bodies are not; take a "
        "softer material, or a rigid obstacle in its place"
        for label in labels.tolist()
    ]


def _crossed(
    facets: float, message: str = "", limit: float = LIMITS.penetration,
    remark: float = LIMITS.coarse_penetration, *, advised: bool = False,
) -> Finding:  # fmt: skip
    """The finding of a crossing of this depth, with its limits [facet lengths] (local).

    ``advised``: whether the message says what helps.
    """
    advice = "" if facets > limit or advised else _SMALLER
    return Finding(
        "crossings", "depth of crossing outlines", facets, message + advice, limit=limit,
        remark=min(remark, limit), unit="facet lengths",
    )  # fmt: skip


def _counted(name: str, check: str, messages: Sequence[str], **limits: Any) -> Iterator[Finding]:
    """A finding for each message, with their number as value, or one without a message (local)."""
    for message in messages or [""]:
        yield Finding(name, check, len(messages), message, **limits)


def _verdict(row: Sequence[tuple[int, Finding]]) -> str:
    """The verdict of the largest weight in a row (local)."""
    return max((finding.verdict for _, finding in row), key=VERDICTS.index)


def _cells(row: Sequence[tuple[int, Finding]], columns: int) -> list[str]:
    """Row of the table: check, values, limits of all columns, verdict (local)."""
    first = row[0][1]
    values = {
        column: max(finding.value for there, finding in row if there == column) for column, _ in row
    }
    limits = (
        ", ".join(dict.fromkeys(format_value(x) for x in given if x < INFINITE))
        for given in ([f.remark for _, f in row], [f.limit for _, f in row])
    )
    check = f"{first.check} [{first.unit}]" if first.unit else first.check
    cells = [format_value(values[c]) if c in values else "" for c in range(columns)]
    return [check, *cells, *limits, _verdict(row)]


def partly_covered(bodies: BodyMotions) -> list[str]:
    """Pairs of floating bodies with facets that are covered in part and carry force (collective).

    Args:
        bodies: The bodies, with all contacts at the present state.
    """
    found = []
    for contact in bodies.contacts if bodies.bodies else ():
        o = contact.operators
        if not isinstance(o, SpaceOperators):
            continue
        beside = contact.active[o.facet_nodes].any(axis=1)
        mine = int((beside & _partly(o)).sum())
        if bodies.bulk.comm.allreduce(mine):
            sides = f"'{contact.pair.slave_name}' - '{contact.pair.master_name}'"
            found.append(f"{sides}: beside facets that are covered in part")
    return found


def _partly(o: SpaceOperators) -> Flags:
    """Facets of this rank's share that have a partner on a part only, (f,) (local)."""
    return ~o.moments.complete & o.moments.De.any(axis=1)


# Positions (p, dim) [length], directions of the pressure (p, dim), and numbers of the parts of
# slave and master, (p,) each; -1 for an obstacle.
Placed = tuple[Array, Array, Indices, Indices]


def points_in_space(bodies: BodyMotions, contact: Contact, near: Flags) -> Placed:
    """Find the points of a pair beside ``near`` nodes, this rank's share (collective).

    On facets that are covered in part these are the corners of the covered parts, moved outward by
    the distance that causes only a remark; else, and on obstacles, the nodes.

    In space the multiplier of a node beside a facet that is covered in part acts within that part,
    but its resultant may act beyond it. Where all facets beside touching nodes are covered wholly,
    the limit analysis before the solve has used the same points.
    """
    of_slave, of_master = bodies.parts_of(contact.slave), bodies.parts_of(contact.master)
    o, own = contact.operators, contact.slave.owned
    if not isinstance(o, SpaceOperators):
        j = own[near[own]]
        return o.x[j], o.n[j], of_slave[j], np.full(j.size, -1)
    s, beside = o.segments, near[o.facet_nodes].any(axis=1)
    pair, shares = o.covered_corners(beside & _partly(o))
    x, n = (np.einsum("ck,ckd->cd", shares, field[s.slave[pair]]) for field in (o.x, o.n))
    x = x + _outward(x, pair, contact.slave.facet_sizes[s.facets[s.owner[pair]]])
    whole = np.flatnonzero(beside & o.moments.complete)
    j, first = o.facet_nodes[whole].ravel(), np.repeat(s.offsets[whole], s.slave.shape[1])
    pair = np.concatenate([pair, first])
    bodies_at = of_slave[s.slave[pair, 0]], of_master[s.master[pair, 0]]
    return np.concatenate([x, o.x[j]]), np.concatenate([n, o.n[j]]), *bodies_at


def _outward(x: Array, pair: Indices, sizes: Array) -> Array:
    """Motions of corners ``x`` (c, 3) away from the middle of those of their pair (local).

    Args:
        x: Positions [length].
        pair: Numbers of their pairs, shape (c,).
        sizes: Sizes of their facets, shape (c,) [length].
    """
    _, pair, count = np.unique(pair, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(pair, column, count.size) for column in x.T], axis=1)
    away = x - (sums / count[:, None])[pair]
    lengths = np.linalg.norm(away, axis=1)
    return LIMITS.coarse_distance * (sizes / np.maximum(lengths, TINY))[:, None] * away


def tipping_bodies(bodies: BodyMotions, pairs: list[PairCertificate], pushed: Array) -> list[str]:
    """Describe floating bodies that would tip over an edge (collective).

    If the resultant of the pressures acts beyond the end of a master, see ``resultant``, the body
    would tip over the edge. If an obstacle is sharper than a facet, see ``corners``, nodes on both
    sides of its tip support the body sideways. Whether pressures can balance the body is decided by
    limit analysis with the rigid motions of floating bodies and the loads on them. Pressures act at
    the ends of the segments beside touching nodes instead of at these nodes, on an obstacle at the
    points of the facets that touch it. In space they act at the corners of the covered parts of
    facets, and bodies that touch on facets that are covered in part are judged. All assumptions
    overestimate the limit load: friction is doubled and covers small errors of the normals, nodes
    that nearly touch are included, and the ends of segments are moved outward by the distance that
    causes only a remark; obstacles touch within this distance.

    Args:
        bodies: The bodies, with the bulk residual and all contacts at the present state.
        pairs: Certificates of the pairs.
        pushed: Loads at points less the forces of ties, (owned dofs,) [force].

    Returns:
        One message, or an empty list: if all bodies are balanced, if no resultant acts beyond the
        cover, or if a law has adhesion.
    """
    in_space = bodies.bulk.space.dim == 3
    beyond = partly_covered(bodies) if in_space else _beyond(pairs)
    if not (beyond and bodies.bodies) or any(c.pair.law.has_adhesion for c in bodies.contacts):
        return []
    bulk = bodies.bulk
    forces = bulk.r.array_r[: bulk.num_owned] - pushed
    loads = np.concatenate([body.resultant(forces) for body in bodies.bodies])
    touching = [_touching(bodies, contact, loads) for contact in bodies.contacts]
    found = moved_by_loads(bodies, loads, Touching.joined(touching))
    if not found:
        return []
    where = "; ".join(beyond)
    names = names_of([body for body, _ in found])
    body, move = max(found, key=lambda each: float(np.abs(each[1]).max()))
    return [
        f"pressures where the surfaces touch cannot balance {names}, as "
        f"{body.name} can {body.describe(move, directed=True)}, but those of the "
        f"solution act elsewhere ({where}): refine the facets there, or take the side that ends "
        "there, or has a corner there, as slave"
    ]


def _beyond(pairs: Sequence[PairCertificate]) -> list[str]:
    """Pairs whose pressures act elsewhere than where the surfaces touch."""
    return [
        f"{pair.pair}: {_described(finding)}"
        for pair in pairs
        for finding in pair.findings
        if finding.name in ("resultant_outside", "obstacle_angle") and finding.verdict == "remark"
    ]


def _described(finding: Finding) -> str:
    """Position of pressures that act elsewhere than where the surfaces touch."""
    if finding.name == "obstacle_angle":
        return f"along the facets at {finding.where}"
    return f"{finding.value:.2f} facets beyond the cover, at {finding.where}"


def _touching(bodies: BodyMotions, contact: Contact, loads: Array) -> Touching:
    """Points at which a pair touches, with twice the largest friction of its nodes (collective)."""
    near = contact.active | nearly_touching(contact)
    points = _points if contact.obstacle is None else _points_on_obstacle
    if bodies.bulk.space.dim == 3:
        points = points_in_space
    x, n, slave, master = points(bodies, contact, near)
    n /= np.linalg.norm(n, axis=1)[:, None]
    rates = np.concatenate(
        [body.displacement(x, master) - body.displacement(x, slave) for body in bodies.bodies]
    )
    slips = [np.einsum("mpc,pc->pm", rates, along) for along in directions_across(n)]
    along_tangents = slips[0] if len(slips) == 1 else np.stack(slips, axis=1)
    local = np.einsum("mpc,pc->pm", rates, n), along_tangents
    opens, sliding = ranks.from_all_ranks(bodies.bulk.comm, local)
    weight = contact.operators.weight
    covered = float(weight[near].sum())
    pressure = float(np.abs(loads).sum()) / covered if covered > 0.0 else 0.0
    slope, shear = strength(contact.now, pressure)
    one = np.ones(len(opens))
    largest = 2.0 * float(slope[near].max(initial=0.0)) + LIMITS.negligible
    sheared = 2.0 * float((weight * shear)[near].sum())
    return Touching(opens, sliding, largest * one, sheared * one, 0.0 * one)


def _points(bodies: BodyMotions, contact: Contact, near: Flags) -> Placed:
    """Find the ends of the segments beside ``near`` nodes, this rank's share (collective)."""
    o, s = contact.operators, contact.intersections()
    beside = near[s.slave].any(axis=1)
    slave, master = s.slave[beside][:, [0, -1]], s.master[beside]
    wider = s.ends[beside] + 2.0 * LIMITS.coarse_distance * np.array([-1.0, 1.0])
    shares = np.stack([0.5 * (1.0 - wider), 0.5 * (1.0 + wider)], axis=2)
    x, n = (np.einsum("sek,skc->sec", shares, field[slave]).reshape(-1, 2) for field in (o.x, o.n))
    of_slave, of_master = bodies.parts_of(contact.slave), bodies.parts_of(contact.master)
    return x, n, np.repeat(of_slave[slave[:, 0]], 2), np.repeat(of_master[master[:, 0]], 2)


def _points_on_obstacle(bodies: BodyMotions, contact: Contact, near: Flags) -> Placed:
    """Find points of the facets beside ``near`` nodes that nearly touch an obstacle (collective).

    The direction is that of the flatter side: of the obstacle, or of the facet where the normals of
    the obstacle at the ends of the facet differ by the angle of a corner.
    """
    o, s = contact.operators, contact.intersections()
    at = np.linspace(-1.0, 1.0, 1 + int(np.ceil(2.0 / LIMITS.coarse_distance)))
    gaps = o.sample_gaps(o.x + contact.now.offset[:, None] * o.n, s, at)
    chords = o.x[s.slave[:, -1]] - o.x[s.slave[:, 0]]
    lengths = np.linalg.norm(chords, axis=1)[:, None]
    touches = (gaps <= LIMITS.coarse_distance * lengths) & near[s.slave].any(axis=1)[:, None]
    x, n = (
        np.einsum("pk,ekc->epc", tabulate(at, s.slave.shape[1])[:, 0], field[s.slave])
        for field in (o.x, o.n)
    )
    ends = o.n[s.slave[:, [0, -1]]]
    sharp = (ends[:, 0] * ends[:, 1]).sum(axis=1) < np.cos(LIMITS.corner)
    n[sharp] = (np.stack([chords[:, 1], -chords[:, 0]], axis=1) / lengths)[sharp, None]
    slave = bodies.parts_of(contact.slave)[s.slave[np.nonzero(touches)[0], 0]]
    return x[touches], n[touches], slave, np.full(len(slave), -1)
