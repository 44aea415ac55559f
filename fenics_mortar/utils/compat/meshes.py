# SPDX-License-Identifier: MIT
"""Meshes and their geometry."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import mesh as dmesh

from fenics_mortar.utils.compat.compiler import quiet_compiler


def cell_name(mesh: dmesh.Mesh) -> str:
    """Return ``"triangle"`` or ``"quadrilateral"``.

    ``mesh.ufl_cell().cellname`` became a property in 0.10; the enumeration did not change.
    """
    return mesh.topology.cell_type.name


def num_corners(mesh: dmesh.Mesh) -> int:
    """Return the number of vertices of a cell, 3 or 4."""
    return {"triangle": 3, "quadrilateral": 4}[cell_name(mesh)]


@quiet_compiler()
def create_mesh(
    comm: MPI.Comm, cells: npt.ArrayLike, x: npt.ArrayLike, cell_name: str, degree: int = 1
) -> dmesh.Mesh:
    """Create a plane mesh from arrays (collective).

    ``ufl.VectorElement`` was replaced by ``basix.ufl.element``, and in 0.10 element and ``x`` were
    exchanged.

    Args:
        comm: Communicator of the mesh.
        cells: Global numbers of the nodes in basix order, shape (num_cells, nodes per cell); each
            rank passes its part, possibly of shape (0, nodes per cell).
        x: Coordinates of this rank's part of the nodes, shape (num_nodes, 2) [length]; the parts
            are numbered one rank after the other.
        cell_name: ``"triangle"`` or ``"quadrilateral"``.
        degree: Degree of the geometry.
    """
    cells = np.ascontiguousarray(cells, dtype=np.int64)
    x = np.ascontiguousarray(x, dtype=np.float64).reshape(-1, 2)
    if hasattr(ufl, "VectorElement"):
        element = ufl.VectorElement("Lagrange", cell_name, degree)
        return dmesh.create_mesh(comm, cells, x, ufl.Mesh(element))
    basix_ufl = importlib.import_module("basix.ufl")
    element = basix_ufl.element("Lagrange", cell_name, degree, shape=(2,))
    return dmesh.create_mesh(comm, cells, x=x, e=ufl.Mesh(element))


@quiet_compiler()
def model_to_mesh(
    model: Any, comm: MPI.Comm, rank: int = 0
) -> tuple[dmesh.Mesh, dmesh.MeshTags, dmesh.MeshTags]:
    """Make mesh, cell tags and facet tags of the plane gmsh model on rank ``rank`` (collective).

    ``io.gmshio`` became ``io.gmsh`` in 0.10 and its triple a tuple with names, in which tags can be
    missing; empty tags are returned in this case. With 0.5 the mesh has ghost cells.

    Args:
        model: The module ``gmsh.model`` on rank ``rank``, any object on the others.
        comm: Communicator of the mesh.
        rank: Rank with the model.
    """
    new = importlib.util.find_spec("dolfinx.io.gmsh") is not None
    gmshio = importlib.import_module("dolfinx.io.gmsh" if new else "dolfinx.io.gmshio")
    mesh, *tags = gmshio.model_to_mesh(model, comm, rank, gdim=2)[:3]
    mesh.topology.create_entities(1)
    none = np.empty(0, dtype=np.int32)
    tags = [dmesh.meshtags(mesh, d, none, none) if t is None else t for d, t in zip((2, 1), tags)]
    return mesh, tags[0], tags[1]


def geometry_dofmap(mesh: dmesh.Mesh) -> npt.NDArray[np.int32]:
    """Return the local geometry nodes of all local cells, shape (num_cells, num_nodes).

    The list became a two-dimensional array in 0.7, one of several (``dofmaps``) in 0.11.
    """
    geometry = mesh.geometry
    if hasattr(geometry, "dofmaps") and not callable(geometry.dofmaps):
        return np.asarray(geometry.dofmaps[0])
    return as_table(geometry.dofmap, geometry.cmap.create_dof_layout())


def as_table(table: Any, layout: Any) -> npt.NDArray[np.int32]:
    """View an adjacency list (until 0.6) as an array (cells, dofs), also without cells."""
    if isinstance(table, np.ndarray):
        return table
    return table.array.reshape(table.num_nodes, layout.num_dofs)


def are_tags_of(tags: Any, mesh: dmesh.Mesh) -> bool:
    """Whether tags were made on the topology of a mesh (local, equal on all ranks).

    Tags of release 0.5 have a mesh, those of later ones a topology, which from 0.9 on is within an
    object of Python.
    """
    own = tags.topology if hasattr(tags, "topology") else tags.mesh.topology
    other = mesh.topology
    return getattr(own, "_cpp_object", own) is getattr(other, "_cpp_object", other)


def settle_coordinate_element(mesh: dmesh.Mesh) -> None:
    """Give the mesh's domain the element that the form compiler gives it, on all ranks (local).

    FFCx 0.5 replaces the element by one with a variant while it compiles a form. Ranks that load
    the result from the cache keep the old one, so that signatures of later forms differ.
    """
    domain = mesh.ufl_domain()
    element = getattr(domain, "_ufl_coordinate_element", None)
    if not hasattr(ufl, "VectorElement") or not isinstance(element, ufl.VectorElement):
        return
    if element.sub_elements()[0]._variant is None:
        degree, rule = element.degree(), element.quadrature_scheme()
        scalar = ufl.FiniteElement(
            element.family(), element.cell(), degree, rule, variant="equispaced"
        )
        domain._ufl_coordinate_element = ufl.VectorElement(scalar)
