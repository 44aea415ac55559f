# SPDX-License-Identifier: MIT
"""The bodies without contact: residual and tangent from UFL, and prescribed displacements."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

import ufl
from ufl.algorithms import expand_derivatives

from fenics_mortar.kernels.cells import find_near, tabulate_areas
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.errors import MortarError, check_same, count_places, raise_together

# A Newton step may leave each cell, at each node, no less than this part of the area it has. It
# keeps the iterates away from inverted cells, and is far from what they need when they converge.
LEAST_AREA = 0.2
# Below this part of a step nothing is gained by cutting it further.
SMALLEST_STEP = 1e-3
# A cell is flat at a node if its area there is below this part of the cell's extent squared.
FLAT = 1e-13
# The mesh is where it was if no node has moved by more than this part of the farthest place: to tie
# a second problem's bodies on it moves nodes by rounding.
UNMOVED = 1e-10
# Times that the pattern of K may grow before it is made anew: sliding contact leaves zeros
# behind.
MOST_GROWTHS = 4
# The nodes of a cell along its outline, by their number: dolfinx' order is corners, edges, inside,
# that of quadrilaterals the one of a tensor product
AROUND = {3: [0, 1, 2], 4: [0, 1, 3, 2], 6: [0, 5, 1, 3, 2, 4], 9: [0, 4, 1, 6, 3, 7, 2, 5]}


class Bulk:
    """Residual r = f_int - f_ext and tangent K of the bodies, assembled by dolfinx.

    Args:
        residual: UFL form, linear in a test function of the space of ``u``.
        u: Displacement, alone or in a mixed function.
        bcs: Dirichlet conditions of dolfinx.
        jacobian: UFL form of the tangent; the derivative of ``residual`` by default.
        space: The displacement's nodes and dofs.

    Attributes:
        V: Space of the displacement alone.
        residual: The form.
        units: Amount of each unknown owned here that counts like a displacement of one, shape
            (num_owned,); see ``set_units``.
        to_force: What turns the residual of each equation into a force, shape (num_owned,).
        stiffness: Force of a displacement of one, once ``set_units`` has been called [stress].
        K: Tangent without boundary conditions, shape (N, N) [stress].
        r: Residual without contact forces and boundary conditions, shape (N,) [stress length].
        num_patterns: How many matrices ``K`` has been so far.
        is_linear: Whether the residual is seen to be linear in the displacement.
        prescribed: Whether a local dof, ghosts included, has a prescribed value.

    Raises:
        MortarError: If a condition is of another space.
    """

    def __init__(
        self,
        residual: Any,
        u: Any,
        bcs: list[Any],
        jacobian: Any | None,
        space: DisplacementSpace,
    ) -> None:
        self.u, self.V, self.bcs, self.space = u, space.V, list(bcs), space
        self.comm: MPI.Comm = self.V.mesh.comm
        self.prescribed = prescribed_dofs(space, u, bcs)
        self.is_linear, self.residual = False, residual
        if jacobian is None:
            jacobian = ufl.derivative(residual, u, ufl.TrialFunction(space.whole))
            expanded = expand_derivatives(jacobian)
            self.is_linear = self.u not in expanded.coefficients()
        self._residual, self._tangent = compat.form(residual), compat.form(jacobian)
        self._tangent_data = [*jacobian.constants(), *jacobian.coefficients()]
        self._constants = list(dict.fromkeys([*residual.constants(), *jacobian.constants()]))
        self._coefficients = {*residual.coefficients(), *jacobian.coefficients()}
        self.K: PETSc.Mat
        self.num_patterns = 0
        self._num_growths: int
        self._data: list[Array] = []
        self._K_is_whole = False  # neither outdated nor with anything else in it
        self._create_tangent()
        self.r: PETSc.Vec = compat.create_vector(space.whole)
        dofs = compat.dofmap(self.V)[: self.V.mesh.topology.index_map(2).size_local]
        self._cells, self._X = dofs, self.V.tabulate_dof_coordinates()[:, :2].copy()
        self._gradients = compat.nodal_gradients(self.V)
        self._undeformed_areas = _proper_areas(self._X, dofs, self._gradients)
        self._nodes = self.V.mesh.geometry.x.copy()
        self.num_owned, self.first = space.num_owned, space.first
        self.units, self.to_force = np.ones((2, self.num_owned))
        self.stiffness = 0.0

    @cached_property
    def held(self) -> npt.NDArray[np.int32]:
        """Local numbers of the owned dofs with prescribed values."""
        return np.flatnonzero(self.prescribed[: self.num_owned]).astype(np.int32)

    def tangent_data(self) -> list[Array]:
        """Copies of the constants and functions in the form of the tangent, but for ``u``."""
        return [
            np.array(data.value if hasattr(data, "value") else data.x.array)
            for data in self._tangent_data
            if data is not self.u
        ]

    @clock("residual")
    def assemble_residual(self) -> None:
        """Assemble ``r`` at the present displacement (collective)."""
        compat.assemble_vector(self.r, self._residual)

    @clock("tangent")
    def assemble_tangent(self) -> None:
        """Assemble ``K`` at the present displacement, unless it is known already (collective)."""
        data = self.tangent_data() if self.is_linear else []
        same = self._K_is_whole and all(map(np.array_equal, data, self._data))
        if self.is_linear and self.comm.allreduce(same, MPI.LAND):
            return
        self._data, self._K_is_whole = data, False
        if self._num_growths > MOST_GROWTHS:
            self.free_garbage()
            self.K.destroy()
            self._create_tangent()
        compat.assemble_matrix(self.K, self._tangent)
        self._K_is_whole = True

    def renew_tangent(self) -> None:
        """Create ``K`` anew, whatever became of it (collective)."""
        self._K_is_whole = False
        self.free_garbage()
        self.K.destroy()
        self._create_tangent()

    def free_garbage(self) -> None:
        """Free PETSc objects that are gone, also those made from ``r`` and ``K`` (collective)."""
        compat.free_petsc_garbage(self.comm, self.r, self.K)

    def _create_tangent(self) -> None:
        """Create ``K`` with the pattern of the form."""
        self.K = compat.create_matrix(self._tangent)
        self.num_patterns += 1
        self._num_growths = 0

    def grow_tangent(self, room: PETSc.Mat) -> None:
        """Let the pattern of ``K`` grow to the union with that of a matrix of zeros (collective).

        It is kept until it has become wasteful.
        """
        self._num_growths += 1
        self.K.axpy(1.0, room, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)

    def take_tangent(self) -> PETSc.Mat:
        """``K``, to add to in place: it is assembled anew before the next time."""
        self._K_is_whole = False
        return self.K

    def add_to_diagonal(self, values: Array) -> None:
        """Add owned ``values`` to the diagonal of ``K`` (collective)."""
        diagonal = self.K.getDiagonal()
        diagonal.array[:] += values
        self.K.setDiagonal(diagonal)
        self._K_is_whole = False

    def distance_to_prescribed(self) -> Array:
        """Prescribed value minus present displacement of the ``held`` dofs (local)."""
        values = self.u.x.array.copy()
        compat.set_prescribed(values, self.bcs)
        return values[self.held] - self.u.x.array[self.held]

    def move(self, step: PETSc.Vec, part: float = 1.0) -> float:
        """Add a displacement increment, or as much of it as the cells bear (collective).

        Args:
            step: The increment.
            part: The part of it to add at the most.

        Returns:
            The part that was added: the largest of ``part``, ``part`` / 2, ... that leaves every
            cell at every node ``LEAST_AREA`` of the area it has now.
        """
        u = self.u.x.array
        start, least = u.copy(), LEAST_AREA * np.maximum(self._areas(), 0.0)
        u[: self.num_owned] += step.array_r
        self.u.x.scatter_forward()
        increment, smallest = u - start, SMALLEST_STEP * part
        u[:] = start + part * increment
        while part > smallest and self._any_below(least):
            part *= 0.5
            u[:] = start + part * increment
        return part

    def _any_below(self, least: Array) -> bool:
        return self.comm.allreduce(bool((self._areas() < least).any()), MPI.LOR)

    def positions(self) -> Array:
        """Current positions of the local nodes, ghosts included, shape (n, 2) [length]."""
        return self._X + self.u.x.array[self.space.dofs]

    def spread(self, nodal: npt.NDArray[Any]) -> Array:
        """A local array of all dofs with values of the local nodes; zero for other unknowns."""
        values = np.zeros(self.u.x.array.size)
        values[self.space.dofs] = nodal[:, None]
        return values

    def set_units(self, stiffness: float) -> None:
        """Set ``units`` and ``to_force`` from ``K`` as assembled (collective).

        One unit of an unknown beside the displacement makes forces of the size of ``stiffness``, or
        residuals that are such a force in the other equations; an equation turns one unit of an
        unknown into such a force. So nothing depends on the units of measurement.

        Args:
            stiffness: Force of a displacement of one [stress].
        """
        self.stiffness = stiffness
        if not self.space.is_mixed:
            return
        units, to_force = np.zeros((2, self.num_owned))
        units[self.space.owned_dofs] = to_force[self.space.owned_dofs] = 1.0
        transpose = self.K.transpose(PETSc.Mat())
        for _ in range(self.space.whole.num_sub_spaces - 1):
            sizes = _row_sizes(transpose, to_force), _row_sizes(self.K, units)
            for known, size in zip((units, to_force), sizes, strict=True):
                reached = (known == 0.0) & (size > 0.0)
                known[reached] = stiffness / size[reached]
        transpose.destroy()
        self.units, self.to_force = (np.where(a > 0.0, a, 1.0) for a in (units, to_force))

    def largest(self, values: Array) -> float:
        """Largest size of owned ``values`` of the unknowns in their ``units`` (collective)."""
        mine = np.abs(values[: self.num_owned]) / self.units
        return self.comm.allreduce(float(mine.max(initial=0.0)), MPI.MAX)

    def _areas(self) -> Array:
        """Deformed over undeformed area at the nodes of the owned cells, (cells, nodes)."""
        return _areas(self.positions(), self._cells, self._gradients) / self._undeformed_areas

    def deformation_gradients(self) -> Array:
        """F of the owned cells, means over their nodes, shape (cells, 2, 2) (local)."""
        return np.einsum("eka,ekb->eab", self.positions()[self._cells], self._slopes)

    @cached_property
    def _slopes(self) -> Array:
        """Derivatives of shape functions by X, means over a cell's nodes, (cells, nodes, 2)."""
        jacobian = np.einsum("eka,nkb->enab", self._X[self._cells], self._gradients)
        slopes = np.einsum("nkb,enba->ekna", self._gradients, np.linalg.inv(jacobian))
        return np.asarray(slopes.mean(axis=2))

    def check_input(self) -> None:
        """Refuse nan and inf in displacement, prescribed values and the form's data (collective).

        Constants that differ between the ranks are refused as well, and a mesh that was moved.

        Raises:
            MortarError: On all ranks; says what is not finite, and where.
        """
        self._check_mesh()
        values = self.u.x.array.copy()
        count, where = self.count_nodes(~np.isfinite(values))
        if count:
            raise MortarError(
                f"the displacement is not finite at {count} nodes, one at {where}; reset it, for "
                "example to a copy made before the last solve"
            )
        compat.set_prescribed(values, self.bcs)
        count, where = self.count_nodes(~np.isfinite(values))
        if count:
            raise MortarError(
                f"the prescribed displacement is not finite at {count} nodes, one at {where}"
            )
        messages = [
            f"a constant of the residual is {constant.value}"
            for constant in self._constants
            if not np.isfinite(constant.value).all()
        ] + [
            f"function '{function.name}' of the residual is not finite"
            for function in self._coefficients
            if not np.isfinite(function.x.array).all()
        ]
        everywhere = sorted(set().union(*self.comm.allgather(set(messages))))
        if everywhere:
            raise MortarError("; ".join(everywhere))
        same = [("a constant of the residual", c.value) for c in self._constants]
        same += [("a prescribed displacement", compat.prescribed_value(bc)) for bc in self.bcs]
        check_same(self.comm, same)

    def _check_mesh(self) -> None:
        """Surfaces and tangent are those of the undeformed mesh as it was at set-up."""
        far = self.comm.allreduce(float(np.abs(self._nodes).max(initial=0.0)), MPI.MAX)
        same = np.abs(self.V.mesh.geometry.x - self._nodes) <= UNMOVED * far
        moved = np.unique(np.nonzero(~same)[0])
        count, where = count_places(self.comm, self._nodes[moved, :2])
        if count:
            raise MortarError(
                f"the mesh was moved after the problem was set up, one node was at {where}; put it "
                "back, or set up a new problem on the moved mesh"
            )

    def count_nodes(self, dofs: npt.NDArray[np.bool_]) -> tuple[int, str]:
        """Number of nodes with any of the marked local dofs, and a place (collective).

        Other unknowns than the displacement count as nodes in the middle of a cell.
        """
        if not self.comm.allreduce(bool(dofs.any()), MPI.LOR):
            return 0, "nowhere"
        space = self.space
        others = dofs[: self.num_owned].copy()
        others[space.owned_dofs] = False
        marked = dofs[space.owned_dofs].any(axis=1)
        places = [self._X[: space.num_nodes][marked]]
        if space.is_mixed:
            cells = compat.dofmap(space.whole)
            middle = np.empty((self.u.x.array.size, 2))
            middle[cells] = self._X[compat.dofmap(self.V)].mean(axis=1)[:, None]
            places.append(middle[np.flatnonzero(others)])
        return count_places(self.comm, np.concatenate(places))

    def flat_cells(self) -> tuple[int, str]:
        """Number of cells without area in the reference state, and a place (collective)."""
        flat = np.isnan(self._undeformed_areas).all(axis=1)
        return count_places(self.comm, self._X[self._cells[flat]].mean(axis=1))

    def by_input_node(self) -> tuple[npt.NDArray[np.int64], Array]:
        """Names (n, k), see ``compat``, and values of all nodes, on all ranks (collective).

        Values are displacements (n, 2); in a mixed space each dof counts as a node, (n, 1).
        """
        size = self.space.block_size
        owned = self.num_owned // size
        nodes = np.concatenate(self.comm.allgather(compat.input_nodes(self.space.whole)[:owned]))
        u = np.concatenate(self.comm.allgather(self.u.x.array.reshape(-1, size)[:owned]))
        order = np.lexsort(nodes.T[::-1])
        return nodes[order], u[order]

    def set_by_input_node(self, nodes: npt.NDArray[np.int64], values: Array) -> None:
        """Set the displacement from what ``by_input_node`` gave.

        Raises:
            MortarError: On all ranks, if the nodes are those of another mesh or degree.
        """
        mine = compat.input_nodes(self.space.whole)
        wrong = nodes.ndim != 2 or nodes.shape[1] != mine.shape[1]
        if not wrong:
            both, place = np.unique(np.concatenate([nodes, mine]), axis=0, return_inverse=True)
            wrong = len(both) != len(nodes)
        error = MortarError("the saved state belongs to another mesh or degree") if wrong else None
        raise_together(self.comm, error)
        of_name = np.empty(len(both), np.int64)
        place = place.ravel()
        of_name[place[: len(nodes)]] = np.arange(len(nodes))
        self.u.x.array[:] = values[of_name[place[len(nodes) :]]].ravel()

    def inside_other_body(
        self, points: Array, bodies: Array, labels: npt.NDArray[np.int64]
    ) -> npt.NDArray[np.bool_]:
        """Which points lie inside a deformed cell of another body than their own (collective).

        Args:
            points: Positions, equal on all ranks, shape (n, 2) [length].
            bodies: Body of each point, shape (n,).
            labels: Body of each local node.
        """
        inside = np.zeros(len(points), bool)
        if len(points) and len(self._cells):
            x, near = self.positions(), np.empty(len(self._cells), bool)
            find_near(x, self._cells, points.min(axis=0), points.max(axis=0), near)
            corners, own = x[self._cells[near]], labels[self._cells[near, 0]]
            centres = corners.mean(axis=1)
            radius = np.linalg.norm(corners - centres[:, None], axis=2).max(initial=0.0)
            close = cKDTree(centres).query_ball_point(points, radius)
            point = np.repeat(np.arange(len(points)), [len(cells) for cells in close])
            cell = np.concatenate([np.asarray(cells, np.int64) for cells in close])
            other = own[cell] != bodies[point]
            cell, point = cell[other], point[other]
            inside[point[_contains(corners[cell], points[point])]] = True
        self.comm.Allreduce(MPI.IN_PLACE, inside, MPI.LOR)
        return inside

    def inverted_cells(self) -> tuple[int, str]:
        """Number of inverted cells, and the reference place of one (collective)."""
        inverted = np.unique(np.nonzero(self._areas() <= 0.0)[0])
        return count_places(self.comm, self._X[self._cells[inverted]].mean(axis=1))


def prescribed_dofs(space: DisplacementSpace, u: Any, bcs: Sequence[Any]) -> npt.NDArray[np.bool_]:
    """Whether local dofs have Dirichlet values (local).

    Raises:
        MortarError: If a condition is of another space.
    """
    prescribed = np.zeros(u.x.array.size, bool)
    for number, bc in enumerate(bcs):
        if not compat.is_part_of(space.whole, bc.function_space):
            raise MortarError(
                f"Dirichlet condition {number} is of another space; right is the space of u or "
                "a component of it"
            )
        prescribed[bc.dof_indices()[0]] = True
    return prescribed


def _row_sizes(matrix: PETSc.Mat, columns: Array) -> Array:
    """Largest size of an entry in each row of matrix diag(columns), shape (owned rows,)."""
    scale = matrix.createVecRight()
    scale.array[:] = columns
    scaled = matrix.copy()
    scaled.diagonalScale(None, scale)
    starts, _, values = scaled.getValuesCSR()
    scaled.destroy()
    rows = np.repeat(np.arange(columns.size), np.diff(starts))
    sizes = np.zeros(columns.size)
    np.maximum.at(sizes, rows, np.abs(values))
    return sizes


def _areas(x: Array, cells: npt.NDArray[np.int32], gradients: Array) -> Array:
    """Determinant of dx/dX at the nodes of ``cells`` (m, k): shape (m, k) [area]."""
    areas = np.empty(cells.shape)
    tabulate_areas(x, cells, gradients, areas)
    return areas


def _contains(corners: Array, points: Array) -> npt.NDArray[np.bool_]:
    """Whether each of ``points`` (n, 2) lies in its cell ``corners`` (n, nodes, 2), drawn by lines.

    A ray from the point meets the outline an odd number of times.
    """
    x = corners[:, AROUND[corners.shape[1]]] - points[:, None]
    y, after = x, np.roll(x, -1, axis=1)
    meets = (y[..., 1] > 0.0) != (after[..., 1] > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (after[..., 0] - y[..., 0]) / (after[..., 1] - y[..., 1])
        ahead = y[..., 0] - slope * y[..., 1] > 0.0
    return (meets & ahead).sum(axis=1) % 2 == 1


def _proper_areas(x: Array, cells: npt.NDArray[np.int32], gradients: Array) -> Array:
    """As ``_areas``, with nan where a cell is flat, as where two nodes are one."""
    areas, extent = _areas(x, cells, gradients), np.ptp(x[cells], axis=1).max(axis=1, initial=0.0)
    return np.where(np.abs(areas) > FLAT * extent[:, None] ** 2, areas, np.nan)
