# SPDX-License-Identifier: MIT
"""Small sliding in space: one set of operators, an exact tangent, second-order differences."""

import re

from mpi4py import MPI

import numpy as np
import pytest
from scenes import nodal
from scipy.spatial.transform import Rotation
from space_pairs import KINDS, TILTED, pressed, slopes, stack
from test_space_tangents import LAWS as ALL_LAWS

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from fenics_mortar.interface.space_mortar import evaluate_space

COMM = MPI.COMM_WORLD
MU = 0.3
SIZES = ((0.8, 0.7, 0.5), (1.6, 1.6, 0.5))
SMALL = {"sliding": "small"}
PATH = [(0.0, 0.0, -0.02), (0.01, 0.004, -0.02), (0.01, 0.004, 0.02), (0.0, 0.0, -0.03)]
LAWS = pytest.mark.parametrize("law", [None, fm.Coulomb(MU)], ids=["frictionless", "Coulomb"])


def small_blocks(cell="hexahedron", degree=1, *, law=None, problem=None, **options):
    """Linear elastic blocks, pressed on each other; small strains, small sliding."""
    given = {"energy": energies.linear_elastic, "pair": SMALL, **options}
    return pressed(cell, degree, law=law, problem=problem, **given)


def largest(values):
    return COMM.allreduce(float(np.abs(values).max(initial=0.0)), MPI.MAX)


@LAWS
@pytest.mark.parametrize("cell, degree", KINDS)
def test_tangent_is_exact(cell, degree, law):
    """All is linear but the direction of friction: without it the remainders are rounding.

    Nodes slide by more than the steps of the Taylor test.
    """
    scene = small_blocks(cell, degree, law=law, turn=TILTED)
    scene.move(0.0, 0.0, -0.05)
    scene.move(0.04, 0.025, -0.055)
    found = slopes(scene)
    whole = found.pop("whole")
    assert all(slope == np.inf for slope in found.values()), found
    assert whole == np.inf if law is None else abs(whole - 2.0) < 0.05
    assert law is None or (scene.contact.status == "slip").any()


@pytest.mark.once
@pytest.mark.parametrize("name", ALL_LAWS, ids=lambda name: name.replace(" ", "_"))
def test_tangents_of_all_laws(name):
    """With bodies of finite strain; rows of laws have no slope where they are linear."""
    newton = fm.NewtonOptions(residual_tolerance=1e-9)
    scene = pressed(law=ALL_LAWS[name], pair=SMALL, problem={"newton": newton})
    for time, place in enumerate(((0.0, 0.0, -0.05), (0.04, 0.025, -0.055)), 1):
        scene.problem.time = float(time)
        scene.move(*place)
    found = slopes(scene)
    assert scene.contact.active.any()
    assert all(abs(found[block] - 2.0) < 0.05 for block in ("bulk", "whole")), found
    assert all(found[block] == np.inf for block in ("n", "g", "D", "M")), found


def test_systems_agree_and_sets_of_frictionless_contact_take_few_iterations():
    scenes = [small_blocks(problem={"algorithm": a}) for a in ("condensed", "saddle")]
    for number, step in enumerate(PATH):
        reports = [scene.move(*step) for scene in scenes]
        assert len({report.num_iterations for report in reports}) == 1
        assert all(report.num_iterations <= 4 for report in reports)
        assert number == 0 or not any(report.notes for report in reports)  # the overlap is told
        one, other = (nodal(scene.problem) for scene in scenes)
        assert largest(one - other) < 1e-9 * largest(one)
        assert (scenes[0].contact.pressure > 0.0).any() == (step[2] < 0.0)


@LAWS
def test_operators_are_evaluated_once(law, monkeypatch):
    """Also of bodies with finite strains."""
    calls, where = [], "fenics_mortar.contact.interface.evaluate_space"
    monkeypatch.setattr(where, lambda *a: calls.append(1) or evaluate_space(*a))
    scene = pressed(law=law, pair=SMALL)
    for step in PATH:
        scene.move(*step)
    assert len(calls) == 1


def test_forces_balance_and_the_gap_is_their_dual():
    """The work of unit pressures is minus the change of the weighted gaps."""
    scene = small_blocks(turn=TILTED, law=fm.Coulomb(MU))
    scene.move(*PATH[0])
    contact = scene.problem.equations.contacts[0]
    rng, o = np.random.default_rng(0), contact.operators
    p = rng.uniform(0.0, 1.0, contact.slave.num_nodes)
    u, w = (rng.uniform(-1.0, 1.0, (s.num_nodes, 3)) for s in (contact.slave, contact.master))
    on_slave, on_master = o.force(p[:, None] * o.n)
    work = (on_slave * u).sum() + (on_master * w).sum()
    assert p @ (o.after_small_motion(o.x + u, o.m + w).gap - o.gap) == pytest.approx(-work, 1e-12)
    on_slave, on_master = o.force(contact.z)
    total = np.abs(on_slave).sum()
    assert total > 0.0
    assert np.abs(on_slave.sum(axis=0) + on_master.sum(axis=0)).max() < 1e-12 * total


@pytest.mark.once
@LAWS
def test_differs_from_finite_sliding_in_second_order(law):
    """Flat bodies that touch: halved loads leave a quarter of the difference."""
    differences = []
    for factor in (1.0, 0.5):
        found = []
        for sliding in ("small", "finite"):
            scene = small_blocks(law=law, pair={"sliding": sliding}, offset=(0.25, 0.2, 0.0))
            for motion in (0.0, 0.0, -0.01), (0.004, 0.003, -0.01):
                scene.move(*(factor * np.array(motion)))
            found.append(nodal(scene.problem))
        differences.append(largest(found[0] - found[1]))
    assert 3.0 < differences[0] / differences[1] < 5.0


@pytest.mark.parametrize("angle", [0.0, 35.0])
def test_friction_is_along_the_pull(angle):
    """Two tangential components: |T| = mu N against the motion, slip is the motion itself."""
    along = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.0])
    options = {"sizes": SIZES, "offset": (0.3, 0.25, 0.0), "lower": (3, 3, 1), "poisson": 0.3}
    scene = stack(energy=energies.linear_elastic, **options)
    scene.hold("lower/top")
    scene.press().set_up(fm.Coulomb(MU), pair=SMALL)
    for way in (0.0, 0.1, 0.15, 0.2):
        scene.move(*(way * along - [0.0, 0.0, 0.02]))
    contact, force = scene.contact, scene.contact.total_force
    assert (contact.status[contact.active] == "slip").all()
    assert np.abs(force[:2] + MU * force[2] * along[:2]).max() < 1e-3 * MU * force[2]
    assert np.abs(contact.slip[contact.active] - 0.05 * along).max() < 1e-3 * 0.05


@pytest.mark.parametrize(
    "degrees, law", [(3.0, fm.Coulomb(MU)), (3.0, None), (0.5, fm.Coulomb(MU))]
)
@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0)], ids=["tilted", "spun"])
def test_rotated_surfaces_are_told(degrees, law, axis):
    """Forces are off by the angle; about the normal with friction alone, which has a direction."""
    scene = stack(sizes=SIZES, offset=(0.3, 0.25, 0.0), poisson=0.3)
    V = scene.u.function_space
    R = Rotation.from_rotvec(np.radians(degrees) * np.array(axis)).as_matrix()
    ends = {side: fem.Function(V) for side in ("lower/bottom", "upper/top")}
    scene.bcs = [fm.dirichlet(V, scene.data, side, end) for side, end in ends.items()]
    scene.set_up(law, pair=SMALL, newton=fm.NewtonOptions())
    scene.u.interpolate(lambda x: R @ x - x)
    for side, end in ends.items():
        push = -0.01 * R[:, 2] * (side == "upper/top")
        end.interpolate(lambda x, push=push: R @ x - x + push[:, None])
    notes = scene.problem.solve(accept_violations=True).notes
    told = re.findall(r"has rotated by ([\d.]+) degrees", " ".join(notes))
    assert len(told) == (degrees > 1.2 and (law is not None or axis[0] > 0.0))
    assert all(abs(float(angle) - degrees) < 0.3 for angle in told)


@pytest.mark.usefixtures("several_ranks")
@LAWS
def test_results_are_those_of_one_rank(law):
    """Also with fewer cells than ranks."""
    for counts in ((3, 2, 1), (1, 1, 1)):
        found = []
        for comm in (COMM, MPI.COMM_SELF):
            scene = small_blocks(law=law, comm=comm, upper=counts, lower=counts)
            iterations = [scene.move(*step).num_iterations for step in PATH[:2]]
            contact = scene.contact
            order = np.lexsort(np.round(contact.positions, 7).T)
            fields = [contact.pressure, contact.shear, contact.slip, contact.gap]
            found.append((iterations, [np.nan_to_num(field[order]) for field in fields]))
        (one, fields), (other, alone) = found
        assert one == other
        for field, expected in zip(fields, alone, strict=True):
            assert np.abs(field - expected).max() < 1e-9 * max(1.0, np.abs(expected).max())
