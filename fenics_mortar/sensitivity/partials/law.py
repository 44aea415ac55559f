# SPDX-License-Identifier: MIT
"""Derivatives of a law, in the rows of a contact and in its memory, by complex steps.

The residuals of the rows and the memory h_k = H(g, slip, z_n, z_tau; h_{k-1}, p) at the end of a
step depend on the mean gap, which the closing gap replaces as in ``Law.remember``, on slip and
multiplier, on the memory before and on the parameters p of the law. Parameters, numbers or arrays,
are listed in ``Law.parameters``; those that vary in space are represented by their values at the
slave nodes. The law is evaluated with a number p + i h d: the imaginary part over h is the
derivative along d, exact up to rounding. Functions such as ``abs`` are not analytic; a result that
contradicts difference quotients on both sides is therefore rejected. Branches are fixed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.contact.law import COMPLEX_STEP, Law, Nodal
from fenics_mortar.contact.space_fields import LawFields
from fenics_mortar.sensitivity.partials.fields import Matrix, by_node, over_weights
from fenics_mortar.utils.arrays import EPSILON, Array
from fenics_mortar.utils.errors import call_together, check_choice

# Steps of difference quotients, relative to the parameter [1]: errors of the quotients are of the
# order of the step. The shorter steps are for nodes near a kink, and for parameters that are zero
# at all nodes. The square root of the largest one is the largest relative difference from the
# complex step.
QUOTIENTS = (1e-6, 1e-9, 1e-12)
# Arguments of laws that are converted to complex numbers, so that arrays created like them are
# complex.
NUMBERS = ("gap", "slip", "z_n", "z_tau", "stiffness", "c_n")

# Law and arguments changed by a number or array, from its value.
At = Callable[[Any], tuple[Law, Mapping[str, Any]]]
# Change of n values of each node, shape (slave nodes, n), along a direction of a named value.
Response = Callable[[Contact, str, Array, Array, At], Array]


def parameter(contact: Contact, name: str) -> Array:
    """Value of a parameter of the law, any shape [its unit] (local).

    Shape (slave nodes,) if it varies in space.

    Raises:
        ValueError: If the law has no such parameter.
    """
    law = contact.pair.law
    check_choice(f"parameter of {law!r}", name, law.parameters)
    if name in law.varying:
        return contact.parameters[name].copy()
    return np.asarray(getattr(law, name), float)


def by_parameter(contact: Contact, name: str, response: Response) -> Matrix:
    """Derivative of rows or memory with respect to a parameter of the law (collective).

    Args:
        contact: The contact, evaluated.
        name: Name of the parameter.
        response: ``change_of_rows`` or ``change_of_memory``.

    Returns:
        Shape (d slave nodes or number of names in memory * slave nodes, numbers of the parameter).

    Raises:
        ValueError: On all ranks, if the law has no such parameter, or cannot be differentiated.
    """
    law, value = contact.pair.law, parameter(contact, name)

    def at(changed: Any) -> tuple[Law, Mapping[str, Any]]:
        if name in law.varying:
            return law, {"fields": {**contact.parameters, name: changed}}
        other = copy(law)
        setattr(other, name, changed if np.ndim(changed) else np.asarray(changed).item())
        return other, {}

    if name in law.varying:  # a node depends only on its own value
        return by_node(response(contact, name, value, np.ones_like(value), at)[:, :, None])
    units = np.eye(value.size).reshape(value.size, *value.shape)
    columns = [response(contact, name, value, unit, at).ravel() for unit in units]
    return Matrix.dense(np.column_stack(columns))


@dataclass(frozen=True)
class PairMemory:
    """Derivatives of the memory of a law at the end of a step, and with respect to that before.

    Local. The memory has c names.

    Attributes:
        by_fields: Derivatives with respect to the fields of ``fields``, (slave nodes, c) each.
        by_before: With respect to the memory before, shape (slave nodes c, slave nodes c).
        rows: Of the rows with respect to the memory before, shape (d slave nodes, slave nodes c).
    """

    by_fields: dict[str, Array]
    by_before: Matrix
    rows: Matrix


def memory_of_pair(contact: Contact) -> PairMemory:
    """Derivatives of the memory of a contact, evaluated at the end of the step (collective).

    Raises:
        ValueError: On all ranks, if the law cannot be differentiated.
    """
    law, f = contact.pair.law, contact.now
    given = _arguments(f)

    def by(response: Response, name: str, value: Array, at: At) -> Array:
        return response(contact, name, value, np.ones_like(value), at)

    def by_argument(name: str) -> Array:
        return by(
            change_of_memory, name, getattr(given, name), lambda changed: (law, {name: changed})
        )

    def at_memory(name: str, changed: Any) -> tuple[Law, Mapping[str, Any]]:
        return law, {"memory": {**given.memory, name: changed}}

    def by_own(response: Response) -> Matrix:
        before = [(name, np.asarray(given.memory[name])) for name in law.memory]
        parts = [by(response, name, value, partial(at_memory, name)) for name, value in before]
        return by_node(np.stack(parts, axis=2))

    by_fields = {name: by_argument(name) for name in ("gap", "slip", "z_n", "z_tau")}
    by_mean_gap = by_fields["gap"] + by_fields["slip"] * f.slip_by_gap[:, None]
    gap = by_mean_gap * over_weights(f, np.ones(len(f.state.z)))[:, None]
    by_fields |= {"gap": gap, "weight": -gap * f.mean_gap[:, None]}
    return PairMemory(by_fields, by_own(change_of_memory), by_own(change_of_rows))


def change_of_rows(contact: Contact, name: str, value: Array, direction: Array, at: At) -> Array:
    """Change of the rows along a direction of a value, (slave nodes, d) [stress length].

    Collective.
    """
    law, f = contact.pair.law, contact.now
    stress, gap = np.abs(f.state.z).max(initial=0.0), np.abs(f.mean_gap).max(initial=0.0)
    what = f"{law!r}: the complex step by '{name}'"
    changes = call_together(
        contact.slave.comm,
        f"the derivative of {law!r} by '{name}'",
        lambda: differentiate(
            what, value, direction, lambda changed: _residuals(f, *at(changed)),
            (stress, stress, gap),
        ),
    )  # fmt: skip
    follows_law = contact.follows_law & (law.bridges_gap | ~f.attracted)
    applies = follows_law & ~f.state.redundant, f.attracted, f.covered
    total, (_, _, along, *weights) = np.zeros_like(f.state.z), contact.rows.frame()
    if contact.slave.dim == 3:  # the row across the law's direction is that of no law
        del weights[0]
    for scaled, change, on in zip((along, *weights), changes, applies, strict=False):
        total -= scaled * np.where(on, change, 0.0)[:, None]
    return total


def change_of_memory(contact: Contact, name: str, value: Array, direction: Array, at: At) -> Array:
    """Change of the memory along a direction of a value, (slave nodes, names) [their units].

    Collective.
    """
    law, f = contact.pair.law, contact.now

    def remembered(changed: Any) -> Array:
        other, changes = at(changed)
        result = other.remember(_complex(f, other, changes), f.state.branch)
        return np.array([np.asarray(result[name], complex) for name in law.memory])

    what = f"{law!r}: the complex step of remember by '{name}'"
    made = call_together(
        contact.slave.comm,
        f"the derivative of {law!r} by the state",
        lambda: differentiate(what, value, direction, remembered),
    )
    return np.asarray(made).T


def _arguments(f: ContactFields) -> Nodal:
    """Arguments of the law with the mean gap (local)."""
    return f.of_geometry if isinstance(f, LawFields) else f.nodal


def _complex(f: ContactFields, law: Law, changes: Mapping[str, Any]) -> Nodal:
    """Changed complex arguments of a law, with its closing gap in place of the gap (local)."""
    given = _arguments(f)
    numbers = {name: getattr(given, name).astype(complex) for name in NUMBERS}
    node = replace(given, **{**numbers, **changes})
    if not law.has_closing_gap:
        return node
    return replace(node, gap=np.where(f.covered, law.closing_gap(node).residual, node.gap))


def _residuals(f: ContactFields, law: Law, changes: Mapping[str, Any]) -> Array:
    """Tangential residual, adhesion and closing gap, complex, (3, slave nodes) (local)."""
    node = _complex(f, law, changes)
    found = np.zeros((3, len(f.state.z)), complex)
    if law.has_friction:
        found[0] = law.tangential(node, f.state.branch).residual
    if law.has_adhesion:
        opened = replace(node, gap=np.maximum(node.gap, 0.0))
        found[1] = law.adhesion_at(opened).residual + f.adhesion[1] * np.minimum(node.gap, 0.0)
    found[2] = node.gap
    return found


def differentiate(
    what: str, value: Array, direction: Array, function: Callable[[Any], Array], terms: Any = 0.0
) -> Array:
    """Derivative by complex step, compared with difference quotients (local).

    Units are those of the result [any]. ``terms``: size of the terms whose sums are the rows of the
    result, for their rounding, shape (rows,).

    Raises:
        ValueError: If they contradict each other; ``what`` describes the derivative.
    """
    start = np.real(function(value))
    if not direction.any():
        return np.zeros_like(start)
    derivative = np.imag(function(value + 1j * COMPLEX_STEP * direction)) / COMPLEX_STEP
    if not np.isfinite(value).all():  # an infinite limit is not reached
        return derivative
    size = np.abs(value).max(initial=0.0) or 1.0
    contradicts = np.ones_like(start, bool)
    for quotient in QUOTIENTS:
        step = quotient * size / np.abs(direction).max()
        rounding = 10.0 * EPSILON * np.maximum(np.abs(start).max(axis=1), terms) / step
        allowed = np.sqrt(QUOTIENTS[0]) * np.abs(derivative).max(axis=1) + rounding
        for sign in (step, -step):
            moved = np.real(function(value + sign * direction))
            contradicts &= np.abs((moved - start) / sign - derivative) > allowed[:, None]
        if not contradicts.any():
            break
    if contradicts.any():
        raise ValueError(
            f"{what} contradicts difference quotients; expected the law to be analytic in the "
            "parameter, without abs, real parts or conversions to float"
        )
    return derivative
