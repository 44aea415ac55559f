# SPDX-License-Identifier: MIT
"""Checkpoints: complete or absent, matching the problem or rejected, with all data of a run."""

import resource

from mpi4py import MPI

import numpy as np
import pytest
from refusal import refused
from scenes import TIGHT, internal, neo_hookean, nodal, pressed_blocks

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.utils.files import write_whole

comm = MPI.COMM_WORLD
MESH = {"n_upper": 6, "n_lower": 9, "layers_upper": 3, "layers_lower": 3}


# Whole files


def test_file_is_replaced_only_when_complete(tmp_path):
    path = tmp_path / "file.txt"
    path.write_text("old")

    def write(beside):
        beside.write_text("half")
        assert path.read_text() == "old" and beside.suffix == path.suffix
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_whole(path, write)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    write_whole(path, lambda beside: beside.write_text("new"))
    assert path.read_text() == "new" and list(tmp_path.iterdir()) == [path]


@pytest.mark.serial
def test_a_full_disk_leaves_the_last_checkpoint(tmp_path):
    """File sizes are limited to half of the required size."""
    scene = pressed_blocks(**MESH)
    scene.loads["push"].value[1] = -0.02
    scene.problem.solve()
    fm.save_state(scene.problem, tmp_path / "state")
    kept, u = (tmp_path / "state.npz").read_bytes(), scene.u.x.array.copy()
    scene.loads["push"].value[1] = -0.04
    scene.problem.solve()
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(kept) // 2, limit[1]))
    try:
        with pytest.raises(fm.MortarError, match=r"cannot write '.*state.npz'"):
            fm.save_state(scene.problem, tmp_path / "state")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert (tmp_path / "state.npz").read_bytes() == kept
    fm.load_state(scene.problem, tmp_path / "state")
    assert np.array_equal(scene.u.x.array, u)


@pytest.mark.serial
def test_a_full_disk_leaves_the_list_of_steps(tmp_path):
    scene = pressed_blocks(**MESH)
    with fm.ResultsWriter(tmp_path / "blocks", scene.problem) as results:
        for time in range(20):
            results.write(time)
        index = (tmp_path / "blocks.pvd").read_bytes()
        limit = resource.getrlimit(resource.RLIMIT_FSIZE)
        pieces = [_Nothing] * len(results._blocks)
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(index) // 2, limit[1]))
        try:
            with pytest.raises(fm.MortarError, match="cannot write"):
                results._write(20.0, pieces)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert (tmp_path / "blocks.pvd").read_bytes() == index


class _Nothing:
    """A part without data."""

    def write(self, path):
        path.write_text("")


# Of this problem


@pytest.mark.parametrize("function", [fm.save_state, fm.load_state])
def test_another_object_than_a_problem_is_refused(function):
    with pytest.raises(ValueError, match="problem=None: expected a ContactProblem"):
        function(None, "state")


def altered(shared_path, change):
    """A checkpoint with some arrays changed, and a problem like the one that wrote it."""
    fm.save_state(pressed_blocks(**MESH).problem, shared_path / "state")
    if comm.rank == 0:
        with np.load(shared_path / "state.npz") as arrays:
            data = dict(arrays)
        change(data)
        np.savez(shared_path / "state.npz", **data)
    comm.barrier()
    return pressed_blocks(**MESH).problem


@pytest.mark.parametrize(
    "name", ["u", "nodes", "x", "cells", "pairs", "places", "z0", "active0", "c_n0", "offset0"]
)
@pytest.mark.parametrize("what", ["missing", "short"])
def test_an_array_that_is_missing_or_short_is_refused_by_all_ranks(shared_path, name, what):
    def change(data):
        array = data.pop(name)
        if what == "short":
            data[name] = array.ravel()[: array.size // 2] if array.ndim else np.empty(0)

    if name == "places" and what == "short":
        return  # there are no obstacles
    problem = altered(shared_path, change)
    u = problem.equations.bulk.u.x.array.copy()
    with pytest.raises(fm.MortarError, match=f"'{name}'" if what == "missing" else "other|missing"):
        fm.load_state(problem, shared_path / "state")
    assert np.array_equal(problem.equations.bulk.u.x.array, u)


def test_numbers_that_are_not_finite_are_refused(shared_path):
    def change(data):
        data["z0"][0] = np.nan

    with pytest.raises(fm.MortarError, match="'z0' is not finite"):
        fm.load_state(altered(shared_path, change), shared_path / "state")


@pytest.mark.parametrize(
    "mesh, message",
    [
        ({"width_upper": 1.01}, "away from this position"),
        ({"height_lower": 1.01}, "away from this position"),
    ],
)
def test_mesh_with_other_node_positions_is_refused(shared_path, mesh, message):
    fm.save_state(pressed_blocks(**MESH).problem, shared_path / "state")
    with pytest.raises(fm.MortarError, match=message):
        fm.load_state(pressed_blocks(**MESH, **mesh).problem, shared_path / "state")


def test_other_connectivity_is_refused(shared_path):
    def change(data):
        data["cells"] = data["cells"][::-1]

    with pytest.raises(fm.MortarError, match="its cells have other nodes"):
        fm.load_state(altered(shared_path, change), shared_path / "state")


# All that a run depends on


def test_weight_of_gaps_and_offsets_are_kept(shared_path):
    scene = pressed_blocks(**MESH)
    scene.contact.c_n = 1e-3  # as after a cycle of sets
    scene.contact.offset = np.linspace(0.0, 0.01, scene.contact.slave.num_nodes)
    scene.loads["push"].value[1] = -0.02
    scene.problem.solve()
    fm.save_state(scene.problem, shared_path / "state")
    again = pressed_blocks(**MESH)
    fm.load_state(again.problem, shared_path / "state")
    assert again.contact.c_n == 1e-3
    assert np.array_equal(again.contact.offset, scene.contact.offset)
    for one in (scene, again):
        one.loads["push"].value[:] = (0.02, -0.04)
    residuals = [one.problem.solve().residuals for one in (scene, again)]
    assert residuals[0] == pytest.approx(residuals[1], rel=1e-6)
    u, w = nodal(scene.problem), nodal(again.problem)
    assert np.abs(u - w).max() < 1e-14


def on_a_circle(x):
    """A block fixed at its top, with small sliding on a circle that was moved before the set-up."""
    blocks = pressed_blocks(**MESH)
    u = fem.Function(blocks.u.function_space)
    circle = fm.Circle((1.1, -1.0), 2.02)
    circle.move(x=x)
    pair = fm.ContactPair(blocks.data, "upper/bottom", circle, sliding="small")
    names = ("upper/top", "lower/bottom")
    bcs = [fm.dirichlet(u.function_space, blocks.data, name, (0.0, 0.0)) for name in names]
    residual = internal(u, neo_hookean(u, 100.0, 0.3))
    options = {"bcs": bcs, "petsc_options_prefix": "test_", "newton": TIGHT}
    return fm.ContactProblem(residual, u, [pair], **options), circle


def test_small_sliding_keeps_its_reference_operators(shared_path):
    """Operators for the position of the obstacle at the set-up of the first run."""
    problem, circle = on_a_circle(0.0)
    problem.solve()
    fm.save_state(problem, shared_path / "state")
    again, moved = on_a_circle(0.3)
    fm.load_state(again, shared_path / "state")
    for obstacle in (circle, moved):
        obstacle.move(x=0.1, y=0.01)
    problem.solve()
    again.solve()
    z, w = problem.equations.contacts[0].z, again.equations.contacts[0].z
    assert np.abs(z).max() > 0.1 and np.abs(z - w).max() < 1e-11 * np.abs(z).max()  # Newton's


# Of this motion


def in_motion(density=1.0, **options):
    """Blocks with a Dynamics, after one step unless ``density`` is ``None``: then at rest."""
    problem = pressed_blocks(**MESH).problem
    if density is None:
        problem.solve()
    else:
        fm.Dynamics(problem, density, **options).step(0.01)
    return problem


@pytest.mark.each
@pytest.mark.parametrize(
    "theirs, ours, message",
    [
        ({}, {"density": None}, "scheme='conserving', rho_inf=1, .* statics: set up the same Dyn"),
        ({"density": None}, {}, "state at rest, and .* rho_inf=1: use load_state before Dynamics"),
        ({}, {"scheme": "massless"}, "with scheme='conserving', .* has scheme='massless', rho_inf"),
        (
            {"scheme": "generalized_alpha"},
            {"scheme": "generalized_alpha", "rho_inf": 0.5},
            "rho_inf=0.8, and this .*rho_inf=0.5: set up a Dynamics with the scheme of the file",
        ),
        ({}, {"density": 2.0}, "bodies with other masses: the largest one of a node is .*, here"),
    ],
    ids=["statics", "at rest", "scheme", "radius", "density"],
)
def test_a_state_of_another_motion_is_refused_with_what_to_do(shared_path, theirs, ours, message):
    fm.save_state(in_motion(**theirs), shared_path / "state")
    problem = in_motion(**ours)
    u = problem.equations.bulk.u.x.array.copy()
    with refused(fm.MortarError, message):
        fm.load_state(problem, shared_path / "state")
    assert np.array_equal(problem.equations.bulk.u.x.array, u)


def test_a_state_of_a_motion_is_not_restored_in_statics():
    moving, at_rest = in_motion(), in_motion(None)
    u = at_rest.equations.bulk.u.x.array.copy()
    with refused(fm.MortarError, "one of a motion, .* statics: set up the same Dynamics"):
        at_rest.restore(moving.state())
    assert np.array_equal(at_rest.equations.bulk.u.x.array, u)


def test_a_motion_starts_from_a_state_at_rest_that_is_loaded_before(shared_path):
    problem = in_motion(None)
    fm.save_state(problem, shared_path / "state")
    again = pressed_blocks(**MESH).problem
    fm.load_state(again, shared_path / "state")
    motions = [fm.Dynamics(one, 1.0) for one in (problem, again)]
    for motion in motions:
        motion.step(0.01)
    u, w = (nodal(motion.problem) for motion in motions)
    assert np.abs(u - w).max() < 1e-14
    fm.save_state(problem, shared_path / "moving")
    fm.load_state(again, shared_path / "moving")
    assert motions[1].time == 0.01


def stretched():
    """A motion of blocks from a velocity that stretches the lower one."""
    scene = pressed_blocks(**MESH)
    motion = fm.Dynamics(scene.problem, 1.0, scheme="massless")
    bodies, tags = scene.data.bodies, scene.data.cell_tags
    motion.velocity.interpolate(
        lambda x: np.stack([0 * x[0], 0.1 * x[1]]), tags.find(bodies["lower"])
    )
    return motion


def test_sizes_of_adaptive_time_steps_are_those_of_the_uninterrupted_motion(shared_path):
    """Their error is measured against the largest velocity so far, which may be in the past."""
    motion, again = stretched(), stretched()
    options = fm.SteppingOptions(step=0.01, smallest=1e-4, largest=0.05)
    motion.run(0.06, options, tolerance=4e-3)
    fm.save_state(motion.problem, shared_path / "state")
    fm.load_state(again.problem, shared_path / "state")
    records = [one.run(0.12, options, tolerance=4e-3).steps for one in (motion, again)]
    sizes, errors = ([[getattr(s, n) for s in r] for r in records] for n in ("size", "error"))
    assert len(set(sizes[0])) > 2 and sizes[0] == pytest.approx(sizes[1], rel=1e-8)
    assert errors[0] == pytest.approx(errors[1], rel=1e-6)
