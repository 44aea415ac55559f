# SPDX-License-Identifier: MIT
"""Friction against closed forms and balances: Tresca's shear under a block and a bar, the work of
sticking and sliding blocks, a block pushed into a channel, and a wheel that rolls.

Bar of stiffness E H on a foundation that bears the shear g: under an end load P it slides as far as
l = P / g, and so does it back, for a load less by Q, as far as m = Q / (2 g):

    u(x) = g (l - x)^2 / (2 E H),   less   2 g (m - x)^2 / (2 E H) on the return.
"""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import TIGHT, internal, linear_elastic, neo_hookean, pressed_blocks, read

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.energies import lame
from meshes.mapped_grids import Grid, block, build, mapped

E, NU = 100.0, 0.3
G = 0.02  # shear of the bar's foundation
WORKS = "supports", "friction"


def block_on_plane(n, material, law, *, degree=1, fixed=("top",), push=None):
    """A block of 1 x 0.5 on y = 0 with ``push`` prescribed at the fixed sides."""
    sliding = "small" if material is linear_elastic else "finite"
    grid = Grid("block", block(2 * n * degree, n * degree, width=1.0, height=0.5))
    data = read(build, grids=[grid], order=degree)
    V = fm.vector_space(data.mesh, degree)
    u = fem.Function(V)
    push = fem.Constant(data.mesh, (0.0, 0.0)) if push is None else push(V)
    plane = fm.Plane((0.0, 0.0), (0.0, 1.0))
    problem = fm.ContactProblem(
        internal(u, material(u, E, NU)),
        u,
        [fm.ContactPair(data, "block/bottom", plane, law=law, sliding=sliding)],
        bcs=[fm.dirichlet(V, data, f"block/{side}", push) for side in fixed],
        petsc_options_prefix="test_",
        newton=TIGHT,
    )
    return problem, push


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_block_that_slides_under_constant_shear(algorithm):
    """Linear elasticity has a solution of degree two: Q2 has it to rounding.

    The shear g at the bottom falls to zero at the height H, the axial stress grows by g / H along
    the motion, the pressure p is uniform, and the bottom stays flat.
    """
    g, p, s, H, shift = 0.7, 3.0, 1.0, 0.5, 0.4
    a, c = (1.0 - NU**2) / E, NU * (1.0 + NU) / E
    shear_modulus = lame(E, NU)[0]

    def exact(x):
        along = (c * p - a * s) * x[0] + a * g * x[0] ** 2 / (2 * H) + shift
        sheared = g / shear_modulus * (x[1] - x[1] ** 2 / (2 * H)) + c * g * x[1] ** 2 / (2 * H)
        return np.stack([along + sheared, (c * s - a * p) * x[1] - c * g * x[0] * x[1] / H])

    def push(V):
        function = fem.Function(V)
        function.interpolate(exact)
        return function

    problem, u = block_on_plane(
        2, linear_elastic, fm.Tresca(g), degree=2, fixed=("left", "right", "top"), push=push
    )
    problem.solve()
    contact = problem.equations.contacts[0]
    on = contact.covered
    assert on.sum() == contact.z.shape[0] - 2 and not contact.sticking.any()
    node = contact.nodal
    assert node.z_tau[on] == pytest.approx(g, rel=1e-9)
    assert node.z_n[on] == pytest.approx(p, rel=1e-9)
    assert np.abs(problem.equations.bulk.u.x.array - u.x.array).max() < 1e-10


def bar(columns, length, height):
    """A bar that is stiff in shear, so that it is one-dimensional, pressed on y = 0; its end load.

    Shear adds a displacement of the order E / G, 1e-6 of the whole.
    """
    data = read(build, grids=[Grid("bar", block(columns, 1, width=length, height=height))])
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    load = fem.Constant(data.mesh, 0.0)
    strain, virtual = ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v))
    work = E * (strain[0, 0] * virtual[0, 0] + strain[1, 1] * virtual[1, 1])
    work += 1e6 * E * strain[0, 1] * virtual[0, 1]
    ends = ufl.ds(subdomain_data=data.facet_tags)(data.boundaries["bar/left"])
    residual = work * ufl.dx(metadata={"quadrature_degree": 2}) - load * v[0] * ends
    plane, law = fm.Plane((0.0, 0.0), (0.0, 1.0)), fm.Tresca(G)
    problem = fm.ContactProblem(
        residual,
        u,
        [fm.ContactPair(data, "bar/bottom", plane, law=law, sliding="small")],
        bcs=[
            fm.dirichlet(V, data, "bar/top", -0.01 * height, component=1),
            fm.dirichlet(V, data, "bar/right", 0.0, component=0),
        ],
        petsc_options_prefix="bar_",
    )
    return problem, load


@pytest.mark.serial
def test_bar_slides_as_far_as_its_load_reaches_and_back():
    """Where the fronts are at nodes, the nodal values are exact, and so is the shear."""
    g, length, height, h = G, 2.0, 0.1, 0.125
    problem, load = bar(16, length, height)
    contact = problem.equations.contacts[0]
    X = contact.slave.X[:, 0]

    def slid(shear, front):
        return shear * np.clip(front - X, 0.0, None) ** 2 / (2.0 * E * height)

    def step(shear, front):
        return shear * (np.where(X < front - 1e-9, 1.0, 0.0) + 0.5 * np.isclose(X, front))

    def compare(displacement, shear):
        found = contact.slave.gather(problem.equations.bulk.u.x.array)[:, 0]
        assert np.abs(found - displacement).max() < 1e-5 * displacement.max()
        assert np.abs(contact.nodal.z_tau - shear).max() < 1e-5 * g

    for front in (4 * h, 8 * h, 12 * h):
        load.value = g * front / height
        problem.solve()
        compare(slid(g, front), step(g, front))
    forth = slid(g, front), step(g, front)
    for back in (2 * h, 5 * h):
        load.value = g * (front - 2.0 * back) / height
        problem.solve()
        compare(forth[0] - slid(2 * g, back), forth[1] - step(2 * g, back))


def stored_energy(u):
    """Energy of ``neo_hookean`` bodies, as a function without arguments."""
    psi = fm.energies.neo_hookean(u, *lame(E, NU))
    form = fem.form(psi * ufl.dx(metadata={"quadrature_degree": 4}))
    return lambda: MPI.COMM_WORLD.allreduce(fem.assemble_scalar(form))


def draw(scene, steps):
    """Move from stick to partial slip in a number of steps.

    Returns the work lost in addition to friction and pressures, the difference of shear times slip
    from friction work, and friction work.
    """
    law = fm.Coulomb(0.3)
    if scene == "plane":
        problem, push = block_on_plane(4, neo_hookean, law)
    else:
        blocks = pressed_blocks(
            pair={"law": law}, n_upper=6, n_lower=9, layers_upper=4, layers_lower=4
        )
        problem, push = blocks.problem, blocks.loads["push"]
    push.value[:] = (0.0, -0.05)
    problem.solve()
    energy = stored_energy(problem.equations.bulk.u)
    start, contact = energy(), problem.equations.contacts[0]
    shears, slips = [contact.shear_force], []

    def move(time):
        push.value[:] = (0.08 * time, -0.05 - 0.02 * time)

    def keep(time, report):
        shears.append(contact.shear_force)
        slips.append(contact.slip)

    path = fm.follow_path(problem, move, fm.SteppingOptions(1.0 / steps), on_step=keep)
    assert len(path.steps) == steps
    assert 0 < contact.sticking.sum() < contact.active.sum()
    names = "supports", "shear", "pressure"
    supports, friction, pressure = (sum(getattr(s.work, k) for s in path.steps) for k in names)
    by_slip = sum(0.5 * (a + b) @ slip for a, b, slip in zip(shears, shears[1:], slips))
    return supports - (energy() - start) - friction - pressure, by_slip - friction, friction


@pytest.mark.once
@pytest.mark.serial
@pytest.mark.parametrize("scene", ["plane", "blocks"])
def test_friction_dissipates_the_difference_of_work_and_energy(scene):
    """The balance closes at second order in the step, between bodies with the work of pressures.

    To first order the slip of the law is work-conjugate to the forces: the partners are those at
    the start of the step.
    """
    lost, by_slip, friction = np.transpose([draw(scene, steps) for steps in (2, 4, 8)])
    coarse, fine = -np.diff(lost)
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.1)
    assert abs(lost[2] - fine / 3.0) < 1e-4 * friction[2]
    assert abs(2.0 * by_slip[2] - by_slip[1]) < 2e-4 * friction[2]  # a second-order term


@pytest.mark.once
@pytest.mark.serial
def test_block_pushed_into_a_narrower_channel():
    """The walls close by 1 % over a slope of 1 : 60, with mu = 0.1.

    While it enters, the push is between mu N and that of a wedge, (mu + tan a) / (1 - mu tan a) N;
    inside hardly more energy is stored (1 % of the work), and the work is dissipated by friction.
    """
    mu, slope, steps, distance = 0.1, 1 / 60, 14, 1.75

    def wall(side):
        def position(s, t):
            narrowing = np.clip(3.0 * s - 0.9, 0.0, 0.6) * slope
            return 3.0 * s, side * (0.5 - narrowing) + 0.3 * (t - (side < 0))

        return Grid("upper" if side > 0 else "lower", mapped(24, 2, position))

    pushed = Grid("pushed", block(8, 8, width=0.8, height=1.0, corner=(0.05, -0.5)))
    data = read(build, grids=[pushed, wall(1), wall(-1)])
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, 0.0)
    facing = ("pushed/top", "upper/bottom"), ("pushed/bottom", "lower/top")
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)),
        u,
        [fm.ContactPair(data, *names, law=fm.Coulomb(mu)) for names in facing],
        bcs=[
            fm.dirichlet(V, data, "upper/top", (0.0, 0.0)),
            fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0)),
            fm.dirichlet(V, data, "pushed/left", push, component=0),
        ],
        petsc_options_prefix="channel_",
        newton=fm.NewtonOptions(residual_tolerance=1e-14),  # down to rounding, for the symmetry
    )
    forces = []

    def move(time):
        push.value = distance * time

    def keep(time, report):
        forces.append([contact.total_force for contact in problem.equations.contacts])

    path = fm.follow_path(problem, move, fm.SteppingOptions(1.0 / steps), on_step=keep)
    assert path.num_cuts == 0
    assert np.median([step.report.num_iterations for step in path.steps]) <= 5
    above, below = np.transpose(forces, (1, 0, 2))
    assert np.abs(above - below * [1.0, -1.0]).max() < 1e-12 * np.abs(above).max()
    pushes, normal = -above[:, 0], -above[:, 1]
    entering = slice(0, 6)
    ratio = pushes[entering] / normal[entering]
    assert (ratio > mu).all() and (ratio < (mu + slope) / (1 - mu * slope)).all()
    inside = slice(steps - 2, steps)
    done, taken = (sum(getattr(s.work, k) for s in path.steps[inside]) for k in WORKS)
    assert done == pytest.approx(taken, rel=0.02)
    assert done == pytest.approx(2.0 * pushes[inside].mean() * 2 * distance / steps, rel=1e-3)


@pytest.mark.once
@pytest.mark.serial
@pytest.mark.parametrize("mu, nu, sliding", [(1.0, 0.3, 1), (0.3, 0.45, 2)])
def test_wheel_that_friction_drives_rolls(mu, nu, sliding):
    """A rigid wheel is rotated on a block, pressed down by a force, and free to move along.

    All nodes except one or two at the edge stick, so that work and moment are small, and the wheel
    travels its circumference up to the stretch of the ground, of the order (a / R)^2 with the
    half-width of contact a. In the end all contact nodes differ from those at the start. The wheel
    must follow the rotation before the solve: otherwise all nodes slide, and Newton's method may
    move it over the edge.
    """
    R, P, turn, steps = 1.0, 4.0, 0.05, 10
    ground = Grid("ground", block(48, 8, width=2.4, height=0.8, corner=(-0.6, -0.8)))
    data = read(build, grids=[ground])
    V, wheel = fm.vector_space(data.mesh, 1), fm.Circle((0.0, R), R)
    u = fem.Function(V)
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, nu)),
        u,
        [fm.ContactPair(data, "ground/top", wheel, law=fm.Coulomb(mu))],
        bcs=[fm.dirichlet(V, data, "ground/bottom", (0.0, 0.0))],
        petsc_options_prefix="wheel_",
    )
    contact = problem.equations.contacts[0]
    wheel.push(y=-P)
    problem.solve()
    touched = contact.active.copy()
    wheel.push(x=0.0)
    work = 0.0
    for step in range(1, steps + 1):
        wheel.move(angle=-turn * step)
        report = problem.solve()
        assert report.certificate.violations() == []
        assert report.num_iterations <= 6
        assert contact.sliding.sum() <= sliding
        work += contact.now.friction_work
    angle = turn * steps
    assert not (touched & contact.active).any()
    assert contact.active.sum() >= 8
    assert wheel.place[0] == pytest.approx(R * angle, rel=4 * P * (1 - nu**2) / (np.pi * E * R))
    assert abs(work) < 2e-4 * P * R * angle
    assert abs(wheel.reaction[2]) < 2e-3 * P * R
