# SPDX-License-Identifier: MIT
"""Active sets of bodies supported by contact, from the linearized contact problem.

Stiff bodies supported by contact alone undergo only small elastic displacements if the active set
is correct. With another set some bodies are loose, and a Newton step moves them far. An active-set
iteration updates all nodes at once; it may cycle for a wall, or turn an arch into a mechanism. This
module solves the linearized problem together with its inequalities, reduced to the multipliers by
the compliance of all bodies, see ``rigid.complementarity``. The next Newton step uses the active
set and branches of this solution. With friction the solution may not be unique. If no body floats,
it is the one at the end of the load path from the accepted state. If nodes only open and close, a
solution beyond a turning point of this path may be used, at the end of a snap-through.

The compliance needs one linear solve for each multiplier component of all nodes that may touch. It
is therefore computed only if the active set does not converge.

The compliance of a floating body is that of the elastic body on springs, corrected by a low-rank
term that weakens the springs on its rigid motions. Without this correction, with weak springs in
the stiffness, the stiffness of a body that is unstable under its loads, such as an inverted
pendulum, would not be positive definite.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import ELASTIC
from fenics_mortar.contact.law import STICK, Coulomb, Frictionless
from fenics_mortar.equations.arguments import EQUATIONS
from fenics_mortar.la.solver import column_groups, factored_bulk
from fenics_mortar.la.sparse import BlockMatrix
from fenics_mortar.la.system import LinearSystem
from fenics_mortar.rigid.complementarity import (
    FrictionProblem,
    Sets,
    TurningPoint,
    follow_loads,
    solve_friction,
)
from fenics_mortar.rigid.driven import DrivenMotions
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.rigid.proximal import RIGID
from fenics_mortar.utils import errors
from fenics_mortar.utils.arrays import SOLVED, Array, Flags, Indices

PREFIX = "fenics_mortar_settling_"


class BodyCompliance:
    """Compliance of all bodies, with weak springs on floating bodies (collective).

    Args:
        bulk: The bodies; springs are added to their tangent, which has to be assembled.
        floating: The floating bodies.
    """

    def __init__(self, bulk: Bulk, floating: FloatingBodies) -> None:
        self._bulk = bulk
        springs = np.zeros(bulk.num_owned)
        motions, added = [np.zeros((0, bulk.num_owned))], [np.zeros(0)]
        for body in floating.bodies:
            mine = floating.labels[: bulk.space.num_nodes] == body.label
            dofs = bulk.space.owned_dofs[mine]
            each = EQUATIONS.spring * body.stiffest / body.num_nodes
            weak = RIGID.weakest_spring * body.stiffest / body.num_nodes
            springs[dofs] = each
            rigid = np.zeros((len(body.motions), bulk.num_owned))
            rigid[:, dofs.ravel()] = floating.motions(body)[1]
            products = bulk.comm.allreduce(rigid @ rigid.T)
            motions.append(np.linalg.solve(np.linalg.cholesky(products), rigid))
            added.append(np.full(len(rigid), 1.0 / weak - 1.0 / each))
        self._motions, self._added = np.concatenate(motions), np.concatenate(added)
        bulk.add_to_diagonal(springs)
        self._factors = factored_bulk(bulk, PREFIX)

    def displacements(self, forces: Array) -> Array:
        """Displacements [length] due to forces [stress length], both (owned dofs, k)."""
        bulk, found = self._bulk, []
        forces = np.where(bulk.prescribed[: bulk.num_owned, None], 0.0, forces)
        for group in column_groups(forces.shape[1]):
            sizes = (bulk.num_owned, None), (None, group.size)
            load = np.asfortranarray(forces[:, group]).ravel(order="F")
            loads = PETSc.Mat().createDense(sizes, array=load, comm=bulk.comm)
            loads.assemble()
            responses = loads.duplicate()
            self._factors.getFactorMatrix().matSolve(loads, responses)
            found.append(responses.getDenseArray().copy())
            loads.destroy()
            responses.destroy()
        along = bulk.comm.allreduce(self._motions @ forces)
        return np.concatenate(found, axis=1) + self._motions.T @ (self._added[:, None] * along)


class LinearizedContact:
    """The linearized contact problem at the present state; all methods are collective.

    Args:
        bulk: The bodies; tangent and residual are assembled.
        floating: The floating bodies.
        system: The linear system, which numbers the multipliers.
        motions: The rigid motions.
    """

    def __init__(
        self, bulk: Bulk, floating: FloatingBodies, system: LinearSystem, motions: DrivenMotions
    ) -> None:
        self._bulk, self._system, self._obstacles = bulk, system, motions
        self._floating = floating
        self._contacts = [c for c in system.contacts if isinstance(c, Contact)]

    @property
    def applies(self) -> bool:
        """Whether some but few nodes may touch and all laws are Coulomb's or frictionless.

        If bodies float, one law has to have friction: without friction a round body on facets may
        have no equilibrium nearby, and with the sets of the linearized problem it would roll on.
        The compliance of the bodies does not include driven motions of remote loads. In space the
        friction cone is no polyhedron.
        """
        if any(contact.slave.dim == 3 for contact in self._contacts):
            return False
        if self._obstacles.driven[len(self._obstacles.obstacles) :].any():
            return False
        touching = [_may_touch(contact) for contact in self._contacts]
        tied = [c.active for c in self._system.contacts if not isinstance(c, Contact)]
        if not any(nodes.any() for nodes in touching):
            return False
        if sum(int(nodes.sum()) for nodes in [*touching, *tied]) > EQUATIONS.max_touching:
            return False
        laws = [contact.pair.law for contact in self._contacts]
        if self._floating.bodies and not any(law.has_friction for law in laws):
            return False
        pressure = self._typical_pressure()
        return all(
            isinstance(law, Coulomb | Frictionless)
            and not (law.has_adhesion or law.has_closing_gap)
            for law in laws
        ) and not any(contact.now.strength(pressure)[1].any() for contact in self._contacts)

    def choose_sets(self, mark: Callable[[], None], *, snap: bool = False) -> bool:
        """Solve the linearized problem; adopt its active sets, branches and multipliers.

        Args:
            mark: Function that marks redundant sticks of the present sets, see ``redundancy``. The
                problem is solved again with elastic stick at these nodes until no further stick is
                redundant.
            snap: Whether a solution beyond a turning point of the load path may be used.

        Returns:
            Whether there is a solution, equal on all ranks.
        """
        problem, nodes = self._problem()
        marked = -1
        while marked < (marked := sum(int(c.redundant.sum()) for c in self._contacts)):
            elastic = self._with_elastic_sticks(problem, nodes)
            comm = self._bulk.comm
            found = comm.bcast(self._solve(elastic, nodes, snap) if comm.rank == 0 else None)
            if found is None:
                return False
            self._adopt(nodes, found)
            mark()
        return True

    def _solve(self, problem: FrictionProblem, nodes: Sequence[Indices], snap: bool) -> Sets | None:
        """The solution at the end of the path from the accepted state (local).

        Any solution if bodies float, since they are moved rigidly before a solve, or if ``snap``.
        """
        if self._floating.bodies:
            return solve_friction(problem)
        found = follow_loads(problem, *self._accepted(problem.slope, nodes))
        if isinstance(found, Sets):
            return found
        return solve_friction(problem) if snap else None

    def describe_turning_point(self) -> str:
        """Describe the turning point of the path from the accepted state; "" if none."""
        problem, nodes = self._problem()
        problem, comm = self._with_elastic_sticks(problem, nodes), self._bulk.comm
        start = self._accepted(problem.slope, nodes)
        found = comm.bcast(follow_loads(problem, *start) if comm.rank == 0 else None)
        if not isinstance(found, TurningPoint) or found.node < 0:
            return ""
        contacts = np.repeat(np.arange(len(nodes)), [j.size for j in nodes])
        contact = self._contacts[contacts[found.node]]
        where = errors.format_point(contact.operators.x[np.concatenate(nodes)[found.node]])
        return (
            f"the path of equilibria, linearized at the last one, has a turning point where the "
            f"node at {where} of '{contact.pair.slave_name}' opens, closes, sticks or slides: it "
            f"continues only with decreasing loads"
        )

    def _accepted(self, slope: Array, nodes: Sequence[Indices]) -> tuple[Sets, Array]:
        """Sets, scaled multipliers and gaps of ``nodes`` at the accepted state (local)."""
        parts, stiffest = [], max(float(contact.stiffness.max()) for contact in self._contacts)
        for contact, j in zip(self._contacts, nodes, strict=True):
            last, o = contact.partners, contact.operators
            multipliers = (
                np.stack([last.pressure, last.shear])[:, j] / self._system.scale(contact)[j, 0]
            )
            gap = (
                np.clip(last.gap, 0.0, contact.slave.nodal_lengths)[j] * o.weight[j] / o.diagonal[j]
            )
            parts.append([*multipliers, gap * contact.stiffness[j] / stiffest])
        z_n, z_tau, gap = np.concatenate(parts, axis=1)
        slides = np.abs(z_tau) >= (1.0 - SOLVED) * slope * z_n
        branch = np.where(slides, np.sign(z_tau), 0.0).astype(np.int64)
        return Sets(z_n > 0.0, branch, z_n, z_tau), gap

    def _adopt(self, nodes: Sequence[Indices], found: Sets) -> None:
        """Adopt sets and multipliers of ``nodes``; all other nodes are open."""
        ends = np.cumsum([j.size for j in nodes])[:-1]
        for contact, j, *sets in zip(
            self._contacts, nodes, *(np.split(column, ends) for column in found), strict=True
        ):
            active, branch, z_n, z_tau = sets
            o, j = contact.operators, j[active]
            all_active, z, branches = (
                np.zeros_like(contact.active),
                np.zeros_like(contact.z),
                contact.branch,
            )
            all_active[j] = True
            force = z_n[active, None] * o.n[j] + z_tau[active, None] * o.tau[j]
            z[j] = self._system.scale(contact)[j] * force
            if contact.pair.law.has_friction:
                branches = branches.copy()
                branches[j] = branch[active]
            contact.change(active=all_active, z=z, branch=branches)

    def _with_elastic_sticks(
        self, problem: FrictionProblem, nodes: Sequence[Indices]
    ) -> FrictionProblem:
        """The problem with elastic redundant sticks, see ``redundancy`` (local)."""
        V, q, n = problem.V.copy(), problem.q.copy(), problem.slope.size
        parts = []
        for contact, j in zip(self._contacts, nodes, strict=True):
            row = contact.stiffness[j] * _slip_weight(contact, j) / ELASTIC
            shear = (contact.partners.shear / self._system.scale(contact)[:, 0])[j]
            parts.append(np.stack([row, shear]) * contact.redundant[j])
        elastic, shear = np.concatenate(parts, axis=1)
        elastic = elastic / max(float(contact.stiffness.max()) for contact in self._contacts)
        V[np.arange(n, 2 * n), np.arange(n, 2 * n)] -= elastic
        q[n:] += elastic * shear
        return problem._replace(V=V, q=q)

    def _problem(self) -> tuple[FrictionProblem, list[Indices]]:
        """The linearized problem of all nodes that may touch, and these nodes of each contact."""
        kept = [contact.state for contact in self._contacts]
        for contact in self._contacts:
            contact.change(
                active=_may_touch(contact),
                branch=np.full_like(contact.branch, STICK),
                redundant=np.zeros_like(contact.redundant),
            )
        nodes = [contact.active_nodes for contact in self._contacts]
        try:
            return self._problem_of(nodes), nodes
        finally:
            for contact, state in zip(self._contacts, kept, strict=True):
                contact.put(state)

    def _problem_of(self, nodes: Sequence[Indices]) -> FrictionProblem:
        """The problem of ``nodes``, which must be active and sticking at present."""
        E, ties = self._directions(nodes), self._tied()
        A = np.concatenate([E, ties])
        used = np.flatnonzero(A.any(axis=0))
        V, y = self._gaps(used)
        A = A[:, used]
        V, y = A @ V @ A.T, A @ y
        if len(ties):
            c, t = slice(0, len(E)), slice(len(E), None)
            change = np.linalg.solve(V[t, t], np.column_stack([V[t, c], y[t]]))
            V, y = V[c, c] - V[c, t] @ change[:, :-1], y[c] - V[c, t] @ change[:, -1]
        slopes, rows = [], []
        pressure = self._typical_pressure()
        for contact, j in zip(self._contacts, nodes, strict=True):
            slopes.append(contact.now.strength(pressure)[0][j])
            rows.append(_slip_weight(contact, j))
        # Weights of the rows of slip that make the compliance symmetric.
        weight = np.concatenate([np.ones(len(E) // 2), *rows])
        weight /= max(float(contact.stiffness.max()) for contact in self._contacts)
        return FrictionProblem(weight[:, None] * V, weight * y, np.concatenate(slopes))

    def _typical_pressure(self) -> float:
        """Mean pressure of loaded nodes, or a small value if no node is loaded [stress]."""
        borne = np.concatenate([np.abs(c.pressure[c.z.any(axis=1)]) for c in self._contacts])
        soft = min(float(contact.modulus.min()) for contact in self._contacts)
        smallest = EQUATIONS.spring * RIGID.weakest_spring * soft
        return max(float(borne.mean()) if borne.size else 0.0, smallest)

    def _gaps(self, used: Indices) -> tuple[Array, Array]:
        """V and y of gaps and slips y + V zeta of multiplier components, replicated.

        Args:
            used: Numbers of the components; all others are zero.

        Returns:
            V, shape (used, used) [stress], and y, shape (used,) [stress length].
        """
        system, bulk, comm = self._system, self._bulk, self._bulk.comm
        pair_rows = [contact.rows.linearized() for contact in system.contacts]
        size = system.num_z_dofs
        B_T = BlockMatrix(comm, bulk.num_owned, size).assemble(system.force_blocks())
        C = BlockMatrix(comm, size, bulk.num_owned).assemble(system.law_blocks(pair_rows))
        compliance = BodyCompliance(bulk, self._floating)
        moved, force = bulk.K.createVecs()
        moved.array[bulk.prescribed_dofs] = bulk.distance_to_prescribed()
        bulk.K.mult(moved, force)
        rest = -(force.array_r + bulk.r.array_r[: bulk.num_owned])
        forces = _columns(B_T, used)
        responses = compliance.displacements(np.column_stack([forces, rest]))
        responses[:, -1] += moved.array_r
        rows = comm.allreduce(_columns(C.transpose(), used).T @ responses)
        rhs = np.zeros(system.all_z_dofs)
        for own, z_dofs in zip(pair_rows, system.z_dofs, strict=True):
            rhs[z_dofs] = own.rhs
        V, y = -rows[:, :-1], rows[:, -1] - rhs[used]
        self._free_obstacles(V, y, used)
        for matrix in (B_T, C, moved, force):
            matrix.destroy()
        return V, y

    def _free_obstacles(self, V: Array, y: Array, used: Indices) -> None:
        """Add the compliance of driven obstacles on weak springs to ``V`` and ``y`` (in place)."""
        motions, system = self._obstacles, self._system
        driven = motions.driven_obstacles
        if not driven.any():
            return
        weak = RIGID.weakest_spring * max(
            float(contact.stiffness.max()) for contact in self._contacts
        )
        by_motion = np.zeros((*driven.shape, system.all_z_dofs))
        by_pressure = np.zeros_like(by_motion)
        for contact, columns in system.numbered():
            if not isinstance(contact, Contact) or contact.obstacle is None:
                continue
            number = motions.obstacles.index(contact.obstacle)
            rows, (_, M_q, _) = (
                contact.rows.by_motions(),
                contact.on_obstacle.motion_force_derivatives(contact.z),
            )
            by_motion[number][:, columns] = np.moveaxis(rows, 2, 0)
            by_pressure[number][:, columns] = M_q * system.scale(contact)
        by_motion = by_motion[driven][:, used] / weak
        V -= by_motion.T @ by_pressure[driven][:, used]
        balance = motions.obstacle_forces() - motions.residual()[: len(driven)]
        y += balance[driven] @ by_motion

    def _directions(self, nodes: Sequence[Indices]) -> Array:
        """Normals, then tangents of the nodes as rows over all multiplier components (local)."""
        size, found = self._system.all_z_dofs, []
        places = dict(zip(map(id, self._system.contacts), self._system.z_dofs, strict=True))
        for kind in ("n", "tau"):
            for contact, j in zip(self._contacts, nodes, strict=True):
                rows = np.zeros((j.size, size))
                columns = places[id(contact)][j]
                rows[np.arange(j.size)[:, None], columns] = getattr(contact.operators, kind)[j]
                found.append(rows)
        return np.concatenate(found)

    def _tied(self) -> Array:
        """Multiplier components of ties as rows over all components (local)."""
        system = self._system
        columns = [
            z_dofs[contact.components.acts]
            for contact, z_dofs in system.numbered()
            if not isinstance(contact, Contact)
        ]
        columns = np.concatenate([np.empty(0, np.int64), *map(np.ravel, columns)])
        return np.eye(system.all_z_dofs)[columns]


def _may_touch(contact: Contact) -> Flags:
    """Active nodes and nodes with a gap below their nodal length, (slave nodes,), bool."""
    gap = np.where(contact.covered, np.nan_to_num(contact.gap), np.inf)
    pressed = contact.covered & (contact.partners.pressure > 0.0)
    touches = contact.active | pressed | (gap <= contact.slave.nodal_lengths)
    return touches & ~contact.set_aside


def _columns(matrix: PETSc.Mat, used: Indices) -> Array:
    """Owned rows and the ascending columns ``used`` of a matrix as a dense array (local)."""
    starts, columns, values = matrix.getValuesCSR()
    rows = np.repeat(np.arange(starts.size - 1), np.diff(starts))
    index = np.full(matrix.getSize()[1], -1)
    index[used] = np.arange(used.size)
    kept = index[columns] >= 0
    dense = np.zeros((starts.size - 1, used.size))
    dense[rows[kept], index[columns[kept]]] = values[kept]
    return dense


def _slip_weight(contact: Contact, j: Indices) -> Array:
    """Weights of rows of slip that make the compliance symmetric, (nodes,) [1]."""
    o = contact.operators
    return (contact.slave.nodal_areas * o.weight)[j] / o.diagonal[j] ** 2
