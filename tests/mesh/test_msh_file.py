# SPDX-License-Identifier: MIT
"""Files of gmsh are read without gmsh, with equal results."""

import re
import subprocess
import sys

import gmsh
import numpy as np
import pytest
from mesh_measures import COMM, area, length, on_root, raises_on_all_ranks

from fenics_mortar.mesh.gmsh_reader import read_gmsh
from meshes import half_cylinder_on_block, two_blocks

SHAPES = {
    "triangles": lambda: two_blocks.build(cell="triangle"),
    "quadrilaterals": lambda: two_blocks.build(cell="quadrilateral"),
    "arcs": lambda: half_cylinder_on_block.build(h=0.2),
}


def write(path, shape, *, binary=0, order=1, version=4.1):
    """Write a mesh, leave it live without holes in the numbers of its nodes."""
    model = SHAPES[shape]()
    model.mesh.setOrder(order)
    model.mesh.renumberNodes()
    gmsh.option.setNumber("Mesh.SaveAll", version == 4.1)  # 2.2 then loses the groups
    gmsh.option.setNumber("Mesh.Binary", binary)
    gmsh.option.setNumber("Mesh.MshFileVersion", version)
    gmsh.write(str(path))
    return model


def everything(data):
    topology, tags = data.mesh.topology, (data.cell_tags, data.facet_tags)
    values = [(t.indices.tolist(), t.values.tolist()) for t in tags]
    nodes = np.asarray(data.mesh.geometry.input_global_indices).tolist()
    corners = topology.connectivity(2, 0).array.tolist()
    return nodes, corners, values, data.bodies, data.boundaries


@pytest.mark.serial  # partitions of equal meshes may differ
@pytest.mark.parametrize("version", [4.1, 2.2])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("binary", [0, 1], ids=["text", "binary"])
@pytest.mark.parametrize("shape", SHAPES)
def test_file_agrees_with_the_live_model(shape, binary, order, version, msh_path):
    model = on_root(write, msh_path, shape, binary=binary, order=order, version=version)
    file, live = read_gmsh(msh_path, COMM), read_gmsh(model, COMM)
    assert everything(file) == everything(live)
    digits = 0.0 if binary else 1e-15  # texts have 16 digits
    assert np.allclose(file.mesh.geometry.x, live.mesh.geometry.x, rtol=digits, atol=digits)


@pytest.mark.parametrize("version", [1.0, 4.0])
def test_other_formats_are_refused_with_the_cure(version, msh_path):
    on_root(write, msh_path, "triangles", version=version)
    raises_on_all_ranks("its format is .*; expected 4.1 or 2.2", read_gmsh, msh_path, COMM)


def damage(path, change, version=4.1):
    write(path, "triangles", version=version)
    path.write_text(change(path.read_text()))


@pytest.mark.parametrize(
    "change, match",
    [
        (lambda text: text[: len(text) // 2], "section '.*' has no end"),
        (lambda text: text.replace("$EndNodes", "\n7 8 9\n$EndNodes"), "too many numbers"),
        (lambda text: text.replace("$EndElements", "1 2\n$EndElements"), "too many numbers"),
        (lambda text: text[: text.rindex("$EndE") - 8] + "\n$EndElements\n", "too few numbers"),
        (lambda text: text.replace("0 1 0 1\n1\n", "0 1 0 1\n2\n", 1), "have the same number"),
        (lambda text: text.replace("0 1 0 1\n1\n", "0 1 0 1\n9999\n", 1), "not in the file"),
        (lambda text: text.replace("0 1 0 1\n1\n", "0 1 0 1\none\n", 1), "could not convert"),
    ],
)
def test_damaged_files_raise_on_all_ranks(change, match, msh_path):
    on_root(damage, msh_path, change)
    raises_on_all_ranks(f"cannot read '.*mesh.msh': .*{match}", read_gmsh, msh_path, COMM)


@pytest.mark.parametrize(
    "change, match",
    [
        (lambda text: text[: len(text) // 2], "section '.*' has no end"),
        (lambda text: text.replace("$EndNodes", "7 8 9\n$EndNodes"), "too many numbers"),
        (lambda text: text.replace("$EndElements", "1 2\n$EndElements"), "too many numbers"),
        (lambda text: text[: text.rindex("$EndE") - 4] + "\n$EndElements\n", "too few numbers"),
        (lambda text: text.replace("\n2 2.2", "\n1 2.2", 1), "have the same number"),
        (lambda text: re.sub(r"(ements\n\d+\n\d+ )\d+", r"\g<1>77", text), "unknown type 77"),
        (lambda text: re.sub(r"(ements\n\d+\n\d+ )\d+", r"\g<1>one", text), "could not convert"),
    ],
)
def test_damaged_files_of_the_old_format_raise_on_all_ranks(change, match, msh_path):
    on_root(damage, msh_path, change, version=2.2)
    raises_on_all_ranks(f"cannot read '.*mesh.msh': .*{match}", read_gmsh, msh_path, COMM)


@pytest.mark.parametrize("tags", ["1 7", "2 7 0"])
def test_elements_of_the_old_format_may_have_a_group_alone(tags, msh_path):
    text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"
    text += "$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n$EndNodes\n"
    text += f"$Elements\n1\n1 3 {tags} 1 2 3 4\n$EndElements\n"
    on_root(msh_path.write_text, text)
    data = read_gmsh(msh_path, COMM)
    assert data.mesh.topology.index_map(2).size_global == 1
    assert area(data, 7) == pytest.approx(1.0)


def test_elements_of_any_order_and_tags_are_read_from_the_old_format(msh_path):
    """Lines between the triangles, further tags, an entity with elements in several places."""
    elements = ["1 1 2 9 4 1 2", "2 2 4 7 1 5 6 1 2 3", "3 1 3 -9 4 0 2 3", "4 2 2 7 1 1 3 4"]
    text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"
    text += "$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n$EndNodes\n"
    text += "$Elements\n4\n" + "\n".join(elements) + "\n$EndElements\n"
    on_root(msh_path.write_text, text)
    data = read_gmsh(msh_path, COMM)
    assert (area(data, 7), length(data, 9)) == (pytest.approx(1.0), pytest.approx(2.0))


@pytest.mark.serial
@pytest.mark.parametrize("version", [4.1, 2.2])
def test_gmsh_is_not_loaded(version, msh_path):
    write(msh_path, "triangles", version=version)
    program = (
        "import sys; from mpi4py import MPI; import fenics_mortar as fm; "
        f"fm.read_gmsh({str(msh_path)!r}, MPI.COMM_SELF); print('gmsh' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.split() == ["False"], done.stderr
