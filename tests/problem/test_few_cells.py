# SPDX-License-Identifier: MIT
"""Every public method on two, three and five cells, on ranks without cells and without surfaces.

``tests/run.sh`` runs these on 3 ranks; on 5 most have neither cells nor nodes of the contact.
"""

import pickle
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import few_cells_program
import numpy as np
import pytest
from few_cells_scenes import SCENES
from public_calls import calls, public

from demos.studies.processes import outer_environment

COMM = MPI.COMM_WORLD
ROOT = Path(__file__).resolve().parents[2]
# Meshes of each scene on 3 and on 5 ranks: so different that each occurs with both numbers.
MESHES = ["2,quadrilateral,1", "3,triangle,1", "2,triangle,1", "5,quadrilateral,2"]
# Scenes whose meshes are given: positions of nodes are controls with degree 1 only, a body of one
# cell has a second layer of nodes with degree 2, and one half of the options and obstacles is tried
# on an even, the other on an odd number of cells.
GIVEN = {
    "paths": ("2,triangle,1", "3,triangle,1"),
    "moving": ("2,quadrilateral,1", "5,quadrilateral,2"),
    "options": ("2,quadrilateral,1", "3,triangle,1"),
    "obstacles": ("2,triangle,1", "5,quadrilateral,1"),
    "in_space": ("2,hexahedron,1", "3,tetrahedron,1"),
    "section": ("2,hexahedron,1", "3,tetrahedron,1"),
}
# Time after which the scenes of one process count as hanging [s]; they take a few seconds, and many
# times as long where other programs use the cores.
LIMIT = 600
# Difference from the results on one rank, over the largest entry: Newton's method stops at 1e-13 of
# the forces, the estimate of an error is the root of a sum of small squares.
SAME = 1e-7
# Results of this size are differences of numbers of order one, as the shear where nothing slides:
# rounding of these is accepted.
SMALL = 1e-5
# Public, but not called: abstract, or replaced by all that is called here.
REPLACED = ("Control.", "Quantity.", "Law.", "Obstacle.")
# Local methods: of laws without adhesion or memory, of obstacles without a shape to be changed.
LOCAL = (
    ".adhesion_at", ".check_field", ".closing_gap", ".remember", ".local_by_shapes", ".set_shape",
)  # fmt: skip
# The error that nodes cannot be moved, a package that is not installed, and derivatives of the
# memory of laws; other tests have them. Laws without adhesion are not asked for it, and those with
# a limit at nodes not for that of a pressure.
ELSEWHERE = {
    "NodalPositions.set", "to_autograd", "LawParameter.memory", "Offset.memory",
    "Interference.memory", "ObstacleShape.memory", "ObstacleLoad.pairs", "ObstaclePlace.pairs",
    "Coulomb.adhesion", "Frictionless.adhesion", "Tresca.adhesion",
    "Coulomb.friction_limit", "Tresca.friction_limit",
}  # fmt: skip
# Called by the scene "written", but not listed by cProfile of Python 3.13; results are compared.
UNLISTED = {"plot"}


def cases(ranks):
    """Scenes with their meshes, as for the program."""
    which = int(ranks >= 5)
    return [
        f"{scene.__name__},{GIVEN.get(scene.__name__, (mesh, other))[which]}"
        for number, scene in enumerate(SCENES)
        for mesh, other in [(MESHES[number % 4], MESHES[(number + 1) % 4])]
    ]


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Results on one rank by case: each rank starts a process for some of them."""
    folder, environment = tmp_path_factory.mktemp("alone"), outer_environment()
    environment["PYTHONPATH"] = f"{ROOT}:{environment.get('PYTHONPATH', '')}"
    mine = cases(COMM.size)[COMM.rank :: COMM.size]
    ended = subprocess.run(
        [sys.executable, few_cells_program.__file__, folder, *mine],
        env=environment, capture_output=True, text=True, timeout=LIMIT,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout[-2000:] + ended.stderr[-6000:]
    some = pickle.loads((folder / "results").read_bytes())
    return {case: found for part in COMM.allgather(some) for case, found in part.items()}


def difference(one, other):
    """Message on the first of two lists of results that differs, "" if none does."""
    for (name, mine), (what, theirs) in zip(one, other, strict=True):
        if name != what:
            return f"{name} and {what}"
        try:
            x, y = (np.nan_to_num(np.asarray(value, float)) for value in (mine, theirs))
        except (TypeError, ValueError):
            same = np.array_equal(mine, theirs)
        else:
            size = max(np.abs(x).max(initial=0.0), SMALL)
            same = x.shape == y.shape and np.abs(x - y).max(initial=0.0) <= SAME * size
        if not same:
            return f"{name}: {mine} on one rank, {theirs} on several"
    return ""


@pytest.mark.usefixtures("several_ranks")
@pytest.mark.parametrize("case", cases(COMM.size))
def test_results_on_ranks_without_cells_are_those_on_one_rank(case, alone, shared_path):
    results = few_cells_program.collect(*few_cells_program.parse(case), shared_path)
    assert COMM.bcast(difference(alone[case], results) if COMM.rank == 0 else None) == ""


@pytest.mark.serial
@pytest.mark.once
def test_every_public_method_is_called(tmp_path):
    """A new method belongs to one of the scenes; some take halves of what they try by the mesh."""
    others = [case for case in cases(5) if case.startswith(("options", "obstacles", "in_space"))]
    with calls() as called:
        for case in [*cases(3), *others]:
            folder = tmp_path / case
            folder.mkdir()
            few_cells_program.collect(*few_cells_program.parse(case), folder)
    missing = {
        name for name, code in public().items()
        if code not in called and not name.startswith(REPLACED) and not name.endswith(LOCAL)
    }  # fmt: skip
    assert missing - UNLISTED == ELSEWHERE
