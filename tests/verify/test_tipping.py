# SPDX-License-Identifier: MIT
"""Bodies whose loads act beyond the edge that they stand on, within a slave facet."""

import pytest
from supported_parts import Body, Touch
from supported_problem import pose

import fenics_mortar as fm
from meshes.mapped_grids import Grid, block


def overhanging(centre, **options):
    """A block of five facets, its weight at x = ``centre``, on a clamped one that ends at x = 1."""
    upper = Grid("upper", block(5, 2, width=1.0, height=0.4, corner=(centre - 0.5, 0.5)))
    base = Grid("base", block(4, 2, width=1.0, height=0.5))
    touch = Touch("upper/bottom", "base/top", fm.Coulomb(0.9))
    bodies = [Body(upper, weight=1.0, push=1.0), Body(base, clamped=("bottom",))]
    return pose("overhanging", bodies, [touch], [{"weight": 1.0}], **options)


@pytest.mark.parametrize("turn", [0.0, 2.0])
def test_a_body_is_not_supported_beyond_the_edge_of_the_other_one(turn):
    """A facet ends at 1.13; only there could the mesh balance the weight."""
    scene = overhanging(1.03, turn=turn)
    with pytest.raises(fm.NotConvergedError, match="cannot balance body 'upper'.*can rotate"):
        list(scene.solve())


@pytest.mark.serial
def test_a_body_that_tips_off_an_edge_is_not_said_to_exceed_its_friction():
    """Its weight, 0.02 beyond the edge, is within the last facet, so that the mesh may hold it."""
    upper = Grid("upper", block(4, 2, width=0.8, height=0.3, corner=(0.82, 0.3)))
    base = Grid("base", block(6, 2, width=1.2, height=0.3))
    touch = Touch("upper/bottom", "base/top", fm.Coulomb(0.9))
    bodies = [Body(upper, weight=1.5), Body(base, clamped=("bottom",))]
    scene = pose("off_the_edge", bodies, [touch], [{"weight": 1.0}], E=1e3)
    reason = "body 'upper' tips over, which no friction can prevent"
    with pytest.raises(fm.NotConvergedError, match=reason) as error:
        list(scene.solve())
    assert "friction limit" not in str(error.value)


def test_a_body_is_supported_up_to_the_edge():
    scene = overhanging(0.97)
    (report,) = scene.solve()
    assert report.certificate.violations() == [] and scene.largest() < 1e-2


def test_pressures_borne_by_another_pair_are_no_violation():
    """The same block, its other end below a ceiling: nothing tips."""
    upper = Grid("upper", block(5, 2, width=1.0, height=0.4, corner=(0.53, 0.5)))
    base = Grid("base", block(4, 2, width=1.0, height=0.5))
    ceiling = Grid("ceiling", block(2, 2, width=0.4, height=0.3, corner=(0.4, 0.9)))
    touches = [Touch("upper/bottom", "base/top"), Touch("upper/top", "ceiling/bottom")]
    clamped = [Body(base, clamped=("bottom",)), Body(ceiling, clamped=("top",))]
    scene = pose("below", [Body(upper, weight=1.0), *clamped], touches, [{"weight": 1.0}])
    (report,) = scene.solve()
    assert report.certificate.tipping == []


@pytest.mark.serial
def test_a_path_ends_where_a_body_tips_and_the_certificate_is_that_of_its_last_state():
    """The resultant is at the edge under a push of 0.5, and 0.05 facets beyond it under 0.55."""
    scene = overhanging(0.9)
    options = fm.SteppingOptions(step=0.2, smallest=0.005)
    with pytest.raises(fm.NotConvergedError) as error:
        fm.follow_path(scene.problem, lambda push: scene.set(weight=1.0, push=push), options)
    assert 0.49 < error.value.report.steps[-1].time < 0.56
    assert scene.problem.certificate().violations() == []
