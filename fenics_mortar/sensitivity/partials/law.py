# SPDX-License-Identifier: MIT
"""Derivative of a contact's rows with respect to parameters of its law, by complex steps.

The parameters of a law, numbers or arrays, are listed in ``Law.parameters``; those that vary in
space are represented by their values at the slave nodes. The law is evaluated with a parameter
p + i h d: the imaginary part over h is the derivative along d, exact up to rounding. Functions such
as ``abs`` are not analytic; a result that contradicts difference quotients on both sides is
therefore rejected. Branches are fixed, and so is the law's memory.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.contact.law import Law
from fenics_mortar.contact.law_fields import LawFields
from fenics_mortar.contact.nodal import COMPLEX_STEP
from fenics_mortar.utils.arguments import check_choice
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import call_together
from fenics_mortar.utils.rounding import EPSILON

# Steps of difference quotients, relative to the parameter [1]: errors of the quotients are of the
# order of the step. The shorter steps are for nodes near a kink, and for parameters that are zero
# at all nodes. The square root of the largest one is the largest relative difference from the
# complex step.
QUOTIENTS = (1e-6, 1e-9, 1e-12)


# Arguments of laws that are converted to complex numbers, so that arrays created like them are
# complex.
NUMBERS = ("gap", "slip", "z_n", "z_tau", "stiffness", "c_n")


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


def rows_by_parameter(contact: Contact, name: str, direction: Array) -> Array:
    """Change of the rows along a direction of a parameter (collective).

    Args:
        contact: The contact, evaluated.
        name: Name of the parameter.
        direction: Shape of the parameter, in its unit.

    Returns:
        Shape (slave nodes, 2) [stress length].

    Raises:
        ValueError: On all ranks, if the law has no such parameter, or cannot be differentiated.
    """
    law, f = contact.pair.law, contact.now
    value, direction = parameter(contact, name), np.asarray(direction, float)
    memory = f.nodal.memory

    def residuals(changed: Any) -> Array:
        if name in law.varying:
            return _residuals(law, f, {**contact.parameters, name: changed}, memory)
        return _residuals(with_parameter(law, name, changed), f, contact.parameters, memory)

    return _rows_of(contact, name, value, direction, residuals)


def rows_by_memory(contact: Contact, name: str) -> Array:
    """Derivative of the rows of each node by its memory at the start of the step (collective).

    Args:
        contact: The contact, evaluated.
        name: Name in ``Law.memory``.

    Returns:
        Shape (slave nodes, 2) [stress length over the unit of the memory].

    Raises:
        ValueError: On all ranks, if the law cannot be differentiated.
    """
    law, f, memory = contact.pair.law, contact.now, contact.now.nodal.memory
    value = np.asarray(memory[name])
    return _rows_of(
        contact, name, value, np.ones_like(value),
        lambda changed: _residuals(law, f, contact.parameters, {**memory, name: changed}),
    )  # fmt: skip


def _rows_of(
    contact: Contact,
    name: str,
    value: Array,
    direction: Array,
    residuals: Callable[[Any], Array],
) -> Array:
    """Change of the rows with ``residuals`` of a changed value (collective)."""
    law, f = contact.pair.law, contact.now
    what = f"the derivative of {law!r} by '{name}'"
    stress, gap = np.abs(f.state.z).max(initial=0.0), np.abs(f.mean_gap).max(initial=0.0)
    changes = call_together(
        contact.slave.comm,
        what,
        lambda: differentiate(
            f"{law!r}: the complex step by '{name}'", value, direction, residuals,
            (stress, stress, gap),
        ),
    )  # fmt: skip
    follows_law = contact.follows_law & (law.bridges_gap | ~f.attracted)
    applies = follows_law & ~f.state.redundant, f.attracted, f.covered
    rows = np.zeros_like(f.state.z)
    for scaled, change, on in zip(contact.rows.frame()[2:], changes, applies, strict=False):
        rows -= scaled * np.where(on, change, 0.0)[:, None]
    return rows


def rows_by_weight(contact: Contact, name: str) -> Array:
    """Change of the rows with the factor of a weight, at 1 (collective).

    Args:
        contact: The contact, evaluated.
        name: "c_n", or "stiffness" k, which is also a weight of the rows of closed gaps and the
            stiffness of redundant sticks.

    Returns:
        Shape (slave nodes, 2) [stress length].

    Raises:
        ValueError: On all ranks, if the law cannot be differentiated.
    """
    law, f = contact.pair.law, contact.now
    given, one = (f.of_geometry if isinstance(f, LawFields) else f.nodal), np.array(1.0)
    weight = getattr(given, name)

    def residuals(factor: Any) -> Array:
        changed = {name: factor * weight.astype(complex)}
        return _residuals(law, f, contact.parameters, given.memory, changed)

    rows = _rows_of(contact, name, one, one, residuals)
    if name == "stiffness":
        normal, _, along, _, *closing = contact.rows.frame()
        elastic = np.where(f.state.redundant, -given.stiffness * f.slip, 0.0)
        rows += normal * f.operators.gap[:, None] - along * elastic[:, None]
        for scaled, row in zip(closing, f.law_rows[2:], strict=True):
            rows -= scaled * row.residual[:, None]
    return rows


def parameter_by_rows(contact: Contact, name: str, rows: Array) -> Array:
    """Gradient of the sum of the rows times ``rows``, of the parameter's shape (collective).

    In the unit of ``rows`` times [stress length] over that of the parameter.
    """
    value = parameter(contact, name)
    if name in contact.pair.law.varying:  # the rows of a node depend only on its value
        return np.einsum("jc,jc->j", rows, rows_by_parameter(contact, name, np.ones_like(value)))
    gradient = np.zeros(value.size)
    for i, unit in enumerate(np.eye(value.size)):
        gradient[i] = (rows * rows_by_parameter(contact, name, unit.reshape(value.shape))).sum()
    return gradient.reshape(value.shape)


def with_parameter(law: Law, name: str, value: Any) -> Law:
    """Copy of the law with another value of a parameter (local)."""
    other = copy(law)
    setattr(other, name, value if np.ndim(value) else np.asarray(value).item())
    return other


def _residuals(
    law: Law,
    f: ContactFields,
    fields: Mapping[str, Any],
    memory: Mapping[str, Any],
    changed: Mapping[str, Any] | None = None,
) -> Array:
    """Tangential residual, adhesion and closing gap, complex, (3, slave nodes) (local)."""
    given = f.of_geometry if isinstance(f, LawFields) else f.nodal
    numbers: dict[str, Any] = {name: getattr(given, name).astype(complex) for name in NUMBERS}
    node = replace(given, fields=fields, memory=memory, **{**numbers, **(changed or {})})
    found = np.zeros((3, len(f.state.z)), complex)
    if law.has_closing_gap:
        node = replace(node, gap=np.where(f.covered, law.closing_gap(node).residual, node.gap))
    if law.has_friction:
        found[0] = law.tangential(node, f.state.branch).residual
    if law.has_adhesion:
        opened = replace(node, gap=np.maximum(node.gap, 0.0))
        found[1] = law.adhesion_at(opened).residual + f.adhesion[1] * np.minimum(node.gap, 0.0)
    found[2] = node.gap
    return found


def differentiate(
    what: str,
    value: Array,
    direction: Array,
    function: Callable[[Any], Array],
    terms: Any = 0.0,
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
