# SPDX-License-Identifier: MIT
"""The scene of the benchmarks: two neo-Hookean blocks, the upper pressed on the lower."""

import sys
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import fem

root = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(root), str(root / "meshes")]
import two_blocks

import fenics_mortar as fm


def two_pressed_blocks(dofs, solver):
    """The problem with about so many unknowns, the length of a slave facet, what moves the top."""
    comm = MPI.COMM_WORLD
    k = round(np.sqrt(dofs / 6))  # facets of the upper block: its side is 1, the lower 2.2 x 1
    model = None
    if comm.rank == 0:
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        model = two_blocks.build(n_upper=k, n_lower=2 * k, layers_upper=k, layers_lower=k)
    data = fm.read_gmsh(model, comm)
    if comm.rank == 0:
        gmsh.finalize()
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    F = ufl.Identity(2) + ufl.grad(u)
    P = 40.0 * (F - ufl.inv(F).T) + 60.0 * ufl.ln(ufl.det(F)) * ufl.inv(F).T
    residual = ufl.inner(P, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 3})
    top = fem.Constant(data.mesh, (0.0, -0.01))
    bcs = [fm.dirichlet(V, data, "lower/bottom", np.zeros(2))]
    bcs += [fm.dirichlet(V, data, "upper/top", top)]
    pair = fm.ContactPair(data, slave="upper/bottom", master="lower/top")
    problem = fm.ContactProblem(
        residual, u, [pair], bcs=bcs, petsc_options_prefix="bench_", solver=solver
    )
    return problem, 1.0 / k, top
