# SPDX-License-Identifier: MIT
"""Mistakes that once passed without a word, and input that once needed a detour."""

import copy
import pickle

import numpy as np
import pytest
from scenes import TIGHT, internal, linear_elastic, neo_hookean, pressed_blocks, rotation
from small_scenes import small_blocks

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.utils import compat
from fenics_mortar.utils.errors import format_point

MESH = {"n_upper": 5, "n_lower": 7, "layers_upper": 2, "layers_lower": 2}


def turned_and_pressed(degrees, sliding, obstacle=None):
    """Notes on two blocks, or one on an obstacle, turned as a whole and pressed by 2 %."""
    scene = pressed_blocks(pair={"sliding": sliding}, **MESH)
    data, V = scene.data, scene.u.function_space
    turn = rotation(np.radians(degrees))
    ends = fem.Function(V), fem.Function(V)
    push = (0.02 * turn @ (0.0, -1.0))[:, None]
    ends[0].interpolate(lambda X: (turn - np.eye(2)) @ X[:2])
    ends[1].interpolate(lambda X: (turn - np.eye(2)) @ X[:2] + push)
    names = ("lower/bottom", "upper/top")
    bcs = [fm.dirichlet(V, data, *both) for both in zip(names, ends, strict=True)]
    scene.u.x.array[:] = ends[0].x.array
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", sliding=sliding)
    residual = scene.problem._given["residual"]
    problem = fm.ContactProblem(
        residual, scene.u, [pair], bcs=bcs, petsc_options_prefix="turned_", newton=TIGHT
    )
    return [n for n in problem.solve(accept_violations=True).notes if "has rotated" in n]


@pytest.mark.parametrize("degrees", [5.0, -2.0])
def test_small_sliding_after_a_rotation_is_reported_with_its_remedy(degrees):
    """The force is off by the angle of the rotation."""
    (note,) = turned_and_pressed(degrees, "small")
    assert f"has rotated by {abs(degrees):.1f} degrees" in note and "sliding='finite'" in note


@pytest.mark.parametrize("degrees, sliding", [(1.0, "small"), (5.0, "finite")])
def test_small_rotations_and_finite_sliding_are_not_reported(degrees, sliding):
    assert turned_and_pressed(degrees, sliding) == []


def test_a_number_for_a_vector_is_refused_with_the_argument_that_is_missing():
    data = small_blocks().data
    V = fm.vector_space(data.mesh, 1)
    for value in (0.0, fem.Constant(data.mesh, 0.0)):
        with pytest.raises(fm.MeshError, match=r"shape \(\); expected \(2,\).*component=0"):
            fm.dirichlet(V, data, "lower/bottom", value)
    with pytest.raises(fm.MeshError, match=r"omit component"):
        fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0), component=1)
    for space, component in ((V, 1), (fm.scalar_space(data.mesh, 1), None)):
        value = (0.0, 0.0, 0.0) if space is V else (0.0, 0.0)
        with pytest.raises(fm.MeshError, match=r"shape \(\d,\); expected \(\)$"):
            fm.dirichlet(space, data, "lower/bottom", value, component=component)


def test_the_mesh_of_an_elastic_obstacle_is_refused_for_its_mesh_data():
    data = small_blocks().data
    w = fem.Function(fm.vector_space(data.mesh, 1))
    plane, residual = fm.Plane((0.0, 0.0), (0.0, 1.0)), internal(w, linear_elastic(w, 1.0, 0.3))
    with pytest.raises(ValueError, match=r"data=.*: expected the MeshData of the mesh of the obs"):
        fm.ElasticObstacle(plane, residual, w, data.mesh, "lower/top")


def test_an_offset_may_be_one_number():
    contact = small_blocks().problem.contacts[0]
    contact.offset = 0.1
    assert np.array_equal(contact.offset, np.full(5, 0.1))
    contact.offset += np.arange(5)
    assert contact.offset[4] == 4.1


@pytest.mark.parametrize("largest, first", [(0.05, 0.05), (0.5, 0.25), (None, 0.25)])
def test_the_first_step_is_not_beyond_the_largest(largest, first):
    assert fm.SteppingOptions(step=0.25, largest=largest).step == first


@pytest.mark.parametrize("sliding", ["finite", "small"])
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda state: pickle.loads(pickle.dumps(state))])
def test_states_are_pickled_and_restored(copied, sliding):
    scene = pressed_blocks(pair={"sliding": sliding, "law": fm.Coulomb(0.3)}, **MESH)
    scene.loads["push"].value[1] = -0.01
    report = scene.problem.solve()
    state = scene.problem.state()
    kept = copied(state)
    assert not kept.u.flags.writeable and not kept.interfaces[0].z.flags.writeable
    scene.loads["push"].value[1] = -0.02
    scene.problem.solve()
    force = scene.contact.total_force
    scene.problem.restore(kept)
    assert np.array_equal(scene.problem.state().u, state.u)
    assert scene.problem.solve().num_iterations <= report.num_iterations
    assert scene.contact.total_force == pytest.approx(force, rel=1e-9)


@pytest.mark.parametrize(
    "value", [fm.NewtonOptions(), fm.SteppingOptions(0.1), fm.Discretization(), fm.Coulomb(0.3)]
)
def test_options_are_pickled(value):
    assert repr(pickle.loads(pickle.dumps(value))) == repr(value)


def test_errors_are_pickled_with_their_report():
    scene = small_blocks()
    scene.loads["push"].value[1] = -0.01
    error = fm.NotConvergedError("too far", scene.problem.solve())
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == "too far" and again.report.num_iterations == error.report.num_iterations


def test_tables_have_no_negative_zero():
    scene = small_blocks()
    scene.loads["push"].value[1] = 0.1
    scene.problem.solve()
    assert "-0" not in str(fm.contact_table(scene.problem)).replace("e-0", "")
    assert format_point((-0.0, 1.0)) == "(0, 1)"


class Sticky(fm.Coulomb):
    """Friction, and an adhesion that ends at a gap of 0.1."""

    def adhesion(self, gap):
        return np.where(gap < 0.1, 1.0 - 10.0 * gap, 0.0), np.where(gap < 0.1, -10.0, 0.0 * gap)


@pytest.mark.parametrize(
    "held, names",
    [
        ("nothing", "body 'lower' and body 'upper'"),
        ("lower", "body 'upper'"),
        ("lower and hub", ""),
        ("lower, hub driven by no force", "body 'upper'"),
        ("lower, upper by adhesion", "body 'upper'"),
        ("lower, upper by adhesion and friction", ""),
        ("lower along y, upper by adhesion", "body 'lower' and body 'upper'"),
        ("nothing, by adhesion", "body 'lower' and body 'upper'"),
        ("lower along y", "body 'lower'"),
    ],
)
def test_bodies_without_supports_and_loads_are_reported(held, names):
    """A zero state is returned with a remark: supports were probably forgotten."""
    data = small_blocks().data
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs, remote, law = [], [], None
    if "lower" in held:
        value = 0.0 if "along" in held else (0.0, 0.0)
        component = 1 if "along" in held else None
        bcs.append(fm.dirichlet(V, data, "lower/bottom", value, component))
    if "hub" in held:
        remote.append(fm.RigidBoundary(data, "upper/top", pivot=(0.5, 1.0)))
    if "driven" in held:
        remote[0].push(x=0.0, y=0.0, moment=0.0)
    if "adhesion" in held:
        law = Sticky(0.3) if "friction" in held else fm.laws.Cohesive(strength=1.0, reach=0.1)
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=law)
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, 100.0, 0.3)), u, [pair],
        bcs=bcs, remote=remote, petsc_options_prefix="idle_",
    )  # fmt: skip
    report = problem.solve()
    for texts in (report.notes, report.certificate.remarks()):
        slides = "along" in held or held == "lower, upper by adhesion"
        free = "move along (1, 0)" if slides else "move and turn in any direction"
        expected = f"holds {names}, and no contact force acts there; free to {free}: left in place"
        assert sum(expected in text for text in texts) == bool(names)
        assert any("nothing holds" in text for text in texts) == bool(names)


def test_a_body_whose_bond_broke_is_reported():
    data = small_blocks().data
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    grip = fm.RigidBoundary(data, "upper/top", pivot=(0.5, 1.0))
    law = fm.laws.MixedCohesive(1e3, strength=0.1, reach=1e-3)
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, 100.0, 0.3)), u,
        [fm.ContactPair(data, "upper/bottom", "lower/top", law=law)],
        bcs=[fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0))], remote=[grip],
        petsc_options_prefix="broken_",
    )  # fmt: skip
    grip.move(y=1e-3 + 2e-3)
    problem.solve()
    grip.push(x=0.0, y=0.0, moment=0.0)
    (note,) = [note for note in problem.solve().notes if "nothing holds" in note]
    assert "holds body 'upper'," in note and "free to move and turn in any direction" in note


def test_bodies_that_fall_together_are_told_to_fall():
    data = small_blocks().data
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    weight = 0.1 * v[1] * ufl.dx
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)) + weight, u, [pair], petsc_options_prefix="fall_"
    )
    with pytest.raises(fm.NotConvergedError, match=r"can move along \(0, -1\) freely"):
        problem.solve()


def test_a_law_set_at_results_instead_of_the_pair_is_refused():
    contact = small_blocks().problem.contacts[0]
    with pytest.raises(AttributeError, match="law"):
        contact.law = fm.Coulomb(0.3)
    contact.pair.law = fm.Coulomb(0.3)


@pytest.mark.parametrize("start", [0.0, 0.3])
def test_a_squeezed_body_without_supports_and_loads_is_not_reported(start):
    """An interference between two obstacles is a load; so is one of the mesh."""
    data = small_blocks().data
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    u.interpolate(lambda X: np.stack([start + 0 * X[0], 0 * X[0]]))
    pairs = [
        fm.ContactPair(data, "lower/top", fm.Plane((0.0, 0.999), (0.0, -1.0)), law=fm.Coulomb(0.3)),
        fm.ContactPair(
            data, "lower/bottom", fm.Plane((0.0, 0.001), (0.0, 1.0)), law=fm.Coulomb(0.3)
        ),
    ]
    bcs = [fm.dirichlet(V, data, "upper/top", (start, 0.0))] if start else []
    residual = internal(u, linear_elastic(u, 100.0, 0.3))
    problem = fm.ContactProblem(residual, u, pairs, bcs=bcs, petsc_options_prefix="idle_")
    report = problem.solve()
    found = [note for note in report.notes if "nothing holds" in note]
    assert len(found) == (not start) and not any("'lower'" in note for note in found)


@pytest.mark.parametrize("pull", [3.0, -3.0])
def test_a_body_under_balanced_loads_makes_room_for_its_own_strains(pull):
    """It touches another one, and nothing holds it."""
    data = small_blocks().data
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    ds = ufl.ds(subdomain_data=data.facet_tags)
    residual = internal(u, linear_elastic(u, 100.0, 0.3))
    for side, sign in (("top", 1.0), ("bottom", -1.0)):
        t = fem.Constant(data.mesh, (0.0, sign * pull))
        residual -= ufl.inner(t, v) * ds(data.boundaries[f"upper/{side}"])
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    bcs = [fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0))]
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="idle_")
    assert problem.solve().certificate.violations() == []
    contact = problem.equations.contacts[0]
    assert not contact.z.any() and contact.now.mean_gap[contact.now.covered].min() > -1e-12
    assert np.ptp(contact.operators.x[:, 1]) < 1e-12


SIGNS = {"both": (-1.0, -1.0), "distance": (-1.0, 1.0), "gradient": (1.0, -1.0)}


@pytest.mark.parametrize("sign", SIGNS)
@pytest.mark.parametrize("slave", ["lower/top", ["lower/top", "lower/right", "lower/left"]])
@pytest.mark.parametrize("depth", [-0.1, 0.05])
def test_a_distance_of_the_wrong_sign_is_refused_by_name(slave, sign, depth):
    """A lid above the block, with a gap or an overlap of its middle."""
    data = small_blocks().data
    of_phi, of_gradient = SIGNS[sign]

    def lid(x):
        phi = 1.0 - depth + 0.5 * (x[:, 0] - 0.5) ** 2 - x[:, 1]
        gradient = np.stack([x[:, 0] - 0.5, -1.0 + 0.0 * x[:, 0]], axis=1)
        hessian = np.zeros((len(x), 2, 2))
        hessian[:, 0, 0] = 1.0
        return of_phi * phi, of_gradient * gradient, of_gradient * hessian

    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("lower/bottom", "upper/top")]
    residual = internal(u, linear_elastic(u, 100.0, 0.3))
    pair = fm.ContactPair(data, slave, fm.SignedDistance(lid))
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="sign_")
    with pytest.raises(fm.MortarError, match="sign"):
        problem.solve()


def thickness_notes(factor, thickness, *, has_hoop_strain, **options):
    """Notes of a solve whose residual has a factor, a function of mesh and radius."""
    data = small_blocks().data
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    r = ufl.SpatialCoordinate(data.mesh)[0]
    weight = factor(data.mesh, r)
    dx = ufl.dx(metadata={"quadrature_degree": 2})
    residual = weight * ufl.inner(linear_elastic(u, 100.0, 0.3), ufl.grad(v)) * dx
    if has_hoop_strain:
        residual += weight * u[0] * v[0] / r * dx
    names = ("lower/bottom", "upper/top", "lower/left", "upper/left")
    bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in names]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    problem = fm.ContactProblem(
        residual, u, [pair], bcs=bcs, thickness=thickness, petsc_options_prefix="thick_", **options
    )
    notes = problem.solve().notes
    assert not any("does not occur" in note for note in problem.solve().notes)  # said once
    return notes


def thickness_remarks(factor, thickness, **options):
    """Remarks on a missing thickness."""
    notes = thickness_notes(factor, thickness, has_hoop_strain=bool(options), **options)
    return [note for note in notes if "does not occur in the integrals of the residual" in note]


def constant(mesh, value):
    return fem.Constant(mesh, value)


def uniform(mesh, value):
    function = fem.Function(compat.scalar_space(mesh, 0, "DG"))
    function.x.array[:] = value
    return function


FACTORS = {
    "none": (lambda mesh, r: 1.0, 28.0, 1),
    "of another value": (lambda mesh, r: constant(mesh, 27.0), 28.0, 1),
    "none of a function": (lambda mesh, r: 3.0, lambda X: 1.0 + X[:, 0], 1),
    "number": (lambda mesh, r: 28.0, 28.0, 0),
    "constant": (lambda mesh, r: constant(mesh, 28.0), 28.0, 0),
    "field": (lambda mesh, r: uniform(mesh, 28.0), 28.0, 0),
    "position": (lambda mesh, r: 1.0 + r, lambda X: 1.0 + X[:, 0], 0),
    "one": (lambda mesh, r: 1.0, 1.0, 0),
    "a constant function": (lambda mesh, r: 28.0, lambda X: np.full(len(X), 28.0), 0),
    "another constant function": (lambda mesh, r: 27.0, lambda X: np.full(len(X), 28.0), 1),
    "a function of value one": (lambda mesh, r: 1.0, lambda X: np.ones(len(X)), 0),
    "two values": (lambda mesh, r: 28.0, lambda X: np.where(X[:, 0] < 1.0, 28.0, 1.0), 0),
    "two others": (lambda mesh, r: 27.0, lambda X: np.where(X[:, 0] < 1.0, 28.0, 1.0), 1),
    "the same on the slave": (lambda mesh, r: r + 28.0, lambda X: 28.0 + 0.0 * X[:, 0], 0),
}


@pytest.mark.parametrize("name", FACTORS)
def test_a_thickness_that_is_not_in_the_residual_is_reported(name):
    """The bulk would be 28 times too soft."""
    factor, thickness, count = FACTORS[name]
    assert len(thickness_remarks(factor, thickness)) == count


@pytest.mark.parametrize("factor, count", [(1.0, 1), (2 * np.pi, 0)])
def test_a_radius_without_2_pi_is_reported(factor, count):
    found = thickness_remarks(lambda mesh, r: factor * r, None, geometry="axisymmetric")
    assert len(found) == count and all("2 pi of 6.283" in note for note in found)


REVOLVED = {
    "2 pi X[0]": (lambda mesh, r: 2 * np.pi * r, False, ["the factor 2 pi X[0]"]),
    "pi times X[0]": (lambda mesh, r: r * constant(mesh, np.pi), False, ["the factor 2 pi X[0]"]),
    "X[0] and the hoop strain": (lambda mesh, r: r, True, ["the hoop strain"]),
    "all": (lambda mesh, r: 2 * np.pi * r, True, ["the factor 2 pi X[0] and the hoop strain"]),
    "a graded plane body": (lambda mesh, r: 2.0 + r, False, []),
    "a wavy plane body": (lambda mesh, r: 2.0 + ufl.cos(2 * np.pi * r), False, []),
}


@pytest.mark.parametrize("thickness", [None, 1.0])
@pytest.mark.parametrize("name", REVOLVED)
def test_bodies_of_revolution_in_a_plane_problem_are_reported(name, thickness):
    """The multipliers would have to be weighted by 2 pi r, too."""
    factor, has_hoop_strain, expected = REVOLVED[name]
    notes = thickness_notes(factor, thickness, has_hoop_strain=has_hoop_strain)
    found = [note for note in notes if "geometry='axisymmetric'" in note]
    assert len(found) == len(expected)
    assert all(part in note for part, note in zip(expected, found, strict=True))


def test_an_energy_of_bodies_of_revolution_in_a_plane_problem_is_reported():
    data = small_blocks().data
    V = fm.vector_space(data.mesh, 1)
    u, v, X = fem.Function(V), ufl.TestFunction(V), ufl.SpatialCoordinate(data.mesh)
    psi = fm.energies.neo_hookean(
        fm.energies.deformation_gradient(u, "axisymmetric"), *fm.energies.lame(100.0, 0.3)
    )
    residual = ufl.derivative(2 * np.pi * X[0] * psi * ufl.dx(degree=3), u, v)
    bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("lower/bottom", "upper/top")]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="plane_")
    assert any("2 pi X[0] and the hoop strain" in note for note in problem.solve().notes)
    assert not any("2 pi X[0]" in note for note in problem.solve().notes)


def test_an_obstacle_as_slave_is_refused_with_what_it_can_be():
    scene = small_blocks()
    wheel = fm.Circle((0.0, 3.0), 1.0)
    with pytest.raises(ValueError, match="an obstacle .* can only be the master"):
        fm.ContactPair(scene.data, wheel, "upper/bottom")


def test_a_number_of_incompressible_bodies_is_refused_with_the_energy_for_them():
    with pytest.raises(ValueError, match=r"nu=0.5: expected .* see mixed_neo_hookean"):
        fm.energies.lame(100.0, 0.5)
    with pytest.raises(ValueError, match=r"E=-100: expected a positive number"):
        fm.energies.lame(-100.0, 0.3)


def test_measured_values_of_another_number_of_steps_are_refused():
    misfit = fm.sensitivity.least_squares([1.0, 2.0])
    assert misfit(np.array([[1.0], [3.0]]))[0] == pytest.approx(0.5)
    with pytest.raises(ValueError, match=r"shape \(2,\): expected .* the 3 steps and 1 quant"):
        misfit(np.zeros((3, 1)))


@pytest.mark.serial
def test_a_wheel_driven_beyond_its_friction_says_so_in_its_report():
    """Its last solve, with springs, converged: the whole solve did not."""
    scene = small_blocks()
    data, V = scene.data, scene.u.function_space
    u = fem.Function(V)
    wheel = fm.Circle((1.1, 3.0), 1.0, name="wheel")
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, 100.0, 0.3)), u,
        [fm.ContactPair(data, "upper/top", wheel, law=fm.Coulomb(0.3))],
        bcs=[fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("lower/bottom", "upper/bottom")],
        petsc_options_prefix="wheel_",
    )  # fmt: skip
    wheel.push(y=-1.0)
    problem.solve()
    wheel.push(y=-1.0, moment=3.0)
    with pytest.raises(fm.NotConvergedError, match="'wheel' slide at their") as error:
        problem.solve()
    assert not error.value.report.converged
    assert "converged in" not in error.value.report.reason.replace("not converged in", "")
