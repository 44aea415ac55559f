# SPDX-License-Identifier: MIT
"""A test that fails on one of two ranks: the run ends on both, within a given time."""

import pytest
import rank_failures
from test_demos import run

pytestmark = pytest.mark.serial

SETTINGS = f"""
import sys; sys.path.insert(0, {rank_failures.__file__.rpartition("/")[0]!r})
import pytest
import rank_failures
from mpi4py import MPI
rank_failures.PATIENCE = 0.5
FAILURES = rank_failures.RankFailures(MPI.COMM_WORLD)

def pytest_configure(config):
    config.pluginmanager.register(FAILURES)

@pytest.fixture(autouse=True)
def together():
    yield
    FAILURES.wait()
"""
# Where the exception is raised on rank 1, and what is printed.
PLACES = {
    "collective": "test_it.py::test_it failed",
    "collection": "rank 1: other ranks still run tests 0.5 s after the end",
}
TEST = """
from mpi4py import MPI

def at(place):
    if place == {place!r} and MPI.COMM_WORLD.rank == 1:
        raise ValueError("on this rank only")

at("collection")

def test_it():
    at("collective")
    MPI.COMM_WORLD.barrier()
"""


@pytest.mark.parametrize("place", PLACES)
def test_failure_on_one_rank_ends_the_run(place, tmp_path):
    (tmp_path / "conftest.py").write_text(SETTINGS)
    (tmp_path / "test_it.py").write_text(TEST.format(place=place))
    ended = run(tmp_path, 2, "-m", "pytest", "-q", "--color=no", "-p", "no:cacheprovider")
    printed = ended.stdout + ended.stderr
    assert ended.returncode != 0, printed
    assert PLACES[place] in printed and "on this rank only" in printed, printed


class TwoRanks:
    """Communicator of rank 0; the test has failed on rank 1."""

    rank, size = 0, 2

    def Dup(self):
        return self

    def allgather(self, failed):
        return [failed, True]


def test_failure_on_another_rank_is_one_on_this_rank():
    with pytest.raises(pytest.fail.Exception, match="failed on rank 1$"):
        rank_failures.RankFailures(TwoRanks()).wait()
