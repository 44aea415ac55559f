# SPDX-License-Identifier: MIT
"""Pairs as users define them: contact, ties, sections of bolts under pretension.

``Discretization`` has choices of a pair for research and for comparison with other codes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from fenics_mortar.contact.conductance import Conductance
from fenics_mortar.contact.law import Frictionless, Law, check_names
from fenics_mortar.interface.mortar import GapWeights, Integration, MortarOptions, Weighting
from fenics_mortar.interface.reference import Basis
from fenics_mortar.mesh.data import MeshData, Names, joined_names
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.obstacles.rigid_motion import TURNS
from fenics_mortar.utils import errors

if TYPE_CHECKING:
    from fenics_mortar.utils.arrays import Array

Measure = Literal["partners", "operators"]
# Options of a tied pair: it has no active set, no slip, and no normals in its gap vector.
OF_TIES = ("basis", "points", "max_angle")


@dataclass(frozen=True)
class Discretization:
    """Discretization of a pair: multipliers, normals, weighted gap, integration, slip.

    The default is the most accurate choice. Others reproduce other codes, or serve to measure the
    effect of a choice. The options are checked by the pair, on all ranks together. ``PRESETS``
    names sets of conventions: "default" is ``Discretization()``. "other_codes" has unit weights of
    the normals, gaps weighted by the multiplier functions and slip from changes of D and M, as 4C;
    solutions agree with 4C to rounding where facets are fully covered; in space the rules of a
    triangle have 7 points (12 on quadratic facets) whatever the shape of the facets.
    "petrov_galerkin" weights gaps by the standard functions, with dual multipliers (Popp, Seitz,
    Gee & Wall 2013). ``dataclasses.replace`` makes a variant of a preset.

    Attributes:
        basis: "dual" (diagonal D, can be condensed) or "standard" multipliers at all nodes; on
            quadratic facets also linear functions at their vertices only: "vertices", which can be
            condensed, or "linear", the standard linear functions of other codes. The two are equal
            on straight, fully covered facets. They have half as many multipliers, but the pressure
            overshoots at the edge of contact. "quadratic": as "dual", but on triangles with six
            nodes, where all others are linear, quadratic functions at all nodes, with pressures
            that scatter a third as much, in a saddle point as well.
        normals: Weights of the facet normals at a slave node: "opposite" (length of the other
            facet: exact on circles), "unit" (the choice of most codes) or "own" length. With
            "opposite", corners inside the slave take the normal of the facet that faces the master.
            On an obstacle, which defines the normals, they affect symmetry planes only.
        gap_weights: Functions that weight the gap of a node. "cover": the multiplier function if
            the node is covered. Beyond the edge of the master, a dual function would extrapolate
            the gap to the node and produce an overlap where there is none; the gap is evaluated at
            the edge instead. "basis": always the multiplier function, as in most codes. "standard":
            the standard functions (Petrov-Galerkin), with dual multipliers only. On an obstacle,
            which has no ends, and in space "cover" equals "basis".
        integration: Quadrature points of D, M and gap. "segments": exact, on each intersection of a
            slave and a master facet. "elements": ``points`` Gauss points per slave facet, as in
            many codes; forces balance, but the error of a transferred uniform pressure depends on
            how well the points resolve the ends of master facets. A facet with fewer partners than
            nodes counts as uncovered. "nodes": the slave nodes (node-to-segment contact), those
            with a partner with their full weight. The last two are for comparison: forces have
            jumps or kinks where points change partners. On an obstacle "segments" and "elements"
            are equal: Gauss points on whole slave facets.
        points: Gauss points per segment, with "elements" per slave facet; at least as many as a
            facet has nodes. ``None``: 5, with "elements" 5 per interval between two nodes. In
            space points per triangle of the common part of two facets, of a rule of 3, 6, 7, 12,
            16, 25, 36, 49 or 64 points. ``None``: 7, on quadratic facets 12, which are exact for
            parallelograms and straight-sided triangles; at least 16 or 25 on surfaces with other
            quads, where the integrands are rational, and in self-contact, where edges of both sides
            of a fold coincide. Plane quads have as many as a uniform pressure needs to pass to
            1e-11, if nodes are moved by at most 20 %. The pieces of quadratic facets have straight
            edges: edges that bend within the surface leave an error.
        slip: Measure of slip for friction, see ``slip``. "partners": motion of a node along the
            material points that it faced at the start of the step. "operators": changes of D and M,
            as in most codes. With small sliding, where these are constant, and on obstacles both
            are "partners"; otherwise in space both are "operators".
        max_angle: Largest angle between the slave normal and the reversed master normal [degree].
            Steeper facets, such as the side of a block that stands on the slave, are not partners.
        c_n: Weight of the gap in the active-set test [1]. The result does not depend on it, nor the
            number of iterations between 1e-8 and 1. Larger weights open nodes because of the gaps
            that remain after a nonlinear step.
    """

    basis: Basis = "dual"
    normals: Weighting = "opposite"
    gap_weights: GapWeights = "cover"
    integration: Integration = "segments"
    points: int | None = None
    slip: Measure = "partners"
    max_angle: float = 70.0
    c_n: float = 1e-3

    def check(self) -> None:
        """Raise an error for options that are not allowed or contradict each other (local).

        Raises:
            ValueError: For such an option; the message names it and the allowed ones.
        """
        for name, allowed in (
            ("basis", get_args(Basis)),
            ("normals", get_args(Weighting)),
            ("gap_weights", get_args(GapWeights)),
            ("integration", get_args(Integration)),
            ("slip", get_args(Measure)),
        ):
            errors.check_choice(name, getattr(self, name), allowed)
        self._check_combination()
        if self.points is not None:
            per = "segment" if self.integration == "segments" else "facet"
            expected = f"a whole number, at least 2 per {per}"
            errors.check_number("points", self.points, expected, lambda n: n >= 2, whole=True)
        expected = "a number between 0 and 90 degrees"
        errors.check_number("max_angle", self.max_angle, expected, lambda angle: 0.0 < angle < 90.0)
        errors.check_number("c_n", self.c_n, "a positive number", lambda c: 0.0 < c < np.inf)

    def options(self, basis: Basis, points: int, radius: float) -> MortarOptions:
        """Options of the operators (local).

        Args:
            basis: Basis on the slave, see ``basis_on``.
            points: Gauss points per segment, with "elements" per slave facet.
            radius: Search radius along the normal [length].
        """
        min_cosine, corners = float(np.cos(np.radians(self.max_angle))), self.normals == "opposite"
        return MortarOptions(
            basis, self.normals, self.gap_weights, self.integration, points, radius, min_cosine,
            corners,
        )  # fmt: skip

    def _check_combination(self) -> None:
        """Raise for options without effect or meaning in combination with another one (local)."""
        if self.integration == "nodes":
            at_nodes = {
                "points": "the points are the nodes",
                "basis": "all multiplier functions are equal at the nodes",
                "gap_weights": "all weights of the gap are equal at the nodes",
            }
            self._refuse_set(at_nodes, "integration='nodes'")
        if self.gap_weights == "standard" and self.basis in ("standard", "linear", "quadratic"):
            raise ValueError(
                f"gap_weights='standard' with basis='{self.basis}': Petrov-Galerkin needs dual "
                "multipliers, basis='dual' or 'vertices'; gap_weights='basis' weights the gap by "
                "the standard functions here"
            )

    def check_for_tie(self) -> None:
        """Raise an error for options that a tied pair does not have (local).

        Raises:
            ValueError: For such an option.
        """
        self.check()
        why = f"a tie has {', '.join(OF_TIES)} only"
        others = {field.name: why for field in fields(self) if field.name not in OF_TIES}
        self._refuse_set(others, "TiedPair")

    def _refuse_set(self, reasons: Mapping[str, str], where: str) -> None:
        """Raise for options, given by name with a reason, that are not the default (local)."""
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in reasons and value != field.default:
                raise ValueError(
                    f"{field.name}={value!r} with {where}: {reasons[field.name]}; expected "
                    f"{field.default!r}"
                )


PRESETS: Mapping[str, Discretization] = MappingProxyType(
    {
        "default": Discretization(),
        "other_codes": Discretization(normals="unit", gap_weights="basis", slip="operators"),
        "petrov_galerkin": Discretization(gap_weights="standard"),
    }
)


def as_discretization(given: str | Discretization) -> Discretization:
    """Discretization of a preset given by name; a ``Discretization`` is returned as is (local).

    Raises:
        ValueError: For an unknown name or an object of another type.
    """
    if isinstance(given, str):
        errors.check_choice("discretization", given, PRESETS)
        return PRESETS[given]
    expected = f"an instance of Discretization, or one of {', '.join(PRESETS)}"
    errors.check_kind("discretization", given, Discretization, expected)
    return given


Sliding = Literal["finite", "small"]


def check_search_radius(search_radius: Any) -> None:
    """Raise an error for a search radius that is not a positive length (local)."""
    if search_radius is not None:
        expected = "a positive length, or None"
        errors.check_number("search_radius", search_radius, expected, lambda r: r > 0.0)


def _check_fluxes(fluxes: Any) -> None:
    """Raise an error unless ``fluxes`` are conductances of different fields (local)."""
    expected = "a list of Conductance, one for each field that flows across the contact"
    errors.check_kind("fluxes", fluxes, Sequence, expected)
    for flux in fluxes:
        errors.check_kind("fluxes", flux, Conductance, expected)
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
            for each; see ``linearized_contact`` for nodes that touch two of them. ``None`` for
            contact of a surface with itself, see ``self_contact``.
        law: ``Frictionless()``, ``Coulomb(mu)``, ``Tresca(stress)`` or a user's law, see ``law``.
            Nodes with a prescribed component, as on symmetry planes, are frictionless.
        search_radius: Largest distance of partners along the slave normal, in front of the slave
            and behind it [length]. Default: diagonal of the smaller surface's bounding box; for an
            obstacle no limit. Behind the slave the distance is also limited to half of the present
            thickness of both bodies together, so that a surface may be the whole outline of a body.
        initial_gap: Gap at set-up of all nodes within half a facet of the other surface [length]: 0
            removes gaps and overlaps of faceted curves, a negative number is an interference, a
            positive one a clearance. ``None`` keeps the gaps of the mesh. See also
            ``PairView.offset``.
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
        errors.check_kind("data", data, MeshData, "the MeshData of the mesh")
        self.data = data
        self.slave_name = joined_names(slave)
        self.master_name = self.slave_name if master is None else joined_names(master)
        self.master = master
        self.search_radius, self.initial_gap = search_radius, initial_gap
        self.sliding: Sliding = sliding
        self.fluxes = fluxes
        self.law: Law = Frictionless() if law is None else law
        with errors.together(data.mesh.comm, "ContactPair"):
            self.discretization = as_discretization(discretization)
            self.check()
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
        errors.check_same_texts(data.mesh.comm, "ContactPair", vars(self))
        for names in (slave, master):
            if not (names is None or isinstance(names, Obstacle)):
                data.boundary_facets(names)

    def check(self) -> None:
        """Check the options (local).

        Raises:
            ValueError: If an option has a value that is not allowed.
        """
        errors.check_kind("data", self.data, MeshData, "the MeshData of the mesh")
        errors.check_choice("sliding", self.sliding, get_args(Sliding))
        self.discretization = as_discretization(self.discretization)
        self.discretization.check()
        check_search_radius(self.search_radius)
        if self.initial_gap is not None:
            errors.check_number("initial_gap", self.initial_gap, "a length, or None", np.isfinite)
        errors.check_kind(
            "law", self.law, Law, "an instance of Frictionless, Coulomb, Tresca or Law"
        )
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
            setattr(pair, name, value)
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
        errors.check_kind("data", data, MeshData, "the MeshData of the mesh")
        self.data = data
        self.slave_name, self.master_name = joined_names(slave), joined_names(master)
        self.master = master
        self.gap, self.search_radius = gap, search_radius
        with errors.together(data.mesh.comm, "TiedPair"):
            self.discretization = as_discretization(discretization)
            self._dim = data.mesh.geometry.dim
            zero = np.zeros(self._dim)
            given = zero if translation is None else translation
            self.translation: Array = errors.check_vector("translation", given, self._dim)
            self.jump: Any = zero if jump is None else jump
            if not isinstance(jump, fem.Constant):
                self.jump = errors.check_vector("jump", self.jump, self._dim)
            self.fields = _numbers(fields)
            self.check()
            self.slave_tags = data.boundary_tags(slave)
            data.boundary_tags(master)
        errors.check_same_texts(data.mesh.comm, "TiedPair", vars(self))
        for names in (slave, master):
            data.boundary_facets(names)

    def check(self) -> None:
        """Check the options (local).

        Raises:
            ValueError: If an option has a value that is not allowed.
        """
        errors.check_choice("gap", self.gap, get_args(Gap))
        self.discretization = as_discretization(self.discretization)
        self.discretization.check_for_tie()
        check_search_radius(self.search_radius)
        self.present_jump()

    def present_jump(self) -> Array:
        """Present value of ``jump``, shape (dim,) [length] (local).

        Raises:
            ValueError: If it does not consist of one finite number for each coordinate.
        """
        return errors.check_vector(
            "jump", np.array(getattr(self.jump, "value", self.jump)), self._dim
        )

    def __repr__(self) -> str:
        """The two sides."""
        return f"{type(self).__name__}({self.slave_name!r}, {self.master_name!r})"


def _numbers(fields: Any) -> tuple[int, ...]:
    """Numbers of sub-spaces, each once (local).

    Raises:
        ValueError: For anything else.
    """
    expected = "different numbers of sub-spaces in a list, as [1]"
    if not isinstance(fields, Sequence) or isinstance(fields, str):
        raise ValueError(f"fields={fields!r}: expected {expected}")
    for field in fields:
        errors.check_number("fields", field, expected, lambda number: number >= 0, whole=True)
    if len(set(fields)) < len(fields):
        raise ValueError(f"fields={fields!r}: expected {expected}")
    return tuple(int(field) for field in fields)


class SectionMotion:
    """Shortening and force of a section, as the first of the motions of a remote load.

    These are three in the plane and six in space; shapes are those of the plane.

    Attributes:
        kind: What moves, used in messages.
        dim: Number of coordinates.
        name: Name used in messages.
        pivot: Without effect, shape (2,) [length].
        place: Shortening, and zeros, shape (3,) [length].
        load: Force that tightens the section, nan for a prescribed shortening, and nan, shape (3,)
            [stress length].
        reaction: Force in the section after the last solve, and zeros, shape (3,) [stress length].
    """

    kind = "section"

    def __init__(self, name: str, dim: int) -> None:
        self.name, self.dim = name, dim
        count = dim + len(TURNS[dim])
        self.pivot, self.place, self.reaction = np.zeros(dim), np.zeros(count), np.zeros(count)
        self.load: Array = np.full(count, np.nan)


class Pretension(TiedPair):
    """A section of a bolt, a cable or a clamp that is tightened by a force, then locked.

    The body is cut in the mesh along a straight section, in space a flat one. Its two faces are
    tied but for the shortening along the axis, by which they overlap, as if so much material were
    removed. ``push`` prescribes the force in the section, and the shortening is an unknown.
    ``move`` prescribes the shortening; ``lock`` keeps the present one, so that the force follows
    from external loads. At first the shortening is prescribed as zero. A bolt whose heads do not
    touch is shortened until they do, as bodies supported by contact alone are moved. The axis does
    not rotate with the body: its rotations have to be small. Methods are local; set forces and
    shortenings equally on all ranks.

    Args:
        data: Mesh, tags and names.
        slave: Name or tag of one face of the section, or a list of names.
        master: Name or tag of the other face.
        axis: Direction in which the slave moves into the master, shape (2,), in space (3,) [1 after
            scaling]; the outward normal of the slave by default.
        name: Name used in messages; by default that of the slave.
        options: Options of ``TiedPair``, as ``search_radius`` and ``discretization``.

    Attributes:
        axis: The direction as a unit vector, zero until a problem has found the normal, shape (2,),
            in space (3,) [1].
        motion: Shortening, force and their loads.

    Raises:
        ValueError: If an option has a value that is not allowed.
        MeshError: If a name or tag is unknown or has no facets.

    Note:
        The constructor is collective.

    Example:
        A bolt tightened by 20 kN, then locked under an external load::

            bolt = fm.Pretension(data, slave="bolt/upper cut", master="bolt/lower cut")
            problem = fm.ContactProblem(
                residual, u, [bolt, *pairs], bcs=bcs, petsc_options_prefix="bolt_"
            )
            bolt.push(20e3)
            problem.solve()
            bolt.lock()
            load.value = 5e3
            problem.solve()
            print(bolt.force, bolt.shortening)
    """

    def __init__(
        self,
        data: MeshData,
        slave: Names,
        master: Names,
        *,
        axis: npt.ArrayLike | None = None,
        name: str | None = None,
        **options: Any,
    ) -> None:
        dim = data.mesh.geometry.dim
        self.axis: Array = np.zeros(dim)
        self.motion = SectionMotion("", dim)
        for what in ("jump", "translation"):
            if what in options:
                raise ValueError(f"Pretension has no option {what!r}: it has a shortening")
        super().__init__(data, slave, master, **options)
        self.motion.name = self.slave_name if name is None else name
        if axis is not None:
            with errors.together(data.mesh.comm, "Pretension"):
                self.axis = errors.check_direction("axis", axis, dim)

    def push(self, force: float) -> None:
        """Prescribe the force in the section; the shortening is an unknown of the next solve.

        Args:
            force: Force, positive in tension [stress length]; in space and with a thickness
                [force].

        Raises:
            ValueError: If it is not a finite number.
        """
        self.motion.load[0] = errors.check_finite("force", force)

    def move(self, shortening: float) -> None:
        """Prescribe the shortening, an absolute value.

        Args:
            shortening: Overlap of the two faces, positive in tension [length].

        Raises:
            ValueError: If it is not a finite number.
        """
        self.motion.place = np.zeros_like(self.motion.place)
        self.motion.place[0] = errors.check_finite("shortening", shortening)
        self.motion.load = np.full_like(self.motion.place, np.nan)

    def lock(self) -> None:
        """Prescribe the present shortening."""
        self.move(self.shortening)

    @property
    def shortening(self) -> float:
        """Present overlap of the faces [length] (local)."""
        return float(self.motion.place[0])

    @property
    def force(self) -> float:
        """Force in the section after the last solve, positive in tension [stress length] (local).

        In space and with a thickness [force].
        """
        return float(self.motion.reaction[0])

    def present_jump(self) -> Array:
        """Displacement of the slave relative to the master, shape (dim,) [length] (local)."""
        return self.shortening * self.axis
