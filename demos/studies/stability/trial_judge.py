# SPDX-License-Identifier: MIT
"""Run a random case and check its final state by measures independent of the package."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np

import fenics_mortar as fm
from demos.studies.stability.case import Case
from demos.studies.stability.random_bodies import corner_areas, depths, distances, lengths
from demos.studies.stability.shape_case import ShapeCase
from demos.studies.stability.shape_judge import own_overlap, shape_errors
from demos.studies.stability.supported_case import SupportedCase
from demos.studies.stability.supported_limits import earliest_end_of_mesh, end_of_mesh
from demos.studies.stability.trial_scene import Scene, build
from fenics_mortar.utils import compat

Record = dict[str, Any]

# Limit analysis is that of rigid bodies; relative tolerance for elastic ones [1].
MARGIN = 0.05
# Tolerance if the certificate reports a coarse mesh: forces at edges are accurate to a facet.
REMARK_MARGIN = 0.25
# With non-associated friction bodies may move before the limit load: a dead end below this fraction
# of the limit load is a failure.
EARLIEST = 0.9

# Largest overlap of discretized surfaces between slave nodes, and largest distance where a force
# acts, over the longest facet [1]; larger values, within the limits of the certificate, must be
# reported by it.
PENETRATION, SEPARATION = 0.2, 0.05
# Largest relative difference of contact force and bulk stress, by Newton's tolerance [1].
BALANCE = 1e-6
# Largest relative change of the state by half the step size, by Newton's tolerance [1].
SAME = 1e-6
# With friction, whose path is integrated in steps; no limit for laws of the slip of a step.
SAME_WITH_FRICTION = 0.05
# Largest relative difference of the response with exchanged roles [1], and number of dofs:
# differences are discretization errors, up to 100 % on the coarsest meshes; on a refinement up to
# this number of dofs they must be below the limit, or the package must report one of the two
# solutions.
SIMILAR, MOST_DOFS = 0.2, 10_000
# Number of dofs for shapes, which need many steps.
MOST_DOFS_OF_SHAPES = 2_500
# Responses below this fraction of Young's modulus times width, or of the width, are zero [1].
NOTHING = 1e-6

# Limits that may confirm a dead end of bodies supported by friction, in this order.
ENDS: dict[str, Callable[[SupportedCase], float]] = {
    "end": lambda case: case.end,
    "end of mesh": end_of_mesh,
    "earliest end of mesh": earliest_end_of_mesh,
}


def run(case: Case, comm: MPI.Comm = MPI.COMM_SELF) -> tuple[Record, Scene | None]:
    """Follow the path of a case and check its final state (collective)."""
    record: Record = {"seed": case.seed, "outcome": "crash", "reason": "", **case.about}
    scene, begin = None, time.perf_counter()
    try:
        scene = build(case, comm)
        options = fm.SteppingOptions(step=case.step, smallest=case.smallest)
        paths = [scene.positions()]
        path = fm.follow_path(
            scene.problem,
            scene.set_loads,
            options,
            stop=case.stop,
            on_step=lambda *_: paths.append(scene.positions()),
        )
        certificate = path.steps[-1].report.certificate
        measured = measure(scene) | {"springs": certificate.springs if certificate else 0.0}
        violations = list(errors(scene, measured))
        if isinstance(case, ShapeCase):
            violations += shape_errors(scene, scene.bulk_forces(), paths[-1], paths[-2])
        record |= {"outcome": "wrong" if violations else "converged"}
        record |= {"reason": "; ".join(violations), **counts(path), **measured}
    except fm.NotConvergedError as error:
        record |= {"outcome": "failed", "reason": str(error), **counts(error.report)}
    except fm.MortarError as error:  # no step is cut: the rejected load is used
        record |= {"outcome": "failed", "reason": str(error)}
        record["refused"] = scene.time if scene else 0.0
    except Exception as error:
        record |= {"reason": repr(error), "traceback": traceback.format_exc()}
    if isinstance(case, SupportedCase):
        confirm(case, record)
    record["seconds"] = time.perf_counter() - begin
    return record, scene


def confirm(case: SupportedCase, record: Record) -> None:
    """Compare the outcome of a case with limit analysis of its rigid bodies.

    A failure is a dead end if bodies move near this load by limit analysis, or by limit analysis
    with forces at nodes only, in which case the mesh is too coarse. Finally, sliding bodies may
    move earlier, if forces and a mechanism satisfy the law of friction together. States beyond
    these loads, and bodies that slid although they are supported, are wrong.
    """
    reached = record.get("refused", record.get("time", 0.0))
    late = case.end * (1.0 + (REMARK_MARGIN if record.get("remarks") else MARGIN))
    if record["outcome"] not in ("converged", "failed"):
        return
    if "refused" not in record and reached > late:
        reason = (
            f"equilibrium at {reached:.3f}, where limit analysis has none beyond {case.end:.3f}"
        )
        record |= {"outcome": "wrong", "reason": reason}
    elif record["outcome"] == "converged" and record["moved"] > case.yielding:
        factor = record["moved"] / case.yielding
        reason = f"bodies moved by {factor:.2g} times the elastic displacement"
        record |= {"outcome": "wrong", "reason": reason}
    elif record["outcome"] == "failed":
        for judge, end in ENDS.items():
            record[judge] = end(case)
            if reached >= EARLIEST * record[judge]:
                record |= {"outcome": "dead end", "confirmed by": judge}
                break


def counts(path: Any) -> Record:
    """Steps, cuts and iterations of a path."""
    if not hasattr(path, "steps"):
        return {}
    return {
        "steps": len(path.steps),
        "cuts": path.num_cuts,
        "iterations": path.num_iterations,
        "per_step": [step.report.num_iterations for step in path.steps],
        "time": path.steps[-1].time if path.steps else 0.0,
    }


def measure(scene: Scene) -> Record:
    """Numbers of a solved state, equal on all ranks (collective)."""
    case, problem = scene.case, scene.problem
    x = case.x + problem.equations.bulk.by_input_node()[1]
    jacobians = corner_areas(x[case.cells]) / corner_areas(case.x[case.cells])
    size = max(float(np.ptp(body.x)) for body in case.bodies)
    no_force = NOTHING * min(body.E for body in case.bodies) * size
    return {
        "min_J": float(jacobians.min()),
        "stretch": float(stretches(case, x).max()),
        "force": [contact.total_force.tolist() for contact in problem.equations.contacts],
        "response": response(scene, x).tolist(),
        "no_response": NOTHING * size if case.pressed else no_force,
        "overlap": max(overlap(case, x, *pair) for pair in case.pairs),
        "separation": max(
            map(partial(separation, case, x), case.pairs, problem.equations.contacts)
        ),
        "moved": float(np.linalg.norm(x - case.x, axis=1).max()),
        "unbalance": unbalance(scene, no_force),
        "remarks": problem.certificate().remarks(),
    }


def response(scene: Scene, x: np.ndarray) -> np.ndarray:
    """Response to the loads: contact forces, or the mean displacement of the pressed boundary."""
    case = scene.case
    if case.pressed:
        return (x - case.x)[case.nodes_of(case.pressed)].mean(axis=0)
    return np.array([contact.total_force for contact in scene.problem.equations.contacts])


def errors(scene: Scene, measured: Record) -> Iterator[str]:
    """Messages on errors of a solved state (collective)."""
    yield from scene.problem.certificate().violations()
    if not measured["min_J"] > 0.0:
        yield f"a cell is inverted: J = {measured['min_J']:.2g}"
    has_remark = bool(measured["remarks"])
    if not (measured["overlap"] < PENETRATION or has_remark):
        yield f"bodies overlap by {measured['overlap']:.2g} of the longest facet"
    if not (measured["separation"] < SEPARATION or has_remark):
        yield f"a force acts over a distance of {measured['separation']:.2g} of the longest facet"
    if not measured["unbalance"] < BALANCE + measured.get("springs", 0.0):  # these are reported
        yield f"contact force and stresses differ by {measured['unbalance']:.1e}"


def stretches(case: Case, x: np.ndarray) -> np.ndarray:
    """Largest principal strain |stretch - 1| at the corners of all cells, (cells, corners)."""
    around = [0, 1, 2] if case.cells.shape[1] == 3 else [0, 1, 3, 2]
    before, after = (
        np.stack([np.roll(y, -1, axis=1) - y, np.roll(y, 1, axis=1) - y], axis=-1)
        for y in (case.x[case.cells[:, around]], x[case.cells[:, around]])
    )
    F = after @ np.linalg.inv(before)
    return np.abs(np.linalg.svd(F, compute_uv=False) - 1.0).max(axis=-1)


def overlap(case: Case, x: np.ndarray, one: str, other: str) -> float:
    """Depth of the nodes of each of two boundaries in the other's body over the longest facet."""
    planes = getattr(case, "planes", {})
    if other in planes:
        line, (point, normal) = x[case.nodes_of(one)], planes[other]
        return max(-float(((line - point) @ normal).min()), 0.0) / float(lengths(line).max())
    facets = max(float(lengths(x[case.nodes_of(b)]).max()) for b in (one, other))
    if case.number_of(one) == case.number_of(other):
        return own_overlap(case, x, one, other) / facets
    deepest = 0.0
    for nodes, boundary in ((case.nodes_of(one), other), (case.nodes_of(other), one)):
        deepest = max(deepest, float(depths(x[nodes], x[case.outline_of(boundary)]).max()))
    return deepest / facets


def separation(case: Case, x: np.ndarray, pair: tuple[str, str], contact: Any) -> float:
    """Smallest distance of two boundaries over the longest facet; zero if no force acts.

    If a node is inside the other body, the boundaries cross.
    """
    if not contact.active.any() or overlap(case, x, *pair) > 0.0:
        return 0.0
    planes = getattr(case, "planes", {})
    if pair[1] in planes:
        line, (point, normal) = x[case.nodes_of(pair[0])], planes[pair[1]]
        return float(((line - point) @ normal).min()) / float(lengths(line).max())
    one, other = (x[case.nodes_of(boundary)] for boundary in pair)
    least = min(distances(one, other).min(), distances(other, one).min())
    return float(least) / max(float(facets.max()) for facets in (lengths(one), lengths(other)))


def unbalance(scene: Scene, no_force: float) -> float:
    """Difference of contact force and the stresses' force on the slaves, relative (collective).

    Prescribed components of slave nodes contain reactions, and are left out. Forces below
    ``no_force`` are zero: a body that has just lifted off carries rounding.
    """
    if isinstance(scene.case, (SupportedCase, ShapeCase)):
        return unbalance_of_nodes(scene, no_force)
    problem, worst = scene.problem, 0.0
    r = compat.create_vector(problem.equations.bulk.V)
    compat.assemble_vector(r, compat.form(scene.residual))
    forces = np.zeros(problem.equations.bulk.u.x.array.size)
    forces[: problem.equations.bulk.num_owned] = r.array_r
    r.destroy()
    for contact in problem.equations.contacts:
        free = contact.free.all(axis=0)
        own = contact.slave.gather(forces).sum(axis=0)
        size = max(float(np.abs(contact.operators.force(contact.z)[0]).sum()), no_force)
        difference = np.abs(own - contact.total_force)[free].max(initial=0.0)
        worst = max(worst, float(difference) / size)
    return worst


def unbalance_of_nodes(scene: Scene, no_force: float) -> float:
    """Imbalance at free nodes, which may be in several pairs; see ``unbalance`` (collective)."""
    problem = scene.problem
    bulk = problem.equations.bulk
    r = compat.create_vector(bulk.V)
    compat.assemble_vector(r, compat.form(scene.residual))
    total, sizes = r.array_r.copy(), 0.0
    r.destroy()
    for contact in problem.equations.contacts:
        on_slave, on_master = contact.operators.force(contact.z)
        contact.slave.scatter_add(on_slave, total)
        contact.master.scatter_add(on_master, total)
        sizes += float(np.abs(on_slave).sum())
    total[bulk.prescribed_dofs] = 0.0
    largest = bulk.comm.allreduce(float(np.abs(total).max(initial=0.0)), MPI.MAX)
    return largest / max(sizes, no_force)


def check_again(case: Case, record: Record) -> None:
    """Solve with half the step size, and with exchanged roles; add differences to the record.

    If bodies are supported by friction, forces are not unique and depend on the path: only the
    outcome is compared.
    """
    if isinstance(case, SupportedCase):
        check_supported_again(case, record)
        return
    again, _ = run(replace(case, step=case.step / 2))
    record["half the steps"] = again["outcome"]
    differences = []
    if again["outcome"] == "converged":
        difference = record["half the steps: difference"] = distance(record, again)
        if not difference < _same(case):
            differences.append(f"half the steps change the response by {difference:.1e}")
    elif again["outcome"] != "failed":
        differences.append(f"half the steps: {again['outcome']}, {again['reason']}")
    if case.can_be_swapped:
        differences += exchange_roles(case, record)
    if differences:
        record |= {"outcome": "wrong", "reason": "; ".join(differences)}
    elif isinstance(case, ShapeCase) and record.get("exchanged roles") == "failed":
        record |= {"outcome": "failed", "reason": record["exchanged roles: reason"]}


def _same(case: Case) -> float:
    """Allowed change of the response by half the step size [1]."""
    rules = getattr(case, "rules", [])
    if any(rule.kind in ("tanh", "Stribeck") for rule in rules):
        return np.inf
    return SAME_WITH_FRICTION if any(rule.mu for rule in rules) else SAME


def check_supported_again(case: SupportedCase, record: Record) -> None:
    """Check that half the step size, and exchanged roles, lead to a valid state, too."""
    paths = {"half the steps": replace(case, step=case.step / 2)}
    if case.can_be_swapped:
        paths["exchanged roles"] = case.swapped()
    for name, other in paths.items():
        again, _ = run(other)
        record[name] = again["outcome"]
        if again["outcome"] in ("wrong", "crash"):
            reason = f"{name}: {again['outcome']}, {again['reason']}"
            record |= {"outcome": "wrong", "reason": reason}


def exchange_roles(case: Case, record: Record) -> Iterator[str]:
    """Compare with the solution of exchanged roles, on finer meshes where coarse ones differ."""
    record["refinements"] = 0
    one, sign, shape = record, 1.0 if case.pressed else -1.0, isinstance(case, ShapeCase)
    while True:
        two, _ = run(case.swapped())
        record["exchanged roles"] = two["outcome"]
        record["exchanged roles: reason"] = f"exchanged roles: {two['reason']}"
        for outcome in (one, two):
            if outcome["outcome"] not in ("converged", "failed"):
                yield f"exchanged roles: {outcome['outcome']}, {outcome['reason']}"
        if not one["outcome"] == two["outcome"] == "converged":
            return
        record["exchanged roles: difference"] = distance(one, two, sign)
        case = case.refined()
        if record["exchanged roles: difference"] < SIMILAR:
            return
        if 2 * len(case.x) > (MOST_DOFS_OF_SHAPES if shape else MOST_DOFS):
            record["exchanged roles: remarks"] = one["remarks"] or two["remarks"]
            if not record["exchanged roles: remarks"]:
                change = record["exchanged roles: difference"]
                yield f"exchanged roles change the response by {change:.2g}, which nothing reports"
            return
        one, _ = run(case)
        record["refinements"] += 1


def distance(one: Record, two: Record, sign: float = 1.0) -> float:
    """Relative difference of two responses."""
    first, second = np.array(one["response"]), sign * np.array(two["response"])
    size = max(np.abs(first).max(), np.abs(second).max(), one["no_response"])
    return float(np.abs(first - second).max() / size)
