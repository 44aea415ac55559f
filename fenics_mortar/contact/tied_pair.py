# SPDX-License-Identifier: MIT
"""A tied pair: slave, master and discretization of a joint."""

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
    """Mesh tying of a slave and a master surface with nonmatching meshes.

    Args:
        data: Mesh, tags and names.
        slave: Name or tag of the side that carries the multiplier; tractions are smoother on the
            finer or softer side.
        master: Name or tag of the other side.
        basis: "dual" (diagonal D, can be condensed), "standard", or multipliers at the vertices of
            quadratic facets, "vertices" or "linear"; see ``ContactPair``.
        gap: Treatment of gaps between the facets of a curved interface.

            - "removed": at set-up the slave nodes of the mesh are moved onto the master, without
              stress. Interpolate functions after the set-up. A displacement of degree 2 needs cells
              of second order, unless the interface is straight.
            - "kept": the mesh and the gap vector stay. The vector does not rotate with the bodies,
              so that a nonzero gap is admissible for small rotations only.
        points: Gauss points per segment.
        search_radius: Largest distance of partners along the slave normal [length]; half the
            longest facet of both sides by default. Nodes without partner stay free.
        max_angle: Largest angle between the slave normal and the reversed master normal [degree].

    Raises:
        ValueError: If an option has a value that is not allowed.
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
        """Check the options (local).

        Raises:
            ValueError: If an option has a value that is not allowed.
        """
        check_choice("basis", self.basis, get_args(Basis))
        check_choice("gap", self.gap, get_args(Gap))
        expected = "a whole number, at least 2 per segment"
        check_number("points", self.points, expected, lambda n: n >= 2, whole=True)
        check_reach(self.search_radius, self.max_angle)

    def __repr__(self) -> str:
        """The two sides."""
        return f"TiedPair({self.slave_name!r}, {self.master_name!r})"
