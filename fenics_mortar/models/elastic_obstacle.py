# SPDX-License-Identifier: MIT
"""The elastic body that a rigid obstacle represents, and the displacement of its surface.

The tractions of a solved contact, applied to the mesh of the body, displace its surface by one
linear solve. With an elastic obstacle the gaps would be wider by this displacement. A second linear
solve, with the tangent of the problem, yields the change of the solution: the error of the rigid
obstacle to first order, for the shapes and supports of both bodies. It is of first order for any
change of the contact area, since the elastic energy W of the soft body, as a function of the
obstacle's motion, decreases by the complementary energy of the obstacle at equal forces.

The deviation of the facets of a curved obstacle's mesh from the curve has the effect of an elastic
displacement. It is an error of the mesh, not of the rigid obstacle, and is reported separately.

All quantities are in the frame of the obstacle, which may have moved and rotated arbitrarily.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

import ufl
from dolfinx import fem

from fenics_mortar.bulk.bodies import find_floating_bodies, label_bodies
from fenics_mortar.bulk.checks import check_residual, check_space
from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface.facing import (
    linear_facets,
    nearest_on_chords,
    nearest_points,
    points_of,
    with_weight,
)
from fenics_mortar.interface.integrals import gauss_rule
from fenics_mortar.interface.traces import extract_surface
from fenics_mortar.la.solver import factored_bulk
from fenics_mortar.mesh.data import MeshData, Names, joined_names
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.models.model_error import Assumption, all_contacts, estimate_wider
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import (
    MeshError,
    call_together,
    check_kind,
    check_same_texts,
    together,
)
from fenics_mortar.utils.ranks import sum_over_ranks

PREFIX = "fenics_mortar_elastic_obstacle_"
# Gauss points on a facet of the slave, which may face several facets of an elastic obstacle with
# kinks.
POINTS_ON_FACET = 12


class ElasticObstacle:
    """Mesh and stiffness of the body that a rigid obstacle represents.

    Args:
        obstacle: The obstacle, whose surface is that of the mesh in its initial position.
        residual: UFL form of the internal forces; its tangent at the present ``u`` is used.
        u: Displacement of the mesh.
        data: Mesh, tags and names, on the communicator of the problem.
        surface: Name or tag of the contact boundary, or a list of them.
        bcs: Dirichlet conditions that fix the body; their values are not used.

    Raises:
        ValueError: If the conditions do not fix the body, or an argument is of another type.
        MeshError: If a name or tag is unknown or has no facets.

    Note:
        The constructor is collective.

    Example:
        ``tool = fm.ElasticObstacle(circle, residual, u, data, "tool/rim", bcs=grips)``, and in the
        problem with the circle, ``model_check=fm.ModelCheck(elastic_obstacles=[tool])``.
    """

    def __init__(
        self,
        obstacle: Obstacle,
        residual: Any,
        u: Any,
        data: MeshData,
        surface: Names,
        *,
        bcs: Sequence[Any] = (),
    ) -> None:
        check_kind("obstacle", obstacle, Obstacle, "a rigid obstacle, such as Circle(...)")
        check_kind("u", u, fem.Function, "a function of dolfinx")
        check_kind("data", data, MeshData, "the MeshData of the mesh of the obstacle")
        with together(data.mesh.comm, "ElasticObstacle"):
            check_kind("bcs", bcs, (list, tuple), "a list of Dirichlet conditions")
            check_kind("residual", residual, ufl.Form, "a UFL form")
            check_residual("residual", residual, u)
            data.boundary_tags(surface)
            if data.mesh is not u.function_space.mesh:
                raise MeshError("data belongs to another mesh than u")
        check_same_texts(data.mesh.comm, "ElasticObstacle", {"surface": surface, "bcs": len(bcs)})
        check_space(u.function_space, ())
        self.obstacle = obstacle
        space = DisplacementSpace(u.function_space)
        self._bulk = Bulk(residual, u, list(bcs), None, space)
        self._surface = extract_surface(
            space, data.facet_tags, data.boundary_tags(surface), joined_names(surface)
        )
        self._bulk.assemble_tangent()
        if find_floating_bodies(self._bulk, *label_bodies(self._bulk.V)):
            raise ValueError(f"the elastic body of {obstacle} can move: expected bcs that fix it")
        self._factors = factored_bulk(self._bulk, PREFIX)

    def displacements(self, contacts: Sequence[Contact]) -> list[Array]:
        """Displacements of the surface under the contact forces (collective).

        Args:
            contacts: The pairs of its obstacle, at a solved state.

        Returns:
            Displacement along the slave normals for each pair, shape (slave nodes,) [length]:
            weighted by the multiplier functions, like gaps.
        """
        touching = [self._touching(contact) for contact in contacts]
        load = np.zeros_like(self._surface.X)
        for points in touching:
            points.add_tractions(load)
        load = sum_over_ranks(self._surface.comm, load)
        force, solution = self._bulk.K.createVecs()
        self._surface.scatter_add(load, force.array)
        force.array[self._bulk.prescribed_dofs] = 0.0
        self._factors.apply(force, solution)
        moved = self._surface.gather(solution.array_r)
        return [points.means(points.along_normals(moved)) for points in touching]

    def flatness(self, contacts: Sequence[Contact]) -> list[Array]:
        """Depth of the facets inside the obstacle for each of ``contacts`` (collective).

        Returns:
            Shape (slave nodes,) each [length], weighted as for ``displacements``.
        """
        touching = [self._touching(contact) for contact in contacts]
        return [points.means(-points.distances(self._surface.X)) for points in touching]

    def _touching(self, contact: Contact) -> _Touching:
        return _Touching(contact, self.obstacle, self._surface)


class _Touching:
    """Points of the slave facets of a pair, and the nearest points of the obstacle's mesh.

    Args:
        contact: The pair, at a solved state.
        obstacle: Its obstacle.
        surface: Contact surface of the obstacle's mesh.
    """

    def __init__(self, contact: Contact, obstacle: Obstacle, surface: Any) -> None:
        self._contact, self._obstacle, o = contact, obstacle, contact.operators
        self._points = points_of(o.segments, gauss_rule(POINTS_ON_FACET))
        self._measure = self._points.measure(o.x)
        self._tractions = with_weight(self._points)
        if contact.slave.thickness is not None:
            self._measure = self._measure * self._points.of(contact.slave.thickness.at(o.x))
        own = obstacle.to_own_frame(self._points.of(o.x).reshape(-1, surface.dim))
        if surface.dim == 3:
            facets = linear_facets(surface.facets, surface.num_nodes)
            self._corners, self._shares = nearest_points(own, surface.X, facets)
        else:
            self._corners, self._shares = nearest_on_chords(own, surface.X, surface)

    def add_tractions(self, load: Array) -> None:
        """Add the nodal forces of tractions to ``load`` (nodes, dim), in the obstacle's frame."""
        z = self._contact.z_u
        if self._contact.at_vertices:
            z = np.stack([self._contact.now.fill_inside(part) for part in z.T.copy()], axis=1)
        forces = self._tractions.of(z) * self._measure[:, :, None]
        forces = forces.reshape(-1, forces.shape[2]) @ self._obstacle.rotation
        np.add.at(load, self._corners, self._shares[:, :, None] * forces[:, None])

    def along_normals(self, moved: Array) -> Array:
        """Displacements (nodes, dim) along slave normals at points, (points,) [length] (local)."""
        motion = self._at_nearest(moved) @ self._obstacle.rotation.T
        normals = self._points.direction(self._contact.operators.n)
        return np.asarray((motion * normals.reshape(motion.shape)).sum(axis=1))

    def distances(self, X: Array) -> Array:
        """Signed distances of nearest points of the mesh from the obstacle [length]; collective."""
        distance = f"the distance of '{self._obstacle.name}'"
        local = partial(self._obstacle.local, self._at_nearest(X))
        return call_together(self._contact.slave.comm, distance, local)[0]

    def means(self, values: Array) -> Array:
        """Weighted means of values (points,) for each slave node [their unit] (collective).

        Zero at nodes without points, shape (slave nodes,). On triangles with six nodes those of the
        corners are interpolated, since an offset is a sum over all nodes.
        """
        parts = self._tractions.dual_moments(self._measure, values.reshape(self._measure.shape))
        sums = np.zeros((2, self._contact.slave.num_nodes))
        for target, part in zip(sums, parts, strict=True):
            np.add.at(target, self._tractions.slave, part)
        sums = sum_over_ranks(self._contact.slave.comm, sums)
        means = np.asarray(sums[0] / np.where(sums[1] > 0.0, sums[1], 1.0))
        only_at_corners = self._tractions is not self._points
        return self._contact.now.fill_inside(means) if only_at_corners else means

    def _at_nearest(self, nodal: Array) -> Array:
        """Interpolate nodal values (nodes, dim) at nearest points, (points, dim) (local)."""
        return np.einsum("pk,pkc->pc", self._shares, nodal[self._corners])


def rigid_obstacle(problem: ContactProblem, elastic: ElasticObstacle) -> Assumption:
    """Errors of a rigid obstacle: its elasticity, and the facets of its mesh (collective)."""
    touching = contacts_of(problem, elastic)
    yielding, flatness = elastic.displacements(touching), elastic.flatness(touching)
    by_mesh = Assumption(
        f"mesh of {elastic.obstacle}",
        f"facets deviate by {_largest(flatness):.2g}",
        estimate_wider(problem, touching, flatness),
    )
    return Assumption(
        f"rigid {elastic.obstacle}",
        f"displacement of its surface {_largest(yielding):.2g}",
        estimate_wider(problem, touching, yielding),
        by_mesh,
    )


def contacts_of(problem: ContactProblem, elastic: ElasticObstacle) -> list[Contact]:
    """The contacts with the obstacle of an elastic obstacle (local)."""
    return [c for c in all_contacts(problem) if c.obstacle is elastic.obstacle]


def _largest(lengths: Sequence[Array]) -> float:
    """Largest absolute value of arrays of any shape [length] (local)."""
    return max((float(np.abs(length).max(initial=0.0)) for length in lengths), default=0.0)
