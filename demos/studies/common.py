# SPDX-License-Identifier: MIT
"""Material laws of plane strain and the reading of meshes, shared by all studies."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mpi4py import MPI

import gmsh

import ufl

import fenics_mortar as fm


def lame(E: float, nu: float) -> tuple[float, float]:
    """Lame's parameters mu and lambda of plane strain [stress]."""
    return E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))


def linear_elastic(u: Any, mu: Any, lmbda: Any) -> Any:
    """Cauchy stress of linear elasticity [stress], a UFL expression of shape (2, 2)."""
    strain = ufl.sym(ufl.grad(u))
    return 2 * mu * strain + lmbda * ufl.tr(strain) * ufl.Identity(2)


def neo_hookean(u: Any, mu: Any, lmbda: Any) -> Any:
    """First Piola-Kirchhoff stress of the compressible neo-Hookean law [stress], shape (2, 2)."""
    F = ufl.Identity(2) + ufl.grad(u)
    inverse = ufl.inv(F).T
    return mu * (F - inverse) + lmbda * ufl.ln(ufl.det(F)) * inverse


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
