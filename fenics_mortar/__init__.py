# SPDX-License-Identifier: MIT
"""Mortar contact of deformable bodies at finite deformation for FEniCSx, in 2D."""

from fenics_mortar.compat import vector_space
from fenics_mortar.contact import ContactPair
from fenics_mortar.errors import MeshError, MortarError, NotConvergedError, SurfaceError
from fenics_mortar.mesh import MeshData, dirichlet, read_gmsh
from fenics_mortar.newton import NewtonOptions, NewtonReport
from fenics_mortar.problem import ContactProblem
from fenics_mortar.results import ResultsWriter, contact_table, plot

__all__ = [
    "ContactPair",
    "ContactProblem",
    "MeshData",
    "MeshError",
    "MortarError",
    "NewtonOptions",
    "NewtonReport",
    "NotConvergedError",
    "ResultsWriter",
    "SurfaceError",
    "contact_table",
    "dirichlet",
    "plot",
    "read_gmsh",
    "vector_space",
]
