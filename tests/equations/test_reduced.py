# SPDX-License-Identifier: MIT
"""Newton's method on the contact dofs alone: equal iterates, and criteria for its use."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import TIGHT, internal, linear_elastic, neo_hookean, nodal, pressed_blocks

import ufl
from dolfinx import fem

import fenics_mortar as fm

comm = MPI.COMM_WORLD
MESH = {"n_upper": 7, "n_lower": 11, "layers_upper": 4, "layers_lower": 4}
PATH = [(0.0, -0.05), (0.02, -0.08), (0.07, -0.08), (0.07, 0.01), (0.1, -0.06)]
# An edge slides by facets: the cover of a node under it increases strongly in a step.
EDGE = [(0.04, -0.05), (0.04, -0.1), (0.24, -0.1), (0.44, -0.1)]


def largest(values):
    return comm.allreduce(float(np.abs(values).max(initial=0.0)), MPI.MAX)


def pair_of(**options):
    """The same linear scene by the general path and on the contact dofs."""
    return [
        pressed_blocks(
            material=linear_elastic,
            problem={"linear_bulk": reduced, **options.get("problem", {})},
            **{**MESH, **{k: v for k, v in options.items() if k != "problem"}},
        )
        for reduced in (False, True)
    ]


@pytest.mark.once
@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
@pytest.mark.parametrize("linearization", ["full", "frozen"])
def test_iterates_agree_with_the_general_equations(slave, algorithm, linearization):
    options = {"algorithm": algorithm, "linearization": linearization}
    general, reduced = pair_of(slave=slave, problem=options)
    equations, _ = reduced.problem._solver.linear_bulk.choose()
    assert equations is not None
    for step in PATH[:3]:
        for scene, solver in ((general, general.problem.equations), (reduced, equations)):
            scene.loads["push"].value[:] = step
            solver.evaluate(start=True)
        for _ in range(5):
            one, other = (
                (solver.advance(), solver.evaluate(start=False))
                for solver in (general.problem.equations, equations)
            )
            size = largest(general.contact.z)
            assert largest(general.contact.z - reduced.contact.z) < 1e-9 * size
            assert np.array_equal(general.contact.active, reduced.contact.active)
            assert one[1].num_changed == other[1].num_changed
            equations.finish()
            u, w = nodal(general.problem), nodal(reduced.problem)
            assert largest(u - w) < 1e-9 * largest(u)


@pytest.mark.once
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
@pytest.mark.parametrize(
    "path, scene",
    [(PATH, {}), (EDGE, {"slave": "lower", "pair": {"law": fm.Coulomb(0.3)}})],
    ids=["pressed", "edge"],
)
def test_load_steps_need_the_same_iterations(path, scene, algorithm):
    general, reduced = pair_of(problem={"algorithm": algorithm}, **scene)
    for step in path:
        reports = []
        for scene in (general, reduced):
            scene.loads["push"].value[:] = step
            reports.append(scene.problem.solve())
        one, other = reports
        assert one.num_iterations == other.num_iterations
        assert [i.num_active for i in one.iterations] == [i.num_active for i in other.iterations]
        assert not other.notes
        u, w = nodal(general.problem), nodal(reduced.problem)
        assert largest(u - w) < 1e-9 * largest(u)
        assert other.certificate.balance < 1e-9


@pytest.mark.once
def test_intermediate_step_on_all_dofs_changes_nothing(monkeypatch):
    """A step on all dofs adds contact terms to K, which the next direction must not contain.

    The upper block is one cell high: contact terms are added to rows with prescribed values.
    """
    general, reduced = pair_of(layers_upper=1)
    for number, step in enumerate(PATH[:3]):
        for scene in (general, reduced):
            scene.loads["push"].value[:] = step
        general.problem.solve()
        if number == 1:
            with monkeypatch.context() as patched:
                linear_bulk = reduced.problem._solver.linear_bulk
                patched.setattr(linear_bulk, "choose", lambda: (None, []))
                reduced.problem._solver._solve()
        else:
            assert not reduced.problem.solve().notes
        u, w = nodal(general.problem), nodal(reduced.problem)
        assert largest(u - w) < 1e-9 * largest(u)


def loaded_blocks(reduced, *, fixed="both"):
    """Blocks under their own weight; where the upper is fixed, its top is moved."""
    scene = pressed_blocks(material=linear_elastic, **MESH)
    V, mesh = scene.u.function_space, scene.data.mesh
    u = fem.Function(V)
    weight, modulus = fem.Constant(mesh, (0.0, 0.0)), fem.Constant(mesh, 100.0)
    v = ufl.TestFunction(V)
    stress = modulus * linear_elastic(u, 1.0, 0.3)
    residual = internal(u, stress) - ufl.inner(weight, v) * ufl.dx
    bcs = scene.problem.equations.bulk.bcs[: {"lower": 1, "both": 2}[fixed]]
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top")
    problem = fm.ContactProblem(
        residual, u, [pair], bcs=bcs, petsc_options_prefix="test_", newton=TIGHT,
        linear_bulk=reduced,
    )  # fmt: skip
    loads = {"push": scene.loads["push"], "weight": weight, "modulus": modulus}
    return problem, loads


@pytest.mark.once
def test_loads_that_change_with_time():
    both = [loaded_blocks(reduced) for reduced in (False, True)]
    for time in (0.3, 0.6, 1.0, 0.1):
        for _, loads in both:
            loads["weight"].value[:] = (2.0 * time, -5.0 * time**2)
            loads["push"].value[1] = -0.03 * np.sin(time)
        one, other = (problem.solve() for problem, _ in both)
        assert one.num_iterations == other.num_iterations and not other.notes
        u, w = (nodal(problem) for problem, _ in both)
        assert largest(u - w) < 1e-9 * largest(u)


@pytest.mark.once
def test_new_stiffness_is_factored_anew():
    both = [loaded_blocks(reduced) for reduced in (False, True)]
    for E in (100.0, 50.0):
        for problem, loads in both:
            loads["modulus"].value = E
            loads["weight"].value[1] = -5.0
            loads["push"].value[1] = -0.03
            assert not problem.solve().notes
        u, w = (nodal(problem) for problem, _ in both)
        assert largest(u - w) < 1e-9 * largest(u)


def test_body_supported_by_contact_is_solved_on_all_dofs():
    problem, loads = loaded_blocks(True, fixed="lower")
    loads["weight"].value[1] = -1.0
    report = problem.solve()
    assert any("leave body 'upper' free to move" in note for note in report.notes)
    assert problem.equations.contacts[0].total_force[1] == pytest.approx(
        1.0, rel=1e-9
    )  # its weight
    assert not any("free to move" in note for note in problem.solve().notes)  # reported once


@pytest.mark.once
def test_choice_follows_from_the_form():
    def takes(material, **options):
        scene = pressed_blocks(material=material, problem=options, **MESH)
        scene.loads["push"].value[1] = -0.05
        scene.problem.solve()
        return scene.problem._solver.linear_bulk.choose()[0] is not None

    assert takes(linear_elastic) and not takes(neo_hookean)
    assert not takes(linear_elastic, linear_bulk=False)
    assert not takes(linear_elastic, solver="iterative")


@pytest.mark.once
def test_linear_bulk_with_a_nonlinear_residual_is_refused():
    """The residual of a bulk that is not linear is checked at the end."""
    scenes = [
        pressed_blocks(material=neo_hookean, problem={"linear_bulk": reduced}, **MESH)
        for reduced in (False, True)
    ]
    for scene in scenes:
        scene.loads["push"].value[1] = -0.1
    _, report = (scene.problem.solve() for scene in scenes)
    assert any("reduced iteration" in note for note in report.notes)
    u, w = (nodal(scene.problem) for scene in scenes)
    assert largest(u - w) < 1e-10 * largest(u)
