# SPDX-License-Identifier: MIT
"""Seconds by phase: at any time the innermost entered phase is running."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

# Time outside all phases.
OTHER = "other"
# The phases of a Newton iteration, in the order of reports.
PHASES = ("residual", "tangent", "search", "integrals", "assembly", "solve", OTHER)


class Clock:
    """Distributes wall time over phases; time in a nested phase counts for that phase only."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}
        self._running = [OTHER]
        self._since = time.perf_counter()

    @contextmanager
    def __call__(self, phase: str) -> Iterator[None]:
        """Context, or decorator of a function, whose time counts for ``phase``."""
        seconds, running = self._seconds, self._running
        now = time.perf_counter()
        seconds[running[-1]] = seconds.get(running[-1], 0.0) + now - self._since
        self._since = now
        running.append(phase)
        try:
            yield
        finally:
            self._distribute()
            self._running.pop()

    @property
    def depth(self) -> int:
        """Number of nested phases."""
        return len(self._running)

    def leave(self, depth: int) -> None:
        """Leave all but the outer ``depth`` phases, as after an interruption."""
        del self._running[depth:]

    def read(self) -> dict[str, float]:
        """Wall time of each of the ``PHASES`` since the last call [s]."""
        self._distribute()
        seconds, self._seconds = self._seconds, {}
        return {phase: seconds.get(phase, 0.0) for phase in PHASES}

    def _distribute(self) -> None:
        now = time.perf_counter()
        phase = self._running[-1]
        self._seconds[phase] = self._seconds.get(phase, 0.0) + now - self._since
        self._since = now


# The clock of this process: computations enter phases, reports read it.
clock = Clock()
