# SPDX-License-Identifier: MIT
"""Was a plane or axisymmetric model enough? The error of the dimension.

The solution of the plane problem, lifted to a problem in space, is that of a cheap model, and a
Newton step of the problem in space corrects it, see ``model_error``. All quantities are those of
the bodies in space, so that the thickness of the plane does not matter.

With friction, slip is counted from the lifted solution of the last check, in the first one from the
state in which the problem in space was given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl

from fenics_mortar.equations.state import State
from fenics_mortar.models.lift import Lift, Section
from fenics_mortar.models.model_error import (
    QUANTITIES,
    Assumption,
    Errors,
    SolutionQuantities,
    differences,
    take_steps,
)
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arguments import check_kind
from fenics_mortar.utils.errors import (
    MortarError,
    RaisedElsewhereError,
    check_same_texts,
    together,
)
from fenics_mortar.utils.ranks import largest_over_ranks


class InSpace:
    """The bodies in space of which a problem is a section; the constructor is local.

    Args:
        problem: Problem in space with the same pairs in the same order, at present loads: those of
            each check. It need not have been solved.
        axis: Direction of extrusion, or axis of revolution, of any length, shape (3,).
        first: Direction of the section's first coordinate, shape (3,); the second one is along
            axis x first. Without effect on bodies of revolution.
        origin: Point where the coordinates of the section are zero, (3,) [length]; with
            ``strain``, in the middle of the thickness.
        strain: Strain along the axis of extrusion, a scalar UFL expression of the displacement in
            the plane [1]; zero if ``None``, as in plane strain. In plane stress it is
            -nu / (1 - nu) (e_11 + e_22).

    Raises:
        ValueError: If an argument is of another type or value.

    Example:
        With ``solid``, a problem on the extruded mesh, in the one of its section
        ``model_check=fm.ModelCheck(0.02, in_space=fm.InSpace(solid))``.
    """

    def __init__(
        self,
        problem: ContactProblem,
        *,
        axis: npt.ArrayLike = (0.0, 0.0, 1.0),
        first: npt.ArrayLike = (1.0, 0.0, 0.0),
        origin: npt.ArrayLike = (0.0, 0.0, 0.0),
        strain: Any | None = None,
    ) -> None:
        """Check the arguments; slip is counted from the present state of the problem."""
        check_kind("problem", problem, ContactProblem, "a ContactProblem in space")
        space = problem.equations.bulk.space
        if space.dim != 3:
            raise ValueError("problem of InSpace: expected one on a mesh of solids")
        if space.is_mixed:
            raise ValueError(
                "problem of InSpace has unknowns other than the displacement, which the plane "
                "problem does not determine: expected the displacement alone"
            )
        if strain is not None:
            check_kind("strain", strain, ufl.core.expr.Expr, "a scalar UFL expression, or None")
            if strain.ufl_shape != ():
                raise ValueError(f"strain has the shape {strain.ufl_shape}: expected a scalar")
        if problem.equations.bulk.history.is_used:
            raise ValueError(
                "problem of InSpace has history functions, which the plane problem does not "
                "determine: expected one without"
            )
        self._solid, self._strain = problem, strain
        self._frame = {"axis": axis, "first": first, "origin": origin}
        Section(**self._frame, revolved=True)
        self.start: State = problem.state()
        self._lift: tuple[ContactProblem, Lift] | None = None

    def prepare(self, plane: ContactProblem) -> None:
        """Check that the problem in the plane may be a section (collective).

        Raises:
            ValueError, MortarError: On all ranks, if it is not, or options differ between ranks.
        """
        comm, theirs = plane.equations.comm, self._solid.equations.comm
        with together(comm, "InSpace"):
            if plane.equations.bulk.space.dim != 2:
                raise ValueError("in_space: expected a problem in the plane, this one is in space")
            if MPI.Comm.Compare(comm, theirs) not in (MPI.IDENT, MPI.CONGRUENT):
                raise ValueError("in_space: the problem in space has another communicator")
            counts = [len(p.equations.contacts) for p in (plane, self._solid)]
            if counts[0] != counts[1]:
                raise ValueError(
                    f"in_space: the problem in space has {counts[1]} pairs, this one {counts[0]}; "
                    "expected the same ones in the same order"
                )
            if self._strain is not None and plane.equations.bulk.space.is_axisymmetric:
                raise ValueError("strain of InSpace with geometry='axisymmetric': expected None")
        self._section(plane)
        frame = {name: np.asarray(value, float).tolist() for name, value in self._frame.items()}
        check_same_texts(comm, "InSpace", {**frame, "strain": self._strain is not None})

    def estimate(self, plane: ContactProblem) -> Assumption:
        """Errors of a solved plane model, from steps of the problem in space (collective).

        The states of both problems are restored.
        """
        with self._at_lifted(plane) as solid:
            lifted = SolutionQuantities.of(solid)
            errors = dict.fromkeys(QUANTITIES, np.inf)
            try:
                errors = take_steps(solid, lifted, solid)
            except RaisedElsewhereError:
                raise
            except MortarError:  # the model in space fails: the plane one is not known to do
                pass
            found = self._assumption(plane, lifted, SolutionQuantities.of(solid), errors)
        self.start = self._accepted(plane)
        return found

    def compare(self, plane: ContactProblem) -> Assumption:
        """True errors of a solved plane model, if the problem in space is solved too (collective).

        Raises:
            MortarError: On all ranks, if it is not.
        """
        if not self._solid.equations.last_converged:
            raise MortarError("compare(): the problem in space is not solved; call its solve()")
        solved = SolutionQuantities.of(self._solid)
        with self._at_lifted(plane) as solid:
            lifted = SolutionQuantities.of(solid)
            solid.equations.bulk.values[: solved.u.size] = solved.u
            solid.equations.bulk.u.x.scatter_forward()
            errors = differences(solid, lifted, solved)
        return self._assumption(plane, lifted, solved, errors)

    def snapshot(self) -> Callable[[], None]:
        """Return a function that restores the state from which slip is counted (local)."""
        start = self.start

        def restore() -> None:
            self.start = start

        return restore

    def follow(self, plane: ContactProblem) -> None:
        """Count slip from the present state of a plane problem that was read (collective)."""
        self.start = self._accepted(plane)

    def _accepted(self, plane: ContactProblem) -> State:
        with self._at_lifted(plane) as solid:
            solid.accept()
            return solid.state()

    @contextmanager
    def _at_lifted(self, plane: ContactProblem) -> Iterator[ContactProblem]:
        """Context with the problem in space at the lifted solution; its state is restored."""
        solid, kept = self._solid, self._solid.state()
        if solid.equations.bulk.inertia is not None:
            raise MortarError("InSpace: the problem in space has a Dynamics; expected statics")
        try:
            solid.restore(kept.counting_slip_from(self.start).replaced(converged=True))
            solid.equations.start_step()
            self._lift_of(plane).put(self._strain)
            solid.restore(solid.state())
            yield solid
        finally:
            solid.equations.system.ksp.reset()
            solid.restore(kept)

    def _lift_of(self, plane: ContactProblem) -> Lift:
        if self._lift is None or self._lift[0] is not plane:
            self._lift = plane, Lift(plane, self._solid, self._section(plane))
        return self._lift[1]

    def _section(self, plane: ContactProblem) -> Section:
        return Section(**self._frame, revolved=plane.equations.bulk.space.is_axisymmetric)

    def _assumption(
        self,
        plane: ContactProblem,
        lifted: SolutionQuantities,
        solved: SolutionQuantities,
        errors: Errors,
    ) -> Assumption:
        kind = "plane strain" if self._strain is None else "plane stress"
        name = "axisymmetric" if plane.equations.bulk.space.is_axisymmetric else kind
        change = np.abs(solved.u - lifted.u).max(initial=0.0)
        (largest,) = largest_over_ranks(plane.equations.comm, np.array([change]))
        return Assumption(name, f"displacement in space differs by {largest:.2g}", errors)
