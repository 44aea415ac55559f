# SPDX-License-Identifier: MIT
"""A random case as a contact problem: mesh and tags from arrays, neo-Hookean bodies, loads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

import fenics_mortar as fm
from demos.studies.common import neo_hookean
from demos.studies.stability.case import Case, Prescribed, at_time
from demos.studies.stability.random_bodies import Array, Body
from demos.studies.stability.shape_case import ShapeCase
from demos.studies.stability.shapes import Shape
from demos.studies.stability.supported_case import SupportedCase
from fenics_mortar.energies import lame
from fenics_mortar.mesh.space import input_nodes
from fenics_mortar.utils import compat


@dataclass
class Scene:
    """A case as a problem."""

    case: Case
    data: fm.MeshData
    problem: fm.ContactProblem
    residual: Any
    prescribed: list[Any]
    traction: Any
    forces: Forces | None = None
    time: float = 0.0

    def set_loads(self, time: float) -> None:
        """Set prescribed displacements, traction and forces on bodies for a time from 0 on."""
        self.time = time
        for constant, prescribed in zip(self.prescribed, self.case.prescribed, strict=True):
            value = at_time(prescribed.motion, time)
            constant.value = value if prescribed.component is None else value[prescribed.component]
        self.traction.value = at_time(self.case.traction, time)
        if self.forces is not None:
            self.forces.set(time)

    def positions(self) -> Array:
        """Present positions of all nodes in the order of the input, on all ranks (collective)."""
        return self.case.x + self.problem.equations.bulk.by_input_node()[1]

    def bulk_forces(self) -> Array:
        """Forces of the stresses minus the loads on all nodes, ordered as ``places`` (collective).

        They are balanced by contact forces and reactions.
        """
        V = self.problem.equations.bulk.V
        r = compat.create_vector(V)
        compat.assemble_vector(r, compat.form(self.residual))
        owned = r.array_r.reshape(-1, 2).copy()
        r.destroy()
        names = np.concatenate(V.mesh.comm.allgather(input_nodes(V)[: len(owned), 0]))
        return np.concatenate(V.mesh.comm.allgather(owned))[np.argsort(names)]


class Forces:
    """Forces and moments on the bodies of a case, distributed over them.

    Attributes:
        density: Body force [stress / length].
    """

    def __init__(self, case: SupportedCase, data: fm.MeshData) -> None:
        """Set all forces to zero."""
        X = ufl.SpatialCoordinate(data.mesh)
        self._case, self._body = case, _body_of_cells(case, data)
        self._parts = [_by_body(case, data, np.zeros(len(case.bodies))) for _ in range(3)]
        places = np.array([centre for _, centre, _ in case.areas])
        x, y = (_by_body(case, data, column) for column in places.T)
        along, across, spin = self._parts
        self.density = ufl.as_vector((along - spin * (X[1] - y), across + spin * (X[0] - x)))

    def set(self, time: float) -> None:
        """Set the forces for a time in [0, 2]."""
        loads = self._case.loads
        now = [at_time(loads[:, i], time) for i in range(loads.shape[1])]
        for part, values in zip(self._parts, self._case.densities(np.array(now)).T, strict=True):
            part.x.array[compat.dofmap(part.function_space)[:, 0]] = values[self._body]


def build(case: Case, comm: MPI.Comm) -> Scene:
    """Create mesh and problem (collective)."""
    data = _mesh_data(case, comm)
    mesh = data.mesh
    V = fm.vector_space(mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    mu, lmbda = (_by_body(case, data, parameters) for parameters in zip(*_lame(case)))
    P = neo_hookean(u, mu, lmbda)
    traction = fem.Constant(mesh, np.zeros(2))
    on = data.boundaries.get(case.pressed)
    ds = ufl.Measure("ds", mesh, subdomain_data=data.facet_tags)
    dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 3})
    residual = ufl.inner(P, ufl.grad(v)) * dx
    forces = None
    if isinstance(case, SupportedCase):
        forces = Forces(case, data)
        residual -= ufl.inner(forces.density, v) * dx
    elif on is not None:
        residual -= ufl.inner(traction, v) * ds(on)
    prescribed, bcs = [], []
    for given in case.prescribed:
        zero = np.zeros(2) if given.component is None else PETSc.ScalarType(0.0)
        value = fem.Constant(mesh, zero)
        prescribed.append(value)
        bcs.append(_dirichlet(case, V, data, given, value))
    pairs = _pairs(case, data)
    problem = fm.ContactProblem(
        residual, u, pairs, bcs=bcs, petsc_options_prefix="trial_", **case.problem_options
    )
    return Scene(case, data, problem, residual, prescribed, traction, forces)


def _dirichlet(case: Case, V: Any, data: fm.MeshData, prescribed: Prescribed, value: Any) -> Any:
    """A prescribed displacement of a boundary, or of the nodes of a grip."""
    name, side = prescribed.boundary.split("/")
    body = case.bodies[case.number_of(name)]
    if not isinstance(body, Shape) or side not in body.grips:
        return fm.dirichlet(V, data, prescribed.boundary, value, prescribed.component)
    nodes = np.isin(input_nodes(V)[:, 0], case.nodes_of(prescribed.boundary))
    dofs = np.flatnonzero(nodes).astype(np.int32)
    if prescribed.component is None:
        return fem.dirichletbc(value, dofs, V)
    return fem.dirichletbc(value, 2 * dofs + prescribed.component, V.sub(prescribed.component))


def _pairs(case: Case, data: fm.MeshData) -> list[fm.ContactPair]:
    """The pairs; those of supported bodies and of shapes have laws, and rigid planes as masters."""
    options = {"discretization": fm.Discretization(**case.pair_options)}
    if not isinstance(case, (SupportedCase, ShapeCase)):
        return [fm.ContactPair(data, *names, **options) for names in case.pairs]
    planes = {name: fm.Plane(*where, name=name) for name, where in case.planes.items()}
    return [
        fm.ContactPair(data, slave, planes.get(master, master), law=rule.law(), **options)
        for (slave, master), rule in zip(case.pairs, case.rules, strict=True)
    ]


def _lame(case: Case) -> list[tuple[float, float]]:
    """Lame's parameters of the bodies."""
    return [lame(body.E, body.nu) for body in case.bodies]


def _by_body(case: Case, data: fm.MeshData, values: tuple[float, ...]) -> fem.Function:
    """A function that is constant in each body."""
    function = fem.Function(compat.scalar_space(data.mesh, 0, "DG"))
    dofs = compat.dofmap(function.function_space)[:, 0]
    function.x.array[dofs] = np.array(values)[_body_of_cells(case, data)]
    return function


def _body_of_cells(case: Case, data: fm.MeshData) -> Array:
    """Number of the body of each local cell."""
    cells = compat.geometry_dofmap(data.mesh)[:, 0]
    nodes = np.asarray(data.mesh.geometry.input_global_indices)[cells]
    return np.searchsorted(case.first_nodes, nodes, side="right") - 1


def _mesh_data(case: Case, comm: MPI.Comm) -> fm.MeshData:
    """Mesh, and tags of all boundaries of the case (collective)."""
    x, cells = case.x, case.cells
    if comm.rank:
        x, cells = x[:0], cells[:0]
    mesh = compat.create_mesh(comm, cells, x, case.cell)
    mesh.topology.create_connectivity(1, 2)
    mesh.topology.create_connectivity(1, 0)
    names = [f"{body.name}/{side}" for body in case.bodies for side in _surfaces(body)]
    tag_of_edge = {
        tuple(sorted(edge)): tag
        for tag, name in enumerate(names, start=1)
        for edge in zip(case.nodes_of(name)[:-1].tolist(), case.nodes_of(name)[1:].tolist())
    }
    given = np.empty(_num_vertices(mesh), np.int64)
    vertices = mesh.topology.connectivity(2, 0).array.reshape(-1, cells.shape[1])
    numbers = np.asarray(mesh.geometry.input_global_indices, np.int64)
    given[vertices] = numbers[compat.geometry_dofmap(mesh)]
    facets = dmesh.exterior_facet_indices(mesh.topology)
    ends = mesh.topology.connectivity(1, 0).array.reshape(-1, 2)[facets]
    tags = [tag_of_edge.get(tuple(sorted(edge)), 0) for edge in given[ends].tolist()]
    order = np.argsort(facets)
    facet_tags = dmesh.meshtags(mesh, 1, facets[order], np.array(tags, np.int32)[order])
    return fm.MeshData(mesh, None, facet_tags, {}, dict(zip(names, range(1, 1 + len(names)))))


def _surfaces(body: Body) -> list[str]:
    """Names of the tagged sides: a grip may be a part of one."""
    return body.surfaces if isinstance(body, Shape) else list(body.sides)


def _num_vertices(mesh: dmesh.Mesh) -> int:
    """Local vertices, ghosts included."""
    index_map = mesh.topology.index_map(0)
    return index_map.size_local + index_map.num_ghosts
