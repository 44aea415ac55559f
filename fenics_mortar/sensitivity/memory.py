# SPDX-License-Identifier: MIT
"""Derivatives of the memory of laws, propagated from step to step of a path.

With the memory h_k at the end of step k, the equations are R_k(s_k, s_{k-1}, h_{k-1}, m) = 0 and
h_k = H_k(s_k, s_{k-1}, h_{k-1}, m). Changes dh_k of the memory are propagated forwards, gradients
c_k with respect to the memory backwards. Both are dictionaries of replicated arrays
(names, slave nodes) by the number of the pair; without laws with memory they are empty, and all
results are zero.
"""

from __future__ import annotations

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.controls import (
    Before,
    Control,
    Interference,
    LawParameter,
    ObstacleLoad,
    ObstaclePlace,
    ObstacleShape,
    Offset,
)
from fenics_mortar.sensitivity.form_controls import FormControl
from fenics_mortar.sensitivity.history import StepHistory
from fenics_mortar.sensitivity.pair_vectors import (
    add_pair,
    at_pair,
    from_rows,
    rows_at,
    zero_vector,
)
from fenics_mortar.sensitivity.partials.gap import gap_along, gap_back
from fenics_mortar.sensitivity.partials.memory import PairMemory
from fenics_mortar.sensitivity.partials.shape import FieldChange, change_by_shape, units_of
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError

Memories = dict[int, Array]
# Controls that affect the memory through the state only.
WITHOUT_MEMORY = (FormControl, ObstaclePlace, ObstacleLoad)


class StepMemory:
    """Derivatives of the memory of all pairs in a step; constructor and methods are collective.

    Args:
        problem: The problem, at the end of a step, evaluated with ``EXACT``.
        before: ``StepHistory`` of the step; any other value if the state before is fixed.
    """

    def __init__(self, problem: ContactProblem, before: Before) -> None:
        self._problem, self._equations = problem, problem.equations
        history = before.pairs if isinstance(before, StepHistory) else {}
        self._pairs = {
            i: PairMemory(contact, history.get(i))
            for i, contact in enumerate(self._equations.contacts)
            if isinstance(contact, Contact) and contact.pair.law.memory
        }

    def along(
        self, dh: Memories, ds: LinearVector, earlier: LinearVector, by_controls: list[Memories]
    ) -> Memories:
        """Change of the memory at the end of the step.

        Args:
            dh: Change of the memory before, empty if it is fixed.
            ds: Change of the state.
            earlier: Change of the state before.
            by_controls: Results of ``along_control``.
        """
        e, found = self._equations, {}
        for i, pair in self._pairs.items():
            change = pair.along_state(at_pair(e, i, ds)) + pair.along_before(at_pair(e, i, earlier))
            if i in dh:
                change = change + pair.along_memory(dh[i])
            found[i] = sum((made[i] for made in by_controls), change)
        return found

    def rows_along(self, dh: Memories) -> LinearVector:
        """Change of the residuals with the memory before."""
        if not dh:
            return LinearVector()
        rows = {i: pair.rows_along(dh[i]) for i, pair in self._pairs.items()}
        return from_rows(self._equations, rows)

    def state_back(self, c: Memories) -> LinearVector:
        """Gradient with respect to the state at the end of the step."""
        return self._vector({i: self._pairs[i].state_back(values) for i, values in c.items()})

    def before_back(self, c: Memories) -> LinearVector:
        """Gradient with respect to the state before."""
        made = {i: self._pairs[i].before_back(values) for i, values in c.items()}
        return self._vector({i: pair for i, pair in made.items() if pair is not None})

    def _vector(self, pairs: dict) -> LinearVector:
        if not pairs:
            return LinearVector()
        total = zero_vector(self._equations)
        for i, pair in pairs.items():
            add_pair(self._equations, i, total, pair)
        return total

    def memory_back(self, c: Memories, y: LinearVector) -> Memories:
        """Gradient with respect to the memory before, minus that of the residuals times ``y``."""
        found = {}
        for i, pair in self._pairs.items():
            found[i] = -pair.rows_back(rows_at(y, i, self._equations.contacts[i]))
            if i in c:
                found[i] = found[i] + pair.memory_back(c[i])
        return found

    def along_control(self, control: Control, dm: Array) -> Memories:
        """Change of the memories, (names, slave nodes), along ``dm`` at fixed states."""
        check_memory_control(self._equations.contacts, control)
        found = {}
        for i, pair in self._pairs.items():
            contact, change = self._equations.contacts[i], None
            if isinstance(control, LawParameter) and control.pair == i:
                change = pair.along_parameter(control.parameter, np.asarray(dm, float))
            if isinstance(control, (Offset, Interference)) and control.pair == i:
                offset = np.broadcast_to(dm, contact.offset.shape)
                change = pair.along_fields({"gap": gap_along(contact.operators, offset)})
            if isinstance(control, ObstacleShape) and contact.obstacle is control.obstacle:
                direction = np.asarray(dm, float)[None]
                change = pair.along_fields(self._of_shape(i, control, direction).only)
            found[i] = np.zeros((1, 1)) if change is None else change
        return found

    def control_back(self, control: Control, c: Memories) -> Array | float:
        """Transpose of ``along_control``, shape of the control's values; see ``StepMemory``."""
        check_memory_control(self._equations.contacts, control)
        total: Array | float = 0.0
        for i, values in c.items():
            pair, contact = self._pairs[i], self._equations.contacts[i]
            if isinstance(control, LawParameter) and control.pair == i:
                total = total + pair.parameter_back(control.parameter, values)
            if isinstance(control, (Offset, Interference)) and control.pair == i:
                by_gap = pair.fields_back(values).gap
                assert by_gap is not None
                by_offset = gap_back(contact.operators, by_gap)
                is_nodal = isinstance(control, Offset)
                total = total + (by_offset if is_nodal else np.asarray(by_offset.sum()))
            if isinstance(control, ObstacleShape) and contact.obstacle is control.obstacle:
                total = total + self._shape_back(i, control, values)
        return total

    def _of_shape(self, i: int, control: ObstacleShape, directions: Array) -> FieldChange:
        contact = self._equations.contacts[i]
        assert isinstance(contact, Contact)
        return change_by_shape(contact, control.parameter, directions)

    def _shape_back(self, i: int, control: ObstacleShape, c: Array) -> Array:
        value, by = control.get(self._problem), self._pairs[i].fields_back(c)
        gradient = np.zeros(value.size)
        for name, change in self._of_shape(i, control, units_of(value))._asdict().items():
            gradient += change @ getattr(by, name)
        return gradient.reshape(value.shape)


def has_memory(contact: object) -> bool:
    """Whether the law of a contact has memory (local)."""
    return isinstance(contact, Contact) and bool(contact.pair.law.memory)


def check_memory_control(contacts: object, control: Control) -> None:
    """Reject controls whose effect on the memory of a law is not known (local).

    Raises:
        MortarError: If a law has memory, and the control is not one of the package's or moves
            nodes.
    """
    known = (*WITHOUT_MEMORY, LawParameter, Offset, Interference, ObstacleShape)
    if isinstance(control, known):
        return
    for contact in contacts:  # type: ignore[attr-defined]
        if has_memory(contact):
            raise MortarError(
                f"{control.name}: no derivative through the memory of {contact.pair.law!r}; "
                "expected a law without memory, or another control"
            )
