# SPDX-License-Identifier: MIT
"""Stresses and the reading of meshes, shared by all studies."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mpi4py import MPI

import fenics_mortar as fm
from fenics_mortar import energies
from meshes.with_gmsh import gmsh


def linear_elastic(u: Any, mu: Any, lmbda: Any, geometry: Any = "plane") -> Any:
    """Cauchy stress of linear elasticity [stress], (2, 2) in plane strain, else (3, 3)."""
    return energies.stress(energies.linear_elastic, energies.strain(u, geometry), mu, lmbda)


def neo_hookean(u: Any, mu: Any, lmbda: Any, geometry: Any = "plane") -> Any:
    """First Piola-Kirchhoff stress [stress], (2, 2) in plane strain, else (3, 3)."""
    F = energies.deformation_gradient(u, geometry)
    return energies.stress(energies.neo_hookean, F, mu, lmbda)


def read_mesh(build: Callable[[], Any], comm: MPI.Comm = MPI.COMM_WORLD) -> fm.MeshData:
    """Mesh of the gmsh model created by ``build`` on rank 0 (collective)."""
    model = None
    if comm.rank == 0:
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        model = build()
    data = fm.read_gmsh(model, comm)
    if comm.rank == 0:
        gmsh.finalize()
    return data
