# SPDX-License-Identifier: MIT
"""Energy and momentum of bodies with nonlinear stresses over many steps; advice of the report."""

from dataclasses import replace

import numpy as np
import pytest

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import read_mesh
from demos.studies.dynamics.scenes import RHO, E, free_block, rings, scene
from fenics_mortar.energies import lame
from fenics_mortar.laws import Cohesive, MixedCohesive, SoftLayer
from fenics_mortar.newton.loop import Iteration, NewtonReport
from fenics_mortar.path.report import (
    DynamicsReport,
    Energies,
    TimeStep,
    Work,
    forces_of,
)
from meshes.mapped_grids import Grid, block, build

C = np.sqrt(E / RHO)


def between_blocks(cells=3, **options):
    """A block that flies to and fro between two blocks with fixed ends."""
    shapes = {"lower": (-0.8, -1.6), "upper": (-0.8, 0.6)}
    grids = [Grid("block", block(cells, cells, width=1.0, height=1.0, corner=(-0.5, -0.5)))]
    grids += [
        Grid(name, block(cells + 1, cells, width=1.6, height=1.0, corner=corner))
        for name, corner in shapes.items()
    ]
    sides = [("block/bottom", "lower/top"), ("block/top", "upper/bottom")]
    ends = ("lower/bottom", "upper/top")
    return scene(grids, sides, prescribed=[(e, c, 0.0) for e in ends for c in (0, 1)], **options)


def between_planes(count, cells=3, gap=0.01, gravity=0.0, speed=0.0):
    """A stack of blocks between two planes, without friction; the second or only one moves down.

    St. Venant-Kirchhoff; the residual has no velocity.

    Returns:
        The motion, and the potential energy of the weight, a form.
    """
    grids = [
        Grid(f"{i}", block(cells + i % 2, cells, width=1.0, height=1.0, corner=(0, i * (1 + gap))))
        for i in range(count)
    ]
    data = read_mesh(lambda: build(grids))
    V = fm.vector_space(data.mesh, 1)
    u, v, dx = fem.Function(V), ufl.TestFunction(V), ufl.dx(metadata={"quadrature_degree": 4})
    energy = fm.energies.st_venant_kirchhoff(u, *lame(E, 0.3)) * dx
    pull = fem.Constant(data.mesh, RHO * gravity)
    weight = pull * u[1] * dx
    sides = [(f"{i}/top", f"{i + 1}/bottom") for i in range(count - 1)]
    sides += [("0/bottom", fm.Plane((0.0, -gap), (0.0, 1.0)))]
    sides += [(f"{count - 1}/top", fm.Plane((0.0, count * (1 + gap)), (0.0, -1.0)))]
    pairs = [fm.ContactPair(data, *pair) for pair in sides]
    residual = ufl.derivative(energy, u, v) + pull * v[1] * dx
    problem = fm.ContactProblem(residual, u, pairs, petsc_options_prefix="planes_")
    motion = fm.Dynamics(problem, RHO, energy=energy)
    low, high = (0.0, 1.0) if count == 1 else (1.0 + gap / 2, 2.0 + gap)
    motion.velocity.interpolate(
        lambda x: np.stack([0.0 * x[0], -speed * C * ((x[1] >= low) & (x[1] <= high))])
    )
    return motion, fem.form(weight)


@pytest.mark.serial
def test_impacts_of_three_st_venant_kirchhoff_blocks_conserve_energy():
    motion, _ = between_planes(3, speed=0.1)
    start, found, touched = motion.energies(), [], set()
    for _ in range(40):
        motion.step(1.0 / 3.0 / C)
        found.append(motion.energies().total / start.total - 1.0)
        pressed = [c.pressure.max(initial=0.0) > 0.0 for c in motion.problem.contacts]
        touched |= set(np.flatnonzero(pressed))
    assert len(touched) == 4
    assert np.abs(found).max() < 1e-3
    assert motion.energies().momentum[0] == pytest.approx(start.momentum[0], abs=1e-10)


@pytest.mark.serial
def test_a_step_that_ends_above_the_energy_says_so_and_names_one_that_does_not():
    """Two blocks in steps of 2.7 times that of a wave from end to end."""
    motion, _ = between_planes(2, speed=0.1)
    energy, dt, said = motion.energies().total, 8.0 / 3.0 / C, []
    for anew in (False, True):
        worst = 0.0
        for _ in range(8):
            note = "".join(motion.step(dt).notes[:1])
            error = abs(motion.energies().total / energy - 1.0)
            assert note.startswith("the time steps added") == (error > max(worst, 1e-3))
            worst = max(error, worst)
            if "take steps of" in note:  # the motion goes on with them, or begins with them
                dt = float(note.split("steps of ")[-1].split(",")[0])
                said.append(anew)
        motion, _ = between_planes(2, speed=0.1)
    assert said == [False] and error < 1e-3


@pytest.mark.serial
def test_a_step_is_not_blamed_for_errors_of_a_run_before():
    motion, _ = between_planes(2, speed=0.1)
    dt = 8.0 / 3.0 / C
    record = motion.run(2.0 * dt, fm.SteppingOptions(step=dt))
    assert "the time steps added" in record.remark()
    notes = motion.step(0.01 * dt).notes
    assert not any("of the largest kinetic energy" in note for note in notes)


@pytest.mark.serial
def test_pressures_return_energy_by_the_motion_they_change():
    """A body that touches a plane and does not deform: its normal velocity may change."""
    motion, _ = between_planes(1, speed=0.1)
    while not motion.problem.contacts[0].pressure.max(initial=0.0):
        motion.step(0.8 / 3.0 / C)
    inertia, corrections = motion._inertia, motion._corrections
    bulk, forces = motion.problem.equations.bulk, forces_of(motion.problem)
    pressures = corrections._pressure_impulse((forces, forces), 0.1)
    for normal in (1.0, 0.0):
        velocity = np.tile([1.0, normal], len(bulk.values) // 2)
        part = corrections._free_part(velocity, pressures)
        assert inertia.product(part, velocity) == pytest.approx(normal, abs=1e-9)  # of mass 1
        assert corrections._free_part(velocity, None) == pytest.approx(0.0 * velocity, abs=1e-9)


@pytest.mark.serial
def test_energy_lost_by_unbalanced_nodes_at_the_start_is_returned():
    """The weight of nodes without mass stretches their cells in the first step."""
    motion, weight = between_planes(1, gap=0.1, gravity=2.0, speed=0.03)
    start, lost = motion.energies().total, []
    for _ in range(10):
        motion.step(0.8 / 3.0 / C)
        energy = motion.energies().total + fem.assemble_scalar(weight)
        lost.append(1.0 - energy / start)
        assert motion.energy_deficit == pytest.approx(start - energy, abs=1e-9)
    assert lost[0] > 1e-3
    assert abs(lost[-1]) < 1e-6


@pytest.mark.serial
@pytest.mark.parametrize("speed, step, number", [(0.03, 0.8, 150), (0.1, 1.5, 40)])
def test_impacts_of_neo_hookean_blocks_conserve_energy(speed, step, number):
    """Without the work of the nonlinear stress the energy is off by 1 % after a few impacts."""
    made = between_blocks()
    motion = made.dynamics("conserving")
    made.set_velocity(motion, {"block": (0.0, -speed * C, 0.0)})
    dt = step * made.cell / C
    record = motion.run(number * dt, fm.SteppingOptions(step=dt))
    energy = np.array([s.energies.total for s in record.steps]) / record.start.total
    contacts = [s.report.iterations[-1].num_active > 0 for s in record.steps]
    assert sum(contacts) > 15
    assert np.abs(energy - 1.0).max() < 1e-3
    assert record.remark() == ""


@pytest.mark.serial
def test_a_spinning_neo_hookean_block_conserves_everything():
    """Three radians per time and vibrations; Lobatto's rule has an error of sixth order."""
    made = free_block(cells=2)
    motion = made.dynamics("conserving")
    made.set_velocity(motion, {"block": (0.5, 0.2, 3.0)})
    momentum, energy, found = motion.momentum(), motion.energies().total, []
    for _ in range(30):
        motion.step(0.02)
        found.append(motion.energies().total / energy - 1.0)
    assert np.abs(found).max() < 1e-8
    assert motion.momentum() == pytest.approx(momentum, abs=1e-10)


@pytest.mark.once
def test_a_central_force_on_a_block_keeps_the_angular_momentum():
    """Energy is returned by internal forces with a resultant, since the load is nonlinear, too."""
    grid = Grid("b", block(3, 3, width=1.0, height=1.0, corner=(2.0, 0.0)))
    data = read_mesh(lambda: build([grid]))
    V = fm.vector_space(data.mesh, 1)
    u, v, dx = fem.Function(V), ufl.TestFunction(V), ufl.dx(metadata={"quadrature_degree": 4})
    x = ufl.SpatialCoordinate(data.mesh) + u
    energy = (
        fm.energies.st_venant_kirchhoff(u, *lame(E, 0.3)) * dx + 0.05 * ufl.inner(x, x) ** 2 * dx
    )
    far = fm.ContactPair(data, "b/bottom", fm.Plane((0.0, -50.0), (0.0, 1.0)))
    residual = ufl.derivative(energy, u, v)
    problem = fm.ContactProblem(residual, u, [far], petsc_options_prefix="central_")
    motion = fm.Dynamics(problem, RHO, energy=energy)
    motion.velocity.interpolate(lambda x: np.stack([0.3 * x[0], 0.0 * x[0] + 1.0]))
    before = motion.momentum()[2]
    for _ in range(12):
        motion.step(0.05)
    assert abs(motion.momentum()[2] - before) < 1e-11 * abs(before)


@pytest.mark.usefixtures("several_ranks")
def test_impacts_conserve_energy_and_momentum_on_several_ranks():
    made = rings(12, 2)
    motion = made.dynamics("conserving")
    made.set_velocity(motion, {"left": (1.0, 0.0, 0.0)})
    momentum, energy, touched = motion.momentum(), motion.energies().total, 0
    for _ in range(20):
        motion.step(0.03)
        touched += made.problem.contacts[0].pressure.max(initial=0.0) > 0.0
    assert touched > 0
    assert motion.momentum() == pytest.approx(momentum, abs=1e-9)
    assert motion.energies().total == pytest.approx(energy, rel=1e-3)


def test_damping_is_not_returned():
    """The velocity in the residual is a mean one where the internal forces are compared."""
    found = []
    for scheme in ("conserving", "massless"):
        made = free_block(cells=2, damping=2.0)
        motion = made.dynamics(scheme)
        made.set_velocity(motion, {"block": (0.0, 0.0, 2.0)})
        energy = motion.energies().kinetic
        for _ in range(10):
            motion.step(0.02)
        found.append(motion.energies().total / energy)
    assert found[0] == pytest.approx(np.exp(-2 * 2.0 * 0.2), rel=0.05)
    assert found[0] == pytest.approx(found[1], rel=2e-3)


def test_rates_of_deformation_have_no_momentum():
    made = rings(8, 2)
    motion = made.dynamics("conserving")
    motion.velocity.interpolate(lambda x: np.stack([x[1] ** 2, np.sin(3 * x[0])]))
    inertia = motion._inertia
    deformation, v = motion._corrections.deformation, motion.velocity.x.array.copy()
    motion._corrections.find_rigid()
    left = deformation(v)
    assert inertia.momentum(motion._positions(), left) == pytest.approx(np.zeros(3), abs=1e-11)
    assert deformation(left) == pytest.approx(left, abs=1e-12)
    assert inertia.product(left, v) == pytest.approx(inertia.product(left, left))
    made.set_velocity(motion, {"left": (1.0, 2.0, 3.0), "right": (-1.0, 0.0, 0.5)})
    assert deformation(motion.velocity.x.array) == pytest.approx(np.zeros(v.size), abs=1e-11)


# Advice


def record_of(scheme, *, pressure=0.0, deficit=0.0, size=0.4, rho_inf=1.0):
    energies = Energies(1.0, 0.0, np.zeros(3))
    work = Work(bulk=0.0, supports=0.0, contact=-pressure)
    report = NewtonReport([Iteration(0.0, 0.0, 0.0, 1.0, 0, 0, {})])
    step = TimeStep(0.4, report, [], 0.0, work, energies, size, deficit)
    steps = [step, replace(step, work=work._replace(contact=0.0), deficit=0.0)]
    return DynamicsReport(energies, steps, scheme=scheme, rho_inf=rho_inf)


def test_the_report_never_advises_what_is_in_use():
    """Pressures added energy that was returned, or not: then a step is named that suffices."""
    assert record_of("conserving", pressure=0.5).remark() == ""
    remark = record_of("conserving", deficit=-0.004).remark()
    assert "the time steps added 0.004 of" in remark and "scheme" not in remark
    assert "steps of 0.18, for an error of 0.001" in remark  # 0.9 of half of 0.4
    assert "took 0.004" in record_of("conserving", deficit=0.004).remark()
    record = record_of("conserving", deficit=0.004)
    record.steps[0] = replace(record.steps[0], work=Work(-0.004, 0.0, 0.0))
    assert "take a finer contact surface" in record.remark()  # smaller steps would not help
    remark = record_of("massless", pressure=0.4).remark()
    assert "pressures added 0.4" in remark and "scheme='conserving', or steps of 0.018," in remark
    remark = record_of("generalized_alpha", pressure=0.4, rho_inf=0.0).remark()
    assert "scheme='conserving'" in remark and "rho_inf" not in remark and "steps of" not in remark
    assert "a smaller rho_inf" in record_of("generalized_alpha", pressure=0.4).remark()


@pytest.mark.once
@pytest.mark.serial
def test_the_step_that_the_report_names_suffices():
    """Steps of four times of a wave through a cell."""
    found, dt = [], 4.0 / 3.0 / C
    for _ in range(2):
        made = between_blocks()
        motion = made.dynamics("conserving")
        made.set_velocity(motion, {"block": (0.0, -0.3 * C, 0.0)})
        record = motion.run(1.6, fm.SteppingOptions(step=dt))
        found.append(max(abs(s.deficit) for s in record.steps) / record.start.kinetic)
        remark = record.remark()
        if "steps of" in remark:
            dt = float(remark.split("steps of ")[1].split(",")[0])
    assert found[-1] < 1e-3 and not remark


@pytest.mark.serial
@pytest.mark.parametrize("law", [Cohesive(2.0, 0.05), MixedCohesive(200.0, 2.0, 0.05)], ids=repr)
def test_a_bond_between_two_flying_blocks_takes_its_energy_and_no_momentum(law):
    """It breaks: strength * reach / 2 per length is lost, and is not returned."""
    grids = [
        Grid(name, block(columns, 3, width=1.0, height=1.0, corner=(0.0, y)))
        for name, columns, y in (("lower", 3, 0.0), ("upper", 2, 1.0))
    ]
    made = scene(grids, [("upper/bottom", "lower/top")], law=law)
    motion = made.dynamics("conserving")
    made.set_velocity(motion, {"upper": (0.0, 0.4, 0.0), "lower": (0.0, -0.4, 0.0)})
    record = motion.run(0.3, fm.SteppingOptions(step=0.01))
    last = record.steps[-1]
    assert record.start.kinetic == pytest.approx(0.16, rel=1e-12)
    assert record.start.total - last.energies.total == pytest.approx(0.05, rel=0.02)
    assert sum(step.work.layers for step in record.steps) == pytest.approx(0.05, rel=0.02)
    assert np.abs(last.energies.momentum).max() < 1e-12
    assert record.remark() == ""


@pytest.mark.serial
@pytest.mark.parametrize("scheme", ["conserving", "massless"])
def test_a_soft_layer_stores_the_kinetic_energy_of_a_block(scheme):
    """rho v^2 / 2 = k o^2 / 2 at the largest overlap; then the layer returns it."""
    k, speed = 50.0, 0.2
    grid = Grid("block", block(2, 3, width=1.0, height=1.0))
    pair = ("block/bottom", fm.Plane((0.0, 0.0), (0.0, 1.0)))
    made = scene([grid], [pair], law=SoftLayer(k, 1.0), modulus=2e3)
    motion, overlaps = made.dynamics(scheme), []
    made.set_velocity(motion, {"block": (0.0, -speed, 0.0)})
    contact = made.problem.contacts[0]
    record = motion.run(
        0.6, fm.SteppingOptions(step=0.01), on_step=lambda *_: overlaps.append(-contact.gap.min())
    )
    assert max(overlaps) == pytest.approx(speed * np.sqrt(RHO / k), rel=0.01)
    assert min(step.energies.total for step in record.steps) < 0.03 * record.start.total
    assert record.steps[-1].energies.total == pytest.approx(record.start.total, rel=2e-3)
    assert record.remark() == ""


@pytest.mark.serial
def test_energy_in_a_nonlinear_layer_is_exact_in_long_steps():
    """Of p = k o^2: k o^3 / 3 per length, in ten steps from the first touch to the return."""
    k, speed = 2e4, 0.2
    grid = Grid("block", block(2, 3, width=1.0, height=1.0))
    pair = ("block/bottom", fm.Plane((0.0, 0.0), (0.0, 1.0)))
    made = scene([grid], [pair], law=SoftLayer(k, 2.0), modulus=2e3)
    motion, totals = made.dynamics("conserving"), []
    made.set_velocity(motion, {"block": (0.0, -speed, 0.0)})
    contact = made.problem.equations.contacts[0]

    def note(*_):
        overlap = np.maximum(-contact.now.mean_gap, 0.0)
        stored = contact.operators.weight @ (k * overlap**3 / 3.0)
        totals.append(motion.energies().total + stored)

    record = motion.run(0.3, fm.SteppingOptions(step=0.03), on_step=note)
    assert min(step.energies.total for step in record.steps) < 0.15 * record.start.total
    assert totals == pytest.approx([record.start.total] * len(totals), rel=2e-3)
