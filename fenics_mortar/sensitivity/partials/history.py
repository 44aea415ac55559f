# SPDX-License-Identifier: MIT
"""Derivative of a step's rows with respect to the accepted state at the start of the step.

The rows depend on the previous state through the partners of the slave nodes, see ``slip``: the
matrices D / w and M / w of that state, its distances along the tangent (``start``), its nearest
points of an obstacle, and for redundant sticks its shear. With the present positions x and m, the
previous ones x' and m' and the tangent t of that state, the slip of node j is

    u_j = tau_j . (P x - Q m - s v)_j - t_j . (P x' - Q m' - s v')_j,    P = D / w,  Q = M / w,

v = D x - M m, and changes with the previous state by

    du_j = dP_jk (tau_j . x_k - t_j . x'_k) - dQ_jl (tau_j . m_l - t_j . m'_l)
         - ds_j tau_j . v_j - t_j . (P dx' - Q dm')_j - dt_j . (P x' - Q m')_j.

For the measure "operators", s = 1 / w, the second bracket of u_j vanishes at any state. Active set,
multiplier nodes and the facets that face each other are fixed.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import ELASTIC, ContactFields
from fenics_mortar.contact.slip import Partners
from fenics_mortar.contact.state import InterfaceState
from fenics_mortar.interface.facing import nearest_facets
from fenics_mortar.interface.integrals import evaluate_normals, share_of
from fenics_mortar.interface.mortar import EXACT, Block, MortarOperators, minus_offset
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.sensitivity.partials.fields import off_planes
from fenics_mortar.sensitivity.partials.maps import Dofs, NodalDerivative, PairVector, rows_at_nodes
from fenics_mortar.utils.arrays import Array, Flags, Indices


class Earlier:
    """An earlier accepted state of a contact, and its operators with all derivatives.

    The constructor is collective; the state of the contact and of its obstacle is not changed.

    Args:
        contact: The contact.
        u: Displacement of that state, shape (local dofs,) [length].
        state: State of the contact.
        place: Position (x, y, angle) of the obstacle, if there is one, shape (3,).

    Attributes:
        fields: Nodal fields of that state.
        place: The argument.
    """

    def __init__(
        self, contact: Contact, u: Array, state: InterfaceState, place: Array | None = None
    ) -> None:
        self.contact, self.place = contact, place
        obstacle = contact.obstacle
        with self.at_earlier_position():  # a copy: the contact itself is unchanged
            operators, _ = copy(contact.evaluation).evaluate(u, state, EXACT)
            if state.offset.any():
                operators = minus_offset(operators, state.offset)
            self.fields: ContactFields = type(contact.now)(contact, state, operators)
            if obstacle is not None:
                self.rotation = obstacle.rotation
                self.gradient = _gradient(self.operators)
                self.V_at_feet = obstacle.motions(_feet(self.operators), contact.arm)

    @contextmanager
    def at_earlier_position(self) -> Iterator[None]:
        """Context in which the obstacle is at its position in that state (local)."""
        obstacle = self.contact.obstacle
        if obstacle is None or self.place is None:
            yield
            return
        present, obstacle.place = obstacle.place, self.place.copy()
        try:
            yield
        finally:
            obstacle.place = present

    @property
    def operators(self) -> Any:
        """Operators of that state."""
        return self.fields.operators

    @property
    def touches(self) -> Flags:
        """Nodes whose partners are along the slave's own normal, as in ``Contact.accept``.

        Shape (slave nodes,), bool.
        """
        pair, state = self.contact.pair, self.fields.state
        touches = state.active | (pair.sliding == "small")
        return touches | self.fields.acts if pair.law.bridges_gap else touches


def _feet(o: ObstacleOperators) -> Array:
    """Nearest points of the obstacle, shape (slave nodes, 2) [length]."""
    return o.x + o.phi[:, None] * o.n


def _gradient(o: ObstacleOperators) -> Array:
    """Gradient of the distance at the slave nodes, shape (slave nodes, 2) [1].

    With small sliding the distance changes along the frozen normals.
    """
    return -o.n if o.linearization.frozen else o.obstacle.evaluate(o.x)[1]


class PairHistory:
    """Derivative of the rows of a contact with respect to an earlier state; collective methods.

    Args:
        contact: The contact, evaluated at the end of the step.
        earlier: The state that defines the partners.

    Attributes:
        slip: Derivative of the slip of the step [1].
        shear: Derivative of the initial shear of redundant sticks.
    """

    def __init__(self, contact: Contact, earlier: Earlier) -> None:
        self._contact = contact
        f = contact.now
        dofs = Dofs((contact.slave, contact.master))
        self.slip = off_planes(slip_derivative(contact, earlier, dofs), contact)
        self.shear = shear_derivative(earlier, dofs)
        weights = contact.rows.frame()[2:]
        terms = [s * row.by_slip[:, None] for s, row in zip(weights, f.law_rows, strict=True)]
        self._by_slip = -np.sum(terms, axis=0)
        self._by_shear = weights[0] * (f.state.redundant / ELASTIC)[:, None]

    def along(self, direction: PairVector) -> Array:
        """Change of the rows, shape (slave nodes, 2) [stress length]."""
        slip, shear = self.slip.along(direction), self.shear.along(direction)
        return self._by_slip * slip[:, None] + self._by_shear * shear[:, None]

    def back(self, rows: Array) -> PairVector:
        """Gradient of the sum of the rows times ``rows`` (slave nodes, 2)."""
        by_slip = np.einsum("jc,jc->j", self._by_slip, rows)
        by_shear = np.einsum("jc,jc->j", self._by_shear, rows)
        return self.slip.back(by_slip).plus(self.shear.back(by_shear))


def shear_derivative(earlier: Earlier, dofs: Dofs) -> NodalDerivative:
    """Derivative of the earlier shear z_tau of active nodes, zero at others (local)."""
    o, state = earlier.operators, earlier.fields.state
    on = state.active[:, None]
    values = np.where(on, o.tangential_derivative(state.z), 0.0)
    blocks = [rows_at_nodes(o.slave, o.normal_columns(), values)]
    by_motion = np.zeros((len(o.x), 3))
    if isinstance(o, ObstacleOperators):
        z = state.z
        by_motion = np.where(on, z[:, 1:] * o.dn_dq[:, 0] - z[:, :1] * o.dn_dq[:, 1], 0.0)
    return NodalDerivative(dofs, blocks, np.where(on, o.tau, 0.0), by_motion)


def slip_derivative(contact: Contact, earlier: Earlier, dofs: Dofs) -> NodalDerivative:
    """Derivative of the present slip with respect to the earlier state (local)."""
    none = np.zeros_like(contact.z)
    if isinstance(contact.operators, ObstacleOperators):
        blocks, by_motion = _on_obstacle(contact.operators, earlier)
        return NodalDerivative(dofs, blocks, none, by_motion)
    terms = _Terms(contact.operators, earlier, contact.partners)
    return NodalDerivative(dofs, list(terms.blocks()), none, np.zeros((len(none), 3)))


def _on_obstacle(now: ObstacleOperators, earlier: Earlier) -> tuple[list[Block], Array]:
    """Blocks and derivative with respect to motions of the slip along an obstacle (local).

    The slip is -tau . y with the nearest point y of the earlier state, which moves with the
    obstacle. The nearest point lies along the normal; therefore ``start`` vanishes at any state.
    """
    o, rotation = earlier.operators, earlier.rotation
    r = -now.tau @ now.obstacle.rotation @ rotation.T
    along = np.einsum("jc,jc->j", r, o.n)
    values = r + along[:, None] * earlier.gradient
    of_normals = o.normal_derivative(o.phi[:, None] * r)
    blocks = [
        rows_at_nodes(o.slave, o.slave.dofs, values),
        rows_at_nodes(o.slave, o.normal_columns(), of_normals),
    ]
    by_motion = o.phi[:, None] * np.einsum("jc,jcm->jm", r, o.dn_dq)
    by_motion -= along[:, None] * np.einsum("jc,jmc->jm", earlier.gradient, o.V)
    by_motion -= np.einsum("jc,jmc->jm", r, earlier.V_at_feet)
    return blocks, by_motion


class _Terms:
    """Terms of the derivative of the slip between two surfaces (local).

    Args:
        now: Operators at the end of the step.
        earlier: State that defines the partners.
        partners: The partners.
    """

    def __init__(self, now: MortarOperators, earlier: Earlier, partners: Partners) -> None:
        self.now, self.partners = now, partners
        self.o: MortarOperators = earlier.operators
        self.faces = earlier.fields.covered
        o = self.o
        self.per_weight = np.where(self.faces, 1.0 / np.where(self.faces, o.weight, 1.0), 0.0)
        counts = (partners.present == 0.0)[:, None]  # nodes with a distance at the earlier state
        self.gap_vectors = np.where(counts, partners.D @ o.x - partners.M @ o.m, 0.0)
        touches = earlier.touches[:, None]
        self.turned = np.where(touches, self.gap_vectors, 0.0)
        n, dn = evaluate_normals(o.master, o.m, "opposite")
        planes = np.isfinite(earlier.contact.master_planes)
        self.n = np.where(planes, earlier.contact.master_planes, n)
        self.dn = np.where(planes[:, :, None], 0.0, dn)
        self.t, y, meets = mean_tangents(o.n, -(partners.M @ self.n), self.gap_vectors)
        self.t = np.where(counts, np.where(touches, o.tau, self.t), 0.0)
        self.y = np.where(touches, 0.0, y)
        self.y_master = np.where(touches | ~meets[:, None], 0.0, y)

    def _by_D(self, j: Indices, k: Indices) -> Array:
        """d(slip of nodes ``j``)/dP[j, k]; shapes broadcast [length]."""
        there = np.einsum("...c,...c->...", self.now.tau[j], self.now.x[k])
        return there - np.einsum("...c,...c->...", self.t[j], self.o.x[k])

    def _by_M(self, j: Indices, l: Indices) -> Array:
        """d(slip of nodes ``j``)/dQ[j, l]; shapes broadcast [length]."""
        there = np.einsum("...c,...c->...", self.now.tau[j], self.now.m[l])
        before = np.einsum("...c,...c->...", self.t[j], self.o.m[l])
        by_normal = np.einsum("...c,...c->...", self.y_master[j], self.n[l])
        return before - there + by_normal

    def blocks(self) -> Iterator[Block]:
        """Blocks of the derivative of the slip: rows slave nodes, columns dofs of both sides."""
        yield from self._of_matrices()
        yield from self._of_positions()
        yield from self._of_tangents()
        yield from self._of_nearest()

    def _of_matrices(self) -> Iterator[Block]:
        """Terms with the changes of D, M and w at nodes with rows in them."""
        o, s, p = self.o, self.o.segments, self.partners
        if o.linearization.frozen:
            return
        scale = self.per_weight[s.slave]
        by_D = self._by_D(s.slave[:, :, None], s.slave[:, None, :])
        values = np.einsum("sjkq,sjk,sj->sjq", o.dD, by_D, scale)
        i, k = s.pairs[:, 0], s.pairs[:, 1]
        by_M = self._by_M(s.slave[i][:, :, None], s.master[i][:, None, :])
        of_M = np.einsum("pjlq,pjl,pj->pjq", o.dM, by_M, scale[i])
        now = np.einsum("jc,jc->j", self.now.tau, p.D @ self.now.x - p.M @ self.now.m)
        if p.present.any():
            now = now - p.present * np.einsum("jc,jc->j", self.now.tau, self.now.vectors)
        before = np.einsum("jc,jc->j", self.t, p.D @ o.x - p.M @ o.m)
        by_normal = np.einsum("jc,jc->j", self.y_master, p.M @ self.n)
        mean = (now - before + by_normal)[s.slave] * scale
        values -= mean[:, :, None] * o.dD.sum(axis=2)
        yield Block(s.slave, o.columns, values)
        yield Block(s.slave[i], o.columns[k], of_M)

    def _of_positions(self) -> Iterator[Block]:
        """Terms -t . (P dx' - Q dm')."""
        o, p = self.o, self.partners
        for surface, matrix, sign in ((o.slave, p.D, -1.0), (o.master, p.M, 1.0)):
            entries = matrix.tocoo()
            mine = share_of(np.arange(entries.nnz), o.slave.comm)
            j, k = entries.row[mine].astype(np.int64), entries.col[mine].astype(np.int64)
            values = sign * entries.data[mine, None] * self.t[j]
            yield Block(j[:, None], surface.dofs_of(k[:, None]), values[:, None])

    def _of_tangents(self) -> Iterator[Block]:
        """Terms -dt . (P x' - Q m') with the changes of the normals of both sides."""
        o = self.o
        change = -o.tangential_derivative(self.turned) - o.normal_derivative(self.y)
        yield rows_at_nodes(o.slave, o.normal_columns(), change)
        if not self.y_master.any():
            return
        entries = self.partners.M.tocoo()
        mine = share_of(np.arange(entries.nnz), o.slave.comm)
        j, l = entries.row[mine].astype(np.int64), entries.col[mine].astype(np.int64)
        values = np.einsum("bc,bcq->bq", entries.data[mine, None] * self.y_master[j], self.dn[l])
        columns = o.master.near_dofs[:, : self.dn.shape[2]]
        yield Block(j[:, None], columns[l], values[:, None])

    def _of_nearest(self) -> Iterator[Block]:
        """Terms with the motion along the nearest facet, at nodes without rows in M."""
        o = self.o
        j = np.flatnonzero(~self.faces)
        roles = o.slave.roles
        candidates = None if roles is None else roles.masters_of_nodes(o.slave.facets, j)
        ends, fraction = nearest_facets(o.x[j], o.m, o.master, candidates)
        mine = share_of(np.arange(j.size), o.slave.comm)
        j, (a, b), f = j[mine], ends[mine].T, fraction[mine, None]
        chord = o.m[b] - o.m[a]
        per_square = 1.0 / (chord**2).sum(axis=1)[:, None]
        by_x = chord * per_square
        by_b = (o.x[j] - o.m[a] - 2.0 * f * chord) * per_square
        scale = (self._by_M(j, b) - self._by_M(j, a))[:, None]
        for surface, nodes, change in (
            (o.slave, j, by_x),
            (o.master, a, -by_x - by_b),
            (o.master, b, by_b),
        ):
            yield Block(j[:, None], surface.dofs_of(nodes[:, None]), (scale * change)[:, None])


def mean_tangents(n: Array, opposite: Array, gap_vectors: Array) -> tuple[Array, Array, Flags]:
    """Mean tangents of both sides, and their derivative with respect to the normals (local).

    Args:
        n: Normals of the slave nodes, shape (slave nodes, 2).
        opposite: Reversed normals of the master opposite, shape (slave nodes, 2).
        gap_vectors: Distance vectors b, shape (slave nodes, 2) [length].

    Returns:
        Tangents t (slave nodes, 2), y with dt . b = y . d(n + opposite), and marks of the nodes
        where ``opposite`` is used; see ``slip``.
    """
    meets = np.einsum("jc,jc->j", n, opposite) > 0.0
    v = np.where(meets[:, None], n + opposite, n)
    size = np.linalg.norm(v, axis=1)[:, None]
    v = v / size
    turned = np.stack([gap_vectors[:, 1], -gap_vectors[:, 0]], axis=1)
    y = (turned - np.einsum("jc,jc->j", v, turned)[:, None] * v) / size
    return np.stack([-v[:, 1], v[:, 0]], axis=1), y, meets
