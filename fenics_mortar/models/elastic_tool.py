# SPDX-License-Identifier: MIT
"""The elastic body that a rigid obstacle stands for: how far it would give way.

The tractions of a solved contact, put on the mesh of the tool where the slave touches it, move its
surface by one linear solve. Had the tool been elastic, the gaps would have been wider by that,
and so a second linear solve, with the tangent of the problem, corrects the solution: the error of
the rigid tool to first order, by the shapes and the supports of both bodies. Energies say why: the
elastic energy W of the soft body, as a function of how the tool is moved, is less by the
complementary energy of the tool at the same forces, whatever happens to the area of contact.

The mesh of a curved tool has facets, that are off the curve as elasticity moves it. That is no
error of the rigid tool, but one of its mesh, and stands beside it.

All is in the frame of the obstacle, so that the tool may have moved and turned by any amount.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

from fenics_mortar.bulk.bodies import find_floating_bodies, label_bodies
from fenics_mortar.bulk.checks import check_residual, check_space
from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.equations.reduced import factored_bulk
from fenics_mortar.interface.facing import nearest_facets, points_of
from fenics_mortar.interface.segments import gauss_rule
from fenics_mortar.interface.surfaces import Surface, extract_surface
from fenics_mortar.mesh.data import MeshData
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils.arguments import check_kind
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MeshError, call_together, check_same_words, together

PREFIX = "fenics_mortar_elastic_tool_"
# Gauss points on a facet of the slave: it may meet several facets of the tool, with kinks between.
NUM_POINTS = 12
# Points for which the nearest facets are looked for at a time.
MOST_POINTS = 2000


class ElasticTool:
    """The mesh and the stiffness of what an obstacle stands for.

    Args:
        obstacle: The obstacle, on the mesh's surface where it was made.
        residual: UFL form of the internal forces; its tangent at the present ``u`` counts.
        u: Displacement of the mesh.
        data: Mesh, tags and names; of the same communicator as the problem's.
        surface: Name or tag of the boundary that touches.
        bcs: Dirichlet conditions where the tool is gripped; they hold it, whatever their values.

    Raises:
        ValueError: If nothing holds the tool.
        MeshError: If a name or tag is unknown or has no facets.

    Note:
        Collective.

    Example:
        ``tool = fm.ElasticTool(circle, residual, u, data, "tool/rim", bcs=grips)``, and of the
        problem with the circle, ``adequacy=fm.AdequacyCheck(tools=[tool])``.
    """

    def __init__(
        self,
        obstacle: Obstacle,
        residual: Any,
        u: Any,
        data: MeshData,
        surface: str | int,
        *,
        bcs: Sequence[Any] = (),
    ) -> None:
        check_kind("obstacle", obstacle, Obstacle, "a rigid obstacle, as Circle(...)")
        check_kind("u", u, fem.Function, "a function of dolfinx")
        check_kind("data", data, MeshData, "the MeshData of the mesh of the tool")
        with together(data.mesh.comm, "ElasticTool"):
            check_kind("bcs", bcs, (list, tuple), "a list of Dirichlet conditions")
            check_kind("residual", residual, ufl.Form, "a UFL form")
            check_residual("residual", residual, u)
            data.boundary_tag(surface)
            if data.mesh is not u.function_space.mesh:
                raise MeshError("data is of another mesh than u")
        check_same_words(data.mesh.comm, "ElasticTool", {"surface": surface, "bcs": len(bcs)})
        check_space(u.function_space, ())
        self.obstacle = obstacle
        space = DisplacementSpace(u.function_space)
        self._bulk = Bulk(residual, u, list(bcs), None, space)
        self._surface = extract_surface(
            space, data.facet_tags, data.boundary_tag(surface), str(surface)
        )
        self._bulk.assemble_tangent()
        if find_floating_bodies(self._bulk, *label_bodies(self._bulk.V)):
            raise ValueError(f"the tool of {obstacle}: bcs have to hold it where it is gripped")
        self._factors = factored_bulk(self._bulk, PREFIX)

    def give(self, contacts: Sequence[Contact]) -> list[Array]:
        """How far the tool gives way to contact forces (collective).

        Args:
            contacts: The pairs of its obstacle, at a solved state.

        Returns:
            Of each pair, the motion of the tool along the normals of the slave nodes, shape (slave
            nodes,) [length]: means by the multipliers' functions, as gaps are.
        """
        touching = [self._touching(contact) for contact in contacts]
        load = np.zeros_like(self._surface.X)
        for points in touching:
            points.add_tractions(load)
        self._surface.comm.Allreduce(MPI.IN_PLACE, load)
        force, answer = self._bulk.K.createVecs()
        self._surface.scatter_add(load, force.array)
        force.array[self._bulk.held] = 0.0
        self._factors.apply(force, answer)
        moved = self._surface.gather(answer.array_r)
        return [points.means(points.along_normals(moved)) for points in touching]

    def flatness(self, contacts: Sequence[Contact]) -> list[Array]:
        """How far the facets of its mesh are inside the obstacle, as ``give`` (collective)."""
        touching = [self._touching(contact) for contact in contacts]
        return [points.means(-points.distances(self._surface.X)) for points in touching]

    def _touching(self, contact: Contact) -> _Touching:
        return _Touching(contact, self.obstacle, self._surface)


class _Touching:
    """Points of the slave facets of a pair, and where they touch the mesh of the tool.

    Args:
        contact: The pair, at a solved state.
        obstacle: Its obstacle.
        surface: What touches of the tool's mesh.
    """

    def __init__(self, contact: Contact, obstacle: Obstacle, surface: Surface) -> None:
        self._contact, self._obstacle, o = contact, obstacle, contact.operators
        self._points = points_of(o.segments, gauss_rule(NUM_POINTS))
        self._measure = self._points.measure(o.x)
        own = obstacle.to_own_frame(self._points.of(o.x).reshape(-1, 2))
        portions = np.array_split(own, len(own) // MOST_POINTS + 1)
        places = [nearest_facets(part, surface.X, surface) for part in portions]
        self._ends, parts = (np.concatenate(found) for found in zip(*places, strict=True))
        on_facet = np.clip(parts, 0.0, 1.0)
        self._shares = np.stack([1.0 - on_facet, on_facet], axis=1)

    def add_tractions(self, load: Array) -> None:
        """Add what the tractions put on the nodes of the tool, in its own frame (local)."""
        forces = self._points.of(self._contact.z) * self._measure[:, :, None]
        forces = forces.reshape(-1, 2) @ self._obstacle.turn
        np.add.at(load, self._ends, self._shares[:, :, None] * forces[:, None])

    def along_normals(self, moved: Array) -> Array:
        """Component of a motion of the tool's nodes along the slave's normals, at the points."""
        motion = self._on_tool(moved) @ self._obstacle.turn.T
        normals = self._points.direction(self._contact.operators.n).reshape(-1, 2)
        return np.asarray((motion * normals).sum(axis=1))

    def distances(self, X: Array) -> Array:
        """Signed distances from the obstacle of what of the tool the points touch (collective)."""
        distance = f"the distance of '{self._obstacle.name}'"
        local = partial(self._obstacle.local, self._on_tool(X))
        return call_together(self._contact.slave.comm, distance, local)[0]

    def means(self, values: Array) -> Array:
        """Means of values at the points for each slave node, 0 where none is near (collective)."""
        parts = self._points.dual_moments(
            self._contact.operators.x, values.reshape(self._measure.shape)
        )
        sums = np.zeros((2, self._contact.slave.num_nodes))
        for target, part in zip(sums, parts, strict=True):
            np.add.at(target, self._points.slave, part)
        self._contact.slave.comm.Allreduce(MPI.IN_PLACE, sums)
        return np.asarray(sums[0] / np.where(sums[1] > 0.0, sums[1], 1.0))

    def _on_tool(self, nodal: Array) -> Array:
        """What the tool's nodes have, (nodes, 2), where the points touch it, (points, 2)."""
        return np.einsum("pk,pkc->pc", self._shares, nodal[self._ends])
