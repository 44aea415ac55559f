# SPDX-License-Identifier: MIT
"""Laws of contact: what the tangential row of an active slave node says, and what open ones bear.

The gap of an active node closes, whatever the law. What is left is one equation a node,
rho(g, u, z_n, z_tau) = 0, with the mean gap g, the slip u since the last accepted step, and the
multiplier z = z_n n + z_tau tau, minus the traction on the slave. A law says rho and its four
derivatives; those of g, u, n and tau by the displacement are ``Contact``'s.

The multiplier of an open node is zero, unless a law says that its sides attract each other, by the
adhesion a(g) of ``Law.adhesion``. Complementary are then g and z_n + a:

    g >= 0,    z_n + a(g) >= 0,    (z_n + a(g)) g = 0,

so that a closed node opens where it pulls by more than a(0), and an open one bears z_n = -a(g).

rho may consist of smooth pieces. Newton's method needs to know on which one a node is, to see when
the pieces change and when they do so in circles: a law says that, too, as one whole number a node.

A regularised Coulomb's law, for example, is smooth, a single piece:

>>> class Creeping(Law):
...     def __init__(self, mu: float, length: float) -> None:
...         self.mu, self.length = mu, length
...
...     def branch(self, node: Nodal, before: Branches) -> Branches:
...         return np.ones_like(before)
...
...     def tangential(self, node: Nodal, branch: Branches) -> Row:
...         part = np.tanh(node.slip / self.length)
...         return Row(
...             node.z_tau - self.mu * node.z_n * part,
...             by_slip=-self.mu * node.z_n * (1.0 - part**2) / self.length,
...             by_z_n=-self.mu * part,
...             by_z_tau=1.0,
...         )
...
...     def friction_limit(self, pressure: Array) -> Array:
...         return self.mu * pressure

and one with adhesion that fades away as surfaces part, and Coulomb's friction, says besides

>>> class Sticky(Coulomb):
...     def adhesion(self, gap: Array) -> tuple[Array, Array]:
...         pull = 2.0 * np.exp(-gap / 0.01)
...         return pull, -pull / 0.01

``ContactProblem.check_tangent`` proves the derivatives. What a law returns has to be finite, of
ranks alike, and one number a node; ``Law.check`` may refuse parameters before each solve. A law
that does otherwise, or raises, ends the solve with an error on all ranks, see ``asking``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from fenics_mortar.utils.arguments import check_choice, check_number

Array = npt.NDArray[np.float64]
Branches = npt.NDArray[np.int64]
# A node this close to a kink, as a part of the bound, stays on its piece: it is on both.
KINK = 1e-8
STICK = 0


@dataclass(frozen=True)
class Nodal:
    """State of the slave nodes; every array of shape (slave nodes,).

    Attributes:
        gap: Mean gap g, zero where there is no partner [length].
        slip: Slip u since the last accepted step, positive along tau [length].
        z_n, z_tau: Multiplier [stress].
        stiffness: That of the bulk k_j / l_j [stress / length].
        c_n: Weight of the gap in the active-set test, c k_j / l_j [stress / length].
    """

    gap: Array
    slip: Array
    z_n: Array
    z_tau: Array
    stiffness: Array
    c_n: Array


class Row(NamedTuple):
    """Residual rho [stress] and its derivatives, each of shape (slave nodes,) or a number."""

    residual: Any
    by_gap: Any = 0.0
    by_slip: Any = 0.0
    by_z_n: Any = 0.0
    by_z_tau: Any = 0.0


class Law(ABC):
    """Base of all laws; all methods act on all slave nodes at once."""

    @abstractmethod
    def branch(self, node: Nodal, before: Branches) -> Branches:
        """Piece of rho that each node is on, 0 if it sticks; ``before``: where it was."""

    @abstractmethod
    def tangential(self, node: Nodal, branch: Branches) -> Row:
        """Residual and derivatives of nodes that are on the given pieces."""

    @abstractmethod
    def friction_limit(self, pressure: Array) -> Array:
        """Largest |z_tau| that the law allows at a pressure."""

    def adhesion(self, gap: Array) -> tuple[Array, Array]:
        """Pull across gaps that are zero or open, and its derivative; none if not overridden.

        Args:
            gap: Shape (slave nodes,), or any other [length].

        Returns:
            a(g), zero or positive [stress], and a'(g) [stress / length], of the same shape.
        """
        return np.zeros_like(gap), np.zeros_like(gap)

    def check(self) -> None:  # noqa: B027
        """Refuse parameters that are not allowed; asked before each solve (local).

        To be overridden by laws with parameters.

        Raises:
            ValueError: If one is not allowed.
        """

    @property
    def has_friction(self) -> bool:
        """Whether there may be a shear."""
        return type(self).tangential is not Frictionless.tangential

    @property
    def is_of_package(self) -> bool:
        """Whether it is one of the laws here, whose pieces are known; else the user's own."""
        return type(self).__module__ == Law.__module__

    @property
    def has_adhesion(self) -> bool:
        """Whether there may be adhesion."""
        return type(self).adhesion is not Law.adhesion


class Frictionless(Law):
    """No friction: z_tau = 0."""

    def branch(self, node: Nodal, before: Branches) -> Branches:
        """All slide."""
        return np.ones_like(before)

    def tangential(self, node: Nodal, branch: Branches) -> Row:
        """The shear itself."""
        return Row(node.z_tau, by_z_tau=1.0)

    def friction_limit(self, pressure: Array) -> Array:
        """None."""
        return np.zeros_like(pressure)


class Stick(Law):
    """Whatever touches sticks, whatever it takes: (k / l) u = 0."""

    def branch(self, node: Nodal, before: Branches) -> Branches:
        """All stick."""
        return np.full_like(before, STICK)

    def tangential(self, node: Nodal, branch: Branches) -> Row:
        """The slip."""
        return Row(node.stiffness * node.slip, by_slip=node.stiffness)

    def friction_limit(self, pressure: Array) -> Array:
        """None that could be reached."""
        return np.full_like(pressure, np.inf)


class Friction(Law):
    """Nodes stick while |z_tau| is below a bound b, and slide along it.

    The complementarity function is z_tau - clip(w, -b, b), w = z_tau + c_t (k / l) u; its pieces:

        stick (0):     |w| <= b        (k / l) u = 0
        slide (+-1):   +-w > b         z_tau -+ b = 0

    Args:
        c_t: Weight of the slip in w, a plain number. The result does not depend on it: it decides
            how soon a node that slides against its shear turns round instead of sticking first.
            If it does so too soon, all nodes of a body may turn to and fro; if too late, a few that
            stick hold a body that slides.

    Raises:
        ValueError: If a number is not allowed.
    """

    def __init__(self, c_t: float) -> None:
        self.c_t = c_t

    def check(self) -> None:
        """Refuse a weight that is not positive."""
        check_number("c_t", self.c_t, "a positive number", lambda c: 0.0 < c < np.inf)

    @abstractmethod
    def limit(self, node: Nodal) -> tuple[Any, Any, Any]:
        """B and its derivatives by the mean gap and z_n."""

    def branch(self, node: Nodal, before: Branches) -> Branches:
        """Stick, or the direction of sliding; without a bound either direction is right."""
        w, limit = node.z_tau + self.c_t * node.stiffness * node.slip, self.limit(node)[0]
        now = np.where(np.abs(w) > limit, np.sign(w), STICK).astype(np.int64)
        kink = np.abs(np.abs(w) - limit) <= KINK * limit
        free = np.where(before == STICK, 1, before)
        return np.where(limit == 0.0, free, np.where(kink, before, now))

    def tangential(self, node: Nodal, branch: Branches) -> Row:
        """The slip of nodes that stick; how far the shear of those that slide is off the bound."""
        limit, by_gap, by_z_n = self.limit(node)
        sticks = branch == STICK
        return Row(
            np.where(sticks, -node.stiffness * node.slip, node.z_tau - branch * limit),
            by_gap=-branch * by_gap,
            by_slip=np.where(sticks, -node.stiffness, 0.0),
            by_z_n=-branch * by_z_n,
            by_z_tau=np.where(sticks, 0.0, 1.0),
        )


class Coulomb(Friction):
    """Coulomb's law, |z_tau| <= mu z_n.

    Args:
        mu: Coefficient of friction.
        max_shear: Shear that the surface bears at most, whatever the pressure [stress].
        c_t: Weight of the slip, see ``Friction``.
        limit_by: What bounds the shear while Newton's method iterates: "trial", the positive part
            of z_n - c_n g as in the active-set test, or "pressure", that of z_n. Both are the same
            in the solution.

    Raises:
        ValueError: If a number is not allowed.
    """

    def __init__(
        self,
        mu: float,
        *,
        max_shear: float = np.inf,
        c_t: float = 0.1,
        limit_by: Literal["trial", "pressure"] = "trial",
    ) -> None:
        super().__init__(c_t)
        self.mu, self.max_shear, self.limit_by = mu, max_shear, limit_by
        Coulomb.check(self)

    def check(self) -> None:
        """Refuse a negative coefficient, a bound that is not positive, and other words."""
        super().check()
        right = "zero or a positive number"
        check_number("mu", self.mu, right, lambda mu: 0.0 <= mu < np.inf)
        right = "a positive stress, or infinity"
        check_number("max_shear", self.max_shear, right, lambda max_shear: max_shear > 0.0)
        check_choice("limit_by", self.limit_by, ("trial", "pressure"))

    def __repr__(self) -> str:
        """The coefficient."""
        return f"Coulomb({self.mu:g})"

    def limit(self, node: Nodal) -> tuple[Any, Any, Any]:
        """Mu times the positive part of the trial pressure, at most ``most``."""
        c_n = node.c_n if self.limit_by == "trial" else np.zeros_like(node.c_n)
        trial = node.z_n - c_n * node.gap
        factor = np.where((trial > 0.0) & (self.mu * trial < self.max_shear), self.mu, 0.0)
        return np.clip(self.mu * trial, 0.0, self.max_shear), -factor * c_n, factor

    def friction_limit(self, pressure: Array) -> Array:
        """Mu times the pressure."""
        return np.clip(self.mu * pressure, 0.0, self.max_shear)


class Tresca(Friction):
    """Tresca's law, a shear of at most ``stress`` wherever there is contact.

    That is so however small the pressure, so that a step may have no solution: an edge node, open,
    overlaps; closed, its shear peels it off; sticking, it bears more than the bound. Such steps of
    a circle pressed on a block fail for all ways in which the nodes at both edges may be open,
    stick or slide. Smaller steps have led past each of them. ``Coulomb(mu, max_shear=stress)``
    leaves a place between, since its limit vanishes with the pressure: with mu = 1 none of these
    steps failed, with 100, where it is almost a jump, half of them did.

    Args:
        stress: The bound [stress].
        c_t: Weight of the slip, see ``Friction``.

    Raises:
        ValueError: If a number is not allowed.
    """

    def __init__(self, stress: float, *, c_t: float = 0.1) -> None:
        super().__init__(c_t)
        self.stress = stress
        Tresca.check(self)

    def check(self) -> None:
        """Refuse a bound that is negative or infinite."""
        super().check()
        right = "zero or a positive number"
        check_number("stress", self.stress, right, lambda stress: 0.0 <= stress < np.inf)

    def __repr__(self) -> str:
        """The bound."""
        return f"Tresca({self.stress:g})"

    def limit(self, node: Nodal) -> tuple[Any, Any, Any]:
        """The bound, which nothing changes."""
        return np.full_like(node.z_n, self.stress), 0.0, 0.0

    def friction_limit(self, pressure: Array) -> Array:
        """The bound, which nothing changes."""
        return np.full_like(pressure, self.stress)


# Laws that return what they should.
BUILT_IN = (Frictionless, Stick, Coulomb, Tresca)
