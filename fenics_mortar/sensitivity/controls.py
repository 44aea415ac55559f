# SPDX-License-Identifier: MIT
"""Controls of contact: parameters of laws, offsets, obstacles.

Offsets and shapes act on rows and memory through nodal fields, parameters of laws
directly, places and loads of obstacles on the rows of the motions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import block_diag

from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.obstacles.rigid_motion import inverse_jacobians
from fenics_mortar.sensitivity.history import Before, OfPair, contact_of
from fenics_mortar.sensitivity.partials import history
from fenics_mortar.sensitivity.partials.fields import Changes, Matrix, fields_by_shape
from fenics_mortar.sensitivity.protocols import Control, PairControl, Quantity, Values
from fenics_mortar.utils import errors

if TYPE_CHECKING:
    from fenics_mortar.contact.fluxes import Flux
    from fenics_mortar.problem import ContactProblem
    from fenics_mortar.utils.arrays import Array, Flags


class LawParameter(PairControl):
    """A parameter of the law of a pair, see ``Law.parameters``; the constructor is local.

    The values of a parameter that varies in space, see ``Law.fields``, are those at the slave nodes
    at the last solve; ``set`` replaces a function by such values.

    Args:
        pair: Number of the pair.
        name: Name of the parameter, such as "mu".
    """

    def __init__(self, pair: int, name: str) -> None:
        super().__init__(pair)
        self.parameter = name
        self.name = f"{name} of pair {pair}"

    def get(self, problem: ContactProblem) -> Array:
        """Present values (local), of shape () for a single number [their unit]."""
        return history.parameter(contact_of(problem.equations, self.pair), self.parameter)

    def set(self, problem: ContactProblem, values: Array) -> None:
        """Set the ``values``, of the shape of ``get`` [their unit], equal on all ranks (local)."""
        law = contact_of(problem.equations, self.pair).pair.law
        errors.check_choice(f"parameter of {law!r}", self.parameter, law.parameters)
        new = np.array(values, float)
        setattr(law, self.parameter, new if new.ndim else new.item())
        law.check()

    def rows(self, problem: ContactProblem, i: int, before: Before = None) -> Matrix:
        """Derivative of the rows of pair ``i``, one of ``pairs`` (collective)."""
        return history.by_parameter(
            contact_of(problem.equations, i), self.parameter, history.change_of_rows
        )

    def memory(
        self, problem: ContactProblem, i: int, memory: history.PairMemory, before: Before = None
    ) -> Matrix:
        """Derivative of the memory of the law of pair ``i``, one of ``pairs`` (collective)."""
        return history.by_parameter(
            contact_of(problem.equations, i), self.parameter, history.change_of_memory
        )


class Offset(PairControl):
    """The nodal offsets of a pair, see ``PairView.offset``; the constructor is local.

    Args:
        pair: Number of the pair.
    """

    def __init__(self, pair: int) -> None:
        super().__init__(pair)
        self.name = f"offset of pair {pair}"

    def get(self, problem: ContactProblem) -> Array:
        """Present values, shape (slave nodes,) [length] (local)."""
        return contact_of(problem.equations, self.pair).offset.copy()

    def set(self, problem: ContactProblem, values: Array) -> None:
        """Set the ``values``, of the shape of ``get`` [their unit], equal on all ranks (local)."""
        contact = contact_of(problem.equations, self.pair)
        contact.change(offset=errors.check_lengths("offset", values, contact.slave.num_nodes))

    def fields(self, problem: ContactProblem, i: int, before: Before = None) -> Changes:
        """Derivatives of the nodal fields of pair ``i``, one of ``pairs`` (collective)."""
        D, _ = contact_of(problem.equations, i).operators.matrices
        return {"gap": -D}


class Interference(Offset):
    """Mean offset of a pair; a change shifts the offsets of all nodes equally.

    The constructor is local.

    Args:
        pair: Number of the pair.
    """

    def __init__(self, pair: int) -> None:
        super().__init__(pair)
        self.name = f"interference of pair {pair}"

    def get(self, problem: ContactProblem) -> Array:
        """Present mean, shape () [length] (local)."""
        return np.asarray(super().get(problem).mean())

    def set(self, problem: ContactProblem, values: Array) -> None:
        """Set the ``values``, of the shape of ``get``; without effect beyond the other surface."""
        shift = np.asarray(values, float).item() - self.get(problem)
        super().set(problem, super().get(problem) + shift)

    def fields(self, problem: ContactProblem, i: int, before: Before = None) -> Changes:
        """Derivatives of the nodal fields of pair ``i``, one of ``pairs`` (collective)."""
        change = super().fields(problem, i)["gap"]
        return {"gap": change @ np.ones((change.shape[1], 1))}


class ConductanceScale(OfPair, Control):
    """Factor of the conductance of a pair for a scalar field, see ``Conductance.scale``.

    The constructor is local.

    Args:
        pair: Number of the pair.
        field: Number of the field's sub-space.
    """

    def __init__(self, pair: int, field: int) -> None:
        super().__init__(pair)
        self.field, self.name = field, f"conductance of pair {pair} for field {field}"

    def _flux(self, problem: ContactProblem) -> Flux:
        for flux in contact_of(problem.equations, self.pair).fluxes:
            if flux.law.field == self.field:
                return flux
        raise ValueError(f"{self.name}: the pair has no such conductance")

    def get(self, problem: ContactProblem) -> Array:
        """Present scale, shape () [1] (local)."""
        return np.asarray(self._flux(problem).law.scale)

    def set(self, problem: ContactProblem, values: Array) -> None:
        """Set the ``values``, of the shape of ``get`` [their unit], equal on all ranks (local)."""
        errors.check_number("scale", float(values), "a positive number", lambda scale: scale > 0.0)
        self._flux(problem).law.scale = float(values)

    def _loads(self, problem: ContactProblem) -> Array:
        loads, flux = np.zeros(problem.equations.bulk.num_owned), self._flux(problem)
        flux.add(flux.now.by_conduction(flux.now.by_scale), loads)
        loads[problem.equations.bulk.prescribed_dofs] = 0.0
        return loads

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """Change of the residuals along ``dm``, of the values' shape; ``before`` is not used."""
        return LinearVector(u=float(dm) * self._loads(problem))

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """Gradient of residuals times ``y`` [its units]; ``before`` is not used (collective)."""
        loads = self._loads(problem)
        mine = 0.0 if y.u is None else float(y.u @ loads)
        return np.asarray(problem.equations.comm.allreduce(mine))


class _OfObstacle(Control):
    """Values of an obstacle.

    Args:
        obstacle: The obstacle.
        quantity: Name of the values.
    """

    def __init__(self, obstacle: Obstacle, quantity: str) -> None:
        self.obstacle = obstacle
        self.name = f"{quantity} of '{getattr(obstacle, 'name', obstacle)}'"

    def check(self) -> None:
        """Reject a value that is not an obstacle (local).

        Raises:
            ValueError: If it is not.
        """
        errors.check_kind("obstacle", self.obstacle, Obstacle, "an obstacle of the problem")


class _OfMotions(_OfObstacle):
    """Values of an obstacle in the rows of its motions.

    Attributes:
        drives: Whether it is the load of driven motions, not the place of prescribed ones.
    """

    drives: bool

    def _number(self, problem: ContactProblem) -> int:
        if not any(obstacle is self.obstacle for obstacle in problem.obstacles):
            raise ValueError(f"{self.name}: the problem has no such obstacle")
        return problem.obstacles.index(self.obstacle)

    def _mine(self) -> Flags:
        """Motions whose rows depend on the values, shape (m,), bool."""
        return np.isfinite(self.obstacle.load) == self.drives

    def pairs(self, problem: ContactProblem) -> list[int]:
        """None: pairs depend on motions through the state only (local)."""
        return []

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """Change of the residuals along ``dm``, of the values' shape; ``before`` is not used."""
        q = np.zeros(problem.equations.motions.scales.shape)
        q[self._number(problem)] = -self._motions() @ np.where(self._mine(), dm, 0.0)
        return LinearVector(q=q)

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """Gradient of residuals times ``y`` [its units]; ``before`` is not used (collective)."""
        if y.q is None:
            return np.zeros(self._mine().shape)
        return np.where(self._mine(), -y.q[self._number(problem)] @ self._motions(), 0.0)

    def _motions(self) -> Array:
        """Derivative of the motions by the values, shape (m, m) [1] (local)."""
        return np.eye(self._mine().size)


class ObstaclePlace(_OfMotions):
    """Prescribed place (x, y, angle) of an obstacle in this step [length, length, radian].

    In space with a rotation vector. Values of driven motions have no effect. The constructor is
    local.

    Args:
        obstacle: The obstacle.
    """

    drives = False

    def __init__(self, obstacle: Obstacle) -> None:
        super().__init__(obstacle, "place")

    def get(self, problem: ContactProblem) -> Array:
        """Present place, shape (m,) [length, radian] (local)."""
        return self.obstacle.place.copy()

    def set(self, problem: ContactProblem, values: Array) -> None:
        """Set the ``values``, of the shape of ``get``; driven motions are unchanged."""
        self.obstacle.place = np.where(self._mine(), values, self.obstacle.place)

    def _motions(self) -> Array:
        """See ``_OfMotions``: a motion in space is a spin, a place has the rotation vector.

        Raises:
            MortarError: On all ranks, if a moment turns an obstacle that is turned by prescribed
                values, too.
        """
        turn, given = self.obstacle.place[None, 3:], self._mine()[3:]
        if not turn.size:
            return super()._motions()
        if turn[0, given].any() and not given.all():
            raise errors.MortarError(
                f"{self.name}: rotations about some axes are prescribed, about others driven by "
                "moments: expected all of one kind, or no prescribed turn"
            )
        return block_diag(np.eye(3), np.linalg.inv(inverse_jacobians(turn)[0]))


class ObstacleLoad(_OfMotions):
    """Forces and moments that drive an obstacle [stress length, stress length^2].

    Values of prescribed motions have no effect. The constructor is local.

    Args:
        obstacle: The obstacle.
    """

    drives = True

    def __init__(self, obstacle: Obstacle) -> None:
        super().__init__(obstacle, "load")

    def get(self, problem: ContactProblem) -> Array:
        """Present loads, shape (m,), 0 for prescribed motions [their unit] (local)."""
        return np.nan_to_num(self.obstacle.load)

    def set(self, problem: ContactProblem, values: Array) -> None:
        """Set the ``values``, of the shape of ``get``; prescribed motions remain prescribed."""
        self.obstacle.load = np.where(self._mine(), values, np.nan)


class ObstacleShape(_OfObstacle, PairControl):
    """A parameter of the shape of an obstacle, see ``Obstacle.shape``; the constructor is local.

    With friction in space slip counts from points of the same shape, so that of
    ``Gradient.by_step`` only the sum over the steps has a meaning.

    Args:
        obstacle: The obstacle.
        name: Name of the parameter: "radius" of a circle, "points" of a spline.
    """

    def __init__(self, obstacle: Obstacle, name: str) -> None:
        super().__init__(obstacle, name)
        self.parameter = name

    def check(self) -> None:
        """Reject a value that is not an obstacle with this parameter (local).

        Raises:
            ValueError: If it is not.
        """
        super().check()
        errors.check_choice("shape parameter", self.parameter, self.obstacle.shape())

    def get(self, problem: ContactProblem) -> Array:
        """Present values (local), of shape () for a single number [their unit]."""
        return np.array(self.obstacle.shape()[self.parameter])

    def set(self, problem: ContactProblem, values: Array) -> None:
        """Set the ``values``, of the shape of ``get`` [their unit], equal on all ranks (local)."""
        self.obstacle.set_shape(self.parameter, np.asarray(values, float))

    def pairs(self, problem: ContactProblem) -> list[int]:
        """Numbers of the pairs whose rows or memory depend on it at fixed states (local)."""
        every = enumerate(problem.equations.contacts)
        return [i for i, contact in every if contact.obstacle is self.obstacle]

    def fields(self, problem: ContactProblem, i: int, before: Before = None) -> Changes:
        """Derivatives of the nodal fields of pair ``i``, one of ``pairs`` (collective)."""
        return fields_by_shape(contact_of(problem.equations, i), self.parameter)


def explicit(
    problem: ContactProblem, quantity: Quantity, control: Control, before: Before
) -> Values:
    """dJ/dm at fixed states, of the shape of the control's values (collective).

    In the unit of J over that of m [any].
    """
    of_control = getattr(control, "explicit", None)
    if of_control is not None:
        return of_control(problem, quantity, before)
    return quantity.by_control(problem, control, before)


def dot(problem: ContactProblem, control: Control, one: Array, other: Array) -> float:
    """Scalar product of two arrays of a control's shape [product of units] (collective).

    Values of controls with a true ``is_distributed`` are those of the owned dofs, others are
    replicated.
    """
    mine, is_distributed = float(np.vdot(one, other)), getattr(control, "is_distributed", False)
    return problem.equations.comm.allreduce(mine) if is_distributed else mine
