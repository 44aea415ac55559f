# SPDX-License-Identifier: MIT
"""Nodes at which a pair has more than one solution, or multipliers that are not unique."""

from __future__ import annotations

from collections.abc import Iterator

from fenics_mortar.utils.errors import format_point
from fenics_mortar.verify.finding import Finding
from fenics_mortar.verify.measured import Measured


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Number of redundant sticks, and of nodes just beside the end of the master (local).

    See ``redundancy``. Beside the end the cover is close to the threshold of a multiplier.
    """
    contact = measured.contact
    x, count, undecided = contact.operators.x, int(contact.redundant.sum()), contact.undecided
    where = format_point(x[contact.redundant.argmax()])
    yield Finding(
        "redundant",
        "sticking nodes that other pairs fix as well",
        count,
        f"{count} sticking nodes are constrained by other pairs as well, one at {where}: their "
        "shear is not unique; it is as close as possible to that of the last state",
        remark=0,
        where=where if count else "",
    )
    where = " and ".join(map(format_point, x[undecided]))
    yield Finding(
        "undecided",
        "nodes just beside the end of the master",
        len(x[undecided]),
        f"the master ends just beside the node at {where}, where the multiplier is handed over to "
        "or from the neighbouring node: there may be two solutions, with and without it; other "
        "steps may lead to the other one",
        remark=0,
        where=where,
    )
