# SPDX-License-Identifier: MIT
"""Residual and increment of all equations, and the support reactions.

``Residual`` measures a state, ``Increment`` is the solution of the equations linearized there, and
``reaction_of`` sums the forces that Dirichlet conditions exert on named boundaries.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from fenics_mortar.contact.law_calls import raise_stored
from fenics_mortar.kernels.blocks import add_forces
from fenics_mortar.mesh.data import MeshData, Names, as_list, joined_names
from fenics_mortar.obstacles.rigid_motion import moments_of
from fenics_mortar.utils import errors, ranks
from fenics_mortar.utils.arrays import EPSILON, SOLVED, Array, Indices, Numbers
from fenics_mortar.utils.clock import clock

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk


class Residual:
    """Residual of the last evaluated state; all methods are collective.

    Forces of the bulk and of contact balance at free dofs. Rows of multipliers, driven motions and
    prescribed dofs are converted to forces, so that one norm measures all of them.

    Args:
        equations: The ``ContactEquations``.

    Attributes:
        total: Sum of bulk residual and contact forces, (owned dofs,) [stress length].
        distance: Distance to the prescribed values, (prescribed dofs,) [length].
        force: Reference force: the largest norm of contact forces, reactions and inertia [stress
            length].
        gap: Largest mean gap of an active node over the node's length [1].
        attainable: ``roundoff`` at that state [stress length].
    """

    total: Array
    distance: Array
    force: float = 0.0
    gap: float
    attainable: float = 0.0

    def __init__(self, equations: Any) -> None:
        bulk: Bulk = equations.bulk
        self._bulk, self._contacts, self._floating = bulk, equations.contacts, equations.floating
        self._motions, self._stiffest = equations.motions, equations.stiffest
        self._per_distance = equations.stiffest / bulk.units[bulk.prescribed_dofs]
        self.begin()

    def begin(self) -> None:
        """Read the prescribed values, constant in a solve unless rigid boundaries are driven."""
        self._prescribed = self._bulk.prescribed_values()

    def measure(self) -> float:
        """Norm of all residuals, with the bulk residual already assembled [stress length]."""
        bulk = self._bulk
        prescribed = bulk.prescribed_dofs
        rows, self.gap = 0.0, 0.0
        if self._motions.movers:
            rows += float((self._motions.residual() ** 2).sum())
        for contact in self._contacts:
            squares, gap = contact.rows.measure()
            rows, self.gap = rows + squares, max(gap, self.gap)
            for flux in contact.conductances:
                now = flux.now
                rows += float(((flux.to_force * now.weight * now.row) ** 2).sum())
        raise_stored(bulk.comm, self._contacts)
        if self._motions.remote:
            self.begin()
        self.distance = self._prescribed - bulk.values[prescribed]
        self.total = np.empty(bulk.num_owned)
        free, contact, reactions = add_forces(
            bulk.r.array_r, self.contact_force(), bulk.to_force, bulk.prescribed, self.total
        )
        moves, inertia = self._per_distance * self.distance, 0.0
        if bulk.inertia is not None:
            inertia = (bulk.inertia.forces(bulk.u.x.array) ** 2).sum()
        sums = np.array([free + moves @ moves, contact, reactions, inertia, rows, rows * rows])
        if bulk.comm.size > 1:
            sums = ranks.sum_over_ranks(bulk.comm, sums)
            self._check_equal_on_ranks(sums[1:4].max(), *sums[4:])
        largest = sums[1:4].max()  # nan if one of them is
        self.force, self.attainable = math.sqrt(largest), self.roundoff()
        return math.sqrt(sums[0] + sums[4] / bulk.comm.size)  # equal on all ranks

    def _check_equal_on_ranks(self, force2: float, total: float, squares: float) -> None:
        """Check that replicated contact rows are equal on all ranks.

        Args:
            force2: Square of the reference force.
            total: Sum over the ranks of the squared norm of the rows.
            squares: Sum over the ranks of the squared norm to the power of two.

        Raises:
            MortarError: On all ranks, if the rows differ.
        """
        size = self._bulk.comm.size
        mean = total / size
        spread = math.sqrt(max(squares / size - mean**2, 0.0))
        if spread > SOLVED * max(mean, force2):  # its roundoff is sqrt(EPSILON) = 1.5e-8
            raise errors.MortarError(
                "the equations of contact differ between ranks: expected the same law, distance "
                "and attributes of contacts and obstacles on all ranks"
            )

    def driving(self) -> Array:
        """``total`` less the pushes on rigid boundaries, (owned dofs,) [stress length].

        Its resultants drive floating bodies.
        """
        return self.total - self._motions.pushed_nodes()

    def of_prescribed(self) -> float:
        """Norm of the rows of prescribed dofs, a lower bound of ``measure`` [stress length]."""
        rows = self._per_distance * self._bulk.distance_to_prescribed()
        return float(np.sqrt(self._bulk.comm.allreduce(float(rows @ rows))))

    def roundoff(self) -> float:
        """Attainable accuracy of the residual, limited by roundoff [stress length]."""
        bulk, inertia = self._bulk, self._bulk.inertia
        displacement = bulk.largest(bulk.values)
        if self._motions.movers:
            displacement = max(displacement, self._motions.largest())
        stiffness = self._stiffest + (0.0 if inertia is None else inertia.stiffness)
        roundoff = stiffness * math.sqrt(bulk.num_dofs) * displacement
        for c in self._contacts:
            largest = float(np.abs(c.slave.X).max()) * math.sqrt(c.slave.num_nodes)
            roundoff += max(stiffness, c.now.steepness) * largest
        return 4.0 * EPSILON * roundoff

    def forces(self) -> tuple[Array, Array, Array]:
        """Bulk residual, contact forces and forces on obstacles at the present state.

        Returns:
            Bulk residual and contact forces, (owned dofs,) each [stress length], whose sum at
            prescribed dofs is the support reaction; forces and moments that keep obstacles in
            place, (obstacles, 3), moments over ``DrivenMotions.scales`` [stress length].
        """
        self._bulk.assemble_residual()
        bulk = self._bulk.r.array_r[: self._bulk.num_owned].copy()
        self._floating.add_spring_forces()
        return bulk, self.contact_force(), self._motions.obstacle_forces()

    @clock("assembly")
    def contact_force(self, multipliers: str = "z") -> Array:
        """B^T z and loads of fluxes, (owned dofs,); ``multipliers="shear"``: of the shear only.

        Units [stress length], those of fluxes [flux length].
        """
        force = np.zeros(self._bulk.num_owned)
        for contact in self._contacts:
            if multipliers == "z":
                contact.add_loads(force)
            else:
                contact.scatter_add(contact.operators.force(getattr(contact, multipliers)), force)
        return force


# Motions of nothing that moves.
NO_MOTION: Array = np.zeros((0, 3))


class Increment(NamedTuple):
    """Solution of the linearized equations.

    Attributes:
        u: Increment of the displacement and other unknowns of the bulk, owned dofs [length].
        z: The new multipliers of each pair, shape (slave nodes, 2) [stress].
        motion: Increments of the motions of m obstacles and remote loads, shape (m, 3) [length];
            ``NO_MOTION`` if none moves.
        remark: Remarks on the solution; "" if there are none.
    """

    u: Array
    z: list[Array]
    motion: Array
    remark: str


class Reaction(NamedTuple):
    """Force and moment that Dirichlet conditions on a boundary exert, equal on all ranks.

    The residual of all forces (stresses, loads, contact with friction, obstacles, inertia) is
    summed over the prescribed dofs of the boundary, whichever condition prescribes them; nothing
    supports free components. That of a rigid boundary contains its push. A corner belongs to all
    its boundaries: its force is in the reaction of each of them, and once in that of a list of
    them. The reaction of the list of all supports, the loads and the forces on obstacles are
    therefore in equilibrium, in dynamics with the inertia. Weak springs that restrain a body, as a
    report then says, are no support.

    Attributes:
        force: Force, shape (2,) [stress length]; with a thickness [force]. In space (3,) [force].
        moment: Moment about ``about``, counterclockwise [stress length^2]; with a thickness
            [force length]. In space a vector, shape (3,) [force length]. Levers are those of the
            present positions.
        about: The point of reference, shape (dim,) [length].

    Note:
        On bodies of revolution the radial component is the sum around the axis, as that of
        ``PairView.total_force``, and the moment is zero by symmetry.
    """

    force: Array
    moment: float | Array
    about: Array


def reaction_of(
    bulk: Bulk, forces: Array, given: list[MeshData], names: Names, about: npt.ArrayLike | None
) -> Reaction:
    """Sum of forces at the prescribed dofs of some boundaries (collective).

    Args:
        bulk: The bodies.
        forces: Bulk residual plus contact forces, shape (owned dofs,) [stress length].
        given: Meshes with names, those of the pairs or the one that the user gave.
        names: Names or tags of the boundaries; a node of several of them counts once.
        about: The point of reference, shape (dim,) [length], or ``None`` for the origin.

    Raises:
        MeshError: On all ranks, if no mesh has the names, a boundary has no facets, or no dof there
            is prescribed.
        ValueError: On all ranks, if ``about`` is not a point.
    """
    with errors.together(bulk.comm, "reaction"):
        point = _point(about, bulk.space.dim)
        if not given:
            raise errors.MeshError(
                "without pairs or remote loads there are no names of boundaries; expected data="
            )
        if any(data.mesh is not bulk.V.mesh for data in given):
            raise errors.MeshError("data belongs to another mesh than u")
        known = [
            data
            for data in given
            if all((isinstance(name, str) and name in data.boundaries) for name in as_list(names))
        ]
        data = (known or given)[0]
        tags = data.boundary_tags(names)
    errors.check_same_texts(bulk.comm, "reaction", {"boundary": tags, "about": point})
    nodes = _nodes(bulk, data.boundary_facets(names))
    dofs = bulk.space.dofs[nodes]
    prescribed = bulk.prescribed[dofs]
    if not ranks.on_any_rank(bulk.comm, bool(prescribed.any())):
        raise errors.MeshError(
            f"boundary '{joined_names(names)}' has no prescribed dof, so that nothing supports the "
            f"body there; expected one with a Dirichlet condition: {_supported(bulk, data)}"
        )
    on_nodes = np.where(prescribed, forces[dofs], 0.0)
    arms = bulk.positions()[nodes] - point
    moments = moments_of(arms, on_nodes).sum(axis=1) * (not bulk.space.is_axisymmetric)
    sums = ranks.sum_over_ranks(bulk.comm, np.concatenate([on_nodes.sum(axis=0), moments]))
    force, moment = np.split(sums, [bulk.space.dim])
    return Reaction(force, moment if moment.size > 1 else float(moment[0]), point)


def _point(about: Any, dim: int) -> Array:
    """The point of reference (dim,) [length], the origin for ``None`` (local)."""
    try:
        point = np.zeros(dim) if about is None else np.array(about, np.float64)
    except (TypeError, ValueError):
        point = np.empty(0)
    if point.shape != (dim,) or not np.isfinite(point).all():
        x = "(x, y)" if dim == 2 else "(x, y, z)"
        raise ValueError(f"about={about!r}: expected a point {x}, or None for the origin")
    return point


def _nodes(bulk: Bulk, facets: Numbers) -> Indices:
    """Nodes of the displacement owned by this rank on facets, shape (k,) (collective)."""
    dim = bulk.space.dim
    bulk.V.mesh.topology.create_connectivity(dim - 1, dim)
    nodes = np.asarray(fem.locate_dofs_topological(bulk.V, dim - 1, facets), np.int64)
    return nodes[nodes < bulk.space.num_nodes]


def _supported(bulk: Bulk, data: MeshData) -> list[str]:
    """Names of boundaries of which every node has a prescribed dof (collective)."""
    found = []
    for name, tag in data.boundaries.items():
        nodes = _nodes(bulk, data.facet_tags.find(tag))
        prescribed = bulk.prescribed[bulk.space.dofs[nodes]].any(axis=1)
        count, fixed = ranks.sum_over_ranks(bulk.comm, [len(nodes), prescribed.sum()])
        if 0 < count == fixed:
            found.append(name)
    return found
