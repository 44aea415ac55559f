# SPDX-License-Identifier: MIT
"""Numbers that are not finite: reported with their position; differences between ranks."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from array_meshes import blocks_of_arrays, grid, mesh_of, problem_on, tagged, triangles
from refusal import COMM, refused
from scenes import internal, neo_hookean, pair_options
from small_scenes import small_blocks
from space_pairs import pressed

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.contact.contact import Contact
from fenics_mortar.utils import compat
from fenics_mortar.utils.errors import NotFiniteError

# Numbers that are not finite


def test_mesh_with_a_coordinate_that_is_not_finite_is_refused():
    cells, x = grid(6, 6)
    x[24] = np.nan  # inside
    data = tagged(mesh_of(cells, x), slave=lambda x: x[1] > 0.9, master=lambda x: x[1] < 0.1)
    with refused(fm.MeshError, "coordinates of 1 nodes are not finite", "node 24"):
        problem_on(data)


def test_cell_without_area_is_named():
    cells, x = grid(4, 4)
    x[12] = x[6]  # in the middle: one of the triangles becomes a line
    data = tagged(
        mesh_of(triangles(cells), x, "triangle"),
        slave=lambda x: x[1] > 0.9,
        master=lambda x: x[1] < 0.1,
    )
    with refused(fm.MeshError, r"cells have no area, one at \(0.\d+, 0.\d+\)"):
        problem_on(data)


def test_displacement_that_is_not_finite_is_refused_by_problem_and_solve():
    scene = small_blocks()
    scene.loads["push"].value[1] = -0.01
    u = scene.u.x.array
    u[: 2 if COMM.rank == COMM.size - 1 else 0] = np.nan
    with refused(fm.MortarError, "displacement is not finite at 1 nodes, one at", "reset"):
        scene.problem.solve()
    with refused(fm.MortarError, "displacement is not finite at 1 nodes, one at", "reset"):
        problem_on(scene.data, [scene.contact.pair], u=scene.u)
    u[:] = 0.0
    assert scene.problem.solve().converged


def test_mesh_that_was_moved_after_set_up_is_refused():
    scene = small_blocks()
    scene.loads["push"].value[1] = -0.01
    nodes = scene.data.mesh.geometry.x
    kept = nodes.copy()
    nodes[: 1 if COMM.rank == COMM.size - 1 else 0, 0] += 1e-3
    with refused(fm.MortarError, "the mesh was moved after the problem was set up", "new problem"):
        scene.problem.solve()
    nodes[:] = kept
    assert scene.problem.solve().converged


def test_load_that_is_not_finite_is_named():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    V, v = u.function_space, ufl.TestFunction(u.function_space)
    traction = fem.Constant(data.mesh, (0.0, 0.0))
    weight = fem.Function(V)
    value = fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [fm.dirichlet(V, data, "base", value), fm.dirichlet(V, data, "top", (0.0, -0.01))]
    load = ufl.inner(traction, v) * ufl.ds + ufl.inner(weight, v) * ufl.dx
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)) - load,
        u,
        [fm.ContactPair(data, "slave", "master")],
        bcs=bcs,
        petsc_options_prefix="test_errors_",
    )
    traction.value[1] = np.nan
    with refused(fm.MortarError, r"a constant of the residual is \[ ?0. +nan\]"):
        problem.solve()
    if COMM.size > 1:
        traction.value[1] = 0.1 if COMM.rank == 0 else 0.0
        where = f"0.1 on rank 0 and 0 on rank {min(COMM.size - 1, 1)}"
        with refused(fm.MortarError, f"a constant of the residual is {where}"):
            problem.solve()
    traction.value[1] = 0.0
    weight.name = "weight"
    weight.x.array[: 2 if COMM.rank == COMM.size - 1 else 0] = np.inf
    with refused(fm.MortarError, "function 'weight' of the residual is not finite"):
        problem.solve()
    weight.x.array[:] = 0.0
    value.value[0] = np.nan
    with refused(fm.MortarError, r"prescribed displacement is not finite at 5 nodes, one at \("):
        problem.solve()
    value.value[0] = 0.0
    assert problem.solve().converged


@pytest.mark.parametrize(
    ("offset", "message"),
    [
        (np.nan, r"offset\[0\]=nan: expected finite lengths of shape \(5,\).*or one for all"),
        ([0.01], r"shape \(1,\), type float64"),
        ([[0.0, 0.0]] * 5, r"shape \(5, 2\), type float64"),
        ([1j] * 5, r"shape \(5,\), type complex128: expected finite lengths"),
        ([0.0, 0.0, np.nan, 0.0, 0.0], r"offset\[2\]=nan: expected finite lengths of shape \(5,\)"),
        ([0.0, 0.0, 0.0, 0.0, -np.inf], r"offset\[4\]=-inf: expected finite lengths"),
    ],
)
def test_refused_offset_keeps_the_old_one(offset, message):
    contact = small_blocks().contact
    before = contact.offset
    with refused(ValueError, message):
        contact.offset = offset
    assert contact.offset is before
    contact.offset = list(range(5))
    assert contact.offset.dtype == float and contact.offset[4] == 4.0


def test_offset_that_is_not_finite_since_it_was_set_is_refused_by_solve():
    scene = small_blocks()
    with refused(ValueError, "read-only"):
        scene.contact.offset[3] = np.nan
    scene.contact.change(offset=np.full(scene.contact.slave.num_nodes, np.nan))
    with refused(ValueError, r"offset of 'upper/bottom'\[0\]=nan: expected finite lengths"):
        scene.problem.solve()


@pytest.mark.usefixtures("several_ranks")
@pytest.mark.parametrize(
    "what", ["offset of", "a prescribed displacement", "place of", "push of", "nan in offset of"]
)
def test_input_that_differs_on_one_rank_is_refused_by_all(what):
    """Ranks would diverge, and the run would hang or fail in MPI."""
    wrong = float(COMM.rank == COMM.size - 1)
    if what in ("place of", "push of"):
        data = blocks_of_arrays()
        u, circle = fem.Function(fm.vector_space(data.mesh, 1)), fm.Circle((0.9, 4.0), 1.5)
        bcs = [fm.dirichlet(u.function_space, data, "base", (0.0, 0.0))]
        problem = problem_on(data, [fm.ContactPair(data, "top", circle)], bcs=bcs, u=u)
        circle.move(y=-0.01 * wrong) if what == "place of" else circle.push(y=-1.0 - wrong)
    else:
        scene = small_blocks()
        problem, contact = scene.problem, scene.contact
        if what == "a prescribed displacement":
            scene.loads["push"].value[1] = -0.01 * wrong
        elif wrong:
            contact.change(offset=np.full(5, 0.01 if what == "offset of" else np.nan))
    last = COMM.size - 1
    with refused(fm.MortarError, what.removeprefix("nan in "), f"on rank 0 and .* on rank {last}"):
        problem.solve()


def test_distance_that_raises_on_one_rank_raises_on_all():
    """Nodes are replicated, integration points are distributed."""
    fails = []

    def plane(x):
        if fails and len(x) != 5:
            raise ZeroDivisionError("no distance here")
        return 1.01 - x[:, 1], np.tile((0.0, -1.0), (len(x), 1)), np.zeros((len(x), 2, 2))

    data = blocks_of_arrays()
    u, solid = fem.Function(fm.vector_space(data.mesh, 1)), fm.SignedDistance(plane, name="lid")
    bcs = [fm.dirichlet(u.function_space, data, "base", (0.0, 0.0))]
    pair = fm.ContactPair(
        data, "master", solid, **pair_options(points=6)
    )  # on 1 to 4 facets, with 5 nodes
    problem = problem_on(data, [pair], bcs=bcs, u=u)
    problem.solve()
    last = COMM.size - 1
    fails += [True] if COMM.rank == last else []
    kind, message = (
        (ZeroDivisionError, "^no distance here")
        if COMM.rank == last
        else (fm.MortarError, f"distance of 'lid' raised on rank {last}: ZeroDivisionError: no dis")
    )
    with pytest.raises(kind, match=message):
        problem.solve()
    fails.clear()
    assert problem.solve().converged


def test_material_parameter_that_is_not_finite_on_one_rank_is_named():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    E = fem.Function(compat.scalar_space(data.mesh, 0, "DG"), name="stiffness")
    E.x.array[:] = 100.0
    E.x.array[: 1 if COMM.rank == 0 else 0] = np.nan
    with refused(fm.MortarError, "function 'stiffness' of the residual is not finite"):
        fm.ContactProblem(
            internal(u, neo_hookean(u, E, 0.3)),
            u,
            [fm.ContactPair(data, "slave", "master")],
            petsc_options_prefix="test_errors_",
        )


@pytest.mark.parametrize("sharp", [0, 2])
def test_iteration_with_folded_facets_fails(monkeypatch, sharp):
    """The gap is nan there; at open nodes the residual would not show it.

    A slave with sharp edges, as a knife, may be solved as master.
    """
    problem = pressed().problem
    equations = problem.equations
    contact, evaluate = equations.contacts[0], Contact.evaluate

    def fold(self, u, linearization):
        evaluate(self, u, linearization)
        gap = self.operators.gap.copy()
        gap[-1] = np.nan
        self.set_operators(replace(self.operators, gap=gap))

    equations.evaluate(start=True)
    monkeypatch.setattr(Contact, "evaluate", fold)
    monkeypatch.setattr(contact.evaluation, "sharp_edges", SimpleNamespace(nodes=np.arange(sharp)))
    names = f"'{contact.slave.name}', or of '{contact.master.name}' opposite,"
    exchange = f"take '{contact.master.name}' as slave and '{contact.slave.name}' as master"
    with refused(NotFiniteError, f"facets of {names} are folded at", exchange if sharp else ""):
        equations.evaluate(start=False)
