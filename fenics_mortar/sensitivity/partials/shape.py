# SPDX-License-Identifier: MIT
"""Derivative of a contact's rows with respect to the shape of its obstacle.

The distance of a point changes by dphi, the gradient by dgrad. This changes the weighted gaps int
Phi_j phi, the normals n = -grad phi / |grad phi| of the slave nodes, and the slip, through the
present tangents and the nearest points of the accepted state from which it is counted. Forces of
given multipliers do not depend on the obstacle.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface.integrals import hand_over
from fenics_mortar.interface.on_obstacle import ObstacleOperators, integrate_facets, thickness_of
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.sensitivity.partials.gap import weights_of_gaps
from fenics_mortar.sensitivity.partials.history import Earlier
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError, call_together


class _Changed:
    """The change of an obstacle's distance, which replaces the obstacle in integrals."""

    def __init__(self, obstacle: Obstacle, name: str, direction: Array) -> None:
        self._obstacle, self._name, self._direction = obstacle, name, direction

    def evaluate(self, x: Array) -> tuple[Array, Array, Array]:
        """Changes of phi (n,) and its gradient (n, 2) at points in space; the Hessian is zero."""
        o = self._obstacle
        phi, gradient = o.local_by_shape(o.to_own_frame(x), self._name, self._direction)
        return phi, gradient @ o.turn.T, np.zeros((*x.shape, 2))

    def motions(self, x: Array, arm: float) -> Array:
        """Motions of the obstacle."""
        return self._obstacle.motions(x, arm)


class FieldChange(NamedTuple):
    """Changes of nodal fields, each of shape (slave nodes,); multipliers z are fixed.

    Attributes:
        gap: Change of the weighted gaps [length^2].
        z_n, z_tau: Changes of pressure and shear [stress].
        slip: Change of the slip of the step [length].
    """

    gap: Array
    z_n: Array
    z_tau: Array
    slip: Array


def change_by_shape(
    contact: Contact, name: str, direction: Array, earlier: Earlier | None = None
) -> FieldChange:
    """Change of fields along a direction of a parameter of the shape (collective).

    Args:
        contact: The contact, evaluated, with the obstacle at its present position.
        name: Name of the parameter, see ``Obstacle.shape``.
        direction: Shape of the parameter, in its unit.
        earlier: Accepted state from which slip is counted; needed with friction.

    Raises:
        MortarError: If sliding is small.
    """
    if contact.pair.sliding == "small":
        raise MortarError("shapes of obstacles cannot be controls with sliding='small'")
    f, o = contact.now, contact.now.on_obstacle
    changed = _Changed(o.obstacle, name, np.asarray(direction, float))
    words = f"the derivative of '{o.obstacle.name}' by '{name}'"
    gap, dn = call_together(
        o.slave.comm, words, lambda: (_gap(contact, changed), _normals(contact, o, changed))
    )
    o.slave.comm.Allreduce(MPI.IN_PLACE, gap)
    dtau = np.stack([-dn[:, 1], dn[:, 0]], axis=1)
    slip = np.zeros(len(gap))
    if contact.pair.law.has_friction or contact.pair.law.needs_nodal_state:
        slip = np.einsum("jc,jc->j", dtau, contact.partners.apart(o))
        if earlier is not None:
            slip += _slip_of_earlier(contact, earlier, name, direction)
        slip = np.where(np.isfinite(contact.plane_normals[:, 0]), 0.0, slip)
    z = f.state.z
    return FieldChange(gap, np.einsum("jc,jc->j", dn, z), np.einsum("jc,jc->j", dtau, z), slip)


def rows_by_shape(
    contact: Contact, name: str, direction: Array, earlier: Earlier | None = None
) -> Array:
    """Change of the rows along a direction of a parameter of the shape (collective).

    Returns shape (slave nodes, 2) [stress length]; arguments: see ``change_by_shape``.
    """
    change = change_by_shape(contact, name, direction, earlier)
    rows = weights_of_gaps(contact) * change.gap[:, None]
    _, _, *laws = contact.rows.frame()
    for scaled, row in zip(laws, contact.now.law_rows, strict=True):
        of_row = row.by_z_n * change.z_n + row.by_z_tau * change.z_tau + row.by_slip * change.slip
        rows = rows - scaled * of_row[:, None]
    return rows


def shape_by_rows(
    contact: Contact, name: str, rows: Array, earlier: Earlier | None = None
) -> Array:
    """Gradient of the sum of the rows times ``rows``, shape of the parameter (collective)."""
    value = np.asarray(contact.now.on_obstacle.obstacle.shape()[name])
    gradient = np.zeros(value.size)
    for i, unit in enumerate(np.eye(value.size)):
        direction = unit.reshape(value.shape)
        gradient[i] = (rows * rows_by_shape(contact, name, direction, earlier)).sum()
    return gradient.reshape(value.shape)


def _gap(contact: Contact, changed: Any) -> Array:
    """This rank's share of the change of the weighted gaps, (slave nodes,) [length^2] (local)."""
    o, slave, s = contact.operators, contact.slave, contact.operators.segments
    nodes = o.facet_nodes
    weights = hand_over(contact.multiplier_nodes[nodes])
    integrals = integrate_facets(
        changed, contact.arm, o.x[nodes], weights, (s.points, s.weights), contact.options,
        thickness_of(slave, o.x, nodes),
    )  # fmt: skip
    gap = np.zeros(slave.num_nodes)
    np.add.at(gap, nodes, integrals[2])
    return gap


def _normals(contact: Contact, o: ObstacleOperators, changed: Any) -> Array:
    """Change of the normals of the slave nodes, zero on symmetry planes, (slave nodes, 2)."""
    size = np.linalg.norm(o.obstacle.evaluate(o.x)[1], axis=1)[:, None]
    change = changed.evaluate(o.x)[1] / size
    dn = -(change - np.einsum("jc,jc->j", o.n, change)[:, None] * o.n)
    return np.where(np.isfinite(contact.plane_normals), 0.0, dn)


def _slip_of_earlier(contact: Contact, earlier: Earlier, name: str, direction: Array) -> Array:
    """Change of the slip due to the nearest points of the earlier state, (slave nodes,) (local)."""
    now, o, obstacle = contact.operators, earlier.operators, contact.obstacle
    assert obstacle is not None
    with earlier.at_earlier_position():
        changed = _Changed(obstacle, name, direction)
        phi, dn = changed.evaluate(o.x)[0], _normals(contact, o, changed)
    along = -now.tau @ obstacle.turn @ earlier.turn.T
    return np.einsum("jc,jc->j", along, phi[:, None] * o.n + o.phi[:, None] * dn)
