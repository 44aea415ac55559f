# SPDX-License-Identifier: MIT
"""Friction over steps: loops, work, rejected steps, ranks."""

from operator import attrgetter

from mpi4py import MPI

import numpy as np
import pytest
from friction_scenes import MEASURES, MESH, NU, E, blocks, drive
from scenes import internal, neo_hookean, nodal, pressed_blocks, read

from dolfinx import fem

import fenics_mortar as fm
from meshes import indenter_on_block

WORKS = "contact", "shear"


@pytest.mark.once
@pytest.mark.serial
def test_reversed_load_closes_the_hysteresis_loop():
    """Forth and back twice: the second loop equals the first, and its area is the friction work.

    In steps in which sliding begins or turns back, the laws dissipate their limit times the slip.
    """
    scene = blocks(fm.Coulomb(0.3))
    corners, top = [0.0, 1.0, 3.0, 5.0, 7.0, 9.0, 11.0], [0.0, 0.0, *[0.08, -0.08] * 2, 0.08]

    def set_loads(time):
        scene.loads["push"].value[:] = (np.interp(time, corners, top), -0.05)

    def path(step, start, stop):
        options = fm.SteppingOptions(step=step)
        return fm.follow_path(scene.problem, set_loads, options, start=start, stop=stop)

    def loops(step, stop):
        scene.problem.restore(begun)
        return path(step, 3.0, stop)

    path(1.0, 0.0, 3.0)
    begun = scene.problem.state()
    coarse, fine = loops(1.0, 11.0), loops(0.25, 7.0)
    work = np.array([step.work.friction for step in coarse.steps])
    assert coarse.num_cuts == 0 and (work > -1e-12).all()
    np.testing.assert_allclose(work[4:], work[:4], rtol=1e-3, atol=1e-3 * work.max())
    assert sum(step.work.bulk for step in fine.steps) == pytest.approx(0.0, abs=1e-6)
    supports = sum(step.work.supports for step in fine.steps)
    assert fine.friction_work == pytest.approx(supports, rel=0.05)
    assert 0.5 * coarse.friction_work == pytest.approx(fine.friction_work, rel=5e-3)


def ironing(cells: int):
    """A round tool pressed into a block and drawn along it over four facets; the path's record."""
    data = read(
        indenter_on_block.build,
        n_block=36 * cells,
        layers_block=10 * cells,
        n_indenter=8 * cells,
        layers_indenter=5 * cells,
    )
    V = fm.vector_space(data.mesh, 1)
    u, tool = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [
        fm.dirichlet(V, data, "block/bottom", np.zeros(2)),
        fm.dirichlet(V, data, "indenter/top", tool),
    ]
    pair = fm.ContactPair(data, "block/top", "indenter/arc", law=fm.Coulomb(0.3))
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)), u, [pair], bcs=bcs, petsc_options_prefix="test_"
    )

    def set_loads(time):
        tool.value[:] = (max(time - 1.0, 0.0), -0.5 * min(time, 1.0))

    fm.follow_path(problem, set_loads, fm.SteppingOptions(step=0.25), stop=1.5)
    return fm.follow_path(problem, set_loads, fm.SteppingOptions(step=0.25), start=1.5, stop=2.5)


@pytest.mark.once
@pytest.mark.serial
def test_ironing_in_long_steps_balances_its_work():
    """The work of contact is that of friction up to a term that vanishes with the facet length."""
    defects = []
    for cells in (1, 2):
        path = ironing(cells)
        assert path.num_cuts == 0
        assert np.median([step.report.num_iterations for step in path.steps]) <= 5 + cells
        contact, friction = (sum(getattr(s.work, k) for s in path.steps) for k in WORKS)
        assert friction > 0.0
        defects.append(abs(contact / friction - 1.0))
    assert defects[0] < 0.02
    assert defects[1] < 0.6 * defects[0]  # first order would be a half


def test_slip_is_measured_from_the_position_after_a_rigid_move():
    scene = blocks(fm.Coulomb(0.3))
    drive(scene, (0.0, -0.05), (0.03, -0.05))
    assert np.abs(scene.contact.slip).max() > 1e-4
    scene.problem._solver._accept_moved()
    assert np.abs(scene.contact.slip).max() < 1e-14


@pytest.mark.parametrize("pair", MEASURES)
def test_rejected_step_leaves_the_state_unchanged(shared_path, pair):
    """After restoring from memory and from a file, a step has the same result.

    Bit for bit on one rank; on several ranks the summation order of MUMPS varies.
    """
    last_bits = 0.0 if MPI.COMM_WORLD.size == 1 else 1e-12
    scene = blocks(fm.Coulomb(0.3), pair=pair)
    drive(scene, (0.0, -0.05), (0.03, -0.05))
    start = scene.problem.state()
    fm.save_state(scene.problem, str(shared_path / "state.npz"))
    drive(scene, (0.08, -0.05))
    z, u = scene.contact.z.copy(), nodal(scene.problem)
    drive(scene, (-0.05, -0.04))
    scene.problem.restore(start)
    drive(scene, (0.08, -0.05))
    for now, before in ((scene.contact.z, z), (nodal(scene.problem), u)):
        assert np.abs(now - before).max() <= last_bits * np.abs(before).max()
    other = blocks(fm.Coulomb(0.3), pair=pair)
    fm.load_state(other.problem, str(shared_path / "state.npz"))
    drive(other, (0.08, -0.05))
    assert np.abs(other.contact.z - z).max() < 1e-12 * np.abs(z).max()


@pytest.mark.parametrize("pair", MEASURES)
def test_ranks_agree(pair):
    """Comparison with the path on one rank: equal stick and slip."""
    path = (0.0, -0.05), (0.03, -0.05), (0.12, -0.05)
    law = fm.Coulomb(0.3)
    mine = pressed_blocks(pair={"law": law, **pair}, comm=MPI.COMM_SELF, **MESH)
    ours = blocks(law, pair=pair)
    drive(mine, *path[:2])
    drive(ours, *path[:2])
    assert np.array_equal(mine.contact.sticking, ours.contact.sticking)
    assert 0 < ours.contact.sticking.sum() < ours.contact.active.sum()
    first, second = drive(mine, path[2])[0], drive(ours, path[2])[0]
    assert first.num_iterations == second.num_iterations
    assert np.array_equal(mine.contact.branch, ours.contact.branch)
    for quantity in map(attrgetter, ("z", "slip", "now.friction_work")):
        one, all_ = (np.asarray(quantity(scene.contact)) for scene in (mine, ours))
        assert np.abs(all_ - one).max() < 1e-11 * np.abs(one).max()
