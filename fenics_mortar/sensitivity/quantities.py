# SPDX-License-Identifier: MIT
"""Quantities of contact as objectives: forces, pressures, gaps, friction work, contact lengths.

Nodal quadrature with the weights w_j, the integrals of the multiplier functions over the current
surface and the thickness, gives int f(p) = sum_j w_j f(p_j); it is exact for f = p. Derivatives are
taken at fixed sets, at the present state of the problem, which must be evaluated with ``EXACT``.
In space integrals are over areas: units are those with a thickness.
All values are equal on all ranks; all methods but constructors and operators are collective.

Sums, products with numbers, and powers of quantities are quantities:

>>> misfit = (TotalForce(0, (0.0, 1.0)) - 12.5) ** 2 + 0.1 * FrictionWork(0)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.obstacles.rigid_motion import check_direction, check_vector
from fenics_mortar.sensitivity.partials.fields import moment, moment_gradient
from fenics_mortar.sensitivity.protocols import ByFields, Combined, ContactQuantity, PairQuantity
from fenics_mortar.utils.arguments import check_number
from fenics_mortar.utils.arrays import Array, Indices


class TotalForce(PairQuantity):
    """Component of the contact force on the slave body [stress length].

    Args:
        pair: Number of the pair, a contact or a tie.
        direction: Vector by which the force is multiplied, shape (d,) [1].
    """

    def __init__(self, pair: int, direction: npt.ArrayLike) -> None:
        super().__init__(pair)
        self.direction = direction

    def check_dimension(self, dim: int) -> None:
        """See ``ContactQuantity``."""
        check_vector("direction", self.direction, dim)

    def _of(self, contact: Interface) -> float:
        """See ``PairQuantity``."""
        return float(contact.total_force @ np.asarray(self.direction, float))

    def _by_fields(self, contact: Interface) -> ByFields:
        """See ``PairQuantity``."""
        weight, direction = contact.operators.weight, np.asarray(self.direction, float)
        return {"weight": -contact.z @ direction, "z": -weight[:, None] * direction}


class Moment(PairQuantity):
    """Moment of the contact forces on the slave body, counter-clockwise [stress length^2].

    Args:
        pair: Number of the pair, a contact or a tie.
        about: Fixed point, shape (d,) [length]; the origin by default.
        axis: In space the direction of the axis through this point, of any length, shape (3,).
    """

    def __init__(
        self,
        pair: int,
        about: npt.ArrayLike | None = None,
        axis: npt.ArrayLike | None = None,
    ) -> None:
        super().__init__(pair)
        self.about, self.axis = about, axis

    def check_dimension(self, dim: int) -> None:
        """See ``ContactQuantity``."""
        self._line(dim)

    def _line(self, dim: int) -> tuple[Array, Array | None]:
        """The point (d,) [length], and the unit vector along the axis in space (local).

        Raises:
            ValueError: If one of them is not given as needed.
        """
        about = np.zeros(dim) if self.about is None else check_vector("about", self.about, dim)
        if (self.axis is None) == (dim == 3):
            expected = "the direction of an axis in space" if dim == 3 else "None in the plane"
            raise ValueError(f"axis={self.axis!r}: expected {expected}")
        return about, None if self.axis is None else check_direction("axis", self.axis)

    def _of(self, contact: Interface) -> float:
        """See ``PairQuantity``."""
        return moment(contact, *self._line(contact.slave.dim))

    def _by_fields(self, contact: Interface) -> ByFields:
        """See ``PairQuantity``: no control changes the moment at a fixed state."""
        return {}

    def _by_state(self, contact: Interface) -> Array:
        return moment_gradient(contact, *self._line(contact.slave.dim))


class PressureFunctional(PairQuantity):
    """Integral of a function of the pressure over the slave, sum_j w_j f(p_j).

    Args:
        pair: Number of the pair.
        function: Function from the pressures of all slave nodes, (slave nodes,) [stress], to values
            (slave nodes,) [unit of f].
        derivative: Function from the pressures to the derivatives, (slave nodes,) [unit of f over
            stress].
    """

    def __init__(
        self, pair: int, function: Callable[[Array], Array], derivative: Callable[[Array], Array]
    ) -> None:
        super().__init__(pair)
        self._function, self._derivative = function, derivative

    def _of(self, contact: Contact) -> float:
        """See ``PairQuantity``."""
        return float(contact.operators.weight @ self._function(contact.now.z_n))

    def _by_fields(self, contact: Contact) -> ByFields:
        """See ``PairQuantity``."""
        p, weight = contact.now.z_n, contact.operators.weight
        return {"weight": self._function(p), "z_n": weight * self._derivative(p)}


class PressureIntegral(PressureFunctional):
    """Integral of a power of the pressure over the slave [stress^power length].

    Args:
        pair: Number of the pair.
        power: Power, a whole number, at least 1.
    """

    def __init__(self, pair: int, power: int = 1) -> None:
        self.power = power
        super().__init__(pair, lambda p: p**power, lambda p: power * p ** (power - 1))

    def check(self) -> None:
        """See ``ContactQuantity``."""
        super().check()
        check_number("power", self.power, "at least 1", lambda n: n >= 1, whole=True)


class PeakPressure(PairQuantity):
    """Smooth maximum of the pressure, the norm (sum_j w_j p_j^P / sum_j w_j)^(1/P) [stress].

    Tensile pressures, as under adhesion, are replaced by zero.

    Args:
        pair: Number of the pair.
        power: Exponent P [1]; the norm is below the maximum and tends to it as P increases.
    """

    def __init__(self, pair: int, power: float = 8.0) -> None:
        super().__init__(pair)
        self.power = power

    def check(self) -> None:
        """See ``ContactQuantity``."""
        super().check()
        check_number("power", self.power, "more than 1", lambda P: 1.0 < P < np.inf)

    def _parts(self, contact: Contact) -> tuple[Array, float, float, float]:
        """Pressures over the largest one, largest pressure, sum of weights, mean of the powers."""
        weight, p = contact.operators.weight, np.maximum(contact.now.z_n, 0.0)
        largest = float(p.max()) or 1.0
        total = float(weight.sum())
        return p / largest, largest, total, float(weight @ (p / largest) ** self.power) / total

    def _of(self, contact: Contact) -> float:
        """See ``PairQuantity``."""
        _, largest, _, mean = self._parts(contact)
        return float(largest * mean ** (1.0 / self.power))

    def _by_fields(self, contact: Contact) -> ByFields:
        """See ``PairQuantity``; zero without pressure."""
        p, largest, total, mean = self._parts(contact)
        if mean == 0.0:
            return {"weight": p}
        by_mean = mean ** (1.0 / self.power - 1.0) / total
        by_weight = largest / self.power * by_mean * (p**self.power - mean)
        weight = contact.operators.weight
        return {"weight": by_weight, "z_n": by_mean * weight * p ** (self.power - 1.0)}


def _check_nodes(nodes: Any) -> None:
    """Reject values that are not numbers of slave nodes (local).

    Raises:
        ValueError: If they are not numbers from 0 on.
    """
    numbers = np.asarray(nodes)
    if numbers.dtype.kind not in "iu" or numbers.ndim != 1 or not numbers.size or numbers.min() < 0:
        raise ValueError(f"nodes={nodes!r}: expected numbers of slave nodes, from 0 on")


class MeanGap(PairQuantity):
    """Mean gap of nodes, the sum of weighted gaps over the sum of weights [length].

    Args:
        pair: Number of the pair.
        nodes: Numbers of slave nodes along the surface, shape (k,); all covered ones by default.
    """

    def __init__(self, pair: int, nodes: Indices | None = None) -> None:
        super().__init__(pair)
        self.nodes = nodes

    def check(self) -> None:
        """See ``ContactQuantity``."""
        super().check()
        if self.nodes is not None:
            _check_nodes(self.nodes)

    def _counts(self, contact: Contact) -> Array:
        counts = contact.covered.astype(float)
        if self.nodes is not None:
            if np.max(self.nodes) >= counts.size:
                raise ValueError(
                    f"nodes: pair {self.pair} has the slave nodes 0 to {counts.size - 1}"
                )
            chosen = np.zeros_like(counts)
            chosen[np.asarray(self.nodes)] = 1.0
            counts = counts * chosen
        return counts

    def _of(self, contact: Contact) -> float:
        """See ``PairQuantity``; nan if none of the nodes is covered."""
        o, counts = contact.operators, self._counts(contact)
        total = float(counts @ o.weight)
        return float(counts @ o.gap) / total if total else np.nan

    def _by_fields(self, contact: Contact) -> ByFields:
        """See ``PairQuantity``."""
        counts = self._counts(contact)
        total = float(counts @ contact.operators.weight) or 1.0
        return {"weight": -self._of(contact) / total * counts, "gap": counts / total}


class FrictionWork(PairQuantity):
    """Work of friction in the step, by the shear at its end [stress length^2].

    The sum of w_j z_tau u_j over active nodes with the slip u_j; see ``PairView.friction_work``.

    Args:
        pair: Number of the pair.
    """

    def _of(self, contact: Contact) -> float:
        """See ``PairQuantity``."""
        return contact.now.friction_work

    def _by_fields(self, contact: Contact) -> ByFields:
        """See ``PairQuantity``."""
        w, z_tau, on = contact.operators.weight, contact.z_tau, contact.active
        slip, f = np.where(on, contact.slip, 0.0), contact.now
        gap = np.where(on, z_tau * f.slip_by_gap, 0.0)
        return {
            "weight": z_tau * slip - gap * f.mean_gap,
            "gap": gap,
            "z_tau": w * slip,
            "slip": np.where(on, w * z_tau, 0.0),
        }


class ContactLength(PairQuantity):
    """Length of the surface in contact, the sum of w_j over active nodes [length].

    The length jumps if the active set changes; the derivative at a fixed set is only the stretch of
    the surface at active nodes. ``effective_length`` is smooth.

    Args:
        pair: Number of the pair.
    """

    def _of(self, contact: Contact) -> float:
        """See ``PairQuantity``."""
        return float(contact.operators.weight @ contact.active)

    def _by_fields(self, contact: Contact) -> ByFields:
        """See ``PairQuantity``."""
        return {"weight": contact.active.astype(float)}


def effective_length(pair: int) -> ContactQuantity:
    """Length over which the mean pressure acts, (int p)^2 / int p^2 [length] (local).

    This is the length in contact for a uniform pressure, and 3 pi^2 / 32 = 0.925 of it for a
    Hertzian pressure. It changes continuously with the active set.

    Args:
        pair: Number of the pair.
    """
    parts = [PressureIntegral(pair, 1), PressureIntegral(pair, 2)]
    return Combined(
        parts,
        lambda v: v[0] ** 2 / v[1],
        lambda v: np.array([2.0 * v[0] / v[1], -((v[0] / v[1]) ** 2)]),
    )
