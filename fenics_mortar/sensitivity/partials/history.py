# SPDX-License-Identifier: MIT
"""Derivatives of the rows and memory of a pair by the state before the step, and by its law.

``history_of_pair`` has the derivatives by the accepted state at the start of the step, through the
slip, see ``slip_by_earlier``. ``by_parameter`` and ``memory_of_pair`` have those by parameters of
the law and by its memory. The residuals of the rows and the memory
h_k = H(g, slip, z_n, z_tau; h_{k-1}, p) at the end of a step depend on the mean gap, which the
closing gap replaces as in ``Law.remember``, on slip and multiplier, on the memory before and on the
parameters p of the law.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_array, eye

from fenics_mortar.contact.arcs import Material, Screw, quarter_turn, times
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import ELASTIC, ContactFields
from fenics_mortar.contact.law import COMPLEX_STEP, Law, Nodal
from fenics_mortar.contact.slip import by_positions, rotation_derivative
from fenics_mortar.contact.space_fields import SpaceFields
from fenics_mortar.interface.facing import nearest_on_master
from fenics_mortar.interface.integrals import evaluate_normals, share_of
from fenics_mortar.interface.mortar import Block
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.obstacles.rigid_motion import inverse_jacobians
from fenics_mortar.sensitivity.partials import fields
from fenics_mortar.utils.arrays import EPSILON, Array, Indices
from fenics_mortar.utils.errors import call_together, check_choice

if TYPE_CHECKING:
    from fenics_mortar.sensitivity.partials.fields import Changes, Matrix


def slip_by_earlier(
    contact: Contact, then: ContactFields, layout: fields.Layout, carried: Array | None = None
) -> Matrix:
    """Derivative of the slip of the step by the earlier state, (r slave nodes, size) (collective).

    In the plane of r = 1 number, in space of vectors, r = 3.

    **In the plane.** The rows depend on the previous state through the partners of the slave nodes,
    see ``slip``: the matrices D / w and M / w of that state, its vectors b'_j, normals and angles,
    and for redundant sticks its shear. With the present positions x and m, the previous ones x' and
    m', P = D / w, Q = M / w, and the derivatives e_j, e'_j, c'_j and U_j of ``Arc`` with respect to
    b_j, b'_j, a rotation of n'_j and theta_j, the slip of node j changes with the previous state by

        du_j = dP_jk (e_j . x_k + e'_j . x'_k) - dQ_jl (e_j . m_l + e'_j . m'_l) - ds_j e_j . v_j
             + e'_j . (P dx' - Q dm')_j + c'_j dpsi'_j + U_j (dchi_j - dchi'_j),

    v = D x - M m. psi' is the angle of n', and chi that between the materials of both surfaces,
    which depends on Q and on the normals of the surfaces. For the measure "operators", s = 1 / w,
    and b' vanishes at any state. Active set, multiplier nodes and the facets that face each other
    are fixed.

    **In space.** With the notation of ``arcs``, primes for the previous state, P = D' / w' and
    Q = M' / w', the slip of a node changes through

        dr   = [dD' x - dM' m - dw' r] / w'    at nodes with rows in D' and M',
        dr   = -dQ m,    dr_0 = P dx' - Q dm' - dQ m'    at others, with nearest points as partners,

    and through the rotations of both materials, which depend on the previous positions x' and m'
    and, at the partners, on Q. Where D' and M' are constant, with small sliding,
    dr_0 = P dx' - Q dm' is left. On an obstacle r_0 leads from its pivot to the node in the
    previous state. Active set, multiplier nodes, facets that face each other and nearest facets are
    fixed.

    Args:
        contact: The contact, evaluated at the end of the step.
        then: Fields of the state that defines the partners.
        layout: Places of the values of the pair.
        carried: In space the summed slip of former steps, which turns with the slave and is added,
            shape (slave nodes, 3) [length].
    """
    terms: Any = (_TermsInPlane if layout.dim == 2 else _TermsInSpace)(contact, then)
    if carried is not None:
        terms.by_spins[0] += np.cross(carried[:, None], np.eye(3))
    count, by_motion = terms.by_start[:, :, 0].size, None
    if terms.on_obstacle:
        by_motion = -np.concatenate([terms.by_start, terms.by_turn() / then.operators.arm], axis=2)
        by_motion = by_motion.reshape(count, layout.num_motions)
    return layout.matrix(terms.blocks(), count, by_motion=by_motion)


class _Terms(ABC):
    """Terms of the derivative of the slip by both surfaces, r numbers at a node (local).

    On an obstacle b' is the vector from the pivot to the node, and the partner has no nodes.

    Args:
        contact: The contact at the end of the step.
        then: Fields of the state that defines the partners.
        by_vectors: Derivatives of the slip by the vectors b now and then, (slave nodes, r, dim)
            each [1].
    """

    def __init__(
        self, contact: Contact, then: ContactFields, by_vectors: tuple[Array, Array]
    ) -> None:
        self.now, self.fields, self.then = contact.operators, then, then.operators
        self.on_obstacle = isinstance(self.then, ObstacleOperators)
        self.partners = p = contact.partners
        self.counts = p.present == 0.0  # nodes with a distance at the earlier state
        self.by_r = by_vectors[0]
        self.by_start = np.where(self.counts[:, None, None], by_vectors[1], 0.0)
        self.mean = self._along(slice(None), p.vectors(self.now), p.start)

    def blocks(self) -> Iterator[Block]:
        """Blocks of the derivative of the slip: rows are its numbers, columns dofs."""
        o, parts = self.then, self.by_r.shape[1]
        if not self.on_obstacle:
            yield from o.matrices_derivative(self._by_D, self._by_M)
            yield from self._of_nearest()
        for a in range(parts):
            of_positions = by_positions(o, (self.partners.D, self.partners.M), self.by_start[:, a])
            for block in chain(of_positions, self._of_turns(a)):
                yield block._replace(rows=parts * block.rows + a)

    def _along(self, j: Any, now: Array, then: Array) -> Array:
        """Changes of the slip of nodes ``j`` by vectors now and then, (..., dim) each."""
        return times(self.by_r[j], now) + times(self.by_start[j], then)

    def _by_D(self, j: Indices, k: Indices) -> Array:
        """d(slip of nodes ``j``)/dD[j, k] of nodes with rows in D; shapes broadcast."""
        change = self._along(j, self.now.x[k], self.then.x[k]) - self.mean[j]
        return change * self.fields.per_weight[j][..., None]

    def _by_M(self, j: Indices, l: Indices) -> Array:
        """d(slip of nodes ``j``)/dM[j, l], likewise."""
        return self._by_Q(j, l) * self.fields.per_weight[j][..., None]

    def _by_Q(self, j: Indices, l: Indices) -> Array:
        """d(slip of nodes ``j``)/dQ[j, l]; shapes broadcast, the last axis is r [length].

        A common factor of a row of Q does not change rotations.
        """
        return self._by_turns(j, l) - self._along(j, self.now.m[l], self.then.m[l])

    def _of_nearest(self) -> Iterator[Block]:
        """Terms with the motion of the nearest points, at nodes without rows in M."""
        o, j = self.then, np.flatnonzero(~self.fields.covered)
        corners, weights = nearest_on_master(o, j)
        mine = share_of(np.arange(j.size), o.slave.comm)
        j, corners, weights = j[mine], corners[mine], weights[mine]
        by_Q = self._by_Q(j[:, None], corners)
        by_x, by_m = weights_of_foot(o.x[j], o.m[corners], weights)
        rows = by_Q.shape[2] * j[:, None] + np.arange(by_Q.shape[2])
        yield Block(rows, o.slave.dofs[j], np.einsum("tcr,tcq->trq", by_Q, by_x))
        yield Block(rows, o.master.dofs_of(corners), np.einsum("tcr,tcq->trq", by_Q, by_m))

    @abstractmethod
    def by_turn(self) -> Array:
        """Derivative by the turn of the obstacle, (slave nodes, r, 1 or 3) [length]."""

    @abstractmethod
    def _by_turns(self, j: Indices, l: Indices) -> Array | float:
        """Part of ``_by_Q`` through the rotations of the master's material."""

    @abstractmethod
    def _of_turns(self, a: int) -> Iterator[Block]:
        """Blocks of component ``a`` through rotations of normals and materials then."""


class _TermsInPlane(_Terms):
    def __init__(self, contact: Contact, then: ContactFields) -> None:
        self.orientation, _, self.found = contact.partners.at(contact.operators)
        by_vectors = self.found.by_vector[:, None], self.found.by_start[:, None]
        super().__init__(contact, then, by_vectors)
        if self.orientation is not None:
            self.before = self.partners.at(self.then).orientation

    def by_turn(self) -> Array:
        """Derivative by the angle of the obstacle, (slave nodes, 1, 1) [length]."""
        return self.found.by_rotation[:, None, None]

    def _by_turns(self, j: Indices, l: Indices) -> Array | float:
        if self.orientation is None:
            return 0.0
        now, then = (
            np.einsum("...c,...c->...", at.by_partners[j], at.master[l])
            for at in (self.orientation, self.before)
        )
        return (self.found.by_angle[j] * (now - then))[..., None]

    def _of_turns(self, a: int) -> Iterator[Block]:
        o, found = self.then, self.found
        if self.on_obstacle:
            if self.partners.planes is not None:
                normals = evaluate_normals(o.slave, o.x, "opposite")
                yield rotation_derivative(o, normals, -found.by_body)
            return
        by_normal = np.where(self.counts, found.by_start_normal, 0.0)
        change = o.normal_derivative(by_normal[:, None] * quarter_turn(o.n))
        yield fields.rows_at_nodes(o.slave, o.normal_columns(), change)
        if self.orientation is not None:
            yield from self.partners.by_angle(o, self.before, -found.by_angle)


class _TermsInSpace(_Terms):
    def __init__(self, contact: Contact, then: ContactFields) -> None:
        self.found = found = contact.partners.at(contact.operators)
        on_surface = isinstance(found, Screw)
        by_start = -found.by_vector @ found.master.Q if on_surface else found.by_vector_then
        super().__init__(contact, then, (found.by_vector, by_start))
        self.turned = (found.slave, found.master) if on_surface else (found.slave,)
        p, o, along = self.partners, self.now, np.eye(3)[:, None] + 0.0 * self.now.x
        _, *by_spins = zip(*map(found.weights, along), strict=True)
        self.by_spins = [np.stack(each, axis=1) for each in by_spins]
        sides = zip(p.materials(o), (o.x, o.m))
        self.materials = [material.starting_at(x) for material, x in sides]
        if on_surface and p.planes is not None:
            of_components = [found.master.by_products(self.by_spins[1][:, a]) for a in range(3)]
            self.by_products = np.stack(of_components, axis=1)
            each = csr_array(eye(len(p.m)))
            self.around = Material(each, self.then.master, p.m, p.planes[1]).products(o.m)

    def by_turn(self) -> Array:
        """Derivative by spins at its earlier place, where the rotation begins [length]."""
        turn = self.now.obstacle.turn_since(self.partners.place)
        return self.found.by_relative @ inverse_jacobians(-turn[None])

    def _by_turns(self, j: Indices, l: Indices) -> Array | float:
        if self.partners.planes is None:
            return 0.0
        turned = np.einsum("...abc,...bc->...a", self.by_products[j], self.around[l])
        rows, columns = (each.flatten()[:, None] for each in np.broadcast_arrays(j, l))
        signs = self.partners.M.sign()[rows, columns].toarray()
        return signs.reshape(*turned.shape[:-1], 1) * turned

    def _of_turns(self, a: int) -> Iterator[Block]:
        if self.partners.planes is None:
            return
        for material, at, by_spin in zip(self.materials, self.turned, self.by_spins, strict=True):
            yield material.rows(at.by_products(by_spin[:, a]).swapaxes(1, 2))


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
    dim = x.shape[1]
    used = (weights > 0.0) | (dim == 2)
    foot = np.einsum("tc,tca->ta", weights, corners)
    off, edges = x - foot, corners - foot[:, None]
    by_corner = np.einsum("ck,ta->tcka", np.eye(dim), off)
    by_corner -= np.einsum("tca,tk->tcka", edges, weights)
    # weights of least distance whose sum is one, with a Lagrange multiplier
    system, rhs = np.zeros((len(x), dim + 1, dim + 1)), np.zeros((len(x), dim + 1, dim + dim**2))
    system[:, :dim, :dim] = np.where(used[:, :, None], edges @ edges.swapaxes(1, 2), np.eye(dim))
    system[:, :dim, dim] = system[:, dim, :dim] = used
    rhs[:, :dim] = np.concatenate([edges, by_corner.reshape(len(x), dim, dim**2)], axis=2)
    rhs[:, :dim] *= used[:, :, None]
    found = np.linalg.solve(system, rhs)[:, :dim]
    return found[..., :dim], found[..., dim:]


@dataclass(frozen=True)
class PairHistory:
    """Derivatives of a contact at the end of a step with respect to an earlier state (local).

    Attributes:
        fields: Derivatives of the slip of the step, in space also of the shear in its direction,
            of their power, and of the total slip, shape (slave nodes, size of the vector) each,
            of the last one three rows a node.
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
    layout, f = fields.Layout(contact), contact.now
    keeps_shear = np.where(f.state.redundant & then.state.active, 1.0 / ELASTIC, 0.0)
    by, redundant = fields.rows_by_fields(contact), f.state.redundant.any()
    if isinstance(f, SpaceFields) and isinstance(then, SpaceFields):
        of_step = slip_by_earlier(contact, then, layout)
        changes = {"slip_vector": of_step, "slip_of_step": of_step}
        if contact.pair.law.summed_slip:
            changes["slip_vector"] = slip_by_earlier(contact, then, layout, f.carried)
        of_fields = {
            name: fields.through_fields(each, changes)
            for name, each in (fields.of_vectors(f) | fields.of_slips(f)).items()
        }
        if redundant:
            weighted = zip(contact.rows.frame()[2:4], f.row_tangents, strict=True)
            dyads = sum(weight[:, :, None] * along[:, None] for weight, along in weighted)
            by["shear"] = dyads * keeps_shear[:, None, None]
            changes["shear"] = fields.tangential_derivative(then, layout, then.z_u, of_slip=False)
        return PairHistory(of_fields, fields.through_fields(by, changes))
    off_planes = np.where(np.isfinite(contact.plane_normals[:, 0]), 0.0, 1.0)
    changes = {
        "slip": fields.by_node(off_planes[:, None, None]) @ slip_by_earlier(contact, then, layout)
    }
    of_fields = dict(changes)
    if redundant:
        by["shear"] = contact.rows.frame()[2] * keeps_shear[:, None]
        changes["shear"] = fields.of_law(then, layout, "z_tau")
    return PairHistory(of_fields, fields.through_fields(by, changes))


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

    Parameters, numbers or arrays, are listed in ``Law.parameters``; those that vary in space are
    represented by their values at the slave nodes.

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
        return fields.by_node(response(contact, name, value, np.ones_like(value), at)[:, :, None])
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

    by_fields = {name: by_argument(name) for name in ("gap", "slip", "z_n", "z_tau")}
    of_slip = by_fields["slip"], by_fields["z_tau"]
    by_mean_gap = by_fields["gap"] + by_fields["slip"] * f.slip_by_gap[:, None]
    gap = by_mean_gap * f.per_weight[:, None]
    by_fields |= {"gap": gap, "weight": -gap * f.mean_gap[:, None]}
    sums = isinstance(f, SpaceFields) and law.summed_slip
    if sums:
        by_fields["total_slip"] = components_of(law, np.eye(3) + np.zeros((len(gap), 1, 1)))

    def by_own(response: Response, of_sum: Any) -> Matrix:
        parts = []
        for name in law.memory:
            if sums and name == law.summed_slip:
                turned = of_sum() @ contact.partners.rotation_of_slave(f.operators)
                parts += list(np.moveaxis(turned, 2, 0))
            else:
                value = np.asarray(given.memory[name])
                parts.append(by(response, name, value, partial(at_memory, name)))
        return fields.by_node(np.stack(parts, axis=2))

    def memory_by_sum() -> Array:
        assert isinstance(f, SpaceFields)
        vectors = fields.of_vectors(f) | fields.of_slips(f)
        change = by_fields["total_slip"] @ vectors["total_slip"]["slip_vector"]
        for by_number, name in zip(of_slip, ("slip", "z_tau"), strict=True):
            change = change + by_number[:, :, None] * vectors[name]["slip_vector"]
        return change

    own = by_own(change_of_memory, memory_by_sum)
    rows = by_own(change_of_rows, lambda: fields.rows_by_fields(contact)["slip_vector"])
    return PairMemory(by_fields, own, rows)


def components_of(law: Law, vectors: Array) -> Array:
    """Values of the components of the summed slip (n, 3, c) among those of the memory (local).

    Shape (n, names of the memory, c), zero for other names [unit of the vectors].
    """
    at = law.memory.index(str(law.summed_slip))
    found = np.zeros((len(vectors), len(law.memory) + 2, vectors.shape[2]))
    found[:, at : at + 3] = vectors
    return found


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
    change = np.asarray(made).T
    if contact.slave.dim == 3 and law.summed_slip:  # which follows from the vectors of slip
        column = law.memory.index(law.summed_slip)
        none = np.zeros((3, len(change)))
        change = np.column_stack([*change.T[:column], *none, *change.T[column + 1 :]])
    return change


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
        found[1] = law.adhesion_at(opened).residual + f.pull.by_gap * np.minimum(node.gap, 0.0)
    found[2] = node.gap
    return found


def differentiate(
    what: str, value: Array, direction: Array, function: Callable[[Any], Array], terms: Any = 0.0
) -> Array:
    """Derivative by complex step, compared with difference quotients (local).

    The law is evaluated with a number p + i h d: the imaginary part over h is the derivative along
    d, exact up to rounding. Functions such as ``abs`` are not analytic; a result that contradicts
    difference quotients on both sides is therefore rejected. Branches are fixed.

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
