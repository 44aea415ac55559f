# SPDX-License-Identifier: MIT
"""Run a case in space along its path, and again in another frame or with exchanged roles."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from mpi4py import MPI

import numpy as np

import fenics_mortar as fm
from demos.studies.stability.random_bodies import Array
from demos.studies.stability.space_case import SpaceCase
from demos.studies.stability.space_judge import judge
from demos.studies.stability.space_scene import SpaceScene, build
from fenics_mortar.interface.space_mortar import SpaceOperators
from fenics_mortar.utils.arrays import EPSILON

# Tolerance of Newton's method where two solutions are compared to rounding.
TIGHT = fm.NewtonOptions(residual_tolerance=1e-12)
# Largest relative change of motions and forces in another frame [1]: rounding of positions, and of
# mean slips, over strains is added. In a mirror, clipped facets that are no parallelograms are
# divided into other triangles.
SAME, ROUNDING, MIRRORED = 1e-7, 1e-14, 1e-3
# Rounding of mean slips over ``Run.magnified``, as in Newton's attainable residual [1].
OF_SLIP = 4.0 * EPSILON
# Largest change of the force of a pair with exchanged roles over its size [1]: the error of meshes
# of two to six facets.
SIMILAR = 0.3
# How a case may be solved again, and a case with obstacles only.
AGAIN = ("", "", "turned", "mirrored", "roles")
ALONE = AGAIN[:-1]
# Smallest step [time], and of paths that limit analysis ends, or may end.
SMALLEST, TO_END = 1e-3, 0.25


@dataclass
class Run:
    """A solved path.

    Attributes:
        positions: Of all nodes at the times 0, 1, ... [unit].
        forces: On the slave of each pair at these times, (pairs, 3) each.
        springs: Largest part of a contact force that springs carry at these times [1].
        magnified: Largest rounding of a mean slip of two bodies over that of a position, likewise
            [1]. Dual functions of nine nodes are up to 1e10 where little of a facet is covered.
    """

    scene: SpaceScene
    reports: list[Any] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    positions: list[Array] = field(default_factory=list)
    forces: list[Array] = field(default_factory=list)
    cuts: int = 0
    springs: float = 0.0
    magnified: float = 0.0


Check = Callable[[Run], Iterator[str]]


def follow(
    case: SpaceCase,
    comm: MPI.Comm = MPI.COMM_SELF,
    check: Check | None = None,
    smallest: float = SMALLEST,
    **options: Any,
) -> Run:
    """Follow the path of a case; the states at times 1, 2, ... are judged (collective)."""
    scene = build(case, comm, **options)
    run = Run(scene, positions=[scene.positions()])
    before = run.positions[0]
    accepted = [0.0]

    def on_step(time: float, report: Any) -> None:
        nonlocal before
        now, scene.last = scene.positions(), accepted[-1]
        accepted.append(time)
        if time == round(time):
            run.errors += [f"time {time:g}: {w}" for w in judge(scene, before, now)]
            certificate = scene.problem.certificate()
            run.remarks += certificate.remarks()
            run.springs = max(run.springs, certificate.springs)
            run.magnified = max(run.magnified, magnification(scene))
            run.positions.append(now)
            found = [one.sum(axis=0) for one, _ in scene.contact_forces()]
            run.forces.append(np.array(found))
            run.errors += [f"time {time:g}: {w}" for w in check(run)] if check else []
        before = now

    for stop in range(1, int(case.stop) + 1):
        steps = fm.SteppingOptions(step=1.0 / case.steps, smallest=smallest)
        path = fm.follow_path(
            scene.problem, scene.set_loads, steps, start=stop - 1.0, stop=float(stop),
            on_step=on_step,
        )  # fmt: skip
        run.reports += [step.report for step in path.steps]
        run.cuts += path.num_cuts
    return run


def magnification(scene: SpaceScene) -> float:
    """Largest rounding of a mean slip of two bodies over that of a position [1] (collective)."""
    largest = 0.0
    for contact, rule in zip(scene.problem.equations.contacts, scene.case.laws, strict=True):
        o, active = contact.operators, contact.active
        if rule.mu and isinstance(o, SpaceOperators):
            ratio = o.rounding_of_vectors()[active] / o.weight[active]
            largest = max(largest, float(ratio.max(initial=0.0)))
    return largest


def compare(
    one: Run, other: Run, allowed: float, what: str, *, drifts: bool = False
) -> Iterator[str]:
    """Messages on different forces of two runs of the same mesh, and motions unless it drifts.

    Where springs carry a part of the forces, in motions that contact hardly resists, the runs may
    have stopped at different places.
    """
    allowed += one.springs + other.springs
    start = one.positions[0]
    for time, (x, y) in enumerate(zip(one.positions, other.positions, strict=True)):
        moved = np.abs(x - start).max()
        if time and not drifts and not np.abs(x - y).max() <= allowed * moved:
            yield f"{what}: motions at time {time} differ by {np.abs(x - y).max() / moved:.1e}"
    for time, (f, g) in enumerate(zip(one.forces, other.forces, strict=True), 1):
        if not np.abs(f - g).max() <= allowed * np.abs(f).max():
            part = np.abs(f - g).max() / np.abs(f).max()
            yield f"{what}: forces at time {time} differ by {part:.1e}"


def run_again(case: SpaceCase, way: str, rng_seed: int, check: Check | None) -> Iterator[str]:
    """Messages of a second solution, compared with one to rounding or to the mesh's error."""
    if way in ("turned", "mirrored"):
        frame = case.frame.other(np.random.default_rng(rng_seed), mirrored=way == "mirrored")
        runs = [follow(replace(case, frame=f), newton=TIGHT) for f in (case.frame, frame)]
        rounding = ROUNDING + OF_SLIP * max(run.magnified for run in runs)
        allowed = rounding / case.strain + (SAME if way == "turned" else MIRRORED)
        free = len(case.solids) > len(case.held)
        drifts = free and not any(rule.mu for rule in case.laws)
        yield from compare(*runs, allowed, way, drifts=drifts)
    elif way == "roles" and case.can_be_swapped:
        one, other = follow(case), follow(case.swapped(), check=check)
        yield from (f"exchanged roles: {wrong}" for wrong in other.errors)
        for time, (f, g) in enumerate(zip(one.forces, other.forces, strict=True), 1):
            signs = [1.0 if master in case.tools else -1.0 for _, master in case.pairs]
            part = np.abs(f - np.array(signs)[:, None] * g).max() / np.abs(f).max()
            if not part <= SIMILAR and not (one.remarks or other.remarks):
                yield f"exchanged roles: forces at time {time} differ by {part:.2g}"


def solver(
    case: SpaceCase, way: str, seed: int, check: Check | None = None, fails: bool | None = False
) -> Callable[..., Any]:
    """The function that solves a drawn case, see ``random_physics``.

    Args:
        case: The case.
        way: One of ``AGAIN``: how it is solved again.
        seed: Of the other frame.
        check: Further checks, at times 1, 2, and so on.
        fails: Whether the package has to refuse it; ``None`` if it may.
    """

    def solve(comm: MPI.Comm = MPI.COMM_SELF) -> Any:
        try:
            run = follow(case, comm, check, SMALLEST if fails is False else TO_END)
        except fm.NotConvergedError as error:
            if fails is False:
                raise
            return [], [], [f"refused: {error}"]
        errors = run.errors
        if fails:
            errors.append("an equilibrium, where limit analysis has none")
        if comm.size == 1:
            errors += run_again(case, way, seed, check)
        return run.reports, errors, run.remarks

    return solve
