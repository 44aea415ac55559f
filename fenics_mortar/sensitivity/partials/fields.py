# SPDX-License-Identifier: MIT
"""Derivatives of the nodal fields of a pair, of its rows and forces.

Rows, memory of laws and functionals depend on state and controls through the fields w (weights), g
(weighted gaps), z_n, z_tau, slip of the step at constant gaps, and z; see ``maps.through_fields``.

**Derivatives of a contact with respect to shapes: of its obstacle, and of its bodies.** If the
shape of the obstacle changes, the distance of a point changes by dphi, its gradient by dgrad. This
changes the weighted gaps int Phi_j phi, the normals n = -grad phi / |grad phi| of the slave nodes,
and the slip, through the present tangents and the nearest points of the accepted state from which
it is counted. Forces of given multipliers do not depend on the obstacle.

With finite sliding, the equations depend on the present positions x = X + u of the nodes: forces
and rows change with X as with the displacement, at fixed sets, offset and weights of the rows.
Lengths of undeformed facets occur only in weights of rows, and in the stiffness of redundant sticks
and of users' laws, which is considered fixed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.contact.interface import Interface
from fenics_mortar.interface.integrals import hand_over
from fenics_mortar.interface.linearization import Block
from fenics_mortar.interface.obstacle_facets import gaps_along, points_of
from fenics_mortar.interface.on_obstacle import ObstacleOperators, facet_thickness
from fenics_mortar.interface.plane_mortar import PlaneOperators
from fenics_mortar.sensitivity.partials.maps import (
    Changes,
    Layout,
    Matrix,
    assembled,
    rows_at_nodes,
    through_fields,
)
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError, call_together
from fenics_mortar.utils.ranks import sum_over_ranks


def fields_by_state(contact: Interface, names: Iterable[str]) -> Changes:
    """Derivatives of fields with respect to the vector of the pair, (slave nodes, size) each.

    Collective. That of "z" has the shape (2 slave nodes, size).
    """
    layout = Layout(contact)
    return {name: DERIVATIVES[name](contact, layout) for name in names}


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


def gap_by_offset(o: PlaneOperators) -> Matrix:
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


def fields_by_shape(contact: Contact, name: str) -> Changes:
    """Derivatives of gap, z_n, z_tau and slip with respect to a parameter of the shape.

    Collective.

    Args:
        contact: The contact, evaluated, with the obstacle at its present position.
        name: Name of the parameter, see ``Obstacle.shape``.

    Returns:
        Shape (slave nodes, m) each, for the m numbers of the parameter.

    Raises:
        MortarError: If sliding is small.
    """
    if contact.pair.sliding == "small":
        raise MortarError("shapes of obstacles cannot be controls with sliding='small'")
    f, o = contact.now, contact.now.on_obstacle
    value = np.asarray(o.obstacle.shape()[name])
    units = np.eye(value.size).reshape(value.size, *value.shape)
    what = f"the derivative of '{o.obstacle.name}' by '{name}'"
    gap, dn = call_together(
        o.slave.comm, what, lambda: (_gap(contact, name, units), _normals(contact, o, name, units))
    )
    dtau, z = np.stack([-dn[..., 1], dn[..., 0]], axis=-1), f.state.z
    changes = {"gap": sum_over_ranks(o.slave.comm, gap)}
    changes |= {"z_n": np.einsum("mjc,jc->mj", dn, z), "z_tau": np.einsum("mjc,jc->mj", dtau, z)}
    if contact.pair.law.has_friction or contact.pair.law.needs_nodal_state:
        slip = np.einsum("mjc,jc->mj", dtau, contact.partners.rotated(o))
        changes["slip"] = np.where(np.isfinite(contact.plane_normals[:, 0]), 0.0, slip)
    return {name: Matrix.dense(change.T) for name, change in changes.items()}


def _distances(o: Any, x: Array, name: str, directions: Array) -> tuple[Array, Array]:
    """Changes of phi (m, n) and of its gradient (m, n, 2) at points ``x`` in space (local)."""
    phi, gradient = o.local_by_shapes(o.to_own_frame(x), name, directions)
    return phi, gradient @ o.rotation.T


def _gap(contact: Contact, name: str, directions: Array) -> Array:
    """This rank's share of the change of the weighted gaps, (m, slave nodes) [length^2] (local)."""
    o, slave, s = contact.operators, contact.slave, contact.operators.segments
    x, nodes, rule = o.x[o.facet_nodes], o.facet_nodes, (s.points, s.weights)
    weights = hand_over(contact.multiplier_nodes[nodes])
    gap = np.zeros((len(directions), slave.num_nodes))
    if len(nodes):
        at, thickness = points_of(x, s.points), facet_thickness(slave, o.x, nodes)
        phi, _ = _distances(contact.obstacle, at.reshape(-1, 2), name, directions)
        phi = phi.reshape(-1, *at.shape[:2])
        of_facets = gaps_along(x, weights, rule, contact.options, thickness, phi)
        for total, share in zip(gap, of_facets, strict=True):
            np.add.at(total, nodes, share)
    return gap


def _normals(contact: Contact, o: ObstacleOperators, name: str, directions: Array) -> Array:
    """Change of the normals of the slave nodes, zero on symmetry planes, (m, slave nodes, 2)."""
    size = np.linalg.norm(o.obstacle.evaluate(o.x)[1], axis=1)[:, None]
    change = _distances(o.obstacle, o.x, name, directions)[1] / size
    dn = -(change - np.einsum("jc,mjc->mj", o.n, change)[..., None] * o.n)
    return np.where(np.isfinite(contact.plane_normals), 0.0, dn)


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
        motions = layout.motion.start + 0 * j[:, None] + np.arange(3)
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
