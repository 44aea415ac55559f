# SPDX-License-Identifier: MIT
"""Mortar contact of deformable bodies at finite deformation for FEniCSx, in 2D."""

from fenics_mortar.adequacy import AdequacyCheck
from fenics_mortar.checkpoint import load_state, save_state
from fenics_mortar.compat import mixed_space, vector_space
from fenics_mortar.elastic_tool import ElasticTool
from fenics_mortar.errors import MeshError, MortarError, NotConvergedError, SurfaceError
from fenics_mortar.laws import Coulomb, Frictionless, Law, Tresca
from fenics_mortar.mesh import MeshData, dirichlet, read_gmsh
from fenics_mortar.newton import NewtonOptions
from fenics_mortar.obstacles import Circle, Obstacle, Plane, Polygon, SignedDistance, Spline
from fenics_mortar.pair import ContactPair
from fenics_mortar.problem import ContactProblem
from fenics_mortar.results import ResultsWriter, contact_table, plot
from fenics_mortar.stepping import SteppingOptions, follow_path
from fenics_mortar.tied import TiedPair

__all__ = [
    "AdequacyCheck",
    "Circle",
    "ContactPair",
    "ContactProblem",
    "Coulomb",
    "ElasticTool",
    "Frictionless",
    "Law",
    "MeshData",
    "MeshError",
    "MortarError",
    "NewtonOptions",
    "NotConvergedError",
    "Obstacle",
    "Plane",
    "Polygon",
    "ResultsWriter",
    "SignedDistance",
    "Spline",
    "SteppingOptions",
    "SurfaceError",
    "TiedPair",
    "Tresca",
    "contact_table",
    "dirichlet",
    "follow_path",
    "load_state",
    "mixed_space",
    "plot",
    "read_gmsh",
    "save_state",
    "vector_space",
]
