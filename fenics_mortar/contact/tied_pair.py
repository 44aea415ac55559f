# SPDX-License-Identifier: MIT
"""A tied pair: which two sides are joined, and how."""

from __future__ import annotations

from typing import Literal, get_args

from fenics_mortar.contact.pair import check_reach
from fenics_mortar.interface.options import Basis
from fenics_mortar.interface.segments import Integration
from fenics_mortar.mesh.data import MeshData
from fenics_mortar.utils.arguments import check_choice, check_kind, check_number
from fenics_mortar.utils.errors import check_same_words, together

Gap = Literal["removed", "kept"]


class TiedPair:
    """Joins a slave to a master surface, whose meshes need not match.

    Args:
        data: Mesh, tags and names.
        slave: Name or tag of the side that carries the multiplier; either side will do, the finer
            or softer one gives smoother tractions.
        master: Name or tag of the other side.
        basis: "dual" (diagonal D, can be condensed), "standard", or of quadratic facets multipliers
            at their vertices only, "vertices" or "linear"; see ``ContactPair``.
        gap: What becomes of the gap that the facets of a curved interface leave. "removed": when
            the problem is set up, slave nodes move onto the master in the mesh itself, which
            is then free of stress; so make the problem before you interpolate anything. A
            displacement of degree 2 needs cells of second order for that, unless the interface is
            straight. "kept": the mesh stays, and so does the gap vector. It does not turn with
            the bodies: right for small rotations only, unless there is no gap.
        points: Gauss points per segment.
        search_radius: Farthest distance along the slave normal at which a partner is looked for
            [length]; half the longest facet of the two sides by default. What has no partner stays
            free.
        max_angle: Largest angle between the slave normal and the reversed master normal [degree].

    Raises:
        ValueError: If an option is not one of those named.
        MeshError: If a name or tag is unknown or has no facets.

    Note:
        Collective.
    """

    integration: Integration = "segments"

    def __init__(
        self,
        data: MeshData,
        slave: str | int,
        master: str | int,
        *,
        basis: Basis = "dual",
        gap: Gap = "removed",
        points: int = 5,
        search_radius: float | None = None,
        max_angle: float = 70.0,
    ) -> None:
        check_kind("data", data, MeshData, "the MeshData of the mesh")
        self.data = data
        self.slave_name, self.master_name = str(slave), str(master)
        self.master = master
        self.basis, self.gap, self.points = basis, gap, points
        self.search_radius, self.max_angle = search_radius, max_angle
        with together(data.mesh.comm, "TiedPair"):
            self.check()
            self.slave_tag = data.boundary_tag(slave)
            data.boundary_tag(master)
        check_same_words(data.mesh.comm, "TiedPair", vars(self))
        for name in (slave, master):
            data.boundary_facets(name)

    def check(self) -> None:
        """Refuse options that are not allowed (local).

        Raises:
            ValueError: If an option is not one of those named.
        """
        check_choice("basis", self.basis, get_args(Basis))
        check_choice("gap", self.gap, get_args(Gap))
        right = "a whole number, at least 2 per segment"
        check_number("points", self.points, right, lambda n: n >= 2, whole=True)
        check_reach(self.search_radius, self.max_angle)

    def __repr__(self) -> str:
        """The two sides."""
        return f"TiedPair({self.slave_name!r}, {self.master_name!r})"
