# SPDX-License-Identifier: MIT
"""Derivative of a step's rows with respect to the accepted state at the start of the step.

The rows depend on the previous state through the partners of the slave nodes, see ``slip``: the
matrices D / w and M / w of that state, its vectors b'_j, normals and angles, and for redundant
sticks its shear. With the present positions x and m, the previous
ones x' and m', P = D / w, Q = M / w, and the derivatives e_j, e'_j, c'_j and U_j of ``Arc`` with
respect to b_j, b'_j, a rotation of n'_j and theta_j, the slip of node j changes with the previous
state by

    du_j = dP_jk (e_j . x_k + e'_j . x'_k) - dQ_jl (e_j . m_l + e'_j . m'_l) - ds_j e_j . v_j
         + e'_j . (P dx' - Q dm')_j + c'_j dpsi'_j + U_j (dchi_j - dchi'_j),

v = D x - M m. psi' is the angle of n', and chi that between the materials of both surfaces, which
depends on Q and on the normals of the surfaces. For the measure "operators", s = 1 / w, and b'
vanishes at any state. Active set, multiplier nodes and the facets that face each other are fixed.
For slip in space see ``space_history``.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_mortar.contact.arcs import quarter_turn
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import ELASTIC, ContactFields
from fenics_mortar.contact.slip import Partners, rotation_derivative
from fenics_mortar.contact.space_fields import SpaceFields
from fenics_mortar.contact.state import InterfaceState
from fenics_mortar.interface.facing import nearest_facets
from fenics_mortar.interface.integrals import share_of
from fenics_mortar.interface.mortar import EXACT, Block
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.interface.plane_mortar import PlaneOperators
from fenics_mortar.sensitivity.partials.fields import (
    of_vectors,
    off_planes,
    rows_by_fields,
    shear_derivative,
    shear_vector_derivative,
)
from fenics_mortar.sensitivity.partials.maps import (
    Changes,
    Layout,
    Matrix,
    rows_at_nodes,
    through_fields,
)
from fenics_mortar.sensitivity.partials.space_history import slip_by_earlier
from fenics_mortar.utils.arrays import Array, Indices


class Earlier:
    """An earlier accepted state of a contact, and its operators with all derivatives.

    The constructor is collective; the state of the contact and of its obstacle is not changed.

    Args:
        contact: The contact.
        u: Displacement of that state, shape (local dofs,) [length].
        state: State of the contact.
        place: Place of the obstacle, if there is one, shape (m,).

    Attributes:
        fields: Nodal fields of that state.
        place: The argument.
    """

    def __init__(
        self, contact: Contact, u: Array, state: InterfaceState, place: Array | None = None
    ) -> None:
        self.contact, self.place = contact, place
        with self.at_earlier_position():  # a copy: the contact itself is unchanged
            operators, _ = copy(contact.evaluation).evaluate(u, state, EXACT)
            if state.offset.any():
                operators = operators.minus_offset(state.offset)
            self.fields: ContactFields = type(contact.now)(contact, state, operators)

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


@dataclass(frozen=True)
class PairHistory:
    """Derivatives of a contact at the end of a step with respect to an earlier state (local).

    Attributes:
        fields: Derivatives of the slip of the step, in space also of the shear in its direction,
            shape (slave nodes, size of the vector) each.
        rows: Derivative of the rows, through slip and the initial shear of redundant sticks, shape
            (d slave nodes, size of the vector).
        earlier: The state.
    """

    fields: Changes
    rows: Matrix
    earlier: Earlier


def history_of_pair(contact: Contact, earlier: Earlier) -> PairHistory:
    """Derivatives of a contact, evaluated at the end of the step (collective).

    Args:
        contact: The contact.
        earlier: The state that defines the partners.
    """
    layout, f, then = Layout(contact), contact.now, earlier.fields
    redundant = f.state.redundant.any()
    keeps_shear = np.where(f.state.redundant & then.state.active, 1.0 / ELASTIC, 0.0)
    by = rows_by_fields(contact)
    if isinstance(f, SpaceFields) and isinstance(then, SpaceFields):
        changes = {"slip_vector": slip_by_earlier(contact, earlier, layout)}
        fields = {name: through_fields(each, changes) for name, each in of_vectors(f).items()}
        if redundant:
            weighted = zip(contact.rows.frame()[2:4], f.row_tangents, strict=True)
            dyads = sum(weight[:, :, None] * along[:, None] for weight, along in weighted)
            by["shear"] = dyads * keeps_shear[:, None, None]
            changes["shear"] = shear_vector_derivative(then, layout)
        return PairHistory(fields, through_fields(by, changes), earlier)
    changes = {"slip": off_planes(_slip_derivative(contact, earlier, layout), contact)}
    fields = dict(changes)
    if redundant:
        by["shear"] = contact.rows.frame()[2] * keeps_shear[:, None]
        changes["shear"] = shear_derivative(then.operators, then.state.z, layout)
    return PairHistory(fields, through_fields(by, changes), earlier)


def _slip_derivative(contact: Contact, earlier: Earlier, layout: Layout) -> Matrix:
    """Derivative of the present slip with respect to the earlier state (collective)."""
    if isinstance(contact.operators, ObstacleOperators):
        blocks, by_motion = _on_obstacle(contact, earlier)
        return layout.nodal(blocks, by_motion=by_motion)
    return layout.nodal(_Terms(contact.operators, earlier, contact.partners).blocks())


def _on_obstacle(contact: Contact, earlier: Earlier) -> tuple[list[Block], Array]:
    """Blocks and derivative with respect to motions of the slip along an obstacle (local).

    b' is the vector from the pivot to the node, and psi' the angle of the slave's material.
    """
    o, partners = earlier.operators, contact.partners
    found = partners.arc(contact.operators)
    blocks = [rows_at_nodes(o.slave, o.slave.dofs, found.by_start)]
    if partners.planes is not None:
        blocks.append(rotation_derivative(o, -found.by_body))
    return blocks, -np.column_stack([found.by_start, found.by_rotation / o.arm])


class _Terms:
    """Terms of the derivative of the slip between two surfaces (local).

    Args:
        now: Operators at the end of the step.
        earlier: State that defines the partners.
        partners: The partners.
    """

    def __init__(self, now: PlaneOperators, earlier: Earlier, partners: Partners) -> None:
        self.now, self.partners = now, partners
        self.o: PlaneOperators = earlier.operators
        self.faces = earlier.fields.covered
        o, (then, _, found) = self.o, partners.at(now)
        self.per_weight = np.where(self.faces, 1.0 / np.where(self.faces, o.weight, 1.0), 0.0)
        counts = partners.present == 0.0  # nodes with a distance at the earlier state
        self.e, self.start = found.by_vector, np.where(counts[:, None], found.by_start, 0.0)
        self.turned = np.where(counts, found.by_start_normal, 0.0)[:, None] * quarter_turn(o.n)
        self.by_angle = found.by_angle
        self.angles = then, partners.at(o).orientation

    def _by_D(self, j: Indices, k: Indices) -> Array:
        """d(slip of nodes ``j``)/dP[j, k]; shapes broadcast [length]."""
        there = np.einsum("...c,...c->...", self.e[j], self.now.x[k])
        return there + np.einsum("...c,...c->...", self.start[j], self.o.x[k])

    def _by_M(self, j: Indices, l: Indices) -> Array:
        """d(slip of nodes ``j``)/dQ[j, l]; shapes broadcast [length]."""
        there = np.einsum("...c,...c->...", self.e[j], self.now.m[l])
        before = np.einsum("...c,...c->...", self.start[j], self.o.m[l])
        total = -there - before
        for at, sign in zip(self.angles, (1.0, -1.0), strict=True):
            if at is not None:
                by_partners = (sign * self.by_angle)[:, None] * at.by_partners
                total = total + np.einsum("...c,...c->...", by_partners[j], at.master[l])
        return total

    def blocks(self) -> Iterator[Block]:
        """Blocks of the derivative of the slip: rows slave nodes, columns dofs of both sides."""
        yield from self._of_matrices()
        yield from self.partners.by_positions(self.o, self.start)
        yield from self._of_normals()
        yield from self._of_nearest()

    def _of_matrices(self) -> Iterator[Block]:
        """Terms with the changes of D, M and w at nodes with rows in them.

        A common factor of a row of Q does not change the angle.
        """
        o, s, p = self.o, self.o.segments, self.partners
        if o.linearization.frozen:
            return
        scale = self.per_weight[s.slave]
        by_D = self._by_D(s.slave[:, :, None], s.slave[:, None, :])
        values = np.einsum("sjkq,sjk,sj->sjq", o.dD, by_D, scale)
        i, k = s.pairs[:, 0], s.pairs[:, 1]
        by_M = self._by_M(s.slave[i][:, :, None], s.master[i][:, None, :])
        of_M = np.einsum("pjlq,pjl,pj->pjq", o.dM, by_M, scale[i])
        now = np.einsum("jc,jc->j", self.e, p.D @ self.now.x - p.M @ self.now.m)
        if p.present.any():
            now = now - p.present * np.einsum("jc,jc->j", self.e, self.now.vectors)
        before = np.einsum("jc,jc->j", self.start, p.D @ o.x - p.M @ o.m)
        mean = (now + before)[s.slave] * scale
        values -= mean[:, :, None] * o.dD.sum(axis=2)
        yield Block(s.slave, o.columns, values)
        yield Block(s.slave[i], o.columns[k], of_M)

    def _of_normals(self) -> Iterator[Block]:
        """Terms with the changes of the normals of contact and of both surfaces."""
        o, before = self.o, self.angles[1]
        yield rows_at_nodes(o.slave, o.normal_columns(), o.normal_derivative(self.turned))
        if before is not None:
            yield from self.partners.by_angle(o, before, -self.by_angle)

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
