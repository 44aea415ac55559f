# SPDX-License-Identifier: MIT
"""Separate bodies of a mesh: their rigid motions, and checks that they cover no point twice.

``label_bodies`` numbers the bodies, ``find_floating_bodies`` finds those with rigid motions that
neither Dirichlet conditions nor the bulk resist, and ``check_mesh_overlap`` rejects a mesh at the
set-up of a problem if it covers a point of the plane or of space twice.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import basix
from dolfinx import mesh as dmesh

from fenics_mortar.bulk.cells import normals_of, sum_over_cells
from fenics_mortar.interface.outline import Outline, extract_outline
from fenics_mortar.kernels.passage import depths_inside
from fenics_mortar.obstacles.rigid_motion import rigid_motions, turned
from fenics_mortar.utils import arrays, compat
from fenics_mortar.utils.errors import MeshError, count_points, format_point
from fenics_mortar.utils.ranks import from_all_ranks

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.interface.curve_surface import Curve
    from fenics_mortar.mesh.space import DisplacementSpace
    from fenics_mortar.utils.arrays import Array, Flags, Indices

# Rotation or translation of a motion of size one [1] below which messages leave it out.
MINOR = 0.1


class RemoteLoad(ABC):
    """A load given at a point, or at a section, of a body with which it moves.

    Attributes:
        motion: Place and loads, those of the user's object.
    """

    motion: Any

    @property
    @abstractmethod
    def driven(self) -> Flags:
        """Whether forces drive a motion, shape (3,), bool."""

    @abstractmethod
    def move(self, change: Array) -> None:
        """Add ``change`` to the motion, shape (3,) [length] (local)."""

    @abstractmethod
    def motions_by(self, body: FloatingBody, part: int) -> Array:
        """The motions due to those of a body, at a part of it, shape (motions, 3) [1] (local)."""


@dataclass(frozen=True)
class PartMotion:
    """Translation of one side of a section of a body along an axis, against the other side.

    Attributes:
        load: The load of the section.
        axis: Direction in which the side moves when the body is tightened, shape (dim,) [1].
        moves: Whether a part of the mesh moves, shape (parts,), bool.
    """

    load: RemoteLoad
    axis: Array
    moves: Flags


@dataclass(frozen=True)
class FloatingBody:
    """A body with rigid motions that neither Dirichlet conditions nor the bulk tangent resist.

    Sections may separate it into parts, which then move against each other.

    Attributes:
        label: Number of the body.
        centre: Mean reference position of its nodes, shape (dim,) [length].
        size: Radius of gyration of its nodes [length].
        motions: Orthonormal combinations of the translations, of the rotations about the centre
            times ``size``, one in the plane and three in space, and of the motion of each section,
            shape (number of free motions, 3 + s) or, in space, (number, 6 + s).
        stiffest: Largest diagonal entry of K in the body [stress], in space times length.
        num_nodes: Number of its nodes on all ranks.
        sections: The s sections that separate it.
    """

    label: int
    centre: Array
    size: float
    motions: Array
    stiffest: float
    num_nodes: int
    sections: Sequence[PartMotion] = ()

    def displacement(self, X: Array, parts: Indices) -> Array:
        """Free motions at points, shape (motions, n, dim) [1] (local).

        Args:
            X: The points, shape (n, dim) [length].
            parts: Parts of the mesh in which they lie, shape (n,).
        """
        rigid = rigid_motions(X, self.centre, self.size)
        of_sections = [np.outer(each.moves[parts], each.axis)[None] for each in self.sections]
        return np.einsum("fm,mnc->fnc", self.motions, np.vstack([rigid, *of_sections]))

    def without(self, responses: Array) -> Self:
        """This body with its motions of zero response; it may have none left (local).

        Args:
            responses: Responses to each motion, shape (motions, n) [1].
        """
        left, sizes, _ = np.linalg.svd(responses)
        rank = int((sizes > arrays.ROUNDING * max(1.0, sizes.max(initial=0.0))).sum())
        return replace(self, motions=left[:, rank:].T @ self.motions)

    def without_rotation(self, distance: Array) -> Self:
        """This body with its motions that move two points equally; it may have none left (local).

        Args:
            distance: Vector from one point to the other, shape (2,) [length].
        """
        apart = turned(distance[None] / np.linalg.norm(distance))[:, 0]
        dim = distance.size
        return self.without(self.motions[:, dim : dim + len(apart)] @ apart)

    def describe(self, motion: Array, *, directed: bool = False, poles: bool = False) -> str:
        """Describe a free motion (local).

        Args:
            motion: Factors of ``motions``, shape (number of free motions,).
            directed: Whether the sign of a translation matters.
            poles: Whether rotations in space are told by axis and point, as those in the plane.
        """
        shares = motion @ self.motions / np.linalg.norm(motion)
        rigid, at_sections = np.split(shares, [len(shares) - len(self.sections)])
        if np.abs(at_sections).max(initial=0.0) > MINOR:
            most = int(np.abs(at_sections).argmax())
            how = "be shortened" if at_sections[most] > 0.0 or not directed else "be pulled apart"
            return f"{how} at section '{self.sections[most].load.motion.name}'"
        return describe_motion(rigid, self.centre, self.size, directed=directed, poles=poles)

    def describe_all(self) -> str:
        """Describe all free motions (local)."""
        dim, count = len(self.centre), len(self.motions)
        if not self.sections and count == dim * (dim + 1) // 2:
            return "move and turn in any direction"
        plain = _echelon(self.motions) @ self.motions.T
        return ", ".join(dict.fromkeys(map(self.describe, plain)))


def _echelon(rows: Array) -> Array:
    """Reduced row echelon form of ``rows`` (n, m), the same for any basis of these [1] (local)."""
    found, top = rows.copy(), 0
    for column in range(rows.shape[1]):
        if top == len(rows):
            break
        pivot = top + int(np.abs(found[top:, column]).argmax())
        if abs(found[pivot, column]) < MINOR**2:
            continue
        found[[top, pivot]] = found[[pivot, top]]
        found[top] /= found[top, column]
        others = np.arange(len(rows)) != top
        found[others] -= np.outer(found[others, column], found[top])
        top += 1
    return found


def describe_motion(
    motion: Array, centre: Array, size: float, *, directed: bool, poles: bool = False
) -> str:
    """Describe a rigid motion by its larger parts (local).

    Args:
        motion: Translations, then rotations about the centre times ``size``, of size one, shape
            (3,), in space (6,) [1].
        centre: Shape (dim,) [length].
        size: See ``motion`` [length].
        directed: Whether the sign of a translation matters.
        poles: Whether rotations in space are told by axis and point, as those in the plane.
    """
    along, turn = np.split(np.round(motion, 4), [centre.size])
    turns = np.linalg.norm(turn) > MINOR
    if centre.size == 2:
        if turns:
            pole = centre + size / turn[0] * np.array([-along[1], along[0]])
            return f"rotate about {format_point(pole)}"
        sign = 1.0 if directed or turn[0] or tuple(along) > (0.0, 0.0) else -1.0
        return f"move along {format_point(sign * along)}"
    if poles and turns and abs(along @ turn) < MINOR**2:
        pole = centre + size * np.cross(turn, along) / (turn @ turn)
        axis = turn / np.linalg.norm(turn)
        return f"rotate about the axis {format_point(axis)} through {format_point(pole)}"
    parts = ("move along", along), ("rotate about the axis", turn)
    larger = [(does, vector) for does, vector in parts if np.linalg.norm(vector) > MINOR]
    return " and ".join(f"{does} {format_point(vector)}" for does, vector in larger)


def label_bodies(V: Any) -> tuple[Indices, int]:
    """Number the connected components of the mesh (collective).

    Returns:
        Body of each local node of the space ``V``, ghosts included, shape (local nodes,), and the
        number of bodies.
        Bodies are numbered by their lowest node; the order may depend on the partition.
    """
    comm, index_map, dofs = V.mesh.comm, V.dofmap.index_map, compat.dofmap(V)
    owned, count = index_map.size_local, index_map.size_local + index_map.num_ghosts
    first = np.repeat(dofs[:, :1], dofs.shape[1] - 1, axis=1).ravel()
    links = coo_array((np.ones(first.size), (first, dofs[:, 1:].ravel())), shape=(count, count))
    count_here, component = connected_components(links, directed=False)
    offsets = np.concatenate([[0], np.cumsum(comm.allgather(count_here))])
    component = component + offsets[comm.rank]
    begin, end = index_map.local_range
    ghosts, of_ghosts = from_all_ranks(comm, (np.asarray(index_map.ghosts), component[owned:]))
    mine = (ghosts >= begin) & (ghosts < end)
    pairs = np.stack([of_ghosts[mine], component[ghosts[mine] - begin]], axis=1)
    body, bodies = join_bodies(int(offsets[-1]), comm.allgather(np.unique(pairs, axis=0)))
    return body[component], bodies


def join_bodies(num_bodies: int, links: Sequence[Indices]) -> tuple[Indices, int]:
    """Merge linked bodies: new number of each body, (num_bodies,), and how many are left (local).

    Args:
        num_bodies: Number of bodies.
        links: Pairs of bodies, equal on all ranks, shapes (k, 2).
    """
    pairs = np.concatenate([np.empty((0, 2), np.int64), *links])
    bridges = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(num_bodies, num_bodies))
    count, body = connected_components(bridges, directed=False)
    return body.astype(np.int64), count


def find_floating_bodies(
    bulk: Bulk, labels: Indices, num_bodies: int, prescribed: Flags | None = None,
    sections: Mapping[int, Sequence[PartMotion]] = MappingProxyType({}),
    parts: Indices | None = None,
) -> list[FloatingBody]:  # fmt: skip
    """Find bodies with free rigid motions, with ``bulk.K`` as assembled (collective).

    A motion is free if its resistance is rounding compared with the stiffness of the body.

    Args:
        bulk: Residual and tangent of the bodies.
        labels: Body of each local node, shape (local nodes,).
        num_bodies: Number of bodies.
        prescribed: Marks of the local dofs that resist, (local dofs,); by default the prescribed.
        sections: Sections of bodies, by their labels.
        parts: Part of the mesh of each local node, shape (local nodes,); needed with sections.
    """
    held = (bulk.prescribed if prescribed is None else prescribed)[: bulk.num_owned]
    dofs = bulk.space.owned_dofs
    X = bulk.V.tabulate_dof_coordinates()[: len(dofs), : bulk.space.dim]
    labels = labels[: len(dofs)]
    parts = (labels if parts is None else parts)[: len(dofs)]
    diagonal = np.abs(bulk.K.getDiagonal().array_r)
    found = []
    for label in range(num_bodies):
        mine = labels == label
        body = centre_and_size(X[mine], bulk.comm)
        own = tuple(sections.get(label, ()))
        count = len(rigid_motions(X[:0], *body)) + len(own)
        basis = FloatingBody(label, *body, np.eye(count), arrays.TINY, 0, own)
        motions = np.zeros((count, bulk.num_owned))
        motions[:, dofs[mine]] = basis.displacement(X[mine], parts[mine])
        at_prescribed = np.where(held, motions, 0.0)
        stiffest = diagonal[dofs[mine]].max(initial=0.0)
        stiffest = max(bulk.comm.allreduce(float(stiffest), MPI.MAX), arrays.TINY)
        stiff = bulk.to_force * compat.products(bulk.K, motions) / stiffest
        size, directions = resistance(np.hstack([at_prescribed, stiff]), bulk.comm)
        num_nodes = bulk.comm.allreduce(int(mine.sum()))
        free = directions[size < arrays.ROUNDING * np.sqrt(num_nodes)]
        if len(free):
            found.append(replace(basis, motions=free, stiffest=stiffest, num_nodes=num_nodes))
    return found


def resistance(responses: Array, comm: MPI.Comm) -> tuple[Array, Array]:
    """Resistance to motions, as norms of the forces that they cause (collective).

    Args:
        responses: Local forces due to each of m motions, shape (m, n).
        comm: Communicator of the forces.

    Returns:
        Norms of the forces due to m orthonormal combinations of the motions [stress length], in
        descending order, and these combinations, shape (m, m) [1]. Unlike eigenvalues of the
        Gram matrix, the norms are accurate to rounding.
    """
    count = len(responses)
    triangle = np.linalg.qr(np.vstack([responses.T, np.zeros((count, count))]), mode="r")
    _, norms, combinations = np.linalg.svd(np.concatenate(comm.allgather(triangle)))
    return norms, combinations


def centre_and_size(X: Array, comm: MPI.Comm) -> tuple[Array, float]:
    """Mean and radius of gyration [length] of points (n, dim) of all ranks (collective)."""
    count = comm.allreduce(len(X))
    centre = comm.allreduce(X.sum(axis=0)) / count
    return centre, float(np.sqrt(comm.allreduce(((X - centre) ** 2).sum()) / count))


# Distance from a facet of points inside of its body, over its length [1]: above the rounding of
# coordinates in files, below the thickness of cells.
BESIDE = 1e-3


def check_mesh_overlap(space: DisplacementSpace, paired: Sequence[Curve]) -> None:
    """Reject a mesh that covers a point twice (collective; facets are compared to 1e-6).

    A mesh of straight cells covers each point at most once if

    - the two cells of each inner facet lie on opposite sides of it, and no cell is twisted:
      otherwise the mesh is folded at the facet;
    - the outline of a body does not cross itself: otherwise the body overlaps itself without a
      fold, for example a strip wound by more than one turn;
    - no two facets of the outlines coincide with their bodies on the same side, and no body lies
      completely inside another one: otherwise two bodies occupy the same area, for example an
      inclusion and a matrix without a hole.

    Partly overlapping bodies are accepted as interference, and so are paired surfaces of one body.

    In space folds and copies of facets are refused here; whether the outside of a body crosses
    itself, or a body lies inside another one, is seen by ``verify.crossing``.

    Args:
        space: The displacement's nodes and dofs.
        paired: The surfaces of pairs, which may overlap; in space they do not count.

    Raises:
        MeshError: On all ranks; the message has a position.
    """
    mesh = space.V.mesh
    dim = mesh.geometry.dim
    mesh.topology.create_connectivity(dim - 1, dim)
    cells = compat.geometry_dofmap(mesh)[:, : compat.num_corners(mesh)].astype(np.int64)
    x = mesh.geometry.x[:, :dim]
    sides = _sides(mesh, x, cells, mesh.topology.index_map(dim).size_local)
    count, where = count_points(mesh.comm, _folded(mesh, sides))
    if count:
        raise MeshError(
            f"{count} facets have the cells of both sides on the same side: the mesh is folded "
            f"there, one at {where}; correct the mesh"
        )
    _check_copies(mesh, sides)
    if dim == 2:
        labels, bodies = label_bodies(space.V)
        _check_outline(extract_outline(space, labels, np.arange(bodies)), paired)


# Cells whose facets are compared at a time [1]: positions at all facets were most of the memory at
# set-up.
COMPARED = 20_000


class _Sides(NamedTuple):
    """The facets of local cells, one row per cell and facet.

    ``facet``: local number; ``nodes``: its ends (in space its corners), ascending by their numbers
    in the mesh input, (n, corners); ``side``: 1 if the cell lies where ``_normals`` point, else -1;
    ``x``: positions of all nodes.
    """

    facet: npt.NDArray[np.int32]
    nodes: npt.NDArray[np.int32]
    side: npt.NDArray[np.int8]
    x: Array

    def ends(self, rows: npt.NDArray[Any]) -> Array:
        """Positions of the ends of some rows, (k, corners, dim) [length]."""
        return np.asarray(self.x[self.nodes[rows]])


def _sides(mesh: Any, x: Array, cells: Indices, owned: int) -> _Sides:
    """Side of each facet on which its cell lies, for the first ``owned`` cells (local)."""
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim, tdim - 1)
    table = mesh.topology.connectivity(tdim, tdim - 1)
    # dolfinx: facet i of a triangle is opposite to corner i, those of a quadrilateral 01 02 13 23.
    local = np.array(basix.topology(getattr(basix.CellType, compat.cell_name(mesh)))[tdim - 1])
    count = len(local)
    given = np.asarray(mesh.geometry.input_global_indices)
    nodes = np.empty((owned * count, local.shape[1]), np.int32)
    sides = _Sides(table.array[: owned * count], nodes, np.empty(len(nodes), np.int8), x)
    for first in range(0, owned, COMPARED):
        some = cells[first : min(first + COMPARED, owned)]
        rows = np.arange(count * first, count * (first + len(some)))
        unordered = some[:, local].reshape(len(rows), -1)
        order = np.argsort(given[unordered], axis=1)
        nodes[rows] = np.take_along_axis(unordered, order, axis=1)
        middles = np.repeat(x[some].mean(axis=1), count, axis=0)
        ends = sides.ends(rows)
        inward = middles - ends.mean(axis=1)
        sides.side[rows] = np.sign((_normals(ends) * inward).sum(axis=1))
    return sides


def _normals(corners: Array) -> Array:
    """Normals of facets by two, in space three of their corners (n, corners, dim), (n, dim)."""
    return normals_of(corners[:, 1 : corners.shape[2]] - corners[:, :1])


def _folded(mesh: Any, sides: _Sides) -> Array:
    """Midpoints of the facets whose two cells lie on the same side, (n, dim) (collective).

    Those between two ranks on the rank that owns them.
    """
    of_cells = np.stack([sides.side, np.ones(len(sides.side))], axis=1)
    sums, count = sum_over_cells(mesh, sides.facet, of_cells).T
    row, here = np.zeros(len(sums), np.int32), np.bincount(sides.facet, minlength=len(sums))
    row[sides.facet] = np.arange(sides.facet.size)
    owned = np.arange(len(sums)) < mesh.topology.index_map(mesh.topology.dim - 1).size_local
    mine = (here > 1) | (owned & (here == 1))
    return sides.ends(row[mine & (np.abs(sums) > 1.0) & (count > 1.0)]).mean(axis=1)


def _check_copies(mesh: Any, sides: _Sides) -> None:
    """Reject facets of the outside that coincide with the cells on the same side (collective)."""
    outer = np.isin(sides.facet, dmesh.exterior_facet_indices(mesh.topology))
    corners, side = sides.ends(outer), sides.side[outer, None]
    middles, normals = from_all_ranks(mesh.comm, (corners.mean(axis=1), side * _normals(corners)))
    sizes = np.linalg.norm(normals, axis=1) ** (1.0 / (middles.shape[1] - 1))
    if middles.shape[1] == 2:
        i, j = arrays.near(middles, middles, arrays.HALF_FACET * float(sizes.min()))
        i, j = i[i < j], j[i < j]
    else:
        from scipy.spatial import cKDTree  # not imported by problems in the plane

        pairs = cKDTree(middles).query_pairs(
            arrays.SAME_PLACE * float(sizes.max()), output_type="ndarray"
        )
        i, j = pairs[np.lexsort(pairs.T[::-1])].T
    close = np.linalg.norm(middles[i] - middles[j], axis=1) <= arrays.SAME_PLACE * sizes[i]
    copies = i[close & ((normals[i] * normals[j]).sum(axis=1) > 0.0)]
    if copies.size:
        raise MeshError(
            f"the mesh covers a place twice: two facets of the outside coincide at "
            f"{format_point(middles[copies[0]])}, with their bodies on the same side; remove the "
            "copy"
        )


def _check_outline(outline: Outline, curves: Sequence[Curve]) -> None:
    """Reject outlines that cross themselves or enclose each other (local)."""
    start, end = np.moveaxis(outline.X[outline.segments], 1, 0)
    pairs, body = arrays.near_pairs(start, end), outline.segment_bodies
    middles, along = 0.5 * (start + end), end - start
    paired = np.zeros(len(start), bool)
    for curve in (curve for curve in curves if curve.num_nodes):
        paired |= outline.are_of(curve)
    i, j = pairs.T
    pairs = pairs[(body[i] == body[j]) & ~(paired[i] & paired[j])]
    crosses = arrays.lines_cross(start, end, pairs, arrays.SAME_PLACE)
    links = outline.neighbours()
    i, j = pairs.T
    separate = (links[0][i] != j) & (links[0][j] != i) & ~crosses
    touch = arrays.lines_cross(start, end, pairs[separate], touching=True)
    touches = np.flatnonzero(separate)[touch]
    crosses[touches] = _cross_at_nodes(start, end, links, pairs[touches])
    if crosses.any():
        where = middles[pairs[np.argmax(crosses), 0]]
        raise MeshError(
            f"a body overlaps itself: its outline crosses itself at {format_point(where)}; correct "
            "the mesh (a node that hangs on an edge there leaves a slit)"
        )
    inside = middles + BESIDE * np.stack([-along[:, 1], along[:, 0]], axis=1)
    _check_nested(outline, inside)


def _cross_at_nodes(
    start: Array, end: Array, links: tuple[Indices, Indices], pairs: Indices
) -> Flags:
    """Whether the outline crosses itself at a node of one of two touching facets, (k,) (local).

    In this case the line through the facet and the previous or next one crosses the other facet, or
    the line through the other facet and its neighbour.
    """
    own = np.arange(len(start))
    after, before = (np.where(beside < 0, own, beside) for beside in links)
    i, j = pairs.T
    found = np.zeros(len(pairs), bool)
    for one in ((i, i), (i, after[i]), (before[i], i)):
        for other in ((j, j), (j, after[j]), (before[j], j)):
            lines = np.concatenate([start[one[0]], start[other[0]]])
            ends = np.concatenate([end[one[1]], end[other[1]]])
            both = np.arange(2 * len(pairs)).reshape(2, -1).T
            found |= arrays.lines_cross(lines, ends, both, arrays.SAME_PLACE)
    return found


def _check_nested(outline: Outline, beside: Array) -> None:
    """Reject a body inside another one that has no hole for it (local).

    Args:
        outline: The outlines.
        beside: Points beside the segments, inside their bodies, shape (m, 2) [length].
    """
    body, start = outline.segment_bodies, outline.X[outline.segments[:, 0]]
    points = {int(b): start[body == b] for b in np.unique(body)}
    boxes = {b: (x.min(axis=0), x.max(axis=0)) for b, x in points.items()}

    def is_inside(b: int, x: Array) -> Flags:
        return depths_inside(outline.X, outline.segments[body == b], x)[:, 0] > 0.0

    for inner, outer in permutations(points, 2):
        (low, high), (lower, higher) = boxes[inner], boxes[outer]
        if not ((low > lower).all() and (high < higher).all()):
            continue
        if is_inside(outer, beside[body == inner]).all() and not (
            is_inside(inner, points[outer]).any()
        ):
            raise MeshError(
                f"the body around {format_point(points[inner].mean(axis=0))} lies inside the one "
                f"around {format_point(points[outer].mean(axis=0))}, which has no hole there: cut "
                "one"
            )
