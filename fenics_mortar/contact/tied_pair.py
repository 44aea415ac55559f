# SPDX-License-Identifier: MIT
"""A tied pair: slave, master and discretization of a joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from fenics_mortar.contact.discretization import Discretization, as_discretization
from fenics_mortar.contact.pair import check_search_radius
from fenics_mortar.mesh.data import MeshData, Names, joined_names
from fenics_mortar.obstacles.rigid_motion import check_vector
from fenics_mortar.utils.arguments import check_choice, check_kind, check_number
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import check_same_texts, together

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
