# SPDX-License-Identifier: MIT
"""Both linear systems: equal iterates, Dirichlet conditions on contact surfaces, several pairs."""

import gc
import resource
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

import gmsh
import numpy as np
import pytest
from scenes import TIGHT, internal, linear_elastic, neo_hookean, nodal, pressed_blocks, read

from dolfinx import fem

import fenics_mortar as fm
from meshes import two_blocks

comm = MPI.COMM_WORLD
MESH = {"n_upper": 7, "n_lower": 11, "layers_upper": 4, "layers_lower": 4}


def largest(values):
    return comm.allreduce(float(np.abs(values).max(initial=0.0)), MPI.MAX)


@pytest.mark.once
@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("linearization", ["full", "no_normals", "no_segments", "frozen"])
def test_saddle_and_condensed_system_have_the_same_iterates(slave, linearization):
    scenes = []
    for algorithm in ("saddle", "condensed"):
        options = {"algorithm": algorithm, "linearization": linearization}
        scene = pressed_blocks(slave=slave, problem=options, **MESH)
        scene.loads["push"].value[:] = (0.02, -0.08)
        scene.problem.equations.evaluate(start=True)
        scenes.append(scene)
    one, other = scenes
    for _ in range(4):
        for scene in scenes:
            scene.problem.equations.advance()
            scene.problem.equations.evaluate(start=False)
        u, w = nodal(one.problem), nodal(other.problem)
        assert largest(u - w) < 1e-12 * largest(u)  # to rounding, at each iteration
        assert largest(one.contact.z - other.contact.z) < 1e-12 * largest(one.contact.z)
        assert np.array_equal(one.contact.active, other.contact.active)


@pytest.mark.once
@pytest.mark.parametrize("algorithm", ["saddle", "condensed"])
def test_half_model_with_a_symmetry_plane_agrees_with_the_full_model(algorithm):
    """Half of a symmetric scene with u_x = 0 on the plane has the pressures of the whole."""
    whole = pressed_blocks(problem={"algorithm": algorithm}, cell="quadrilateral", **HALF["whole"])
    whole.loads["push"].value[1] = -0.05
    whole.problem.solve()
    data = read(two_blocks.build, cell="quadrilateral", **HALF["half"])
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [
        fm.dirichlet(V, data, "lower/bottom", np.zeros(2)),
        fm.dirichlet(V, data, "upper/top", np.array([0.0, -0.05])),
        fm.dirichlet(V, data, ["upper/left", "lower/left"], 0.0, component=0),
    ]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    half = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)),
        u,
        [pair],
        bcs=bcs,
        petsc_options_prefix="half_",
        algorithm=algorithm,
        newton=TIGHT,
    )
    half.solve()
    z, exact = (
        half.equations.contacts[0].pressure,
        whole.contact.pressure[-half.equations.contacts[0].slave.num_nodes :],
    )
    assert largest(z - exact) < 1e-11 * largest(exact)


HALF = {
    "whole": {"n_upper": 8, "n_lower": 12, "width_upper": 1.0, "width_lower": 2.0},
    "half": {"n_upper": 4, "n_lower": 6, "width_upper": 0.5, "width_lower": 1.0, "offset": 0.0},
}


@pytest.mark.once
@pytest.mark.parametrize("algorithm", ["saddle", "condensed"])
def test_node_with_prescribed_displacement_has_no_multiplier(algorithm):
    scene = pressed_blocks(problem={"algorithm": algorithm}, **MESH)
    V, data = scene.u.function_space, scene.data
    bcs = [
        *scene.problem.equations.bulk.bcs,
        fm.dirichlet(V, data, ["upper/left"], np.array([0.0, -0.05])),
    ]
    u = fem.Function(V)
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)),
        u,
        [fm.ContactPair(data, "upper/bottom", "lower/top")],
        bcs=bcs,
        petsc_options_prefix="test_",
        algorithm=algorithm,
        newton=TIGHT,
    )
    scene.loads["push"].value[1] = -0.05
    problem.solve()
    contact = problem.equations.contacts[0]
    assert not contact.multiplier_nodes[0] and contact.multiplier_nodes[1:].all()
    assert np.abs(contact.z[0]).max() == 0.0
    forces = contact.operators.force(contact.z)
    assert np.abs(forces[0].sum(axis=0) + forces[1].sum(axis=0)).max() < 1e-13
    assert np.abs(forces[0][0]).max() > 0.0  # the neighbour's weight reaches the fixed node


@pytest.mark.parametrize("algorithm", [None, "saddle"])
def test_oblique_normal_acts_on_a_vertically_guided_body(algorithm):
    """The upper block is fixed sideways: the force acts along the normal nevertheless."""
    data = read(two_blocks.build, inclination=np.radians(25), **MESH)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    Vx = V.sub(0)
    data.mesh.topology.create_connectivity(2, 2)
    upper = data.cell_tags.find(data.body_tag("upper"))
    sideways = fem.locate_dofs_topological(Vx, 2, upper)
    bcs = [
        fm.dirichlet(V, data, "lower/bottom", np.zeros(2)),
        fm.dirichlet(V, data, "upper/top", -0.05, component=1),
        fem.dirichletbc(PETSc.ScalarType(0), sideways, Vx),
    ]
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, 100.0, 0.3)),
        u,
        [fm.ContactPair(data, "upper/bottom", "lower/top")],
        bcs=bcs,
        petsc_options_prefix="oblique_",
        algorithm=algorithm,
    )
    problem.solve()
    contact = problem.equations.contacts[0]
    assert contact.multiplier_nodes.all() and contact.oblique.all()
    tangential = np.einsum("jc,jc->j", contact.operators.tau, contact.z)
    assert np.abs(tangential).max() < 1e-12 * np.abs(contact.z).max()
    fx, fy = contact.total_force
    # The block yields by 2.4 % of this.
    assert abs(fx / fy) == pytest.approx(np.tan(np.radians(25)), rel=0.03)
    with pytest.raises(ValueError, match="oblique to its normal"):
        fm.ContactProblem(
            internal(u, linear_elastic(u, 100.0, 0.3)),
            u,
            [fm.ContactPair(data, "upper/bottom", "lower/top")],
            bcs=bcs,
            petsc_options_prefix="oblique_",
            algorithm="condensed",
        )


@pytest.mark.once
def test_options_of_one_problem_do_not_reach_the_next():
    first = pressed_blocks(problem={"petsc_options": {"ksp_type": "gmres"}}, **MESH)
    second = pressed_blocks(**MESH)
    assert first.problem.equations.system.ksp.getType() == "gmres"
    assert second.problem.equations.system.ksp.getType() == "preonly"


@pytest.mark.once
def test_problem_without_pairs_is_the_bulk_problem():
    scene = pressed_blocks(**MESH)
    u = scene.u
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, 100.0, 0.3)),
        u,
        [],
        bcs=scene.problem.equations.bulk.bcs,
        petsc_options_prefix="bulk_",
    )
    scene.loads["push"].value[1] = 0.1
    assert problem.solve().converged


def three_blocks():
    """Three blocks on top of each other, the middle one slave above and below."""
    from meshes._shared import add_block, generate

    gmsh.model.add("three_blocks")
    bodies, boundaries = {}, {}
    for name, low, left, right, counts in (
        ("low", 0.0, 0.0, 2.0, (9, 3)),
        ("middle", 1.0, 0.4, 1.6, (7, 3)),
        ("high", 2.0, 0.3, 1.5, (5, 3)),
    ):
        corners = np.array([(left, low), (right, low), (right, low + 1), (left, low + 1)])
        surface, sides = add_block(corners, *counts, "quadrilateral")
        bodies[name] = [surface]
        boundaries |= {f"{name}/{side}": [curve] for side, curve in sides.items()}
    return generate(bodies, boundaries)


@pytest.mark.once
@pytest.mark.parametrize("algorithm", ["saddle", "condensed"])
def test_three_bodies_in_two_pairs_carry_the_same_force(algorithm):
    data = read(three_blocks)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [
        fm.dirichlet(V, data, "low/bottom", np.zeros(2)),
        fm.dirichlet(V, data, "high/top", np.array([0.0, -0.1])),
        # without friction, only this condition prevents a sideways motion of the middle block
        fm.dirichlet(V, data, "middle/left", 0.0, component=0),
    ]
    pairs = [
        fm.ContactPair(data, "middle/bottom", "low/top"),
        fm.ContactPair(data, "high/bottom", "middle/top"),
    ]
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, 100.0, 0.3)),
        u,
        pairs,
        bcs=bcs,
        petsc_options_prefix="three_",
        algorithm=algorithm,
    )
    problem.solve()
    below, above = (contact.total_force for contact in problem.equations.contacts)
    assert below[1] > 0.0 and above[1] > 0.0
    assert below[1] == pytest.approx(above[1], rel=1e-9)


def test_surface_that_is_slave_and_master_is_not_condensed():
    data = read(three_blocks)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [
        fm.dirichlet(V, data, "low/bottom", np.zeros(2)),
        fm.dirichlet(V, data, "middle/top", np.array([0.0, -0.1])),
    ]
    pairs = [
        fm.ContactPair(data, "middle/bottom", "low/top"),
        fm.ContactPair(data, "high/bottom", "middle/bottom"),
    ]
    with pytest.raises(ValueError, match="saddle"):
        fm.ContactProblem(
            internal(u, linear_elastic(u, 100.0, 0.3)),
            u,
            pairs,
            bcs=bcs,
            petsc_options_prefix="three_",
            algorithm="condensed",
        )


@pytest.mark.parametrize("basis", ["standard", "linear"])
def test_standard_multipliers_are_not_condensed(basis):
    with pytest.raises(ValueError, match="not diagonal"):
        pressed_blocks(pair={"basis": basis}, problem={"algorithm": "condensed"}, **MESH)


@pytest.mark.once
def test_petsc_options_of_the_prefix_reach_the_solver():
    options = {"petsc_options": {"pc_type": "lu", "ksp_type": "gmres", "ksp_rtol": 1e-12}}
    scene = pressed_blocks(problem={**options, "petsc_options_prefix": "mine_"}, **MESH)
    assert scene.problem.equations.system.ksp.getType() == "gmres"
    assert scene.problem.equations.system.ksp.getOptionsPrefix() == "mine_"
    scene.loads["push"].value[1] = -0.05
    assert scene.problem.solve().converged


@pytest.mark.once
@pytest.mark.serial
def test_deleted_problems_free_their_memory():
    """Matrices and factors of one problem take 5 MB here; memory in use hardly grows."""

    def solve_and_forget():
        scene = pressed_blocks(n_upper=60, n_lower=80)
        scene.loads["push"].value[1] = -0.02
        scene.problem.solve()
        del scene
        gc.collect()
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

    first, *_, last = [solve_and_forget() for _ in range(8)][2:]
    assert last - first < 5 * 2e6
