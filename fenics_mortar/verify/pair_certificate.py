# SPDX-License-Identifier: MIT
"""Certificate of one pair: measured defects, violations and remarks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fenics_mortar.contact.arcs import MAX_ROTATION
from fenics_mortar.utils.rounding import SMALL_ANGLE
from fenics_mortar.verify.limits import LIMITS

# Remedy for curved surfaces with straight facets.
CURVED = "cells of order 2 (gmsh.model.mesh.setOrder(2)) with displacements of degree 2"


@dataclass(frozen=True)
class PairCertificate:
    """Measured defects of one pair; dimensionless, zero for an exact solution.

    For a tied pair, tension and shear (allowed) and penetration (impossible) are zero.

    Attributes:
        pair: Names of slave and master.
        force: Sum of all contact forces over the sum of their norms; zero up to rounding.
        moment: Sum of their moments over forces times lever arms; of third order in the facet
            length, zero up to rounding for a tied pair without gap.
        tension: Excess of the tension -z_n over the adhesion of the contact law, over the largest
            pressure or tension.
        shear: Excess of the tangential multiplier over the friction limit, over the largest
            pressure (or the friction limit, if larger).
        overlap: Largest negative mean gap of a slave node over its length; for a tied pair the
            largest distance of the sides.
        overlap_at: Position of the largest overlap.
        search_radius: Distance within which partners are searched, as text.
        complementarity: Largest |(z_n + a) g| with the adhesion a, over largest pressure times
            length.
        penetration: Largest penetration of a segment over the length of its facet: admitted by the
            discretization between the nodes, of second order in the facet length.
        distance: Smallest distance of slave and master over the facet length if a force acts.
        where: Position of the largest penetration.
        oblique: Fraction of the forces along the slave normals that acts along the facets of the
            master; of first order in the facet length where both surfaces are smooth.
        oblique_at: Position of the largest contribution.
        misdirected: Fraction of the normal forces that acts along the surface because corners of
            the slave have averaged normals: an error of the ratio of shear and normal force.
            Contributions of neighbouring active nodes are added with their signs.
        excess_shear: Where corners of the slave stick on a flat master: excess of the shear along
            the master over the friction limit at the pressure on it, over that limit.
        excess_shear_at: Position of the largest excess.
        friction: Friction limit over pressure, mean of all nodes under pressure; inf for the law
            ``Stick``.
        end_pressure: Largest ratio of the pressure beside a clamped slave node to that of the next
            nodes.
        end_pressure_at: Position of the largest ratio.
        outside: Largest distance of the resultant of neighbouring pressures from the part of the
            slave that the master covers [facet lengths].
        outside_at: Position of that resultant.
        sharp: Fraction of the normal forces that acts along the facets of the slave, as an obstacle
            is sharper than they are.
        sharp_at: Position of the largest contribution.
        narrow: Fraction of the normal forces in regions of too few active nodes or narrower than a
            facet.
        narrow_at: The largest of these regions and the remedy, as text.
        uneven: Gaps between active nodes, root mean square, over the approach of the bodies that
            belongs to the pressures.
        uneven_at: Position of the largest of these gaps.
        undecided_at: Positions of nodes whose cover is close to the threshold of a multiplier.
        redundant: Sticking nodes that other constraints fix as well: their shear is not unique,
            see ``redundancy``.
        redundant_at: Position of one of them.
        rotation: Rotation of both sides relative to each other in the step, if its direction may be
            uncertain, for laws with slip [radian]; see ``arcs``.
        rotation_at: Position of the largest rotation.
        friction_work: Difference of the work of friction by slip and by the motions of nodes and
            obstacle in the step, over the sums of shear forces times motions.
        gradient: Error of the direction of a user's gradient, see ``obstacle_gradient``: sine of
            the angle by which contact forces are misdirected.
        gradient_at: Position of the largest error.
        tilt: With small sliding, mean rotation of the normals since the undeformed mesh, by
            which the resultant is misdirected [radian].
        unpaired: Nodes of the two surfaces inside another body without a partner in any pair.
        uncovered: Slave nodes without a partner.
    """

    pair: str
    force: float
    moment: float
    tension: float = 0.0
    shear: float = 0.0
    overlap: float = 0.0
    overlap_at: str = ""
    search_radius: str = ""
    complementarity: float = 0.0
    penetration: float = 0.0
    distance: float = 0.0
    where: str = ""
    oblique: float = 0.0
    oblique_at: str = ""
    misdirected: float = 0.0
    excess_shear: float = 0.0
    excess_shear_at: str = ""
    friction: float = 0.0
    end_pressure: float = 0.0
    end_pressure_at: str = ""
    outside: float = 0.0
    outside_at: str = ""
    sharp: float = 0.0
    sharp_at: str = ""
    narrow: float = 0.0
    narrow_at: str = ""
    uneven: float = 0.0
    uneven_at: str = ""
    undecided_at: str = ""
    redundant: int = 0
    redundant_at: str = ""
    rotation: float = 0.0
    rotation_at: str = ""
    friction_work: float = 0.0
    gradient: float = 0.0
    gradient_at: str = ""
    tilt: float = 0.0
    unpaired: int = 0
    uncovered: int = 0

    def violations(
        self, tolerance: float = LIMITS.tolerance, penetration: float = LIMITS.penetration
    ) -> list[str]:
        """Describe violated conditions; empty for a sound state (local).

        Args:
            tolerance: Limit for quantities that vanish in a solution of the equations [1].
            penetration: Limit for penetration and distance [facet lengths].
        """
        return list(self._violations(tolerance, penetration))

    def _violations(self, tolerance: float, penetration: float) -> Iterator[str]:
        for name in ("force", "tension", "shear", "overlap", "complementarity"):
            value = getattr(self, name)
            if not value <= tolerance:
                where = f" {self.overlap_at}" if name == "overlap" else ""
                yield f"{self.pair}: {name} {value:.1e} (allowed {tolerance:.1e}){where}"
        if not self.penetration <= penetration:
            yield (
                f"{self.pair}: penetration of {self.penetration:.2f} facets between the nodes, at "
                f"{self.where}"
            )
        if not self.distance <= penetration:
            yield f"{self.pair}: a force acts, but the sides are {self.distance:.2f} facets apart"
        if not self.rotation <= MAX_ROTATION:
            yield (
                f"{self.pair}: the rotation of the sides relative to each other in the step, at "
                f"{self.rotation_at}, is known up to a full turn only, and with it the direction "
                "of slip: take smaller steps, in which bodies turn by less than "
                f"{np.degrees(MAX_ROTATION):.0f} degrees"
            )
        if not self.excess_shear <= LIMITS.at_corners:
            yield self._sticking_corner()
        if not self.gradient <= LIMITS.wrong_gradient:
            yield self._wrong_gradient()
        if self.unpaired:
            yield (
                f"{self.pair}: {self.unpaired} nodes are inside another body and have no partner: "
                f"contact was missed, since partners are searched {self.search_radius}; take "
                "smaller steps or a larger search_radius"
            )

    def remarks(self) -> Iterator[str]:
        """Describe where the mesh is too coarse or the solution may not be unique (local)."""
        if self.penetration > LIMITS.coarse_penetration:
            yield (
                f"{self.pair}: penetration of {self.penetration:.2f} facets between the nodes, at "
                f"{self.where}; finer facets, or {CURVED}, reduce it"
            )
        if self.distance > LIMITS.coarse_distance:
            yield (
                f"{self.pair}: a force acts, but the sides are {self.distance:.2f} facets apart; "
                f"finer facets of the slave, or {CURVED}, reduce the distance"
            )
        if self.narrow > LIMITS.at_corners:
            yield (
                f"{self.pair}: {self.narrow:.0%} of the normal forces act on regions that the mesh "
                f"does not resolve: {self.narrow_at}"
            )
        if self.uneven > LIMITS.uneven:
            yield (
                f"{self.pair}: facets of the two sides do not fit: between the nodes, most of all "
                f"at {self.uneven_at}, the gap is {self.uneven:.0%} of the approach of the bodies: "
                "forces may be far too small, and single pressures far too large; take "
                f"{CURVED}, or finer facets"
            )
        yield from self._remarks_on_corners()
        if LIMITS.of_friction < self.excess_shear <= LIMITS.at_corners:
            yield self._sticking_corner()
        if self.outside > LIMITS.coarse_distance:
            yield self._resultant_outside()
        if self.sharp > LIMITS.at_corners:
            yield (
                f"{self.pair}: {self.sharp:.0%} of the normal forces act along the facets of the "
                f"slave, most of them at {self.sharp_at}, where the obstacle is sharper than they "
                "are: refine the facets there, or round the obstacle"
            )
        if self.end_pressure > LIMITS.end_pressure:
            yield (
                f"{self.pair}: a body presses on a clamped slave node, at {self.end_pressure_at}, "
                "which carries no multiplier: the force may be far too small; take the other body "
                "as slave"
            )
        if self.friction_work > LIMITS.friction_work:
            yield (
                f"{self.pair}: the work of friction by slip differs by {self.friction_work:.0%} "
                "from that of the motions of nodes and obstacle in the step: slip is not resolved; "
                "take smaller steps or finer facets"
            )
        if LIMITS.negligible < self.gradient <= LIMITS.wrong_gradient:
            yield self._wrong_gradient()
        if abs(self.tilt) > SMALL_ANGLE:
            yield (
                f"{self.pair}: the contact surface has rotated by "
                f"{np.degrees(abs(self.tilt)):.1f} degrees, but sliding='small' keeps the "
                "directions of the undeformed mesh: contact forces are misdirected by this angle; "
                "use sliding='finite'"
            )
        if self.redundant:
            yield (
                f"{self.pair}: {self.redundant} sticking nodes are constrained by other pairs as "
                f"well, one at {self.redundant_at}: their shear is not unique; it is as close as "
                f"possible to that of the last state"
            )
        if self.undecided_at:
            yield (
                f"{self.pair}: the master ends just beside the node at {self.undecided_at}, where "
                f"the multiplier is handed over to or from the neighbouring node: there may be "
                f"two solutions, with and without it; other steps may lead to the other one"
            )

    def _sticking_corner(self) -> str:
        """Describe a corner of the slave that sticks beyond the friction limit."""
        master = self.pair.partition(" - ")[2]
        return (
            f"{self.pair}: a corner of the slave sticks at {self.excess_shear_at}, but the "
            f"shear along '{master}' is {self.excess_shear:.1%} above the friction limit: the "
            "direction of the force on a corner, that of its averaged normal, is not resolved; "
            f"{self._other_roles()}round the corner"
        )

    def _other_roles(self) -> str:
        """Advice to exchange slave and master; "" for a surface in contact with itself."""
        slave, _, master = self.pair.partition(" - ")
        return f"take '{master}' as slave and '{slave}' as master, or " * (slave != master)

    def _wrong_gradient(self) -> str:
        """Describe a gradient that is not the derivative of the distance."""
        return (
            f"{self.pair}: the gradient of the obstacle's distance is turned by "
            f"{np.degrees(np.arcsin(min(self.gradient, 1.0))):.1f} degrees from difference "
            f"quotients at {self.gradient_at}, and so is the direction of the contact forces; "
            f"correct the function of the obstacle"
        )

    def _resultant_outside(self) -> str:
        """Describe a resultant outside the part of the slave that is covered."""
        return (
            f"{self.pair}: the resultant of the pressures acts at {self.outside_at}, "
            f"{self.outside:.2f} facets outside of the part of the slave that the master covers: "
            "the limit load of this mesh may be above that of a finer one"
        )

    def _remarks_on_corners(self) -> Iterator[str]:
        """Describe the error of the contact direction at corners."""
        limit = min(LIMITS.at_corners, max(LIMITS.of_friction * self.friction, LIMITS.negligible))
        if self.friction > 0.0 and self.misdirected > limit:
            yield (
                f"{self.pair}: {self.misdirected:.1%} of the normal forces act along the surface, "
                f"compared with a friction of {self.friction:.2g}: a corner of the slave presses "
                f"at {self.oblique_at}, along its averaged normal; {self._other_roles()}"
                "round the corner"
            )
        if self.friction > 0.0 or not self.oblique > LIMITS.at_corners:
            return
        is_slave = self.misdirected > 0.5 * LIMITS.at_corners
        known = "direction and depth are" if is_slave else "depth is"
        remedy = "take the other side as slave, round it" if is_slave else "round it"
        yield (
            f"{self.pair}: {self.oblique:.0%} of the normal forces act along the master's facets, "
            f"most of them at {self.oblique_at}: where a corner presses, {known} accurate to a "
            f"fraction of a facet only; {remedy}, or refine the facets"
        )
