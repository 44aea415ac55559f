# SPDX-License-Identifier: MIT
"""A contact pair: slave, master, contact law and discretization."""

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
    """Check the limits of the search for partners (local)."""
    if search_radius is not None:
        expected = "a positive length, or None"
        check_number("search_radius", search_radius, expected, lambda r: r > 0.0)
    expected = "a number between 0 and 90 degrees"
    check_number("max_angle", max_angle, expected, lambda angle: 0.0 < angle < 90.0)


class ContactPair:
    """Contact of a slave with a master surface or a rigid obstacle.

    Args:
        data: Mesh, tags and names.
        slave: Name or tag of the side that carries the multiplier (the finer or softer one).
        master: Name or tag of the other side, or an obstacle. Several pairs may share a master. A
            slave with several masters needs one pair for each; see ``redundancy`` for nodes that
            touch two of them. With an obstacle ``normals`` affects symmetry planes only,
            ``gap_weights="cover"`` equals "basis", and "segments" equals "elements".
        law: ``Frictionless()``, ``Coulomb(mu)``, ``Tresca(stress)`` or a user's law, see ``laws``.
            Nodes with a prescribed component, as on symmetry planes, are frictionless.
        basis: Multiplier functions.

            - "dual": dual functions at all nodes; D is diagonal and can be condensed.
            - "standard": standard functions at all nodes; not condensed.
            - "vertices": linear dual functions at the vertices of quadratic facets. Half as many
              multipliers, but the pressure overshoots at the edge of contact.
            - "linear": linear standard functions at the vertices; not condensed.
        normals: Weights of the facet normals at a slave node: "opposite" (length of the other
            facet; exact on circles), "unit" (common in other codes) or "own" (own length).
        gap_weights: Weight functions of the gap.

            - "cover": the multiplier's function at covered nodes. At nodes beyond the edge of the
              master the gap is evaluated at the edge; the dual function would extrapolate it to the
              node and might indicate an overlap of separate surfaces.
            - "basis": always the multiplier's function, as in most codes.
            - "standard": the standard functions (Petrov-Galerkin).
        integration: Quadrature of D, M and gap. The last two are for comparison: forces jump or
            have kinks where points change their partners.

            - "segments": exact, on the intersections of slave and master facets.
            - "elements": ``points`` Gauss points per slave facet, each with its own partner. Forces
              balance; the error under uniform pressure depends on the number of points. A facet
              with fewer partners than nodes counts as uncovered.
            - "nodes": at the slave nodes (node-to-segment contact). ``basis`` and ``gap_weights``
              have no effect, ``points`` is not allowed.
        points: Gauss points per segment, 5 by default; with "elements" per slave facet, 5 between
            neighbouring nodes by default.
        search_radius: Largest distance of partners along the slave normal, in front of the slave
            and behind it [length]. Default: diagonal of the smaller surface's bounding box; for an
            obstacle no limit. Behind the slave the distance is also limited to half of the present
            thickness of both bodies together, so that surfaces may be whole outlines.
        max_angle: Largest angle between the slave normal and the reversed master normal [degree].
            Steeper facets do not count as cover.
        initial_gap: Gap at set-up of all nodes within half a facet of the other surface [length]: 0
            removes gaps and overlaps of faceted curves, a negative number is an interference.
            ``None`` keeps the gaps of the mesh. See also ``PairView.offset``.
        sliding: "finite", or "small": D, M and normals of the undeformed mesh, and a gap that is
            linear in the displacement. For slip that is small compared with a facet and small
            rotations; with linear bulk the matrix is factored once, see ``reduced``.
        slip: Measure of slip, see ``slip``: "partners" (motion along the material points faced at
            the start of the step) or "operators" (changes of D and M, as in most codes). With small
            sliding and on obstacles always "partners".
        c_n: Weight of the gap in the active-set test [1]. The result does not depend on it, nor do
            the iterations from 1e-8 to 1; larger weights release nodes too early.

    Raises:
        ValueError: If an option has a value that is not allowed.
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
        """Check the options (local).

        Raises:
            ValueError: If an option has a value that is not allowed.
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
            raise ValueError(f"points={points}: not allowed with integration='nodes'")
        what = {"segments": "segment", "elements": "facet", "nodes": "facet"}[integration]
        expected = f"a whole number, at least 2 per {what}"
        if points is not None:
            check_number("points", points, expected, lambda n: n >= 2, whole=True)
        check_reach(self.search_radius, self.max_angle)
        if self.initial_gap is not None:
            check_number("initial_gap", self.initial_gap, "a length, or None", np.isfinite)
        check_number("c_n", self.c_n, "a positive number", lambda c: 0.0 < c < np.inf)
        check_kind("law", self.law, Law, "an instance of Frictionless, Coulomb, Tresca or Law")
        self.law.check()

    def __repr__(self) -> str:
        """The two sides."""
        return f"ContactPair({self.slave_name!r}, {self.master_name!r})"
