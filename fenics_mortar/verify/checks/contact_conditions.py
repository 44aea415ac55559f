# SPDX-License-Identifier: MIT
"""Conditions of contact at the nodes: signs of forces and gaps, and their product."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fenics_mortar.contact.messages import describe_search_radius
from fenics_mortar.contact.tied import Tie
from fenics_mortar.utils.errors import format_point
from fenics_mortar.verify.finding import Finding
from fenics_mortar.verify.limits import LIMITS
from fenics_mortar.verify.measured import Measured


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Tension, shear, overlap and complementarity (local).

    Yields:
        ``tension``: excess of -z_n over the adhesion a, over the largest pressure or tension;
        ``shear``: excess of the tangential multiplier over the friction limit, over the largest
        pressure (or the friction limit, if larger); ``overlap``: largest negative mean gap of a
        slave node over its length; ``complementarity``: largest |(z_n + a) g| over largest pressure
        times length.
    """
    contact, largest, limit = measured.contact, measured.largest_pressure, LIMITS.tolerance
    excess, tension = np.abs(contact.z_tau) - measured.friction_limit, contact.now.tension
    gap = contact.now.closing_gap / contact.slave.nodal_lengths
    gap[np.isnan(gap)] = 0.0  # uncovered nodes
    yield Finding(
        "tension",
        "tension above the adhesion / largest pressure",
        max(float(tension.max()), 0.0) / largest,
        limit=limit,
    )
    yield Finding(
        "shear",
        "shear above the friction limit / largest pressure",
        max(float(excess.max()), 0.0) / max(largest, float(measured.friction_limit.max())),
        limit=limit,
    )
    overlap, where = max(-float(gap.min()), 0.0), format_point(contact.operators.x[gap.argmin()])
    yield Finding(
        "overlap",
        "overlap at the nodes",
        overlap,
        f"overlap {overlap:.1e} (allowed {limit:.1e}) at {where}, in facets; partners are searched "
        f"{describe_search_radius(contact)}",
        limit=limit,
        unit="facet lengths",
        where=where,
    )
    yield Finding(
        "complementarity",
        "pressure at open gaps / largest pressure",
        float(np.abs(tension * gap).max()) / largest,
        limit=limit,
    )


def of_tie(tie: Tie) -> Iterator[Finding]:
    """Largest distance of the sides; a tied pair carries tension and shear (local)."""
    yield Finding(
        "tie_distance",
        "distance of tied sides",
        float(np.nanmax(tie.gap / tie.slave.nodal_lengths)),
        limit=LIMITS.tolerance,
        unit="facet lengths",
    )
