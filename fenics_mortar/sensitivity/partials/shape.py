# SPDX-License-Identifier: MIT
"""Derivative of a contact's rows with respect to the shape of its obstacle.

The distance of a point changes by dphi, the gradient by dgrad. This changes the weighted gaps int
Phi_j phi, the normals n = -grad phi / |grad phi| of the slave nodes, and the slip, through the
present tangents and the nearest points of the accepted state from which it is counted. Forces of
given multipliers do not depend on the obstacle.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface.integrals import hand_over
from fenics_mortar.interface.obstacle_facets import gap_weights
from fenics_mortar.interface.on_obstacle import ObstacleOperators, facet_thickness
from fenics_mortar.sensitivity.partials.gap import weights_of_gaps
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError, call_together
from fenics_mortar.utils.ranks import sum_over_ranks


class FieldChange(NamedTuple):
    """Changes of nodal fields along m directions, each of shape (m, slave nodes); z is fixed.

    Attributes:
        gap: Change of the weighted gaps [length^2].
        z_n, z_tau: Changes of pressure and shear [stress].
        slip: Change of the slip of the step [length].
    """

    gap: Array
    z_n: Array
    z_tau: Array
    slip: Array

    @property
    def only(self) -> dict[str, Array]:
        """Changes along the first direction by name, (slave nodes,) each [unit of the field]."""
        return {name: values[0] for name, values in self._asdict().items()}


def units_of(value: Array) -> Array:
    """All directions in which one number of a parameter changes, ``(size, *shape)`` [1] (local)."""
    return np.eye(value.size).reshape(value.size, *value.shape)


def change_by_shape(contact: Contact, name: str, directions: Array) -> FieldChange:
    """Change of fields along directions of a parameter of the shape (collective).

    Args:
        contact: The contact, evaluated, with the obstacle at its present position.
        name: Name of the parameter, see ``Obstacle.shape``.
        directions: Shape ``(m, *shape)`` with that of the parameter, in its unit.

    Raises:
        MortarError: If sliding is small.
    """
    if contact.pair.sliding == "small":
        raise MortarError("shapes of obstacles cannot be controls with sliding='small'")
    f, o = contact.now, contact.now.on_obstacle
    what = f"the derivative of '{o.obstacle.name}' by '{name}'"
    gap, dn = call_together(
        o.slave.comm,
        what,
        lambda: (_gap(contact, name, directions), _normals(contact, o, name, directions)),
    )
    gap = sum_over_ranks(o.slave.comm, gap)
    dtau = np.stack([-dn[..., 1], dn[..., 0]], axis=-1)
    slip = np.zeros_like(gap)
    if contact.pair.law.has_friction or contact.pair.law.needs_nodal_state:
        slip = np.einsum("mjc,jc->mj", dtau, contact.partners.rotated(o))
        slip = np.where(np.isfinite(contact.plane_normals[:, 0]), 0.0, slip)
    z = f.state.z
    return FieldChange(gap, np.einsum("mjc,jc->mj", dn, z), np.einsum("mjc,jc->mj", dtau, z), slip)


def rows_by_shape(contact: Contact, name: str, directions: Array) -> Array:
    """Change of the rows along directions of a parameter of the shape (collective).

    Returns shape (m, slave nodes, 2) [stress length]; arguments: see ``change_by_shape``.
    """
    change = change_by_shape(contact, name, directions)
    rows = weights_of_gaps(contact) * change.gap[..., None]
    _, _, *weights = contact.rows.frame()
    for weight, row in zip(weights, contact.now.law_rows, strict=True):
        of_row = row.by_z_n * change.z_n + row.by_z_tau * change.z_tau + row.by_slip * change.slip
        rows = rows - weight * of_row[..., None]
    return rows


def shape_by_rows(contact: Contact, name: str, rows: Array) -> Array:
    """Gradient of the sum of the rows times ``rows``, of the parameter's shape (collective).

    In the unit of ``rows`` times [stress length] over that of the parameter.
    """
    value = np.asarray(contact.now.on_obstacle.obstacle.shape()[name])
    changes = rows_by_shape(contact, name, units_of(value))
    return np.einsum("mjc,jc->m", changes, rows).reshape(value.shape)


def _distances(o: Any, x: Array, name: str, directions: Array) -> tuple[Array, Array]:
    """Changes of phi (m, n) and of its gradient (m, n, 2) at points ``x`` in space (local)."""
    phi, gradient = o.local_by_shapes(o.to_own_frame(x), name, directions)
    return phi, gradient @ o.rotation.T


def _gap(contact: Contact, name: str, directions: Array) -> Array:
    """This rank's share of the change of the weighted gaps, (m, slave nodes) [length^2] (local)."""
    o, slave, s = contact.operators, contact.slave, contact.operators.segments
    nodes = o.facet_nodes
    weights = hand_over(contact.multiplier_nodes[nodes])
    at, of_gap = gap_weights(
        o.x[nodes],
        weights,
        (s.points, s.weights),
        contact.options,
        facet_thickness(slave, o.x, nodes),
    )
    gap = np.zeros((len(directions), slave.num_nodes))
    if len(nodes):
        phi, _ = _distances(contact.obstacle, at.reshape(-1, 2), name, directions)
        of_facets = np.einsum("ejp,mep->mej", of_gap, phi.reshape(-1, *at.shape[:2]))
        for total, share in zip(gap, of_facets, strict=True):
            np.add.at(total, nodes, share)
    return gap


def _normals(contact: Contact, o: ObstacleOperators, name: str, directions: Array) -> Array:
    """Change of the normals of the slave nodes, zero on symmetry planes, (m, slave nodes, 2)."""
    size = np.linalg.norm(o.obstacle.evaluate(o.x)[1], axis=1)[:, None]
    change = _distances(o.obstacle, o.x, name, directions)[1] / size
    dn = -(change - np.einsum("jc,mjc->mj", o.n, change)[..., None] * o.n)
    return np.where(np.isfinite(contact.plane_normals), 0.0, dn)
