# SPDX-License-Identifier: MIT
"""Derivative of a contact's rows by parameters of its law, by complex steps.

A law names its parameters, numbers or arrays, in ``Law.parameters``. Its residual rho and its
adhesion are evaluated with a parameter p + i h d: the imaginary part over h is the derivative along
d, exact up to rounding. Functions such as ``abs`` are not analytic; a result that contradicts
difference quotients on both sides is therefore refused. Branches are fixed.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.laws import Law, Nodal
from fenics_mortar.utils.arguments import check_choice
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import call_together
from fenics_mortar.utils.rounding import EPSILON

# Arguments of a law that its residual depends on.
ARRAYS = ("gap", "slip", "z_n", "z_tau", "stiffness", "c_n")
# Complex step [1]: its square is below the rounding of any number that is not tiny itself.
STEP = 1e-30
# Real step of difference quotients, relative to the parameter, and largest relative difference to
# the complex step [1]: errors of the quotients are of the order of the step.
QUOTIENT, ALIKE = 1e-6, 1e-3


def parameter(law: Law, name: str) -> Array:
    """Value of a parameter of the law, any shape (local).

    Raises:
        ValueError: If the law has no such parameter.
    """
    check_choice(f"parameter of {law!r}", name, law.parameters)
    return np.asarray(getattr(law, name), float)


def with_parameter(law: Law, name: str, value: Any) -> Law:
    """Copy of the law with another value of a parameter (local)."""
    other = copy(law)
    setattr(other, name, value if np.ndim(value) else np.asarray(value).item())
    return other


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
    words = f"the derivative of {contact.pair.law!r} by '{name}'"
    residual, adhesion = call_together(
        contact.slave.comm, words, lambda: _derivatives(contact, name, np.asarray(direction))
    )
    f = contact.now
    _, _, along, opening = contact.frame()
    applies = contact.follows_law & ~f.attracted & ~f.state.redundant
    return -along * np.where(applies, residual, 0.0)[:, None] - opening * adhesion[:, None]


def parameter_by_rows(contact: Contact, name: str, rows: Array) -> Array:
    """Gradient of the sum of the rows times ``rows``, shape of the parameter (collective)."""
    value = parameter(contact.pair.law, name)
    gradient = np.zeros(value.size)
    for i, unit in enumerate(np.eye(value.size)):
        gradient[i] = (rows * rows_by_parameter(contact, name, unit.reshape(value.shape))).sum()
    return gradient.reshape(value.shape)


def _derivatives(contact: Contact, name: str, direction: Array) -> tuple[Array, Array]:
    """Derivatives of rho and of the adhesion along a direction, each (slave nodes,) (local)."""
    law, f = contact.pair.law, contact.now
    value = parameter(law, name)
    if not law.has_friction:
        residual = np.zeros(len(f.state.z))
    else:
        residual = _differentiate(law, name, value, direction, lambda other: _rho(other, f))
    if not law.has_adhesion:
        return residual, np.zeros_like(residual)
    pull = _differentiate(law, name, value, direction, lambda other: _adhesion(other, f.mean_gap))
    return residual, np.where(f.attracted, pull, 0.0)


def _rho(law: Law, f: Any) -> Any:
    """Residual of the law; its arguments are complex, so that its arrays may be."""
    node: Nodal = f.nodal
    arguments: dict[str, Any] = {name: getattr(node, name).astype(complex) for name in ARRAYS}
    own = {name for name in law.parameters if isinstance(getattr(law, name), np.ndarray)}
    arguments["fields"] = {name: v for name, v in node.fields.items() if name not in own}
    return law.tangential(replace(node, **arguments), f.state.branch).residual


def _adhesion(law: Law, gap: Array) -> Any:
    """Adhesion as in the rows: continued linearly to negative gaps."""
    pull, by_gap = law.adhesion(np.maximum(gap, 0.0).astype(complex))
    return pull + by_gap * np.minimum(gap, 0.0)


def _differentiate(
    law: Law, name: str, value: Array, direction: Array, function: Callable[[Law], Any]
) -> Array:
    """Derivative by complex step, compared with difference quotients (local)."""
    if not direction.any():
        return np.zeros(np.shape(function(law)))
    changed = function(with_parameter(law, name, value + 1j * STEP * direction))
    derivative = np.array(np.imag(changed), float) / STEP
    if not np.isfinite(value).all():  # an infinite limit is not reached
        return derivative
    size = np.abs(value).max(initial=0.0) or 1.0
    step = QUOTIENT * size / np.abs(direction).max()
    start = np.real(function(law))
    errors = []
    for sign in (step, -step):
        moved = np.real(function(with_parameter(law, name, value + sign * direction)))
        errors.append(np.abs((moved - start) / sign - derivative))
    rounding = 10.0 * EPSILON * np.abs(start).max(initial=0.0) / step
    allowed = ALIKE * np.abs(derivative).max(initial=0.0) + rounding
    if np.minimum(*errors).max(initial=0.0) > allowed:
        raise ValueError(
            f"{law!r}: the complex step by '{name}' contradicts difference quotients; expected "
            "tangential and adhesion to be analytic in the parameter, without abs, real parts or "
            "conversions to float"
        )
    return derivative
