# SPDX-License-Identifier: MIT
"""Meshes on all ranks: reading, areas, lengths, nodes, errors that all raise."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

from fenics_mortar.mesh.gmsh_reader import read_gmsh
from fenics_mortar.utils import compat
from fenics_mortar.utils.errors import MeshError
from meshes import half_cylinder_on_block, indenter_on_block, rings, two_blocks

COMM = MPI.COMM_WORLD
CELLS = ("triangle", "quadrilateral")
SCRIPTS = {
    "two_blocks": two_blocks.build,
    "rings": rings.build,
    "indenter_on_block": indenter_on_block.build,
    "half_cylinder_on_block": lambda **options: half_cylinder_on_block.build(h=0.1, **options),
}


def on_root(function, *args, **options):
    """Call ``function`` on rank 0 only; return its value there and ``None`` on the others."""
    return function(*args, **options) if COMM.rank == 0 else None


def read(build, **options):
    """Build a model on rank 0 and read it on all."""
    return read_gmsh(on_root(build, **options), COMM)


def measure(data, dim, entities):
    """Area or volume of cells, length or area of exterior facets of ``dim``, over all ranks."""
    entities = np.sort(entities).astype(np.int32)
    tags = dmesh.meshtags(data.mesh, dim, entities, np.ones(entities.size, dtype=np.int32))
    integral = ufl.Measure(
        "dx" if dim == data.mesh.topology.dim else "ds", domain=data.mesh, subdomain_data=tags
    )(1)
    one = fem.Constant(data.mesh, PETSc.ScalarType(1.0))
    return COMM.allreduce(fem.assemble_scalar(compat.form(one * integral)))


def area(data, body):
    return measure(data, data.mesh.topology.dim, data.cell_tags.find(data.body_tag(body)))


def length(data, boundary):
    return measure(data, data.mesh.topology.dim - 1, data.boundary_facets(boundary))


def num_facets(data, boundary):
    owned = data.mesh.topology.index_map(data.facet_tags.dim).size_local
    return COMM.allreduce(int((data.boundary_facets(boundary) < owned).sum()))


def nodes_on(data, boundary):
    """Coordinates of the vertices of a boundary on all ranks, shape (num_nodes, 2), sorted."""
    V = compat.scalar_space(data.mesh, 1)
    data.mesh.topology.create_connectivity(1, 2)
    dofs = fem.locate_dofs_topological(V, 1, data.boundary_facets(boundary))
    owned = dofs[dofs < V.dofmap.index_map.size_local]
    return gathered(V.tabulate_dof_coordinates()[owned, :2])


def gathered(x):
    """Gather the rows of all ranks in an order that does not depend on rounding."""
    x = np.concatenate(COMM.allgather(x))
    return x[np.lexsort(x.round(10).T + 0.0)]


def raises_on_all_ranks(match, function, *args, **options):
    """Check that each rank raises a MeshError with the same message."""
    with pytest.raises(MeshError, match=match) as caught:
        function(*args, **options)
    assert len(set(COMM.allgather(str(caught.value)))) == 1
