# SPDX-License-Identifier: MIT
"""A case in space as a contact problem, its nodes and surfaces as arrays on all ranks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np
from scipy.spatial.transform import Rotation

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.stability.random_bodies import Array
from demos.studies.stability.space_case import Solid, SpaceCase
from fenics_mortar import energies
from fenics_mortar.mesh.space import input_nodes
from fenics_mortar.utils import compat
from meshes import mapped_boxes

# Corners of the facets of cells, in the order of VTK.
FACES = {
    "hexahedron": mapped_boxes.FACES,
    "tetrahedron": [(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)],
}


@dataclass
class SpaceScene:
    """A case as a problem; lengths and forces are in its own frame and units.

    Attributes:
        internal, external: Forms of the virtual work of the stresses and of the loads.
        time, last: Time of the loads, and of the accepted state before.
    """

    case: SpaceCase
    data: fm.MeshData
    u: Any
    internal: Any
    external: Any
    problem: Any
    given: dict[str, Any]
    loads: list[Any]
    tools: dict[str, Any]
    time: float = 0.0
    last: float = 0.0

    def set_loads(self, time: float) -> None:
        """Set all motions and loads for a time from 0 on."""
        self.time, case, frame = time, self.case, self.case.frame
        for name, function in self.given.items():
            motion = case.held[name]
            function.interpolate(
                lambda x, m=motion: (
                    frame.unit * frame.vector(m.moved(frame.own(x.T), time) - frame.own(x.T)).T
                )
            )
        for name, tool in self.tools.items():
            now = case.tools[name].motion.at(time)
            tool.place[:] = np.append(frame.unit * frame.vector(now[:3]), frame.axial(now[3:]))
        forces = [frame.stress / frame.unit * frame.vector(s.load(time)) for s in case.solids]
        for load, values in zip(self.loads, np.transpose(forces), strict=True):
            _set(load, case, self.data, values)

    # Nodes: identifiers are sorted, so that all frames and ranks have the same order

    def _gathered(self, owned: Array) -> Array:
        """Values (owned nodes, k) of all ranks, ordered by identifiers (collective)."""
        V = self.u.function_space
        names = np.concatenate(V.mesh.comm.allgather(input_nodes(V)[: len(owned)]))
        return np.concatenate(V.mesh.comm.allgather(owned))[np.lexsort(names.T[::-1])]

    @cached_property
    def X(self) -> Array:
        """Positions of all nodes in the mesh, (n, 3) [unit] (collective)."""
        owned = self.u.function_space.dofmap.index_map.size_local
        x = self.u.function_space.tabulate_dof_coordinates()[:owned]
        return self.case.frame.own(self._gathered(x))

    @cached_property
    def prescribed(self) -> Array:
        """Whether a node is prescribed, (n,) (collective)."""
        bulk = self.problem.equations.bulk
        flags = np.zeros(bulk.num_owned, bool)
        flags[bulk.prescribed_dofs] = True
        return self._gathered(flags.reshape(-1, 3)).any(axis=1)

    def positions(self) -> Array:
        """Present positions of all nodes, (n, 3) [unit] (collective)."""
        owned = self.u.function_space.dofmap.index_map.size_local
        u = self._gathered(self.u.x.array.reshape(-1, 3)[:owned])
        frame = self.case.frame
        return np.asarray(self.X + u @ frame.turn / frame.unit)

    def forces(self, form: Any) -> Array:
        """Forces of a form on all nodes, (n, 3) [unit of stress unit^2] (collective)."""
        r = compat.create_vector(self.u.function_space)
        compat.assemble_vector(r, compat.form(form))
        owned = r.array_r.reshape(-1, 3).copy()
        r.destroy()
        return self._in_units(self._gathered(owned))

    def contact_forces(self) -> list[tuple[Array, Array]]:
        """Forces of the package on slave and master of each pair, (n, 3) each (collective)."""
        bulk, found = self.problem.equations.bulk, []
        for contact in self.problem.equations.contacts:
            parts = []
            sides = contact.slave, contact.master
            for side, force in zip(sides, contact.operators.force(contact.z_u), strict=True):
                owned = np.zeros(bulk.num_owned)
                side.scatter_add(force, owned)
                parts.append(self._in_units(self._gathered(owned.reshape(-1, 3))))
            found.append((parts[0], parts[1]))
        return found

    def _in_units(self, force: Array) -> Array:
        frame = self.case.frame
        return np.asarray(force @ frame.turn / (frame.stress * frame.unit**2))

    @cached_property
    def _numbers(self) -> dict[tuple[int, ...], int]:
        """Number of the node at each vertex, edge, facet and cell by the vertices (collective)."""
        V = self.u.function_space
        owned = V.dofmap.index_map.size_local
        names = self._gathered(input_nodes(V)[:owned]).tolist()
        return {tuple(v for v in name if v >= 0): i for i, name in enumerate(names)}

    @cached_property
    def arrays(self) -> dict[str, Any]:
        """Cells, bodies and boundaries by vertices, see ``mapped_boxes``."""
        boxes = [solid.box for solid in self.case.solids]
        return mapped_boxes.arrays(boxes, cell=self.case.cell)

    @cached_property
    def triangles(self) -> dict[str, Array]:
        """Triangles of the nodes of each boundary, outward, (n, 3) each (collective)."""
        inside = {}
        for cell in self.arrays["cells"].tolist():
            middle = self.arrays["points"][cell].mean(axis=0)
            for face in FACES[self.case.cell]:
                inside[tuple(sorted(cell[i] for i in face))] = middle
        found = {}
        for name, facets in self.arrays["boundaries"].items():
            rows = [self._pieces(f, inside[tuple(sorted(f))]) for f in facets.tolist()]
            found[name] = np.concatenate(rows)
        return found

    def _pieces(self, facet: list[int], inside: Array) -> Array:
        """Triangles of a facet by the vertices around it."""
        x, n = self.arrays["points"][facet], len(facet)
        if np.cross(x[1] - x[0], x[2] - x[0]) @ (x[0] - inside) < 0.0:
            facet = facet[::-1]
        number = self._numbers
        at = [number[(v,)] for v in facet]
        if self.case.degree == 1:
            return np.array([[at[0], at[i], at[i + 1]] for i in range(1, n - 1)])
        mid = [number[tuple(sorted((facet[i], facet[(i + 1) % n])))] for i in range(n)]
        ends = [[at[i], mid[i], mid[i - 1]] for i in range(n)]
        if n == 3:
            return np.array([*ends, mid])
        middle = number[tuple(sorted(facet))]
        return np.array([*ends, *([mid[i - 1], mid[i], middle] for i in range(n))])

    @cached_property
    def hulls(self) -> dict[str, Array]:
        """Triangles of the whole surface of each body (collective)."""
        found = {}
        for solid in self.case.solids:
            sides = {solid.box.boundary(side) for side in mapped_boxes.SIDES}
            found[solid.box.name] = np.concatenate([self.triangles[side] for side in sides])
        return found


def build(case: SpaceCase, comm: MPI.Comm = MPI.COMM_SELF, **options: Any) -> SpaceScene:
    """Create mesh and problem (collective)."""
    frame = case.frame
    boxes = [replace(s.box, x=frame.point(s.box.x)) for s in case.solids]
    data = mapped_boxes.mesh(boxes, cell=case.cell, comm=comm)
    V = fm.vector_space(data.mesh, case.degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    moduli = np.array([energies.lame(frame.stress * s.E, s.nu) for s in case.solids])
    mu, lmbda = (_by_body(case, data, values) for values in moduli.T)
    loads = [_by_body(case, data, np.zeros(len(case.solids))) for _ in range(3)]
    psi = energies.neo_hookean(u, mu, lmbda) * ufl.dx(degree=2 * case.degree + 1)
    internal = ufl.derivative(psi, u, v)
    external = ufl.inner(ufl.as_vector(loads), v) * ufl.dx(degree=case.degree)
    given = {name: fem.Function(V) for name in case.held}
    bcs = [fm.dirichlet(V, data, name, function) for name, function in given.items()]
    tools = {name: tool.make(frame, name) for name, tool in case.tools.items()}
    pairs = [
        fm.ContactPair(data, slave, tools.get(master, master), law=rule.law(frame))
        for (slave, master), rule in zip(case.pairs, case.laws, strict=True)
    ]
    residual = internal - external
    problem = fm.ContactProblem(
        residual, u, pairs, bcs=bcs, petsc_options_prefix="space_trial_", **options
    )
    return SpaceScene(case, data, u, internal, external, problem, given, loads, tools)


def _by_body(case: SpaceCase, data: fm.MeshData, values: Array) -> fem.Function:
    """A function that is constant in each body (local)."""
    function = fem.Function(compat.scalar_space(data.mesh, 0, "DG"))
    _set(function, case, data, values)
    return function


def _set(function: fem.Function, case: SpaceCase, data: fm.MeshData, values: Any) -> None:
    """Set values of bodies (local)."""
    dofs = compat.dofmap(function.function_space)[:, 0]
    for solid, value in zip(case.solids, values, strict=True):
        function.x.array[dofs[data.cell_tags.find(data.bodies[solid.box.name])]] = value


def turned(box: Any, vector: Any, about: Any) -> Array:
    """Nodes of a box, turned by a rotation vector about a point."""
    R = Rotation.from_rotvec(vector).as_matrix()
    return np.asarray((box - np.asarray(about)) @ R.T + about)


def volume(solid: Solid) -> tuple[float, Array]:
    """Volume of a body [unit^3], and its centroid [unit], by its tetrahedra."""
    found = mapped_boxes.arrays([solid.box], cell="tetrahedron")
    x = found["points"][found["cells"]]
    sizes = np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) / 6.0
    return float(sizes.sum()), sizes @ x.mean(axis=1) / sizes.sum()
