# SPDX-License-Identifier: MIT
"""Vectors of a problem and of its pairs: values at surfaces and obstacles of a ``LinearVector``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.equations.general import ContactEquations
from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.interface.mortar import EXACT
from fenics_mortar.sensitivity.partials.maps import PairVector
from fenics_mortar.utils.arguments import check_number
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError


def zero_vector(equations: ContactEquations) -> LinearVector:
    """The zero vector (local)."""
    z = [np.zeros_like(contact.z) for contact in equations.contacts]
    q = np.zeros(equations.motions.scales.shape)
    return LinearVector(np.zeros(equations.bulk.num_owned), z, q)


def scales_of(equations: ContactEquations, contact: Any) -> tuple[int, Array]:
    """Number of a pair's obstacle; motions per (x, y, angle), (3,) [1, 1, length] (local)."""
    number = equations.motions.obstacles.index(contact.obstacle)
    return number, equations.motions.scales[number]


def at_pair(equations: ContactEquations, i: int, x: LinearVector) -> PairVector:
    """Values of a vector at pair ``i`` (collective)."""
    contact = equations.contacts[i]
    none = np.zeros_like(contact.z)
    u = np.zeros(equations.bulk.num_owned) if x.u is None else x.u
    motion = np.zeros(3)
    if contact.obstacle is not None and x.q is not None:
        number, scales = scales_of(equations, contact)
        motion = x.q[number] * scales
    on_slave, on_master = contact.slave.gather(u), contact.master.gather(u)
    return PairVector(on_slave, on_master, none if x.z is None else x.z[i], motion)


def add_pair(equations: ContactEquations, i: int, x: LinearVector, pair: PairVector) -> None:
    """Add values at pair ``i`` to a vector of ``zero_vector``: transpose of ``at_pair`` (local)."""
    contact = equations.contacts[i]
    u, z, q = x.u, x.z, x.q
    assert u is not None and z is not None and q is not None
    contact.slave.scatter_add(pair.on_slave, u)
    contact.master.scatter_add(pair.on_master, u)
    z[i][:] += pair.z
    if contact.obstacle is not None:
        number, scales = scales_of(equations, contact)
        q[number] += pair.motion * scales


def from_rows(equations: ContactEquations, rows: dict[int, Array]) -> LinearVector:
    """Residuals with given rows of multipliers, (slave nodes, 2) by number of the pair (local)."""
    none = zero_vector(equations)
    z = [rows.get(i, np.zeros_like(contact.z)) for i, contact in enumerate(equations.contacts)]
    return LinearVector(none.u, z, none.q)


def rows_at(x: LinearVector, i: int, contact: Any) -> Array:
    """Rows of the multipliers of pair ``i``, (slave nodes, 2) [unit of x.z] (local)."""
    z: Sequence[Array] | None = x.z
    return np.zeros_like(contact.z) if z is None else z[i]


class OfPair:
    """Part of controls and quantities of one pair.

    Args:
        pair: Number of the pair.
    """

    def __init__(self, pair: int) -> None:
        self.pair = pair

    def check(self) -> None:
        """Check the number of the pair, in a call made on all ranks (local).

        Raises:
            ValueError: If it is not a number of a pair.
        """
        expected = "the number of a pair, from 0 on"
        check_number("pair", self.pair, expected, lambda i: i >= 0, whole=True)


def interface_of(equations: ContactEquations, i: int) -> Interface:
    """Contact or tie of the pair with number ``i`` (local).

    Raises:
        ValueError: If there is no such pair.
    """
    count = len(equations.contacts)
    if not isinstance(i, (int, np.integer)) or not 0 <= i < count:
        raise ValueError(f"pair {i!r}: expected a number from 0 to {count - 1}, in order of pairs")
    return equations.contacts[i]


def contact_of(equations: ContactEquations, i: int) -> Contact:
    """Contact of the pair with number ``i`` (local).

    Raises:
        ValueError: If there is no such pair, or it is a tie.
    """
    contact = interface_of(equations, i)
    if not isinstance(contact, Contact):
        raise ValueError(f"pair {i} is tied: expected a contact")
    return contact


def check_exact(contact: Any) -> None:
    """Raise an error if the operators of a contact lack derivatives (local, equal on all ranks).

    Raises:
        MortarError: If terms of the linearization are left out.
    """
    terms = contact.operators.linearization
    if isinstance(contact, Contact) and contact.pair.sliding == "small":
        if (contact.now.decreases_fast & contact.attracted).any():
            raise MortarError(
                "adhesion that decreases fast with the gap has no derivative with "
                "sliding='small': expected "
                "sliding='finite'"
            )
    elif terms != EXACT:
        raise MortarError(f"operators with {terms}: derivatives of a solution need {EXACT}")
