# SPDX-License-Identifier: MIT
"""Pretension: a section of a bolt with a given force, or with a given shortening."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.pair import TiedPair
from fenics_mortar.mesh.data import MeshData, Names
from fenics_mortar.obstacles.rigid_motion import check_finite, check_vector
from fenics_mortar.obstacles.rotations import TURNS
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import together


class SectionMotion:
    """Shortening and force of a section, as the first of the motions of a remote load.

    These are three in the plane and six in space, of which shapes below are those of the plane.

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
            with together(data.mesh.comm, "Pretension"):
                self.axis = _unit(check_vector("axis", axis, dim))

    def push(self, force: float) -> None:
        """Prescribe the force in the section; the shortening is an unknown of the next solve.

        Args:
            force: Force, positive in tension [stress length]; in space and with a thickness
                [force].

        Raises:
            ValueError: If it is not a finite number.
        """
        self.motion.load[0] = check_finite("force", force)

    def move(self, shortening: float) -> None:
        """Prescribe the shortening, an absolute value.

        Args:
            shortening: Overlap of the two faces, positive in tension [length].

        Raises:
            ValueError: If it is not a finite number.
        """
        self.motion.place = np.zeros_like(self.motion.place)
        self.motion.place[0] = check_finite("shortening", shortening)
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

    def __repr__(self) -> str:
        """The two faces."""
        return f"Pretension({self.slave_name!r}, {self.master_name!r})"


def _unit(vector: Array) -> Array:
    """A vector (dim,) over its length (local).

    Raises:
        ValueError: If it is zero.
    """
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        raise ValueError("axis is zero; expected a direction")
    return vector / length
