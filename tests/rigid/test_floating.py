# SPDX-License-Identifier: MIT
"""Bodies supported by contact alone: they are moved until contact stops them; no springs remain."""

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
import supported
from scenes import internal, neo_hookean, read, rectangles
from scipy.optimize import minimize
from small_scenes import pushed_block, small_blocks

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.obstacles.rigid_motion import RIGID
from fenics_mortar.rigid.complementarity import nearest_below
from fenics_mortar.rigid.floating import _beginnings, unsupported
from meshes.mapped_grids import Grid, block, mesh

comm = MPI.COMM_WORLD


@pytest.mark.once
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
@pytest.mark.parametrize("gap", [0.1, 3.0])
def test_springs_do_not_affect_a_body_free_to_slide(gap, algorithm):
    """No force drives it sideways: for any initial gap the pressure is that without a gap."""
    falling, lying = (pushed_block(gap=g, algorithm=algorithm) for g in (gap, 0.0))
    report = falling.solve()
    lying.solve()
    pressure, exact = (problem.equations.contacts[0].pressure for problem in (falling, lying))
    # Rounding, of about 1e-14 and, where the loose body tilts, 2e-12.
    assert np.abs(pressure - exact).max() < 1e-12 * exact.max()
    assert np.abs(pressure - pressure[::-1]).max() < 1e-10 * exact.max()
    assert falling.equations.contacts[0].total_force == pytest.approx((0.0, 1.0), abs=1e-9)
    assert report.num_iterations <= 5
    assert any("spring" in note for note in report.notes)


def test_a_body_that_others_carry_along_is_not_said_to_slide_in_a_direction_of_rounding():
    data = small_blocks().data
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    dx = ufl.Measure("dx", domain=data.mesh, subdomain_data=data.cell_tags)
    upper, lower = (dx(data.bodies[name]) for name in ("upper", "lower"))
    weight = 0.1 * v[1] * (upper + lower) - 0.03 * v[0] * upper
    floor = fm.Plane((0.0, 0.0), (0.0, 1.0))
    pairs = [
        fm.ContactPair(data, "upper/bottom", "lower/top", law=fm.Coulomb(0.9)),
        fm.ContactPair(data, "lower/bottom", floor, law=fm.Coulomb(0.5)),
    ]
    residual = internal(u, neo_hookean(u, 100.0, 0.3)) + weight
    problem = fm.ContactProblem(residual, u, pairs, petsc_options_prefix="carried_")
    problem.solve()
    floating, (bulk, _) = problem.equations.floating, problem.equations.evaluate_forces()
    labels = {body.label: floating.name_of(body.label) for body in floating.bodies}
    begins = _beginnings(floating, set(labels), bulk, may_tip=False)
    told = {name: begins.get(label, "") for label, name in labels.items()}
    assert told["body 'lower'"] == "" and "to move along (1, " in told["body 'upper'"]


def test_motion_towards_a_body_is_not_slip():
    """An inclined load within the friction cone: the block comes to rest where it lands."""
    falling, lying = (pushed_block(gap=gap, slant=0.1, law=fm.Coulomb(0.3)) for gap in (0.1, 0.0))
    places = []
    for problem in (falling, lying):
        problem.solve()
        contact = problem.equations.contacts[0]
        assert contact.total_force == pytest.approx((-0.1, 1.0), abs=1e-8)
        assert problem.equations.springs.max_motion() == 0.0  # no springs are left
        places.append(contact.slave.gather(problem.equations.bulk.u.x.array)[:, 0].mean())
    assert places[0] - places[1] > 0.1 * 0.1  # fall times slope; more at the bottom if it tilts


@pytest.mark.once
def test_pinned_body_rotates_into_contact():
    problem = pushed_block(gap=0.1, pin=(0, 1))
    problem.solve()
    assert problem.equations.contacts[0].active.sum() == 1
    assert problem.certificate().pairs[0].violations() == []


@pytest.mark.once
def test_block_between_two_plates_is_pressed_evenly():
    """Three bodies one above the other; the middle one has no Dirichlet condition at all."""
    scene = stack(gap=0.02)
    for push in (-0.05, -0.1):
        scene["push"].value[:] = (0.0, push)
        scene["problem"].solve()
    forces = [contact.total_force for contact in scene["problem"].contacts]
    assert forces[0][1] > 0.0
    assert np.allclose(forces[0], -forces[1], atol=1e-9 * forces[0][1])
    assert all(not c.violations() for c in scene["problem"].certificate().pairs)


def disk_in_ring():
    """A disk of radius 0.65 with clearance in a ring, which has names outside and inside."""
    model, occ = gmsh.model, gmsh.model.occ
    model.add("disk in a ring")
    whole, hole = (occ.addDisk(0.0, 0.0, 0.0, r, r) for r in (1.0, 0.7))
    ring, _ = occ.cut([(2, whole)], [(2, hole)])
    disk = occ.addDisk(0.0, 0.0, 0.0, 0.65, 0.65)
    occ.synchronize()
    for name, surface in (("ring", ring[0][1]), ("disk", disk)):
        model.setPhysicalName(2, model.addPhysicalGroup(2, [surface]), name)
    for _, curve in model.getEntities(1):
        radius = model.getBoundingBox(1, curve)[3]
        name = "outer" if radius > 0.9 else "inner" if radius > 0.68 else "rim"
        model.setPhysicalName(1, model.addPhysicalGroup(1, [curve]), name)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.12)
    model.mesh.generate(2)
    return model


@pytest.mark.once
def test_disk_in_a_ring_settles_at_equilibrium():
    """Rigid moves creep there in small steps limited by the admitted overlap."""
    data = read(disk_in_ring)
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    dx = ufl.dx(metadata={"quadrature_degree": 2})
    weight = ufl.inner(fem.Constant(data.mesh, (0.0, -1.0)), v) * dx
    residual = internal(u, neo_hookean(u, 100.0, 0.3)) - weight
    pair = fm.ContactPair(data, "rim", "inner", law=fm.Coulomb(0.4))
    bcs = [fm.dirichlet(V, data, "outer", (0.0, 0.0))]
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="disk_")
    problem.solve()
    force = problem.equations.contacts[0].total_force
    assert abs(force[0]) < 1e-8
    assert force[1] == pytest.approx(np.pi * 0.65**2, rel=0.008)  # a polygon: 0.5 % smaller
    assert problem.certificate().violations() == []


def stack(*, gap):
    """Plates fixed and pushed, a free block between them, slave in both pairs."""

    data = read(
        rectangles,
        size=0.21,
        lower=(-0.5, 0.0, 1.0, 1.0),
        middle=(-0.5, 1.0 + gap, 1.0, 0.5),
        upper=(-0.5, 1.5 + 2 * gap, 1.0, 1.0),
    )
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [
        fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0)),
        fm.dirichlet(V, data, "upper/top", push),
    ]
    pairs = [
        fm.ContactPair(data, "middle/bottom", "lower/top"),
        fm.ContactPair(data, "middle/top", "upper/bottom"),
    ]
    residual = internal(u, neo_hookean(u, 100.0, 0.3))
    problem = fm.ContactProblem(residual, u, pairs, bcs=bcs, petsc_options_prefix="stack_")
    return {"problem": problem, "push": push}


def disk_on_block(size):
    """A disk of radius 0.5, 0.05 above a block of 2 x 0.5 and off its middle."""
    occ, model = gmsh.model.occ, gmsh.model
    model.add("disk")
    block, disk = (
        occ.addRectangle(-1.0, -0.5, 0.0, 2.0, 0.5),
        occ.addDisk(0.03, 0.55, 0.0, 0.5, 0.5),
    )
    occ.synchronize()
    for name, surface in (("block", block), ("disk", disk)):
        model.setPhysicalName(2, model.addPhysicalGroup(2, [surface]), name)
        for _, curve in model.getBoundary([(2, surface)], oriented=False):
            y = occ.getCenterOfMass(1, curve)[1]
            side = {"disk": "edge"}.get(name) or {-0.5: "bottom", 0.0: "top"}.get(round(y, 6))
            if side:
                model.setPhysicalName(1, model.addPhysicalGroup(1, [curve]), f"{name}/{side}")
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    model.mesh.generate(2)
    return model


def falling_disk(size):
    data = read(disk_on_block, size=size)
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    options = {"subdomain_data": data.cell_tags, "metadata": {"quadrature_degree": 2}}
    dx = ufl.Measure("dx", domain=data.mesh, **options)
    density = ufl.inner(neo_hookean(u, 100.0, 0.3), ufl.grad(v))
    weight = 0.5 * v[1] * dx(data.bodies["disk"])
    residual = sum(density * dx(tag) for tag in data.bodies.values()) + weight
    bcs = [fm.dirichlet(V, data, "block/bottom", (0.0, 0.0))]
    pairs = [fm.ContactPair(data, "disk/edge", "block/top")]
    return fm.ContactProblem(residual, u, pairs, bcs=bcs, petsc_options_prefix="disk_")


@pytest.mark.parametrize(
    "size", [0.1, *(pytest.param(s, marks=pytest.mark.serial) for s in (0.085, 0.06))]
)
def test_rolling_disk_settles_in_one_solve(size):
    """No Dirichlet condition on it: contact carries the weight, forces of springs are reported."""
    problem = falling_disk(size)
    report = problem.solve()
    certificate = report.certificate
    assert certificate.violations() == []
    force = problem.equations.contacts[0].total_force
    # The weight of a polygon: 0.64 % less than that of the disk on the coarsest mesh.
    assert force[1] == pytest.approx(0.5 * np.pi * 0.25, rel=0.008)
    is_reported = any("springs carry" in text for text in certificate.remarks())
    assert is_reported == (certificate.springs > RIGID.slight)
    assert problem.solve().certificate.violations() == []  # and again from this state


@pytest.mark.serial
def test_rolling_disk_needs_the_proximal_point_method(monkeypatch):
    def give_up(equations, options, failed):
        raise failed

    monkeypatch.setattr("fenics_mortar.equations.solver.solve_with_springs", give_up)
    failures = 0
    for size in (0.1, 0.085, 0.06):
        try:
            falling_disk(size).solve()
        except fm.NotConvergedError:
            failures += 1
    assert failures


def test_closest_vector_below_planes():
    """Against a general solver of quadratic programs, on random planes."""
    random = np.random.default_rng(5)
    for _ in range(20):
        wanted, rows = random.normal(size=3), random.normal(size=(6, 3))
        room = random.uniform(0.0, 0.3, 6)
        constraint = {"type": "ineq", "fun": lambda v, A=rows, b=room: b - A @ v}
        exact = minimize(
            lambda v, t=wanted: 0.5 * ((v - t) ** 2).sum(),
            np.zeros(3),
            constraints=[constraint],
            method="SLSQP",
            options={"ftol": 1e-14},
        ).x
        found, _ = nearest_below(wanted, rows, room)
        assert (rows @ found <= room + 1e-10).all()
        assert np.abs(found - exact).max() < 1e-7  # accuracy of SLSQP


@pytest.mark.once
@pytest.mark.parametrize("base", ["plane", "body"])
def test_block_that_friction_supports_stays_and_one_that_slides_keeps_its_friction(base):
    """Limit analysis is used before the solve; see also ``test_supported``, in serial."""
    for push, reaches in ((0.1, 0.0), (0.6, 0.1)):
        scene = supported.block_and_wall(push, 0.5, base)
        reports = list(scene.solve())
        assert reports[-1].num_iterations <= 5
        assert scene.motion("block")[0] == pytest.approx(0.3 if reaches else 0.0, abs=2e-3)
        assert -scene.force(1)[0] == pytest.approx(reaches, abs=1e-3)


def test_adhesion_across_a_gap_carries_weight():
    """Half of the ceiling's adhesion could act across gaps; touching nodes carry the rest alone."""
    scene = supported.hanging(weight=0.9, pull=1.0)
    list(scene.solve())
    equations = scene.problem.equations
    contact, bulk = equations.contacts[0], equations.bulk
    assert contact.active.all() and contact.pressure.max() < 0.0
    bulk.assemble_residual()
    loads = bulk.r.array_r[: bulk.num_owned].copy()
    weight, total = contact.operators.weight, contact.operators.weight.sum()
    inner = weight > 0.2 * total
    z = contact.z.copy()
    for touching, sign in ((inner, 1.0), (~inner, 1.0), (inner, -1.0), (~inner, -1.0)):
        contact.change(active=touching, z=sign * z)
        assert bool(unsupported(equations.floating, loads)) == (sign < 0.0)


def test_a_block_that_is_pulled_off_is_not_said_to_tip_over():
    """All its nodes leave at once, whatever motion has the largest work within bounds."""
    lower = Grid("lower", block(3, 2, width=1.0, height=0.5))
    data = mesh([lower, Grid("upper", block(4, 2, width=0.8, height=0.5, corner=(0.1, 0.5)))])
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    energy = fm.energies.neo_hookean(u, *fm.energies.lame(100.0, 0.3))
    residual = ufl.derivative(energy * ufl.dx(degree=3), u, v) - v[1] * ufl.dx
    pairs = [fm.ContactPair(data, "upper/bottom", "lower/top")]
    bcs = [fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0))]
    problem = fm.ContactProblem(residual, u, pairs, bcs=bcs, petsc_options_prefix="off_")
    with pytest.raises(fm.NotConvergedError, match=r"^body 'upper' can move along \(0, 1\) freely"):
        problem.solve()


def test_a_body_thrown_far_away_by_an_iteration_is_left_to_the_next_remedy():
    """Its turns about the place where the solve began are then lost in rounding."""
    cell = {"width": 1.0, "height": 1.0}
    lower, upper = block(1, 1, **cell), block(1, 1, corner=(0.1, 1.0), **cell)
    data = mesh([Grid("lower", lower), Grid("upper", upper)])
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    tool = fm.Circle((0.6, 3.0), 1.0)
    pairs = [
        fm.ContactPair(data, "upper/bottom", "lower/top", law=fm.Coulomb(0.3)),
        fm.ContactPair(data, "upper/top", tool, law=fm.Coulomb(0.3)),
    ]
    bcs = [fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0))]
    residual = internal(u, neo_hookean(u, 100.0, 0.3))
    problem = fm.ContactProblem(residual, u, pairs, bcs=bcs, petsc_options_prefix="thrown_")
    tool.move(y=-0.02)
    problem.solve()
    tool.push(y=-1.5)
    problem.solve()
    below, above = (contact.total_force[1] for contact in problem.contacts)
    assert (below, above) == pytest.approx((1.5, -1.5))
