# SPDX-License-Identifier: MIT
"""Iterative solver: results of the direct solver, mesh-independent numbers of iterations."""

from itertools import pairwise

from mpi4py import MPI
from petsc4py import PETSc

import gmsh
import numpy as np
import pytest
import space_pairs
from scenes import linear_elastic, neo_hookean, nodal, pair_options, pressed_blocks, read
from test_obstacles import block_under

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.space import hertz
from demos.studies.space.half_spaces import KINDS
from fenics_mortar.la.multigrid import ContactPreconditioner
from fenics_mortar.la.options import GAMG, ITERATIVE, Costs
from fenics_mortar.la.solver import LinearSolver
from fenics_mortar.newton.loop import MAX_FORCING
from fenics_mortar.utils import compat
from meshes import half_ball_on_block, half_cylinder_on_block, two_blocks

comm = MPI.COMM_WORLD
HYPRE = compat.petsc_has("hypre")
# Options of the user for the cycle of a PETSc without hypre.
BY_GAMG = {f"cycle_{name}": value for name, value in GAMG.items()}
MESH = {"n_upper": 7, "n_lower": 11, "layers_upper": 5, "layers_lower": 5}
ROUGH = {"basis": "standard", "law": fm.Coulomb(0.3)}


def largest(values):
    return comm.allreduce(float(np.abs(values).max(initial=0.0)), MPI.MAX)


@pytest.mark.once
@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize(
    "degree, pair",
    [
        (1, {}), (2, {}), (1, {"basis": "standard"}), (2, {"basis": "standard"}), (1, ROUGH),
        (2, {"law": fm.Coulomb(0.3)}),
    ],
)  # fmt: skip
def test_results_are_those_of_the_direct_solver(slave, degree, pair):
    """A corner of the upper block lies beyond the edge of the lower one."""
    u, forces, iterations = [], [], []
    for solver in ("direct", "iterative"):
        options = {"solver": solver, "newton": fm.NewtonOptions()}
        scene = pressed_blocks(
            slave=slave, degree=degree, pair=pair, problem=options, offset=1.4, **MESH
        )
        for push in ((0.02, -0.05), (0.08, -0.1)):
            scene.loads["push"].value[:] = push
            iterations.append(scene.problem.solve().num_iterations)
        u.append(nodal(scene.problem))
        forces.append(scene.problem.contacts[0].forces)  # pressures of slivers have fewer digits
    direct, iterative = np.split(np.array(iterations), 2)
    assert np.abs(direct - iterative).max() <= 1  # residuals may end close to the tolerance
    assert largest(u[0] - u[1]) < 1e-8 * largest(u[0])
    assert largest(forces[0] - forces[1]) < 1e-8 * largest(forces[0])


def pressed(k, upper, lower, inclination, basis="dual"):
    """Linear iterations for eight digits, mean of three; k facets along the slave."""
    mesh = {"n_upper": k, "n_lower": 2 * k, "layers_upper": k, "layers_lower": k}
    data = read(two_blocks.build, inclination=np.radians(inclination), **mesh)
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    dx = ufl.dx(subdomain_data=data.cell_tags, metadata={"quadrature_degree": 2})
    residual = sum(
        E * ufl.inner(linear_elastic(u, 1.0, 0.3), ufl.grad(v)) * dx(data.bodies[name])
        for name, E in (("upper", upper), ("lower", lower))
    )
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", **pair_options(basis=basis))
    problem = fm.ContactProblem(
        residual, u, [pair],
        bcs=[
            fm.dirichlet(V, data, "lower/bottom", np.zeros(2)),
            fm.dirichlet(V, data, "upper/top", np.array([0.01, -0.01])),
        ],
        petsc_options_prefix="test_", solver="iterative", linear_bulk=False,
    )  # fmt: skip
    left, count, digits = [], 0, 0.0
    problem.equations.system.ksp.setMonitor(lambda ksp, iteration, residual: left.append(residual))
    problem.equations.evaluate(start=True)
    for _ in range(3):
        left.clear()
        problem.equations.advance()
        problem.equations.evaluate(start=False)
        count, digits = count + len(left) - 1, digits + np.log10(left[0] / left[-1])
    return 8.0 * count / digits


@pytest.mark.once
@pytest.mark.parametrize(
    "upper, lower, inclination, basis",
    [
        (1, 1, 0.0, "dual"),
        (1, 1000, 0.0, "dual"),
        (1000, 1, 0.0, "standard"),
        (1, 1, 20.0, "standard"),
        (1000, 1, 20.0, "dual"),
    ],
)
def test_iterations_do_not_grow_with_the_mesh(upper, lower, inclination, basis):
    """Hypre: growth by at most a fifth per refinement, independent of which body is stiffer.

    The hierarchy of PETSc's aggregation gets its second and third grid on these meshes.
    """
    counts = [pressed(k, upper, lower, inclination, basis) for k in (8, 16, 32)]
    assert max(counts) <= (12.5 if HYPRE else 15.0)
    assert all(fine <= (1.2 if HYPRE else 1.4) * coarse for coarse, fine in pairwise(counts))


@pytest.mark.skipif(comm.size == 1, reason="on one rank PETSc has no such algorithm")
def test_components_are_coarsened_separately_for_large_matrices():
    """On several ranks PETSc's product algorithm loses the block size."""
    name, counts = "mattransposematmult_via", []
    for algorithm in ("nonscalable", "scalable"):
        PETSc.Options().setValue(name, algorithm)
        counts.append(pressed(16, 1, 1, 0.0))
        PETSc.Options().delValue(name)
    assert counts[0] == pytest.approx(counts[1], rel=0.1)  # rounding: 4 %, no block size: 100 %


def refined_cylinder(refinements):
    """A half cylinder on a block, refined ``refinements`` times."""
    model = half_cylinder_on_block.build(
        radius=8.0, width=48.0, height=24.0, h=0.16, fine=1.0, growth=0.2
    )
    for _ in range(refinements):
        gmsh.model.mesh.refine()
    return model


def pressed_cylinder(refinements, cylinder, block, **options):
    """Linear iterations for eight digits, mean of all, while a half cylinder sinks into a block."""
    data = read(refined_cylinder, refinements=refinements)
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    dx = ufl.dx(subdomain_data=data.cell_tags, metadata={"quadrature_degree": 1})
    residual = sum(
        E * ufl.inner(neo_hookean(u, 1.0, 0.3), ufl.grad(v)) * dx(data.bodies[name])
        for name, E in (("cylinder", cylinder), ("block", block))
    )
    push = fem.Constant(data.mesh, (0.0, 0.0))
    problem = fm.ContactProblem(
        residual, u, [fm.ContactPair(data, "cylinder/arc", "block/top")],
        bcs=[
            fm.dirichlet(V, data, "block/bottom", np.zeros(2)),
            fm.dirichlet(V, data, "cylinder/top", push),
        ],
        petsc_options_prefix="test_", solver="iterative", **options,
    )  # fmt: skip
    counted = counted_iterations(problem)
    for depth in (0.05, 0.15):
        push.value[1] = -depth
        problem.solve()
    iterations, digits = counted()
    return 8.0 * iterations.sum() / digits.sum()


def counted_iterations(problem):
    """A function that returns iterations and digits of each linear solve so far."""
    monitored = []
    problem.equations.system.ksp.setMonitor(lambda ksp, *now: monitored.append(now))

    def counted():
        iteration, left = np.array(monitored).T
        first = np.flatnonzero(iteration == 0)
        last = np.append(first[1:], iteration.size) - 1
        return iteration[last], np.log10(left[first] / left[last])

    return counted


@pytest.mark.parametrize(
    "cylinder, block, most",
    [
        (1, 1, 13),
        *(
            pytest.param(*each, marks=pytest.mark.serial)
            for each in ((1000, 1, 11.5), (1, 1000, 13))
        ),
    ],
)
def test_iterations_do_not_grow_where_the_contact_is_curved(cylinder, block, most):
    """From first contact on, the active set changes in each iteration; growth is at most a fifth.

    On several ranks the counts vary by 4 % from run to run by rounding. Without hypre see above.
    """
    coarse, fine = (pressed_cylinder(refinements, cylinder, block) for refinements in range(2))
    assert max(coarse, fine) <= (most if HYPRE else 20.0)
    assert fine <= (1.2 if HYPRE else 1.4) * coarse


@pytest.mark.once
def test_each_solve_is_fast_while_nodes_leave_the_contact_in_space():
    """The guess has twice the nodes in contact: the cycle is too stiff where they have left it."""
    data = read(half_ball_on_block.build, h=0.036, fine=0.2, growth=0.6)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    P = neo_hookean(u, 1.0, 0.3)
    dx = ufl.dx(metadata={"quadrature_degree": 1})
    problem = fm.ContactProblem(
        ufl.inner(P, ufl.grad(ufl.TestFunction(V))) * dx, u,
        [fm.ContactPair(data, "ball/sphere", "block/top")],
        bcs=[
            fm.dirichlet(V, data, "block/bottom", np.zeros(3)),
            fm.dirichlet(V, data, "ball/top", (0.0, 0.0, -0.02)),
        ],
        petsc_options_prefix="test_", solver="iterative",
    )  # fmt: skip
    counted = counted_iterations(problem)
    problem.solve()
    iterations, digits = counted()
    assert (8.0 * iterations / digits).max() <= 28.0


@pytest.mark.once
@pytest.mark.skipif(not HYPRE, reason="aggregation needs up to twice as many in stretched cells")
def test_stretched_cells_need_no_more_iterations_in_space():
    """Boxes graded towards the contact, where cells are up to sixty times as long as high."""
    posed = hertz.pose(hertz.SCENES["sphere"], KINDS[0], 8, solver="iterative", linear_bulk=False)
    counted = counted_iterations(posed.problem)
    posed.press(hertz.loads(hertz.SCENES["sphere"])[0])
    posed.problem.solve()
    iterations, digits = counted()
    assert (8.0 * iterations / digits).max() <= 22.0


@pytest.mark.once
@pytest.mark.skipif(not HYPRE, reason="aggregation needs more iterations")
@pytest.mark.parametrize("stiffness, poisson, most", [(1000.0, 0.3, 18), (1.0, 0.49, 45)])
def test_stiff_or_nearly_incompressible_bodies_slide_as_by_the_direct_solver(
    stiffness, poisson, most
):
    """Iterations for eight digits are 12 and 31; with incomplete factors of the strip 53 and 71."""

    def energy(u, *moduli):
        z = ufl.SpatialCoordinate(u.function_space.mesh)[2]
        factor = ufl.conditional(ufl.gt(z, -0.0015), stiffness, 1.0)  # of the upper block
        return fm.energies.neo_hookean(u, *(factor * modulus for modulus in moduli))

    found = []
    for solver in ("direct", "iterative"):
        scene = space_pairs.pressed(
            law=fm.Coulomb(0.3), upper=(5, 5, 3), lower=(5, 6, 3), poisson=poisson, energy=energy,
            problem={"solver": solver, "newton": fm.NewtonOptions()},
        )  # fmt: skip
        counted = counted_iterations(scene.problem)
        report = scene.move(0.01, 0.005, -0.015)
        assert not any("iterative solver failed" in note for note in report.notes)
        found.append(scene.u.x.array.copy())
    iterations, digits = counted()
    assert (8.0 * iterations / digits).max() <= most
    assert 0 < scene.contact.sticking.sum() < scene.contact.active.sum()
    assert largest(found[0] - found[1]) < 1e-9 * largest(found[0])


def test_aggregates_may_have_fewer_dofs_than_rigid_motions():
    """Their coarse grid has zero rows in PETSc 3.18."""
    assert pressed_cylinder(0, 1, 1, petsc_options=BY_GAMG) <= 20.0


def test_results_by_aggregation_are_those_of_the_direct_solver():
    """As in a PETSc without hypre."""
    u = []
    for options in ({"solver": "direct"}, {"solver": "iterative", "petsc_options": BY_GAMG}):
        scene = pressed_blocks(problem={**options, "newton": fm.NewtonOptions()}, **MESH)
        scene.loads["push"].value[:] = (0.02, -0.05)
        report = scene.problem.solve()
        u.append(nodal(scene.problem))
    assert "multigrid by PETSc's gamg" in report.solver
    assert largest(u[0] - u[1]) < 1e-8 * largest(u[0])


def test_last_solve_of_a_step_is_loose_and_applies_multigrid_once_per_iteration(monkeypatch):
    """The linear residual may be a hundredth of the tolerance, far below rounding before."""
    allowed, counts = [], [0, 0]
    solve, apply = LinearSolver.solve, ContactPreconditioner.apply

    def recorded(solver, *args, **options):
        allowed.append(solver.forcing)
        found = solve(solver, *args, **options)
        counts[0] += solver.ksp.getIterationNumber()
        return found

    def counted(*args):
        counts[1] += 1
        apply(*args)

    monkeypatch.setattr(LinearSolver, "solve", recorded)
    monkeypatch.setattr(ContactPreconditioner, "apply", counted)
    newton = fm.NewtonOptions()
    scene = pressed_blocks(problem={"solver": "iterative", "newton": newton}, **MESH)
    for push in (-0.02, -0.021):
        allowed.clear()
        scene.loads["push"].value[1] = push
        report = scene.problem.solve()
    assert allowed[0] == MAX_FORCING < allowed[-1]
    assert report.iterations[-1].residual < 0.1 * newton.residual_tolerance
    assert counts[0] == counts[1] > 0


@pytest.mark.once
@pytest.mark.parametrize("options", [{"solver": "iterative"}, {"linear_bulk": True}])
def test_rigid_obstacle_is_pressed_into_a_block(options):
    """An obstacle has no dofs: nodes on it have no partners to follow."""
    results = []
    for choice in ({"linear_bulk": False}, options):
        circle = fm.Circle((0.5, 2.02), 1.0)
        problem = block_under(circle, material=linear_elastic, **choice)
        for step in range(1, 4):
            circle.move(x=0.01 * step, y=-0.02 * step)
            report = problem.solve()
            assert not any("reduced iteration" in note for note in report.notes)
        results.append((nodal(problem), problem.equations.contacts[0].z, report))
    (u, z, one), (w, y, other) = results
    assert one.num_iterations == other.num_iterations
    assert largest(u - w) < 1e-8 * largest(u) and largest(z - y) < 1e-8 * largest(z)
    assert largest(z) > 0.0


def test_unsupported_problems_are_refused():
    with pytest.raises(ValueError, match="expected one of auto, direct, iterative"):
        pressed_blocks(problem={"solver": "guess"}, **MESH)


def solver_of(problem):
    return {"fgmres": "iterative", "preonly": "direct"}[problem.equations.system.ksp.getType()]


@pytest.mark.parametrize(
    "many, options, expected",
    [
        (0, {}, "iterative"),
        (10**9, {}, "direct"),
        (0, {"solver": "direct"}, "direct"),
        (0, {"algorithm": "saddle"}, "iterative"),
        (0, {"petsc_options": {"pc_type": "lu"}}, "direct"),
        (0, {"material": linear_elastic}, "direct"),
        (0, {"material": linear_elastic, "linear_bulk": False}, "iterative"),
        (0, {"pair": {"basis": "standard"}}, "iterative"),
    ],
)
def test_solver_depends_on_size_and_system(monkeypatch, many, options, expected):
    costs = Costs(many=many)
    monkeypatch.setattr("fenics_mortar.la.condensed.costs_of", lambda dim: costs)
    scene = {name: options[name] for name in ("material", "pair") if name in options}
    problem = {name: value for name, value in options.items() if name not in scene}
    assert solver_of(pressed_blocks(problem=problem, **scene, **MESH).problem) == expected


@pytest.mark.once
def test_failed_iterations_are_replaced_by_factors_and_reported(monkeypatch):
    options = {"newton": fm.NewtonOptions()}
    u, reports = [], []
    for many in (10**9, 0):
        monkeypatch.setattr(
            "fenics_mortar.la.condensed.costs_of", lambda dim, many=many: Costs(many=many)
        )
        monkeypatch.setitem(ITERATIVE, "ksp_max_it", 1)
        scene = pressed_blocks(problem=options, **MESH)
        for push in (-0.05, -0.1):
            scene.loads["push"].value[1] = push
            reports.append(scene.problem.solve())
        u.append(nodal(scene.problem))
    is_reported = [any("iterative solver failed" in note for note in r.notes) for r in reports]
    assert is_reported == [False, False, True, False]
    assert largest(u[0] - u[1]) < 1e-12 * largest(u[0])
    with pytest.raises(fm.NotConvergedError, match="linear system was not solved"):
        scene = pressed_blocks(problem={"solver": "iterative"}, **MESH)
        scene.loads["push"].value[1] = -0.05
        scene.problem.solve()


@pytest.mark.once
def test_petsc_errors_in_set_up_lead_to_factors_or_a_mortar_error(monkeypatch):
    """PETSc has no such factorization: an error, not a diverged solve."""
    monkeypatch.setattr("fenics_mortar.la.condensed.costs_of", lambda dim: Costs(many=0))
    monkeypatch.setitem(ITERATIVE, "strip_redundant_pc_factor_mat_solver_type", "nobody")
    scene = pressed_blocks(problem={"newton": fm.NewtonOptions()}, **MESH)
    scene.loads["push"].value[1] = -0.05
    report = scene.problem.solve()
    assert solver_of(scene.problem) == "direct"
    assert any("iterative solver failed: PETSc's error" in note for note in report.notes)
    scene = pressed_blocks(problem={"solver": "iterative"}, **MESH)
    scene.loads["push"].value[1] = -0.05
    with pytest.raises(fm.NotConvergedError, match="linear system was not solved.*PETSc's error"):
        scene.problem.solve()


def test_petsc_error_in_an_iteration_unlocks_vectors(monkeypatch):
    """Right-hand side and matrix can be filled again afterwards."""

    def fail(*_):
        raise PETSc.Error(76)

    monkeypatch.setattr("fenics_mortar.la.condensed.costs_of", lambda dim: Costs(many=0))
    monkeypatch.setattr(ContactPreconditioner, "apply", fail)
    scene = pressed_blocks(problem={"newton": fm.NewtonOptions()}, **MESH)
    scene.loads["push"].value[1] = -0.05
    report = scene.problem.solve()
    assert solver_of(scene.problem) == "direct"
    assert any("iterative solver failed: PETSc's error" in note for note in report.notes)
    assert report.num_iterations > 1
