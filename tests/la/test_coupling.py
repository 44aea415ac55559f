# SPDX-License-Identifier: MIT
"""Pattern of the system: sufficient for sliding, created again if contact exceeds it."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from scenes import internal, neo_hookean, pressed_blocks, read

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.bulk.residual import MAX_GROWTHS
from fenics_mortar.la.coupling import MARGIN, MAX_MARGIN, _faced
from meshes import half_cylinder_on_block

comm = MPI.COMM_WORLD
MESH = {"n_upper": 8, "n_lower": 40, "layers_upper": 2, "layers_lower": 2, "width_lower": 4.0}
MASTER_FACET = 0.1


def entries(scene):
    return scene.problem.equations.system.matrix.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"]


def slide(scene, facets):
    scene.loads["push"].value[0] += facets * MASTER_FACET
    assert scene.problem.solve().converged


@pytest.mark.once
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
@pytest.mark.parametrize("degree", [1, 2])
def test_pattern_stays_while_contact_slides_over_fewer_facets_than_the_margin(degree, algorithm):
    scene = pressed_blocks(degree=degree, problem={"algorithm": algorithm}, **MESH)
    scene.loads["push"].value[1] = -0.01
    scene.problem.solve()
    before, matrix = entries(scene), scene.problem.equations.system.matrix
    for _ in range(3):
        slide(scene, 0.3 * MARGIN)
        assert entries(scene) == before and scene.problem.equations.system.matrix is matrix
    slide(scene, 0.5 * MARGIN)
    assert entries(scene) > before
    before = entries(scene)
    for _ in range(3):  # the margin is wider now
        slide(scene, 0.3 * MAX_MARGIN)
        assert entries(scene) == before


@pytest.mark.once
def test_outdated_zeros_are_removed():
    scene = pressed_blocks(**MESH)
    scene.loads["push"].value[:] = (-1.2, -0.01)
    scene.problem.solve()
    matrices, sizes = scene.problem.equations.bulk.num_patterns, []
    for _ in range(2 * MAX_GROWTHS):
        slide(scene, 0.6 * MAX_MARGIN)
        sizes.append(entries(scene))
    assert scene.problem.equations.bulk.num_patterns == matrices + 1
    assert np.diff(sizes).min() < 0.0 and sizes[-1] < 1.2 * sizes[0]


@pytest.mark.once
def test_pattern_stays_when_multiplier_nodes_change():
    """A short block slides along a long one, the slave: by facets, others are covered each step."""
    scene = pressed_blocks(slave="lower", **MESH)
    scene.loads["push"].value[1] = -0.01
    scene.problem.solve()
    before, matrix = entries(scene), scene.problem.equations.system.matrix
    carry = scene.contact.multiplier_nodes
    for _ in range(3):
        slide(scene, 0.3 * MARGIN)
        assert entries(scene) == before and scene.problem.equations.system.matrix is matrix
    assert (scene.contact.multiplier_nodes != carry).any()


def pressed_cylinder(degree, algorithm):
    """A half cylinder in contact with a block, and the constant that moves its flat side."""
    h = 0.2 * degree
    data = read(
        half_cylinder_on_block.build, radius=8.0, width=12.0, height=12.0, h=h, fine=1.0, growth=0.2
    )
    V = fm.vector_space(data.mesh, degree)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [
        fm.dirichlet(V, data, "block/bottom", np.zeros(2)),
        fm.dirichlet(V, data, "cylinder/top", push),
    ]
    pair = fm.ContactPair(data, "cylinder/arc", "block/top")
    residual, options = internal(u, neo_hookean(u, 100.0, 0.3)), {"algorithm": algorithm}
    problem = fm.ContactProblem(
        residual, u, [pair], bcs=bcs, petsc_options_prefix="test_", **options
    )
    return problem, push


@pytest.mark.once
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
@pytest.mark.parametrize("degree", [1, 2])
def test_pattern_is_made_once_while_contact_grows(degree, algorithm, monkeypatch):
    """The open part of the arc rotates: it faces other facets, up to the block's ends."""
    problem, push = pressed_cylinder(degree, algorithm)
    made, extend_pattern = [], type(problem.equations.system)._extend_pattern
    monkeypatch.setattr(
        type(problem.equations.system),
        "_extend_pattern",
        lambda *args: made.append(extend_pattern(*args)),
    )
    num_active = []
    for depth in (0.1, 0.4, 0.9):
        push.value[1] = -depth
        assert problem.solve().converged
        num_active.append(problem.equations.contacts[0].active.sum())
    assert num_active[-1] > 2 * num_active[0]
    assert len(made) == 1


def test_pattern_includes_multipliers_of_nodes_that_have_just_left(monkeypatch):
    """Until the next solve it acts at the node's present position, although the node is open."""
    scene = pressed_blocks(**MESH)
    scene.loads["push"].value[1] = -0.01
    scene.problem.solve()
    system, contact, u = scene.problem.equations.system, scene.contact, scene.u
    assert not system._update_pattern()
    u.x.array[contact.slave.local_dofs[:, 0]] += 2 * MARGIN * MASTER_FACET
    contact.evaluate(u.x.array, scene.problem.equations.linearization)
    z = contact.z
    contact.change(active=np.zeros_like(contact.active), z=np.zeros_like(z))
    assert not system._update_pattern()
    contact.change(z=z)
    assert system._update_pattern()


@pytest.mark.parametrize("degree", [1, 2])
def test_pairs_of_nodes_are_numbered_by_facet_and_master_node(degree):
    o = pressed_blocks(degree=degree, **MESH).contact.operators
    first, count = o.facet_nodes[:, 0], o.master.num_nodes + 1
    slave, master = np.repeat(o.facet_nodes[:, -1], 2), np.tile([0, 3], len(first))
    numbers = _faced(o, slave, master)
    assert np.array_equal(numbers % count, master)
    on_facet = [nodes[first == i // count] for nodes, i in ((o.facet_nodes, n) for n in numbers)]
    assert all(
        len(facet) == 1 and node in facet for facet, node in zip(on_facet, slave, strict=True)
    )
