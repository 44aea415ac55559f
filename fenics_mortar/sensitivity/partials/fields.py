# SPDX-License-Identifier: MIT
"""Derivatives of nodal fields of a contact, and of their functionals, at the present state.

A functional of a pair is differentiated with respect to the fields w (weights), g (weighted gaps),
z_n, z_tau, slip and z, and by the chain rule with respect to displacement, multipliers and obstacle
motions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.contact.interface_fields import InterfaceFields
from fenics_mortar.interface.mortar import Block
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.sensitivity.partials.maps import Dofs, NodalDerivative, PairVector, rows_at_nodes
from fenics_mortar.utils.arrays import Array


@dataclass(frozen=True)
class ByFields:
    """Derivative of a functional with respect to nodal fields, (slave nodes,); ``None`` is zero.

    Attributes:
        weight: With respect to the weights w_j.
        gap: With respect to the weighted gaps g_j.
        z_n, z_tau: With respect to pressure and shear.
        slip: With respect to the slip of the step at constant gaps.
        z: With respect to the multipliers, apart from pressure and shear, shape (slave nodes, 2).
    """

    weight: Array | None = None
    gap: Array | None = None
    z_n: Array | None = None
    z_tau: Array | None = None
    slip: Array | None = None
    z: Array | None = None

    def gradient(self, contact: Interface) -> PairVector:
        """Derivative with respect to the present state at the pair (collective)."""
        dofs = Dofs((contact.slave, contact.master))
        total = zero_of(contact)
        if self.z is not None:
            total = total._replace(z=self.z.copy())
        for name, derivative in DERIVATIVES.items():
            weights = getattr(self, name)
            if weights is not None:
                total = total.plus(derivative(contact, dofs).back(weights))
        return total


def zero_of(contact: Interface) -> PairVector:
    """The zero vector of a pair (local)."""
    z, m = np.zeros_like(contact.z), np.zeros((contact.master.num_nodes, 2))
    return PairVector(np.zeros_like(z), m, z.copy(), np.zeros(3))


def weight_derivative(contact: Interface, dofs: Dofs) -> NodalDerivative:
    """Derivative of the weights w_j (local)."""
    return _by_nodes(contact, dofs, contact.operators.weight_derivative())


def gap_derivative(contact: Interface, dofs: Dofs) -> NodalDerivative:
    """Derivative of the weighted gaps g_j (local)."""
    o = contact.operators
    by_motion = o.dgap_dq if isinstance(o, ObstacleOperators) else None
    return _by_nodes(contact, dofs, o.gap_derivative(), by_motion)


def z_n_derivative(contact: Interface, dofs: Dofs) -> NodalDerivative:
    """Derivative of the pressures z_n (local)."""
    o, z = contact.operators, contact.z
    blocks = [rows_at_nodes(o.slave, o.normal_columns(), o.normal_derivative(z))]
    by_motion = None
    if isinstance(o, ObstacleOperators):
        by_motion = np.einsum("jc,jcm->jm", z, o.dn_dq)
    return _by_nodes(contact, dofs, blocks, by_motion, o.n)


def z_tau_derivative(contact: Interface, dofs: Dofs) -> NodalDerivative:
    """Derivative of the shears z_tau (local)."""
    o, z = contact.operators, contact.z
    blocks = [rows_at_nodes(o.slave, o.normal_columns(), o.tangential_derivative(z))]
    by_motion = None
    if isinstance(o, ObstacleOperators):
        by_motion = z[:, 1:] * o.dn_dq[:, 0] - z[:, :1] * o.dn_dq[:, 1]
    return _by_nodes(contact, dofs, blocks, by_motion, o.tau)


def slip_derivative(contact: Interface, dofs: Dofs) -> NodalDerivative:
    """Derivative of the step's slip at constant gaps, zero on symmetry planes.

    Collective at first access.
    """
    assert isinstance(contact, Contact)
    o, partners = contact.operators, contact.partners
    turned = o.tangential_derivative(partners.rotated(o))
    blocks = [rows_at_nodes(o.slave, o.normal_columns(), turned), *partners.derivative(o)]
    by_motion = None
    if isinstance(o, ObstacleOperators):
        by_motion = partners.derivative_by_motions(o)
    return off_planes(_by_nodes(contact, dofs, blocks, by_motion), contact)


DERIVATIVES = {
    "weight": weight_derivative,
    "gap": gap_derivative,
    "z_n": z_n_derivative,
    "z_tau": z_tau_derivative,
    "slip": slip_derivative,
}


def off_planes(derivative: NodalDerivative, contact: Contact) -> NodalDerivative:
    """The derivative of slip with zeros at nodes on symmetry planes (local)."""
    kept = np.where(np.isfinite(contact.plane_normals[:, 0]), 0.0, 1.0)
    blocks = [
        Block(block.rows, block.columns, block.values * kept[block.rows][:, :, None])
        for block in derivative.blocks
    ]
    by_z, by_motion = kept[:, None] * derivative.by_z, kept[:, None] * derivative.by_motion
    return NodalDerivative(derivative.dofs, blocks, by_z, by_motion)


def _by_nodes(
    contact: Interface,
    dofs: Dofs,
    blocks: Sequence[Block],
    by_motion: Array | None = None,
    by_z: Array | None = None,
) -> NodalDerivative:
    """The derivative, zero for arguments that are ``None`` (local)."""
    count = contact.slave.num_nodes
    by_z = np.zeros((count, 2)) if by_z is None else by_z
    return NodalDerivative(
        dofs, blocks, by_z, np.zeros((count, 3)) if by_motion is None else by_motion
    )


def moment(contact: Interface, about: Array) -> float:
    """Moment of the contact forces on the slave body [stress length^2] (collective)."""
    force, _ = _fields(contact).forces
    r = contact.operators.x - about
    return -float((r[:, 0] * force[:, 1] - r[:, 1] * force[:, 0]).sum())


def moment_gradient(contact: Interface, about: Array) -> PairVector:
    """Derivative of ``moment`` about a point (2,) with respect to the state (collective)."""
    o, z = contact.operators, contact.z
    force, _ = _fields(contact).forces
    r = o.x - about
    turned = np.stack([-r[:, 1], r[:, 0]], axis=1)
    by_x = -np.stack([force[:, 1], -force[:, 0]], axis=1)
    by_z = -o.jump(turned, np.zeros((contact.master.num_nodes, 2)))
    total = zero_of(contact)._replace(on_slave=by_x, z=by_z)
    if o.linearization.frozen:
        return total
    dofs = Dofs((contact.slave, contact.master))
    block = o.slave_force_derivative(z)
    rows = Block(dofs.indices(block.rows), block.columns, block.values)
    weights = dofs.flat(-turned, np.zeros((contact.master.num_nodes, 2)))
    on_slave, on_master = dofs.split(dofs.back([rows], weights))
    return total.plus(zero_of(contact)._replace(on_slave=on_slave, on_master=on_master))


def _fields(contact: Interface) -> InterfaceFields:
    return contact.now
