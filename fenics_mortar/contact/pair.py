# SPDX-License-Identifier: MIT
"""A contact pair: which sides meet, and the choices of how contact is discretised there."""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np

from fenics_mortar.contact.laws import Frictionless, Law
from fenics_mortar.contact.slip import Measure
from fenics_mortar.interface.options import Basis, GapWeights, Weighting
from fenics_mortar.interface.segments import Integration
from fenics_mortar.mesh.data import MeshData
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils.arguments import check_choice, check_kind, check_number
from fenics_mortar.utils.errors import check_same_words, together

Sliding = Literal["finite", "small"]


def check_reach(search_radius: Any, max_angle: Any) -> None:
    """Refuse a radius or an angle that finds nothing (local)."""
    if search_radius is not None:
        right = "a positive length, or None"
        check_number("search_radius", search_radius, right, lambda r: r > 0.0)
    right = "a number between 0 and 90 degrees"
    check_number("max_angle", max_angle, right, lambda angle: 0.0 < angle < 90.0)


class ContactPair:
    """Contact of a slave with a master surface or a rigid obstacle.

    Args:
        data: Mesh, tags and names.
        slave: Name or tag of the side that carries the multiplier (the finer or softer one).
        master: Name or tag of the other side, or an obstacle; several pairs may share one, and a
            slave may have several masters, one pair each: in a groove a node may touch two, and
            stick to both, see ``redundancy``. An obstacle has its own normals and no
            ends, so that ``normals`` matters on symmetry planes only, ``gap_weights="cover"`` is
            "basis", and "segments" and "elements" are the same: Gauss points on whole slave facets.
        law: ``Frictionless()``, ``Coulomb(mu)``, ``Tresca(stress)`` or one's own, see ``laws``.
            Nodes that are held in a component, as on symmetry planes, have no friction.
        basis: "dual" (diagonal D, can be condensed) or "standard" multipliers at all nodes, or, of
            quadratic facets, at their "vertices" only: linear functions, which can be condensed,
            too. They are half as many, but the pressure overshoots at the edge of contact. "linear"
            has the standard linear functions there, as in other codes: the same on straight facets
            that are covered whole, but not condensed.
        normals: Weights of the facet normals at a slave node: "opposite" (length of the other
            facet: exact on circles), "unit" (the choice of most codes) or "own" length.
        gap_weights: What the gap of a node is weighted by. "cover": by the multiplier's function if
            the node is covered; beyond the edge of the master the dual function would continue the
            gap to the node, see overlap where the surfaces are apart and press from a distance, so
            there it is one that evaluates the gap at the edge. "basis": always by the multiplier's
            function, as most codes do. "standard": by the standard functions (Petrov-Galerkin).
        integration: Where the gap is looked at. "segments": exactly, on every intersection of a
            slave with a master facet. "elements": at ``points`` Gauss points per slave facet, each
            with the partner that it hits, as in many codes; forces balance, but a uniform pressure
            passes only as well as the points resolve the ends of master facets. A facet with fewer
            partners than nodes counts as uncovered. "nodes": at the slave nodes, which is
            node-to-segment contact; each node that has a partner has its weight. ``basis`` and
            ``gap_weights`` mean nothing then, and ``points`` is refused. The last two are there for
            comparison: as points change their partners, the forces jump or have kinks.
        points: Gauss points per segment, with "elements" per slave facet. By default 5, with
            "elements" 5 for each part of a facet between two nodes.
        search_radius: Farthest distance along the slave normal at which a partner is looked for, in
            front of the slave and behind it [length]; the diagonal of the smaller surface's box by
            default, for an obstacle no limit. Behind, where bodies overlap, the nearer way out
            counts: to half of what both bodies are thick there together, in their present state
            (tied ones as one). So surfaces may be whole outlines: nothing is seen through a plate.
        max_angle: Largest angle between the slave normal and the reversed master normal [degree].
            Steeper facets, as the side of a block that stands on the slave, do not count as cover.
        initial_gap: Gap [length] that the nodes near the other surface (half a facet) shall have
            where the problem is set up, whatever the facets of curved surfaces leave between them:
            0 closes gaps and overlaps, a negative number is an interference. ``None`` takes gaps
            and overlaps as they are meshed. See also ``Contact.offset``.
        sliding: "finite", or "small": D, M and normals stay those of the undeformed mesh, and the
            gap is linear in the displacement. It suffices where slip is small beside a facet and
            normals hardly turn; with linear bulk the matrix is factored once, see ``reduced``.
        slip: What friction measures slip by, see ``slip``. "partners": how far a node has moved
            along the material points that it faced when the step began. "operators": the changes
            of D and M, as most codes do. With small sliding, where these do not change, and on
            obstacles both are the first.
        c_n: Weight of the gap in the active-set test, a plain number. The result does not depend on
            it; neither do the iterations from 1e-8 to 1. Larger weights release nodes for the gaps
            that a nonlinear step leaves behind.

    Raises:
        ValueError: If an option is not one of those named.
        MeshError: If a name or tag is unknown or has no facets.

    Note:
        Collective.
    """

    def __init__(
        self,
        data: MeshData,
        slave: str | int,
        master: str | int | Obstacle,
        *,
        law: Law | None = None,
        basis: Basis = "dual",
        normals: Weighting = "opposite",
        gap_weights: GapWeights = "cover",
        integration: Integration = "segments",
        points: int | None = None,
        search_radius: float | None = None,
        max_angle: float = 70.0,
        initial_gap: float | None = None,
        sliding: Sliding = "finite",
        slip: Measure = "partners",
        c_n: float = 1e-3,
    ) -> None:
        self.data = data
        self.slave_name, self.master_name = str(slave), str(master)
        self.master = master
        self.basis, self.normals, self.points = basis, normals, points
        self.gap_weights: GapWeights = gap_weights
        self.integration: Integration = integration
        self.search_radius, self.max_angle, self.c_n = search_radius, max_angle, c_n
        self.initial_gap = initial_gap
        self.sliding: Sliding = sliding
        self.slip: Measure = slip
        self.law: Law = Frictionless() if law is None else law
        if getattr(data, "mesh", None) is None:  # and no communicator
            self.check()
        with together(data.mesh.comm, "ContactPair"):
            self.check()
            self.slave_tag = data.boundary_tag(slave)
            if not isinstance(master, Obstacle):
                data.boundary_tag(master)
        check_same_words(data.mesh.comm, "ContactPair", vars(self))
        for name in (slave, master):
            if not isinstance(name, Obstacle):
                data.boundary_facets(name)

    def check(self) -> None:
        """Refuse options that are not allowed (local).

        Raises:
            ValueError: If an option is not one of those named.
        """
        check_kind("data", self.data, MeshData, "the MeshData of the mesh")
        for what, allowed in (
            ("basis", get_args(Basis)),
            ("normals", get_args(Weighting)),
            ("gap_weights", get_args(GapWeights)),
            ("integration", get_args(Integration)),
            ("sliding", get_args(Sliding)),
            ("slip", get_args(Measure)),
        ):
            check_choice(what, getattr(self, what), allowed)
        points, integration = self.points, self.integration
        if integration == "nodes" and points is not None:
            raise ValueError(f"points={points}: with integration='nodes' the points are the nodes")
        what = {"segments": "segment", "elements": "facet", "nodes": "facet"}[integration]
        right = f"a whole number, at least 2 per {what}"
        if points is not None:
            check_number("points", points, right, lambda n: n >= 2, whole=True)
        check_reach(self.search_radius, self.max_angle)
        if self.initial_gap is not None:
            check_number("initial_gap", self.initial_gap, "a length, or None", np.isfinite)
        check_number("c_n", self.c_n, "a positive number", lambda c: 0.0 < c < np.inf)
        check_kind("law", self.law, Law, "an instance of Frictionless, Coulomb, Tresca or Law")
        self.law.check()

    def __repr__(self) -> str:
        """The two sides."""
        return f"ContactPair({self.slave_name!r}, {self.master_name!r})"
