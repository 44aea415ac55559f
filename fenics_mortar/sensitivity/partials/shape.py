# SPDX-License-Identifier: MIT
"""Derivatives of a contact with respect to shapes: of its obstacle, and of its bodies.

If the shape of the obstacle changes, the distance of a point changes by dphi, its gradient by
dgrad. This changes the weighted gaps int Phi_j phi, the normals n = -grad phi / |grad phi| of the
slave nodes, and the slip, through the present tangents and the nearest points of the accepted state
from which it is counted. Forces of given multipliers do not depend on the obstacle.

With finite sliding, the equations depend on the present positions x = X + u of the nodes: forces
and rows change with X as with the displacement, at fixed sets, offset and weights of the rows.
Lengths of undeformed facets occur only in weights of rows, and in the stiffness of redundant sticks
and of users' laws, which is considered fixed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.interface.integrals import hand_over
from fenics_mortar.interface.mortar import Block
from fenics_mortar.interface.obstacle_facets import gaps_along, points_of
from fenics_mortar.interface.on_obstacle import ObstacleOperators, facet_thickness
from fenics_mortar.sensitivity.partials.maps import Changes, Layout, Matrix
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError, call_together
from fenics_mortar.utils.ranks import sum_over_ranks


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
