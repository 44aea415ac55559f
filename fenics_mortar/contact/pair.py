# SPDX-License-Identifier: MIT
"""A contact pair: the two sides, their law, gap and sliding, and how contact is discretized."""

from __future__ import annotations

from copy import copy
from typing import Any, Literal, get_args

import numpy as np

from fenics_mortar.contact.discretization import Discretization, as_discretization
from fenics_mortar.contact.laws import Frictionless, Law
from fenics_mortar.mesh.data import MeshData
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils.arguments import check_choice, check_kind, check_number
from fenics_mortar.utils.errors import check_same_words, together

Sliding = Literal["finite", "small"]


def check_radius(search_radius: Any) -> None:
    """Refuse a search radius that finds nothing (local)."""
    if search_radius is not None:
        expected = "a positive length, or None"
        check_number("search_radius", search_radius, expected, lambda r: r > 0.0)


class ContactPair:
    """Contact of a slave with a master surface or a rigid obstacle.

    Args:
        data: Mesh, tags and names.
        slave: Name or tag of the side that carries the multiplier (the finer or softer one).
        master: Name or tag of the other side, or an obstacle; several pairs may share one, and a
            slave may have several masters, one pair each: in a groove a node may touch two, and
            stick to both, see ``redundancy``.
        law: ``Frictionless()``, ``Coulomb(mu)``, ``Tresca(stress)`` or one's own, see ``laws``.
            Nodes that are held in a component, as on symmetry planes, have no friction.
        search_radius: Farthest distance along the slave normal at which a partner is looked for, in
            front of the slave and behind it [length]; the diagonal of the smaller surface's box by
            default, for an obstacle no limit. Behind, where bodies overlap, the nearer way out
            counts: to half of what both bodies are thick there together, in their present state
            (tied ones as one). So surfaces may be whole outlines: nothing is seen through a plate.
        initial_gap: Gap [length] that the nodes near the other surface (half a facet) shall have
            where the problem is set up, whatever the facets of curved surfaces leave between them:
            0 closes gaps and overlaps, a negative number is an interference. ``None`` takes gaps
            and overlaps as they are meshed. See also ``Contact.offset``.
        sliding: "finite", or "small": D, M and normals stay those of the undeformed mesh, and the
            gap is linear in the displacement. It suffices where slip is small beside a facet and
            normals hardly turn; with linear bulk the matrix is factored once, see ``reduced``.
        discretization: Choices for research and comparison: a ``Discretization`` or the name of a
            preset, "default", "other_codes" or "petrov_galerkin".

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
        search_radius: float | None = None,
        initial_gap: float | None = None,
        sliding: Sliding = "finite",
        discretization: str | Discretization = "default",
    ) -> None:
        self.data = data
        self.slave_name, self.master_name = str(slave), str(master)
        self.master = master
        self.search_radius, self.initial_gap = search_radius, initial_gap
        self.sliding: Sliding = sliding
        self.law: Law = Frictionless() if law is None else law
        self.discretization: Discretization
        if getattr(data, "mesh", None) is None:  # and no communicator
            self._set_up(discretization)
        with together(data.mesh.comm, "ContactPair"):
            self._set_up(discretization)
            self.slave_tag = data.boundary_tag(slave)
            if not isinstance(master, Obstacle):
                data.boundary_tag(master)
        check_same_words(data.mesh.comm, "ContactPair", vars(self))
        for name in (slave, master):
            if not isinstance(name, Obstacle):
                data.boundary_facets(name)

    def _set_up(self, discretization: Any) -> None:
        """Set the discretization and check all options (local)."""
        self.discretization = as_discretization(discretization)
        self.check()

    def check(self) -> None:
        """Refuse options that are not allowed (local).

        Raises:
            ValueError: If an option is not one of those named.
        """
        check_kind("data", self.data, MeshData, "the MeshData of the mesh")
        check_choice("sliding", self.sliding, get_args(Sliding))
        expected = "an instance of Discretization"
        check_kind("discretization", self.discretization, Discretization, expected)
        self.discretization.check()
        check_radius(self.search_radius)
        if self.initial_gap is not None:
            check_number("initial_gap", self.initial_gap, "a length, or None", np.isfinite)
        check_kind("law", self.law, Law, "an instance of Frictionless, Coulomb, Tresca or Law")
        self.law.check()

    def with_options(self, **options: Any) -> ContactPair:
        """Copy of the pair with other options (local).

        Args:
            options: Attributes by name, or functions of the present ones. They are checked when a
                problem is set up.

        Raises:
            ValueError: For an unknown name.
        """
        pair = copy(self)
        for name, new in options.items():
            if name not in vars(pair):
                raise ValueError(f"{name}={new!r}: expected one of {', '.join(vars(pair))}")
            value = new(getattr(pair, name)) if callable(new) else new
            setattr(pair, name, as_discretization(value) if name == "discretization" else value)
        return pair

    def __repr__(self) -> str:
        """The two sides."""
        return f"ContactPair({self.slave_name!r}, {self.master_name!r})"
