# SPDX-License-Identifier: MIT
"""The stability atlas: its runner, and some cells that distinguish the methods."""

import functools
import json
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from scenes import read

import ufl
from dolfinx import fem

from demos.studies.stability import atlas
from demos.studies.stability.methods import REMEDIES
from meshes import mapped_grids

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.serial
Worker = atlas.Worker


def task(scene, value, method="default"):
    return {"scene": scene, "value": str(value), "method": method, "ranks": 1}


def worker_that(body):
    """A worker that runs ``body`` for each line that it reads."""
    program = """
        import json, os, sys, time
        for line in sys.stdin:
            task = json.loads(line)
        """
    program = textwrap.dedent(program) + textwrap.indent(textwrap.dedent(body), "    ")
    return Worker(command=[sys.executable, "-c", program])


# The meshes


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_mapped_grids_have_their_areas_and_boundaries(cell):
    ring = mapped_grids.sector(12, 2, radii=(0.5, 1.0), centre=(3.0, 0.0))
    flat = mapped_grids.block(4, 3, width=2.0, height=1.0)[::-1]  # runs clockwise
    grids = [
        mapped_grids.Grid("ring", ring, closed=True),
        mapped_grids.Grid("flat", flat, joined={"left": "flat/ends", "right": "flat/ends"}),
    ]
    data = read(mapped_grids.build, grids=grids, cell=cell)
    one = fem.Constant(data.mesh, 1.0)
    dx = ufl.Measure("dx", domain=data.mesh, subdomain_data=data.cell_tags)
    areas = [fem.assemble_scalar(fem.form(one * dx(data.bodies[b]))) for b in ("ring", "flat")]
    polygon = 6 * np.sin(np.pi / 6) * (1.0**2 - 0.5**2)
    assert areas == pytest.approx([polygon, 2.0], rel=1e-12)
    counts = {name: len(data.boundary_facets(name)) for name in data.boundaries}
    assert counts == {
        "ring/bottom": 12,
        "ring/top": 12,
        "flat/bottom": 4,
        "flat/top": 4,
        "flat/ends": 6,
    }


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_mapped_grids_of_order_2_bend(cell):
    """Parabolas through three points of each arc; a chord of arc t misses t^2 / 6 of the area.

    A parabola's sagitta is that of the arc, so that area is missing only from order t^4 on.
    """
    ring = mapped_grids.sector(24, 4, radii=(0.5, 1.0))
    for x in (ring, ring[::-1]):
        grids = [mapped_grids.Grid("ring", x, closed=True)]
        data = read(mapped_grids.build, grids=grids, cell=cell, order=2)
        area = fem.assemble_scalar(fem.form(fem.Constant(data.mesh, 1.0) * ufl.dx))
        arc = np.pi / 6
        assert area == pytest.approx(0.75 * np.pi, rel=arc**4 / 100)
        assert len(data.boundary_facets("ring/bottom")) == 12


# The runner


def test_worker_that_crashes_gives_a_failed_cell():
    worker = worker_that("os.abort()")
    record = worker.run(task("any", 1), 20.0)
    assert record["state"] == "failed" and "crash, exit code -6" in record["reason"]
    assert not worker.alive
    assert "no worker, exit code -6" in worker.run(task("any", 2), 20.0)["reason"]


def test_worker_that_hangs_is_ended_and_gives_a_failed_cell():
    worker = worker_that("time.sleep(100)")
    record = worker.run(task("any", 1), 0.5)
    assert record["state"] == "failed" and record["reason"] == "time limit of 0.5 s"
    assert not worker.alive


def test_worker_answers_one_task_after_the_other():
    worker = worker_that('print(json.dumps({"state": task["value"]}), flush=True)')
    assert [worker.run(task("any", v), 20.0)["state"] for v in (1, 2)] == ["1", "2"]
    worker.stop()
    assert not worker.alive


def test_cells_after_a_crash_get_a_new_worker(monkeypatch):
    def start(ranks):
        return worker_that(
            """
            if task["value"] == "2":
                os.abort()
            print(json.dumps({"state": "converged"}), flush=True)
            """
        )

    monkeypatch.setattr(atlas, "Worker", start)
    states = {}
    atlas.run_all(
        [task("any", v) for v in (1, 2, 3, 4)],
        lambda done, record: states.update({done["value"]: record["state"]}),
        workers=1,
        seconds=20.0,
    )
    assert states == {"1": "converged", "2": "failed", "3": "converged", "4": "converged"}


def test_result_that_depends_on_ranks_is_wrong():
    cells = {
        ("ranks", value, "default"): {
            **task("ranks", value),
            "state": "converged",
            "iterations": [4, 5],
            "numbers": [1.0, off],
        }
        for value, off in (("1", 2.0), ("2", 2.0 + 1e-12), ("3", 2.0 + 1e-3))
    }
    atlas.compare_ranks(cells)
    assert [cell["state"] for cell in cells.values()] == ["converged", "converged", "wrong"]


# The cells

# Remedies for rolling bodies are slow to fail; see test_floating.py and test_driven.py
QUICK = [n for n in REMEDIES if REMEDIES[n].scene not in ("falling_wheel", "rigid_tool")]
# Expected state of a cell, and a part of the reason
PINNED = {
    ("rigid_tool", "loose plate, 0.2", "default"): ("converged", ""),
    ("step_size", "5", "default"): ("converged", ""),
    ("corner_on_flat", "45 flat", "default"): ("converged", ""),
    ("corner_on_flat", "45 flat", "plain_frozen"): ("failed", "not converged in 30 iterations"),
    ("stiffness", "1e-06", "default"): ("converged", ""),
    ("mesh_ratio", "2:60", "default"): ("converged", ""),
    ("mesh_ratio", "60:2", "default"): ("converged", ""),
    ("edge_cover", "1e-10", "default"): ("converged", ""),
    ("slide_off", "2", "default"): ("converged", ""),
    ("slide_off", "2", "whole_facet"): ("wrong", "force"),
    ("island", "0.001", "default"): ("converged", ""),
    ("island", "0.001", "whole_facet"): ("wrong", "force"),
    ("corner_on_corner", "0.01", "default"): ("converged", ""),
    ("corner_on_corner", "0.01", "plain_frozen"): ("failed", "not converged in 30 iterations"),
    ("sandwich", "slave-master 0.0", "default"): ("converged", ""),
    ("three_bodies", "0.0", "default"): ("converged", ""),
    ("unit_of_length", "1e-06", "default"): ("converged", ""),
}


@pytest.fixture(scope="module")
def record_of():
    """The records of cells, each computed on first use by one worker."""
    worker = atlas.Worker()

    @functools.cache
    def record(*cell):
        nonlocal worker
        worker = worker if worker.alive else atlas.Worker()
        return worker.run(task(*cell), 60.0)

    yield record
    worker.stop()


@pytest.mark.parametrize("cell", PINNED, ids="-".join)
def test_cell_agrees_with_theory(record_of, cell):
    state, reason = PINNED[cell]
    record = record_of(*cell)
    assert record["state"] == state, record["reason"][:300]
    assert reason in record["reason"]


# Steps of a rolling wheel depend on the machine; tests/rigid has bodies that fall and do not roll.
@pytest.mark.parametrize("name", QUICK)
def test_scene_needs_its_remedy(record_of, name):
    remedy = REMEDIES[name]
    with_it, without_it = (record_of(remedy.scene, remedy.value, m) for m in (remedy.beside, name))
    assert with_it["state"] in ("converged", "cut"), with_it["reason"][:300]
    assert without_it["state"] in ("wrong", "failed")


def test_frozen_cone_needs_more_iterations(record_of):
    """With sliding friction the limit converges linearly, at the rate mu times the slope."""
    full, frozen = (
        record_of("slope", "0.4", method)["iterations"] for method in ("default", "frozen_cone")
    )
    assert max(full) <= 6
    assert min(frozen) >= 10


def test_iterations_do_not_depend_on_units_or_algorithm(record_of):
    cells = [("unit_of_stress", "1000000000000.0", m) for m in ("default", "saddle")]
    cells += [("unit_of_length", v, "default") for v in ("1e-06", "1000000.0")]
    iterations = [record_of(*cell)["iterations"] for cell in cells]
    assert iterations[1:] == iterations[:-1]


@pytest.mark.once
def test_command_writes_picture_and_tables(tmp_path):
    command = [sys.executable, "-m", "demos.studies.stability.atlas", "--problems", "three_bodies"]
    command += ["--methods", "default", "--results", tmp_path, "--workers", "1"]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True, timeout=120)
    kept = [json.loads(line) for line in (tmp_path / "cells.jsonl").read_text().splitlines()]
    assert len(kept) == 2
    assert "slit between two" in (tmp_path / "atlas.md").read_text()
    for name in ("atlas.png", "iterations.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
