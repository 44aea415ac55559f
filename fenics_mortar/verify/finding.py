# SPDX-License-Identifier: MIT
"""What a check of the certificate needs and yields: limits, the state of a pair, findings."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from fenics_mortar.interface.surfaces import POINTS
from fenics_mortar.obstacles.rigid_motion import RIGID
from fenics_mortar.utils.arrays import HALF_FACET, SOLVED, Array, Indices
from fenics_mortar.utils.ranks import any_over_ranks

if TYPE_CHECKING:
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.contact.interface import Interface


@dataclass(frozen=True)
class Limits:
    """Thresholds of several checks of a state; those of a single check are in its module.

    Attributes:
        tolerance: Limit for quantities that vanish in a solution of the equations [1].
        penetration: Limit for penetration and distance between the nodes [facet lengths].
        unpaired: Smallest depth of crossing surfaces that no pair keeps apart that is an error
            [facet lengths]; smaller ones are below the error of displacements.
        unloaded: Smallest depth of the sides of a pair in each other, beside nodes without force,
            that is an error [facet lengths]: curved surfaces touch a coarse facet by less. In the
            plane a corner of the master touches a facet early or late by up to as much.
        coarse_unloaded: Smallest such depth with a remark [facet lengths]: a ball or a tip that
            enters a facet between its nodes by as much has no force.
        negligible: Force over the contact force below which it is smaller than the error of the
            discretization: 0.5 %, for springs and for shear caused by corners.
        min_pressure: Smallest reference of pressures, as a fraction of the stiffness [1]: smaller
            pressures may be rounding.
        min_force: Smallest reference of forces, as a fraction of stiffness times displacement [1].
        coarse_penetration: Smallest penetration with a remark [facet lengths]; curved bodies on
            coarse meshes overlap by less.
        coarse_distance: Smallest distance with a remark [facet lengths].
        missed: Smallest penetration between the nodes with a remark if no force acts [facet
            lengths]: positions in files of few digits overlap by less.
        at_corners: Threshold at corners and ends [1], above the error of estimates there (a few
            per cent), for the sine of the angle of oblique forces, the excess of the shear
            of a sticking corner over the friction limit, and the pressure over the largest
            pressure.
        corner: Angle between the facets at a node above which it is a corner, not part of a curve
            [radian].
        sharp_corner: The same where curves may be coarse [radian]: polygons with more than six
            sides count as circles.
        section_turn: Largest rotation of a body in one straight section of its path [radian], which
            shrinks it by 8 %. A path of less than half a facet did not pass through an obstacle if
            the normals at its ends differ by less.
        two_ways: Rotation above which a body may have turned the other way in a step [radian]: a
            sixth of a full turn, so that turns of up to five sixths are recognized.
        deep: Depth of a path below the surface of an obstacle over its chord [1] above which it
            does not slide along the surface. Paths through a round obstacle have 0.24 at least,
            those of nodes pressed into it the depth over the diameter.
        max_points: Largest number of points on a path, which limits the time of the check.
        bare: Covered fraction of a reference facet below which it is uncovered [1].
        samples: Number of points on a segment at which gaps are evaluated.
    """

    tolerance: float = SOLVED
    penetration: float = HALF_FACET
    unpaired: float = 0.01
    unloaded: float = 0.1
    coarse_unloaded: float = 0.02
    negligible: float = RIGID.negligible
    min_pressure: float = SOLVED
    min_force: float = 1e-4
    coarse_penetration: float = 0.2
    coarse_distance: float = 0.05
    missed: float = 1e-3
    at_corners: float = 0.1
    corner: float = 0.3
    sharp_corner: float = np.pi / 3
    section_turn: float = np.pi / 4
    two_ways: float = np.pi / 3
    deep: float = 0.1
    max_points: int = 2000
    bare: float = 0.01
    samples: int = POINTS


LIMITS = Limits()
# Points of a segment at which gaps between the nodes are measured, -1 ... 1, ends included.
POINTS_BETWEEN = np.linspace(-1.0, 1.0, LIMITS.samples)

# Remedy for curved surfaces with straight facets.
CURVED = "cells of order 2 (gmsh.model.mesh.setOrder(2)) with displacements of degree 2"


Verdict = Literal["", "ok", "remark", "violation"]
INFINITE = math.inf


@dataclass(frozen=True)
class Finding:
    """Value of one check; all methods are local.

    Attributes:
        name: Short name, ``pair["name"]`` of a ``PairCertificate``.
        check: What is checked, in a few words, for the printed table.
        value: Measured value [its unit], zero for an exact solution.
        text: What a value above a limit means and what helps; by default ``check`` with its value.
        limit: Value above which the state is wrong [its unit]; inf if there is none.
        remark: Value above which results may be inaccurate or not unique [its unit]; inf if there
            is none.
        unit: Unit of value and limits; "" for ratios and numbers.
        where: Position of the largest contribution, "" if there is none.
    """

    name: str
    check: str
    value: float
    text: str = ""
    limit: float = INFINITE
    remark: float = INFINITE
    unit: str = ""
    where: str = ""

    @property
    def verdict(self) -> Verdict:
        """``"ok"``, ``"remark"`` or ``"violation"``; "" for a value without limits."""
        if not self.value <= self.limit:
            return "violation"
        if self.value > self.remark:
            return "remark"
        return "ok" if min(self.limit, self.remark) < INFINITE else ""

    @property
    def message(self) -> str:
        """Description of a value above a limit."""
        least = format_value(min(self.limit, self.remark))
        return self.text or f"{self.check}: {format_value(self.value)} (allowed {least})"


def format_value(value: float) -> str:
    """Two digits, or those of the integer part up to 1e6; 0 for -0 (local)."""
    return f"{value:.0f}" if 100.0 <= abs(value) < 1e6 else f"{value + 0.0:.2g}"


@dataclass(frozen=True)
class Measured:
    """An evaluated pair; all properties are local.

    Attributes:
        contact: The pair.
        paired: Global numbers of the nodes with a partner in any pair, ascending.
        inside: Global numbers of nodes of the pair inside another body of it, ascending.
        solved: Force up to which the equations are solved [stress length].
    """

    contact: Contact
    paired: Indices
    inside: Indices
    solved: float

    @cached_property
    def pressure(self) -> Array:
        """Normal multipliers, shape (slave nodes,) [stress]."""
        return np.asarray(np.einsum("jc,jc->j", self.contact.operators.n, self.contact.z))

    @cached_property
    def is_pressed(self) -> bool:
        """Whether the normal forces are more than the error of the solution."""
        return float(np.maximum(self.pressure, 0.0) @ self.contact.operators.weight) > self.solved

    @cached_property
    def friction_limit(self) -> Array:
        """Largest shears, zero at nodes without contact, shape (slave nodes,) [stress]."""
        contact = self.contact
        may_transfer = contact.acts if contact.pair.law.bridges_gap else contact.active
        return np.where(may_transfer, contact.now.friction_limit(self.pressure), 0.0)

    @cached_property
    def largest_pressure(self) -> float:
        """Reference of pressures [stress]; above rounding."""
        smallest = LIMITS.min_pressure * float(self.contact.modulus.max())
        return max(float(np.abs(self.pressure).max()), smallest)

    @cached_property
    def friction(self) -> float:
        """Sum of friction limits over sum of pressures, of nodes under pressure [1]."""
        return mean_friction(self.friction_limit, self.pressure)


def mean_friction(limit: Array, pressure: Array) -> float:
    """Sum of friction limits over sum of pressures, of nodes under pressure [1] (local).

    Args:
        limit: Friction limit of each node, shape (slave nodes,) [stress].
        pressure: Normal multipliers, shape (slave nodes,) [stress].
    """
    presses = (pressure > 0.0) & (limit > 0.0)
    return float(limit[presses].sum() / pressure[presses].sum()) if presses.any() else 0.0


# What is wrong with an overlap of a body without any pair.
IN_NO_PAIR = (
    "; at least one of them belongs to no pair, and nothing keeps them apart: add a ContactPair, "
    "if they may touch"
)


@dataclass(frozen=True)
class Crossing:
    """Deepest crossing of the outlines of two bodies, or of one outline with itself; all is local.

    Attributes:
        sides: Names of the surfaces, or of the bodies outside surfaces of pairs.
        where: Position, as text.
        depth: Depth of one body in the other [length].
        facets: Depth over the facet's length [1].
        admitted: Depth above which the state is wrong [facet lengths].
        is_paired: Whether a pair keeps these surfaces apart, or boundary conditions hold both.
        hint: What the pair does not see there.
        remark: Depth above which there is a remark [facet lengths].
    """

    sides: tuple[str, str]
    where: str
    depth: float
    facets: float
    admitted: float = LIMITS.penetration
    is_paired: bool = True
    hint: str = ""
    remark: float = LIMITS.coarse_penetration

    def __str__(self) -> str:
        """The crossing as text."""
        first, second = self.sides
        who = f"{first} crosses itself" if first == second else f"{first} and {second} cross"
        found = f"{who} at {self.where}, {self.depth:.3g} deep ({self.facets:.2g} facets)"
        if self.is_paired:
            return found + self.hint
        kind = "ContactPair(data, surface)" if first == second else "ContactPair"
        return f"{found}; no pair keeps these surfaces apart: add a {kind}"

    def in_no_pair(self) -> Crossing:
        """The same as a remark, if a body has no pair, of an overlap that grew (local)."""
        return replace(
            self, is_paired=True, hint=IN_NO_PAIR, admitted=math.inf, remark=self.admitted
        )


def paired_nodes(contact: Interface) -> Indices:
    """Global numbers of the nodes of both surfaces that have a partner, (n,) (collective)."""
    paired = np.zeros(contact.master.num_nodes, bool)
    paired[contact.intersections().master.ravel()] = True
    paired = any_over_ranks(contact.slave.comm, paired)
    return np.concatenate(
        [contact.slave.nodes[contact.now.has_partner], contact.master.nodes[paired]]
    )
