# SPDX-License-Identifier: MIT
"""Reference positions of the nodes as a control: contributions of the contacts."""

from __future__ import annotations

import numpy as np

from fenics_mortar.equations.general import ContactEquations
from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.controls import Before, history_of
from fenics_mortar.sensitivity.pair_vectors import add_pair, at_pair, check_exact, zero_vector
from fenics_mortar.sensitivity.partials.positions import Positions, check_positions
from fenics_mortar.utils.arrays import Array


class ContactPositions:
    """Derivative of the residuals with respect to the positions of the nodes, contacts only.

    Positions are values at the dofs of the displacement. The residuals of the bodies depend on them
    as well; their derivative is not included. See ``sensitivity.partials.positions``.

    Args:
        problem: The problem, at the end of a step, evaluated with ``EXACT``; collective.
        before: State at the start of the step, with friction.

    Raises:
        MortarError: On all ranks, if contact depends on the undeformed mesh in other ways.
    """

    def __init__(self, problem: ContactProblem, before: Before = None) -> None:
        self._equations = problem.equations
        self._history = history_of(problem, before)
        self._pairs = []
        for contact in self._equations.contacts:
            check_positions(contact)
            check_exact(contact)
            self._pairs.append(Positions(contact))

    def jvp(self, dx: Array) -> LinearVector:
        """Change of the residuals with the positions, (owned dofs,) [length] (collective)."""
        e, positions = self._equations, LinearVector(u=dx)
        change = zero_vector(e)
        for i, pair in enumerate(self._pairs):
            at = at_pair(e, i, positions)
            add_pair(e, i, change, pair.along(at.on_slave, at.on_master))
        _drop_prescribed(e, change)
        if self._history is not None:
            history = self._history.jvp(positions).z
            assert change.z is not None and history is not None
            for rows, of_history in zip(change.z, history, strict=True):
                rows += of_history
        return change

    def vjp(self, y: LinearVector) -> Array:
        """Gradient, by positions, of residuals times ``y``, (owned dofs,) (collective).

        In the unit of the product over [length].
        """
        e, gradient = self._equations, zero_vector(self._equations)
        given = LinearVector(
            None if y.u is None else y.u.copy(), y.z, None if y.q is None else y.q.copy()
        )
        _drop_prescribed(e, given)
        for i, (pair, contact) in enumerate(zip(self._pairs, e.contacts, strict=True)):
            on_slave, on_master = pair.back(at_pair(e, i, given))
            assert gradient.u is not None
            contact.slave.scatter_add(on_slave, gradient.u)
            contact.master.scatter_add(on_master, gradient.u)
        total = gradient.u
        assert total is not None
        if self._history is not None:
            of_history = self._history.vjp(y).u
            assert of_history is not None
            total = total + of_history
        return total


def _drop_prescribed(e: ContactEquations, x: LinearVector) -> None:
    """Set entries of prescribed dofs and motions to zero: their rows contain no forces (local)."""
    if x.u is not None:
        x.u[e.bulk.prescribed_dofs] = 0.0
    if x.q is not None:
        x.q[:] = np.where(e.motions.driven, x.q, 0.0)
