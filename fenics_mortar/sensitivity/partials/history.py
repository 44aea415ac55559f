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
For slip in space see below.

Derivative of the slip of a step in space with respect to the accepted state at its start.

With the notation of ``arcs``, primes for the previous state, P = D' / w' and Q = M' / w', the
slip of a node changes through

    dr   = [dD' x - dM' m - dw' r] / w'    at nodes with rows in D' and M',
    dr   = -dQ m,    dr_0 = P dx' - Q dm' - dQ m'    at others, with nearest points as partners,

and through the rotations of both materials, which depend on the previous positions x' and m' and,
at the partners, on Q. Where D' and M' are constant, with small sliding, dr_0 = P dx' - Q dm' is
left. On an obstacle r_0 leads from its pivot to the node in the previous state. Active set,
multiplier nodes, facets that face each other and nearest facets are fixed.

Derivatives of a law, in the rows of a contact and in its memory, by complex steps.

The residuals of the rows and the memory h_k = H(g, slip, z_n, z_tau; h_{k-1}, p) at the end of a
step depend on the mean gap, which the closing gap replaces as in ``Law.remember``, on slip and
multiplier, on the memory before and on the parameters p of the law. Parameters, numbers or arrays,
are listed in ``Law.parameters``; those that vary in space are represented by their values at the
slave nodes. The law is evaluated with a number p + i h d: the imaginary part over h is the
derivative along d, exact up to rounding. Functions such as ``abs`` are not analytic; a result that
contradicts difference quotients on both sides is therefore rejected. Branches are fixed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_array, eye

from fenics_mortar.contact.arcs import Material, Turned, quarter_turn, spokes_of
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import ELASTIC, ContactFields, SpaceFields
from fenics_mortar.contact.law import COMPLEX_STEP, Law, Nodal
from fenics_mortar.contact.slip import Partners, by_positions, rotation_derivative
from fenics_mortar.interface.facing import nearest_on_master
from fenics_mortar.interface.integrals import PlaneOperators, share_of
from fenics_mortar.interface.mortar import Block
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.obstacles.rigid_motion import inverse_jacobians
from fenics_mortar.sensitivity.partials.fields import (
    Changes,
    Layout,
    Matrix,
    by_node,
    interleaved,
    of_law,
    of_vectors,
    off_planes,
    rows_at_nodes,
    rows_by_fields,
    shear_vector_derivative,
    through_fields,
)
from fenics_mortar.utils.arrays import EPSILON, Array, Flags, Indices
from fenics_mortar.utils.errors import call_together, check_choice

if TYPE_CHECKING:
    from fenics_mortar.contact.space_partners import ObstaclePartners, SpacePartners
    from fenics_mortar.interface.space_mortar import SpaceOperators

AXES = np.eye(3)


def slip_by_earlier(contact: Contact, then: Any, layout: Layout) -> Matrix:
    """Derivative of the vectors of slip by the earlier state, (3 slave nodes, size) (collective).

    Args:
        contact: The contact, evaluated at the end of the step.
        then: Operators of the state that defines the partners.
        layout: Places of the values of the pair.
    """
    if not isinstance(then, ObstacleOperators):
        terms = _TermsInSpace(contact.now.operators, then, contact.partners)
        return layout.matrix(terms.blocks(), contact.z.size)
    parts = [layout.nodal(*_past_obstacle(contact, then, a)) for a in AXES]
    return interleaved(parts, len(then.x))


def _past_obstacle(
    contact: Contact, then: ObstacleOperators, axis: Array
) -> tuple[list[Block], None, Array]:
    """Blocks and derivative by motions of the component of the slip along an axis (local)."""
    now: Any = contact.operators
    partners: ObstaclePartners = contact.partners
    found, slave = partners.at(now), then.slave
    by_x = np.einsum("jab,a->jb", found.by_vector_then, axis)
    blocks = [rows_at_nodes(slave, slave.dofs, by_x)]
    if partners.mirrored is not None:
        by_spin = found.weights(np.tile(axis, (len(then.x), 1)))[1]
        blocks += by_positions_at_start(partners.materials(now)[0], found.slave, now.x, by_spin)
    # the rotation of the obstacle in the step begins at its earlier place
    spin = found.by_relative @ inverse_jacobians(-partners.turn(now)[None])
    by_turn = np.einsum("jab,a->jb", spin, axis) / now.arm
    return blocks, None, -np.hstack([by_x, by_turn])


def by_positions_at_start(
    material: Material, at: Turned, x: Array, along: Array
) -> Iterator[Block]:
    """Blocks of along_j . a_j by the positions at the start of a step, with the spins a (local).

    Args:
        material: The material.
        at: Its rotations.
        x: Present positions of the nodes, shape (nodes, 3) [length].
        along: Shape (n, 3).
    """
    surface, (j, l, k, size, kept) = material.surface, material.spokes
    values = at.by_products(along)[j] * kept
    values = size[:, None] * np.einsum("sa,sab->sb", x[k] - x[l], values)
    mine = share_of(np.arange(j.size), surface.comm)
    for nodes, sign in ((k, 1.0), (l, -1.0)):
        yield Block(j[mine, None], surface.dofs[nodes[mine]], sign * values[mine, None])


class _TermsInSpace:
    """Terms of the derivative of the slip between two surfaces (local).

    Args:
        now: Operators at the end of the step.
        then: Operators of the earlier state.
        partners: The partners.
    """

    def __init__(self, now: SpaceOperators, then: SpaceOperators, partners: SpacePartners) -> None:
        self.now, self.then, self.partners = now, then, partners
        self.found = found = partners.at(now)
        self.faces = partners.weight > 0.0
        distance = (partners.present == 0.0)[:, None, None]  # r_0 is zero at other nodes
        self.by_r = found.by_vector
        self.by_start = np.where(distance, -found.by_vector @ found.master.Q, 0.0)
        self.turns = partners.mirrored is not None
        along = [found.weights(np.tile(axis, (len(now.x), 1))) for axis in AXES]
        self.by_spins = [np.stack(each, axis=1) for each in list(zip(*along, strict=True))[1:]]
        if self.turns:
            by_spin = self.by_spins[1]
            products = [found.master.by_products(by_spin[:, a]) for a in range(3)]
            self.by_products = np.stack(products, axis=1)
            self.around = self._products_around()

    def _products_around(self) -> Array:
        """Sums of dx_a dx'_b over the nodes around master nodes, (master nodes, 3, 3)."""
        o, p = self.then, self.partners
        each = csr_array(eye(len(o.m)))
        assert p.mirrored is not None
        _, l, k, _, kept = spokes_of(each, o.master, p.mirrored[1])
        m, m_0 = self.now.m, p.m
        sums = np.zeros((len(m), 3, 3))
        np.add.at(sums, l, (m[k] - m[l])[:, :, None] * (m_0[k] - m_0[l])[:, None] * kept)
        return sums

    def _by_M(self, j: Indices, l: Indices, sign: Array) -> Array:
        """d(slip of nodes ``j``)/dQ[j, l]; shapes broadcast, the last axis is a vector's [length].

        ``sign`` is that of Q[j, l].
        """
        total = -np.einsum("...ab,...b->...a", self.by_r[j], self.now.m[l])
        total = total - np.einsum("...ab,...b->...a", self.by_start[j], self.then.m[l])
        if not self.turns:
            return total
        turned = np.einsum("...abc,...bc->...a", self.by_products[j], self.around[l])
        return total + sign[..., None] * turned

    def blocks(self) -> Iterator[Block]:
        """Blocks of the derivative of the slip: rows are components, columns dofs of both sides."""
        yield self._of_matrices()
        yield from of_nearest(self.then, self.faces, self._by_M)
        for a in range(3):
            for block in self._of_component(a):
                yield block._replace(rows=3 * block.rows + a)

    def _of_component(self, a: int) -> Iterator[Block]:
        """Terms of a component with P dx' - Q dm' in r_0, and with the rotations of materials."""
        found, p = self.found, self.partners
        yield from by_positions(self.then, p.entries, self.by_start[:, a])
        if not self.turns:
            return
        sides = zip(
            p.materials(self.now), (found.slave, found.master), (self.now.x, self.now.m),
            self.by_spins, strict=True,
        )  # fmt: skip
        for material, at, x, by_spin in sides:
            yield from by_positions_at_start(material, at, x, by_spin[:, a])

    def _of_matrices(self) -> Block:
        """Terms with the changes of D, M and w at nodes with rows in them.

        A common factor of a row of Q does not change the rotation.
        """
        o, nodes = self.then, self.then.facet_nodes
        on = self.faces[nodes]
        scale = np.where(on, 1.0 / np.where(on, o.weight[nodes], 1.0), 0.0)[:, :, None, None]
        by_r = self.by_r[nodes]
        mean = np.einsum("fjab,fjb->fja", by_r, self.found.vector[nodes])
        by_D = np.einsum("fjab,fkb->fjak", by_r, self.now.x[nodes]) - mean[..., None]
        j, l = np.broadcast_arrays(nodes[:, :, None], o.segments.merged[:, None])
        by_M = np.swapaxes(self._by_M(j, l, self._sign_of_M(j, l)), 2, 3)
        values = o.matrices_derivative(scale * by_D, scale * by_M)
        rows = 3 * nodes[:, :, None] + np.arange(3)
        shape = len(nodes), 3 * nodes.shape[1]
        return Block(rows.reshape(shape), o.columns, values.reshape(*shape, values.shape[3]))

    def _sign_of_M(self, j: Indices, l: Indices) -> Array:
        """Signs of the entries of Q, zero where there is none; shape of ``j`` and ``l`` [1]."""
        rows, columns, values = self.partners.entries[1]
        keys = rows * len(self.now.m) + columns
        order = np.argsort(keys)
        at = np.searchsorted(keys[order], j * len(self.now.m) + l)
        at = order[np.minimum(at, keys.size - 1)]
        return np.where((rows[at] == j) & (columns[at] == l), np.sign(values[at]), 0.0)


def of_nearest(o: Any, faces: Flags, by_M: Callable[..., Array]) -> Iterator[Block]:
    """Terms with the motion of the nearest points, at nodes without rows in M (local).

    Args:
        o: Operators of the earlier state.
        faces: Nodes with rows in M, shape (slave nodes,), bool.
        by_M: Function of nodes (t, 1), corners (t, c) and the signs of their weights (t, c), whose
            values are the derivatives of the r components of the slip by Q, shape (t, c, r).
    """
    j = np.flatnonzero(~faces)
    corners, weights = nearest_on_master(o, j)
    mine = share_of(np.arange(j.size), o.slave.comm)
    j, corners, weights = j[mine], corners[mine], weights[mine]
    by_Q = by_M(j[:, None], corners, np.sign(weights))
    by_x, by_m = weights_of_foot(o.x[j], o.m[corners], weights)
    rows = by_Q.shape[2] * j[:, None] + np.arange(by_Q.shape[2])
    yield Block(rows, o.slave.dofs[j], np.einsum("tcr,tcq->trq", by_Q, by_x))
    yield Block(rows, o.master.dofs_of(corners), np.einsum("tcr,tcq->trq", by_Q, by_m))


def weights_of_foot(x: Array, corners: Array, weights: Array) -> tuple[Array, Array]:
    """Derivatives of the weights of nearest points of triangles, in the plane of lines (local).

    The nearest point is in the triangle, on an edge or at a corner, and stays there.

    Args:
        x: The points, shape (t, dim) [length].
        corners: Corners of the triangles or lines, shape (t, dim, dim) [length].
        weights: Weights of the corners at the nearest points, shape (t, dim) [1]; of triangles zero
            off the edge.

    Returns:
        Derivatives by the points, (t, dim, dim), and by the corners, (t, dim, dim^2) [1 / length].
    """
    count, dim = x.shape
    by_x, by_corners = np.zeros((count, dim, dim)), np.zeros((count, dim, dim, dim))
    off = x - np.einsum("tc,tca->ta", weights, corners)
    for t in range(count):
        used = np.flatnonzero((weights[t] > 0.0) | (dim == 2))
        if used.size < 2:
            continue
        base, others = used[0], used[1:]
        T = corners[t, others] - corners[t, base]
        inverse = np.linalg.inv(T @ T.T)
        change = np.zeros((others.size, dim, dim))  # of T (x - foot) by the corners
        for i, other in enumerate(others):
            change[i, other] += off[t]
            change[i, base] -= off[t]
        change -= T[:, None] * weights[t][:, None]
        of_others = inverse @ T, np.einsum("ik,kca->ica", inverse, change)
        for total, part in zip((by_x, by_corners), of_others, strict=True):
            total[t, others] = part
            total[t, base] = -part.sum(axis=0)
    return by_x, by_corners.reshape(count, dim, dim * dim)


@dataclass(frozen=True)
class PairHistory:
    """Derivatives of a contact at the end of a step with respect to an earlier state (local).

    Attributes:
        fields: Derivatives of the slip of the step, in space also of the shear in its direction,
            shape (slave nodes, size of the vector) each.
        rows: Derivative of the rows, through slip and the initial shear of redundant sticks, shape
            (d slave nodes, size of the vector).
    """

    fields: Changes
    rows: Matrix


def history_of_pair(contact: Contact, then: ContactFields) -> PairHistory:
    """Derivatives of a contact, evaluated at the end of the step (collective).

    Args:
        contact: The contact.
        then: Nodal fields of the earlier state, with operators that have all derivatives.
    """
    layout, f = Layout(contact), contact.now
    redundant = f.state.redundant.any()
    keeps_shear = np.where(f.state.redundant & then.state.active, 1.0 / ELASTIC, 0.0)
    by = rows_by_fields(contact)
    if isinstance(f, SpaceFields) and isinstance(then, SpaceFields):
        changes = {"slip_vector": slip_by_earlier(contact, then.operators, layout)}
        fields = {name: through_fields(each, changes) for name, each in of_vectors(f).items()}
        if redundant:
            weighted = zip(contact.rows.frame()[2:4], f.row_tangents, strict=True)
            dyads = sum(weight[:, :, None] * along[:, None] for weight, along in weighted)
            by["shear"] = dyads * keeps_shear[:, None, None]
            changes["shear"] = shear_vector_derivative(then, layout)
        return PairHistory(fields, through_fields(by, changes))
    changes = {"slip": off_planes(_slip_derivative(contact, then, layout), contact)}
    fields = dict(changes)
    if redundant:
        by["shear"] = contact.rows.frame()[2] * keeps_shear[:, None]
        changes["shear"] = of_law(then, layout, "z_tau")
    return PairHistory(fields, through_fields(by, changes))


def _slip_derivative(contact: Contact, then: ContactFields, layout: Layout) -> Matrix:
    """Derivative of the present slip with respect to the earlier state (collective).

    On an obstacle b' is the vector from the pivot to the node, and psi' the angle of the slave's
    material.
    """
    o, partners = then.operators, contact.partners
    if not isinstance(o, ObstacleOperators):
        return layout.nodal(_Terms(contact.operators, then, partners).blocks())
    found = partners.at(contact.operators).arc
    blocks = [rows_at_nodes(o.slave, o.slave.dofs, found.by_start)]
    if partners.planes is not None:
        blocks.append(rotation_derivative(o, -found.by_body))
    by_motion = -np.column_stack([found.by_start, found.by_rotation / o.arm])
    return layout.nodal(blocks, by_motion=by_motion)


class _Terms:
    """Terms of the derivative of the slip between two surfaces (local).

    Args:
        now: Operators at the end of the step.
        then: Fields of the state that defines the partners.
        partners: The partners.
    """

    def __init__(self, now: PlaneOperators, then: ContactFields, partners: Partners) -> None:
        self.now, self.partners = now, partners
        self.o: PlaneOperators = then.operators
        self.faces = then.covered
        o, (present, _, found) = self.o, partners.at(now)
        self.per_weight = then.per_weight
        counts = partners.present == 0.0  # nodes with a distance at the earlier state
        self.e, self.start = found.by_vector, np.where(counts[:, None], found.by_start, 0.0)
        self.turned = np.where(counts, found.by_start_normal, 0.0)[:, None] * quarter_turn(o.n)
        self.by_angle = found.by_angle
        self.angles = present, partners.at(o).orientation

    def _by_M(self, j: Indices, l: Indices) -> Array:
        """d(slip of nodes ``j``)/dQ[j, l]; shapes broadcast [length]."""
        total = -_dot(self.e[j], self.now.m[l]) - _dot(self.start[j], self.o.m[l])
        for at, sign in zip(self.angles, (1.0, -1.0), strict=True):
            if at is not None:
                by_partners = (sign * self.by_angle)[:, None] * at.by_partners
                total = total + _dot(by_partners[j], at.master[l])
        return total

    def blocks(self) -> Iterator[Block]:
        """Blocks of the derivative of the slip: rows slave nodes, columns dofs of both sides."""
        yield from self._of_matrices()
        yield from by_positions(self.o, self.partners.entries, self.start)
        yield from self._of_normals()
        yield from of_nearest(self.o, self.faces, lambda j, l, _: self._by_M(j, l)[..., None])

    def _of_matrices(self) -> Iterator[Block]:
        """Terms with the changes of D, M and w at nodes with rows in them.

        A common factor of a row of Q does not change the angle.
        """
        o, s, p = self.o, self.o.segments, self.partners
        if o.linearization.frozen:
            return
        scale = self.per_weight[s.slave]
        j, k = s.slave[:, :, None], s.slave[:, None, :]
        by_D = _dot(self.e[j], self.now.x[k]) + _dot(self.start[j], o.x[k])
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


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...c,...c->...", a, b)


# Steps of difference quotients, relative to the parameter [1]: errors of the quotients are of the
# order of the step. The shorter steps are for nodes near a kink, and for parameters that are zero
# at all nodes. The square root of the largest one is the largest relative difference from the
# complex step.
QUOTIENTS = (1e-6, 1e-9, 1e-12)
# Arguments of laws that are converted to complex numbers, so that arrays created like them are
# complex.
NUMBERS = ("gap", "slip", "z_n", "z_tau", "stiffness", "c_n")

# Law and arguments changed by a number or array, from its value.
At = Callable[[Any], tuple[Law, Mapping[str, Any]]]
# Change of n values of each node, shape (slave nodes, n), along a direction of a named value.
Response = Callable[[Contact, str, Array, Array, At], Array]


def parameter(contact: Contact, name: str) -> Array:
    """Value of a parameter of the law, any shape [its unit] (local).

    Shape (slave nodes,) if it varies in space.

    Raises:
        ValueError: If the law has no such parameter.
    """
    law = contact.pair.law
    check_choice(f"parameter of {law!r}", name, law.parameters)
    if name in law.varying:
        return contact.parameters[name].copy()
    return np.asarray(getattr(law, name), float)


def by_parameter(contact: Contact, name: str, response: Response) -> Matrix:
    """Derivative of rows or memory with respect to a parameter of the law (collective).

    Args:
        contact: The contact, evaluated.
        name: Name of the parameter.
        response: ``change_of_rows`` or ``change_of_memory``.

    Returns:
        Shape (d slave nodes or number of names in memory * slave nodes, numbers of the parameter).

    Raises:
        ValueError: On all ranks, if the law has no such parameter, or cannot be differentiated.
    """
    law, value = contact.pair.law, parameter(contact, name)

    def at(changed: Any) -> tuple[Law, Mapping[str, Any]]:
        if name in law.varying:
            return law, {"fields": {**contact.parameters, name: changed}}
        other = copy(law)
        setattr(other, name, changed if np.ndim(changed) else np.asarray(changed).item())
        return other, {}

    if name in law.varying:  # a node depends only on its own value
        return by_node(response(contact, name, value, np.ones_like(value), at)[:, :, None])
    units = np.eye(value.size).reshape(value.size, *value.shape)
    columns = [response(contact, name, value, unit, at).ravel() for unit in units]
    return np.column_stack(columns)


@dataclass(frozen=True)
class PairMemory:
    """Derivatives of the memory of a law at the end of a step, and with respect to that before.

    Local. The memory has c names.

    Attributes:
        by_fields: Derivatives with respect to the fields of ``fields``, (slave nodes, c) each.
        by_before: With respect to the memory before, shape (slave nodes c, slave nodes c).
        rows: Of the rows with respect to the memory before, shape (d slave nodes, slave nodes c).
    """

    by_fields: dict[str, Array]
    by_before: Matrix
    rows: Matrix


def memory_of_pair(contact: Contact) -> PairMemory:
    """Derivatives of the memory of a contact, evaluated at the end of the step (collective).

    Raises:
        ValueError: On all ranks, if the law cannot be differentiated.
    """
    law, f = contact.pair.law, contact.now
    given = replace(f.nodal, gap=f.mean_gap)

    def by(response: Response, name: str, value: Array, at: At) -> Array:
        return response(contact, name, value, np.ones_like(value), at)

    def by_argument(name: str) -> Array:
        return by(
            change_of_memory, name, getattr(given, name), lambda changed: (law, {name: changed})
        )

    def at_memory(name: str, changed: Any) -> tuple[Law, Mapping[str, Any]]:
        return law, {"memory": {**given.memory, name: changed}}

    def by_own(response: Response) -> Matrix:
        before = [(name, np.asarray(given.memory[name])) for name in law.memory]
        parts = [by(response, name, value, partial(at_memory, name)) for name, value in before]
        return by_node(np.stack(parts, axis=2))

    by_fields = {name: by_argument(name) for name in ("gap", "slip", "z_n", "z_tau")}
    by_mean_gap = by_fields["gap"] + by_fields["slip"] * f.slip_by_gap[:, None]
    gap = by_mean_gap * f.per_weight[:, None]
    by_fields |= {"gap": gap, "weight": -gap * f.mean_gap[:, None]}
    return PairMemory(by_fields, by_own(change_of_memory), by_own(change_of_rows))


def change_of_rows(contact: Contact, name: str, value: Array, direction: Array, at: At) -> Array:
    """Change of the rows along a direction of a value, (slave nodes, d) [stress length].

    Collective.
    """
    law, f = contact.pair.law, contact.now
    stress, gap = np.abs(f.state.z).max(initial=0.0), np.abs(f.mean_gap).max(initial=0.0)
    what = f"{law!r}: the complex step by '{name}'"
    changes = call_together(
        contact.slave.comm,
        f"the derivative of {law!r} by '{name}'",
        lambda: differentiate(
            what, value, direction, lambda changed: _residuals(f, *at(changed)),
            (stress, stress, gap),
        ),
    )  # fmt: skip
    follows_law = contact.follows_law & (law.bridges_gap | ~f.attracted)
    applies = follows_law & ~f.state.redundant, f.attracted, f.covered
    total, (_, _, along, *weights) = np.zeros_like(f.state.z), contact.rows.frame()
    if contact.slave.dim == 3:  # the row across the law's direction is that of no law
        del weights[0]
    for scaled, change, on in zip((along, *weights), changes, applies, strict=False):
        total -= scaled * np.where(on, change, 0.0)[:, None]
    return total


def change_of_memory(contact: Contact, name: str, value: Array, direction: Array, at: At) -> Array:
    """Change of the memory along a direction of a value, (slave nodes, names) [their units].

    Collective.
    """
    law, f = contact.pair.law, contact.now

    def remembered(changed: Any) -> Array:
        other, changes = at(changed)
        result = other.remember(_complex(f, other, changes), f.state.branch)
        return np.array([np.asarray(result[name], complex) for name in law.memory])

    what = f"{law!r}: the complex step of remember by '{name}'"
    made = call_together(
        contact.slave.comm,
        f"the derivative of {law!r} by the state",
        lambda: differentiate(what, value, direction, remembered),
    )
    return np.asarray(made).T


def _complex(f: ContactFields, law: Law, changes: Mapping[str, Any]) -> Nodal:
    """Changed complex arguments of a law, with its closing gap in place of the gap (local)."""
    given = replace(f.nodal, gap=f.mean_gap)
    numbers = {name: getattr(given, name).astype(complex) for name in NUMBERS}
    node = replace(given, **{**numbers, **changes})
    if not law.has_closing_gap:
        return node
    return replace(node, gap=np.where(f.covered, law.closing_gap(node).residual, node.gap))


def _residuals(f: ContactFields, law: Law, changes: Mapping[str, Any]) -> Array:
    """Tangential residual, adhesion and closing gap, complex, (3, slave nodes) (local)."""
    node = _complex(f, law, changes)
    found = np.zeros((3, len(f.state.z)), complex)
    if law.has_friction:
        found[0] = law.tangential(node, f.state.branch).residual
    if law.has_adhesion:
        opened = replace(node, gap=np.maximum(node.gap, 0.0))
        found[1] = law.adhesion_at(opened).residual + f.adhesion[1] * np.minimum(node.gap, 0.0)
    found[2] = node.gap
    return found


def differentiate(
    what: str, value: Array, direction: Array, function: Callable[[Any], Array], terms: Any = 0.0
) -> Array:
    """Derivative by complex step, compared with difference quotients (local).

    Units are those of the result [any]. ``terms``: size of the terms whose sums are the rows of the
    result, for their rounding, shape (rows,).

    Raises:
        ValueError: If they contradict each other; ``what`` describes the derivative.
    """
    start = np.real(function(value))
    if not direction.any():
        return np.zeros_like(start)
    derivative = np.imag(function(value + 1j * COMPLEX_STEP * direction)) / COMPLEX_STEP
    if not np.isfinite(value).all():  # an infinite limit is not reached
        return derivative
    size = np.abs(value).max(initial=0.0) or 1.0
    contradicts = np.ones_like(start, bool)
    for quotient in QUOTIENTS:
        step = quotient * size / np.abs(direction).max()
        rounding = 10.0 * EPSILON * np.maximum(np.abs(start).max(axis=1), terms) / step
        allowed = np.sqrt(QUOTIENTS[0]) * np.abs(derivative).max(axis=1) + rounding
        for sign in (step, -step):
            moved = np.real(function(value + sign * direction))
            contradicts &= np.abs((moved - start) / sign - derivative) > allowed[:, None]
        if not contradicts.any():
            break
    if contradicts.any():
        raise ValueError(
            f"{what} contradicts difference quotients; expected the law to be analytic in the "
            "parameter, without abs, real parts or conversions to float"
        )
    return derivative
