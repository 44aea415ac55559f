# SPDX-License-Identifier: MIT
"""Linear operators that act on each pair of a problem by a small matrix.

Vectors of a problem are restricted to its pairs, multiplied by the matrices of the pairs, and the
products are collected to a vector of the problem. Collecting is the transpose of restricting;
therefore the transposed operator has the transposed matrices and the two kinds of vectors swapped.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.equations.general import ContactEquations
from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.interface.mortar import EXACT
from fenics_mortar.sensitivity.partials.maps import Layout, Matrix
from fenics_mortar.utils.arguments import check_number
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError


@dataclass(frozen=True)
class Vectors:
    """A kind of vectors of a problem.

    Attributes:
        at: Part of a vector at a pair with a number, flat; ``None`` if it is zero.
        collect: Vector from its parts by the numbers of the pairs.
    """

    at: Callable[[ContactEquations, int, Any], Array | None]
    collect: Callable[[ContactEquations, dict[int, Array]], Any]


@dataclass(frozen=True)
class PairOperator:
    """Operator with one matrix for each pair, and its transpose; see ``pair_vectors``.

    Attributes:
        equations: The equations.
        matrices: Matrices by the numbers of their pairs.
        source: Kind of the vectors that it is applied to.
        target: Kind of the results.
    """

    equations: ContactEquations
    matrices: dict[int, Matrix]
    source: Vectors
    target: Vectors

    def __matmul__(self, x: Any) -> Any:
        """Product with a vector (collective)."""
        e, parts = self.equations, {}
        for i, matrix in self.matrices.items():
            part = self.source.at(e, i, x)
            if part is not None:
                parts[i] = matrix @ part
        return self.target.collect(e, parts)

    @property
    def T(self) -> PairOperator:
        """The transpose (local)."""
        matrices = {i: matrix.T for i, matrix in self.matrices.items()}
        return PairOperator(self.equations, matrices, self.target, self.source)


def _motions_of(equations: ContactEquations, contact: Any) -> tuple[int, Array]:
    """Number of a pair's obstacle; motions per value of its place, (m,) [1, length] (local)."""
    number = equations.motions.obstacles.index(contact.obstacle)
    return number, equations.motions.scales[number]


def at_pair(equations: ContactEquations, i: int, x: LinearVector) -> Array:
    """Values of a vector at pair ``i``, see ``partials.maps`` (collective)."""
    contact = equations.contacts[i]
    layout = Layout(contact)
    values = np.zeros(layout.size)
    if x.u is not None:
        values[layout.on_slave] = contact.slave.gather(x.u).ravel()
        values[layout.on_master] = contact.master.gather(x.u).ravel()
    if x.z is not None:
        values[layout.z] = x.z[i].ravel()
    if contact.obstacle is not None and x.q is not None:
        number, scales = _motions_of(equations, contact)
        values[layout.motion] = x.q[number] * scales
    return values


def from_pairs(equations: ContactEquations, parts: dict[int, Array]) -> LinearVector:
    """Sum of values at pairs: transpose of ``at_pair`` (local)."""
    u, q = np.zeros(equations.bulk.num_owned), np.zeros(equations.motions.scales.shape)
    z = [np.zeros_like(contact.z) for contact in equations.contacts]
    for i, values in parts.items():
        contact = equations.contacts[i]
        layout = Layout(contact)
        contact.slave.scatter_add(values[layout.on_slave].reshape(-1, layout.dim), u)
        contact.master.scatter_add(values[layout.on_master].reshape(-1, layout.dim), u)
        z[i] = values[layout.z].reshape(contact.z.shape)
        if contact.obstacle is not None:
            number, scales = _motions_of(equations, contact)
            q[number] += values[layout.motion] * scales
    return LinearVector(u, z, q)


def _rows_at(_: ContactEquations, i: int, x: LinearVector) -> Array | None:
    return None if x.z is None else x.z[i].ravel()


def _from_rows(equations: ContactEquations, parts: dict[int, Array]) -> LinearVector:
    none = [np.zeros(contact.z.size) for contact in equations.contacts]
    shapes = [contact.z.shape for contact in equations.contacts]
    return LinearVector(z=[parts.get(i, none[i]).reshape(shape) for i, shape in enumerate(shapes)])


# Vectors of unknowns or of all residuals; residuals of the rows of the multipliers alone; values by
# pair, as of the memory of laws.
UNKNOWNS = Vectors(at_pair, from_pairs)
ROWS = Vectors(_rows_at, _from_rows)
BY_PAIR = Vectors(lambda _, i, x: x.get(i), lambda _, parts: parts)


def values_of(shape: tuple[int, ...]) -> Vectors:
    """Vectors of replicated values of a control of a shape (local)."""

    def collect(_: ContactEquations, parts: dict[int, Array]) -> Array:
        return sum(parts.values(), np.zeros(int(np.prod(shape)))).reshape(shape)

    return Vectors(lambda _, i, x: np.ravel(x), collect)


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
        MortarError: If it ties fields.
    """
    count = len(equations.contacts)
    if not isinstance(i, (int, np.integer)) or not 0 <= i < count:
        raise ValueError(f"pair {i!r}: expected a number from 0 to {count - 1}, in order of pairs")
    contact = equations.contacts[i]
    if contact.z.shape[1] > contact.slave.dim:
        raise MortarError(
            f"pair {i} ties fields: quantities of it have no derivatives; expected a UFL form"
        )
    return contact


def contact_of(equations: ContactEquations, i: int) -> Contact:
    """Contact of the pair with number ``i`` (local).

    Raises:
        ValueError: If there is no such pair, or it is a tie.
    """
    contact = interface_of(equations, i)
    if not isinstance(contact, Contact):
        raise ValueError(f"pair {i} is tied: expected a contact")
    return contact


def refuse_fluxes(contact: Any, name: str) -> None:
    """Raise an error for a control on which fluxes across a contact depend (local).

    Raises:
        MortarError: On all ranks.
    """
    if contact.fluxes:
        raise MortarError(
            f"{name}: fluxes across {contact.pair!r} have no derivative by this control; those by "
            "constants and functions of the residual, parameters of laws, obstacles' motions and "
            "ConductanceScale are available"
        )


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
