# SPDX-License-Identifier: MIT
"""Discretization of a pair: choices for research and for comparison with other codes.

The default is the most accurate choice. Others reproduce other codes, or serve to measure the
effect of a choice. ``PRESETS`` names sets of conventions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import get_args

import numpy as np

from fenics_mortar.contact.slip import Measure
from fenics_mortar.interface.segments import (
    Basis,
    GapWeights,
    Integration,
    MortarOptions,
    Weighting,
)
from fenics_mortar.utils.arguments import check_choice, check_kind, check_number

# Options of a tied pair: it has no active set, no slip, and no normals in its gap vector.
OF_TIES = ("basis", "points", "max_angle")


@dataclass(frozen=True)
class Discretization:
    """Discretization of a pair: multipliers, normals, weighted gap, integration, slip.

    The options are checked by the pair, on all ranks together. Presets: "default" is
    ``Discretization()``. "other_codes" has unit weights of the normals, gaps weighted by the
    multiplier functions and slip from changes of D and M, as 4C; solutions agree with 4C to
    rounding where facets are fully covered; in space the rules of a triangle have 7 points (12 on
    quadratic facets) whatever the shape of the facets. "petrov_galerkin" weights gaps by the
    standard functions, with dual multipliers (Popp, Seitz, Gee & Wall 2013).
    ``dataclasses.replace`` makes a variant of a preset.

    Attributes:
        basis: "dual" (diagonal D, can be condensed) or "standard" multipliers at all nodes; on
            quadratic facets also linear functions at their vertices only: "vertices", which can be
            condensed, or "linear", the standard linear functions of other codes. The two are equal
            on straight, fully covered facets. They have half as many multipliers, but the pressure
            overshoots at the edge of contact. "quadratic": as "dual", but on triangles with six
            nodes, where all others are linear, quadratic functions at all nodes, with pressures
            that scatter a third as much, in a saddle point as well.
        normals: Weights of the facet normals at a slave node: "opposite" (length of the other
            facet: exact on circles), "unit" (the choice of most codes) or "own" length. With
            "opposite", corners inside the slave take the normal of the facet that faces the master.
            On an obstacle, which defines the normals, they affect symmetry planes only.
        gap_weights: Functions that weight the gap of a node. "cover": the multiplier function if
            the node is covered. Beyond the edge of the master, a dual function would extrapolate
            the gap to the node and produce an overlap where there is none; the gap is evaluated at
            the edge instead. "basis": always the multiplier function, as in most codes. "standard":
            the standard functions (Petrov-Galerkin), with dual multipliers only. On an obstacle,
            which has no ends, and in space "cover" equals "basis".
        integration: Quadrature points of D, M and gap. "segments": exact, on each intersection of a
            slave and a master facet. "elements": ``points`` Gauss points per slave facet, as in
            many codes; forces balance, but the error of a transferred uniform pressure depends on
            how well the points resolve the ends of master facets. A facet with fewer partners than
            nodes counts as uncovered. "nodes": the slave nodes (node-to-segment contact), those
            with a partner with their full weight. The last two are for comparison: forces have
            jumps or kinks where points change partners. On an obstacle "segments" and "elements"
            are equal: Gauss points on whole slave facets.
        points: Gauss points per segment, with "elements" per slave facet; at least as many as a
            facet has nodes. ``None``: 5, with "elements" 5 per interval between two nodes. In
            space points per triangle of the common part of two facets, of a rule of 3, 6, 7, 12,
            16, 25 or 36 points. ``None``: 7, on quadratic facets 12, which are exact for
            parallelograms and straight-sided triangles; 16 or 25 on surfaces with other quads,
            where the integrands are rational, and in self-contact, where edges of both sides of a
            fold coincide. On other quads a uniform pressure passes to 2e-9 with 16 points if nodes
            are moved by 20 %, and to rounding with 36. The pieces of quadratic facets have straight
            edges: edges that bend within the surface leave an error.
        slip: Measure of slip for friction, see ``slip``. "partners": motion of a node along the
            material points that it faced at the start of the step. "operators": changes of D and M,
            as in most codes. With small sliding, where these are constant, and on obstacles both
            are "partners"; otherwise in space both are "operators".
        max_angle: Largest angle between the slave normal and the reversed master normal [degree].
            Steeper facets, such as the side of a block that stands on the slave, are not partners.
        c_n: Weight of the gap in the active-set test [1]. The result does not depend on it, nor the
            number of iterations between 1e-8 and 1. Larger weights open nodes because of the gaps
            that remain after a nonlinear step.
    """

    basis: Basis = "dual"
    normals: Weighting = "opposite"
    gap_weights: GapWeights = "cover"
    integration: Integration = "segments"
    points: int | None = None
    slip: Measure = "partners"
    max_angle: float = 70.0
    c_n: float = 1e-3

    def check(self) -> None:
        """Raise an error for options that are not allowed or contradict each other (local).

        Raises:
            ValueError: For such an option; the message names it and the allowed ones.
        """
        for name, allowed in (
            ("basis", get_args(Basis)),
            ("normals", get_args(Weighting)),
            ("gap_weights", get_args(GapWeights)),
            ("integration", get_args(Integration)),
            ("slip", get_args(Measure)),
        ):
            check_choice(name, getattr(self, name), allowed)
        self._check_combination()
        if self.points is not None:
            per = "segment" if self.integration == "segments" else "facet"
            expected = f"a whole number, at least 2 per {per}"
            check_number("points", self.points, expected, lambda n: n >= 2, whole=True)
        expected = "a number between 0 and 90 degrees"
        check_number("max_angle", self.max_angle, expected, lambda angle: 0.0 < angle < 90.0)
        check_number("c_n", self.c_n, "a positive number", lambda c: 0.0 < c < np.inf)

    def options(self, points: int, radius: float) -> MortarOptions:
        """Options of the operators (local).

        Args:
            points: Gauss points per segment, with "elements" per slave facet.
            radius: Search radius along the normal [length].
        """
        return MortarOptions(
            self.basis,
            self.normals,
            self.gap_weights,
            self.integration,
            points,
            radius,
            float(np.cos(np.radians(self.max_angle))),
            corners=self.normals == "opposite",
        )

    def _check_combination(self) -> None:
        """Raise for options without effect or meaning in combination with another one (local)."""
        if self.integration == "nodes":
            at_nodes = {
                "points": "the points are the nodes",
                "basis": "all multiplier functions are equal at the nodes",
                "gap_weights": "all weights of the gap are equal at the nodes",
            }
            self._refuse_set(at_nodes, "integration='nodes'")
        if self.gap_weights == "standard" and self.basis in ("standard", "linear", "quadratic"):
            raise ValueError(
                f"gap_weights='standard' with basis='{self.basis}': Petrov-Galerkin needs dual "
                "multipliers, basis='dual' or 'vertices'; gap_weights='basis' weights the gap by "
                "the standard functions here"
            )

    def check_for_tie(self) -> None:
        """Raise an error for options that a tied pair does not have (local).

        Raises:
            ValueError: For such an option.
        """
        self.check()
        why = f"a tie has {', '.join(OF_TIES)} only"
        others = {field.name: why for field in fields(self) if field.name not in OF_TIES}
        self._refuse_set(others, "TiedPair")

    def _refuse_set(self, reasons: Mapping[str, str], where: str) -> None:
        """Raise for options, given by name with a reason, that are not the default (local)."""
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in reasons and value != field.default:
                raise ValueError(
                    f"{field.name}={value!r} with {where}: {reasons[field.name]}; expected "
                    f"{field.default!r}"
                )


PRESETS: Mapping[str, Discretization] = MappingProxyType(
    {
        "default": Discretization(),
        "other_codes": Discretization(normals="unit", gap_weights="basis", slip="operators"),
        "petrov_galerkin": Discretization(gap_weights="standard"),
    }
)


def as_discretization(given: str | Discretization) -> Discretization:
    """Discretization of a preset given by name; a ``Discretization`` is returned as is (local).

    Raises:
        ValueError: For an unknown name or an object of another type.
    """
    if isinstance(given, str):
        check_choice("discretization", given, PRESETS)
        return PRESETS[given]
    expected = f"an instance of Discretization, or one of {', '.join(PRESETS)}"
    check_kind("discretization", given, Discretization, expected)
    return given
