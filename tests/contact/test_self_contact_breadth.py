# SPDX-License-Identifier: MIT
"""Self-contact in problems beyond plane statics.

The ends of a C-ring are closed by chosen sides, and as two surfaces that may touch: roles are
equal, so that all numbers agree up to rounding; chosen sides are verified elsewhere.
"""

from functools import partial

import numpy as np
import pytest
import revolved
from scenes import internal, linear_elastic, nodal
from self_scenes import NU, E, c_ring, honeycomb, ten_bodies

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import laws
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block

MU = fm.Coulomb(0.3)
ENDS = ["ring/first", "ring/last"]
RING = [*ENDS, "ring/top", "ring/bottom"]


def torus(u):
    return revolved.internal(u, revolved.neo_hookean(u, E, NU))


def linear(u):
    return internal(u, linear_elastic(u, E, NU))


def ring_of(sides, pair=None, law=None, **options):
    pair = pair or {}
    return c_ring(lambda data: [fm.ContactPair(data, *sides, law=law, **pair)], **options)


def close(sides, displacement=(0.01, -0.18), **options):
    """A ring whose ends are pressed together and along each other, two facets along."""
    ring = ring_of(sides, **options)
    ring.move(5, high=np.array(displacement))
    return ring


def compare(slope=2.0, **options):
    """Compare chosen and found sides; the whole outline has a certificate without violations."""
    chosen, found, whole = (close(s, **options) for s in (ENDS, [ENDS], [RING]))
    assert chosen.contact.active.sum() >= 3
    assert found.contact.active.sum() == chosen.contact.active.sum()
    assert np.allclose(*(nodal(s.problem) for s in (found, chosen)), atol=1e-11)
    assert found.forces() == pytest.approx(chosen.forces(), rel=1e-9)
    assert whole.forces() == pytest.approx(chosen.forces(), rel=0.15)
    for ring in (found, whole):
        assert ring.problem.certificate().violations() == []
        measured = ring.problem.check_tangent().slopes["whole"]
        assert not measured < slope - 0.05
    return found


AXISYMMETRIC = {"residual": torus, "centre": 3.0, "problem": {"geometry": "axisymmetric"}}
LINEAR = {"residual": linear, "displacement": (0.005, -0.14), "problem": {"linear_bulk": True}}
SMALL = {"pair": {"sliding": "small"}, "displacement": (0.005, -0.14)}
CASES = {
    "axisymmetric": {"law": MU, **AXISYMMETRIC},
    "linear bulk": {"law": MU, **LINEAR},
    "small sliding": {"law": MU, **SMALL},
    "linear bulk and small sliding": {**LINEAR, **SMALL},
    "compliance": {"law": laws.SoftLayer(2000.0, 1.0, 0.2)},
    "Stribeck": {"law": laws.Stribeck(0.4, 0.2, 0.05)},
    "rate and state": {"law": laws.RateAndState(0.3, 0.01, 0.015, 0.02, 0.01)},
    "axisymmetric, compliance": {"law": laws.SoftLayer(2000.0, 1.0, 0.2), **AXISYMMETRIC},
}


@pytest.mark.serial
@pytest.mark.parametrize("name", CASES)
def test_found_sides_agree_with_chosen_ones(name):
    compare(**CASES[name])


@pytest.mark.serial
def test_a_surface_in_contact_with_itself_wears():
    """Sticking nodes are at a kink of |slip|, so that the tangent has the slope of one side."""
    found = compare(law=laws.Worn(0.3, 1e-2), slope=1.0)
    assert found.contact.state.accepted_instant.memory["depth"].max() > 0.0


@pytest.mark.serial
@pytest.mark.parametrize("scheme", ["generalized_alpha", "massless", "conserving"])
def test_found_sides_agree_with_chosen_ones_in_dynamics(scheme):
    """With "massless", found sides have no mass on both sides: results are nearly equal."""
    found = []
    for sides in (ENDS, [ENDS]):
        ring = ring_of(sides, law=MU)
        motion = fm.Dynamics(ring.problem, 1e-3, scheme=scheme)

        def load(time, ring=ring):
            ring.moved["high"].value[:] = time * np.array([0.005, -0.14])

        motion.run(1.0, fm.SteppingOptions(step=0.1, smallest=1e-4), load)
        assert ring.contact.active.sum() >= 3
        assert ring.problem.certificate().violations() == []
        assert ring.problem.check_tangent().slopes["whole"] == pytest.approx(2.0, abs=0.05)
        found.append(ring.u.x.array.copy())
    allowed = 1e-11 if scheme == "generalized_alpha" else 1e-3
    assert np.abs(found[0] - found[1]).max() < allowed


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"solver": "iterative"}, "'ring/first . ring/last' is in contact with itself"),
        ({"algorithm": "condensed"}, "use algorithm='saddle'"),
    ],
)
def test_solvers_that_need_separate_sides_are_refused(option, message):
    with pytest.raises(ValueError, match=message):
        ring_of([ENDS], problem=option)


def test_forces_of_one_body_of_a_list_do_not_load_the_others():
    """Only multipliers of its nodes and of nodes that face it act on a body."""
    stack = ten_bodies(lambda data, names: [fm.ContactPair(data, names)], foundation=0.0)
    stack.problem.solve()
    floating, contact = stack.problem.equations.floating, stack.contact
    assert len(floating.bodies) == 10
    pressures = np.zeros((contact.slave.num_nodes, 2))
    touched = np.hypot(*(contact.slave.X - [0.5, 0.0]).T).argmin()
    pressures[touched] = contact.operators.n[touched]
    contact.change(z=pressures)
    assert sum(body.is_loaded() for body in floating.bodies) == 1


@pytest.mark.once
@pytest.mark.serial
def test_a_honeycomb_is_compressed_through_its_folding():
    """Cells fold, then their walls meet: contact within cells, with friction, at six tenths."""
    comb = honeycomb(partial(walls, law=MU))
    height = np.ptp(comb.contact.slave.X[:, 1])
    path = comb.move(14, high=np.array([0.0, -0.6 * height]))
    contact = comb.contact
    assert path.num_cuts == 0
    assert comb.problem.certificate().violations() == []
    assert contact.active.sum() >= 15 and contact.sticking.any()
    assert comb.problem.check_tangent().slopes["whole"] == pytest.approx(2.0, abs=0.05)


def walls(data, law):
    return [fm.ContactPair(data, "comb/walls", law=law)]


@pytest.mark.once
@pytest.mark.serial
def test_ten_free_bodies_are_compressed_far():
    """A corner that touches two bodies has a multiplier for each of two lists of sides."""

    def pairs(data, sides):
        return [fm.ContactPair(data, names, law=MU) for names in sides]

    stack = ten_bodies(pairs, seed=2, foundation=0.0, joined=False)
    motion = fm.Dynamics(stack.problem, 1.0, scheme="generalized_alpha", rho_inf=0.0)

    def load(time):
        stack.moved["high"].value[:] = 0.0, -0.1 * time

    report = motion.run(4.0, fm.SteppingOptions(step=0.1, smallest=0.02), load)
    level, upright = stack.problem.equations.contacts
    assert report.num_iterations < 6 * len(report.steps)
    assert stack.problem.certificate().violations() == []
    assert level.active.sum() > 80 and upright.active.sum() > 10
    twice = (c.slave.nodes[c.may_carry] for c in (level, upright))
    assert np.intersect1d(*twice).size == 40


def problem_with_masters(*parts):
    """A block on a block whose upper and right sides are divided into named parts."""
    lower = block(4, 2, width=1.0, height=0.5)
    upper = block(3, 2, width=1.0, height=0.5, corner=(0.0, 0.5))
    arrays = mapped_grids.arrays([Grid("lower", lower), Grid("upper", upper)])
    top = arrays["boundaries"].pop("lower/top")
    arrays["boundaries"] |= {"lower/first": top[:2], "lower/last": top[2:]}
    data = fm.mesh_from_arrays(**arrays)
    u = fem.Function(fm.vector_space(data.mesh, 1))
    residual = internal(u, linear_elastic(u, E, NU))
    pairs = [fm.ContactPair(data, "upper/bottom", f"lower/{part}") for part in parts]
    bcs = [fm.dirichlet(u.function_space, data, "lower/bottom", (0.0, 0.0))]
    return fm.ContactProblem(residual, u, pairs, bcs=bcs, petsc_options_prefix="test_parts_")


def test_two_pairs_may_share_slave_nodes_where_masters_meet_at_a_corner():
    assert len(problem_with_masters("last", "right").contacts) == 2
    with pytest.raises(fm.SurfaceError, match="4 nodes are slaves of 'lower/first' in two pairs"):
        problem_with_masters("first", "last")
