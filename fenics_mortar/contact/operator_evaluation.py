# SPDX-License-Identifier: MIT
"""Evaluation of the operators of one contact with a master surface or an obstacle.

With small sliding, D, M and normals are those of the undeformed mesh; the gap is the present one.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from fenics_mortar.contact.state import InterfaceState
from fenics_mortar.interface.integrals import (
    BodiesBehind,
    MortarOptions,
    evaluate_mortar,
    evaluate_normals,
    find_segments,
)
from fenics_mortar.interface.mortar import LINEARIZATIONS, Linearization, MortarOperators
from fenics_mortar.interface.on_obstacle import evaluate_obstacle
from fenics_mortar.interface.outline import Outline, Sight
from fenics_mortar.interface.space_integrals import evaluate_space
from fenics_mortar.interface.surfaces import POINTS
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils.arrays import Array, Flags


class Reference(NamedTuple):
    """Frozen operators of the undeformed mesh, with multiplier nodes and obstacle position.

    A pickle omits the operators, which belong to a communicator; they are ``None`` then, and are
    integrated again in the next evaluation.
    """

    operators: Any
    multiplier_nodes: Flags
    place: Array

    def __reduce__(self) -> tuple[Any, ...]:
        """How a pickle or a deep copy makes it again (local)."""
        return Reference, (None, self.multiplier_nodes, self.place)


def place_of(reference: Reference | None, obstacle: Obstacle | None) -> Array:
    """Place of the obstacle in frozen operators, (m,) [length, radian]; nan without them.

    With a master surface shape (3,), not used.
    """
    size = 3 if obstacle is None else obstacle.place.size
    return np.full(size, np.nan) if reference is None else reference.place


class OperatorEvaluation:
    """Evaluation of the operators of one contact; does not change the state.

    Args:
        sides: Slave and master.
        obstacle: The rigid master, or ``None``.
        arm: Length by which angles of the obstacle are multiplied [length].
        planes: Normals of slave nodes on symmetry planes, nan elsewhere, shape (slave nodes, 2); in
            space matrices that remove components of normals, shape (slave nodes, 3, 3).
        options: Basis, quadrature, search.
        small: Whether sliding is small.
    """

    def __init__(
        self,
        sides: tuple[Any, Any],
        obstacle: Obstacle | None,
        arm: float,
        planes: Array,
        options: MortarOptions,
        *,
        small: bool,
    ) -> None:
        self.slave, self.master = sides
        self.obstacle, self.arm, self.planes = obstacle, arm, planes
        self.options, self.small = options, small
        self.sight: Sight | None = None
        self.behind: BodiesBehind | None = None
        # of the last state and two initial guesses, also with the multiplier nodes of their cover
        self._recent = deque[tuple[bytes, bytes, Linearization, MortarOperators]](maxlen=5)

    def limit_sight(self, outline: Outline) -> None:
        """Limit the distance of partners behind the slave by the thickness of the bodies (local).

        Without effect on obstacles.
        """
        if self.obstacle is None:
            normals, _ = evaluate_normals(self.slave, self.slave.X, self.options.weighting)
            self.sight = Sight(outline, self.slave, self.master, normals)
            self._recent.clear()

    def evaluate(
        self, u: Array, state: InterfaceState, linearization: Linearization
    ) -> tuple[MortarOperators, Reference | None]:
        """Evaluate the operators at a displacement (collective).

        Args:
            u: Displacement, shape (local dofs,) [length].
            state: State, of which multiplier nodes and frozen operators are used.
            linearization: Derivatives to evaluate.

        Without an obstacle, the operators of an earlier call are returned if their arguments are
        unchanged: initial guesses and the first iterate of a step have equal positions.

        Returns:
            The operators, and those of the undeformed mesh if sliding is small.
        """
        behind, x, m = self._positions_at(u)
        if not self.small:
            return self._at(x, m, state.multiplier_nodes, linearization, behind), None
        kept = state.reference
        if kept is not None and kept.operators is None:
            kept = self.reference_at(kept.place, state.multiplier_nodes)
        if kept is None or not np.array_equal(kept.multiplier_nodes, state.multiplier_nodes):
            kept = self.evaluate_reference(state.multiplier_nodes)
        place = [] if self.obstacle is None else [kept.place]
        moved = kept.operators.after_small_motion(x, m, *place)
        exact = replace(moved.linearization, exact=linearization.exact)
        return replace(moved, linearization=exact), kept

    def _at(
        self, x: Array, m: Array, multiplier_nodes: Flags, linearization: Linearization,
        behind: BodiesBehind | None,
    ) -> MortarOperators:  # fmt: skip
        """As ``_integrate``, or a recent result for the same arguments (collective)."""
        if self.obstacle is not None:
            return self._integrate(x, m, multiplier_nodes, linearization, behind)
        points = (np.concatenate([x, m]) if behind is None else behind.outline[0]).tobytes()
        nodes, searched = multiplier_nodes.tobytes(), None
        for at, of_nodes, terms, operators in self._recent:
            same = at == points and terms == linearization
            if same and of_nodes == nodes:
                self.behind = behind
                return operators
            searched = operators if same else searched
        operators = self._integrate(x, m, multiplier_nodes, linearization, behind, searched)
        self._recent.appendleft((points, nodes, linearization, operators))
        return operators

    def evaluate_reference(self, multiplier_nodes: Flags) -> Reference:
        """Evaluate the operators of the undeformed mesh (collective).

        Args:
            multiplier_nodes: Whether a slave node carries a multiplier, (slave nodes,), bool.
        """
        behind, X, X_master = self._positions_at(None)
        operators = self._integrate(X, X_master, multiplier_nodes, LINEARIZATIONS["frozen"], behind)
        place = np.zeros(3) if self.obstacle is None else self.obstacle.place.copy()
        return Reference(operators.freeze(), multiplier_nodes, place)

    def reference_at(self, place: Array, multiplier_nodes: Flags) -> Reference | None:
        """Operators of the undeformed mesh of an earlier state (collective).

        Args:
            place: ``place_of`` the reference of that state.
            multiplier_nodes: Multiplier nodes of that state, shape (slave nodes,), bool.
        """
        if np.isnan(place).any():
            return None
        if self.obstacle is None:
            return self.evaluate_reference(multiplier_nodes)
        now, self.obstacle.place = self.obstacle.place, place.copy()
        try:
            return self.evaluate_reference(multiplier_nodes)
        finally:
            self.obstacle.place = now

    def at_outline(
        self, outline: Outline, x: Array, state: InterfaceState, linearization: Linearization
    ) -> MortarOperators:
        """Evaluate the operators with the nodes of outlines at given positions (collective).

        Args:
            outline: Outlines of the bodies of all pairs.
            x: Positions of their nodes, shape (n, dim) [length].
            state: See ``evaluate``.
            linearization: See ``evaluate``.
        """
        on_slave, on_master = (x[outline.indices_of(s.nodes)] for s in (self.slave, self.master))
        behind, kept = None, self.behind
        if self.sight is not None:
            behind = self.sight.behind(x[outline.indices_of(self.sight.outline.nodes)])
        try:
            nodes = state.multiplier_nodes
            return self._integrate(on_slave, on_master, nodes, linearization, behind)
        finally:
            self.behind = kept

    def intersections(self, o: MortarOperators) -> Any:
        """Intersections of this rank's slave facets with the master, for any integration (local).

        Args:
            o: Operators at the positions that define the partners.
        """
        if self.options.integration == "segments" or self.obstacle is not None or o.slave.dim == 3:
            return o.segments
        options = replace(self.options, integration="segments", points=POINTS)
        at = o.x, o.n, o.m, o.segments.facets
        return find_segments(self.slave, self.master, *at, options, self.behind)

    def _positions_at(self, u: Array | None) -> tuple[BodiesBehind | None, Array, Array]:
        """Bodies behind the slave; positions of both sides, undeformed for None (collective)."""
        sides = self.slave, self.master
        if self.sight is not None:
            behind, *moved = self.sight.behind_at(u)
        else:
            behind, moved = None, [0.0 * side.X if u is None else side.gather(u) for side in sides]
        x, m = [side.X + change for side, change in zip(sides, moved, strict=True)]
        return behind, x, m

    def _integrate(
        self,
        x: Array,
        m: Array,
        multiplier_nodes: Flags,
        linearization: Linearization,
        behind: BodiesBehind | None,
        searched: Any = None,
    ) -> MortarOperators:
        """Operators with slave nodes at ``x`` and master nodes at ``m`` (collective).

        ``searched``: see ``evaluate_mortar``.
        """
        self.behind = behind
        if self.obstacle is None:
            evaluate: Any = evaluate_mortar if self.slave.dim == 2 else evaluate_space
            return evaluate(
                self.slave, self.master, x, m, multiplier_nodes, self.planes, self.options,
                linearization, behind, searched,
            )  # fmt: skip
        return evaluate_obstacle(
            self.slave, self.master, self.obstacle, self.arm, x, multiplier_nodes, self.planes,
            self.options, linearization,
        )  # fmt: skip
