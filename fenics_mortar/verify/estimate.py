# SPDX-License-Identifier: MIT
"""A posteriori error estimate from the residual of equilibrium between the nodes, for each cell.

The exact stress satisfies div P + f = 0 in the bodies and has equal tractions on both sides of
every line, in space of every face; on the boundary the traction is given, or that of contact. The
defects of the discrete solution in the energy norm are

    eta_T^2 = b h^2 |div P + f|^2 / Q + sum over sides of c h [P N - t] . Q^-1 [P N - t] + gap,

with Q_ik = dP_iJ / dF_kL N_J N_L, the stiffness of a layer across N (for linear elasticity
lambda + 2 mu along N and mu across it); in a cell Q is averaged over N. On a side h is the height
of the parallelogram or parallelepiped that a simplex fills in part, in a cell the root of its area
or the cubic root of its volume. t is the mean traction of the two cells of an inner side, the given
traction on the boundary, and the multiplier on contact surfaces. The discrete gap is closed only in
the mean: penetration g contributes (Q_nn / 2 h) g^2, the work of pressing it into the layers on
both sides, and so does opening if all corners of a facet are active; otherwise the gap contributes
the work z_n g. The slip s of a step contributes with Q along the facet if all its corners stick,
otherwise by the work b |s| - z_tau . s that friction with the limit b would dissipate in excess
of the multiplier. The jump of tied surfaces contributes with the full Q. Straight facets of a
curved surface cause gaps and overlaps that the exact surface does not have; the estimate is then
too high. Residuals of the constraints of mixed functions, such as incompressibility, contribute the
energy of the smallest change of grad u that removes them.

The terms are those of Hild and Nicaise (Numer. Math. 101, 2005) and of Krause, Veeser and Walloth
(Numer. Math. 130, 2015), who prove them for linear elasticity on a rigid obstacle, the latter for
simplices in the plane and in space: error and estimate bound each other up to factors that depend
on degree and shape of the cells and have no known values. Nothing here depends on the dimension but
h and the measures of sides. For friction, two bodies and finite strains there is no proof.

Averaging of stresses (Zienkiewicz and Zhu) is not used: it averages stresses across interfaces of
materials, ignores loads and contact, and is less accurate with degree 2. Residual estimates have no
sharp constants; with b and c as chosen, each term alone is exact for a layer of cells under a
stress that varies across it with one degree more than the cells can represent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import permutations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fenics_mortar.bulk.cells import DEGREES, ReferenceCell, normals_of, sum_over_cells
from fenics_mortar.bulk.fluxes import Fluxes
from fenics_mortar.interface.reference import gauss_points, tabulate
from fenics_mortar.utils import compat, errors, files
from fenics_mortar.utils.arrays import ROUNDING, TINY, Array, Flags, Indices
from fenics_mortar.verify.defects import interface_defects, interface_tractions

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.interface.surfaces import Surface

# Decimals of the linear functions at points, which are equal or differ by 0.1 at least.
DECIMALS = 6


class CellSides:
    """Sides of the owned cells: neighbours on any rank, facets of surfaces, prescribed components.

    The points are those of ``ReferenceCell.rule``. Both cells of a side, and a surface, list the
    points of a symmetric rule in orders of their own. They share the order by the linear functions
    of the corners, taken in the order of their global numbers.

    The constructor is collective.

    Args:
        bulk: The bodies.
        cell: The reference cell.

    Attributes:
        facets: Local facets, shape (cells, sides).
        inner: Whether there is a cell on the other side, on any rank, shape (cells, sides).
        prescribed: Whether a component is prescribed at all nodes, shape (cells, sides, dim).
    """

    def __init__(self, bulk: Bulk, cell: ReferenceCell) -> None:
        V, self._mesh, dim = bulk.V, bulk.V.mesh, bulk.space.dim
        topology, layout = V.mesh.topology, V.dofmap.dof_layout
        topology.create_connectivity(dim, dim - 1)
        shape = topology.index_map(dim).size_local, len(cell.sides)
        facets = topology.connectivity(dim, dim - 1).array[: shape[0] * shape[1]]
        self.facets: Indices = facets.reshape(shape).astype(np.int64)
        nodes = compat.dofmap(V)[: shape[0]]
        closures = [layout.entity_closure_dofs(dim - 1, k) for k in range(shape[1])]
        self.prescribed = bulk.prescribed[bulk.space.dofs[nodes[:, closures]]].all(axis=2)
        at = [[layout.entity_dofs(0, vertex)[0] for vertex in side] for side in cell.sides]
        corners = V.dofmap.index_map.local_to_global(nodes[:, at].ravel().astype(np.int32))
        self._corners = np.asarray(corners, np.int64).reshape(*shape, cell.sides.shape[1])
        self._order = common_order(self._corners)
        count = sum_over_cells(V.mesh, facets, np.ones((facets.size, 1)))[:, 0]
        self.inner: Flags = count[self.facets] > 1.0

    def of_surface(self, surface: Surface) -> tuple[Indices, Indices, Indices]:
        """Cells, their sides, and the facets of the surface on these sides, each (n,) (local)."""
        t, k = np.nonzero(~self.inner)
        theirs, mine = np.sort(surface.nodes[surface.corners]), np.sort(self._corners[t, k])
        both = np.concatenate([theirs, mine])
        number = np.unique(both, axis=0, return_inverse=True)[1].reshape(len(both))
        facet = np.full(len(both), -1)
        facet[number[: len(theirs)]] = np.arange(len(theirs))
        facet = facet[number[len(theirs) :]]
        on = facet >= 0
        return t[on], k[on], facet[on]

    def from_surface(self, surface: Surface, values: Array) -> tuple[Indices, Indices, Array]:
        """Values (facets, q, c) of a surface at the points of the sides on it (local).

        Returns:
            Cells (n,), their sides (n,), and values (n, q, c) [their unit].
        """
        t, k, facet = self.of_surface(surface)
        order = common_order(surface.nodes[surface.corners])[facet]
        common = np.take_along_axis(values[facet], order[..., None], axis=1)
        return t, k, _in_own_order(common, self._order[t, k])

    def sum_of_both(self, values: Array) -> Array:
        """Sum of values (cells, sides, q, c) of the one or two cells of a facet (collective).

        The result has the shape of ``values`` [unit of values].
        """
        common, facets = np.take_along_axis(values, self._order[..., None], axis=2), self.facets
        flat = common.reshape(facets.size, math.prod(common.shape[2:]))
        total = sum_over_cells(self._mesh, facets.ravel(), flat)
        return _in_own_order(total[facets].reshape(values.shape), self._order)


def common_order(corners: Indices) -> Indices:
    """Order of the points of facets that depends on the numbers of their corners alone (local).

    Args:
        corners: Global numbers of the corners, shape (..., c).

    Returns:
        Numbers of the points, shape (..., q).
    """
    size = corners.shape[-1]
    return _orders(size)[np.argsort(corners, axis=-1) @ size ** np.arange(size)]


@cache
def _orders(size: int) -> Indices:
    """Orders by the permutation of ``size`` corners, shape (size^size, q)."""
    shapes = tabulate(gauss_points(size)[0], size)[:, 0].round(DECIMALS)
    orders = np.zeros((size**size, len(shapes)), np.int64)
    for permutation in permutations(range(size)):
        place = permutation @ size ** np.arange(size)
        orders[place] = np.lexsort(shapes[:, permutation].T)
    return orders


def _in_own_order(common: Array, order: Indices) -> Array:
    """Values (..., q, c) in the common order, in the order of the facets' own points."""
    return np.take_along_axis(common, np.argsort(order, axis=-1)[..., None], axis=-2)


# Factors b and c of the terms in cells and on sides, by degree [1].
CELL_FACTOR = {1: 1 / 12, 2: 1 / 60}
SIDE_FACTOR = {1: 1 / 6, 2: 1 / 10}
# Cells whose values at points are in memory at a time.
CELLS_AT_ONCE = 10_000


@dataclass(frozen=True)
class ErrorEstimate(files.Markdown):
    """Estimate of the error of the displacement in the energy norm; properties are local.

    Prints as a Markdown table of the parts.

    Attributes:
        cells: Indicator of each cell of this rank, shape (owned cells,) [stress^1/2 length].
        size: Norm of the solution, the root of the integral of P : grad u [stress^1/2 length].
        parts: Norms of the terms: "cells", "constraint" (of mixed functions), "sides" between
            cells, "boundary", "contact" (tractions), "gap" (for tied surfaces: their jump) and
            "slip" [stress^1/2 length]; equal on all ranks, as is ``size``.
        mesh: The mesh.
    """

    cells: Array
    size: float
    parts: dict[str, float]
    mesh: Any

    @property
    def total(self) -> float:
        """Estimate of the error of all bodies [stress^1/2 length]."""
        return float(np.sqrt(sum(part**2 for part in self.parts.values())))

    @property
    def relative(self) -> float:
        """Ratio of ``total`` and the norm of the solution [1]."""
        return self.total / self.size if self.size > 0.0 else np.inf

    def __str__(self) -> str:
        """Relative error, and a Markdown table of the parts and their shares of its square."""
        square = self.total**2
        rows = [
            [name, f"{part:.2e}", f"{100.0 * part**2 / square:.0f} %"]
            for name, part in self.parts.items()
            if part > 0.0
        ]
        table = files.markdown_table(["part", "estimate", "share of square"], rows, left=(0,))
        error = f"estimated error {100.0 * self.relative:.3g} % in the energy norm"
        text = f"{error}: {self.total:.3e} of {self.size:.3e}"
        return f"{text}\n\n{table}" if rows else text

    def mark(self, fraction: float = 0.5) -> Indices:
        """Mark the fewest cells with a fraction of the squared estimate (collective).

        Bulk criterion of Doerfler (SIAM J. Numer. Anal. 33, 1996).

        Args:
            fraction: Fraction of the squared estimate [1].

        Returns:
            Local cells, shape (n,). Cells with equal indicators are marked together.

        Raises:
            ValueError: On all ranks, unless ``fraction`` is above 0 and at most 1.
        """
        with errors.together(self.mesh.comm, "mark"):
            errors.check_number(
                "fraction", fraction, "a number above 0 and up to 1", lambda p: 0.0 < p <= 1.0
            )
        mine = self.cells**2
        squares = np.sort(np.concatenate(self.mesh.comm.allgather(mine)))[::-1]
        enough = np.cumsum(squares) >= fraction * (1 - ROUNDING) * squares.sum()
        return np.flatnonzero(mine >= squares[np.argmax(enough)] * (1 - ROUNDING))


class Estimator:
    """Error indicator of bodies, compiled once.

    The constructor is collective.

    Args:
        bulk: The bodies.

    Raises:
        MortarError: On all ranks, if the residual has unsupported integrals.
    """

    def __init__(self, bulk: Bulk) -> None:
        self._mesh = bulk.V.mesh
        self._fluxes = Fluxes(bulk.residual, bulk.u, bulk.space)
        self._sides = CellSides(bulk, self._fluxes.cell)
        self._degree = DEGREES[bulk.V.dofmap.dof_layout.num_dofs]
        self._prescribed = bulk.prescribed.astype(float)
        affine = compat.geometry_dofmap(self._mesh).shape[1] == bulk.space.dim + 1
        self._varies = slice(1 if affine else None)  # points where Jacobians differ

    def evaluate(self, interfaces: Sequence[Interface]) -> ErrorEstimate:
        """Estimate the error of the present state, with interfaces evaluated there (collective).

        Args:
            interfaces: Contact and tied pairs.

        Raises:
            Exception: An error of a user's law, raised on all ranks.
        """
        sides, (own, size) = self._sides, self._in_batches()
        parts = {"cells": own.cells, "constraint": own.constraint}
        defects, touching = self._defects(own.tractions, interfaces)
        work = (own.measure * _work(own.Q, defects)).sum(axis=2)
        work = SIDE_FACTOR[self._degree] * own.height * work
        boundary = ~sides.inner & ~touching
        for name, on in (("sides", sides.inner), ("boundary", boundary), ("contact", touching)):
            parts[name] = np.where(on, work, 0.0).sum(axis=1)

        layer = own.Q.mean(axis=2) / own.height[..., None, None]
        parts |= {name: np.zeros(len(work)) for name in ("gap", "slip")}
        for pair in interfaces:
            t, s, facet = sides.of_surface(pair.slave)
            share = 0.5 if pair.master.num_nodes else 1.0  # two layers in series
            for name, (dyads, lost) in interface_defects(pair).items():
                work = share * np.einsum("tik,tik->t", layer[t, s], dyads[facet]) + lost[facet]
                np.add.at(parts[name], t, work)

        terms = [size, *(part.sum() for part in parts.values())]
        sums = self._mesh.comm.allreduce(np.array(terms))
        size, *norms = np.sqrt(np.abs(sums)).tolist()
        indicator = np.sqrt(np.sum(list(parts.values()), axis=0))
        return ErrorEstimate(indicator, size, dict(zip(parts, norms, strict=True)), self._mesh)

    def _in_batches(self) -> tuple[_OwnTerms, float]:
        """Terms of all owned cells, and the integral of P : grad u over them (collective)."""
        count = len(self._sides.facets)
        batches = np.array_split(np.arange(count), max(1, -(-count // CELLS_AT_ONCE)))
        terms, sizes, rests = zip(*(self._own_terms(cells) for cells in batches), strict=True)
        self._fluxes.refuse_fluxes(np.max(rests, axis=0))
        return _OwnTerms(*(np.concatenate(parts) for parts in zip(*terms, strict=True))), sum(sizes)

    def _own_terms(self, cells: Indices) -> tuple[_OwnTerms, float, Array]:
        """Terms of ``cells`` (n,), the integral of P : grad u, and ``Fluxes.in_cells``' rest."""
        cell = self._fluxes.cell
        inside, along, rest = self._fluxes.in_cells(cells)
        A, C = self._fluxes.moduli(cells)
        dim, varies = A.shape[1], self._varies
        volume = np.abs(np.linalg.det(inside.jacobian[:, varies])) * cell.weights
        filled = cell.fill * volume.sum(axis=1)
        Q = np.einsum("tiJkJ->tik", A)[:, None] / dim
        work = (volume * _work(Q, inside.residual)).sum(axis=1)
        of_cells = CELL_FACTOR[self._degree] * filled ** (2 / dim) * work
        constraint = (volume * _work_of_constraints(A, C, inside.constraint)).sum(axis=1)
        N, measure = _outlines(along.jacobian[:, :, varies], cell)
        measure = measure * cell.rule[1]
        tractions = np.einsum("tsqiJ,tsqJ->tsqi", along.stress, N)
        Q = np.einsum("tsqikL,tsqL->tsqik", np.einsum("tiJkL,tsqJ->tsqikL", A, N), N)
        height = filled[:, None] / (cell.side_fill * measure.sum(axis=2))
        size = np.sum(volume * np.einsum("tpiJ,tpiJ->tp", inside.stress, inside.gradient))
        return _OwnTerms(of_cells, constraint, tractions, measure, Q, height), float(size), rest

    def _defects(self, tractions: Array, interfaces: Sequence[Interface]) -> tuple[Array, Flags]:
        """Errors of tractions (cells, sides, q, dim), and sides on interfaces (cells, sides)."""
        sides = self._sides
        outer, touching = ~sides.inner, np.zeros(sides.inner.shape, bool)
        defects = 0.5 * sides.sum_of_both(tractions)
        t, k = np.nonzero(outer)
        defects[t, k] = tractions[t, k] - self._fluxes.loads(t, k, sides.facets[t, k])
        for pair in interfaces:
            for surface, given in interface_tractions(pair, self._prescribed):
                t, k, values = sides.from_surface(surface, given)
                defects[t, k] -= values
                touching[t, k] = True
        prescribed = sides.prescribed & outer[..., None]
        return np.where(prescribed[:, :, None, :], 0.0, defects), touching


class _OwnTerms(NamedTuple):
    """Terms of cells that depend on nothing else, and what the others need of them.

    Attributes:
        cells: eta_T^2 of the residual in the cell, shape (cells,) [stress area length].
        constraint: That of the constraints, shape (cells,).
        tractions: P N at the points of the sides, shape (cells, sides, q, dim) [stress].
        measure: Weights of these points, shape (cells, sides, q) [area].
        Q: Stiffness of layers along the sides at their points, at one of them if the cells are
            affine, shape (cells, sides, 1 or q, dim, dim) [stress].
        height: Height h of the cell above its sides, shape (cells, sides) [length].
    """

    cells: Array
    constraint: Array
    tractions: Array
    measure: Array
    Q: Array
    height: Array


def _work(Q: Array, t: Array) -> Array:
    """Work t . |Q|^-1 t for Q (..., dim, dim) and t (..., dim); |Q| has absolute eigenvalues."""
    return np.asarray((t * np.einsum("...ij,...j->...i", _inverse(Q), t)).sum(axis=-1))


def _inverse(Q: Array) -> Array:
    """Inverses |Q|^-1 (..., dim, dim); most bodies are stable, and have definite matrices."""
    Q = 0.5 * (Q + np.swapaxes(Q, -1, -2))
    try:
        np.linalg.cholesky(Q)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(Q)
        scaled = vectors / np.maximum(np.abs(values), TINY)[..., None, :]
        return scaled @ np.swapaxes(vectors, -1, -2)
    return np.linalg.inv(Q)


def _work_of_constraints(A: Array, C: Array, c: Array) -> Array:
    """Twice the energy of the smallest grad u that satisfies the constraints, (cells, p) (local).

    Args:
        A: Moduli at fixed other unknowns [stress], shape (cells, dim, dim, dim, dim).
        C: Derivative of the constraints with respect to grad u, (cells, constraints, dim, dim).
        c: Values of the constraints, shape (cells, p, constraints).
    """
    size = A.shape[1] ** 2
    flat = C.reshape(*C.shape[:2], size)
    H = np.einsum("tak,tpk->tpa", np.linalg.pinv(flat), c)
    return np.abs(np.einsum("tpa,tab,tpb->tp", H, A.reshape(-1, size, size), H))


def _outlines(jacobian: Array, cell: ReferenceCell) -> tuple[Array, Array]:
    """Outer normals (cells, sides, k, dim) and areas over those of the reference (local).

    ``jacobian`` (cells, sides, k, dim, dim): at the first k points of each side.
    """
    tangents = np.einsum("tskcX,skaX->tskac", jacobian, cell.tangents[:, : jacobian.shape[2]])
    N = normals_of(tangents)
    outward = np.einsum("tskcX,sX->tskc", jacobian, cell.normals)
    measure = np.linalg.norm(N, axis=3)
    return N * (np.sign((N * outward).sum(axis=3)) / measure)[..., None], measure
