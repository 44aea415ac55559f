# SPDX-License-Identifier: MIT
"""Progress of a path: records of the logger ``fenics_mortar``, and a remark on idle loads.

Rank 0 logs each accepted step and each cut with level INFO, and the table of each solve with level
DEBUG. Nothing is shown unless the program sets up logging::

    logging.basicConfig()
    logging.getLogger("fenics_mortar").setLevel(logging.INFO)
"""

from __future__ import annotations

import logging
from typing import Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.steps import needing_time
from fenics_mortar.newton.report import NewtonReport
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.errors import as_text
from fenics_mortar.utils.ranks import on_any_rank

LOGGER = logging.getLogger("fenics_mortar")
LOGGER.addHandler(logging.NullHandler())


class Progress:
    """Log of one path; all methods are local.

    Args:
        comm: Communicator of the problem; rank 0 logs.
    """

    def __init__(self, comm: MPI.Comm) -> None:
        self._logs, self._num_steps = comm.rank == 0, 0

    def accept(self, time: float, report: NewtonReport) -> None:
        """Log the accepted step to ``time``."""
        self._num_steps += 1
        self._log(f"step {self._num_steps}, time {time:.6g}: {report.reason}", report)

    def cut(self, time: float, reason: str, report: NewtonReport) -> None:
        """Log the failed step to ``time``."""
        self._log(f"time {time:.6g}: cut, {reason}", report)

    def _log(self, line: str, report: NewtonReport) -> None:
        if self._logs:
            LOGGER.info("%s", line)
            LOGGER.debug("%s", report)


class IdleLoads:
    """Comparison of the loads of all steps with those before the path.

    Args:
        problem: The problem, before the first step.
    """

    def __init__(self, problem: ContactProblem) -> None:
        self._problem, self._changed = problem, False
        self._first = self._loads()

    def look(self) -> None:
        """Compare the present loads (local)."""
        if not self._changed:
            pairs = zip(self._first, self._loads(), strict=True)
            self._changed = not all(np.array_equal(a, b) for a, b in pairs)

    def remarks(self, num_steps: int) -> list[str]:
        """The remark after several steps without any change; else none (collective).

        Laws that depend on the time may be the reason for such a path.

        Args:
            num_steps: Number of accepted steps.
        """
        contacts, comm = self._problem.equations.contacts, self._problem.equations.comm
        timed = any(isinstance(c, Contact) and needing_time(c) for c in contacts)
        if on_any_rank(comm, self._changed) or timed or num_steps < 2:
            return []
        return [
            "set_loads changed no constant, function, prescribed value, obstacle or law of the "
            "problem in any step: set values in place, e.g. push.value[1] = -0.03 * time"
        ]

    def _loads(self) -> list[Any]:
        """Values that ``set_loads`` may set, in a fixed order (local)."""
        equations, motions = self._problem.equations, self._problem.equations.motions
        found: list[Any] = [
            *equations.bulk.input_data.loads(),
            *motions.loads,
        ]
        found += [value for o in self._problem.obstacles for value in o.shape().values()]
        found += [np.array(contact.offset, float) for contact in equations.contacts]
        found += [as_text(c.pair.law) for c in equations.contacts if isinstance(c, Contact)]
        return found
