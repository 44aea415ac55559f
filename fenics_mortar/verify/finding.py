# SPDX-License-Identifier: MIT
"""Finding: the value of one check of the certificate, with its limits and their meaning."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Verdict = Literal["", "ok", "remark", "violation"]
INFINITE = math.inf


@dataclass(frozen=True)
class Finding:
    """Value of one check; all methods are local.

    Attributes:
        name: Short name, ``pair["name"]`` of a ``PairCertificate``.
        check: What is checked, in a few words, for the printed table.
        value: Measured value [its unit], zero for an exact solution.
        text: What a value above a limit means and what helps; by default ``check`` with its value.
        limit: Value above which the state is wrong [its unit]; inf if there is none.
        remark: Value above which results may be inaccurate or not unique [its unit]; inf if there
            is none.
        unit: Unit of value and limits; "" for ratios and numbers.
        where: Position of the largest contribution, "" if there is none.
    """

    name: str
    check: str
    value: float
    text: str = ""
    limit: float = INFINITE
    remark: float = INFINITE
    unit: str = ""
    where: str = ""

    @property
    def verdict(self) -> Verdict:
        """``"ok"``, ``"remark"`` or ``"violation"``; "" for a value without limits."""
        if not self.value <= self.limit:
            return "violation"
        if self.value > self.remark:
            return "remark"
        return "ok" if min(self.limit, self.remark) < INFINITE else ""

    @property
    def message(self) -> str:
        """Description of a value above a limit."""
        least = format_value(min(self.limit, self.remark))
        return self.text or f"{self.check}: {format_value(self.value)} (allowed {least})"


def format_value(value: float) -> str:
    """Two digits, or those of the integer part up to 1e6; 0 for -0 (local)."""
    return f"{value:.0f}" if 100.0 <= abs(value) < 1e6 else f"{value + 0.0:.2g}"
