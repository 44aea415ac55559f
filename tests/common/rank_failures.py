# SPDX-License-Identifier: MIT
"""End of a run on several ranks after a failure on some of them only."""

import faulthandler
import os
import sys
import time

import pytest

# Time that the other ranks have to finish a test that failed on this rank, or the run [s]: about
# that of compiling kernels. A rank that waits in a collective call for this one never does.
PATIENCE = 60.0


class RankFailures:
    """Plugin of pytest: a test fails on all ranks if it fails on one.

    A rank leaves a test that fails, while the others may wait for it in a collective call: this
    rank then waits in the barrier after the test, or in ``MPI_Finalize``, and no rank ever ends.
    ``PATIENCE`` seconds after the failure this process ends, and mpirun ends the others.

    Args:
        comm: Communicator of all ranks; a copy is used here, since collective calls of the test on
            other ranks must not be taken for those after it.
    """

    def __init__(self, comm):
        self.comm, self.failed, self.errors = comm.Dup(), False, None

    def pytest_configure(self):
        """Keep the file descriptor of errors, which pytest replaces while a test runs."""
        self.errors = os.dup(2)

    def write(self, text):
        os.write(self.errors, f"\n##### rank {self.comm.rank}: {text}\n".encode())

    def pytest_runtest_logstart(self):
        self.failed = False

    @pytest.hookimpl(trylast=True)
    def pytest_exception_interact(self, report):
        """Print a failure at once, and end this process unless pytest ends this test in time.

        Other threads of Python do not run while PETSc waits; the one of ``faulthandler`` does.
        pytest stops it after the test, and also in its own function for this event.
        """
        if isinstance(report, pytest.TestReport) and not self.failed:
            self.failed = True
            self.write(
                f"{report.nodeid} failed; unless all ranks finish it within {PATIENCE:g} s, the run"
                f" is aborted\n{report.longreprtext}"
            )
            faulthandler.dump_traceback_later(PATIENCE, exit=True, file=self.errors)

    def wait(self):
        """Wait for all ranks after a test, which fails on this rank if it failed on another."""
        failed = self.comm.allgather(self.failed)
        if any(failed) and not self.failed:
            self.failed = True
            where = ", ".join(str(rank) for rank in range(self.comm.size) if failed[rank])
            pytest.fail(f"failed on rank {where}", pytrace=False)

    def pytest_unconfigure(self):
        """Wait for all ranks at the end: ``MPI_Finalize`` would wait for ever."""
        arrived, begin = self.comm.Ibarrier(), time.monotonic()
        while not arrived.Test():
            if time.monotonic() - begin > PATIENCE:
                self.write(f"other ranks still run tests {PATIENCE:g} s after the end: aborted")
                sys.stdout.flush()
                self.comm.Abort(1)
            time.sleep(0.001)
