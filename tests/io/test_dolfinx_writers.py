# SPDX-License-Identifier: MIT
"""The displacement of a problem is an ordinary function, which can be written by dolfinx."""

import xml.etree.ElementTree as ET

import pytest
from small_scenes import small_blocks

import dolfinx.io


def solved(degree):
    scene = small_blocks(degree=degree)
    scene.loads["push"].value[1] = -0.01
    scene.problem.solve()
    return scene


def test_xdmf_takes_displacements_of_degree_1(shared_path):
    scene = solved(1)
    with dolfinx.io.XDMFFile(
        scene.problem.equations.comm, str(shared_path / "u.xdmf"), "w"
    ) as file:
        file.write_mesh(scene.u.function_space.mesh)
        for time in (0.5, 1.0):
            file.write_function(scene.u, time)
    times = [time.get("Value") for time in ET.parse(shared_path / "u.xdmf").iter("Time")]
    assert [float(time) for time in times] == [0.5, 1.0]


@pytest.mark.skipif(not hasattr(dolfinx.io, "VTXWriter"), reason="dolfinx has no ADIOS2")
def test_vtx_takes_displacements_of_degree_2(shared_path):
    scene = solved(2)
    with dolfinx.io.VTXWriter(
        scene.problem.equations.comm, str(shared_path / "u.bp"), [scene.u]
    ) as file:
        file.write(0.5)
    assert list((shared_path / "u.bp").iterdir())
