# SPDX-License-Identifier: MIT
"""Temperatures tied together with the displacement: exact solutions, balance, systems, refusals."""

import numpy as np
import pytest
from heat_scenes import heated, stacked
from tied_scenes import comm

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import sensitivity
from fenics_mortar.energies import lame
from meshes.mapped_grids import Grid, block, sector

SIDES = [("upper/bottom", "lower/top"), ("lower/top", "upper/bottom")]
HOT, CONDUCTIVITY = 10.0, 5.0


def bar(sides=SIDES[0], *, alpha=1e-3, tie=None, algorithm=None, **options):
    """Two tied blocks, cold below and hot above, compressed."""
    scene = stacked(alpha=alpha, **options)
    pair = fm.TiedPair(scene.data, *sides, **{"fields": [1], **(tie or {})})
    problem = scene.problem([pair], algorithm=algorithm)
    scene.set(top=-0.05, hot=HOT)
    return scene, problem


def temperature(scene):
    T, X = scene.at(1)
    return T[:, 0], X


def heat_from(scene, problem, y):
    """Heat that enters at the dofs of the temperature at a height."""
    space, dofs = scene.w.function_space.sub(1).collapse()
    count = space.dofmap.index_map.size_local
    there = np.abs(space.tabulate_dof_coordinates()[:count, 1] - y) < 1e-9
    residual = problem.equations.residual.forces()[0]
    return comm.allreduce(float(residual[np.asarray(dofs)[:count][there]].sum()))


# Exact solutions


@pytest.mark.once
@pytest.mark.parametrize("sides", SIDES)
@pytest.mark.parametrize("basis", ["dual", "standard", "vertices", "linear"])
@pytest.mark.parametrize("degrees", [(1, 1), (2, 1), (2, 2)])
def test_linear_temperature_and_uniform_strain_are_exact(degrees, basis, sides):
    """Nonmatching facets; end nodes on rollers carry a multiplier of the temperature only."""
    tie = {"discretization": fm.Discretization(basis=basis)}
    scene, problem = bar(sides, degrees=degrees, alpha=0.0, tie=tie)
    report = problem.solve()
    assert report.num_iterations <= 3
    u, X = scene.at(0)
    assert np.abs(u - np.stack([0.0 * X[:, 0], -0.05 * X[:, 1] / 3.0], axis=1)).max() < 1e-13
    T, X = temperature(scene)
    assert np.abs(T - HOT * X[:, 1] / 3.0).max() < 1e-12 * HOT
    tied = problem.equations.contacts[0]
    field = tied.fluxes[0]
    assert not tied.active[0] and field.active[0] and field.active[-1]
    way = 1.0 if sides == SIDES[0] else -1.0
    assert field.flux[field.active] == pytest.approx(way * CONDUCTIVITY * HOT / 3.0, rel=1e-11)


@pytest.mark.filterwarnings("error:invalid value")
@pytest.mark.parametrize("degrees", [(1, 1), (2, 1), (2, 2)])
def test_linear_temperature_along_an_axis_is_exact(degrees):
    """Cylinders: integrals are weighted by the circumference; the axis has half a facet."""
    scene, problem = bar(degrees=degrees, alpha=0.0, geometry="axisymmetric")
    problem.solve()
    T, X = temperature(scene)
    assert np.abs(T - HOT * X[:, 1] / 3.0).max() < 1e-12 * HOT
    flux = problem.contacts[0].fluxes[0]
    assert flux.into_master == pytest.approx(np.pi * CONDUCTIVITY * HOT / 3.0, rel=1e-11)


@pytest.mark.parametrize("degrees", [(1, 1), (2, 1), (2, 2)])
def test_temperature_of_two_rings_converges_to_the_logarithm(degrees):
    """Curved cells with a displacement of degree 2; second order with degree 1, else third."""
    errors, degree = [], degrees[0]
    for n in (1, 2):
        grids = [
            Grid(name, sector(count * n * degree, 2 * n * degree, radii=radii), closed=True)
            for name, count, radii in (("inner", 12, (1.0, 2.0)), ("outer", 20, (2.0, 3.0)))
        ]
        scene = heated(grids, degrees=degrees, order=degree)
        for i in (0, 1):
            scene.prescribe(f"support {i}", "outer/bottom", 0, i)
        scene.prescribe("cold", "outer/bottom", 1)
        scene.prescribe("hot", "inner/top", 1)
        pair = fm.TiedPair(scene.data, "inner/bottom", "outer/top", fields=[1])
        problem = scene.problem([pair])
        scene.set(hot=HOT)
        report = problem.solve()
        assert not report.certificate.violations()
        T, X = temperature(scene)
        errors.append(np.abs(T - HOT * np.log(3.0 / np.hypot(*X.T)) / np.log(3.0)).max())
    flux = problem.contacts[0].fluxes[0]
    total = 2.0 * np.pi * CONDUCTIVITY * HOT / np.log(3.0)
    assert flux.into_master == pytest.approx(total, rel=1e-5 if degrees[1] == 2 else 4e-3)
    assert flux.conduction.min() == pytest.approx(flux.conduction.max(), rel=2e-3)
    assert errors[1] < errors[0] / (8.0 if degrees[1] == 2 else 3.9) and errors[1] < 0.004 * HOT


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_expansion_of_a_bar_with_linear_temperature_is_exact(algorithm):
    """Quadratic displacement of constant axial stress, with both fields of degree 2."""
    scene, problem = bar(degrees=(2, 2), alpha=2e-3, algorithm=algorithm)
    problem.solve()
    mu, lmbda = lame(100.0, 0.3)
    bulk = (3.0 * lmbda + 2.0 * mu) / (lmbda + 2.0 * mu)
    u, X = scene.at(0)
    y = X[:, 1]
    expansion = bulk * 2e-3 * HOT / 6.0
    expected = expansion * y**2 + (-0.05 / 3.0 - 3.0 * expansion) * y
    assert np.abs(u[:, 1] - expected).max() < 1e-13 and np.abs(u[:, 0]).max() < 1e-13
    pressure = -(lmbda + 2.0 * mu) * (-0.05 / 3.0 - 3.0 * expansion)
    on = problem.equations.contacts[0].active
    assert problem.contacts[0].pressure[on] == pytest.approx(pressure, rel=1e-11)


def test_four_blocks_with_a_crosspoint_conduct_exactly():
    """A linear temperature across the joints of four blocks, at which three meet at a time."""
    places = {"a": (3, 0, 1), "b": (4, 1, 1), "c": (5, 0, 0), "d": (7, 1, 0)}
    grids = [
        Grid(name, block(n, n, width=1.0, height=1.0, corner=(x, y)))
        for name, (n, x, y) in places.items()
    ]
    scene = heated(grids, alpha=0.0)
    scene.prescribe("feet", ["c/bottom", "d/bottom"], 0, 1)
    scene.prescribe("side", ["a/left", "c/left"], 0, 0)
    scene.prescribe("cold", ["c/bottom", "d/bottom"], 1)
    scene.prescribe("hot", ["a/top", "b/top"], 1)
    sides = ("a/right", "b/left"), ("b/bottom", "d/top"), ("d/left", "c/right")
    sides += (("c/top", "a/bottom"),)
    problem = scene.problem([fm.TiedPair(scene.data, *pair, fields=[1]) for pair in sides])
    scene.set(hot=HOT)
    problem.solve()
    T, X = temperature(scene)
    assert np.abs(T - HOT * X[:, 1] / 2.0).max() < 1e-12 * HOT


# Balance and systems


@pytest.mark.once
@pytest.mark.parametrize("sides", SIDES)
@pytest.mark.parametrize("degrees", [(1, 1), (2, 1), (2, 2)])
def test_heat_flows_where_the_blocks_are_tied_and_is_in_balance(degrees, sides):
    """Blocks of width 1 and 1.7: what enters above leaves below, through the joint."""
    scene, problem = bar(sides, degrees=degrees, overhang=0.7)
    problem.solve()
    flux, field = problem.contacts[0].fluxes[0], problem.equations.contacts[0].fluxes[0]
    loads = np.concatenate(field.loads())
    assert abs(loads.sum()) < 1e-13 * np.abs(loads).sum()
    assert flux.into_master == -flux.into_slave
    supplied = [heat_from(scene, problem, y) for y in (0.0, 3.0)]
    way = 1.0 if sides == SIDES[0] else -1.0
    assert way * flux.into_master == pytest.approx(supplied[1], rel=1e-11)
    assert supplied[0] == pytest.approx(-supplied[1], rel=1e-11) and supplied[1] > 5.0
    bare = field.operators.cover == 0.0
    assert not field.flux[bare].any() and bare.any() == (sides == SIDES[1])
    tied = problem.equations.contacts[0]
    o, weight = field.operators, field.operators.weight[field.active]
    jump = o.jump(*field.gather(scene.w.x.array))[field.active, 0]
    assert np.abs(jump / weight).max() < 1e-12 * HOT
    assert tied.now.forces[0].shape[1] == problem.contacts[0].tractions.shape[1] == 2


@pytest.mark.once
@pytest.mark.parametrize("degrees", [(1, 1), (2, 1), (2, 2)])
@pytest.mark.parametrize("factor", [1.0, 1e6])
def test_condensed_and_saddle_point_system_agree(degrees, factor):
    """Also if the unit of heat makes its residual a million times larger."""
    found = []
    for algorithm in ("condensed", "saddle"):
        conductivity = factor * CONDUCTIVITY
        scene, problem = bar(
            degrees=degrees, overhang=0.7, algorithm=algorithm, conductivity=conductivity
        )
        report = problem.solve()
        assert report.num_iterations <= 3
        found.append((scene.at(0)[0], scene.at(1)[0], problem.contacts[0].fluxes[0].conduction))
        check = problem.check_tangent(print_table=False)
        assert check.remainders["whole"].max() < 1e-12  # a linear problem
    for one, other in zip(*found, strict=True):
        assert np.abs(one - other).max() < 1e-12 * np.abs(one).max()


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_contact_that_conducts_beside_a_tie(algorithm):
    """Two and three components of multipliers in one system, with the exact tangent."""
    grids = [
        Grid("left", block(4, 3, width=1.0, height=1.0)),
        Grid("right", block(5, 4, width=1.0, height=1.0, corner=(1.0, 0.0))),
        Grid("tool", block(4, 2, width=1.0, height=0.5, corner=(0.3, 1.0))),
    ]
    scene = heated(grids)
    scene.prescribe("bottom", ["left/bottom", "right/bottom"], 0, 1)
    scene.prescribe("side", "left/left", 0, 0)
    scene.prescribe("shift", "tool/top", 0, 0)
    scene.prescribe("push", "tool/top", 0, 1)
    scene.prescribe("cold", ["left/bottom", "right/bottom"], 1)
    scene.prescribe("hot", "tool/top", 1)
    heat = fm.Conductance(1, fm.PressureConductance(3.0, 5.0))
    pairs = [
        fm.ContactPair(scene.data, "tool/bottom", ["left/top", "right/top"], fluxes=[heat]),
        fm.TiedPair(scene.data, "right/left", "left/right", fields=[1]),
    ]
    problem = scene.problem(pairs, algorithm=algorithm)
    for step in (1, 2):
        scene.set(push=-0.01 * step, hot=HOT)
        report = problem.solve()
        assert report.num_iterations <= 7 and not report.certificate.violations()
    across, along = problem.contacts[0].fluxes[0], problem.contacts[1].fluxes[0]
    assert across.into_master > 0.5 and abs(along.into_master) > 1e-3
    check = problem.check_tangent(print_table=False)
    assert check.slopes["whole"] == pytest.approx(2.0, abs=0.02)


def test_prescribed_temperatures_of_the_slave_carry_no_multiplier():
    """The function of a node on a side of given temperature is handed over."""
    scene = stacked(alpha=0.0)
    scene.prescribe("side", ["upper/left", "lower/left"], 1)
    pair = fm.TiedPair(scene.data, *SIDES[0], fields=[1])
    problem = scene.problem([pair])
    scene.set(hot=3.0, cold=3.0, side=3.0)
    problem.solve()
    assert np.abs(temperature(scene)[0] - 3.0).max() < 1e-12
    tied = problem.equations.contacts[0]
    first = tied.slave.X[:, 0] < 1e-9
    assert first.any() and not tied.fluxes[0].conducts[first].any()


def test_states_with_fluxes_are_stored_and_extrapolated(shared_path):
    scene, problem = bar(overhang=0.7)
    for step in (1, 2, 3):
        scene.set(hot=HOT * step, top=-0.01 * step)
        report = problem.solve()
    assert report.converged
    fm.save_state(problem, str(shared_path / "tied.npz"))
    again, other = bar(overhang=0.7)
    fm.load_state(other, str(shared_path / "tied.npz"))
    again.set(hot=3.0 * HOT, top=-0.03)
    assert other.solve().num_iterations <= 1
    z = [p.equations.contacts[0].z for p in (problem, other)]
    assert z[0].shape[1] == 3 and np.abs(z[0] - z[1]).max() < 1e-11 * np.abs(z[0]).max()
    with fm.ResultsWriter(shared_path / "fields", problem) as results:
        results.write(1.0)
    assert "upper/bottom" in fm.contact_table(problem)


# Remarks and refusals


def test_fields_that_are_not_tied_are_named():
    for fields, named in (((), True), ([1], False)):
        scene = stacked()
        scene.prescribe("warm", "lower/top", 1)
        pair = fm.TiedPair(scene.data, *SIDES[0], fields=fields)
        notes = " ".join(scene.problem([pair]).solve().notes)
        assert ("does not tie sub-space 1" in notes and "fields=[1]" in notes) == named


@pytest.mark.parametrize("fields", [1, "1", [-1], [1.5], [1, 1], [None]])
def test_invalid_fields_are_refused(fields):
    with pytest.raises(ValueError, match="expected different numbers of sub-spaces"):
        fm.TiedPair(stacked().data, *SIDES[0], fields=fields)


def test_fields_that_cannot_be_tied_are_refused():
    for field, message in ((0, "another sub-space than the displacement's: 1"), (2, "field=2")):
        with pytest.raises(ValueError, match=message):
            bar(tie={"fields": [field]})
    scene = stacked()
    scene.prescribe("warm", "upper/bottom", 1)
    pair = fm.TiedPair(scene.data, *SIDES[0], fields=[1])
    with pytest.raises(fm.SurfaceError, match="field 1 is prescribed at every slave node"):
        scene.problem([pair])


# Derivatives

LOADS = {"hot": HOT, "top": -0.05}


def objective(**loads):
    """Integral of the squares of temperature and displacement of a tied bar."""
    scene, problem = bar(overhang=0.7, degrees=(2, 1))
    scene.set(**{**LOADS, **loads})
    problem.solve()
    u, T = ufl.split(scene.w)
    return scene, problem, (T**2 + 100.0 * ufl.inner(u, u)) * ufl.dx(degree=4)


def value(**loads):
    return comm.allreduce(fem.assemble_scalar(fem.form(objective(**loads)[2])))


def test_gradients_through_tied_fields():
    """Adjoint and directional derivatives against central differences of whole solves."""
    scene, problem, form = objective()
    controls = [scene.given[name] for name in LOADS]
    found = fm.gradient(form, controls, problem)
    for (name, load), control in zip(LOADS.items(), controls, strict=True):
        ends = [value(**{name: load * (1.0 + step)}) for step in (1e-4, -1e-4)]
        expected = (ends[0] - ends[1]) / (2e-4 * load)
        assert float(found[control]) == pytest.approx(expected, rel=1e-6)
        along = sensitivity.tangent_linear(form, control, 1.0, problem)
        assert along.derivative == pytest.approx(float(found[control]), rel=1e-10)
    with pytest.raises(fm.MortarError, match="pair 0 ties fields"):
        fm.gradient(sensitivity.TotalForce(0, (0.0, 1.0)), controls, problem)
