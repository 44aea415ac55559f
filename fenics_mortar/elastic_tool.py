# SPDX-License-Identifier: MIT
"""The elastic body that a rigid obstacle stands for: how far it would give way.

The tractions of a solved contact, put on the mesh of the tool where the slave touches it, move its
surface by one linear solve. Had the tool been elastic, the gaps would have been wider by that,
and so a second linear solve, with the tangent of the problem, corrects the solution: the error of
the rigid tool to first order, by the shapes and the supports of both bodies. Energies say why: the
elastic energy W of the soft body, as a function of how the tool is moved, is less by the
complementary energy of the tool at the same forces, whatever happens to the area of contact.

All is in the frame of the obstacle, so that the tool may have moved and turned by any amount.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.bodies import find_floating_bodies, label_bodies
from fenics_mortar.bulk import Bulk
from fenics_mortar.contact import Contact
from fenics_mortar.facing import nearest_facets, points_of
from fenics_mortar.mesh import MeshData
from fenics_mortar.mortar import MortarOperators
from fenics_mortar.obstacles import Obstacle
from fenics_mortar.reduced import factored_bulk
from fenics_mortar.space import DisplacementSpace
from fenics_mortar.surfaces import Array, Indices, extract_surface

PREFIX = "fenics_mortar_elastic_tool_"


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
        ``fm.AdequacyCheck(tools=[ElasticTool(circle, residual, u, data, "tool/rim", bcs=grips)])``.
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
            nodes,) [length].
        """
        load = np.zeros_like(self._surface.X)
        for contact in contacts:
            self._add_tractions(contact, load)
        self._surface.comm.Allreduce(MPI.IN_PLACE, load)
        force, answer = self._bulk.K.createVecs()
        self._surface.scatter_add(load, force.array)
        force.array[self._bulk.held] = 0.0
        self._factors.apply(force, answer)
        moved = self._surface.gather(answer.array_r)
        return [self._along_normals(contact.operators, moved) for contact in contacts]

    def _add_tractions(self, contact: Contact, load: Array) -> None:
        """Add what the tractions on this rank's facets put on the nodes of the tool, own frame."""
        o, points = contact.operators, points_of(contact.operators.segments)
        ends, shares = self._places(points.of(o.x).reshape(-1, 2))
        forces = points.of(contact.z) * points.measure(o.x)[:, :, None]
        forces = forces.reshape(-1, 2) @ self.obstacle.turn
        np.add.at(load, ends, shares[:, :, None] * forces[:, None])

    def _along_normals(self, o: MortarOperators, moved: Array) -> Array:
        """Motion of the tool along the normals of slave nodes, by that of its own nodes."""
        ends, shares = self._places(o.x)
        motion = np.einsum("jk,jkc->jc", shares, moved[ends]) @ self.obstacle.turn.T
        return np.asarray(np.einsum("jc,jc->j", o.n, motion))

    def _places(self, x: Array) -> tuple[Indices, Array]:
        """Ends of the nearest facets of the tool and their shares, both (points, 2)."""
        own = self.obstacle.to_own_frame(x)
        ends, part = nearest_facets(own, self._surface.X, self._surface)
        part = np.clip(part, 0.0, 1.0)
        return ends, np.stack([1.0 - part, part], axis=1)
