# SPDX-License-Identifier: MIT
"""Input of motions: damping, velocities, steps; static solves; gained energy."""

from dataclasses import replace

import numpy as np
import pytest
from refusal import refused

from dolfinx import fem

import fenics_mortar as fm
from demos.studies.dynamics.scenes import RHO, E, bar, free_block, scene
from fenics_mortar.newton.loop import Iteration, NewtonReport
from fenics_mortar.path.report import DynamicsReport, Energies, TimeStep, Work
from fenics_mortar.utils import compat
from meshes.mapped_grids import Grid, sector


def moving(**options):
    made = free_block(cells=3)
    return made, made.dynamics("massless", **options)


def test_states_before_a_motion():
    """One of statics has no velocity; one of the motion may be restored before the first step."""
    made = free_block(cells=3)
    at_rest = made.problem.state()
    motion = made.dynamics("massless")
    with refused(fm.MortarError, "the state is one at rest, and this problem has a Dynamics"):
        made.problem.restore(at_rest)
    made.problem.restore(made.problem.state())
    assert motion.step(0.01).converged


def test_functions_of_a_run_are_functions():
    _, motion = moving()
    with refused(ValueError, "set_loads=0.1: expected a function of the time, or None"):
        motion.run(0.1, fm.SteppingOptions(step=0.1), 0.1)


def test_damping_that_would_have_no_effect_is_refused():
    """A ``Velocity`` in the residual is zero unless this object is passed."""
    made, other = free_block(cells=3), free_block(cells=3)
    with refused(ValueError, "contains a Velocity that would remain zero"):
        fm.Dynamics(made.problem, RHO)
    with refused(ValueError, "velocity has no effect"):
        fm.Dynamics(made.problem, RHO, velocity=fm.Velocity(made.u))
    with refused(ValueError, "that of another function"):
        fm.Dynamics(made.problem, RHO, velocity=other.velocity)
    fm.Dynamics(made.problem, RHO, velocity=made.velocity)


def test_density_and_energy_of_another_mesh_are_refused():
    made, other = free_block(cells=3), free_block(cells=3)
    given = {"velocity": made.velocity}
    with refused(ValueError, "density belongs to another mesh"):
        fm.Dynamics(made.problem, fem.Constant(other.data.mesh, 1.0), **given)
    with refused(ValueError, "the energy has an integral over cells of another mesh"):
        fm.Dynamics(made.problem, RHO, energy=other.energy, **given)


@pytest.mark.parametrize("kind", ["constant", "function"])
def test_a_density_that_changes_later_is_refused(kind):
    """Masses are assembled once: a step with another density would use the old ones."""
    made = free_block(cells=3)
    density = fem.Constant(made.data.mesh, RHO)
    if kind == "function":
        density = fem.Function(compat.scalar_space(made.data.mesh, 0, "DG"))
        density.x.array[:] = RHO
    motion = fm.Dynamics(made.problem, density, velocity=made.velocity)
    motion.step(0.01)
    if kind == "constant":
        density.value = 2.0 * RHO
    elif made.problem.equations.comm.rank == 0:
        density.x.array[:] = 2.0 * RHO
    with refused(fm.MortarError, "density has changed since Dynamics"):
        motion.step(0.01)
    with refused(fm.MortarError, "density has changed since Dynamics"):
        motion.run(1.0, fm.SteppingOptions(step=0.1))


def test_statics_of_bodies_in_motion_is_refused():
    """``solve`` and ``follow_path`` would use the inertia of the last step, without a velocity."""
    made, motion = moving()
    motion.step(0.01)
    u = made.u.x.array.copy()
    with refused(fm.MortarError, "Dynamics.step or Dynamics.run"):
        made.problem.solve()
    with refused(fm.MortarError, "Dynamics.step or Dynamics.run"):
        fm.follow_path(made.problem, lambda time: None, fm.SteppingOptions(step=0.5))
    with refused(fm.MortarError, r"variant\(\) does not support inertia"):
        made.problem.variant(sliding="small")
    assert np.array_equal(made.u.x.array, u)
    motion.step(0.01)


def test_invalid_velocities_and_time_steps_are_refused():
    _, motion = moving()
    for dt in (1e-300, 1e300, np.nan, None):
        with refused(ValueError, "dt="):
            motion.step(dt)
    motion.velocity.x.array[:2] = np.nan
    with refused(fm.MortarError, "velocity of Dynamics is not finite"):
        motion.step(0.01)
    with refused(ValueError, "a state of the problem"):
        motion.error(None, 0.01)
    with refused(ValueError, "a state of the motion"):
        motion.error(free_block(cells=3).problem.state(), 0.01)


def test_a_velocity_set_on_the_owned_dofs_counts_on_all_ranks():
    """Ghosts of the velocity are updated: damping and momentum use one velocity."""
    _, motion = moving()
    V = motion.velocity.function_space
    owned = V.dofmap.index_map.size_local * V.dofmap.index_map_bs
    motion.velocity.x.array[:owned] = 1.0
    motion.step(1e-3)
    assert np.allclose(motion.velocity.x.array, 1.0, atol=1e-8)


@pytest.mark.serial
@pytest.mark.parametrize("scheme", ["conserving", "generalized_alpha"])
def test_energy_added_by_contact_is_reported(scheme):
    """The trapezoidal rule multiplies the energy of an impact; the report contains a remark."""
    made, speed = bar(cells=20), np.sqrt(E / RHO)
    motion = made.dynamics(scheme, 1.0)
    made.set_velocity(motion, {"bar": (0.0, -0.01 * speed, 0.0)})
    record = motion.run(24.0 / speed, fm.SteppingOptions(step=made.cell / speed))
    gained = record.steps[-1].energies.total - record.start.total
    if scheme == "conserving":
        assert not record.remark()
        assert abs(gained) < 1e-9 * record.start.total
    else:
        assert gained > 0.5 * record.start.total
        assert record.contact_energy == pytest.approx(gained, rel=0.02)
        assert "contact pressures added" in str(record)


@pytest.mark.parametrize(("columns", "modulus", "resolved"), [(12, 100.0, 0), (48, 5.0, 1)])
def test_a_ring_too_coarse_for_its_contact_is_reported(columns, modulus, resolved):
    """The softer ring on finer facets has a wide region of contact, after a first node."""
    grid = Grid("ring", sector(columns, 2, radii=(0.6, 1.0)), closed=True)
    ground = fm.Plane((0.0, -1.001), (0.0, 1.0))
    made = scene([grid], [("ring/bottom", ground)], modulus=modulus)
    motion = made.dynamics("conserving")
    made.set_velocity(motion, {"ring": (0.0, -0.5, 0.0)})
    record = motion.run(0.2, fm.SteppingOptions(step=0.02))
    assert made.problem.contacts[0].active.any()
    said = "of the normal forces act on regions that the mesh does not resolve" in str(record)
    assert said == (not resolved)
    if said:
        assert "at the time 0." in record.remark() and "'ring/bottom'" in record.remark()


def test_energy_added_by_friction_is_reported():
    energies = Energies(1.0, 0.0, np.zeros(3))
    work = Work(bulk=0.0, supports=0.0, contact=-0.2, shear=-0.2)
    report = NewtonReport([Iteration(0.0, 0.0, 0.0, 1.0, 0, 0, {})])
    step = TimeStep(0.1, report, [], 0.0, work, energies)
    assert "friction added 0.2 of" in DynamicsReport(energies, [step]).remark()
    lost = replace(step, work=work._replace(contact=0.2, shear=0.2))
    assert not DynamicsReport(energies, [lost]).remark()


def test_rates_of_prescribed_motions_follow_from_these():
    """Rates do not oscillate from step to step after an inconsistent start or a jump."""
    made = free_block(cells=3, prescribed=[("block/top", 1, 0.0)])
    motion = made.dynamics("conserving")
    made.set_velocity(motion, {"block": (0.0, -1.0, 0.0)})  # of the prescribed nodes, too
    motion.run(0.16, fm.SteppingOptions(step=0.02))
    prescribed = made.problem.equations.bulk.prescribed
    rates = motion._inertia.rates
    assert np.abs(rates.velocity[prescribed]).max(initial=0.0) < 1e-12
    assert np.abs(rates.acceleration[prescribed]).max(initial=0.0) < 1e-10


def test_interruption_reverts_the_whole_step(monkeypatch):
    """Interruptions during the solve, and while the energies are computed after it."""
    made, motion = moving()
    made.set_velocity(motion, {"block": (0.0, -1.0, 0.0)})
    motion.step(0.01)
    u, time = made.u.x.array.copy(), motion.time

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("fenics_mortar.path.report.work_of", interrupted)
        with pytest.raises(KeyboardInterrupt):
            motion.step(0.01)
    assert np.array_equal(made.u.x.array, u)
    assert motion.time == time
    motion.step(0.01)
    assert np.allclose(made.u.x.array[1::2], -0.02)
