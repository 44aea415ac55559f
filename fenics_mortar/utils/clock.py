# SPDX-License-Identifier: MIT
"""Seconds by phase: at any time one phase runs, the innermost that was entered."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

# What no phase covers.
OTHER = "other"
# The phases of a Newton iteration, in the order in which reports show them.
PHASES = ("residual", "tangent", "search", "integrals", "assembly", "solve", OTHER)


class Clock:
    """Shares out the time that passes among phases; time in a phase within another is its own."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}
        self._running = [OTHER]
        self._since = time.perf_counter()

    @contextmanager
    def __call__(self, phase: str) -> Iterator[None]:
        """A block, or as a decorator a function, that belongs to ``phase``."""
        self._share_out()
        self._running.append(phase)
        try:
            yield
        finally:
            self._share_out()
            self._running.pop()

    @property
    def depth(self) -> int:
        """How many phases have been entered, one within the other."""
        return len(self._running)

    def leave(self, depth: int) -> None:
        """Leave all but so many phases, as after an interruption."""
        del self._running[depth:]

    def read(self) -> dict[str, float]:
        """Seconds of all ``PHASES`` since the last call."""
        self._share_out()
        seconds, self._seconds = self._seconds, {}
        return {phase: seconds.get(phase, 0.0) for phase in PHASES}

    def _share_out(self) -> None:
        now = time.perf_counter()
        phase = self._running[-1]
        self._seconds[phase] = self._seconds.get(phase, 0.0) + now - self._since
        self._since = now


# That of this process: whoever works enters a phase, whoever reports reads.
clock = Clock()
