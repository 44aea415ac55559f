# SPDX-License-Identifier: MIT
"""The problems of ``waits``, solved by another code on the same meshes.

    python3 -m demos.studies.performance.waits_peer getfem 50 100 0.0037
    kratos/bin/python -m demos.studies.performance.waits_peer kratos 50 100 0.0037
    ngsolve/bin/python -m demos.studies.performance.waits_peer ngsolve 50 100 0.0037

The docstrings of ``demos/studies/accuracy/peer_*.py`` describe how to install the codes and which
of their types of contact is used. Seconds are those of all load steps, without the creation of
meshes and models. Force and pressure are computed by our own residual from the code's displacement.
If a code cannot solve a problem, the column of the solver has the reason.
"""

from __future__ import annotations

import sys
import time
from importlib import import_module
from typing import Any

import numpy as np

from demos.studies.accuracy.peer import Given, Pose, given, prescribed
from demos.studies.performance.waits import (
    BLOCK,
    DISC,
    STEPS,
    STIFFER,
    half_disc,
    ironing,
    print_head,
    print_row,
)


def measure(name: str, pose: Pose, problem: Any, arrays: Given, positions: list[Any]) -> None:
    """Solve for prescribed values, one array for each load step, and print a row."""
    try:
        solve = pose(arrays)
        start, iterations = time.process_time(), 0
        for values in positions:
            answer = solve(values)
            iterations += answer.iterations
    except (RuntimeError, NotImplementedError) as error:
        print(f"| {name} | {arrays.x.size} | - | - | - | - | {error} |", flush=True)
        return
    seconds = time.process_time() - start
    bulk = problem.equations.bulk
    bulk.u.x.array[:] = answer.u.ravel()
    print_row(name, problem, seconds, iterations, answer.solver)


def body_of_slave(problem: Any) -> np.ndarray:
    """Numbers of the cells of the body with the slave surface."""
    (contact,) = problem.equations.contacts
    data = contact.pair.data
    return data.cell_tags.find(data.body_tag(contact.slave.name.split("/")[0]))


def main() -> None:
    """Measure all sizes."""
    code, *sizes = sys.argv[1:]
    peer = import_module(f"demos.studies.accuracy.peer_{code}")
    print_head()
    for size in map(float, sizes):
        if size < 1.0:
            for name, degree in (("H1", 1), ("H1 of degree 2", 2)):
                problem = half_disc(size, degree)
                arrays = given(problem, body_of_slave(problem), *DISC, deformed=True)
                measure(name, peer.pose, problem, arrays, [arrays.values])
            continue
        problem, move = ironing(int(size))
        material = {"stiffness": STIFFER, "finite": True, "deformed": True}
        arrays = given(problem, body_of_slave(problem), *BLOCK, **material)
        positions = []
        for step in range(1, STEPS + 1):
            move(step / STEPS)
            positions.append(prescribed(problem))
        arrays.values = positions[-1]
        measure("H3, loop", peer.pose, problem, arrays, positions)


if __name__ == "__main__":
    main()
