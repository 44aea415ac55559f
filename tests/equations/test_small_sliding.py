# SPDX-License-Identifier: MIT
"""Small sliding: one set of operators, a symmetric linear law, one factorization."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import internal, linear_elastic, neo_hookean, nodal, pressed_blocks

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.interface.integrals import evaluate_mortar

comm = MPI.COMM_WORLD
MESH = {"n_upper": 7, "n_lower": 11, "layers_upper": 4, "layers_lower": 4}
PATH = [(0.0, -0.02), (0.01, -0.03), (0.02, 0.01), (0.0, -0.03)]
SMALL = {"sliding": "small"}


def largest(values):
    return comm.allreduce(float(np.abs(values).max(initial=0.0)), MPI.MAX)


def small_blocks(**options):
    pair = {**SMALL, **options.pop("pair", {})}
    return pressed_blocks(**{"material": linear_elastic, "pair": pair, **MESH, **options})


def test_single_factorization_agrees_with_the_general_equations():
    """Alg. 1, Alg. 2 and the complementarity problem of the pressures have equal results."""
    choices = ({}, *({"linear_bulk": False, "algorithm": a} for a in ("condensed", "saddle")))
    scenes = [small_blocks(problem=choice) for choice in choices]
    for step in PATH:
        reports = []
        for scene in scenes:
            scene.loads["push"].value[:] = step
            reports.append(scene.problem.solve())
        first, *others = (nodal(scene.problem) for scene in scenes)
        assert all(largest(u - first) < 1e-9 * largest(first) for u in others)
        z, *others = (scene.contact.z for scene in scenes)
        assert all(np.abs(w - z).max() <= 1e-9 * np.abs(z).max() for w in others)
        assert len({report.num_iterations for report in reports}) == 1
        assert not any(report.notes for report in reports)
        assert reports[0].certificate.balance < 1e-9
    taken = [scene.problem._solver.linear_bulk.choose()[0] for scene in scenes]
    assert taken[0] is not None and taken[1] is None and taken[2] is None


@pytest.mark.parametrize("material", [linear_elastic, neo_hookean])
def test_operators_are_evaluated_once(material, monkeypatch):
    calls = []
    where = "fenics_mortar.interface.integrals.evaluate_mortar"
    monkeypatch.setattr(where, lambda *a: calls.append(1) or evaluate_mortar(*a))
    scene = small_blocks(material=material)
    for step in PATH:
        scene.loads["push"].value[:] = step
        scene.problem.solve()
    assert len(calls) == 1


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_tangent_is_exact(algorithm):
    scene = small_blocks(problem={"algorithm": algorithm, "linear_bulk": False})
    scene.loads["push"].value[:] = PATH[1]
    scene.problem.solve()
    slopes = scene.problem.check_tangent(print_table=False).slopes
    # linear: the remainder is rounding, no slope is defined
    assert all(slope == np.inf for slope in slopes.values()), slopes


def test_converges_quadratically_with_a_bulk_of_finite_strain():
    scene = small_blocks(material=neo_hookean)
    scene.loads["push"].value[:] = (0.0, -0.1)
    scene.problem.solve()
    slopes = scene.problem.check_tangent(print_table=False).slopes
    assert all(slope > 1.95 for slope in slopes.values()), slopes


def test_contact_law_is_symmetric_and_conservative():
    """The gap's derivative is minus the force of a unit pressure; slave and master balance."""
    scene = small_blocks()
    scene.loads["push"].value[:] = PATH[1]
    scene.problem.solve()
    contact = scene.contact
    rng = np.random.default_rng(0)
    p = rng.uniform(0.0, 1.0, contact.slave.num_nodes)
    u, w = (rng.uniform(-1.0, 1.0, (s.num_nodes, 2)) for s in (contact.slave, contact.master))
    o = contact.operators
    on_slave, on_master = o.force(p[:, None] * o.n)
    work = (on_slave * u).sum() + (on_master * w).sum()
    start = o.after_small_motion(o.x + u, o.m + w).gap - o.gap
    assert p @ start == pytest.approx(-work, rel=1e-12)
    on_slave, on_master = o.force(contact.z)
    total = np.abs(on_slave).sum()
    assert np.abs(on_slave.sum(axis=0) + on_master.sum(axis=0)).max() < 1e-12 * total


@pytest.mark.once
def test_differs_from_finite_sliding_in_second_order():
    """Flat bodies that touch: halved loads leave a quarter of the difference."""
    differences = []
    for factor in (1.0, 0.5):
        found = []
        for sliding in ("small", "finite"):
            scene = small_blocks(pair={"sliding": sliding})
            scene.loads["push"].value[:] = (0.004 * factor, -0.02 * factor)
            scene.problem.solve()
            found.append(nodal(scene.problem))
        differences.append(largest(found[0] - found[1]))
    assert 3.0 < differences[0] / differences[1] < 5.0


@pytest.mark.once
@pytest.mark.parametrize("obstacle", ["plane", "circle"])
def test_obstacles(obstacle):
    """An obstacle that moves: on all dofs and on the pressures; exact tangent with its motions."""
    found = []
    for linear_bulk in (None, False):
        scene = small_blocks()
        V, u = scene.u.function_space, fem.Function(scene.u.function_space)
        tool = (
            fm.Plane((1.1, 1.0), (0.1, 1.0)) if obstacle == "plane" else fm.Circle((1.1, -1.0), 2.0)
        )
        fixed = [fm.dirichlet(V, scene.data, "upper/top", np.zeros(2))]
        fixed += [fm.dirichlet(V, scene.data, "lower/bottom", np.zeros(2))]
        pair = fm.ContactPair(scene.data, "upper/bottom", tool, sliding="small")
        problem = fm.ContactProblem(
            internal(u, linear_elastic(u, 100.0, 0.3)), u, [pair], bcs=fixed,
            petsc_options_prefix="test_", linear_bulk=linear_bulk,
        )  # fmt: skip
        for height in (0.02, 0.05):
            tool.move(y=height, angle=0.5 * height)
            problem.solve()
        assert problem.equations.contacts[0].active.any()
        found.append(nodal(problem))
        slopes = problem.check_tangent(print_table=False).slopes
        assert all(slope == np.inf for slope in slopes.values()), slopes
    assert largest(found[0] - found[1]) < 1e-9 * largest(found[0])


@pytest.mark.once
def test_friction_on_undeformed_operators():
    """Solved on the contact dofs and on all dofs."""
    law = {"law": fm.Coulomb(0.2)}
    scenes = [small_blocks(pair=law, problem={"linear_bulk": reduced}) for reduced in (True, False)]
    for step in PATH[:2]:
        for scene in scenes:
            scene.loads["push"].value[:] = step
            assert not scene.problem.solve().notes
    first, other = (nodal(scene.problem) for scene in scenes)
    assert largest(first - other) < 1e-8 * largest(first)
    shear = scenes[0].contact.shear_force
    assert np.abs(shear).max() > 0.01 * np.abs(scenes[0].contact.total_force).max()


def test_option_is_checked():
    with pytest.raises(ValueError, match="sliding='none': expected one of finite, small"):
        small_blocks(pair={"sliding": "none"})
