# SPDX-License-Identifier: MIT
"""Checks before each solve of places, loads and pivots of obstacles and remote loads."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from fenics_mortar.bulk.residual import Bulk, mark_prescribed
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.obstacles.rigid_motion import DRIVEN_TURNS, RigidMotion
from fenics_mortar.rigid.motions import RigidMotions
from fenics_mortar.rigid.spread import SpreadLoad
from fenics_mortar.utils.arguments import check_no_effect, parameters_of
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError, NotFiniteError, format_point


class MotionInputs:
    """Checks of the places and loads of a problem that users may set.

    The constructor is collective.

    Args:
        bulk: The bodies.
        motions: Rigid motions of obstacles and remote loads.
    """

    def __init__(self, bulk: Bulk, motions: RigidMotions) -> None:
        self._bulk = bulk
        self._given = [*motions.movers, *(load.motion for load in motions.spread)]
        of_boundaries = [load for load in motions.remote if load in bulk.bcs]
        self._boundaries: list[tuple[Any, Any]] = [
            (load, mark_prescribed(bulk.space, bulk.u, [bc for bc in bulk.bcs if bc is not load]))
            for load in of_boundaries
        ]
        self.remember()

    def remember(self) -> None:
        """Remember the pivots, and by how much the movers have turned (local)."""
        self._turned = [(m.pivot.copy(), _angle_of(m)) for m in self._given]

    def check(self) -> None:
        """Reject invalid values (local).

        Raises:
            MortarError: If a value has another shape or type, is not finite, or not admissible.
            ValueError: If a dimension of a shape of the package was set as an attribute.
        """
        for mover, before in zip(self._given, self._turned, strict=True):
            check_numbers(mover)
            _check_pivot(mover, *before)
            if self._bulk.space.is_axisymmetric and isinstance(mover, RigidMotion):
                check_axial(mover)
            if isinstance(mover, SpreadLoad) and np.isnan(mover.load).any():
                raise MortarError(f"load of {mover.kind} '{mover.name}' is nan: expected numbers")

    def numbers(self) -> Iterator[tuple[str, Any]]:
        """Arrays that have to be equal on all ranks, by name (local)."""
        for mover in self._given:
            for what, value in (("place", mover.place), ("push", mover.load)):
                yield f"the {what} of {mover.kind} '{mover.name}'", value
            yield f"the pivot of {mover.kind} '{mover.name}'", mover.pivot

    def check_conditions(self) -> None:
        """Reject driven motions of nodes that other conditions prescribe (collective).

        Raises:
            MortarError: On all ranks.
        """
        for load, prescribed in self._boundaries:
            count, where = self._bulk.input_data.count_nodes(load.driven_dofs() & prescribed)
            if count:
                raise MortarError(
                    f"{count} nodes of rigid boundary '{load.motion.name}', one at {where}, are "
                    "prescribed by another condition in a direction in which a push drives them: "
                    "leave them out of one of both, or prescribe that motion by move()"
                )


def check_numbers(mover: RigidMotion) -> None:
    """Reject places, loads or pivots that are not numbers (local).

    Raises:
        MortarError: If a value has another shape or type, or is not finite.
        ValueError: If a dimension of a shape of the package was set as an attribute.
    """
    name = f"{mover.kind} '{mover.name}'"
    count = 3 if mover.dim == 2 else 6
    for what, size in (("place", count), ("load", count), ("pivot", mover.dim)):
        given = np.asarray(getattr(mover, what))
        fixed = ", or nan for prescribed motions" if what == "load" else ""
        expected = f"expected {size} finite numbers{fixed}"
        allowed = np.nan_to_num(given, posinf=np.inf, neginf=-np.inf) if what == "load" else given
        if given.shape != (size,) or given.dtype.kind not in "iuf":
            raise MortarError(f"{what} of {name} is {given!r}: {expected}")
        if not np.isfinite(allowed).all():
            raise NotFiniteError(f"{what} of {name} is {given}: {expected}")
    turns = int(np.isfinite(mover.load[mover.dim :]).sum())
    if turns not in DRIVEN_TURNS:
        raise MortarError(
            f"load of {name} is {mover.load}: expected moments about none, one or all of the axes"
        )
    if isinstance(mover, Obstacle) and type(mover).__module__.startswith(
        Obstacle.__module__.rpartition(".")[0]
    ):
        of_shape = [what for what in parameters_of(mover) if what not in ("name", "pivot")]
        shape = " or ".join(f"set_shape({what!r}, ...)" for what in mover.shape())
        cure = f"use {shape or 'another obstacle in a new problem'}"
        check_no_effect(name, mover, of_shape, cure)


def _angle_of(mover: RigidMotion) -> float:
    """The angle by which a mover has turned [radian] (local)."""
    turn = mover.place[mover.dim :]
    return float(turn[0] if mover.dim == 2 else np.linalg.norm(turn))


def _check_pivot(mover: RigidMotion, pivot: Array, angle: float) -> None:
    """Reject a new pivot of what had turned by ``angle`` about ``pivot`` (local)."""
    if np.isfinite(mover.load[mover.dim :]).any():  # driven: turned by the last solve
        angle = _angle_of(mover)
    if angle != 0.0 and (np.asarray(mover.pivot) != pivot).any():
        raise MortarError(
            f"pivot of {mover.kind} '{mover.name}' was changed from {format_point(pivot)} to "
            f"{format_point(mover.pivot)} after the {mover.kind} had turned by {angle:.4g} radian, "
            "which would shift its surface: set the pivot before it turns, e.g. Circle(centre, "
            "radius, pivot=...)"
        )


def check_axial(mover: RigidMotion) -> None:
    """Reject forces other than axial ones on what is a body of revolution (local).

    Raises:
        MortarError: If its radial motion or its rotation is driven, or a load spread so.
    """
    across = mover.load[[0, 2]]
    if across.any() if isinstance(mover, SpreadLoad) else np.isfinite(across).any():
        raise MortarError(
            f"{mover.kind} '{mover.name}' is pushed radially or turned: a rigid body of revolution "
            "moves along its axis only; expected push(y=...), and move(x=..., angle=...) for tools "
            "that change their shape"
        )
