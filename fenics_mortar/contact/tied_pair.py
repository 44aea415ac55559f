# SPDX-License-Identifier: MIT
"""A tied pair: which two sides are joined, and how."""

from __future__ import annotations

from typing import Literal, get_args

from fenics_mortar.contact.discretization import Discretization, as_discretization
from fenics_mortar.contact.pair import check_radius
from fenics_mortar.mesh.data import MeshData
from fenics_mortar.utils.arguments import check_choice, check_kind
from fenics_mortar.utils.errors import check_same_words, together

Gap = Literal["removed", "kept"]


class TiedPair:
    """Joins a slave to a master surface, whose meshes need not match.

    Args:
        data: Mesh, tags and names.
        slave: Name or tag of the side that carries the multiplier; either side will do, the finer
            or softer one gives smoother tractions.
        master: Name or tag of the other side.
        gap: What becomes of the gap that the facets of a curved interface leave. "removed": when
            the problem is set up, slave nodes move onto the master in the mesh itself, which
            is then free of stress; so make the problem before you interpolate anything. A
            displacement of degree 2 needs cells of second order for that, unless the interface is
            straight. "kept": the mesh stays, and so does the gap vector. It does not turn with
            the bodies: right for small rotations only, unless there is no gap.
        search_radius: Farthest distance along the slave normal at which a partner is looked for
            [length]; half the longest facet of the two sides by default. What has no partner stays
            free.
        discretization: ``Discretization`` of which a tie has basis, points and max_angle only, or
            "default".

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
        master: str | int,
        *,
        gap: Gap = "removed",
        search_radius: float | None = None,
        discretization: str | Discretization = "default",
    ) -> None:
        check_kind("data", data, MeshData, "the MeshData of the mesh")
        self.data = data
        self.slave_name, self.master_name = str(slave), str(master)
        self.master = master
        self.gap, self.search_radius = gap, search_radius
        with together(data.mesh.comm, "TiedPair"):
            self.discretization = as_discretization(discretization)
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
        check_choice("gap", self.gap, get_args(Gap))
        expected = "an instance of Discretization"
        check_kind("discretization", self.discretization, Discretization, expected)
        self.discretization.check_for_tie()
        check_radius(self.search_radius)

    def __repr__(self) -> str:
        """The two sides."""
        return f"TiedPair({self.slave_name!r}, {self.master_name!r})"
