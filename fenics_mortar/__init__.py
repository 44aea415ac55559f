# SPDX-License-Identifier: MIT
"""Mortar contact of deformable bodies at finite deformation for FEniCSx, in the plane and in space.

Apart from the public names, ``laws`` has all contact laws, with base classes and helpers for those
of users, ``energies`` has energies of the bodies in UFL, and ``sensitivity`` has recorded paths,
controls and quantities of derivatives.

With DOLFINx in wheels import this package, or mpi4py, before dolfinx, which otherwise fails with
"libmpi.so.12: cannot open shared object file".
"""

if __name__ != "fenics_mortar":
    raise ImportError(
        f"fenics_mortar was imported as {__name__!r}: install it, or put the folder of the clone "
        "itself, not the folder above it, on PYTHONPATH (. .ci/env.sh in the clone)"
    )

import gc as _gc

# First: with DOLFINx from PyPI mpi4py finds the MPI library that dolfinx and PETSc then need.
from mpi4py import MPI as _MPI  # noqa: F401

# Almost all objects made here live until the end: looking for dead ones took a fifth of the time.
_collects = _gc.isenabled()
_gc.disable()
try:
    from fenics_mortar import energies as energies
    from fenics_mortar import laws as laws
    from fenics_mortar.bulk.history import quadrature_function
    from fenics_mortar.bulk.inertia import Velocity
    from fenics_mortar.contact.conductance import (
        Conductance,
        GapConductance,
        NodalFlux,
        PressureConductance,
    )
    from fenics_mortar.contact.law import Coulomb, Frictionless, Law, Tresca
    from fenics_mortar.contact.pair import ContactPair, Discretization, Pretension, TiedPair
    from fenics_mortar.contact.view import PairView
    from fenics_mortar.equations.general import State
    from fenics_mortar.equations.linearized import LinearVector
    from fenics_mortar.io.checkpoint import load_state, save_state
    from fenics_mortar.io.paraview import ResultsWriter, contact_table
    from fenics_mortar.io.picture import plot
    from fenics_mortar.mesh.data import MeshData, dirichlet
    from fenics_mortar.mesh.from_arrays import mesh_from_arrays
    from fenics_mortar.mesh.from_meshio import mesh_from_meshio
    from fenics_mortar.mesh.gmsh_reader import read_gmsh
    from fenics_mortar.models.in_space import InSpace
    from fenics_mortar.models.model_check import ModelCheck
    from fenics_mortar.models.model_error import ElasticObstacle, ModelReport
    from fenics_mortar.newton.loop import NewtonOptions, NewtonReport
    from fenics_mortar.obstacles.obstacle import Obstacle, SignedDistance
    from fenics_mortar.obstacles.revolved import Cone, Cylinder, Extruded, Revolved, Torus
    from fenics_mortar.obstacles.shapes import Circle, Plane, Polygon, Sphere, Spline
    from fenics_mortar.path.dynamics import Dynamics
    from fenics_mortar.path.report import DynamicsReport, PathReport
    from fenics_mortar.path.stepping import SteppingOptions, follow_path
    from fenics_mortar.problem import ContactProblem
    from fenics_mortar.rigid.spread import RigidBoundary, SpreadLoad
    from fenics_mortar.sensitivity.gradient import gradient
    from fenics_mortar.utils.compat import mixed_space, scalar_space, vector_space
    from fenics_mortar.utils.errors import MeshError, MortarError, NotConvergedError, SurfaceError
    from fenics_mortar.verify.certificate import Certificate, PairCertificate
    from fenics_mortar.verify.estimate import ErrorEstimate
    from fenics_mortar.verify.tangent import TangentCheck
finally:
    if _collects:
        _gc.enable()

__version__ = "0.1.0"  # single source: read by pyproject.toml

__all__ = [
    "Certificate", "Circle", "Conductance", "Cone", "ContactPair", "ContactProblem", "Coulomb",
    "Cylinder", "Discretization", "Dynamics", "DynamicsReport", "ElasticObstacle", "ErrorEstimate",
    "Extruded", "Frictionless", "GapConductance", "InSpace", "Law", "LinearVector", "MeshData",
    "MeshError", "ModelCheck", "ModelReport", "MortarError", "NewtonOptions", "NewtonReport",
    "NodalFlux", "NotConvergedError", "Obstacle", "PairCertificate", "PairView", "PathReport",
    "Plane", "Polygon", "PressureConductance", "Pretension", "ResultsWriter", "Revolved",
    "RigidBoundary", "SignedDistance", "Sphere", "Spline", "SpreadLoad", "State", "SteppingOptions",
    "SurfaceError", "TangentCheck", "TiedPair", "Torus", "Tresca", "Velocity", "contact_table",
    "dirichlet", "follow_path", "gradient", "load_state", "mesh_from_arrays", "mesh_from_meshio",
    "mixed_space", "plot", "quadrature_function", "read_gmsh", "save_state", "scalar_space",
    "vector_space",
]  # fmt: skip
