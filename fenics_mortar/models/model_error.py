# SPDX-License-Identifier: MIT
"""Error of a solved problem's model, from a Newton step of a richer model.

At the solution of a cheap model the equations of a richer model have a residual. One linear solve
with the tangent of the richer model, a Newton step, yields a correction of displacement and
multipliers. To first order the correction is the error of the model, and so is the change of any
quantity. If the remaining residual is larger than in a nearly linear problem, the models are far
apart, and a few more steps follow, until the remaining residual, as a fraction of the correction,
cannot change any quantity by half. All quantities are checked, since a peak pressure may be
accurate while the contact area is not.

``estimate`` compares models, ``rigid_obstacle`` an obstacle with an ``ElasticObstacle``,
``describe`` states how far a solution deviates from the assumptions, and a ``ModelReport`` has the
errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

from fenics_mortar.bulk.bodies import find_floating_bodies, label_bodies
from fenics_mortar.bulk.checks import check_residual, check_space
from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import tangential
from fenics_mortar.contact.law import Stick
from fenics_mortar.contact.pair import ContactPair
from fenics_mortar.equations.general import restored_if_interrupted
from fenics_mortar.interface import facing
from fenics_mortar.interface.integrals import evaluate_normals
from fenics_mortar.interface.reference import gauss_rule
from fenics_mortar.interface.traces import extract_surface
from fenics_mortar.la.solver import factored_bulk
from fenics_mortar.mesh.data import MeshData, Names, joined_names
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.obstacles.rigid_motion import polar
from fenics_mortar.utils import files, ranks
from fenics_mortar.utils.errors import (
    MeshError,
    MortarError,
    RaisedElsewhereError,
    call_together,
    check_kind,
    check_same_texts,
    together,
)

if TYPE_CHECKING:
    from fenics_mortar.problem import ContactProblem
    from fenics_mortar.utils.arrays import Array


def largest_strain(problem: ContactProblem) -> tuple[float, float]:
    """Largest rotation [radian] and principal strain, cell means (collective).

    From polar decompositions F = R U at the present state, in the plane or in space.
    """
    bulk = problem.equations.bulk
    R, stretches = polar(bulk.cells.deformation_gradients(bulk.positions()))
    strains = np.abs(stretches - 1.0).max(axis=1)
    if bulk.space.is_axisymmetric:
        strains = np.maximum(strains, np.abs(bulk.cells.hoop_strains(bulk.positions())))
    mine = np.array([np.abs(values).max(initial=0.0) for values in (angles_of(R), strains)])
    rotation, strain = ranks.largest_over_ranks(problem.equations.comm, mine)
    return float(rotation), float(strain)


def strained(problem: ContactProblem, u: Array) -> Array:
    """Subtract from a displacement the closest rigid motion of each body (collective).

    Otherwise a finite rotation would contribute strain to the energy of a tangent. The only rigid
    motion of a body of revolution is along the axis, for which the tangent is exact.

    Args:
        problem: The problem with its bodies.
        u: Displacement, shape (owned dofs,) [length].

    Returns:
        The remainder, shape (owned dofs,) [length].
    """
    space, rest = problem.equations.bulk.space, u.copy()
    if space.is_axisymmetric:
        return rest
    comm, dim = problem.equations.comm, space.dim
    X = space.V.tabulate_dof_coordinates()[: space.num_nodes, :dim]
    labels = problem.equations.floating.labels[: space.num_nodes]
    x = X + u[space.owned_dofs]
    for label in range(comm.allreduce(int(labels.max(initial=0)), MPI.MAX) + 1):
        mine = labels == label
        sums = np.concatenate([[mine.sum()], X[mine].sum(axis=0), x[mine].sum(axis=0)])
        count, *means = comm.allreduce(sums)
        before, now = np.split(np.array(means) / max(count, 1), 2)
        dX, dx = X[mine] - before, x[mine] - now
        rotation, _ = polar(comm.allreduce(dx.T @ dX))
        rest[space.owned_dofs[mine]] = dx - dX @ rotation.T
    return rest


def angles_of(R: Array) -> Array:
    """Angles of rotations ``R`` (..., d, d) in the plane or in space, (...,) [radian] (local)."""
    dim = R.shape[-1]
    sine = np.linalg.norm(R - np.swapaxes(R, -1, -2), axis=(-2, -1)) / np.sqrt(8.0)
    return np.arctan2(sine, 0.5 * (np.trace(R, axis1=-2, axis2=-1) + 2.0 - dim))


ENERGY, FORCE, PEAK = "energy norm", "total force", "peak pressure"
QUANTITIES = (ENERGY, FORCE, PEAK)
Errors = dict[str, float]
# Largest number of steps of the richer model.
MAX_CORRECTIONS = 6
# Remaining fraction of the residual after a step [1] above which another step follows.
LINEAR_FRACTION = 0.1
# Expected change of an error by another step, relative to the solution [1], that is always
# accepted.
SETTLED = 1e-3


@dataclass
class SolutionQuantities:
    """Quantities of a solution, for comparison with another one on the same mesh.

    Attributes:
        u: Displacement, shape (owned dofs,) [length].
        force: Total force on each slave, shape (pairs, dim) [stress length].
        peak: Largest pressure of each pair, shape (pairs,) [stress].
    """

    u: Array
    force: Array
    peak: Array

    @classmethod
    def of(cls, problem: ContactProblem) -> SolutionQuantities:
        """Copy the quantities of the present state of a problem (collective)."""
        return cls(
            problem.equations.bulk.u.x.array[: problem.equations.bulk.num_owned].copy(),
            np.array([contact.total_force for contact in problem.equations.contacts]),
            np.array([contact.pressure.max() for contact in problem.equations.contacts]),
        )


def adopt(problem: ContactProblem, other: ContactProblem) -> None:
    """Set the state of ``problem`` to the present one of ``other``, its variant (collective)."""
    ours, theirs = problem.equations.contacts, other.equations.contacts
    for contact, of_other in zip(ours, theirs, strict=True):
        if isinstance(contact, Contact) and isinstance(of_other, Contact):
            contact.adopt(of_other)
    problem.restore(other.state())


def estimate(problem: ContactProblem, *richer: ContactProblem) -> Errors:
    """Relative errors of a solved problem by quantity; its state is restored (collective).

    Args:
        problem: The problem.
        richer: Richer variants in the order of their steps, each from the result of the one before.

    Returns:
        The errors; inf where a richer model fails.
    """
    state, cheap, last = problem.state(), SolutionQuantities.of(problem), problem
    try:
        for model in richer:
            adopt(model, last)
            with restored_if_interrupted(model.equations):
                found = take_steps(problem, cheap, model)
            last = model
        return found
    except RaisedElsewhereError:
        raise
    except MortarError:
        return dict.fromkeys(QUANTITIES, np.inf)
    finally:
        for model in richer:
            model.equations.system.ksp.reset()
        problem.restore(state)


def take_steps(problem: ContactProblem, cheap: SolutionQuantities, model: ContactProblem) -> Errors:
    """Take steps of a model until another step would hardly change any error (collective).

    The expected change by a step is the remaining fraction of the residual after the last step,
    times the change by all previous steps.
    """
    start = model.equations.evaluate(start=True).residual or np.inf
    for _ in range(MAX_CORRECTIONS):
        fraction = model.equations.advance().fraction
        left = model.equations.evaluate(start=False).residual / start
        found = differences(problem, cheap, SolutionQuantities.of(model))
        settled = left * found[ENERGY] <= max(SETTLED, 0.5 * min(found.values()))
        if fraction == 1.0 and left <= LINEAR_FRACTION and settled:
            break
    return found


def estimate_wider(
    problem: ContactProblem, contacts: Sequence[Contact], lengths: Sequence[Array]
) -> Errors:
    """Relative errors by quantity of neglecting an increase of gaps (collective).

    Args:
        problem: The solved problem; its state is restored.
        contacts: Pairs whose gaps increase.
        lengths: Increase for each pair, shape (slave nodes,) [length].
    """
    kept = [contact.offset for contact in contacts]
    for contact, length in zip(contacts, lengths, strict=True):
        contact.change(offset=contact.offset - length)
    found = estimate(problem, problem)
    for contact, offset in zip(contacts, kept, strict=True):
        contact.change(offset=offset)
    problem.restore(problem.state())
    return found


def differences(
    problem: ContactProblem, one: SolutionQuantities, other: SolutionQuantities
) -> Errors:
    """Relative differences of two solutions by quantity (collective).

    Energies are those of the bulk tangent of ``problem``.
    """
    bulk = problem.equations.bulk
    bulk.assemble_tangent()
    x, y = bulk.K.createVecs()

    def energy(u: Array) -> float:
        x.array[:] = u
        bulk.K.mult(x, y)
        return abs(x.dot(y))

    square = relative(energy(one.u - other.u), energy(strained(problem, other.u)))
    found = {
        ENERGY: float(np.sqrt(square)),
        FORCE: relative(np.linalg.norm(one.force - other.force), np.linalg.norm(other.force)),
        PEAK: relative(np.abs(one.peak - other.peak).max(), np.abs(other.peak).max()),
    }
    return ranks.agreed(problem.equations.comm, found)


def relative(difference: Any, size: Any) -> float:
    """Difference over size [1]; 0 if both vanish, inf if only the size does (local)."""
    return float(difference / size) if size > 0.0 else float(np.inf if difference > 0.0 else 0.0)


# Names of assumptions, which the bulk and the pairs of a variant make.
LINEAR, SMALL = "linear strain", "small sliding"


def describe(problem: ContactProblem, assumption: str) -> str:
    """The deviations of a solved problem from an assumption, as text (collective).

    For linear strain: the rotation, whose spurious strain is angle^2 / 2, and the strain; for small
    sliding: the slip over a facet's length and the rotation of the normals.
    """
    if assumption == LINEAR:
        rotation, strain = largest_strain(problem)
        return f"rotation {np.degrees(rotation):.2g}°, strain {100 * strain:.2g} %"
    slip, angle = np.max([_largest_slip(c) for c in sliding_little(problem)], axis=0)
    return f"slip {slip:.2g} facets, normals rotate by {np.degrees(angle):.2g}°"


def sliding_little(problem: ContactProblem) -> list[Contact]:
    """Contacts with small sliding, which use the operators of the undeformed mesh (local)."""
    return [c for c in problem.equations.floating.contacts if c.pair.sliding == "small"]


def _largest_slip(contact: Contact) -> tuple[float, float]:
    """Largest slip of active nodes over their length, and rotation of normals [radian] (local)."""
    o, on = contact.operators, contact.active & contact.covered
    jump = o.jump(o.x - contact.slave.X, o.m - contact.master.X)
    along = np.linalg.norm(tangential(jump, o.n), axis=1)
    slip = along[on] / (o.weight * contact.slave.nodal_lengths)[on]
    weighting = contact.pair.discretization.normals
    before, now = (evaluate_normals(contact.slave, x, weighting)[0] for x in (contact.slave.X, o.x))
    angles = np.arccos(np.clip(np.einsum("jc,jc->j", before, now)[on], -1.0, 1.0))
    return float(slip.max(initial=0.0)), float(angles.max(initial=0.0))


def shear_demand(problem: ContactProblem) -> float:
    """Largest mean |z_tau| / z_n of all pairs with a sticking law [1] (local).

    This is the deviation of a model without friction: the friction that sticking would require. In
    space the sizes of the vectors z_tau.
    """
    demands = [
        relative(
            np.abs(c.operators.weight * c.now.shear_size).sum(),
            float(np.abs(c.operators.weight * c.pressure).sum()),
        )
        for c in problem.equations.contacts
        if isinstance(c.pair, ContactPair) and isinstance(c.pair.law, Stick)
    ]
    return max(demands, default=0.0)


@dataclass(frozen=True)
class Assumption:
    """An assumption of a model and its estimated error.

    Attributes:
        name: The assumption.
        indicator: Deviation of the state from the assumption, as text.
        errors: Estimated relative error by quantity [1]; nan if unknown.
        mesh: Error of the mesh of the richer model, if known.
    """

    name: str
    indicator: str
    errors: Errors
    mesh: Assumption | None = None


@dataclass(frozen=True)
class ModelReport(files.Markdown):
    """Estimated errors of the assumptions of a solution; prints as a Markdown table; local.

    Attributes:
        assumptions: Each assumption; if there are several, the last one is their combination.
        tolerance: Allowed relative error of the quantity [1].
        quantity: "energy norm", "total force" or "peak pressure".
        discretisation: Relative error of the mesh [1], if known.
    """

    assumptions: list[Assumption]
    tolerance: float
    quantity: str
    discretisation: float | None = None

    @property
    def error(self) -> float:
        """Estimated relative error of the quantity due to all assumptions [1]."""
        return max((a.errors[self.quantity] for a in self.assumptions), default=0.0)

    @property
    def suffices(self) -> bool:
        """Whether the estimated error is within the tolerance; false if it is unknown."""
        return bool(self.error <= self.tolerance)

    def verdict(self, assumption: Assumption) -> str:
        """Verdict on one assumption, as text (local)."""
        error = assumption.errors[self.quantity]
        if np.isnan(error):
            return "unknown"
        if error <= self.tolerance:
            return "enough"
        of_meshes = [self.discretisation or 0.0]
        of_meshes += [assumption.mesh.errors[self.quantity]] if assumption.mesh else []
        return "refine the mesh first" if error <= max(of_meshes) else "not enough"

    def __str__(self) -> str:
        """Markdown table: one row per assumption, and the error of the mesh."""
        head, rows = ["assumption", "indicator", *QUANTITIES, "verdict"], list[list[str]]()
        for a in self.assumptions:
            rows.append(_row(a, self.verdict(a)))
            rows += [_row(a.mesh, "")] if a.mesh else []
        if self.discretisation is not None:
            error = [f"{100 * self.discretisation:.2g} %", *[""] * (len(QUANTITIES) - 1)]
            rows.append(["mesh", "", *error, ""])
        table = files.markdown_table(head, rows, left=(0, 1, len(head) - 1))
        tolerance = f"{100 * self.tolerance:g} % in {self.quantity}"
        return f"{table}\n\nestimated errors; the tolerance is {tolerance}"


def _row(assumption: Assumption, verdict: str) -> list[str]:
    """One row of the table."""
    cells = [f"{100 * assumption.errors[name]:.2g} %" for name in QUANTITIES]
    return [assumption.name, assumption.indicator, *cells, verdict]


PREFIX = "fenics_mortar_elastic_obstacle_"
# Gauss points on a facet of the slave, which may face several facets of an elastic obstacle with
# kinks.
POINTS_ON_FACET = 12


class ElasticObstacle:
    """Mesh and stiffness of the body that a rigid obstacle represents.

    The tractions of a solved contact, applied to the mesh of the body, displace its surface by one
    linear solve. With an elastic obstacle the gaps would be wider by this displacement. A second
    linear solve, with the tangent of the problem, yields the change of the solution: the error of
    the rigid obstacle to first order, for the shapes and supports of both bodies. It is of first
    order for any change of the contact area, since the elastic energy W of the soft body, as a
    function of the obstacle's motion, decreases by the complementary energy of the obstacle at
    equal forces.

    The deviation of the facets of a curved obstacle's mesh from the curve has the effect of an
    elastic displacement. It is an error of the mesh, not of the rigid obstacle, and is reported
    separately.

    All quantities are in the frame of the obstacle, which may have moved and rotated arbitrarily.

    Args:
        obstacle: The obstacle, whose surface is that of the mesh in its initial position.
        residual: UFL form of the internal forces; its tangent at the present ``u`` is used.
        u: Displacement of the mesh.
        data: Mesh, tags and names, on the communicator of the problem.
        surface: Name or tag of the contact boundary, or a list of them.
        bcs: Dirichlet conditions that fix the body; their values are not used.

    Raises:
        ValueError: If the conditions do not fix the body, or an argument is of another type.
        MeshError: If a name or tag is unknown or has no facets.

    Note:
        The constructor is collective.

    Example:
        ``tool = fm.ElasticObstacle(circle, residual, u, data, "tool/rim", bcs=grips)``, and in the
        problem with the circle, ``model_check=fm.ModelCheck(elastic_obstacles=[tool])``.
    """

    def __init__(
        self,
        obstacle: Obstacle,
        residual: Any,
        u: Any,
        data: MeshData,
        surface: Names,
        *,
        bcs: Sequence[Any] = (),
    ) -> None:
        check_kind("obstacle", obstacle, Obstacle, "a rigid obstacle, such as Circle(...)")
        check_kind("u", u, fem.Function, "a function of dolfinx")
        check_kind("data", data, MeshData, "the MeshData of the mesh of the obstacle")
        with together(data.mesh.comm, "ElasticObstacle"):
            check_kind("bcs", bcs, (list, tuple), "a list of Dirichlet conditions")
            check_kind("residual", residual, ufl.Form, "a UFL form")
            check_residual("residual", residual, u)
            data.boundary_tags(surface)
            if data.mesh is not u.function_space.mesh:
                raise MeshError("data belongs to another mesh than u")
        check_same_texts(data.mesh.comm, "ElasticObstacle", {"surface": surface, "bcs": len(bcs)})
        check_space(u.function_space, ())
        self.obstacle = obstacle
        space = DisplacementSpace(u.function_space)
        self._bulk = Bulk(residual, u, list(bcs), None, space)
        tags = data.facet_tags, data.boundary_tags(surface)
        self._surface = extract_surface(space, *tags, joined_names(surface))
        self._bulk.assemble_tangent()
        if find_floating_bodies(self._bulk, *label_bodies(self._bulk.V)):
            raise ValueError(f"the elastic body of {obstacle} can move: expected bcs that fix it")
        self._factors = factored_bulk(self._bulk, PREFIX)

    def displacements(self, contacts: Sequence[Contact]) -> list[Array]:
        """Displacements of the surface under the contact forces (collective).

        Args:
            contacts: The pairs of its obstacle, at a solved state.

        Returns:
            Displacement along the slave normals for each pair, shape (slave nodes,) [length]:
            weighted by the multiplier functions, like gaps.
        """
        touching = [_Touching(contact, self.obstacle, self._surface) for contact in contacts]
        load = np.zeros_like(self._surface.X)
        for points in touching:
            points.add_tractions(load)
        load = ranks.sum_over_ranks(self._surface.comm, load)
        force, solution = self._bulk.K.createVecs()
        self._surface.scatter_add(load, force.array)
        force.array[self._bulk.prescribed_dofs] = 0.0
        self._factors.apply(force, solution)
        moved = self._surface.gather(solution.array_r)
        return [points.means(points.along_normals(moved)) for points in touching]

    def flatness(self, contacts: Sequence[Contact]) -> list[Array]:
        """Depth of the facets inside the obstacle for each of ``contacts`` (collective).

        Returns:
            Shape (slave nodes,) each [length], weighted as for ``displacements``.
        """
        touching = [_Touching(contact, self.obstacle, self._surface) for contact in contacts]
        return [points.means(-points.distances(self._surface.X)) for points in touching]


class _Touching:
    """Points of the slave facets of a pair, and the nearest points of the obstacle's mesh.

    Args:
        contact: The pair, at a solved state.
        obstacle: Its obstacle.
        surface: Contact surface of the obstacle's mesh.
    """

    def __init__(self, contact: Contact, obstacle: Obstacle, surface: Any) -> None:
        self._contact, self._obstacle, o = contact, obstacle, contact.operators
        self._points = facing.points_of(o.segments, gauss_rule(POINTS_ON_FACET))
        self._measure = self._points.measure(o.x)
        self._tractions = facing.with_weight(self._points, at_vertices=contact.at_vertices)
        if contact.slave.thickness is not None:
            self._measure = self._measure * self._points.of(contact.slave.thickness.at(o.x))
        own = obstacle.to_own_frame(self._points.of(o.x).reshape(-1, surface.dim))
        if surface.dim == 3:
            facets = facing.linear_facets(surface.facets, surface.num_nodes)
            self._corners, self._shares = facing.nearest_points(own, surface.X, facets)
        else:
            self._corners, self._shares = facing.nearest_on_chords(own, surface.X, surface)

    def add_tractions(self, load: Array) -> None:
        """Add the nodal forces of tractions to ``load`` (nodes, dim), in the obstacle's frame."""
        z = self._contact.z_u
        if self._contact.at_vertices:
            z = np.stack([self._contact.now.fill_inside(part) for part in z.T.copy()], axis=1)
        forces = self._tractions.of(z) * self._measure[:, :, None]
        forces = forces.reshape(-1, forces.shape[2]) @ self._obstacle.rotation
        np.add.at(load, self._corners, self._shares[:, :, None] * forces[:, None])

    def along_normals(self, moved: Array) -> Array:
        """Displacements (nodes, dim) along slave normals at points, (points,) [length] (local)."""
        motion = self._at_nearest(moved) @ self._obstacle.rotation.T
        normals = self._points.direction(self._contact.operators.n)
        return np.asarray((motion * normals.reshape(motion.shape)).sum(axis=1))

    def distances(self, X: Array) -> Array:
        """Signed distances of nearest points of the mesh from the obstacle [length]; collective."""
        distance = f"the distance of '{self._obstacle.name}'"
        local = partial(self._obstacle.local, self._at_nearest(X))
        return call_together(self._contact.slave.comm, distance, local)[0]

    def means(self, values: Array) -> Array:
        """Weighted means of values (points,) for each slave node [their unit] (collective).

        Zero at nodes without points, shape (slave nodes,). Of linear functions on triangles with
        six nodes those of the corners are interpolated, since an offset is a sum over all nodes.
        """
        parts = self._tractions.dual_moments(self._measure, values.reshape(self._measure.shape))
        sums = np.zeros((2, self._contact.slave.num_nodes))
        for target, part in zip(sums, parts, strict=True):
            np.add.at(target, self._tractions.slave, part)
        sums = ranks.sum_over_ranks(self._contact.slave.comm, sums)
        means = np.asarray(sums[0] / np.where(sums[1] > 0.0, sums[1], 1.0))
        only_at_corners = self._tractions.slave.shape != self._points.slave.shape
        return self._contact.now.fill_inside(means) if only_at_corners else means

    def _at_nearest(self, nodal: Array) -> Array:
        """Interpolate nodal values (nodes, dim) at nearest points, (points, dim) (local)."""
        return np.einsum("pk,pkc->pc", self._shares, nodal[self._corners])


def rigid_obstacle(problem: ContactProblem, elastic: ElasticObstacle) -> Assumption:
    """Errors of a rigid obstacle: its elasticity, and the facets of its mesh (collective)."""
    touching = contacts_of(problem, elastic)
    yielding, flatness = elastic.displacements(touching), elastic.flatness(touching)
    deviate = f"facets deviate by {_largest(flatness):.2g}"
    by_mesh = estimate_wider(problem, touching, flatness)
    mesh = Assumption(f"mesh of {elastic.obstacle}", deviate, by_mesh)
    moved = f"displacement of its surface {_largest(yielding):.2g}"
    errors = estimate_wider(problem, touching, yielding)
    return Assumption(f"rigid {elastic.obstacle}", moved, errors, mesh)


def contacts_of(problem: ContactProblem, elastic: ElasticObstacle) -> list[Contact]:
    """The contacts with the obstacle of an elastic obstacle (local)."""
    return [c for c in problem.equations.floating.contacts if c.obstacle is elastic.obstacle]


def _largest(lengths: Sequence[Array]) -> float:
    """Largest absolute value of arrays of any shape [length] (local)."""
    return max((float(np.abs(length).max(initial=0.0)) for length in lengths), default=0.0)
