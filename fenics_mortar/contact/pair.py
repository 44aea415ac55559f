# SPDX-License-Identifier: MIT
"""Contact pairs and tied pairs: their sides, law, gap, sliding and discretization."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from fenics_mortar.contact.conductance import Conductance
from fenics_mortar.contact.discretization import Discretization, as_discretization
from fenics_mortar.contact.law import check_names
from fenics_mortar.contact.laws import Frictionless, Law
from fenics_mortar.mesh.data import MeshData, Names, joined_names
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.obstacles.rigid_motion import check_vector
from fenics_mortar.utils.arguments import check_choice, check_kind, check_number
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import check_same_texts, together

Sliding = Literal["finite", "small"]


def check_search_radius(search_radius: Any) -> None:
    """Raise an error for a search radius that is not a positive length (local)."""
    if search_radius is not None:
        expected = "a positive length, or None"
        check_number("search_radius", search_radius, expected, lambda r: r > 0.0)


def _check_fluxes(fluxes: Any) -> None:
    """Raise an error unless ``fluxes`` are conductances of different fields (local)."""
    expected = "a list of Conductance, one for each field that flows across the contact"
    if not isinstance(fluxes, Sequence):
        raise ValueError(f"fluxes={fluxes!r}: expected {expected}")
    for flux in fluxes:
        check_kind("fluxes", flux, Conductance, expected)
    names = {f if isinstance(f := flux.field, int) else id(f) for flux in fluxes}
    if len(names) < len(fluxes):
        raise ValueError(
            f"fluxes={fluxes!r}: two of one field; expected one Conductance(field, [h, ...])"
        )


class ContactPair:
    """Contact of a slave with a master surface or a rigid obstacle.

    Args:
        data: Mesh, tags and names.
        slave: Name or tag of the side that carries the multiplier (the finer or softer one), or a
            list of names, which form one surface. Without a master: surfaces whose facets may all
            touch each other.
        master: Name or tag of the other side, a list of names, or an obstacle. Several pairs may
            share a master. A slave with several masters of different law or search needs one pair
            for each; see ``redundancy`` for nodes that touch two of them. ``None`` for contact of a
            surface with itself, see ``self_contact``.
        law: ``Frictionless()``, ``Coulomb(mu)``, ``Tresca(stress)`` or a user's law, see ``laws``.
            Nodes with a prescribed component, as on symmetry planes, are frictionless.
        search_radius: Largest distance of partners along the slave normal, in front of the slave
            and behind it [length]. Default: diagonal of the smaller surface's bounding box; for an
            obstacle no limit. Behind the slave the distance is also limited to half of the present
            thickness of both bodies together, so that a surface may be the whole outline of a body.
        initial_gap: Gap at set-up of all nodes within half a facet of the other surface [length]: 0
            removes gaps and overlaps of faceted curves, a negative number is an interference.
            ``None`` keeps the gaps of the mesh. See also ``PairView.offset``.
        sliding: "finite", or "small": D, M and normals of the undeformed mesh, and a gap that is
            linear in the displacement, valid for small rotations and slip that is small compared
            with a facet. With linear bulk the matrix is factorized once, see ``reduced``.
        fluxes: Conductances of scalar fields of a mixed function, such as a temperature: one
            ``Conductance`` for each field that flows across this contact.
        discretization: Choices for research and comparison: a ``Discretization`` or the name of a
            preset, "default", "other_codes" or "petrov_galerkin".

    Raises:
        ValueError: If an option has a value that is not allowed.
        MeshError: If a name or tag is unknown or has no facets.

    Note:
        Collective.
    """

    def __init__(
        self,
        data: MeshData,
        slave: Names,
        master: Names | Obstacle | None = None,
        *,
        law: Law | None = None,
        search_radius: float | None = None,
        initial_gap: float | None = None,
        sliding: Sliding = "finite",
        fluxes: Sequence[Conductance] = (),
        discretization: str | Discretization = "default",
    ) -> None:
        self.data = data
        self.slave_name = joined_names(slave)
        self.master_name = self.slave_name if master is None else joined_names(master)
        self.master = master
        self.search_radius, self.initial_gap = search_radius, initial_gap
        self.sliding: Sliding = sliding
        self.fluxes = fluxes
        self.law: Law = Frictionless() if law is None else law
        self.discretization: Discretization
        if getattr(data, "mesh", None) is None:  # without a communicator, the error is local
            self._set_up(discretization)
        with together(data.mesh.comm, "ContactPair"):
            self._set_up(discretization)
            if isinstance(slave, Obstacle):
                raise ValueError(
                    f"slave={slave!r}: an obstacle has no multiplier and can only be the master; "
                    "expected ContactPair(data, name of a boundary, obstacle)"
                )
            self.slave_tags = data.boundary_tags(slave)
            if isinstance(master, Obstacle):
                _check_dimension(master, data.mesh.geometry.dim)
            elif master is not None:
                data.boundary_tags(master)
        check_same_texts(data.mesh.comm, "ContactPair", vars(self))
        for names in (slave, master):
            if not (names is None or isinstance(names, Obstacle)):
                data.boundary_facets(names)

    def _set_up(self, discretization: Any) -> None:
        """Set the discretization and check all options (local)."""
        self.discretization = as_discretization(discretization)
        self.check()

    def check(self) -> None:
        """Check the options (local).

        Raises:
            ValueError: If an option has a value that is not allowed.
        """
        check_kind("data", self.data, MeshData, "the MeshData of the mesh")
        check_choice("sliding", self.sliding, get_args(Sliding))
        expected = "an instance of Discretization"
        check_kind("discretization", self.discretization, Discretization, expected)
        self.discretization.check()
        check_search_radius(self.search_radius)
        if self.initial_gap is not None:
            check_number("initial_gap", self.initial_gap, "a length, or None", np.isfinite)
        check_kind("law", self.law, Law, "an instance of Frictionless, Coulomb, Tresca or Law")
        check_names(self.law)
        self.law.check()
        _check_fluxes(self.fluxes)
        if self.master is None and self.discretization.integration != "segments":
            raise ValueError(
                f"integration={self.discretization.integration!r} without a master: contact of a "
                "surface with itself has integration='segments' only"
            )

    def with_options(self, **options: Any) -> ContactPair:
        """Copy of the pair with other options (local).

        Args:
            options: New values of attributes by name, or functions of the present values. They are
                checked when a problem is set up.

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
        if self.master is None:
            return f"ContactPair({self.slave_name!r})"
        return f"ContactPair({self.slave_name!r}, {self.master_name!r})"


def _check_dimension(obstacle: Obstacle, dim: int) -> None:
    """Reject obstacles in space for meshes of the plane, and others (local)."""
    if obstacle.dim == dim:
        return
    expected = {
        2: "one in the plane, as Circle, or SignedDistance with a pivot of two numbers",
        3: "one in space, as Sphere, Extruded or Revolved, or SignedDistance with a pivot of three "
        "numbers",
    }
    raise ValueError(
        f"obstacle '{obstacle.name}' has {obstacle.dim} coordinates, the mesh {dim}: expected "
        f"{expected[dim]}"
    )


Gap = Literal["removed", "kept"]


class TiedPair:
    """Mesh tying of a slave and a master surface with nonmatching meshes, also at a distance.

    The displacement is tied, with D u_s = D (u_m + jump) in weak form. Further unknowns of a mixed
    function, such as a temperature or a concentration, are tied if they are given in ``fields``.

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
            longest facet of both sides by default. Nodes without partner are not tied. With a
            translation, the distance from the translated master.
        translation: Vector from the master to the slave in the mesh, (dim,) [length]; zero for a
            joint. Tied left and right sides of a cell are periodic boundaries.
        jump: u_s - u_m, (dim,) [length]: numbers, or a constant whose value may change between
            solves. With a macroscopic deformation gradient F it is (F - 1) translation.
        fields: Numbers of the sub-spaces of a mixed function whose scalar fields T are tied too,
            D T_s = D T_m in weak form, without ``jump``: continuous Lagrange elements of degree 1
            or of that of the displacement. The flux of field i from slave to master is column dim +
            i of the multipliers, see ``PairView.fluxes``; those of both sides cancel to rounding. A
            pressure of incompressible bodies has no flux and is not to be tied.
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

        One period of a rough layer of width L in contact, stretched by 1 %. Nonmatching meshes of
        the two sides are no obstacle::

            stretch = fem.Constant(data.mesh, (0.01 * L, 0.0))
            periodic = fm.TiedPair(
                data, slave="layer/right", master="layer/left", translation=(L, 0.0), jump=stretch
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
        translation: npt.ArrayLike | None = None,
        jump: fem.Constant | npt.ArrayLike | None = None,
        fields: Sequence[int] = (),
        discretization: str | Discretization = "default",
    ) -> None:
        check_kind("data", data, MeshData, "the MeshData of the mesh")
        self.data = data
        self.slave_name, self.master_name = joined_names(slave), joined_names(master)
        self.master = master
        self.gap, self.search_radius = gap, search_radius
        with together(data.mesh.comm, "TiedPair"):
            self.discretization = as_discretization(discretization)
            self._dim = data.mesh.geometry.dim
            zero = np.zeros(self._dim)
            given = zero if translation is None else translation
            self.translation: Array = check_vector("translation", given, self._dim)
            self.jump: Any = zero if jump is None else jump
            if not isinstance(jump, fem.Constant):
                self.jump = check_vector("jump", self.jump, self._dim)
            self.fields = _numbers(fields)
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
        self.present_jump()

    def present_jump(self) -> Array:
        """Present value of ``jump``, shape (dim,) [length] (local).

        Raises:
            ValueError: If it does not consist of one finite number for each coordinate.
        """
        return check_vector("jump", np.array(getattr(self.jump, "value", self.jump)), self._dim)

    def __repr__(self) -> str:
        """The two sides."""
        return f"TiedPair({self.slave_name!r}, {self.master_name!r})"


def _numbers(fields: Any) -> tuple[int, ...]:
    """Numbers of sub-spaces, each once (local).

    Raises:
        ValueError: For anything else.
    """
    expected = "different numbers of sub-spaces in a list, as [1]"
    if not isinstance(fields, Sequence) or isinstance(fields, str):
        raise ValueError(f"fields={fields!r}: expected {expected}")
    for field in fields:
        check_number("fields", field, expected, lambda number: number >= 0, whole=True)
    if len(set(fields)) < len(fields):
        raise ValueError(f"fields={fields!r}: expected {expected}")
    return tuple(int(field) for field in fields)
