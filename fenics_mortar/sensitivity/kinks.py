# SPDX-License-Identifier: MIT
"""Distance of a state from the next change of its active sets and branches, and flat objectives.

The converged state is differentiable where no set changes. At a kink, the derivatives are those of
the sets of the state: an element of Clarke's generalized derivative. The distances from a kink are

================  ==========================================================
node              distance [1]
================  ==========================================================
active            (z_n + a) / largest pressure of the pair
open              mean gap / nodal length
sticking          (b - abs(z_tau)) / b, friction limit b
sliding           slip / nodal length
================  ==========================================================

and zero where the cover of a node is at the limit for a multiplier. A node is undecided if its
distance is at most ``laws.KINK``. Distances of sticking and sliding nodes are known for laws with a
friction limit that is reached in sliding (``Friction``).

Far from kinks an objective may be flat. If all nodes in contact stick in all steps, a larger
friction limit changes nothing: the derivative is exactly zero in a whole region, and an optimizer
that compares gradients with zero stops there. The same holds for all parameters of a pair without
contact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.contact.laws import KINK, Friction
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.controls import LawParameter
from fenics_mortar.sensitivity.protocols import Control
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.errors import format_point
from fenics_mortar.utils.rounding import LAST_DIGITS

Change = Literal["opens", "closes", "slides", "sticks", "cover"]
Status = Literal["open", "stick", "other"]


@dataclass(frozen=True)
class Kink:
    """The node of a pair and step closest to a change of a set; local.

    Attributes:
        distance: Distance from the change [1], see ``kinks``.
        step: Number of the step.
        pair: Number of the pair.
        node: Number of the slave node along the surface.
        X: Reference position of the node, shape (d,) [length].
        change: The change.
    """

    distance: float
    step: int
    pair: int
    node: int
    X: tuple[float, ...]
    change: Change

    @property
    def is_undecided(self) -> bool:
        """Whether the node is on the kink."""
        return self.distance <= KINK

    def __str__(self) -> str:
        """Node, change and distance as text."""
        return (
            f"step {self.step}, pair {self.pair}: node {self.node} at {format_point(self.X)} "
            f"{self.change} at a distance of {self.distance:.1e}"
        )


def find_kinks(problem: ContactProblem, step: int) -> list[Kink]:
    """Undecided nodes of the present state, and the nearest other one of each pair (local).

    Args:
        problem: The problem, evaluated.
        step: Number of the step.
    """
    found: list[Kink] = []
    for pair, contact in enumerate(problem.equations.contacts):
        if not isinstance(contact, Contact):
            continue
        kinks = [
            Kink(float(distance[j]), step, pair, int(j), tuple(contact.slave.X[j].tolist()), change)
            for change, distance in _distances(contact).items()
            for j in _nearest_nodes(distance)
        ]
        undecided = [kink for kink in kinks if kink.is_undecided]
        found += undecided or sorted(kinks, key=_by_distance)[:1]
    return found


def nearest(kinks: list[Kink]) -> Kink | None:
    """The kink of the smallest distance, ``None`` without contact (local)."""
    return min(kinks, key=_by_distance, default=None)


def _nearest_nodes(distance: Array) -> Indices:
    """Nodes on the kink, or the nearest one; none if no node can change."""
    limit = max(KINK, float(distance.min(initial=np.inf)))
    return np.flatnonzero((distance <= limit) & np.isfinite(distance))


def _by_distance(kink: Kink) -> float:
    return kink.distance


def _distances(contact: Contact) -> dict[Change, Array]:
    """Distances of all nodes from each change, inf where it is not possible, (slave nodes,)."""
    now, law = contact.now, contact.pair.law
    active, covered = contact.active, now.covered
    rounding = LAST_DIGITS * contact.stiffness  # as in the active-set test
    pressure = np.where(np.abs(now.tension) <= rounding, 0.0, np.abs(now.tension))
    largest = float(pressure.max(initial=0.0)) or 1.0
    undecided = np.zeros(active.size, bool)
    undecided[contact.undecided] = True
    found: dict[Change, Array] = {
        "opens": _where(active, pressure / largest),
        "closes": _where(covered & ~active, np.abs(now.mean_gap) / now.nodal_lengths),
        "cover": _where(undecided, np.zeros(active.size)),
    }
    if isinstance(law, Friction):
        limit = np.asarray(now.friction_limit(now.z_n))
        limited = active & (limit > 0.0) & np.isfinite(limit)
        shear = np.abs(now.z_tau) / np.where(limited, limit, 1.0)
        found["slides"] = _where(limited & now.sticking, np.abs(1.0 - shear))
        found["sticks"] = _where(limited & now.sliding, np.abs(now.slip) / now.nodal_lengths)
    return found


def _where(applies: Flags, distance: Array) -> Array:
    return np.where(applies, distance, np.inf)


def status_of(contact: Interface) -> Status:
    """Whether no node of a pair is in contact, or all that are stick (local)."""
    if not contact.active.any():
        return "open"
    if not isinstance(contact, Contact) or not contact.pair.law.has_friction:
        return "other"
    can_slide = contact.active & contact.follows_law
    return "other" if (can_slide & ~contact.now.sticking).any() else "stick"


def flat_remarks(
    contacts: Sequence[Interface],
    statuses: Sequence[Sequence[Status]],
    controls: Sequence[Control],
    by_step: Sequence[Sequence[Array]],
) -> tuple[str, ...]:
    """Describe parameters of laws whose derivative is zero in a whole region (local).

    Args:
        contacts: The pairs.
        statuses: ``status_of`` the pairs, in each step that the objective depends on.
        controls: The controls.
        by_step: Contributions of the steps to the derivatives by each control.
    """
    found = []
    for control, parts in zip(controls, by_step, strict=True):
        if not isinstance(control, LawParameter) or any(part.any() for part in parts):
            continue
        seen = {each[control.pair] for each in statuses}
        if seen and "other" not in seen:
            contact = contacts[control.pair]
            found.append(
                f"the derivative by {control.name} is zero: in all {len(statuses)} steps "
                f"{_reason(contact, seen)} (a flat region, which is not a minimum)"
            )
    return tuple(found)


def _reason(contact: Interface, seen: set[Status]) -> str:
    """Why an objective is flat, and what helps (local)."""
    names = f"'{contact.slave.name}' on '{contact.master.name}'"
    if "stick" not in seen:
        return f"no node of {names} is in contact; choose steps or other parameters with contact"
    return (
        f"all nodes of {names} in contact stick, so that the objective does not depend on the "
        "friction limit; start with less friction, bound it to values with slip, or load until "
        "nodes slide"
    )
