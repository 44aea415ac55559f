# SPDX-License-Identifier: MIT
"""Contact laws: the tangential row of active slave nodes, and the adhesion of open ones.

The gap of an active node is closed under every law. A law adds one equation per node,
rho(g, u, z_n, z_tau) = 0, with the mean gap g, the slip u since the last accepted step, and the
multiplier z = z_n n + z_tau tau, minus the traction on the slave. It returns rho and its four
derivatives; the derivatives of g, u, n and tau with respect to the displacement are computed by
``Contact``.

The multiplier of an open node is zero unless the law has an adhesion a(g), see ``Law.adhesion``.
Then g and z_n + a are complementary:

    g >= 0,    z_n + a(g) >= 0,    (z_n + a(g)) g = 0,

so that a closed node opens if its tension exceeds a(0), and z_n = -a(g) at an open node.

rho may consist of smooth branches. ``Law.branch`` returns the branch of each node as an integer;
Newton's method uses it to detect changes and cycles.

Example: a regularized Coulomb law with a single branch,

>>> class Creeping(Law):
...     def __init__(self, mu: float, length: float) -> None:
...         self.mu, self.length = mu, length
...
...     def branch(self, node: Nodal, before: Branches) -> Branches:
...         return np.ones_like(before)
...
...     def tangential(self, node: Nodal, branch: Branches) -> Row:
...         fraction = np.tanh(node.slip / self.length)
...         return Row(
...             node.z_tau - self.mu * node.z_n * fraction,
...             by_slip=-self.mu * node.z_n * (1.0 - fraction**2) / self.length,
...             by_z_n=-self.mu * fraction,
...             by_z_tau=1.0,
...         )
...
...     def friction_limit(self, pressure: Array) -> Array:
...         return self.mu * pressure
>>> Creeping(0.3, 0.01).friction_limit(np.array([0.0, 2.0]))
array([0. , 0.6])

and Coulomb friction with an adhesion that decays with the gap:

>>> class Sticky(Coulomb):
...     def adhesion(self, gap: Array) -> tuple[Array, Array]:
...         pull = 2.0 * np.exp(-gap / 0.01)
...         return pull, -pull / 0.01
>>> Sticky(0.3).has_adhesion
True

``ContactProblem.check_tangent`` verifies the derivatives. Results must be finite, equal on all
ranks, and one number per node. Otherwise, or if the law raises an error, the solve raises an error
on all ranks, see ``law_calls``. ``Law.check`` may reject parameters before each solve.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, Literal

import numpy as np

from fenics_mortar.contact.law import (
    KINK,
    STICK,
    Array,
    Branches,
    Frictionless,
    Law,
    Nodal,
    Row,
    Stick,
    magnitude,
    row_of,
    varies,
)
from fenics_mortar.utils.arguments import check_choice, check_number
from fenics_mortar.utils.errors import as_text

__all__ = [
    "Coulomb",
    "Friction",
    "Frictionless",
    "Law",
    "Nodal",
    "Row",
    "Tresca",
    "magnitude",
    "row_of",
]

# Friction limit over the pressure [1] below which the distance from a kink is relative to the
# pressure: errors of the shear after convergence are fractions of the whole traction.
SMALL_LIMIT = 1e-2


class Friction(Law):
    """Base class of laws with a friction limit b: a node sticks while |z_tau| < b, else it slides.

    The complementarity function is z_tau - clip(w, -b, b), w = z_tau + c_t (k / l) u, with the
    branches

        stick (0):     |w| <= b        (k / l) u = 0
        slide (+-1):   +-w > b         z_tau -+ b = 0

    Args:
        c_t: Weight of the slip in w [1]. The result does not depend on it. With large weights nodes
            reverse their direction of sliding within one iteration and may alternate; with small
            ones they stick first, which delays the sliding of a body.

    Raises:
        ValueError: If a number is not allowed.
    """

    c_t = 0.1  # default for laws that do not call ``__init__`` of this class
    _nodal_limits = (*Law._nodal_limits, "limit")

    def __init__(self, c_t: float = c_t) -> None:
        self.c_t = c_t

    def check(self) -> None:
        """Check the weight of the slip."""
        check_number("c_t", self.c_t, "a positive number", lambda c: 0.0 < c < np.inf)

    @abstractmethod
    def limit(self, node: Nodal) -> Row | tuple[Any, Any, Any]:
        """Friction limit b at ``node`` with its derivatives, (slave nodes,).

        A ``Row``, or b and its derivatives with respect to gap and z_n [stress].
        """

    def friction_limit_at(self, node: Nodal) -> Array:
        """The limit b; see ``Law.friction_limit_at``."""
        return np.asarray(self.limit(node)[0])

    def branch(self, node: Nodal, before: Branches) -> Branches:
        """Stick (0) or direction of sliding (+-1), either if the limit is 0; see ``Law.branch``."""
        w, limit = node.z_tau + self.c_t * node.stiffness * node.slip, self.limit(node)[0]
        now = np.where(np.abs(w) > limit, np.sign(w), STICK).astype(np.int64)
        kink = np.abs(np.abs(w) - limit) <= KINK * np.maximum(limit, SMALL_LIMIT * np.abs(node.z_n))
        free = np.where(before == STICK, 1, before)
        return np.where(limit == 0.0, free, np.where(kink, before, now))

    def tangential(self, node: Nodal, branch: Branches) -> Row:
        """Slip of sticking nodes, shear minus limit of sliding ones; see ``Law.tangential``."""
        given, sticks = self.limit(node), branch == STICK
        b = given if isinstance(given, Row) else Row(*given[:2], by_z_n=given[2])
        return Row(
            np.where(sticks, -node.stiffness * node.slip, node.z_tau - branch * b.residual),
            by_gap=-branch * b.by_gap,
            by_slip=np.where(sticks, -node.stiffness, -branch * b.by_slip),
            by_z_n=-branch * b.by_z_n,
            by_z_tau=np.where(sticks, 0.0, 1.0 - branch * b.by_z_tau),
        )


class Coulomb(Friction):
    """Coulomb's law, |z_tau| <= mu z_n, with an optional upper limit of the shear.

    Args:
        mu: Coefficient of friction [1]: a number, an array with one number per slave node, a
            function of undeformed positions (n, 2), or a scalar function of dolfinx on the mesh of
            the problem. Fields are evaluated at the slave nodes before each solve.
        max_shear: Upper limit of the shear, independent of the pressure [stress].
        c_t: Weight of the slip in the complementarity function [1], see ``Friction``.
        limit_by: Pressure in the friction limit of a Newton iterate: "trial", the positive part of
            z_n - c_n g as in the active-set test, or "pressure", the positive part of z_n. The
            solution is the same.

    Raises:
        ValueError: If an argument has a value that is not allowed.
    """

    fields = ("mu",)
    parameters: tuple[str, ...] = ("mu", "max_shear")

    def __init__(
        self,
        mu: Any,
        *,
        max_shear: float = np.inf,
        c_t: float = Friction.c_t,
        limit_by: Literal["trial", "pressure"] = "trial",
    ) -> None:
        super().__init__(c_t)
        self.mu, self.max_shear, self.limit_by = mu, max_shear, limit_by
        Coulomb.check(self)

    def check(self) -> None:
        """Check coefficient, upper limit and options."""
        super().check()
        if not varies(self.mu):
            expected = "zero or a positive number"
            check_number("mu", self.mu, expected, lambda mu: 0.0 <= mu < np.inf)
        expected = "a positive stress, or infinity"
        check_number("max_shear", self.max_shear, expected, lambda max_shear: max_shear > 0.0)
        check_choice("limit_by", self.limit_by, ("trial", "pressure"))

    def check_field(self, name: str, values: Array) -> None:
        """Raise an error for negative coefficients in ``values`` (slave nodes,) [1]."""
        if name == "mu" and values.min() < 0.0:
            raise ValueError(
                f"mu={values.min():g} at a slave node: expected zero or a positive number"
            )

    def __repr__(self) -> str:
        """The coefficient; all numbers of a derived law."""
        if type(self) is not Coulomb:
            return as_text(self)
        mu = type(self.mu).__name__ if varies(self.mu) else f"{self.mu:g}"
        return f"Coulomb({mu})"

    def limit(self, node: Nodal) -> tuple[Any, Any, Any]:
        """Mu times the positive part of the pressure, at most ``max_shear``; see ``Friction``."""
        mu = node.fields.get("mu", self.mu)
        c_n = node.c_n if self.limit_by == "trial" else np.zeros_like(node.c_n)
        trial = node.z_n - c_n * node.gap
        factor = np.where((trial > 0.0) & (mu * trial < self.max_shear), mu, 0.0)
        return np.clip(mu * trial, 0.0, self.max_shear), -factor * c_n, factor

    def friction_limit(self, pressure: Array) -> Array:
        """Mu times the pressure, at most ``max_shear``; see ``Law.friction_limit``."""
        return np.clip(self.mu * pressure, 0.0, self.max_shear)


class Tresca(Friction):
    """Tresca's law, |z_tau| <= stress at all active nodes.

    The friction limit does not vanish with the pressure, and a load step may have no solution: an
    edge node overlaps if it is open, is in tension if it slides, and exceeds the limit if it
    sticks. In such steps of a circle pressed on a block, no combination of open, sticking and
    sliding edge nodes was a solution; smaller steps converged. ``Coulomb(mu, max_shear=stress)``
    has a limit that vanishes with the pressure: none of these steps failed with mu = 1, half of
    them with mu = 100.

    Args:
        stress: Friction limit [stress].
        c_t: Weight of the slip in the complementarity function [1], see ``Friction``.

    Raises:
        ValueError: If an argument has a value that is not allowed.
    """

    parameters = ("stress",)

    def __init__(self, stress: float, *, c_t: float = Friction.c_t) -> None:
        super().__init__(c_t)
        self.stress = stress
        Tresca.check(self)

    def check(self) -> None:
        """Check the friction limit."""
        super().check()
        expected = "zero or a positive number"
        check_number("stress", self.stress, expected, lambda stress: 0.0 <= stress < np.inf)

    def __repr__(self) -> str:
        """The friction limit; all numbers of a derived law."""
        return f"Tresca({self.stress:g})" if type(self) is Tresca else as_text(self)

    def limit(self, node: Nodal) -> tuple[Any, Any, Any]:
        """Constant; see ``Friction.limit``."""
        return np.full_like(node.z_n, self.stress), 0.0, 0.0

    def friction_limit(self, pressure: Array) -> Array:
        """Constant; see ``Law.friction_limit``."""
        return np.full_like(pressure, self.stress)


# Laws whose results are not checked.
BUILT_IN = (Frictionless, Stick, Coulomb, Tresca)
