# SPDX-License-Identifier: MIT
"""Tied pairs: patch tests, what must hold exactly, crosspoints, symmetric systems, bad input."""

from itertools import product

from mpi4py import MPI

import numpy as np
import pytest
from scenes import (
    TIGHT,
    internal,
    lame,
    linear_elastic,
    neo_hookean,
    nodal,
    pair_options,
    read,
    rotation,
)
from test_operators import dense

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes import two_blocks
from meshes.mapped_grids import Grid, block, build, sector

comm = MPI.COMM_WORLD
ROLES = [("upper/bottom", "lower/top"), ("lower/top", "upper/bottom")]
STRAIN = np.array([[1.1, 0.2], [0.05, 0.9]])
ENDS = ["lower/bottom", "upper/top"]
AROUND = [*ENDS, *(f"{block}/{side}" for block in ("upper", "lower") for side in ("left", "right"))]
# for displacements of size 1, after solves with matrices of condition 1e3
EXACT = 1e-12


def neo(u):
    return internal(u, neo_hookean(u, 100.0, 0.3))


def linear(u):
    return internal(u, linear_elastic(u, 100.0, 0.0))


def tied(data, pairs, names, gradient, *, degree=1, start=0.9, law=neo, **options):
    """A problem with the displacement gradient . X prescribed on boundaries, and that."""
    V = fm.vector_space(data.mesh, degree)
    u, exact = fem.Function(V), fem.Function(V)
    exact.interpolate(lambda X: gradient @ X[:2])
    bcs = [fm.dirichlet(V, data, name, exact) for name in names]
    u.x.array[:] = start * exact.x.array
    options = {"petsc_options_prefix": "tied_", "newton": TIGHT, **options}
    return fm.ContactProblem(law(u), u, pairs, bcs=bcs, **options), exact


def blocks(counts=(5, 7), comm=comm, **mesh):
    mesh = {"width_upper": 1.0, "width_lower": 1.0, "layers_upper": 3, "layers_lower": 4, **mesh}
    return read(two_blocks.build, comm=comm, n_upper=counts[0], n_lower=counts[1], **mesh)


def ring_data(degree):
    """Two rings with 12 and 20 facets where they meet, with curved cells if the degree is 2."""
    grids = [
        Grid(name, sector(count * degree, 2 * degree, radii=radii), closed=True)
        for name, count, radii in (("inner", 12, (1.0, 2.0)), ("outer", 20, (2.0, 3.0)))
    ]
    return read(build, grids=grids, order=degree)


def four_blocks(roles=(True, True, True, True)):
    """Blocks a b over c d of 3 to 7 cells a side; whether the first is the slave of each pair."""
    places = {"a": (3, 0, 1), "b": (4, 1, 1), "c": (5, 0, 0), "d": (7, 1, 0)}
    grids = [
        Grid(name, block(n, n, width=1.0, height=1.0, corner=(x, y)))
        for name, (n, x, y) in places.items()
    ]
    data = read(build, grids=grids)
    sides = ["a/right", "b/left"], ["b/bottom", "d/top"], ["d/left", "c/right"]
    both = zip((*sides, ["c/top", "a/bottom"]), roles, strict=True)
    return data, [fm.TiedPair(data, *(pair if first else pair[::-1])) for pair, first in both]


def off(problem, exact):
    return comm.allreduce(np.abs(problem.equations.bulk.u.x.array - exact.x.array).max(), MPI.MAX)


# Patch tests


@pytest.mark.parametrize(
    "angle, counts", [(0, (4, 4)), (0, (2, 34)), (30, (3, 10)), (90, (4, 4)), (90, (2, 34))]
)
@pytest.mark.parametrize("degree", [1, 2])
def test_a_homogeneous_finite_strain_passes_any_interface(degree, angle, counts):
    """All sides prescribed, so that the ends of the slave hand their functions over."""
    gradient = rotation(0.7) @ STRAIN - np.eye(2)
    for roles, cell in zip(ROLES, ("triangle", "quadrilateral"), strict=True):
        data = blocks(counts, cell=cell, rotation=np.radians(angle), inclination=0.2)
        problem, exact = tied(data, [fm.TiedPair(data, *roles)], AROUND, gradient, degree=degree)
        assert problem.solve().certificate.violations() == []
        assert off(problem, exact) < EXACT


@pytest.mark.parametrize(
    "basis, counts",
    [
        ("dual", (4, 4)),
        ("dual", (1, 17)),
        ("standard", (3, 10)),
        ("standard", (1, 17)),
        ("vertices", (3, 10)),
        ("linear", (1, 17)),
    ],
)
@pytest.mark.parametrize("degree", [1, 2])
def test_uniaxial_tension_passes_with_its_traction(degree, counts, basis):
    """Free sides; linear elastic with nu = 0: the traction is E times the strain."""
    for roles in ROLES:
        data = blocks(counts)
        pair = fm.TiedPair(data, *roles, **pair_options(basis=basis))
        problem, exact = tied(data, [pair], ENDS, np.diag([0.0, 0.01]), degree=degree, law=linear)
        problem.solve()
        assert off(problem, exact) < EXACT
        assert np.abs(problem.equations.contacts[0].pressure + 1.0).max() < 1e-11

    # What holds exactly
    assert problem.estimate().relative < 1e-9  # the exact solution is told as such


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
@pytest.mark.parametrize("sides", [("inner/bottom", "outer/top"), ("outer/top", "inner/bottom")])
@pytest.mark.parametrize("degree", [1, 2])
def test_turned_rings_are_free_of_stress_and_torques_cancel(degree, sides, algorithm):
    """The gap of some 1e-2 or 1e-4 between the facets is removed: rigid motions are solutions."""
    turn, data = rotation(0.8) - np.eye(2), ring_data(degree)
    pair = fm.TiedPair(data, *sides)
    problem, exact = tied(data, [pair], ["outer/bottom"], turn, degree=degree, algorithm=algorithm)
    exact.interpolate(lambda X: turn @ X[:2])  # nodes have moved
    problem.solve()
    tie = problem.equations.contacts[0]
    assert np.abs(tie.D @ tie.slave.X - tie.M @ tie.master.X).max() < 1e-14
    assert np.abs(np.hypot(*tie.slave.X.T) - 2.0).max() > (1e-3 if degree == 1 else 1e-5)
    assert off(problem, exact) < EXACT and np.abs(tie.z).max() < 1e-10 * 100.0
    exact.interpolate(lambda X: turn @ X[:2] + 0.02 * X[:2] ** 2)
    problem.solve()
    assert np.abs(tie.z).max() > 0.1
    certificate = problem.certificate().pairs[0]
    assert certificate.moment < 1e-14 and certificate.force < 1e-14 and certificate.overlap < 1e-13


def test_a_kept_gap_does_not_turn_with_the_bodies():
    """And so strains them and makes a torque; the mesh stays where it was."""
    data, turn = ring_data(1), rotation(0.8) - np.eye(2)
    pair = fm.TiedPair(data, "inner/bottom", "outer/top", gap="kept")
    problem, exact = tied(data, [pair], ["outer/bottom"], turn)
    problem.solve()
    assert np.abs(np.hypot(*problem.equations.contacts[0].slave.X.T) - 2.0).max() < 1e-14
    assert off(problem, exact) > 1e-3
    assert problem.certificate().pairs[0].moment > 1e-4


@pytest.mark.parametrize("basis", ["dual", "standard"])
@pytest.mark.parametrize("degree", [1, 2])
def test_tangent_has_second_order_remainder_and_newton_is_quadratic(degree, basis):
    data = blocks((6, 5), rotation=0.4, width_lower=1.3)
    pair = fm.TiedPair(data, *ROLES[0], **pair_options(basis=basis))
    shear = np.array([[0.0, 0.2], [0.0, 0.1]])
    problem, _ = tied(data, [pair], ENDS, shear, degree=degree, start=0.0)
    report = problem.solve()
    r = np.array(report.residuals) / report.force
    k = int(np.argmax(r < 1e-4))
    assert r[k] < 1e-4 and r[k + 1] < max(100 * r[k] ** 2, 1e-12)
    check = problem.check_tangent(print_table=False)
    assert min(check.slopes.values()) > 1.95, check.table()


@pytest.mark.parametrize("roles", ROLES)
@pytest.mark.parametrize("degree", [1, 2])
def test_forces_balance_where_facets_have_no_partner_in_part(degree, roles):
    """The upper block stands out at both sides, by parts of facets."""
    data = blocks((7, 5), width_upper=1.33, width_lower=1.2)
    shear = np.array([[0.0, 0.3], [0.0, 0.2]])
    problem, _ = tied(data, [fm.TiedPair(data, *roles)], ENDS, shear, degree=degree, start=0.0)
    report = problem.solve()
    certificate = report.certificate.pairs[0]
    assert report.certificate.violations() == []
    assert certificate.force < 1e-14 and certificate.moment < 1e-14
    assert certificate.overlap < 1e-13
    tie = problem.equations.contacts[0]
    assert np.abs(tie.D.sum(axis=1) - tie.M.sum(axis=1)).max() < 1e-15


@pytest.mark.serial
def test_two_rings_of_different_materials_have_lames_displacement():
    """u = A r + B / r in each ring; displacement and pressure are equal where they meet."""
    (a, b, c), E = (1.0, 2.0, 3.0), {"inner": 100.0, "outer": 300.0}
    (mu, lmbda), (mu2, lmbda2) = (lame(e, 0.3) for e in E.values())
    rows = [[a, 1 / a, 0, 0], [b, 1 / b, -b, -1 / b], [0, 0, c, 1 / c]]
    stress = [2 * (mu + lmbda), -2 * mu / b**2, -2 * (mu2 + lmbda2), 2 * mu2 / b**2]
    A, B, A2, B2 = np.linalg.solve([*rows, stress], [0.0, 0.0, 0.01, 0.0])
    pressure = -(2 * (mu + lmbda) * A - 2 * mu * B / b**2)
    data = ring_data(2)

    def law(u):
        dx = ufl.Measure("dx", subdomain_data=data.cell_tags, metadata={"quadrature_degree": 4})
        v = ufl.grad(ufl.TestFunction(u.function_space))
        parts = ((linear_elastic(u, e, 0.3), data.body_tag(name)) for name, e in E.items())
        return sum(ufl.inner(stress, v) * dx(tag) for stress, tag in parts)

    pair, none = fm.TiedPair(data, "inner/bottom", "outer/top"), np.zeros((2, 2))
    problem, exact = tied(data, [pair], ["inner/top", "outer/bottom"], none, degree=2, law=law)
    X = exact.function_space.tabulate_dof_coordinates()[:, :2]
    r = np.hypot(*X.T)[:, None]
    exact.x.array[:] = (np.where(r < b, A * r + B / r, A2 * r + B2 / r) * X / r).ravel()
    problem.solve()
    # 12 quadratic facets: about (pi / 12)^4 / 10 in the displacement, (pi / 12)^3 in the pressure
    assert off(problem, exact) < 1e-3 * 0.01
    assert np.abs(problem.equations.contacts[0].pressure / pressure - 1).max() < 0.02


# The linear system


def test_matrix_of_a_linear_bulk_is_constant_and_the_condensed_one_symmetric():
    """A T = Q^T K Q with the slave's motion put in, in the rows of the other nodes."""
    data, gradient = blocks(), np.array([[0.0, 0.3], [0.0, 0.2]])
    pair = fm.TiedPair(data, *ROLES[0])
    problem, _ = tied(data, [pair], ENDS, gradient, start=0.0, law=linear, algorithm="condensed")
    before = dense(problem.tangent)
    problem.solve()
    A = dense(problem.tangent)
    assert np.abs(A - before).max() < 1e-13 * np.abs(A).max()
    tie, T = problem.equations.contacts[0], np.eye(len(A))
    slave, master = tie.slave.dofs, tie.master.dofs
    follow = tie.M.toarray() / tie.D.diagonal()[:, None]
    for c in range(2):
        T[slave[:, c]] = 0.0
        T[np.ix_(slave[:, c], master[:, c])] = follow
    kept = np.setdiff1d(np.arange(len(A)), [*slave.ravel(), *prescribed(problem)])
    reduced = (A @ T)[np.ix_(kept, kept)]
    assert np.abs(reduced - reduced.T).max() < 1e-13 * np.abs(reduced).max()
    assert np.linalg.eigvalsh(reduced).min() > 0.0
    assert np.abs((A @ T)[slave.ravel()]).max() < 1e-13 * np.abs(A).max()


def prescribed(problem):
    bulk = problem.equations.bulk
    return np.concatenate(comm.allgather(bulk.held + bulk.first))


def test_saddle_matrix_is_symmetric():
    data, gradient = blocks((6, 5), width_lower=1.3), np.array([[0.0, 0.3], [0.0, 0.2]])
    pair = fm.TiedPair(data, *ROLES[0])
    problem, _ = tied(data, [pair], ENDS, gradient, start=0.0, algorithm="saddle")
    problem.solve()
    problem.equations.bulk.assemble_tangent()
    _, B_T, C, _ = (dense(part) for part in problem.equations.system.blocks())
    assert np.abs(B_T - C.T).max() < 1e-14 * np.abs(C).max() and np.abs(C).max() > 1.0


@pytest.mark.parametrize("degree", [1, 2])
def test_conjugate_gradients_with_multigrid_solve_the_reduced_system(degree):
    """As many iterations on a mesh of half the size, and what a direct solver finds."""
    shear, counts = np.array([[0.0, 0.3], [0.0, 0.2]]), []
    for n in (1, 2):
        data = blocks((5 * n, 8 * n), layers_upper=5 * n, layers_lower=8 * n, width_lower=1.2)
        found = []
        for solver in ("direct", "iterative"):
            pair = fm.TiedPair(data, *ROLES[0])
            problem, _ = tied(
                data, [pair], ENDS, shear, degree=degree, start=0.0, solver=solver,
                newton=fm.NewtonOptions(),
            )  # fmt: skip
            problem.solve()
            found.append(nodal(problem))
        assert np.abs(found[0] - found[1]).max() < 1e-8
        cycle = problem.equations.system.ksp.getPC().getPythonContext()._cycle
        assert cycle.getType() == "cg" and problem.equations.system.ksp.getIterationNumber() <= 3
        counts.append(cycle.getIterationNumber())
    assert counts[1] <= 1.5 * counts[0] and counts[0] < 60


# Crosspoints, other pairs, ranks


@pytest.mark.parametrize("roles", list(product((True, False), repeat=4))[::3])
def test_four_blocks_meet_in_a_point_whatever_their_roles(roles):
    data, pairs = four_blocks(roles)
    around = ["a/top", "b/top", "c/bottom", "d/bottom", "a/left", "c/left", "b/right", "d/right"]
    problem, exact = tied(data, pairs, around, STRAIN - np.eye(2), algorithm="condensed")
    problem.solve()
    assert off(problem, exact) < EXACT
    # nodes at the crosspoint and at the held ends carry no multiplier
    assert [int((~tie.multiplier_nodes).sum()) for tie in problem.equations.contacts] == [
        2,
        2,
        2,
        2,
    ]


def test_four_blocks_are_as_stiff_as_one():
    """Only top and bottom are held; the middle may not open."""
    found, stretch = [], np.diag([0.0, 0.1])
    data, pairs = four_blocks()
    problem, _ = tied(data, pairs, ["a/top", "b/top", "c/bottom", "d/bottom"], stretch)
    assert problem.solve().certificate.violations() == []
    found.append(force_on(problem, 2.0))
    one = read(build, grids=[Grid("one", block(12, 12, width=2.0, height=2.0))])
    problem, _ = tied(one, [], ["one/top", "one/bottom"], stretch)
    problem.solve()
    found.append(force_on(problem, 2.0))
    assert found[0] == pytest.approx(found[1], rel=0.01)


def force_on(problem, height):
    """Vertical force on the nodes at a height."""
    bulk, contact, _ = problem.forces()
    dofs = problem.equations.bulk.space.owned_dofs
    X = problem.equations.bulk.V.tabulate_dof_coordinates()[: len(dofs)]
    return comm.allreduce(float((bulk + contact)[dofs[np.abs(X[:, 1] - height) < 1e-9, 1]].sum()))


def tool_on_halves(comm=comm, slave="tool", joined=True, law=None):
    """A tool pressed on a base of two tied halves, and slid over the joint of these."""
    names = {"top": "ground", "bottom": "floor"} if slave != "left/top" else {"bottom": "floor"}
    tool = block(10, 4, width=1.0, height=0.5, corner=(-0.5, 0.0))
    left = block(8 if joined else 16, 6, width=2.0 if joined else 4.0, height=1.0, corner=(-2, -1))
    grids = [Grid("tool", tool), Grid("left", left, names)]
    if joined:
        grids.append(Grid("right", block(6, 4, width=2.0, height=1.0, corner=(0, -1)), names))
    data = read(build, comm=comm, grids=grids)
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    sides = ("tool/bottom", "ground") if slave == "tool" else (slave, "tool/bottom")
    pairs = [fm.ContactPair(data, *sides, law=law)]
    if joined:
        pairs.append(fm.TiedPair(data, "left/right", "right/left"))
    bcs = [
        fm.dirichlet(V, data, "floor", np.zeros(2)),
        fm.dirichlet(V, data, "tool/top", push),
    ]
    problem = fm.ContactProblem(
        neo(u), u, pairs, bcs=bcs, petsc_options_prefix="halves_", newton=TIGHT
    )
    reports = []
    for place in ((0.0, -0.02), (0.0, -0.05), (0.1, -0.05), (0.2, -0.05), (0.3, -0.05)):
        push.value[:] = place
        # Where the right half is in no pair, the tool goes into it: a violation that is meant.
        missed = slave == "left/top"
        reports.append(problem.solve(accept_violations=missed))
    return problem, reports


@pytest.mark.parametrize("slave, system", [("tool", "Condensed"), ("ground", "Saddle")])
def test_a_tool_slides_over_the_joint_of_tied_halves_as_over_one_base(slave, system):
    problem, reports = tool_on_halves(slave=slave)
    assert type(problem.equations.system).__name__ == f"{system}System"
    contact, tie = problem.equations.contacts
    for report in reports:
        assert report.certificate.violations() == [] and report.num_iterations <= 8
        assert report.certificate.pairs[0].shear < 1e-10
    assert np.abs(tie.z).max() > 0.1
    one = tool_on_halves(slave=slave, joined=False)[0].contacts[0]
    assert contact.total_force[1] == pytest.approx(one.total_force[1], rel=0.01)
    slopes = problem.check_tangent(print_table=False).slopes
    assert min(slopes.values()) > 1.95, slopes


@pytest.mark.parametrize("slave", ["tool", "ground"])
def test_a_contact_surface_goes_on_across_the_joint(slave):
    """With friction, too: one curve, on which the two corners are one node."""
    problem, reports = tool_on_halves(slave=slave, law=fm.Coulomb(0.2))
    contact = problem.equations.contacts[0]
    ground = contact.master if slave == "tool" else contact.slave
    assert ground.num_nodes == 8 + 6 + 1
    assert np.count_nonzero(ground.following < 0) == np.count_nonzero(ground.previous < 0) == 1
    assert max(report.num_iterations for report in reports) <= 8
    assert reports[-1].certificate.violations() == []
    force = np.abs(problem.equations.contacts[0].total_force)
    assert force[0] == pytest.approx(0.2 * force[1], rel=0.02)  # the surface is about level
    assert min(problem.check_tangent(print_table=False).slopes.values()) > 1.95


def test_a_contact_surface_may_end_at_the_joint():
    """The corner has a multiplier in contact only, and bears what the tie's neighbour passes on."""
    problem, reports = tool_on_halves(slave="left/top")
    contact, tie = problem.equations.contacts
    corner = np.intersect1d(contact.slave.nodes, tie.slave.nodes)
    assert np.isin(corner, contact.candidate_nodes).all() and corner.size == 1
    assert not np.isin(corner, tie.candidate_nodes).any()
    assert type(problem.equations.system).__name__ == "SaddleSystem"
    assert max(report.num_iterations for report in reports) <= 8


def test_a_body_that_only_a_tie_holds_does_not_float():
    """The same as the upper of two blocks; what is pulled at its top would fly off else."""
    data = blocks(layers_upper=2)

    def law(u):
        ds = ufl.Measure("ds", subdomain_data=data.facet_tags)(data.boundary_tag("upper/top"))
        pull = ufl.as_vector((0.0, 1.0))
        return linear(u) - ufl.inner(pull, ufl.TestFunction(u.function_space)) * ds

    pair = fm.TiedPair(data, *ROLES[0])
    problem, _ = tied(data, [pair], ["lower/bottom"], np.zeros((2, 2)), law=law)
    assert problem.equations.floating.bodies == []
    report = problem.solve()
    assert report.certificate.balance < 1e-13
    assert np.abs(problem.equations.contacts[0].pressure + 1.0).max() < 1e-10


def test_result_is_that_of_one_rank():
    together, alone = (tool_on_halves(comm=group)[0] for group in (comm, MPI.COMM_SELF))
    for one, other in zip(together.equations.contacts, alone.equations.contacts, strict=True):
        assert np.array_equal(one.active, other.active)
        assert np.abs(one.z - other.z).max() < 1e-10 * np.abs(other.z).max()


def test_saved_states_and_tables_know_ties(shared_path):
    problem, _ = tool_on_halves()
    fm.save_state(problem, str(shared_path / "state.npz"))
    other, _ = tool_on_halves()
    other.equations.bulk.u.x.array[:] = 0.0
    fm.load_state(other, str(shared_path / "state.npz"))
    assert np.abs(nodal(other) - nodal(problem)).max() < 1e-13
    assert "left/right - right/left" in fm.contact_table(other)


# Bad input


@pytest.mark.parametrize(
    "options, message",
    [
        ({"basis": "triple"}, "basis='triple'"),
        ({"gap": "closed"}, "gap='closed'"),
        ({"points": 1}, "points=1"),
        ({"search_radius": -1.0}, "search_radius=-1.0"),
        ({"max_angle": 90.0}, "max_angle=90.0"),
        ({"normals": "unit"}, "normals='unit' with TiedPair: a tie has basis, points, max_angle"),
        ({"discretization": "other_codes"}, "normals='unit' with TiedPair"),
        ({"integration": "nodes"}, "integration='nodes' with TiedPair"),
    ],
)
def test_unknown_options_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        fm.TiedPair(blocks(), *ROLES[0], **pair_options(options))


def test_what_cannot_be_tied_is_refused():
    data = blocks(gap=0.4)
    with pytest.raises(fm.MeshError, match="no boundary 'upper/botom'"):
        fm.TiedPair(data, "upper/botom", "lower/top")
    none = np.zeros((2, 2))
    with pytest.raises(fm.SurfaceError, match=r"nowhere within 0\.1 of each other.*search_radius"):
        tied(data, [fm.TiedPair(data, *ROLES[0])], ENDS, none)
    data = blocks((1, 3))
    with pytest.raises(fm.SurfaceError, match="every slave node that has a partner is prescribed"):
        tied(data, [fm.TiedPair(data, *ROLES[0])], AROUND, none)
    with pytest.raises(fm.SurfaceError, match="share 1 nodes"):
        tied(data, [fm.TiedPair(data, "lower/top", "lower/left")], ENDS, none)
    with pytest.raises(ValueError, match="basis 'standard', so D is not diagonal"):
        pair = fm.TiedPair(data, *ROLES[0], **pair_options(basis="standard"))
        tied(data, [pair], ENDS, none, algorithm="condensed")
    with pytest.raises(ValueError, match="a list of ContactPair and TiedPair"):
        tied(data, ["upper/bottom"], ENDS, none)


def test_straight_cells_of_degree_2_keep_the_gap_of_a_curve():
    data = ring_data(1)
    sides, none = ("inner/bottom", "outer/top"), np.zeros((2, 2))
    with pytest.raises(fm.SurfaceError, match="use a mesh of second order, or gap='kept'"):
        tied(data, [fm.TiedPair(data, *sides)], ["outer/bottom"], none, degree=2)
    pair = fm.TiedPair(data, *sides, gap="kept")
    tied(data, [pair], ["outer/bottom"], np.diag([0.01, 0.0]), degree=2)[0].solve()


def test_tied_bodies_that_nothing_holds_are_named():
    data, force = blocks(), (1.0, 0.0)

    def law(u):
        return neo(u) - ufl.inner(ufl.as_vector(force), ufl.TestFunction(u.function_space)) * ufl.dx

    problem, _ = tied(data, [fm.TiedPair(data, *ROLES[0])], [], np.zeros((2, 2)), law=law)
    with pytest.raises(fm.MortarError, match="body .* can .* freely: loads drive it"):
        problem.solve()
