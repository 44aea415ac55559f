# SPDX-License-Identifier: MIT
"""Linear bulk in space on the contact dofs alone: the results of all dofs, and when it is used."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
import test_space_contact
from scenes import nodal
from space_pair_scenes import bodies
from space_pairs import KINDS, ROLES, TILTED, pressed, stack

import fenics_mortar as fm
from fenics_mortar import energies
from fenics_mortar.la.options import SPACE_COSTS
from meshes.mapped_boxes import Box, block, mapped

COMM = MPI.COMM_WORLD
MU = 0.3
PATH = [(0.0, 0.0, -0.05), (0.02, 0.01, -0.08), (0.07, 0.04, -0.08), (0.07, 0.04, 0.02)]
LAWS = pytest.mark.parametrize("law", [None, fm.Coulomb(MU)], ids=["frictionless", "Coulomb"])
# Results of both methods differ by the rounding of solves; larger ones would add up in a path.
SAME = 1e-11


def largest(values):
    return COMM.allreduce(float(np.abs(values).max(initial=0.0)), MPI.MAX)


def blocks(cell="hexahedron", degree=1, *, law=None, problem=None, **options):
    """Linear elastic blocks, pressed on each other."""
    given = {"energy": energies.linear_elastic, **options}
    return pressed(cell, degree, law=law, problem=problem, **given)


def both(make):
    """The scene that ``make`` sets up, on all dofs and on the contact dofs."""
    return [make(problem={"linear_bulk": reduced}) for reduced in (False, True)]


def results(scene):
    """Displacements in the order of the mesh, multipliers in that of positions.

    Two meshes may be partitioned differently.
    """
    contact = scene.problem.equations.contacts[0]
    return nodal(scene.problem), contact.z[np.lexsort(np.round(contact.slave.X, 7).T)]


def assert_equal(scenes, reports):
    (u, z), (w, y) = (results(scene) for scene in scenes)
    assert largest(u - w) < SAME * largest(u) and largest(z - y) <= SAME * largest(z)
    general, reduced = reports
    assert general.num_iterations == reduced.num_iterations
    assert reduced.solver.startswith("linear bulk factored once")
    assert not any("reduced iteration" in note for note in reduced.notes)
    assert reduced.certificate.violations() == []


@LAWS
@pytest.mark.parametrize("sliding", ["finite", "small"])
@pytest.mark.parametrize("cell, degree", KINDS)
def test_paths_are_those_of_all_dofs(cell, degree, sliding, law):
    """Pressed, slid, and lifted off; iterations are the same."""

    def make(**options):
        return blocks(cell, degree, law=law, pair={"sliding": sliding}, turn=TILTED, **options)

    scenes = both(make)
    for step in PATH:
        assert_equal(scenes, [scene.move(*step) for scene in scenes])


@pytest.mark.once
@pytest.mark.parametrize("options", [{"algorithm": "saddle"}, {"linearization": "frozen"}])
def test_other_linearizations_and_roles(options):
    def make(problem):
        return blocks(law=fm.Coulomb(MU), roles=ROLES[1], problem={**problem, **options})

    scenes = both(make)
    for step in PATH[:2]:
        assert_equal(scenes, [scene.move(*step) for scene in scenes])


@pytest.mark.serial
@LAWS
def test_symmetry_planes(law):
    def make(problem):
        scene = stack(sizes=((0.8, 0.7, 0.5), (1.2, 1.2, 0.5)), offset=(0.25, 0.2, -0.003),
                      poisson=0.3, energy=energies.linear_elastic).press()  # fmt: skip
        for component, side in enumerate(("left", "front")):
            scene.roll(f"upper/{side}", component)
        return scene.set_up(law, **problem)

    scenes = both(make)
    for z in (-0.05, -0.06):
        assert_equal(scenes, [scene.move(0.0, 0.0, z) for scene in scenes])


@pytest.mark.parametrize("cell, degree", KINDS)
def test_ties_of_bodies_with_supports(cell, degree):
    def make(problem):
        scene = stack(cell, degree, poisson=0.3, turn=TILTED, energy=energies.linear_elastic)
        return scene.press().set_up(tie=True, **problem)

    scenes = both(make)
    for step in ((0.05, 0.02, -0.1), (0.0, 0.02, 0.1)):
        assert_equal(scenes, [scene.move(*step) for scene in scenes])


def test_body_held_by_a_tie_alone_is_solved_on_all_dofs():
    scene = stack(energy=energies.linear_elastic)
    scene.hold("lower/bottom")
    scene.set_up(tie=True, linear_bulk=True)
    report = scene.problem.solve()
    assert any("ties alone hold a body" in note for note in report.notes)
    assert "factored in every iteration: ties alone" in report.solver


@pytest.mark.serial
@pytest.mark.parametrize("mu", [0.0, MU])
@pytest.mark.parametrize("sliding", ["finite", "small"])
@pytest.mark.parametrize("kind", ["plane", "sphere"])
def test_obstacles(kind, sliding, mu):
    """An obstacle that is translated and rotated."""
    made = []
    for reduced in (False, True):
        obstacle = test_space_contact.KINDS[kind]()
        options = {"pair": {"sliding": sliding}, "energy": energies.linear_elastic}
        scene = test_space_contact.block_under(obstacle, mu=mu, linear_bulk=reduced, **options)
        made.append((obstacle, scene))
    for way in (0.0, 0.5, 1.0):
        reports = []
        for obstacle, scene in made:
            turn = way * np.array((0.02, 0.05, -0.03))
            obstacle.move(x=0.03 * way, y=0.05 * way, z=-0.01 * way, angle=turn)
            reports.append(scene.problem.solve())
        assert_equal([scene for _, scene in made], reports)


def graded_tip(problem):
    """A ball on a block; facets at its tip are much smaller than its displacement."""

    def position(s, t, r):
        x, y = (0.5 * (2.0 * each - 1.0) ** 3 for each in (s, t))
        return x, y, (1.0 - np.sqrt(1.0 - x**2 - y**2)) * (1.0 - r**2) + 0.8 * r**2

    lower = block((4, 4, 3), size=(1.4, 1.4, 1.0), corner=(-0.7, -0.7, -1.0))
    boxes = [Box("upper", mapped((8, 8, 3), position)), Box("lower", lower)]
    held, pairs = ["upper/top", "lower/bottom"], [("upper/bottom", "lower/top")]
    return bodies(boxes, held, pairs, energy=energies.linear_elastic, **problem)


def test_steps_that_would_invert_cells_are_shortened_as_on_all_dofs():
    """One node touches at first."""
    scenes = both(graded_tip)
    reports = [scene.move("upper/top", (0.0, 0.0, -0.08)).solve() for scene in scenes]
    fractions = [[it.fraction for it in report.iterations] for report in reports]
    assert min(fractions[0]) < 1.0
    assert fractions[0] == fractions[1]
    u, w = (nodal(scene.problem) for scene in scenes)
    assert largest(u - w) < 1e-9 * largest(u)


@pytest.mark.serial
def test_choice_follows_from_the_active_nodes(monkeypatch):
    """Dense systems of up to 30 nodes are predicted to be faster; 81 nodes may become active.

    Initial guesses are extrapolated: that of the third step has 36 active nodes already.
    """
    costs = replace(SPACE_COSTS, once=0.0, dense=0.0, per_entry=0.0)
    iteration = costs.factors(graded_tip({}).problem.equations.bulk.r.getSize(), 1)
    costs = replace(costs, per_solve=1e6 * iteration / (9 * 30) ** 3)
    monkeypatch.setattr("fenics_mortar.equations.reduced.costs_of", lambda dim: costs)
    scene, chosen = graded_tip({}), []
    for depth in (0.01, 0.02, 0.04, 0.04, 0.02, 0.01):
        solver = scene.move("upper/top", (0.0, 0.0, -depth)).solve().solver
        chosen.append("factored once" in solver)
        assert chosen[-1] or "are many" in solver
    assert chosen == [False, True, False, False, False, True]


@pytest.mark.usefixtures("several_ranks")
@LAWS
def test_results_are_those_of_one_rank(law):
    """Also with fewer cells than ranks."""
    for counts in ((3, 2, 1), (1, 1, 1)):
        found = []
        for comm in (COMM, MPI.COMM_SELF):
            problem = {"linear_bulk": True}
            scene = blocks(law=law, comm=comm, upper=counts, lower=counts, problem=problem)
            reports = [scene.move(*step) for step in PATH[:2]]
            assert all("factored once" in report.solver for report in reports)
            contact = scene.contact
            order = np.lexsort(np.round(contact.positions, 7).T)
            fields = [contact.pressure, contact.shear, contact.slip, contact.gap]
            iterations = [report.num_iterations for report in reports]
            found.append((iterations, [np.nan_to_num(field[order]) for field in fields]))
        (one, fields), (other, alone) = found
        assert one == other
        for field, expected in zip(fields, alone, strict=True):
            assert np.abs(field - expected).max() < 1e-9 * max(1.0, np.abs(expected).max())
