# SPDX-License-Identifier: MIT
"""Sections under pretension: bolt and plates as two springs."""

import numpy as np
import pytest
from refusal import refused
from remote_scenes import joint
from scenes import linear_elastic, neo_hookean, nodal

import fenics_mortar as fm

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
