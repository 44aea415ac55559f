# SPDX-License-Identifier: MIT
"""Was a plane or axisymmetric model enough? The error of the dimension.

The solution of the plane problem, lifted to a problem in space, see ``Lift``, is that of a cheap
model, and a Newton step of the problem in space corrects it, see ``model_error``. All quantities
are those of the bodies in space, so that the thickness of the plane does not matter.

With friction, slip is counted from the lifted solution of the last check, in the first one from the
state in which the problem in space was given.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem

from fenics_mortar.bulk.cells import Triangles, triangulate
from fenics_mortar.contact.contact import Contact
from fenics_mortar.equations.general import State, restored_if_interrupted
from fenics_mortar.interface.facing import linear_facets, nearest_on_chords, nearest_points
from fenics_mortar.la.solver import factored
from fenics_mortar.models import model_error
from fenics_mortar.obstacles.revolved import directions_across
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils import compat, errors, ranks
from fenics_mortar.utils.arrays import EPSILON, Array, Indices

if TYPE_CHECKING:
    from fenics_mortar.contact.interface import Interface

PREFIX = "fenics_mortar_lift_"
# Distance of nodes from the plane model over its size [1] above which they are not part of it:
# chords of a quarter of a circle with 4 facets are within 0.02 of its radius.
OUTSIDE = 0.03


class Section:
    """Coordinates of a section in space, and vectors of the section in space; all local.

    Args:
        axis: Direction of extrusion, or axis of revolution, of any length, shape (3,).
        first: Direction of the first coordinate of an extruded section, shape (3,).
        origin: Point where both coordinates are zero, shape (3,) [length].
        revolved: Whether the section is revolved.

    Raises:
        ValueError: If a direction is zero, or the first one along the axis.
    """

    def __init__(self, axis: Any, first: Any, origin: Any, *, revolved: bool = False) -> None:
        self.revolved, self._origin = revolved, errors.check_vector("origin", origin, 3)
        self.axis = errors.check_direction("axis", axis)
        self._across = None if revolved else directions_across(axis, first)

    def coordinates(self, X: Array) -> Array:
        """Coordinates of points (n, 3) in the section, shape (n, 2) [length]."""
        first, second = self._directions(X)
        d = X - self._origin
        return np.stack([(d * first).sum(axis=1), (d * second).sum(axis=1)], axis=1)

    def along(self, X: Array) -> Array:
        """Distances s of points (n, 3) from the section along the axis, shape (n,) [length]."""
        return np.asarray((X - self._origin) @ self.axis)

    def in_space(self, X: Array, vectors: Array) -> Array:
        """Vectors (n, 2) of the section at points ``X`` (n, 3), in space (n, 3) [their unit]."""
        first, second = self._directions(X)
        return vectors[:, :1] * first + vectors[:, 1:] * second

    def place_in_space(self, place: Array) -> Array:
        """Place (x, y, angle) of an obstacle as one in space, (6,) [length, radian]."""
        if self.revolved:
            return np.append(place[1] * self.axis, np.zeros(3))
        return np.append(self.in_space(np.zeros((1, 3)), place[None, :2])[0], place[2] * self.axis)

    def _directions(self, X: Array) -> tuple[Array, Array]:
        """e_1 and e_2 at points (n, 3), shape (n, 3) each [1]; e_r is zero on the axis."""
        if self._across is not None:
            first, second = (np.broadcast_to(e, X.shape) for e in self._across)
            return first, second
        d = X - self._origin
        across = d - np.outer(d @ self.axis, self.axis)
        r = np.linalg.norm(across, axis=1)
        off = r > EPSILON * np.abs(d).max(initial=0.0)
        e_r = np.where(off[:, None], across / np.where(off, r, 1.0)[:, None], 0.0)
        return e_r, np.broadcast_to(self.axis, X.shape)


class Lift:
    """A plane problem as a part of a problem in space; the constructor is collective.

    Its solution becomes a state of the problem in space. Positions of the problem in space have
    coordinates of the section, as in ``obstacles.revolved``: with the unit vectors e_1, e_2 and
    a = e_1 x e_2 along the axis of extrusion, or e_1 = e_r and e_2 along the axis of revolution,

        u(X) = u_1 e_1 + u_2 e_2 + s e_a a,    z(X) = (z_1 e_1 + z_2 e_2) / (1 + e_a),

    where u_1, u_2, z_1 and z_2 are those of the plane problem at the coordinates of X, and
    s = (X - O) . a. e_a is the strain along a, zero in plane strain; forces are those of the
    thickness before it.

    Displacements are interpolated linearly between the nodes of the plane mesh, body by body:
    bodies in contact have different values at one position. A body of the plane represents those
    bodies in space most of whose nodes are in it. On a mesh extruded or revolved from that of the
    plane nothing is interpolated; otherwise the difference of the meshes is part of the error.

    Args:
        plane: The problem in the plane.
        solid: The problem in space, with the same pairs in the same order.
        section: The section of the bodies that the plane is.

    Raises:
        MeshError: On all ranks, if a body or a slave surface in space is not part of the plane.
    """

    def __init__(self, plane: ContactProblem, solid: ContactProblem, section: Section) -> None:
        self._plane, self._solid, self._section = plane, solid, section
        floating, space = plane.equations.floating, plane.equations.bulk.space
        self._nodes = [np.flatnonzero(floating.parts == b) for b in range(floating.num_parts)]
        self._bodies = [triangulate(space, nodes) for nodes in self._nodes]
        self._size = floating.extent(plane.equations.bulk.cells.X)
        bulk = solid.equations.bulk
        self._X = bulk.cells.X[: bulk.space.num_nodes]
        self._points = section.coordinates(self._X)
        self._body = self._match_bodies()
        pairs = zip(plane.equations.contacts, solid.equations.contacts, strict=True)
        self._pairs = [self._match_slaves(*pair) for pair in pairs]

    def put(self, strain: Any = None) -> None:
        """Set displacement, multipliers and driven obstacles of the problem in space (collective).

        Args:
            strain: Strain along the axis of extrusion, a scalar UFL expression [1]; zero if
                ``None``.
        """
        bulk, plane = self._solid.equations.bulk, self._plane.equations.bulk
        across, widths = np.zeros(len(self._X)), np.ones(bulk.values.size)
        if strain is not None:
            across = self._at_nodes(project(plane.V, strain))[:, 0]
            widths[bulk.space.owned_dofs] += across[:, None]
        u = self._section.in_space(self._X, self._at_nodes(plane.values[plane.space.dofs]))
        u += np.outer(self._section.along(self._X) * across, self._section.axis)
        bulk.values[bulk.space.owned_dofs] = u
        bulk.u.x.scatter_forward()
        for contact, other, (ends, shares) in zip(
            self._solid.equations.contacts, self._plane.equations.contacts, self._pairs
        ):
            z = np.stack([other.now.fill_inside(part) for part in other.z_u.T.copy()], axis=1)
            z = np.einsum("jk,jkc->jc", shares, z[ends])
            z = z * contact.may_carry[:, None] / contact.slave.gather(widths)[:, :1]
            z = self._section.in_space(contact.slave.X, z)
            active = contact.active
            if isinstance(contact, Contact):
                active = contact.may_carry & ((shares * other.active[ends]).sum(axis=1) > 0.5)
            fluxes = np.zeros((len(z), contact.z.shape[1] - 3))
            contact.change(z=np.hstack([z, fluxes]), active=active, load_time=other.state.load_time)
        self._put_obstacles()

    def _put_obstacles(self) -> None:
        """Set the motions of obstacles that a solve determines (local)."""
        motions = self._solid.equations.motions
        for other, contact in zip(self._plane.equations.contacts, self._solid.equations.contacts):
            if contact.obstacle is None or other.obstacle is None:
                continue
            found = motions.of_obstacle(contact, motions.found)
            place = self._section.place_in_space(other.obstacle.place)
            contact.obstacle.place = np.where(found, place, contact.obstacle.place)

    def _at_nodes(self, values: Array) -> Array:
        """Values (nodes of the plane, 2) at the owned nodes in space, (n, 2) [their unit]."""
        found = np.empty((len(self._points), 2))
        for number, (body, nodes) in enumerate(zip(self._bodies, self._nodes, strict=True)):
            mine = self._body == number
            found[mine] = extrapolate(body, values[nodes], self._points[mine])[0]
        return found

    def _match_bodies(self) -> Indices:
        """Body of the plane for each owned node in space, shape (n,) (collective).

        Raises:
            MeshError: On all ranks, if there is none for a body.
        """
        floating, comm = self._solid.equations.floating, self._solid.equations.comm
        parts = floating.parts[: len(self._X)]
        inside = np.zeros((len(self._bodies), floating.num_parts))
        for number, body in enumerate(self._bodies):
            in_body = np.isfinite(body.interpolate(body.X, self._points)[:, 0])
            inside[number] = np.bincount(parts[in_body], minlength=floating.num_parts)
        best = ranks.sum_over_ranks(comm, inside).argmax(axis=0)[parts]
        farthest = np.zeros(1)
        for number, body in enumerate(self._bodies):
            _, distances = extrapolate(body, body.X, self._points[best == number])
            farthest[0] = max(farthest[0], distances.max(initial=0.0))
        farthest = ranks.largest_over_ranks(comm, farthest)
        if farthest[0] > OUTSIDE * self._size:
            raise errors.MeshError(
                f"a node in space is {farthest[0]:.3g} away from the bodies of the plane problem: "
                "expected bodies whose section it is; see axis, first and origin of InSpace"
            )
        return np.asarray(best)

    def _match_slaves(self, plane: Interface, solid: Interface) -> tuple[Indices, Array]:
        """Two nodes of the plane's slave for each slave node in space, and shares (n, 2) (local).

        Raises:
            MeshError: If a slave node is apart from the slave of the plane.
        """
        curve = plane.slave
        chords = np.concatenate([curve.facets[:, k : k + 2] for k in range(curve.degree)])
        points = self._section.coordinates(solid.slave.X)
        ends, shares = nearest_on_chords(points, curve.X, replace(curve, facets=chords))
        away = np.einsum("jk,jkc->jc", shares, curve.X[ends]) - points
        farthest = int(np.hypot(*away.T).argmax())
        if np.hypot(*away[farthest]) > OUTSIDE * self._size:
            raise errors.MeshError(
                f"slave '{solid.slave.name}': the node at "
                f"{errors.format_point(solid.slave.X[farthest])} is not on '{curve.name}' of the "
                "plane problem: expected the same pairs in the same order, with the same roles"
            )
        return ends, shares


def project(V: Any, expression: Any) -> Array:
    """Projection of a scalar expression of UFL on the functions of a space (collective).

    Args:
        V: Space of vectors in the plane.
        expression: The expression [any unit].

    Returns:
        Values at the local nodes, ghosts included, in the first column, shape (n, 2) [its unit].
    """
    test, found = ufl.TestFunction(V), fem.Function(V)
    mass = compat.form(ufl.inner(ufl.TrialFunction(V), test) * ufl.dx)
    M, b = compat.create_matrix(mass), compat.create_vector(V)
    compat.assemble_matrix(M, mass)
    compat.assemble_vector(b, compat.form(expression * test[0] * ufl.dx))
    factored(M, PREFIX).apply(b, compat.petsc_vec(found))
    found.x.scatter_forward()
    return np.asarray(found.x.array.reshape(-1, 2))


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
        errors.check_kind("problem", problem, ContactProblem, "a ContactProblem in space")
        space = problem.equations.bulk.space
        if space.dim != 3:
            raise ValueError("problem of InSpace: expected one on a mesh of solids")
        if space.is_mixed:
            raise ValueError(
                "problem of InSpace has unknowns other than the displacement, which the plane "
                "problem does not determine: expected the displacement alone"
            )
        if strain is not None:
            errors.check_kind(
                "strain", strain, ufl.core.expr.Expr, "a scalar UFL expression, or None"
            )
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
        with errors.together(comm, "InSpace"):
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
        errors.check_same_texts(comm, "InSpace", {**frame, "strain": self._strain is not None})

    def estimate(self, plane: ContactProblem) -> model_error.Assumption:
        """Errors of a solved plane model, from steps of the problem in space (collective).

        The states of both problems are restored.
        """
        with self._at_lifted(plane) as solid:
            lifted = model_error.SolutionQuantities.of(solid)
            try:
                found = model_error.take_steps(solid, lifted, solid)
                change = self._change(lifted, model_error.SolutionQuantities.of(solid))
            except errors.RaisedElsewhereError:
                raise
            except errors.MortarError:  # the model in space fails: the plane one is not known to do
                found = dict.fromkeys(model_error.QUANTITIES, np.inf)
                change = "the steps in space fail"
        self.follow(plane)
        return model_error.Assumption(self._name(plane), change, found)

    def compare(self, plane: ContactProblem) -> model_error.Assumption:
        """True errors of a solved plane model, if the problem in space is solved too (collective).

        Raises:
            MortarError: On all ranks, if it is not.
        """
        if not self._solid.equations.last_converged:
            raise errors.MortarError(
                "compare(): the problem in space is not solved; call its solve()"
            )
        solved = model_error.SolutionQuantities.of(self._solid)
        with self._at_lifted(plane) as solid:
            lifted = model_error.SolutionQuantities.of(solid)
            solid.equations.bulk.values[: solved.u.size] = solved.u
            solid.equations.bulk.u.x.scatter_forward()
            found = model_error.differences(solid, lifted, solved)
        return model_error.Assumption(self._name(plane), self._change(lifted, solved), found)

    def follow(self, plane: ContactProblem) -> None:
        """Count slip from the present state of a plane problem (collective)."""
        with self._at_lifted(plane) as solid:
            solid.accept()
            self.start = solid.state()

    @contextmanager
    def _at_lifted(self, plane: ContactProblem) -> Iterator[ContactProblem]:
        """Context with the problem in space at the lifted solution; its state is restored."""
        solid, kept = self._solid, self._solid.state()
        if solid.equations.bulk.inertia is not None:
            raise errors.MortarError(
                "InSpace: the problem in space has a Dynamics; expected statics"
            )
        with restored_if_interrupted(solid.equations):  # also if this is while it is restored
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

    def _name(self, plane: ContactProblem) -> str:
        kind = "plane strain" if self._strain is None else "plane stress"
        return "axisymmetric" if plane.equations.bulk.space.is_axisymmetric else kind

    def _change(
        self, lifted: model_error.SolutionQuantities, solved: model_error.SolutionQuantities
    ) -> str:
        """Describe how a solution in space differs from that of the plane (collective)."""
        change = np.abs(solved.u - lifted.u).max(initial=0.0)
        (largest,) = ranks.largest_over_ranks(self._solid.equations.comm, np.array([change]))
        return f"displacement in space differs by {largest:.2g}"


def extrapolate(body: Triangles, values: Array, points: Array) -> tuple[Array, Array]:
    """Values at points in a body, those of the nearest point outside of it (collective).

    Args:
        body: The body.
        values: Values at its local nodes, shape (n, 2) [unit].
        points: Points of this rank, shape (p, 2) [length].

    Returns:
        Values, shape (p, 2) [unit], and distances from the body, shape (p,) [length].
    """

    def nearest(values: Array, points: Array) -> tuple[Array, Array]:
        if not (len(body.nodes) and len(points)):
            return np.zeros((len(points), 2)), np.full(len(points), np.inf)
        corners, weights = nearest_points(points, body.X, linear_facets(body.nodes, len(body.X)))
        at, x = (np.einsum("pk,pkc->pc", weights, field[corners]) for field in (values, body.X))
        return at, np.hypot(*(x - points).T)

    return body.on_all_ranks(nearest, values, points)
