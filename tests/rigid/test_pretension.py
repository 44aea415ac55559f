# SPDX-License-Identifier: MIT
"""Sections under pretension: bolt and plates as two springs."""

import numpy as np
import pytest
from refusal import refused
from remote_scenes import joint
from scenes import internal, linear_elastic, neo_hookean, nodal

from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_grids import Grid, block, mesh

PRELOAD, EXTERNAL = 0.2, 0.15


def tightened(material=linear_elastic, **options):
    """The joint after tightening, with a free top."""
    problem, bolt, top, stiffness = joint(material, fm.RigidBoundary, **options)
    top.push(y=0.0)
    bolt.push(PRELOAD)
    report = problem.solve()
    assert report.certificate.violations() == []
    return problem, bolt, top, stiffness, report


def test_bolt_and_plates_share_an_external_load_as_two_springs():
    """Bars without Poisson's effect: stiffness, shortening and F_0 + F k_b / (k_b + k_p)."""
    problem, bolt, top, (k_b, k_p), report = tightened()
    assert bolt.force == pytest.approx(PRELOAD, rel=1e-12)
    assert bolt.shortening == pytest.approx(PRELOAD * (1.0 / k_b + 1.0 / k_p), rel=1e-11)
    assert problem.contacts[1].total_force[1] == pytest.approx(PRELOAD, rel=1e-11)
    assert any("section 'bolt', shortened by" in note for note in report.notes)
    bolt.lock()
    top.push(y=EXTERNAL)
    problem.solve()
    assert bolt.force == pytest.approx(PRELOAD + EXTERNAL * k_b / (k_b + k_p), rel=1e-11)
    top.push(y=2.0)  # the plates separate: the bolt carries the load alone
    problem.solve()
    assert bolt.force == pytest.approx(2.0, rel=1e-11)
    assert not problem.contacts[1].pressure.any()


def clamp(above, below, law=None, material=linear_elastic):
    """A bolt of two halves, with a head each, around a plate with gaps below both heads.

    Returns:
        The problem, the section and the two seats.
    """
    x, y = np.linspace(0.0, 3.0, 4), np.linspace(0.0, 3.0, 4)
    half = np.stack(np.meshgrid(x, y, indexing="ij"), axis=2)

    def part(sign):
        shank, head = half[:2, :3] * [1.0, sign], half[:, 2:] * [1.0, sign]
        return [grid if sign > 0 else grid[:, ::-1] for grid in (shank, head)]

    (shank, head), (lower, foot) = part(1.0), part(-1.0)
    plate = block(4, 4, width=3.0, height=4.0 - above - below, corner=(1.2, -2.0 + below))
    names = {"left": "axis"}
    grids = [
        Grid("shank", shank, names), Grid("head", head, names), Grid("lower", lower, names),
        Grid("foot", foot, names), Grid("plate", plate),
    ]  # fmt: skip
    data = mesh(grids)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, "axis", 0.0, 0), fm.dirichlet(V, data, "plate/right", (0.0, 0.0))]
    bolt = fm.Pretension(data, "shank/bottom", "lower/top", name="bolt")
    joints = [fm.TiedPair(data, "shank/top", "head/bottom", search_radius=0.1)]
    joints += [fm.TiedPair(data, "lower/bottom", "foot/top", search_radius=0.1)]
    sides = ("plate/top", "head/bottom"), ("plate/bottom", "foot/top")
    seats = [fm.ContactPair(data, *side, law=law or fm.Frictionless()) for side in sides]
    residual = internal(u, material(u, 100.0, 0.3))
    problem = fm.ContactProblem(
        residual, u, [bolt, *joints, *seats], bcs=bcs, petsc_options_prefix="clamp_"
    )
    return problem, bolt, problem.contacts[-2:]


@pytest.mark.parametrize("law", [None, fm.Coulomb(0.2)], ids=str)
@pytest.mark.parametrize("gaps", [(0.1, 0.0), (0.7, 0.9)], ids=str)
def test_bolt_whose_heads_do_not_touch_is_tightened_by_its_force(law, gaps):
    """Both halves are moved until they touch; the same state as if a shortening had closed them."""
    problem, bolt, seats = clamp(*gaps, law, neo_hookean)
    bolt.push(0.5)
    report = problem.solve()
    assert any("'shank' was moved rigidly" in note for note in report.notes)
    assert not any("cross" in note for note in report.notes), report.notes
    assert bolt.force == pytest.approx(0.5, rel=1e-10)
    forces = [seat.total_force[1] for seat in seats]
    assert forces == pytest.approx([-0.5, 0.5], rel=1e-9)
    assert sum(gaps) < bolt.shortening < sum(gaps) + 0.1
    assert min(problem.check_tangent(print_table=False).slopes.values()) > 1.95
    if gaps[1] == 0.0:
        other, moved, _ = clamp(*gaps, law, neo_hookean)
        moved.move(bolt.shortening)
        other.solve()
        assert moved.force == pytest.approx(0.5, rel=1e-9)


def test_push_that_nothing_resists_names_section_and_body():
    """Before and after contact; a motion that is prescribed again is not checked as a free one."""
    problem, bolt, seats = clamp(0.1, 0.2)
    bolt.push(-0.1)
    with pytest.raises(fm.MortarError, match="'shank' can be pulled apart at section 'bolt'"):
        problem.solve()
    bolt.push(0.5)
    problem.solve()
    state = problem.state()
    bolt.push(-0.1)
    with pytest.raises(fm.MortarError, match="'shank'.*section 'bolt'"):
        problem.solve()
    problem.restore(state)
    bolt.lock()
    assert problem.solve().certificate.violations() == []
    assert seats[0].total_force[1] == pytest.approx(-0.5, rel=1e-9)


def test_shortening_and_force_have_the_same_solution():
    """At finite strain: the force to a prescribed shortening is pushed."""
    problem, bolt, *_, report = tightened(neo_hookean)
    residuals = report.residuals
    assert residuals[-1] < 1e-4 * residuals[-2] < 1e-8 * residuals[-3]
    other, moved, lid, _ = joint(neo_hookean, fm.RigidBoundary)
    lid.push(y=0.0)
    moved.move(bolt.shortening)
    other.solve()
    assert moved.force == pytest.approx(PRELOAD, rel=1e-10)
    assert np.abs(nodal(other) - nodal(problem)).max() < 1e-12


def test_tangent_has_slopes_of_two():
    """With driven shortening and driven top."""
    problem, *_ = tightened(neo_hookean, inset=0.1)
    slopes = problem.check_tangent(print_table=False).slopes
    assert min(slopes.values()) > 1.95, slopes


def test_state_and_checkpoint_contain_the_shortening(tmp_path):
    """Also the jump of the tie follows."""
    problem, bolt, *_ = tightened()
    fm.save_state(problem, tmp_path / "state")
    other, own, lid, _ = joint(linear_elastic, fm.RigidBoundary)
    fm.load_state(other, tmp_path / "state")
    assert own.shortening == bolt.shortening and own.present_jump()[1] == -bolt.shortening
    assert own.force == pytest.approx(PRELOAD, rel=1e-10)
    state = problem.state()
    bolt.push(0.5 * PRELOAD)
    problem.solve()
    problem.restore(state)
    assert bolt.force == pytest.approx(PRELOAD, rel=1e-10)
    bolt.push(PRELOAD)
    own.lock()
    lid.push(y=0.0)
    other.solve()
    assert own.force == pytest.approx(PRELOAD, rel=1e-10)


def test_axis_is_the_normal_of_the_slave_or_given():
    """An inclined axis is scaled; a section that is not straight needs one."""
    _, bolt, *_ = joint(linear_elastic, fm.RigidBoundary)
    assert bolt.axis == pytest.approx((0.0, -1.0), abs=1e-15)
    data = bolt.data
    given = fm.Pretension(data, "bolt/bottom", "nut/top", axis=(3.0, -4.0))
    given.move(0.5)
    assert given.present_jump() == pytest.approx((0.3, -0.4))
    with refused(ValueError, "axis is zero"):
        fm.Pretension(data, "bolt/bottom", "nut/top", axis=(0.0, 0.0))
    with refused(ValueError, "has no option 'jump'"):
        fm.Pretension(data, "bolt/bottom", "nut/top", jump=(0.0, 0.0))
    with refused(ValueError, "force"):
        given.push(np.nan)
