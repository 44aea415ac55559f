# SPDX-License-Identifier: MIT
"""Table of bodies that touch themselves or each other, with friction; half a minute, in serial.

``/usr/bin/python3 tests/program.py self_contact_table``.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from self_scenes import Driven, c_ring, flattened_tube, honeycomb, strip_in_s, ten_bodies, tube

import fenics_mortar as fm

MU = fm.Coulomb(0.3)


def of(names: Any) -> Callable[..., list[fm.ContactPair]]:
    """Pairs of a surface, or a list of them, that may touch itself."""
    return lambda data, *given: [fm.ContactPair(data, names or given[0], law=MU)]


Moved = tuple[Driven, Any]


def moved(scene: Driven, steps: int, **ends: tuple[float, float]) -> Moved:
    """The scene with its parts moved to new positions, and the path."""
    return scene, scene.move(steps, **{name: np.array(end) for name, end in ends.items()})


def ring() -> Moved:
    """A C-ring, its ends pressed together and along each other."""
    names = [f"ring/{side}" for side in ("first", "last", "top", "bottom")]
    return moved(c_ring(of(names)), 10, high=(0.01, -0.18))


def strip() -> Moved:
    """A clamped strip folded into an S."""
    return moved(strip_in_s(of("strip/outline")), 10, high=(0.03, -0.25))


def pinched_tube() -> Moved:
    """A tube pinched until its inside touches."""
    return moved(tube(of("tube/inside")), 14, high=(0.0, -0.9), low=(0.0, 0.9))


def flat_tube() -> Moved:
    """A tube pressed flat between two planes."""
    return flattened_tube(MU)


def stack() -> Moved:
    """Ten random bodies between two plates."""
    return moved(ten_bodies(of(None), foundation=10.0), 4, high=(0.0, -0.12))


def comb() -> Moved:
    """A honeycomb of 3 x 3 cells, compressed by six tenths."""
    made = honeycomb(of("comb/walls"))
    height = float(np.ptp(made.contact.slave.X[:, 1]))
    return moved(made, 14, high=(0.0, -0.6 * height))


def main() -> None:
    """Print a row for each scene."""
    columns = "steps | iterations | cuts | active | stick | resultant / size | Taylor slope"
    print(f"| scene | {columns} | violations |\n|---|" + "---:|" * 7 + "---|")
    for pose in (ring, strip, pinched_tube, flat_tube, stack, comb):
        scene, path = pose()
        contact, problem = scene.contact, scene.problem
        forces = contact.operators.force(contact.z)
        total = np.abs(sum(force.sum(axis=0) for force in forces)).max()
        balance = total / sum(np.abs(force).sum() for force in forces)
        slope = problem.check_tangent(print_table=False).slopes["whole"]
        iterations = sum(step.report.num_iterations for step in path.steps)
        cells = [pose.__name__, len(path.steps), iterations, path.num_cuts, contact.active.sum()]
        cells += [contact.sticking.sum(), f"{balance:.0e}", f"{slope:.3f}"]
        wrong = problem.certificate().violations()
        print(f"| {' | '.join(map(str, cells))} | {'; '.join(wrong) or 'none'} |", flush=True)


if __name__ == "__main__":
    main()
