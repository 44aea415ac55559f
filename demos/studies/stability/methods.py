# SPDX-License-Identifier: MIT
"""Methods of the stability study: the default, and variants with one change."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, field
from functools import partial
from typing import Any
from unittest.mock import patch

from demos.studies.stability.whole_facet import whole_facet_basis
from fenics_mortar.bulk import residual as bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.law import Coulomb, Nodal
from fenics_mortar.equations import solver
from fenics_mortar.newton import loop as newton
from fenics_mortar.rigid.floating import FloatingBodies


@dataclass(frozen=True)
class Method:
    """Options that differ from the defaults.

    Attributes:
        title: Name in the picture and the table.
        problem: Arguments of ``ContactProblem``.
        pair: Arguments of ``ContactPair``.
        newton: Arguments of ``NewtonOptions``.
        adaptive: ``follow_path``, or the problem's fixed steps by plain calls of ``solve``.
        smallest: Smallest step over that of the problem; ``None``: the default of ``follow_path``.
            If contrast methods fail, they fail at any step: most of the time would be spent on the
            last cuts.
        override: Context that changes the package while the cell runs.
        scenes: Patterns of the problems on which it differs from the default.
    """

    title: str
    problem: dict[str, Any] = field(default_factory=dict)
    pair: dict[str, Any] = field(default_factory=dict)
    newton: dict[str, Any] = field(default_factory=dict)
    adaptive: bool = True
    smallest: float | None = 1.0 / 64.0
    override: Callable[[], AbstractContextManager] = nullcontext
    scenes: str = "*"


BOUND = Coulomb.limit


def frozen_cone() -> AbstractContextManager:
    """Friction limit is constant in an iteration, mu times the pressure of the last iterate.

    The tangent of a sliding body is then symmetric, as required by some codes.
    """

    def limit(law: Coulomb, node: Nodal) -> tuple[Any, Any, Any]:
        return BOUND(law, node)[0], 0.0, 0.0

    return patch.object(Coulomb, "limit", limit)


def bound_by_pressure() -> AbstractContextManager:
    """Friction limit from the pressure, not from the active-set test."""
    return patch.dict(Coulomb.__init__.__kwdefaults__, limit_by="pressure")


FRICTION = "rubbing*,reversal,slope"
# Problems with long or difficult steps; in others no step is shortened.
DAMPED = "step_size,stiffness,bouncing,*arch,ironing,rubbing*,corner*,press_fit,roll,cantilevers"

METHODS = {
    "default": Method("default", smallest=None),
    "saddle": Method("Alg. 1, saddle", problem={"algorithm": "saddle"}),
    "standard": Method("standard basis", pair={"basis": "standard"}),
    "plain": Method("plain Newton", adaptive=False),
    "line_search": Method("with line search", newton={"line_search": True}, scenes=DAMPED),
    "short_moves": Method("half a facet at most", newton={"max_motion": 0.5}, scenes=DAMPED),
    "no_normals": Method("without normals", problem={"linearization": "no_normals"}),
    "no_segments": Method("without segment motion", problem={"linearization": "no_segments"}),
    "frozen": Method("fixed point", problem={"linearization": "frozen"}),
    "plain_frozen": Method(
        "plain fixed point", problem={"linearization": "frozen"}, adaptive=False
    ),
    "by_pressure": Method("bound by pressure", override=bound_by_pressure, scenes=FRICTION),
    "frozen_cone": Method("frozen cone", override=frozen_cone, scenes=FRICTION),
    "whole_facet": Method(
        "basis of whole facets", pair={"gap_weights": "basis"}, override=whole_facet_basis
    ),
    "elements": Method("element quadrature", pair={"integration": "elements"}),
    "nodes": Method("node to segment", pair={"integration": "nodes"}),
}


def replaced(*changes: tuple[Any, str, Any]) -> AbstractContextManager:
    """Context with replaced functions of the package: (owner, name, function)."""
    stack = ExitStack()
    for owner, name, function in changes:
        stack.enter_context(patch.object(owner, name, function))
    return stack


def without(*changes: tuple[Any, str, Any]) -> Callable[[], AbstractContextManager]:
    """Function that returns the context of ``replaced``."""
    return partial(replaced, *changes)


def give_up(equations: Any, options: Any, failed: Exception) -> None:
    """Replacement of ``solve_with_springs`` that raises the error."""
    raise failed


@dataclass(frozen=True)
class Remedy:
    """A feature of the default, and a problem that needs it.

    Attributes:
        title: Description of the feature.
        scene: Name of a family.
        value: Value of the problem, as text.
        beside: Name of the method that has the remedy.
        method: The method without the remedy.
    """

    title: str
    scene: str
    value: str
    beside: str
    method: Method


REMEDIES = {
    "no_step_cuts": Remedy(
        "a step that fails is taken back and cut",
        "pushed_arch",
        "60",
        "default",
        Method("no cuts", adaptive=False),
    ),
    "no_cycles": Remedy(
        "cycles of the active set are left",
        "weight_of_gap",
        "10000.0",
        "plain",
        Method(
            "cycles not left",
            adaptive=False,
            override=without((newton, "period_of", lambda sets: 0), (newton, "UNSETTLED", 1000)),
        ),
    ),
    "no_shortening": Remedy(
        "Newton steps that would invert cells are shortened",
        "ironing",
        "10",
        "plain",
        Method("cells invert", adaptive=False, override=without((bulk, "MIN_FRACTION", 2.0))),
    ),
    "no_settling": Remedy(
        "bodies that loads drive are moved until contact stops them",
        "falling_wheel",
        "10",
        "default",
        Method("not moved", override=without((solver, "settle", lambda *given: []))),
    ),
    "no_springs": Remedy(
        "vanishing springs on rigid modes that contact leaves free",
        "thin_ring",
        "0.1",
        "default",
        Method("no spring", override=without((FloatingBodies, "add_springs", lambda *given: None))),
    ),
    "no_anchors": Remedy(
        "springs on bodies that roll",
        "falling_wheel",
        "1",
        "plain",
        Method(
            "no anchors",
            adaptive=False,
            override=without((solver, "solve_with_springs", give_up)),
        ),
    ),
    "no_holding": Remedy(
        "springs on obstacles that roll",
        "rigid_tool",
        "free egg, 0.01",
        "default",
        Method("no anchors", override=without((solver, "solve_with_springs", give_up))),
    ),
    "meshed_gaps": Remedy(
        "gaps can be set, whatever the facets leave",
        "press_fit",
        "12:16",
        "default",
        Method("gaps as meshed", pair={"initial_gap": None}),
    ),
    "no_cover_weights": Remedy(
        "beyond the edge of the master the gap is that of the edge",
        "near_miss",
        "0.01",
        "default",
        Method("gaps by the basis", pair={"gap_weights": "basis"}),
    ),
    "no_hand_over": Remedy(
        "hardly covered nodes hand their multiplier to a neighbour",
        "corner_on_flat",
        "3 flat",
        "default",
        Method(
            "not handed over",
            override=without((Contact, "update_multiplier_nodes", lambda self: 0)),
        ),
    ),
}

ALL_METHODS = METHODS | {name: remedy.method for name, remedy in REMEDIES.items()}
