# SPDX-License-Identifier: MIT
"""Derivatives of the nodal fields of a pair, of its rows and forces.

Rows, memory of laws and functionals depend on state and controls through the fields w (weights), g
(weighted gaps), z_n, z_tau, slip of the step at constant gaps, and z; see ``maps.through_fields``.
In space slip and z_tau are components along the law's direction, see ``space_fields``; rows depend
on the vectors of slip and normals, "slip_vector" and "normal".

**Derivatives of a contact with respect to the shapes of its bodies.** With finite sliding, the
equations depend on the present positions x = X + u of the nodes: forces and rows change with X as
with the displacement, at fixed sets, offset and weights of the rows. Lengths of undeformed facets
occur only in weights of rows, and in the stiffness of redundant sticks and of users' laws, which is
considered fixed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.contact.interface import Interface
from fenics_mortar.contact.law import Row
from fenics_mortar.contact.space_fields import SpaceFields, VectorRow
from fenics_mortar.interface.mortar import Block, MortarOperators
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.interface.plane_mortar import PlaneOperators
from fenics_mortar.sensitivity.partials.maps import (
    Changes,
    Layout,
    Matrix,
    assembled,
    interleaved,
    rows_at_nodes,
    through_fields,
)
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError


def fields_by_state(contact: Interface, names: Iterable[str]) -> Changes:
    """Derivatives of fields with respect to the vector of the pair, (slave nodes, size) each.

    Collective. That of "z" has the shape (d slave nodes, size).
    """
    layout = Layout(contact)
    derivatives = DERIVATIVES if layout.dim == 2 else IN_SPACE
    return {name: derivatives[name](contact, layout) for name in names}


def _weight(contact: Interface, layout: Layout) -> Matrix:
    return layout.nodal(contact.operators.weight_derivative())


def _weighted_gap(contact: Interface, layout: Layout) -> Matrix:
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


def shear_derivative(o: PlaneOperators, z: Array, layout: Layout) -> Matrix:
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
    "gap": _weighted_gap,
    "z_n": _z_n,
    "z_tau": _z_tau,
    "slip": _slip,
    "z": _z,
}


def by_vectors(o: MortarOperators, partners: Any, layout: Layout, row: VectorRow) -> Matrix:
    """Derivative of a function of multiplier, slip and normal of a node in space (collective).

    Shape (slave nodes, size).
    """
    turned, by_motion = np.einsum("ja,jaq->jq", row.by_normal, o.dn), None
    blocks = [rows_at_nodes(o.slave, o.normal_columns(), turned)]
    slips = row.by_slip.any()
    if slips:
        blocks += partners.derivative(o, row.by_slip)
    if isinstance(o, ObstacleOperators):
        by_motion = np.einsum("ja,jam->jm", row.by_normal, o.dn_dq)
        if slips:
            of_slip = partners.derivative_by_motions(o)
            by_motion += np.einsum("ja,jam->jm", row.by_slip, of_slip)
    return layout.nodal(blocks, row.by_z, by_motion)


# Numbers of a node in space as functions of the law's arguments.
OF_LAW = {
    "z_n": Row(0.0, by_z_n=1.0),
    "z_tau": Row(0.0, by_z_tau=1.0),
    "slip": Row(0.0, by_slip=1.0),
}


def _of_law(name: str) -> Callable[[Interface, Layout], Matrix]:
    def derivative(contact: Interface, layout: Layout) -> Matrix:
        f: Any = contact.now
        row = f.by_vectors(OF_LAW[name])
        return by_vectors(f.operators, f.state.partners, layout, row)

    return derivative


IN_SPACE = DERIVATIVES | {name: _of_law(name) for name in OF_LAW}


def of_vectors(f: SpaceFields) -> dict[str, dict[str, Array]]:
    """Derivatives of arguments of the law by the vectors of slip and normals (local).

    By their names, shape (slave nodes, 1, 3) each [unit of the argument over that of the vector].
    """
    rows = {name: f.by_vectors(row) for name, row in OF_LAW.items()}
    return {
        name: {"slip_vector": row.by_slip[:, None], "normal": row.by_normal[:, None]}
        for name, row in rows.items()
    }


def shear_vector_derivative(f: SpaceFields, layout: Layout) -> Matrix:
    """Derivative of the shear P z in space, (3 slave nodes, size) (collective)."""
    o, z, z_n = f.operators, f.z_u, f.z_n
    none, (count, dim) = np.zeros(len(z)), z.shape
    found = []
    for a in np.eye(dim):
        n_a = (o.n @ a)[:, None]
        row = VectorRow(none, a - n_a * o.n, np.zeros_like(z), none, -z_n[:, None] * a - n_a * z)
        found.append(by_vectors(o, None, layout, row))
    return interleaved(found, count)


def off_planes(derivative: Matrix, contact: Contact) -> Matrix:
    """The derivative of slip with zeros at nodes on symmetry planes (local)."""
    kept = np.where(np.isfinite(contact.plane_normals[:, 0]), 0.0, 1.0)
    return through_fields({"slip": kept[:, None]}, {"slip": derivative})


def over_weights(f: ContactFields, values: Array) -> Array:
    """Values (slave nodes,) over the weights w_j, zero at uncovered nodes (local)."""
    return np.where(f.covered, values / np.where(f.covered, f.operators.weight, 1.0), 0.0)


def rows_by_fields(contact: Contact) -> dict[str, Array]:
    """Derivatives of the d rows of a node with respect to its fields, (slave nodes, d) (local).

    With respect to vectors (slave nodes, d, d). Multipliers, active set and weights of the rows are
    fixed. Rows of closed gaps and of the law depend on gaps. In the unit of the rows [stress
    length] over that of the field.
    """
    f = contact.now
    normal, _, *weights = contact.rows.frame()
    if isinstance(f, SpaceFields):
        return _rows_in_space(f, normal, weights)
    by = {name: np.zeros_like(normal) for name in ("z_n", "z_tau", "slip")} | {"gap": normal.copy()}
    for weight, row in zip(weights, f.law_rows, strict=True):
        by["gap"] -= weight * over_weights(f, row.by_gap)[:, None]
        for name in ("z_n", "z_tau", "slip"):
            by[name] -= weight * getattr(row, f"by_{name}")[:, None]
    return by


def _rows_in_space(f: SpaceFields, normal: Array, weights: list[Array]) -> dict[str, Array]:
    """See ``rows_by_fields``; along vectors of slip and normals."""
    count, dim = normal.shape
    by = {name: np.zeros((count, dim, dim)) for name in ("slip_vector", "normal")}
    by["gap"] = normal.copy()
    for weight, row in zip(weights, f.vector_rows, strict=True):
        by["gap"] -= weight * over_weights(f, row.by_gap)[:, None]
        by["slip_vector"] -= weight[:, :, None] * row.by_slip[:, None]
        by["normal"] -= weight[:, :, None] * row.by_normal[:, None]
    return by


def gap_by_offset(o: MortarOperators) -> Matrix:
    """Derivative of the weighted gaps g_j - D_jk offset_k, (slave nodes, slave nodes) [length].

    Collective.
    """
    nodes, count = o.facet_nodes, len(o.x)
    return assembled([Block(nodes, nodes, -o.D)], (count, count), o.slave.comm)


def moment(contact: Interface, about: Array, axis: Array | None) -> float:
    """Moment of the contact forces on the slave body [stress length^2] (collective).

    In space its component along the unit vector ``axis`` (3,).
    """
    force, _ = contact.now.forces
    return -float((_around(axis, contact.operators.x - about) * force).sum())


def _around(axis: Array | None, vectors: Array) -> Array:
    """Products of the axis, in the plane that across it, and vectors (n, d) (local)."""
    if axis is None:
        return np.stack([-vectors[:, 1], vectors[:, 0]], axis=1)
    return np.cross(axis, vectors)


def moment_gradient(contact: Interface, about: Array, axis: Array | None) -> Array:
    """Derivative of ``moment`` about a point (d,), a vector of the pair (collective).

    In the unit of the moment over those of the vector, see ``maps``.
    """
    o, z, layout = contact.operators, contact.z, Layout(contact)
    force, _ = contact.now.forces
    turned = _around(axis, o.x - about)
    total = np.zeros(layout.size)
    total[layout.on_slave] = _around(axis, force).ravel()
    total[layout.z] = -o.jump(turned, np.zeros_like(contact.master.X)).ravel()
    if o.linearization.frozen:
        return total
    rows, columns, values = o.slave_force_derivative(z)
    by_x = layout.matrix([Block(layout.places(rows), columns, values)], layout.size)
    weights = np.zeros(layout.size)
    weights[layout.on_slave] = turned.ravel()
    return total - by_x.T @ weights


def by_positions(contact: Interface) -> Matrix:
    """Derivative of forces, rows, and forces on the obstacle by the positions of all nodes.

    Shape (size, size) of the vector of the pair: its columns of displacements are not zero
    (collective).
    """
    assert isinstance(contact, Contact)
    layout, o = Layout(contact), contact.operators
    blocks = [
        Block(layout.places(rows), columns, values)
        for rows, columns, values in o.force_derivative(contact.z)
    ]
    blocks += [
        Block(rows + layout.z.start, columns, values)
        for rows, columns, values in contact.rows.linearized().blocks
    ]
    if isinstance(o, ObstacleOperators):
        j = contact.slave.owned
        by_nodes = np.swapaxes(o.motion_force_derivatives(contact.z)[0], 0, 1)[j]
        motions = layout.motion.start + 0 * j[:, None] + np.arange(layout.num_motions)
        blocks.append(Block(motions, contact.slave.dofs[j], by_nodes))
    return layout.matrix(blocks, layout.size)


def check_positions(contact: Interface) -> None:
    """Reject contacts whose equations depend on the undeformed mesh in other ways (local).

    Raises:
        MortarError: For ties, small sliding, thickness or parameters of laws that are functions of
            the position.
    """
    if not isinstance(contact, Contact) or contact.pair.sliding == "small":
        raise MortarError(
            f"{contact.pair!r} has D and M of the undeformed mesh: nodal positions as controls "
            "need contact with sliding='finite'"
        )
    for name, value in contact.pair.law.varying.items():
        if not isinstance(value, np.ndarray):
            raise MortarError(f"{name} of {contact.pair.law!r} varies with the position")
    thickness = contact.slave.thickness
    if thickness is not None and thickness.by_x == 0.0 and np.ptp(thickness.at(contact.slave.X)):
        raise MortarError(
            "the thickness depends on the position: there are no derivatives by nodal positions"
        )
