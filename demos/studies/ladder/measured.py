# SPDX-License-Identifier: MIT
"""True errors, estimates and costs of simpler models."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

import fenics_mortar as fm
from demos.studies.ladder.posing import Posed, elastic_tool, pose, read
from demos.studies.ladder.row import NOTHING, Errors, Row
from demos.studies.ladder.scenes import FULL, Model, Scene
from fenics_mortar.models.model_error import (
    ENERGY,
    FORCE,
    PEAK,
    QUANTITIES,
    SolutionQuantities,
    contacts_of,
    differences,
    estimate_wider,
)

Solved = tuple[Posed, Row]


def clocked(do: Callable[..., Any], *arguments: Any) -> tuple[Any, float]:
    """Result of a function, and its CPU seconds."""
    start = time.process_time()
    return do(*arguments), time.process_time() - start


def follow(scene: Scene, posed: Posed, row: Row) -> bool:
    """Solve all steps; return whether all converged."""
    start = time.process_time()
    try:
        for t in np.arange(1, scene.steps + 1) / scene.steps:
            posed.set_time(t)
            report = posed.solve(scene.duration / scene.steps)
            row.iterations += report.num_iterations
    except fm.MortarError as error:
        row.reason = str(error)
        return False
    row.seconds = time.process_time() - start
    if report.model_check is not None:
        found = report.model_check.assumptions
        row.estimate = found[-1].errors if found else dict.fromkeys(QUANTITIES, 0.0)
    return True


def true_errors(posed: Posed, full: Posed) -> Errors:
    """Differences from the full model at the nodes of the cheap one."""
    both = [p.problem.equations.bulk for p in (posed, full)]
    mine, theirs = (bulk.V.tabulate_dof_coordinates() for bulk in both)
    problem, reference = posed.problem, SolutionQuantities.of(full.problem)
    # the two sides of an interface may share positions: nodes of equal meshes are matched by number
    place = np.arange(len(mine))
    if len(mine) != len(theirs):
        soft = (
            full.problem.equations.floating.labels
            == full.problem.equations.floating.labels[soft_node(full)]
        )
        place = np.flatnonzero(soft)[cKDTree(theirs[soft]).query(mine)[1]]
    reference.u = reference.u.reshape(-1, 2)[place].ravel()
    return differences(problem, SolutionQuantities.of(problem), reference)


def soft_node(posed: Posed) -> int:
    """A node of the soft body."""
    return int(posed.problem.equations.contacts[0].slave.nodes[0])


def mesh_errors(scene: Scene, load: float, full: Posed) -> Errors:
    """Errors of the full model's mesh."""
    finer = pose(scene, load, FULL, read(scene, load, finer=2))
    coarse = np.nan if full.dynamics is not None else full.problem.estimate().relative
    if not follow(scene, finer, Row(scene.name, load, "mesh", 0)):
        return NOTHING | {ENERGY: coarse}
    here, there = (SolutionQuantities.of(posed.problem) for posed in (full, finer))
    force = np.linalg.norm(here.force - there.force) / np.linalg.norm(there.force)
    peak = np.abs(here.peak - there.peak).max() / there.peak.max()
    return {ENERGY: coarse, FORCE: float(force), PEAK: float(peak)}


def estimated_errors(scene: Scene, load: float, model: Model, posed: Posed) -> Errors:
    """Errors estimated by ``ModelCheck`` for all assumptions; nan for bodies in motion."""
    if posed.dynamics is not None:
        return NOTHING
    if model.rigid:
        return by_meshed_tool(scene, load, posed)
    finite = posed.finite if model.strain == "linear" else None
    assumptions = fm.ModelCheck(finite_strain=finite).assess(posed.problem).assumptions
    return assumptions[-1].errors if assumptions else dict.fromkeys(QUANTITIES, 0.0)


def by_meshed_tool(scene: Scene, load: float, posed: Posed) -> Errors:
    """Differences between a rigid circle and the meshed elastic tool."""
    (circle,) = posed.problem.equations.motions.obstacles
    tool = elastic_tool(scene, circle, read(scene, load, "tool"))
    touching = contacts_of(posed.problem, tool)
    parts = zip(tool.displacements(touching), tool.flatness(touching), strict=True)
    return estimate_wider(posed.problem, touching, [a + b for a, b in parts])


def solved(scene: Scene, load: float, model: Model, data: Any, friction: float = 0.0) -> Solved:
    """A problem solved with a model, and its row, without errors."""
    posed, setup = clocked(pose, scene, load, model, data, friction)
    row = Row(scene.name, load, model.name, posed.problem.equations.bulk.r.getSize(), setup)
    follow(scene, posed, row)
    return posed, row


def measure(scene: Scene, load: float) -> Iterator[Row]:
    """All models of a problem at a load."""
    alone = scene.pressure is not None
    names = {rigid: "soft" if rigid or alone else "soft tool" for rigid in (True, False)}
    meshes = {rigid: read(scene, load, bodies) for rigid, bodies in names.items()}
    full = solved(scene, load, FULL, meshes[False])
    mesh = mesh_errors(scene, load, full[0])
    for model in (FULL, *(model for model in scene.models() if model != FULL)):
        posed, row = full if model == FULL else solved(scene, load, model, meshes[model.rigid])
        reference, straight = full
        if model.leaves_out:
            reference, straight = solved(scene, load, FULL, meshes[False], model.leaves_out)
        row.mesh, row.against, row.reason = mesh, straight.seconds, row.reason or straight.reason
        if not row.reason:
            row.true = true_errors(posed, reference)
            if not model.leaves_out:
                row.estimate, row.check = clocked(estimated_errors, scene, load, model, posed)
        yield row


def measure_all(scene: Scene) -> Iterator[Row]:
    """All models of a problem at all its loads, printed as they are measured."""
    for load in scene.loads:
        for row in measure(scene, load):
            print(f"{row.scene} {row.load:g} {row.model}: {row.seconds:.1f} s {row.reason}")
            yield row
