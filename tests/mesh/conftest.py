# SPDX-License-Identifier: MIT
"""Fixtures of tests with gmsh."""

import gmsh
import pytest
from mesh_measures import COMM


@pytest.fixture(autouse=True)
def gmsh_session():
    """Run gmsh on rank 0, silently."""
    if COMM.rank == 0:
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
    yield
    if COMM.rank == 0:
        gmsh.finalize()


@pytest.fixture
def msh_path(tmp_path):
    """Give one path to all ranks."""
    return COMM.bcast(tmp_path / "mesh.msh")
