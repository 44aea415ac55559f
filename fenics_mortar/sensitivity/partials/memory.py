# SPDX-License-Identifier: MIT
"""Derivatives of a law's memory at the end of a step, and derivatives by the initial memory.

The memory h_k = H(g, slip, z_n, z_tau; h_{k-1}, p) of a node depends on its mean gap, slip,
multiplier, memory before and the parameters p of the law; as in ``Law.remember`` the closing gap
replaces the gap. H is differentiated by complex steps, which are compared with difference
quotients. Branches are fixed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.contact.law import Law
from fenics_mortar.contact.law_fields import LawFields
from fenics_mortar.sensitivity.partials.fields import DERIVATIVES, ByFields
from fenics_mortar.sensitivity.partials.history import PairHistory
from fenics_mortar.sensitivity.partials.law import (
    NUMBERS,
    differentiate,
    parameter,
    rows_by_memory,
    with_parameter,
)
from fenics_mortar.sensitivity.partials.maps import Dofs, PairVector
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import call_together

# Arguments of the memory that depend on the state; the gap is the geometric mean gap.
ARGUMENTS = ("gap", "slip", "z_n", "z_tau")


class PairMemory:
    """Derivatives of the memory of one pair; constructor and methods are collective.

    Args:
        contact: The contact, evaluated at the end of the step.
        history: Derivative of its rows with respect to the state before, ``None`` if the state
            before is fixed.
    """

    def __init__(self, contact: Contact, history: PairHistory | None) -> None:
        self._contact, self._history = contact, history
        self._what = f"the derivative of {contact.pair.law!r} by the state"
        f, names = contact.now, contact.pair.law.memory
        given = _given(f)
        self._by = {name: self._differentiate(name, getattr(given, name)) for name in ARGUMENTS}
        self._by_memory = {name: self._by_own(name) for name in names}
        self._rows = {name: rows_by_memory(contact, name) for name in names}

    def _differentiate(self, name: str, value: Array) -> Array:
        """Derivative of the memory with respect to an argument, (names, slave nodes)."""
        contact, law, f = self._contact, self._contact.pair.law, self._contact.now

        def found() -> Array:
            return differentiate(
                f"{law!r}: the complex step of remember by '{name}'", value, np.ones_like(value),
                lambda changed: _updated_memory(law, f, contact.parameters, {name: changed}),
            )  # fmt: skip

        return np.asarray(call_together(contact.slave.comm, self._what, found))

    def _by_own(self, name: str) -> Array:
        """Derivative of the memory with respect to that before, (names, slave nodes)."""
        contact, law, f = self._contact, self._contact.pair.law, self._contact.now
        memory = _given(f).memory
        value = np.asarray(memory[name])

        def found() -> Array:
            return differentiate(
                f"{law!r}: the complex step of remember by '{name}'", value, np.ones_like(value),
                lambda changed: _updated_memory(
                    law, f, contact.parameters, {"memory": {**memory, name: changed}}
                ),
            )  # fmt: skip

        return np.asarray(call_together(contact.slave.comm, self._what, found))

    def along_state(self, direction: PairVector) -> Array:
        """Change with the state at the end of the step, (names, slave nodes) [their units]."""
        dofs = Dofs((self._contact.slave, self._contact.master))
        made = {name: DERIVATIVES[name](self._contact, dofs).along(direction) for name in FIELDS}
        return self.along_fields(made)

    def along_fields(self, changes: Mapping[str, Array]) -> Array:
        """Change (names, slave nodes) [their units] with changes of fields; gaps are weighted."""
        o, f = self._contact.operators, self._contact.now
        none = np.zeros(len(o.x))
        weighted = changes.get("gap", none) - f.mean_gap * changes.get("weight", none)
        gap = np.where(f.covered, weighted / np.where(f.covered, o.weight, 1.0), 0.0)
        total = self._by["gap"] * gap
        slip = changes.get("slip", none) + f.slip_by_gap * gap
        total = total + self._by["slip"] * slip
        for name in ARGUMENTS[2:]:
            total = total + self._by[name] * changes.get(name, none)
        return total

    def fields_back(self, c: Array) -> ByFields:
        """Transpose of ``along_fields`` for weights ``c`` (names, slave nodes)."""
        o, f = self._contact.operators, self._contact.now
        by = {name: (self._by[name] * c).sum(axis=0) for name in ARGUMENTS}
        per_weight = np.where(f.covered, 1.0 / np.where(f.covered, o.weight, 1.0), 0.0)
        gap = (by["gap"] + by["slip"] * f.slip_by_gap) * per_weight
        return ByFields(-gap * f.mean_gap, gap, by["z_n"], by["z_tau"], by["slip"])

    def state_back(self, c: Array) -> PairVector:
        """Transpose of ``along_state``; ``c``: (names, slave nodes)."""
        return self.fields_back(c).gradient(self._contact)

    def along_before(self, direction: PairVector) -> Array:
        """Change with the state that slip is counted from, (names, slave nodes) [their units]."""
        if self._history is None:
            return np.zeros_like(self._by["slip"])
        return self._by["slip"] * self._history.slip.along(direction)

    def before_back(self, c: Array) -> PairVector | None:
        """Transpose of ``along_before``, ``c``: (names, slave nodes); ``None`` if that is fixed."""
        if self._history is None:
            return None
        return self._history.slip.back((self._by["slip"] * c).sum(axis=0))

    def along_memory(self, dh: Array) -> Array:
        """Change with the memory before, (names, slave nodes) [their units]."""
        return np.sum([by * d for by, d in zip(self._by_memory.values(), dh, strict=True)], axis=0)

    def memory_back(self, c: Array) -> Array:
        """Transpose of ``along_memory``; both arrays are (names, slave nodes) [1 / their units]."""
        return np.array([(by * c).sum(axis=0) for by in self._by_memory.values()])

    def rows_along(self, dh: Array) -> Array:
        """Change of the rows with the memory before, (slave nodes, 2) [stress length]."""
        pairs = zip(self._rows.values(), dh, strict=True)
        return np.sum([rows * d[:, None] for rows, d in pairs], axis=0)

    def rows_back(self, y: Array) -> Array:
        """Transpose of ``rows_along`` for weights ``y`` (slave nodes, 2) [rows times y]."""
        return np.array([np.einsum("jc,jc->j", rows, y) for rows in self._rows.values()])

    def along_parameter(self, name: str, direction: Array) -> Array:
        """Change with a parameter of the law, (names, slave nodes) [their units]."""
        contact, law, f = self._contact, self._contact.pair.law, self._contact.now

        def at(changed: Any) -> Array:
            if name in law.varying:
                return _updated_memory(law, f, {**contact.parameters, name: changed}, {})
            return _updated_memory(with_parameter(law, name, changed), f, contact.parameters, {})

        what = f"{law!r}: the complex step of remember by '{name}'"
        value = parameter(contact, name)
        return np.asarray(
            call_together(
                contact.slave.comm, self._what, lambda: differentiate(what, value, direction, at)
            )
        )

    def parameter_back(self, name: str, c: Array) -> Array:
        """Transpose of ``along_parameter``, shape of the parameter [1 / its unit]."""
        value = parameter(self._contact, name)
        if name in self._contact.pair.law.varying:
            return np.asarray((c * self.along_parameter(name, np.ones_like(value))).sum(axis=0))
        units = [unit.reshape(value.shape) for unit in np.eye(value.size)]
        gradient = [(c * self.along_parameter(name, unit)).sum() for unit in units]
        return np.array(gradient).reshape(value.shape)


# Fields of ``DERIVATIVES`` on which the memory depends.
FIELDS = ("weight", "gap", "z_n", "z_tau", "slip")


def _given(f: ContactFields) -> Any:
    """Arguments of the law with the mean gap (local)."""
    return f.of_geometry if isinstance(f, LawFields) else f.nodal


def _updated_memory(
    law: Law, f: ContactFields, fields: Mapping[str, Any], changes: Mapping[str, Any]
) -> Array:
    """Memory at the end of the step, with changed arguments, complex (names, slave nodes)."""
    given = _given(f)
    numbers: dict[str, Any] = {name: getattr(given, name).astype(complex) for name in NUMBERS}
    node = replace(given, **{**numbers, "fields": fields, **changes})
    if law.has_closing_gap:
        node = replace(node, gap=np.where(f.covered, law.closing_gap(node).residual, node.gap))
    result = law.remember(node, f.state.branch)
    return np.array([np.asarray(result[name], complex) for name in law.memory])
