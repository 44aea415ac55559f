# SPDX-License-Identifier: MIT
"""Pressure beside clamped slave nodes.

A clamped slave node carries no multiplier; its neighbours carry its force. If a body presses on the
very end of a clamped surface, its whole force acts on that neighbour, which can move: the force is
far too small on any mesh. This is detected by a pressure peak at the neighbour.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import format_point
from fenics_mortar.verify.finding import Finding
from fenics_mortar.verify.limits import LIMITS
from fenics_mortar.verify.measured import Measured

# Ratio of the pressure beside clamped slave nodes to that of the next nodes above which there is a
# remark [1].
END_PRESSURE = 2.0


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Largest ratio of the pressure beside a clamped slave node to that of the next nodes."""
    ratio, where = end_pressure(measured.contact, measured.pressure)
    yield Finding(
        "end_pressure",
        "pressure beside a clamped slave node / that farther away",
        ratio,
        f"a body presses on a clamped slave node, at {where}, which carries no multiplier: the "
        "force may be far too small; take the other body as slave",
        remark=END_PRESSURE,
        where=where,
    )


def end_pressure(contact: Contact, pressure: Array) -> tuple[float, str]:
    """Largest ratio [1], and the position of the clamped node; 0 and "" without one (local).

    Args:
        contact: The pair.
        pressure: Normal multipliers, shape (slave nodes,) [stress].
    """
    slave, degree = contact.slave, contact.slave.degree
    prescribed = (contact.free == 0.0).any(axis=1) & ~contact.may_carry
    if not prescribed.any():
        return 0.0, ""
    around = slave.along(np.flatnonzero(prescribed), range(-3 * degree, 3 * degree + 1))
    there = np.where(around >= 0, pressure[around], 0.0)
    beside = there[:, 2 * degree : 4 * degree + 1].max(axis=1, initial=0.0)
    there[:, 2 * degree : 4 * degree + 1] = 0.0
    counts = beside > LIMITS.at_corners * pressure.max(initial=0.0)
    beside = np.where(counts, beside, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.nan_to_num(beside / there.max(axis=1, initial=0.0), posinf=np.inf)
    if not ratio.any():
        return 0.0, ""
    where = contact.operators.x[np.flatnonzero(prescribed)[ratio.argmax()]]
    return float(ratio.max()), format_point(where)
