# SPDX-License-Identifier: MIT
"""Every public method on two, three and five cells, on ranks without cells and without surfaces."""

import pickle
import subprocess
import sys
from pathlib import Path

import few_cells_program
import numpy as np
import pytest
from few_cells_scenes import SCENES
from public_calls import calls, public

from demos.studies.processes import mpirun, outer_environment

pytestmark = [pytest.mark.serial, pytest.mark.slow]

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
# Time after which a scene counts as hanging [s]; one takes up to ten seconds, and ten times as long
# where other programs use the cores.
LIMIT = 180
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
# memory of laws; other tests have them.
ELSEWHERE = {
    "NodalPositions.set", "to_autograd", "LawParameter.memory", "Offset.memory",
    "Interference.memory", "ObstacleShape.memory", "ObstacleLoad.pairs", "ObstaclePlace.pairs",
}  # fmt: skip
# Called by the scene "written", but not listed by cProfile of Python 3.13; results are compared.
UNLISTED = {"plot"}


def cases(ranks):
    """Arguments of the program: scenes with their meshes."""
    which = (3, 5).index(ranks)
    return [
        f"{scene.__name__},{GIVEN.get(scene.__name__, (mesh, other))[which]}"
        for number, scene in enumerate(SCENES)
        for mesh, other in [(MESHES[number % 4], MESHES[(number + 1) % 4])]
    ]


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Results on one rank by case, and the code of all functions called."""
    found = {}
    with calls() as called:
        for case in {**dict.fromkeys(cases(3)), **dict.fromkeys(cases(5))}:
            folder = tmp_path_factory.mktemp(case)
            found[case] = few_cells_program.collect(*few_cells_program.parse(case), folder)
    return found, called


def on_ranks(ranks, some, folder):
    """Results of some cases on several ranks."""
    environment = outer_environment()
    environment["PYTHONPATH"] = f"{ROOT}:{environment.get('PYTHONPATH', '')}"
    program = few_cells_program.__file__
    ended = subprocess.run(
        [*mpirun(ranks), sys.executable, program, folder, str(LIMIT), *some],
        env=environment, capture_output=True, text=True, timeout=LIMIT * len(some),
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout[-2000:] + ended.stderr[-6000:]
    return pickle.loads((folder / "results").read_bytes())


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


@pytest.mark.parametrize("ranks", [3, pytest.param(5, marks=pytest.mark.once)])
def test_results_on_ranks_without_cells_are_those_on_one_rank(ranks, alone, tmp_path):
    found = on_ranks(ranks, cases(ranks), tmp_path)
    differ = {case: difference(alone[0][case], results) for case, results in found.items()}
    assert {case: message for case, message in differ.items() if message} == {}


def test_every_public_method_is_called(alone):
    """A new method belongs to one of the scenes."""
    missing = {
        name for name, code in public().items()
        if code not in alone[1] and not name.startswith(REPLACED) and not name.endswith(LOCAL)
    }  # fmt: skip
    assert missing - UNLISTED == ELSEWHERE
