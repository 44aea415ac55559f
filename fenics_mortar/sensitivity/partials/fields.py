# SPDX-License-Identifier: MIT
"""Derivatives of nodal fields of a contact, of its rows by them, and of the moment of its forces.

Rows, memory of laws and functionals depend on state and controls through the fields w (weights), g
(weighted gaps), z_n, z_tau, slip of the step at constant gaps, and z; see ``maps.through_fields``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.contact.interface import Interface
from fenics_mortar.interface.mortar import Block, MortarOperators
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.sensitivity.partials.maps import (
    Changes,
    Layout,
    Matrix,
    assembled,
    rows_at_nodes,
    through_fields,
)
from fenics_mortar.utils.arrays import Array


def fields_by_state(contact: Interface, names: Iterable[str]) -> Changes:
    """Derivatives of fields with respect to the vector of the pair, (slave nodes, size) each.

    Collective. That of "z" has the shape (2 slave nodes, size).
    """
    layout = Layout(contact)
    return {name: DERIVATIVES[name](contact, layout) for name in names}


def _weight(contact: Interface, layout: Layout) -> Matrix:
    return layout.nodal(contact.operators.weight_derivative())


def _gap(contact: Interface, layout: Layout) -> Matrix:
    o = contact.operators
    by_motion = o.dgap_dq if isinstance(o, ObstacleOperators) else None
    return layout.nodal(o.gap_derivative(), by_motion=by_motion)


def _z_n(contact: Interface, layout: Layout) -> Matrix:
    o, z = contact.operators, contact.z
    blocks = [rows_at_nodes(o.slave, o.normal_columns(), o.normal_derivative(z))]
    by_motion = np.einsum("jc,jcm->jm", z, o.dn_dq) if isinstance(o, ObstacleOperators) else None
    return layout.nodal(blocks, o.n, by_motion)


def _z_tau(contact: Interface, layout: Layout) -> Matrix:
    return shear_derivative(contact.operators, contact.z, layout)


def shear_derivative(o: MortarOperators, z: Array, layout: Layout) -> Matrix:
    """Derivative of the shears of multipliers z, (slave nodes, size) (collective)."""
    blocks = [rows_at_nodes(o.slave, o.normal_columns(), o.tangential_derivative(z))]
    by_motion = None
    if isinstance(o, ObstacleOperators):
        by_motion = z[:, 1:] * o.dn_dq[:, 0] - z[:, :1] * o.dn_dq[:, 1]
    return layout.nodal(blocks, o.tau, by_motion)


def _slip(contact: Interface, layout: Layout) -> Matrix:
    assert isinstance(contact, Contact)
    o, partners = contact.operators, contact.partners
    turned = o.tangential_derivative(partners.rotated(o))
    blocks = [rows_at_nodes(o.slave, o.normal_columns(), turned), *partners.derivative(o)]
    by_motion = partners.derivative_by_motions(o) if isinstance(o, ObstacleOperators) else None
    return off_planes(layout.nodal(blocks, by_motion=by_motion), contact)


def _z(contact: Interface, layout: Layout) -> Matrix:
    rows = np.arange(contact.z.size)
    return Matrix(rows, layout.z.start + rows, np.ones(rows.size), (rows.size, layout.size))


DERIVATIVES: dict[str, Callable[[Interface, Layout], Matrix]] = {
    "weight": _weight,
    "gap": _gap,
    "z_n": _z_n,
    "z_tau": _z_tau,
    "slip": _slip,
    "z": _z,
}


def off_planes(derivative: Matrix, contact: Contact) -> Matrix:
    """The derivative of slip with zeros at nodes on symmetry planes (local)."""
    kept = np.where(np.isfinite(contact.plane_normals[:, 0]), 0.0, 1.0)
    return through_fields({"slip": kept[:, None]}, {"slip": derivative})


def over_weights(f: ContactFields, values: Array) -> Array:
    """Values (slave nodes,) over the weights w_j, zero at uncovered nodes (local)."""
    return np.where(f.covered, values / np.where(f.covered, f.operators.weight, 1.0), 0.0)


def rows_by_fields(contact: Contact) -> dict[str, Array]:
    """Derivatives of the two rows of a node with respect to its fields, (slave nodes, 2) (local).

    Multipliers, active set and weights of the rows are fixed. Rows of closed gaps and of the law
    depend on gaps. In the unit of the rows [stress length] over that of the field.
    """
    f = contact.now
    normal, _, *weights = contact.rows.frame()
    by = {name: np.zeros_like(normal) for name in ("z_n", "z_tau", "slip")} | {"gap": normal.copy()}
    for weight, row in zip(weights, f.law_rows, strict=True):
        by["gap"] -= weight * over_weights(f, row.by_gap)[:, None]
        for name in ("z_n", "z_tau", "slip"):
            by[name] -= weight * getattr(row, f"by_{name}")[:, None]
    return by


def gap_by_offset(o: MortarOperators) -> Matrix:
    """Derivative of the weighted gaps g_j - D_jk offset_k, (slave nodes, slave nodes) [length].

    Collective.
    """
    nodes, count = o.facet_nodes, len(o.x)
    return assembled([Block(nodes, nodes, -o.D)], (count, count), o.slave.comm)


def moment(contact: Interface, about: Array) -> float:
    """Moment of the contact forces on the slave body [stress length^2] (collective)."""
    force, _ = contact.now.forces
    r = contact.operators.x - about
    return -float((r[:, 0] * force[:, 1] - r[:, 1] * force[:, 0]).sum())


def moment_gradient(contact: Interface, about: Array) -> Array:
    """Derivative of ``moment`` about a point (2,), a vector of the pair (collective).

    In the unit of the moment over those of the vector, see ``maps``.
    """
    o, z, layout = contact.operators, contact.z, Layout(contact)
    force, _ = contact.now.forces
    r = o.x - about
    turned = np.stack([-r[:, 1], r[:, 0]], axis=1)
    total = np.zeros(layout.size)
    total[layout.on_slave] = np.stack([-force[:, 1], force[:, 0]], axis=1).ravel()
    total[layout.z] = -o.jump(turned, np.zeros((contact.master.num_nodes, 2))).ravel()
    if o.linearization.frozen:
        return total
    rows, columns, values = o.slave_force_derivative(z)
    by_x = layout.matrix([Block(layout.places(rows), columns, values)], layout.size)
    weights = np.zeros(layout.size)
    weights[layout.on_slave] = turned.ravel()
    return total - by_x.T @ weights
