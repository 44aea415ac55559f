# SPDX-License-Identifier: MIT
"""Mortar contact of deformable bodies at finite deformation for FEniCSx, in 2D."""

from fenics_mortar.contact.laws import Coulomb, Frictionless, Law, Tresca
from fenics_mortar.contact.pair import ContactPair
from fenics_mortar.contact.tied import TiedPair
from fenics_mortar.io.checkpoint import load_state, save_state
from fenics_mortar.io.paraview import ResultsWriter
from fenics_mortar.io.picture import plot
from fenics_mortar.io.table import contact_table
from fenics_mortar.mesh.data import MeshData
from fenics_mortar.mesh.dirichlet import dirichlet
from fenics_mortar.mesh.gmsh_reader import read_gmsh
from fenics_mortar.models.adequacy import AdequacyCheck
from fenics_mortar.models.elastic_tool import ElasticTool
from fenics_mortar.newton.loop import NewtonOptions
from fenics_mortar.obstacles.obstacle import Obstacle, SignedDistance
from fenics_mortar.obstacles.shapes import Circle, Plane, Polygon, Spline
from fenics_mortar.path.stepping import SteppingOptions, follow_path
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.compat import mixed_space, vector_space
from fenics_mortar.utils.errors import MeshError, MortarError, NotConvergedError, SurfaceError

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
