# SPDX-License-Identifier: MIT
"""Reading gmsh meshes with their names, from files and live models."""

import re
import runpy
import sys
from importlib.machinery import PathFinder
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
from mesh_measures import (
    CELLS,
    COMM,
    SCRIPTS,
    area,
    length,
    measure,
    nodes_on,
    num_facets,
    on_root,
    raises_on_all_ranks,
    read,
)

from dolfinx import mesh as dmesh

import meshes
from fenics_mortar.mesh.data import MeshData
from fenics_mortar.mesh.gmsh_reader import read_gmsh
from fenics_mortar.utils import compat
from fenics_mortar.utils.errors import MeshError
from meshes import rings, two_blocks


def test_names_are_known_on_all_ranks():
    data = read(two_blocks.build)
    sides = ("bottom", "right", "top", "left")
    assert sorted(data.bodies) == ["lower", "upper"]
    assert sorted(data.boundaries) == sorted(f"{b}/{s}" for b in data.bodies for s in sides)
    assert len(set(COMM.allgather(repr((data.bodies, data.boundaries))))) == 1


def test_unknown_boundary_name_lists_the_known_ones():
    data = MeshData(None, None, None, {"lower": 1}, {"lower/top": 2, "lower/bottom": 3})
    right = r"no boundary 'punch'; the mesh has \['lower/bottom', 'lower/top'\]"
    raises_on_all_ranks(right, data.boundary_tag, "punch")
    raises_on_all_ranks(r"no body 'punch'; the mesh has \['lower'\]", data.body_tag, "punch")


def test_tags_and_names_are_equivalent():
    data = MeshData(None, None, None, {"lower": 1}, {"lower/top": 2})
    assert data.boundary_tag("lower/top") == data.boundary_tag(2) == data.boundary_tag(np.int32(2))
    assert data.body_tag("lower") == data.body_tag(1) == 1


def test_mesh_without_names_is_used_by_its_tags():
    mesh = dmesh.create_unit_square(COMM, 3, 3)
    left = dmesh.locate_entities_boundary(mesh, 1, lambda x: np.isclose(x[0], 0.0))
    tags = dmesh.meshtags(mesh, 1, np.sort(left), np.full(left.size, 5, dtype=np.int32))
    data = MeshData(mesh, None, tags)
    assert length(data, 5) == pytest.approx(1.0, rel=1e-14)
    raises_on_all_ranks(r"boundary 6 has no facets; the mesh has \[5\]", data.boundary_facets, 6)


# Reading


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("script", SCRIPTS)
def test_file_and_live_model_give_the_same_mesh(script, cell, msh_path):
    model = on_root(SCRIPTS[script], cell=cell)
    on_root(gmsh.write, str(msh_path))
    live, file = read_gmsh(model, COMM), read_gmsh(msh_path, COMM)
    assert (live.bodies, live.boundaries) == (file.bodies, file.boundaries)
    for body in live.bodies:
        assert area(file, body) == pytest.approx(area(live, body), rel=1e-13)
    for boundary in live.boundaries:
        assert np.allclose(nodes_on(file, boundary), nodes_on(live, boundary), atol=1e-14)
        assert num_facets(file, boundary) == num_facets(live, boundary)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("script", SCRIPTS)
def test_mesh_has_only_the_given_cells_and_none_inverted(script, cell):
    model = on_root(SCRIPTS[script], cell=cell)
    if COMM.rank == 0:
        (cell_type,), _, (nodes,) = model.mesh.getElements(2)
        tags, x, _ = model.mesh.getNodes()
        corners = nodes.reshape(-1, {"triangle": 3, "quadrilateral": 4}[cell])
        corners = x.reshape(-1, 3)[np.argsort(tags)][corners - 1]
        before, after = (np.roll(corners, shift, axis=1) - corners for shift in (1, -1))
        turn = after[..., 0] * before[..., 1] - after[..., 1] * before[..., 0]
        assert cell_type == {"triangle": 2, "quadrilateral": 3}[cell]
        assert (turn > 0.0).all()
    assert compat.cell_name(read_gmsh(model, COMM).mesh) == cell


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("script", SCRIPTS)
def test_boundaries_of_a_script_are_the_whole_boundary(script, cell):
    data = read(SCRIPTS[script], cell=cell)
    data.mesh.topology.create_connectivity(1, 2)
    exterior = dmesh.exterior_facet_indices(data.mesh.topology)
    named = data.boundary_facets(list(data.boundaries))
    assert COMM.allreduce(bool(np.isin(exterior, named).all()), MPI.LAND)
    assert sum(length(data, name) for name in data.boundaries) == pytest.approx(
        measure(data, 1, exterior), rel=1e-13
    )


@pytest.mark.parametrize("cell", CELLS)
def test_second_order_mesh_follows_the_circles(cell):
    def build(order):
        model = rings.build(cell=cell)
        model.mesh.setOrder(order)
        return model

    exact = np.pi * (2.0**2 - 1.0**2)
    errors = [1.0 - area(read(build, order=order), "inner") / exact for order in (1, 2)]
    assert errors[0] == pytest.approx(1.0 - 16 / np.pi * np.sin(np.pi / 16), rel=1e-10)
    assert abs(errors[1]) < 1e-3 * errors[0]


def test_gaps_in_node_numbers_are_accepted(msh_path):
    """gmsh writes only nodes of physical groups, with the numbers they had."""

    def write_upper():
        model = two_blocks.build()
        for dim, tag in model.getPhysicalGroups():
            if model.getPhysicalName(dim, tag).startswith("lower"):
                model.removePhysicalGroups([(dim, tag)])
        gmsh.write(str(msh_path))

    on_root(write_upper)
    data = read_gmsh(msh_path, COMM)
    assert list(data.bodies) == ["upper"]
    assert area(data, "upper") == pytest.approx(1.0, rel=1e-13)
    assert num_facets(data, "upper/bottom") == 10


def test_reading_a_file_leaves_the_running_gmsh_session_alone(msh_path):
    def build_two():
        two_blocks.build()
        gmsh.write(str(msh_path))
        rings.build()
        gmsh.model.setCurrent("two_blocks")
        gmsh.option.setNumber("General.Verbosity", 0)  # terminal on, but silent
        gmsh.option.setNumber("General.Terminal", 1)

    def state():
        terminal = gmsh.option.getNumber("General.Terminal")
        return gmsh.model.getCurrent(), gmsh.model.list(), gmsh.model.getEntities(), terminal

    on_root(build_two)
    before = on_root(state)
    read_gmsh(msh_path, COMM)
    assert COMM.bcast(before == on_root(state))


def test_last_rank_may_read(msh_path):
    on_root(two_blocks.build)
    on_root(gmsh.write, str(msh_path))
    COMM.barrier()
    data = read_gmsh(msh_path if COMM.rank == COMM.size - 1 else None, COMM, rank=COMM.size - 1)
    assert area(data, "lower") == pytest.approx(2.2, rel=1e-13)


# Errors


def plate(*, order=1, mesh=True, groups=True, dim=2, z=0.0, nan=False):
    """Build an incomplete plate."""
    gmsh.model.add("plate")
    occ, model = gmsh.model.occ, gmsh.model
    occ.addRectangle(0, 0, 0, 1, 1) if dim == 2 else occ.addBox(0, 0, 0, 1, 1, 1)
    occ.rotate(occ.getEntities(dim), 0, 0, 0, 1, 0, 0, z)
    occ.synchronize()
    if groups:
        for _, surface in model.getEntities(2):
            model.setPhysicalName(2, model.addPhysicalGroup(2, [surface]), f"body {surface}")
    if mesh:
        model.mesh.generate(dim)
    if nan:
        model.mesh.setNode(2, [np.nan, 0.0, 0.0], [])
    return model


def test_model_without_boundaries_has_empty_facet_tags():
    data = read(plate)
    assert area(data, "body 1") == pytest.approx(1.0, rel=1e-14)
    assert (data.facet_tags.dim, COMM.allreduce(data.facet_tags.indices.size)) == (1, 0)


def with_second_group(dim):
    model = plate()
    for name in ("first", "second"):
        model.setPhysicalName(dim, model.addPhysicalGroup(dim, [1]), name)
    return model


def with_untagged_surface():
    model = plate(mesh=False)
    model.occ.addRectangle(2, 0, 0, 1, 1)
    model.occ.synchronize()
    model.mesh.generate(2)
    return model


def with_mixed_cells():
    model = two_blocks.build(cell="triangle")
    model.mesh.setRecombine(2, 1)
    model.mesh.clear()
    model.mesh.generate(2)
    return model


def empty():
    """As what is made without ``gmsh.initialize()``: gmsh 4.8 prints that and goes on."""
    gmsh.model.add("empty")
    return gmsh.model


def with_serendipity_cells():
    model = two_blocks.build()
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
    model.mesh.setOrder(2)
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 0)
    return model


def with_curve_without_mesh():
    model = plate()
    occ = model.occ
    line = occ.addLine(occ.addPoint(2, 0, 0), occ.addPoint(3, 0, 0))
    occ.synchronize()
    model.setPhysicalName(1, model.addPhysicalGroup(1, [line]), "later")
    return model


@pytest.mark.each
@pytest.mark.parametrize(
    ("build", "match"),
    (
        (lambda: plate(groups=False), "surface 1 is in no physical group"),
        (empty, r"was gmsh.initialize\(\) called"),
        (lambda: plate(mesh=False), r"no elements of dimension 2; was .*generate\(2\)"),
        (lambda: plate(dim=3), "volume 1 is in no physical group"),
        (lambda: plate(z=0.1), "z varies by 0.0998"),
        (lambda: plate(nan=True), "coordinates of 1 nodes are not finite, e.g. of node 2"),
        (lambda: with_second_group(2), r"surface 1 is in the physical groups \['body 1', 'first'"),
        (lambda: with_second_group(1), r"curve 1 is in the physical groups \['first', 'second'\]"),
        (with_untagged_surface, "surface 2 is in no physical group"),
        (with_curve_without_mesh, r"curve \d of physical group \['later'\] has no elements"),
        (with_mixed_cells, r"mixes \['Quadrilateral 4', 'Triangle 3'\]"),
        (with_serendipity_cells, r"type \['Quadrilateral 8'\] are not supported"),
        (lambda: None, "source is None; expected"),
        (lambda: 3.5, "source is 3.5; expected"),
        (lambda: "nowhere.msh", "no file 'nowhere.msh'"),
    ),
    ids=lambda value: value.replace(" ", "_")[:30] if isinstance(value, str) else "",
)
def test_unreadable_file_raises_on_all_ranks(build, match):
    raises_on_all_ranks(match, read, build)


def test_file_of_another_format_raises_on_all_ranks(msh_path):
    on_root(msh_path.write_text, "$MeshFormat\nno mesh at all\n")
    raises_on_all_ranks("mesh.msh': its format is 'no mesh at'", read_gmsh, msh_path, COMM)


def test_file_with_one_name_twice_raises_on_all_ranks(msh_path):
    """gmsh drops the second name, but files can contain it."""

    def write():
        two_blocks.build()
        gmsh.write(str(msh_path))
        msh_path.write_text(msh_path.read_text().replace("upper/left", "upper/right"))

    on_root(write)
    match = r"the physical groups \d+ and \d+ have the same name 'upper/right'"
    raises_on_all_ranks(match, read_gmsh, msh_path, COMM)


class Broken:
    """Finder of modules for which gmsh lacks a library of the system."""

    @staticmethod
    def find_spec(name, *_):
        if name == "gmsh":
            raise OSError("libGLU.so.1: cannot open shared object file")


@pytest.mark.parametrize(
    ("finders", "cure"),
    [([], "No module .*; install gmsh: "), ([Broken], "apt-get install libglu1")],
)
def test_meshes_without_gmsh_name_the_cure(monkeypatch, finders, cure):
    """Demos and scripts of meshes import gmsh from there only."""
    found = [finder for finder in sys.meta_path if finder is not PathFinder]
    with monkeypatch.context() as patch:
        patch.delitem(sys.modules, "gmsh")
        patch.delitem(sys.modules, "meshes.with_gmsh")
        patch.setattr(sys, "meta_path", [*finders, *sys.meta_path] if finders else found)
        with pytest.raises(MeshError, match=f"module gmsh is needed .*{cure}"):
            runpy.run_path(str(Path(meshes.__file__).with_name("with_gmsh.py")))
    root = Path(two_blocks.__file__).resolve().parents[1]
    folders = "meshes/*.py", "demos/demo_*.py", "demos/studies/**/*.py"
    scripts = [script for folder in folders for script in root.glob(folder)]
    own = [s.name for s in scripts if re.search(r"^ *import gmsh$", s.read_text(), re.M)]
    assert len(scripts) > 50 and own == ["with_gmsh.py"]


def test_rank_that_does_not_exist_cannot_read():
    raises_on_all_ranks(f"ranks 0 to {COMM.size - 1}", read_gmsh, None, COMM, rank=COMM.size)
