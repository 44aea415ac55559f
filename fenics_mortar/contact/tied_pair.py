# SPDX-License-Identifier: MIT
"""A tied pair: slave, master and discretization of a joint."""

from __future__ import annotations

from typing import Literal, get_args

from fenics_mortar.contact.discretization import Discretization, as_discretization
from fenics_mortar.contact.pair import check_search_radius
from fenics_mortar.mesh.data import MeshData, Names, joined_names
from fenics_mortar.utils.arguments import check_choice, check_kind
from fenics_mortar.utils.errors import check_same_texts, together

Gap = Literal["removed", "kept"]


class TiedPair:
    """Mesh tying of a slave and a master surface with nonmatching meshes.

    Args:
        data: Mesh, tags and names.
        slave: Name or tag of the side that carries the multiplier, or a list of names, which form
            one surface; tractions are smoother on the finer or softer side.
        master: Name or tag of the other side, or a list of names.
        gap: Treatment of gaps between the facets of a curved interface.

            - "removed": at set-up the slave nodes of the mesh are moved onto the master, without
              stress. Interpolate functions after the set-up. A displacement of degree 2 needs cells
              of second order, unless the interface is straight.
            - "kept": mesh and gap vector are unchanged. The vector does not rotate with the bodies,
              so that a nonzero gap is admissible for small rotations only.
        search_radius: Largest distance of partners along the slave normal [length]; half the
            longest facet of both sides by default. Nodes without partner are not tied.
        discretization: ``Discretization``, of which a tie uses basis, points and max_angle only, or
        "default".

    Raises:
        ValueError: If an option has a value that is not allowed.
        MeshError: If a name or tag is unknown or has no facets.

    Note:
        Collective.

    Example:
        An inclusion bonded to a plate, with contact elsewhere::

            tie = fm.TiedPair(data, slave="inclusion/arc", master="plate/arc")
            problem = fm.ContactProblem(
                residual, u, [tie, contact], bcs=bcs, petsc_options_prefix="tied_"
            )
    """

    def __init__(
        self,
        data: MeshData,
        slave: Names,
        master: Names,
        *,
        gap: Gap = "removed",
        search_radius: float | None = None,
        discretization: str | Discretization = "default",
    ) -> None:
        check_kind("data", data, MeshData, "the MeshData of the mesh")
        self.data = data
        self.slave_name, self.master_name = joined_names(slave), joined_names(master)
        self.master = master
        self.gap, self.search_radius = gap, search_radius
        with together(data.mesh.comm, "TiedPair"):
            self.discretization = as_discretization(discretization)
            self.check()
            self.slave_tags = data.boundary_tags(slave)
            data.boundary_tags(master)
        check_same_texts(data.mesh.comm, "TiedPair", vars(self))
        for names in (slave, master):
            data.boundary_facets(names)

    def check(self) -> None:
        """Check the options (local).

        Raises:
            ValueError: If an option has a value that is not allowed.
        """
        check_choice("gap", self.gap, get_args(Gap))
        expected = "an instance of Discretization"
        check_kind("discretization", self.discretization, Discretization, expected)
        self.discretization.check_for_tie()
        check_search_radius(self.search_radius)

    def __repr__(self) -> str:
        """The two sides."""
        return f"TiedPair({self.slave_name!r}, {self.master_name!r})"
