# SPDX-License-Identifier: MIT
"""What lies behind a slave surface: the outlines of the bodies of a pair, in their present place.

The back of a plate faces whatever lies below it, through the plate and through that body. Such a
partner is farther behind the slave surface than both bodies are thick; see ``kernels.sight`` for
the rule. The lengths are those in the present state: bodies bend and are compressed, and where an
end of a beam looks along its axis the length of the undeformed mesh says nothing.

To a safe depth nobody asks. So this costs an iteration the positions of the outlines, from which
those of the two surfaces are taken, and else only where a partner is farther behind than that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

from mpi4py import MPI

import numpy as np

from dolfinx import mesh as dmesh

from fenics_mortar.interface.surfaces import Surface, facet_nodes, replicate
from fenics_mortar.kernels.sight import tabulate_lengths
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Array, Indices

# Partners count without question to this part of the length of the undeformed body behind a facet,
# and to the length of the facet at the most: no body is compressed to less, nor does one bend away
# in less.
SAFE = 0.25
# Ends of a body within this part of a facet from where a line begins are those of that facet.
ROUNDING = 1e-10


class View(NamedTuple):
    """What lies behind the facets of a slave surface, as the kernels take it.

    Attributes:
        safe: Depth behind each slave facet to which any partner counts, shape (f,) [length].
        slave_bodies: Bodies of the slave facets, shape (f,).
        master_bodies: Bodies of the master facets, shape (m,).
        outline: Present positions of nodes (b, 2) [length], pieces (p, 2) with the body on their
            left, and bodies of these, shape (p,).
    """

    safe: Array
    slave_bodies: Indices
    master_bodies: Indices
    outline: tuple[Array, Indices, Indices]

    def of(self, facets: Indices) -> View:
        """The view of some of the slave facets, shape (k,)."""
        return self._replace(safe=self.safe[facets], slave_bodies=self.slave_bodies[facets])


def open_view(num_facets: int) -> View:
    """A view through everything."""
    none: Indices = np.empty(0, np.int64)
    outline = np.empty((0, 2)), np.empty((0, 2), np.int64), none
    return View(np.full(num_facets, np.inf), none, none, outline)


@dataclass(frozen=True)
class Outline:
    """Boundary of the mesh as straight pieces, equal on all ranks but for what each owns.

    Attributes:
        X: Reference positions of its nodes, shape (b, 2) [length].
        pieces: Nodes of each piece, the body on the left, shape (p, 2).
        bodies: Body of each piece, shape (p,).
        nodes: Global numbers of its nodes, ascending, shape (b,).
        owners: Rank that owns each node, shape (b,).
        local_dofs: Local dofs of the nodes this rank owns, shape (owned nodes, 2).
        comm: Communicator of the mesh.
    """

    X: Array
    pieces: Indices
    bodies: Indices
    nodes: Indices
    owners: Indices
    local_dofs: Indices
    comm: MPI.Comm

    def gather(self, values: Array) -> Array:
        """Nodal values (b, 2) of a local array of all dofs, on all ranks (collective)."""
        return replicate(values[self.local_dofs], self.owners, self.comm)

    def places_of(self, nodes: Indices) -> Indices:
        """Where global ``nodes`` of the boundary (k,) are among those of the outline (local)."""
        return np.searchsorted(self.nodes, nodes)

    def without(self, surface: Surface, nodes: Indices) -> Outline:
        """The outline less those facets of a surface whose ends are both among ``nodes`` (local).

        Where bodies are tied to each other they go on.
        """
        size = len(self.nodes)
        facets = surface.facets[np.isin(surface.nodes[surface.facets], nodes).all(axis=1)]
        at = self.places_of(surface.nodes[facets])
        gone = np.concatenate([at[:, k : k + 2] for k in range(surface.degree)])
        stays = ~np.isin(self.pieces @ [size, 1], gone @ [size, 1])
        return replace(self, pieces=self.pieces[stays], bodies=self.bodies[stays])

    def of_bodies(self, bodies: Indices) -> Outline:
        """The outline of some bodies only (local)."""
        mine = np.isin(self.bodies, bodies)
        used = np.unique(self.pieces[mine])
        number = np.full(len(self.nodes), -1)
        number[used] = np.arange(used.size)
        owned = np.flatnonzero(self.owners == self.comm.rank)
        return replace(
            self,
            X=self.X[used],
            pieces=number[self.pieces[mine]],
            bodies=self.bodies[mine],
            nodes=self.nodes[used],
            owners=self.owners[used],
            local_dofs=self.local_dofs[np.isin(owned, used)],
        )


def extract_outline(space: DisplacementSpace, labels: Indices) -> Outline:
    """Collect the boundary of the mesh on all ranks (collective).

    Args:
        space: The displacement's nodes and dofs.
        labels: Body of each local node of the displacement's space.
    """
    V = space.V
    topology, comm, index_map = V.mesh.topology, V.mesh.comm, V.dofmap.index_map
    facets = np.asarray(dmesh.exterior_facet_indices(topology), np.int32)
    facets = facets[facets < topology.index_map(1).size_local]
    ends = facet_nodes(V, facets)
    pieces = np.concatenate([ends[:, k : k + 2] for k in range(ends.shape[1] - 1)])
    to_global = np.asarray(index_map.local_to_global(pieces.ravel().astype(np.int32)), np.int64)
    places = V.tabulate_dof_coordinates()[:, :2][pieces.ravel()]
    mine = to_global.reshape(-1, 2), places, labels[pieces[:, 0]]
    parts = zip(*comm.allgather(mine), strict=True)
    given, coordinates, bodies = (np.concatenate(part) for part in parts)
    nodes, first, inverse = np.unique(given, return_index=True, return_inverse=True)
    begin, end = index_map.local_range
    starts = np.array(comm.allgather(begin))
    owners = np.asarray(np.searchsorted(starts, nodes, side="right") - 1, np.int64)
    owned = nodes[(nodes >= begin) & (nodes < end)]
    return Outline(
        coordinates[first],
        inverse.reshape(given.shape).astype(np.int64),
        bodies.astype(np.int64),
        nodes,
        owners,
        space.dofs[owned - begin],
        comm,
    )


class Sight:
    """Outlines of the bodies of a slave and a master surface, and the nodes of these on them.

    Args:
        outline: Boundary of the mesh.
        slave, master: The surfaces.
        normals: Normals of the slave nodes in the undeformed mesh, shape (slave nodes, 2).

    Attributes:
        outline: Boundary of the bodies of the two.
    """

    def __init__(self, outline: Outline, slave: Surface, master: Surface, normals: Array) -> None:
        bodies = [self._bodies(outline, side) for side in (slave, master)]
        self.outline = outline = outline.of_bodies(np.unique(np.concatenate(bodies)))
        self._slave_bodies, self._master_bodies = bodies
        self._of_slave, self._of_master = map(outline.places_of, (slave.nodes, master.nodes))
        lengths = np.empty(len(slave.facets))
        tabulate_lengths(
            slave.X, normals, slave.facets, bodies[0], self._pieces(outline.X), ROUNDING, lengths
        )
        self._safe = np.minimum(SAFE * lengths, slave.lengths)

    @staticmethod
    def _bodies(outline: Outline, surface: Surface) -> Indices:
        """Bodies of the facets of a surface."""
        of_node = np.empty(len(outline.nodes), np.int64)
        of_node[outline.pieces[:, 0]] = outline.bodies
        return of_node[outline.places_of(surface.nodes[surface.facets[:, 0]])]

    def _pieces(self, x: Array) -> tuple[Array, Indices, Indices]:
        return x, self.outline.pieces, self.outline.bodies

    def look(self, u: Array | None) -> tuple[View, Array, Array]:
        """The view at the displacement ``u``, a local array, or undeformed (collective).

        Returns:
            The view, and the displacements of the nodes of slave and master, each (nodes, 2).
        """
        X = self.outline.X
        moved = np.zeros_like(X) if u is None else self.outline.gather(u)
        view = View(self._safe, self._slave_bodies, self._master_bodies, self._pieces(X + moved))
        return view, moved[self._of_slave], moved[self._of_master]
