# SPDX-License-Identifier: MIT
"""Certificate of a solved state: contact conditions, measured independently of the solver.

Convergence of Newton's method means that the discrete equations are solved. Whether the state
satisfies the conditions of contact is measured here from the state alone: balance of slave and
master and of reactions and loads, signs, complementarity, penetration between the nodes, nodes
inside another body without a partner, and crossing outlines, whether or not a pair covers them.
Errors at corners, which all these conditions may miss, are estimated in ``corners``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.law_calls import raise_stored
from fenics_mortar.contact.tied import Tie
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.files import Markdown, markdown_table
from fenics_mortar.utils.ranks import agreed
from fenics_mortar.verify.checks import Kind, checks
from fenics_mortar.verify.checks.balance import balance_of_bodies
from fenics_mortar.verify.finding import (
    INFINITE,
    LIMITS,
    Crossing,
    Finding,
    Measured,
    format_value,
    paired_nodes,
)


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
class Certificate(Markdown):
    """Measured defects of a state; prints as a Markdown table, one row per check.

    Attributes:
        pairs: One certificate per pair.
        balance: Largest sum of reactions, loads and contact forces of a body or obstacle, over the
            sum of the norms of all forces [1].
        inverted: Number of cells inverted at a point where a form with finite strains is evaluated.
        springs: Largest sum of the forces of springs on a body over the contact force on it [1];
            zero unless the report of the solve records springs.
        drift: From the report of a solve: sliding distance of an obstacle driven by forces over its
            contact width [1], common to all its nodes and beyond the prescribed motion. The state
            is in equilibrium, but may not be reached by a path of equilibria.
        crossings: Crossings of outlines.
        passages: Bodies that passed through each other during the step, as messages.
        possible_passages: Passages on motions that the ends of the step do not tell, as messages.
        uncertain_turns: Turns by prescribed values that the ends of the step do not tell, likewise.
        tipping: Bodies that pressures on the covered surfaces cannot balance, as messages.
        unsupported: Remark on bodies without supports, loads and contact, whose place is arbitrary.
        inverted_nodes: Remark on cells inverted at nodes alone, or with linear strains.
        dim: Dimension of the bodies.
    """

    pairs: list[PairCertificate]
    balance: float
    inverted: int
    springs: float = 0.0
    drift: float = 0.0
    crossings: list[Crossing] = field(default_factory=list)
    passages: list[str] = field(default_factory=list)
    possible_passages: list[str] = field(default_factory=list)
    uncertain_turns: list[str] = field(default_factory=list)
    tipping: list[str] = field(default_factory=list)
    inverted_nodes: str = ""
    unsupported: str = ""
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
        table = markdown_table(head, cells, left=(0, len(head) - 1))
        return "\n\n".join([table, *(self.violations() or self.remarks())])

    def _of_bodies(self) -> Iterator[Finding]:
        """Findings of all bodies; of several findings of a name the table shows the largest."""
        yield Finding(
            "balance", "imbalance of all forces on a body", self.balance,
            f"balance of a body {self.balance:.1e} (allowed {LIMITS.tolerance:.1e})",
            limit=LIMITS.tolerance,
        )  # fmt: skip
        yield Finding(
            "springs", "force of springs on bodies / contact force", self.springs,
            f"springs carry {self.springs:.1e} of the contact force (allowed "
            f"{LIMITS.negligible:.1e})",
            limit=LIMITS.negligible,
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
        loose = [self.unsupported] * (self.unsupported != "")
        yield from _counted("unsupported", "problems without supports and loads", loose, remark=0)
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
    inside: Sequence[Indices] | None = None,
) -> Certificate:  # fmt: skip
    """Measure the present state (collective).

    Args:
        contacts: The pairs, evaluated there.
        floating: The bodies, with the residual of the bulk at the present state.
        unbalanced: Sums of all forces on the obstacles, equal on all ranks [stress length].
        inside: In space, global numbers of the nodes of the bodies of each pair inside another body
            of it, ascending.

    Raises:
        Exception: An error of a user's law, raised on all ranks.
    """
    bulk, pairs = floating.bulk, list[PairCertificate]()
    paired = np.unique(np.concatenate([np.empty(0, np.int64), *map(paired_nodes, contacts)]))
    inverted, _ = bulk.inverted_cells()
    of_pairs: Sequence[Indices | None] = [None] * len(contacts) if inside is None else inside
    for contact, nodes in zip(contacts, of_pairs, strict=True):
        kind: Kind = "of_tie" if isinstance(contact, Tie) else "of_contact"
        measured: Any = contact
        if isinstance(contact, Contact):
            measured = Measured(contact, bulk, floating.labels, paired, nodes)
        found = [each for check in checks(kind, bulk.space.dim) for each in check(measured)]
        names = f"{contact.slave.name} - {contact.master.name}"
        pairs.append(PairCertificate(names, tuple(found)))
    raise_stored(bulk.comm, contacts)
    # tied bodies are not joined: springs may pull these against each other
    balance = balance_of_bodies(bulk, contacts, floating.parts, unbalanced)
    at_nodes, dim = bulk.describe_inverted_nodes(), bulk.space.dim
    whole = Certificate(pairs, balance, inverted, inverted_nodes=at_nodes, dim=dim)
    return agreed(bulk.comm, whole)


def _crossed(
    facets: float,
    message: str = "",
    limit: float = LIMITS.penetration,
    remark: float = LIMITS.coarse_penetration,
    *,
    advised: bool = False,
) -> Finding:
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
