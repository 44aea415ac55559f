# SPDX-License-Identifier: MIT
"""Wall time by phase: time is counted for the innermost phase that was entered."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from mpi4py import MPI

from fenics_mortar.utils.ranks import largest_over_ranks

P = ParamSpec("P")
T = TypeVar("T")
# Time outside all phases.
OTHER = "other"
# The phases of a Newton iteration, in the order of reports.
PHASES = ("residual", "tangent", "search", "integrals", "assembly", "solve", OTHER)


class Clock:
    """Distribution of wall time over phases; time in a nested phase counts for that phase only."""

    def __init__(self) -> None:
        self._seconds = dict.fromkeys(PHASES, 0.0)
        self._running = [OTHER]
        self._since = time.perf_counter()

    def __call__(self, phase: str) -> Phase:
        """Context, or decorator of a function, whose time counts for ``phase``."""
        return Phase(self, phase)

    @property
    def depth(self) -> int:
        """Number of nested phases."""
        return len(self._running)

    def leave(self, depth: int) -> None:
        """Leave all but the outer ``depth`` phases, for example after an interruption."""
        del self._running[depth:]

    def read(self) -> dict[str, float]:
        """Wall time of each of the ``PHASES`` since the last call [s]."""
        now = time.perf_counter()
        seconds, self._seconds = self._seconds, dict.fromkeys(PHASES, 0.0)
        seconds[self._running[-1]] += now - self._since
        self._since = now
        return seconds

    def slowest(self, comm: MPI.Comm) -> dict[str, float]:
        """As ``read``, the maximum over the ranks (collective)."""
        mine = self.read()
        if comm.size == 1:
            return mine
        slowest = largest_over_ranks(comm, list(mine.values()))
        return dict(zip(mine, slowest.tolist(), strict=True))


class Phase:
    """A phase of a clock, as context or decorator.

    The code for entering and leaving is repeated in both for speed: timed functions may take
    microseconds.
    """

    def __init__(self, clock: Clock, phase: str) -> None:
        self._clock, self._phase = clock, phase

    def __enter__(self) -> None:
        """Enter the phase."""
        clock, now = self._clock, time.perf_counter()
        clock._seconds[clock._running[-1]] += now - clock._since
        clock._since = now
        clock._running.append(self._phase)

    def __exit__(self, *_: object) -> None:
        """Leave the phase."""
        clock, now = self._clock, time.perf_counter()
        clock._seconds[clock._running.pop()] += now - clock._since
        clock._since = now

    def __call__(self, function: Callable[P, T]) -> Callable[P, T]:
        """The function, whose time counts for the phase."""
        clock, phase = self._clock, self._phase

        @wraps(function)
        def timed(*args: P.args, **kwargs: P.kwargs) -> T:
            now = time.perf_counter()
            clock._seconds[clock._running[-1]] += now - clock._since
            clock._since = now
            clock._running.append(phase)
            try:
                return function(*args, **kwargs)
            finally:
                now = time.perf_counter()
                clock._seconds[clock._running.pop()] += now - clock._since
                clock._since = now

        return timed


# The clock of this process: computations enter phases, reports read it.
clock = Clock()
