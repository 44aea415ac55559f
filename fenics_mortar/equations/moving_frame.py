# SPDX-License-Identifier: MIT
"""Extrapolation of states in a frame that moves with the contact.

If contact slides or rolls along a body by a facet or more per step, a node of that body is ahead of
the contact in one state, in contact in the next and behind it afterwards. Extrapolation of nodal
displacements then fails. In a frame that moves with the contact, displacements change little. Let
X_c be the position of a contact on the undeformed body, the mean of its nodes weighted by their
forces, and s its change in the last step, of length 1. The guess for a step of length r is

    u(X) = v + r (v - w),    v = u_n(X - r s),    w = u_(n-1)(X - (1 + r) s),

which is linear extrapolation for s = 0; multipliers likewise along the slave surface. States are
interpolated linearly on a Delaunay triangulation of the body's nodes. Where X - r s or X - (1 + r)
s is outside the body, linear extrapolation is used. The ends of a long body are hardly affected by
contact in its middle. The surface of a round body is affected, and rolling bodies do not benefit
from the frame.

Measured on shallow ironing with friction, 80 facets on the block: steps of one facet take 6
iterations from linear extrapolation or the last state, steps of three facets 11; from this guess 3
and 4.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.equations.general import ContactEquations
from fenics_mortar.equations.options import EQUATIONS
from fenics_mortar.equations.state import State
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.kernels.locate import locate
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.rounding import HALF_FACET


class _Side(NamedTuple):
    """A surface of a contact, and its body."""

    contact: int
    is_slave: bool
    surface: Surface
    body: int


class MovingFrame:
    """Positions of contacts on bodies, and extrapolation of states in the moving frame.

    Args:
        problem: Its equations.
    """

    def __init__(self, problem: ContactEquations) -> None:
        self._problem, self._sides = problem, list[_Side]()
        for number, contact in enumerate(problem.contacts):
            for surface in (contact.slave, contact.master):
                bodies = np.unique(problem.floating.labels_of(surface))
                if isinstance(contact, Contact) and bodies.size == 1:
                    is_slave = surface is contact.slave
                    self._sides.append(_Side(number, is_slave, surface, int(bodies[0])))
        self._meshes: dict[int, Any] = {}

    def contact_centres(self) -> Array:
        """Undeformed positions of contacts, (sides, 2), nan if open [length] (collective)."""
        found = []
        for side in self._sides:
            contact = self._problem.contacts[side.contact]
            forces = contact.operators.force(contact.z)[0 if side.is_slave else 1]
            weight = np.hypot(*forces.T)
            with np.errstate(invalid="ignore"):
                found.append(weight @ side.surface.X / weight.sum())
        return np.array(found).reshape(-1, 2)

    def guess(self, last: State, before: State, moved: Array, ratio: float) -> State | None:
        """Extrapolate two states in the frame of the contacts (collective).

        Args:
            last: The last state.
            before: The state before it.
            moved: Change of ``contact_centres`` between them, shape (sides, 2) [length].
            ratio: Length of the next step over that of the last one.

        Returns:
            The state, with the active sets of the last one; ``None`` if no contact moves by half a
            facet or more.
        """
        motions = self._motions(moved, ratio)
        if not motions:
            return None
        guess = last.towards(before, -ratio)
        interfaces = list(guess.interfaces)
        u = guess.u.copy()
        for body, s in motions.items():
            self._shift_body(u, (last.u, before.u), body, s, ratio)
        for side in self._sides:
            if side.is_slave and side.body in motions:
                s, i = motions[side.body], side.contact
                states = last.interfaces[i].z, before.interfaces[i].z
                z = _shifted(side.surface, states, s, ratio)
                interfaces[i] = replace(interfaces[i], z=z)
        return replace(guess, u=u, interfaces=tuple(interfaces))

    def _motions(self, moved: Array, ratio: float) -> dict[int, Array]:
        """Motions of contacts by half a facet or more, by body, (2,) each [length] (local)."""
        found = {}
        for body in {side.body for side in self._sides}:
            mine = [k for k, side in enumerate(self._sides) if side.body == body]
            s = moved[mine].mean(axis=0)
            facet = min(self._sides[k].surface.lengths.min() for k in mine)
            size = np.hypot(*s)
            distance = np.hypot(*(moved[mine] - s).T).max()
            if ratio * size > HALF_FACET * facet and distance <= EQUATIONS.same_direction * size:
                found[body] = s
        return found

    def _shift_body(
        self, u: Array, states: tuple[Array, Array], body: int, s: Array, ratio: float
    ) -> None:
        """Overwrite the displacements of a body in ``u`` by shifted ones (collective)."""
        problem = self._problem
        dofs, owned = problem.bulk.space.dofs, problem.bulk.space.num_nodes
        mine = np.flatnonzero(problem.floating.labels == body)
        X = problem.bulk.V.tabulate_dof_coordinates()[mine, :2]
        own = mine < owned
        if body not in self._meshes:
            from scipy.spatial import Delaunay

            self._meshes[body] = Delaunay(self._gathered(X[own]))
        v, w = (
            _interpolated(self._meshes[body], self._gathered(state[dofs[mine[own]]]), X - t)
            for state, t in zip(states, (ratio * s, (1.0 + ratio) * s), strict=True)
        )
        there = np.isfinite(v + w).all(axis=1)
        u[dofs[mine[there]]] = (v + ratio * (v - w))[there]

    def _gathered(self, values: Array) -> Array:
        """Concatenate the rows of all ranks (collective)."""
        return np.concatenate(self._problem.comm.allgather(values))


def _interpolated(mesh: Any, values: Array, points: Array) -> Array:
    """Interpolate values (nodes, 2) at points (n, 2), nan outside the triangulation (local)."""
    found, weights = np.empty(len(points), np.int64), np.empty((len(points), 3))
    locate(points, mesh.points, mesh.simplices, mesh.neighbors, found, weights)
    at = np.einsum("nk,nkc->nc", weights, values[mesh.simplices[found]])
    return np.where(found[:, None] >= 0, at, np.nan)


def _shifted(surface: Surface, states: tuple[Array, Array], s: Array, ratio: float) -> Array:
    """Extrapolate the shifted multipliers of two states, shape (slave nodes, 2) (local)."""
    X, own = surface.X, np.arange(surface.num_nodes)
    before, after = (np.where(to >= 0, to, own) for to in (surface.previous, surface.following))
    chord = X[after] - X[before]
    along = chord @ s / np.hypot(*chord.T)
    path = np.cumsum(np.hypot(*np.diff(X, axis=0, prepend=X[:1]).T))

    def at(values: Array, back: Array) -> Array:
        return np.stack([np.interp(path - back, path, values[:, k]) for k in (0, 1)], axis=1)

    v, w = (at(z, t * along) for z, t in zip(states, (ratio, 1.0 + ratio), strict=True))
    return v + ratio * (v - w)
