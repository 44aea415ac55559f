# SPDX-License-Identifier: MIT
"""Meshes from arrays: the same as by gmsh, with the nodes of the input."""

import numpy as np
import pytest
from mesh_measures import read
from refusal import COMM, refused
from scenes import internal, neo_hookean

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.utils import compat
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block, sector

SQUARES = {
    "points": [(0, 0), (1, 0), (1, 1), (0, 1), (0, 1), (1, 1), (1, 2), (0, 2)],
    "cells": [(0, 1, 2, 3), (4, 5, 6, 7)],
    "bodies": {"lower": [0], "upper": [1]},
    "boundaries": {"base": [(0, 1)], "master": [(3, 2)], "slave": [(4, 5)], "top": [(6, 7)]},
}


def touching_blocks(order):
    """Two blocks that touch along y = 1, one of them a bent sector of 12 cells."""
    lower = block(5 * order, 2 * order, width=2.0, height=1.0)
    upper = block(3 * order, 2 * order, width=2.0, height=0.5, corner=(0.0, 1.0))
    ring = sector(12 * order, order, radii=(0.3, 0.6), centre=(5.0, 0.0))
    return [Grid("lower", lower), Grid("upper", upper), Grid("ring", ring, closed=True)]


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("order", [1, 2])
def test_mesh_from_arrays_equals_that_of_gmsh(cell, order):
    grids = touching_blocks(order)
    made = mapped_grids.mesh(grids, cell=cell, order=order)
    known = read(mapped_grids.build, grids=grids, cell=cell, order=order)
    assert compat.cell_name(made.mesh) == cell
    assert np.array_equal(made.mesh.geometry.x, known.mesh.geometry.x)
    assert np.array_equal(compat.geometry_dofmap(made.mesh), compat.geometry_dofmap(known.mesh))
    for tags, names in (("cell_tags", "bodies"), ("facet_tags", "boundaries")):
        mine, theirs = getattr(made, tags), getattr(known, tags)
        for name, tag in getattr(known, names).items():
            found = mine.find(getattr(made, names)[name])
            assert np.array_equal(np.sort(found), np.sort(theirs.find(tag))), name


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("order, degree", [(1, 1), (1, 2), (2, 1), (2, 2)])
def test_values_at_the_nodes_of_the_input(cell, order, degree):
    given = mapped_grids.arrays(touching_blocks(order), cell=cell, order=order)
    x, cells = given["points"], given["cells"]
    data = fm.mesh_from_arrays(**given)
    u = fem.Function(fm.vector_space(data.mesh, degree))
    u.interpolate(lambda X: np.stack([3 * X[0] - X[1], X[1] ** 2]))
    right = np.stack([3 * x[:, 0] - x[:, 1], x[:, 1] ** 2], axis=1)
    corners = np.unique(cells[:, : {"triangle": 3, "quadrilateral": 4}[cell]])
    inside = np.setdiff1d(np.arange(len(x)), corners)
    found = data.nodal_values(u, np.arange(len(x)))
    assert np.allclose(found[corners], right[corners], atol=1e-14)
    assert len(inside) == (0 if order == 1 else len(x) - len(corners))
    if degree == 2:
        assert np.allclose(found[inside], right[inside], atol=1e-14)
    else:
        assert np.isnan(found[inside]).all()
    dofs = data.node_dofs(u.function_space, np.arange(len(x)))
    here = dofs >= 0
    own = u.function_space.tabulate_dof_coordinates()[dofs[here], :2]
    assert np.allclose(own, x[here], atol=1e-14)
    present = COMM.allreduce(np.where(here, 1, 0))
    assert (present[corners] > 0).all() and ((present[inside] > 0) == (degree == 2)).all()


def test_bodies_that_touch_are_not_joined_and_unused_points_are_ignored():
    given = {**SQUARES, "points": [*SQUARES["points"], (9.0, 9.0)]}
    data = fm.mesh_from_arrays(**given if COMM.rank == 0 else dict.fromkeys(given))
    assert data.mesh.topology.index_map(0).size_global == 8
    u = fem.Function(fm.vector_space(data.mesh, 1))
    bcs = [
        fm.dirichlet(u.function_space, data, "base", (0.0, 0.0)),
        fm.dirichlet(u.function_space, data, "top", (0.0, -0.1)),
    ]
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)), u, [fm.ContactPair(data, "slave", "master")],
        bcs=bcs, petsc_options_prefix="test_arrays_",
    )  # fmt: skip
    problem.solve()
    middle = data.nodal_values(u, [2, 3, 4, 5, 8])
    assert np.allclose(middle[:4, 1], -0.05, atol=1e-10)
    assert np.isnan(middle[4]).all()


def test_last_rank_may_give_the_arrays():
    last = COMM.size - 1
    given = SQUARES if COMM.rank == last else dict.fromkeys(SQUARES)
    data = fm.mesh_from_arrays(**given, rank=last)
    assert data.bodies == {"lower": 1, "upper": 2}
    assert COMM.allreduce(data.boundary_facets("slave").size) >= 1


def test_cell_flags_and_a_constant_third_coordinate_are_accepted():
    points = np.pad(np.array(SQUARES["points"], float), ((0, 0), (0, 1)), constant_values=2.0)
    bodies = {"lower": [True, False], "upper": np.array([False, True])}
    data = fm.mesh_from_arrays(**{**SQUARES, "points": points, "bodies": bodies})
    assert data.mesh.geometry.dim == 2
    assert COMM.allreduce(data.cell_tags.find(2).size) >= 1


@pytest.mark.each
@pytest.mark.parametrize(
    "changed, message",
    [
        (
            {"points": [(0, 0, 0), (1, 0, 1), (1, 1, 2)], "cells": [(0, 1, 2)]},
            r"cells have shape \(1, 3\).*z of the points varies: for a mesh of the x-y plane",
        ),
        ({"points": [(0, np.nan)]}, "coordinates of 1 points are not finite, e.g. of point 0"),
        ({"points": [0, 1]}, r"points have shape \(2,\)"),
        ({"cells": [(0, 1, 2, 3, 4)]}, r"cells have shape \(1, 5\); expected \(m, 3\)"),
        ({"cells": [(0.0, 1.0, 2.0)]}, "cells are of type float64; expected integers"),
        ({"cells": [(0, 1, 2, 8)]}, "a cell has the node 8; the points are 0 to 7"),
        ({"cells": [(0, 1, 2, 2), (4, 5, 6, 7)]}, r"cell 0 has a node twice: \[0, 1, 2, 2\]"),
        ({"cells": [(0, 1, 2, 3), (1, 2, 3, 0)]}, r"1 cells are duplicates, one at \(0.5, 0.5\)"),
        ({"bodies": {"lower": [0]}}, r"1 cells are in no body, one at \(0.5, 1.5\)"),
        (
            {"bodies": {"lower": [0], "upper": [0, 1]}},
            "cell 0 is in the bodies 'lower' and 'upper'",
        ),
        ({"bodies": {"lower": [0], "upper": [2]}}, "body 'upper' has cells 2 to 2; the cells are"),
        ({"bodies": {"lower": [True]}}, r"'lower' has flags of shape \(1,\), expected \(2,\)"),
        ({"bodies": [0, 1]}, "expected a dictionary of arrays by name"),
        ({"boundaries": {"": [(0, 1)]}}, "boundaries has the name ''; expected a text"),
        ({"boundaries": {"a": [0, 1]}}, r"boundary 'a' has shape \(2,\); expected \(f, 2\)"),
        (
            {"boundaries": {"a": [(0, 2)]}},
            "'a': 1 facets are not edges of cells, one from node 0 to",
        ),
        ({"boundaries": {"a": [(2, 4)]}}, "one from node 2 to node 4"),
        (
            {"boundaries": {"a": [(1, 0, 2)]}},
            r"no nodes of 1 of its facets, one from node 0 to node 1 around \(0.5, 0\): expected "
            "the corners of each facet, as cells of order 1 have",
        ),
        (
            {"boundaries": {"a": [(0, 1)], "b": [(1, 0)]}},
            r"the facet from node 0 to node 1 is in the boundaries \['a', 'b'\]",
        ),
    ],
)
def test_invalid_arrays_are_refused_on_all_ranks(changed, message):
    given = {**SQUARES, **changed}
    with refused(fm.MeshError, message):
        fm.mesh_from_arrays(**given if COMM.rank == 0 else dict.fromkeys(given))


def strips(*, split):
    """A long block on a longer one; ``split`` cuts both contact surfaces into two boundaries."""
    given = mapped_grids.arrays(
        [
            Grid("lower", block(9, 3, width=3.0, height=1.0, corner=(-0.5, -1.0))),
            Grid("upper", block(8, 3, width=2.0, height=1.0)),
        ]
    )
    for name in ("lower/top", "upper/bottom") if split else ():
        facets = given["boundaries"].pop(name)
        given["boundaries"] |= {f"{name}/1": facets[:4], f"{name}/2": facets[4:]}
    return fm.mesh_from_arrays(**given)


@pytest.mark.parametrize("kind", [fm.ContactPair, fm.TiedPair])
def test_sides_of_several_names_are_one_surface(kind):
    found = []
    for split in (False, True):
        data = strips(split=split)
        parts = ("/1", "/2") if split else ("",)
        u = fem.Function(fm.vector_space(data.mesh, 1))
        slave, master = ([f"{name}{p}" for p in parts] for name in ("upper/bottom", "lower/top"))
        tagged = [data.boundaries[name] for name in master]
        pair = kind(data, slave=slave, master=tagged)
        assert pair.slave_name == " + ".join(slave)
        bcs = [
            fm.dirichlet(u.function_space, data, "lower/bottom", (0.0, 0.0)),
            fm.dirichlet(u.function_space, data, "upper/top", (0.03, -0.1)),
        ]
        residual = internal(u, neo_hookean(u, 100.0, 0.3))
        problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="parts_")
        problem.solve()
        found.append((u.x.array.copy(), problem.contacts[0].tractions))
    last_bits = 0.0 if COMM.size == 1 else 1e-12  # on several, MUMPS adds in any order
    for alone, together in zip(*found, strict=True):
        size = np.abs(alone).max(initial=0.0)
        assert np.abs(alone - together).max(initial=0.0) <= last_bits * size


def test_unknown_and_missing_names_among_several_are_refused():
    data = strips(split=True)
    with refused(fm.MeshError, "no boundary 'upper/bottom'; the mesh has"):
        fm.ContactPair(data, ["upper/bottom/1", "upper/bottom"], "lower/top/1")
    with refused(fm.MeshError, "no boundary is given; the mesh has"):
        fm.ContactPair(data, [], "lower/top/1")
    with refused(fm.MeshError, "no boundary is given; the mesh has"):
        fm.TiedPair(data, "upper/bottom/1", [])
