# SPDX-License-Identifier: MIT
"""Derivatives of the nodal fields of a pair with respect to the shape of its obstacle.

If the shape changes, the distance of a point changes by dphi, its gradient by dgrad. This changes
the weighted gaps int Phi_j phi, the normals n = -grad phi / |grad phi| of the slave nodes, and the
slip: in the plane through the present tangents, in space through the nearest points of the accepted
state from which it is counted. Forces of given multipliers do not depend on the obstacle.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.space_fields import SpaceFields
from fenics_mortar.interface.obstacle_facets import gaps_along, points_of, whole_rule
from fenics_mortar.interface.on_obstacle import (
    ObstacleOperators,
    facet_hand_over,
    facet_thickness,
)
from fenics_mortar.sensitivity.partials.fields import of_vectors
from fenics_mortar.sensitivity.partials.maps import Changes, Matrix, through_fields
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError, call_together
from fenics_mortar.utils.ranks import sum_over_ranks


def fields_by_shape(contact: Contact, name: str) -> Changes:
    """Derivatives of gap, z_n, z_tau and slip with respect to a parameter of the shape.

    Collective. In space also those of the normals.

    Args:
        contact: The contact, evaluated, with the obstacle at its present position.
        name: Name of the parameter, see ``Obstacle.shape``.

    Returns:
        Shape (slave nodes, m) each, of vectors (3 slave nodes, m), for the m numbers of the
        parameter.

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
    changes = {"gap": sum_over_ranks(o.slave.comm, gap)}
    if isinstance(f, SpaceFields):
        found = {"normal": Matrix.dense(dn.reshape(len(dn), -1).T)}
        found["gap"] = Matrix.dense(changes["gap"].T)
        return found | {name: through_fields(by, found) for name, by in of_vectors(f).items()}
    dtau, z = np.stack([-dn[..., 1], dn[..., 0]], axis=-1), f.state.z
    changes |= {"z_n": np.einsum("mjc,jc->mj", dn, z), "z_tau": np.einsum("mjc,jc->mj", dtau, z)}
    if contact.pair.law.has_friction or contact.pair.law.needs_nodal_state:
        slip = np.einsum("mjc,jc->mj", dtau, contact.partners.rotated(o))
        changes["slip"] = np.where(np.isfinite(contact.plane_normals[:, 0]), 0.0, slip)
    return {name: Matrix.dense(change.T) for name, change in changes.items()}


def _distances(o: Any, x: Array, name: str, directions: Array) -> tuple[Array, Array]:
    """Changes of phi (m, n) and of its gradient (m, n, d) at points ``x`` in space (local)."""
    phi, gradient = o.local_by_shapes(o.to_own_frame(x), name, directions)
    return phi, gradient @ o.rotation.T


def _gap(contact: Contact, name: str, directions: Array) -> Array:
    """This rank's share of the change of the weighted gaps, (m, slave nodes) [length^2] (local)."""
    o, slave, options = contact.operators, contact.slave, contact.options
    x, nodes = o.x[o.facet_nodes], o.facet_nodes
    rule = whole_rule(options, slave.degree, nodes.shape[1])
    weights = facet_hand_over(contact.multiplier_nodes[nodes], slave.dim, options)
    gap = np.zeros((len(directions), slave.num_nodes))
    if len(nodes):
        at, thickness = points_of(x, rule[0]), facet_thickness(slave, o.x, nodes)
        phi, _ = _distances(contact.obstacle, at.reshape(-1, slave.dim), name, directions)
        phi = phi.reshape(-1, *at.shape[:2])
        of_facets = gaps_along(x, weights, rule, options, thickness, phi)
        for total, share in zip(gap, of_facets, strict=True):
            np.add.at(total, nodes, share)
    return gap


def _normals(contact: Contact, o: ObstacleOperators, name: str, directions: Array) -> Array:
    """Change of the normals of the slave nodes, on symmetry planes along them (m, slave nodes, d).

    Zero on those of the plane.
    """
    gradient, change = o.obstacle.evaluate(o.x)[1], _distances(o.obstacle, o.x, name, directions)[1]
    in_plane = contact.slave.dim == 2
    if not in_plane:
        projectors = contact.evaluation.planes
        gradient = np.einsum("jab,jb->ja", projectors, gradient)
        change = np.einsum("jab,mjb->mja", projectors, change)
    change = change / np.linalg.norm(gradient, axis=1)[:, None]
    dn = -(change - np.einsum("jc,mjc->mj", o.n, change)[..., None] * o.n)
    return np.where(in_plane & np.isfinite(contact.plane_normals), 0.0, dn)
