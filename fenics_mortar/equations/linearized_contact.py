# SPDX-License-Identifier: MIT
"""Active sets from the linearized contact problem, and sticks that are redundant in active sets.

``LinearizedContact`` finds sets for Newton's method where its own do not settle. ``Redundancy``
marks redundant sticks of the present sets, in each iteration and for the linearized problem.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np
from scipy.sparse import csr_array

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import ELASTIC
from fenics_mortar.contact.law import STICK, Coulomb, Frictionless
from fenics_mortar.contact.rows import strength
from fenics_mortar.equations.arguments import EQUATIONS
from fenics_mortar.la.solver import column_groups, factored_bulk
from fenics_mortar.la.sparse import BlockMatrix
from fenics_mortar.obstacles.rigid_motion import RIGID
from fenics_mortar.rigid.complementarity import (
    FrictionProblem,
    Sets,
    TurningPoint,
    follow_loads,
    solve_friction,
)
from fenics_mortar.utils import compat, errors
from fenics_mortar.utils.arrays import SAME_PLACE, SOLVED, Array, Flags, Indices

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.rigid.floating import FloatingBodies

PREFIX = "fenics_mortar_settling_"


def displacements(bulk: Bulk, floating: FloatingBodies, forces: Array) -> Array:
    """Displacements [length] of all bodies due to forces [stress length], both (owned dofs, k).

    The compliance of a floating body is that of the elastic body on springs, corrected by a
    low-rank term that weakens the springs on its rigid motions. Without this correction, with weak
    springs in the stiffness, the stiffness of a body that is unstable under its loads, such as an
    inverted pendulum, would not be positive definite. The springs are added to the assembled
    tangent (collective).
    """
    springs = np.zeros(bulk.num_owned)
    motions, added = [np.zeros((0, bulk.num_owned))], [np.zeros(0)]
    for body in floating.bodies:
        rates = body.nodal_motions()
        each = EQUATIONS.spring * body.stiffest / body.num_nodes
        weak = RIGID.weakest_spring * body.stiffest / body.num_nodes
        springs[body.dofs] = each
        rigid = np.zeros((len(rates), bulk.num_owned))
        rigid[:, body.dofs.ravel()] = rates
        motions.append(np.linalg.solve(body.factor(rates), rigid))
        added.append(np.full(len(rigid), 1.0 / weak - 1.0 / each))
    bulk.add_to_diagonal(springs)
    factors = factored_bulk(bulk, PREFIX).getFactorMatrix()
    forces, found = np.where(bulk.prescribed[: bulk.num_owned, None], 0.0, forces), []
    for group in column_groups(forces.shape[1]):
        sizes = (bulk.num_owned, None), (None, group.size)
        load = np.asfortranarray(forces[:, group]).ravel(order="F")
        loads = PETSc.Mat().createDense(sizes, array=load, comm=bulk.comm)
        loads.assemble()
        responses = loads.duplicate()
        factors.matSolve(loads, responses)
        found.append(responses.getDenseArray().copy())
        loads.destroy()
        responses.destroy()
    V = np.concatenate(motions)
    along = np.concatenate(added)[:, None] * bulk.comm.allreduce(V @ forces)
    return np.concatenate(found, axis=1) + V.T @ along


class LinearizedContact:
    """The linearized contact problem at the present state; all methods are collective.

    Stiff bodies supported by contact alone undergo only small elastic displacements if the active
    set is correct. With another set some bodies are loose, and a Newton step moves them far. An
    active-set iteration updates all nodes at once; it may cycle for a wall, or turn an arch into a
    mechanism. This class solves the linearized problem together with its inequalities, reduced to
    the multipliers by the compliance of all bodies, see ``rigid.complementarity``. The next Newton
    step uses the active set and branches of this solution. With friction the solution may not be
    unique. If no body floats, it is the one at the end of the load path from the accepted state. If
    nodes only open and close, a solution beyond a turning point of this path may be used, at the
    end of a snap-through.

    The compliance, see ``displacements``, needs one linear solve for each multiplier component of
    all nodes that may touch. It is therefore computed only if the active set does not converge.

    Args:
        equations: The ``ContactEquations``; tangent and residual of the bodies are assembled.
    """

    def __init__(self, equations: Any) -> None:
        self._bulk, self._system = equations.bulk, equations.system
        self._obstacles, self._floating = equations.motions, equations.floating
        self._numbered = [(c, z) for c, z in self._system.numbered() if isinstance(c, Contact)]
        self._contacts = self._floating.contacts
        self._stiffest = max((float(c.stiffness.max()) for c in self._contacts), default=0.0)

    @property
    def applies(self) -> bool:
        """Whether some but few nodes may touch and all laws are Coulomb's or frictionless.

        If bodies float, one law has to have friction: without friction a round body on facets may
        have no equilibrium nearby, and with the sets of the linearized problem it would roll on.
        The compliance of the bodies does not include driven motions of remote loads. In space the
        friction cone is no polyhedron.
        """
        driven_loads = self._obstacles.driven[len(self._obstacles.obstacles) :]
        if self._bulk.space.dim == 3 or driven_loads.any():
            return False
        touching = [_may_touch(contact) for contact in self._contacts]
        tied = [c.active for c in self._system.contacts if not isinstance(c, Contact)]
        count = sum(int(nodes.sum()) for nodes in touching)
        count_tied = sum(int(nodes.sum()) for nodes in tied)
        if not 0 < count <= EQUATIONS.max_touching - count_tied:
            return False
        laws = [contact.pair.law for contact in self._contacts]
        if self._floating.bodies and not any(law.has_friction for law in laws):
            return False
        pressure = self._typical_pressure()
        return all(
            isinstance(law, Coulomb | Frictionless)
            and not (law.has_adhesion or law.has_closing_gap)
            for law in laws
        ) and not any(strength(contact.now, pressure)[1].any() for contact in self._contacts)

    def choose_sets(self, mark: Callable[[], None], *, snap: bool = False) -> bool:
        """Solve the linearized problem; adopt its active sets, branches and multipliers.

        Args:
            mark: Function that marks redundant sticks of the present sets, see ``Redundancy``. The
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
        places = zip(self._contacts, nodes, strict=True)
        contact, node = [(c, j) for c, mine in places for j in mine][found.node]
        where = errors.format_point(contact.operators.x[node])
        return (
            f"the path of equilibria, linearized at the last one, has a turning point where the "
            f"node at {where} of '{contact.pair.slave_name}' opens, closes, sticks or slides: it "
            f"continues only with decreasing loads"
        )

    def _accepted(self, slope: Array, nodes: Sequence[Indices]) -> tuple[Sets, Array]:
        """Sets, scaled multipliers and gaps of ``nodes`` at the accepted state (local)."""
        parts = []
        for contact, j in zip(self._contacts, nodes, strict=True):
            last, o, scale = contact.partners, contact.operators, contact.components.scale[j, 0]
            gap = np.clip(last.gap, 0.0, contact.slave.nodal_lengths)[j]
            gap = gap * o.weight[j] / o.diagonal[j] * contact.stiffness[j] / self._stiffest
            parts.append([*np.stack([last.pressure, last.shear])[:, j] / scale, gap])
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
            o, j, branches = contact.operators, j[active], contact.branch
            all_active, z = np.zeros_like(contact.active), np.zeros_like(contact.z)
            all_active[j] = True
            force = z_n[active, None] * o.n[j] + z_tau[active, None] * o.tau[j]
            z[j] = contact.components.scale[j] * force
            if contact.pair.law.has_friction:
                branches = branches.copy()
                branches[j] = branch[active]
            contact.change(active=all_active, z=z, branch=branches)

    def _with_elastic_sticks(
        self, problem: FrictionProblem, nodes: Sequence[Indices]
    ) -> FrictionProblem:
        """The problem with elastic redundant sticks, see ``Redundancy`` (local)."""
        V, q, n = problem.V.copy(), problem.q.copy(), problem.slope.size
        parts = []
        for contact, j in zip(self._contacts, nodes, strict=True):
            row = contact.stiffness[j] * _slip_weight(contact, j) / ELASTIC / self._stiffest
            shear = (contact.partners.shear / contact.components.scale[:, 0])[j]
            parts.append(np.stack([row, shear]) * contact.redundant[j])
        elastic, shear = np.concatenate(parts, axis=1)
        V[np.arange(n, 2 * n), np.arange(n, 2 * n)] -= elastic
        q[n:] += elastic * shear
        return problem._replace(V=V, q=q)

    def _problem(self) -> tuple[FrictionProblem, list[Indices]]:
        """The linearized problem of all nodes that may touch, and these nodes of each contact."""
        kept = [contact.state for contact in self._contacts]
        for contact in self._contacts:
            stick, none = np.full_like(contact.branch, STICK), np.zeros_like(contact.redundant)
            contact.change(active=_may_touch(contact), branch=stick, redundant=none)
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
        (V, y), A = self._gaps(used), A[:, used]
        V, y = A @ V @ A.T, A @ y
        if len(ties):
            c, t = slice(0, len(E)), slice(len(E), None)
            change = np.linalg.solve(V[t, t], np.column_stack([V[t, c], y[t]]))
            V, y = V[c, c] - V[c, t] @ change[:, :-1], y[c] - V[c, t] @ change[:, -1]
        slopes, rows = [], []
        pressure = self._typical_pressure()
        for contact, j in zip(self._contacts, nodes, strict=True):
            slopes.append(strength(contact.now, pressure)[0][j])
            rows.append(_slip_weight(contact, j))
        # Weights of the rows of slip that make the compliance symmetric.
        weight = np.concatenate([np.ones(len(E) // 2), *rows]) / self._stiffest
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
        moved = np.zeros(bulk.num_owned)
        moved[bulk.prescribed_dofs] = bulk.distance_to_prescribed()
        rest = -(compat.products(bulk.K, moved[None])[0] + bulk.r.array_r[: bulk.num_owned])
        forces = _columns(B_T, used)
        responses = displacements(bulk, self._floating, np.column_stack([forces, rest]))
        responses[:, -1] += moved
        rows = comm.allreduce(_columns(C.transpose(), used).T @ responses)
        rhs = np.zeros(system.all_z_dofs)
        for own, z_dofs in zip(pair_rows, system.z_dofs, strict=True):
            rhs[z_dofs] = own.rhs
        V, y = -rows[:, :-1], rows[:, -1] - rhs[used]
        self._free_obstacles(V, y, used)
        B_T.destroy()
        C.destroy()
        return V, y

    def _free_obstacles(self, V: Array, y: Array, used: Indices) -> None:
        """Add the compliance of driven obstacles on weak springs to ``V`` and ``y`` (in place)."""
        motions, system = self._obstacles, self._system
        driven = motions.driven_obstacles
        if not driven.any():
            return
        by_motion = np.zeros((*driven.shape, system.all_z_dofs))
        by_pressure = np.zeros_like(by_motion)
        for contact, columns in self._numbered:
            if contact.obstacle is None:
                continue
            _, M_q, _ = contact.operators.motion_force_derivatives(contact.z)
            rows, forces = (motions.of_obstacle(contact, a) for a in (by_motion, by_pressure))
            rows[:, columns] = np.moveaxis(contact.rows.by_motions(), 2, 0)
            forces[:, columns] = M_q * contact.components.scale
        by_motion = by_motion[driven][:, used] / (RIGID.weakest_spring * self._stiffest)
        V -= by_motion.T @ by_pressure[driven][:, used]
        balance = motions.obstacle_forces() - motions.residual()[: len(driven)]
        y += balance[driven] @ by_motion

    def _directions(self, nodes: Sequence[Indices]) -> Array:
        """Normals, then tangents of the nodes as rows over all multiplier components (local)."""
        found = []
        for kind in ("n", "tau"):
            for (contact, z_dofs), j in zip(self._numbered, nodes, strict=True):
                rows = np.zeros((j.size, self._system.all_z_dofs))
                np.put_along_axis(rows, z_dofs[j], getattr(contact.operators, kind)[j], axis=1)
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
    size = matrix.getLocalSize()[0], matrix.getSize()[1]
    dense: Array = csr_array(matrix.getValuesCSR()[::-1], shape=size)[:, used].toarray()
    return dense


def _slip_weight(contact: Contact, j: Indices) -> Array:
    """Weights of rows of slip that make the compliance symmetric, (nodes,) [1]."""
    o = contact.operators
    return (contact.slave.nodal_areas * o.weight)[j] / o.diagonal[j] ** 2


# Norm of the remainder of a normalized row after projection [1] below which the row is dependent.
# The remainder of a redundant row is of the order of the strains of the step.
DEPENDENT = 0.1


class Redundancy:
    """Search for redundant sticks of all pairs; replicated, all methods are local.

    A closed gap and stick are one constraint each. If several pairs share nodes, stick constraints
    may depend on other constraints. Examples: the two closed gaps of a groove fix a node
    completely; a facet of body C across the joint of A and B keeps the corners of both on one line;
    where four blocks meet, two of the four sticks close a loop. The shear is then not unique, and
    the linear system is singular, or nearly singular if a gap opens by rounding.

    A redundant node sticks elastically with k = 1000 k_j,

        z_tau = z_tau,old + (k / l_j) u,      u: slip since the last accepted state,

    up to the friction limit. As long as the stick is redundant, u vanishes up to the curvature of
    the constraints, and the shear is constant: among all admissible shears it is the one nearest to
    the last. If the stick is no longer redundant, for example if one flank of a groove moves, u is
    a true slip, and the node soon slides.

    In space a node sticks along two tangents; it is redundant if one of both sticks is.

    Dependence is found from the rows (D_jk n, -M_jl n) and (D_jk tau, -M_jl tau) at the last
    accepted state. A row whose slave node belongs to no other pair cannot be part of a vanishing
    sum. Only rows of shared slave nodes are therefore compared, a few per corner. The curves of a
    surface that may touch itself count as pairs: at a junction of cracks, nodes belong to two of
    them.

    Args:
        interfaces: All pairs.
    """

    def __init__(self, interfaces: Sequence[Interface]) -> None:
        self._contacts = [c for c in interfaces if isinstance(c, Contact)]
        self._curves = [_curves(contact) for contact in self._contacts]
        # nodes that two curves share are nodes of both on a surface that may touch itself
        nodes = [
            c.slave.nodes if c.slave is c.master else np.unique(c.nodes) for c in self._contacts
        ]
        found, count = np.unique(np.concatenate([[], *nodes]), return_counts=True)
        self._shared = found[count > 1]

    def mark(self) -> None:
        """Mark the redundant sticks of the present active sets in the states of all contacts.

        The mark of a sticking node is kept: a joint closed up to rounding may open and close
        repeatedly, and this must not change the law at neighbouring nodes.
        """
        if not self._shared.size:
            return
        for contact in self._contacts:
            contact.change(redundant=contact.redundant & contact.sticking)
        sticks = [contact.slave.nodes[contact.sticking] for contact in self._contacts]
        if not np.isin(np.concatenate(sticks), self._shared).any():
            return
        parts = [_entries(contact) for contact in self._contacts]
        pair = np.repeat(np.arange(len(parts)), [part[0].size for part in parts])
        row, node, value, own = (np.concatenate(fields) for fields in zip(*parts, strict=True))
        dim = value.shape[1]
        curve = [of[part[0] // dim] for of, part in zip(self._curves, parts, strict=True)]
        kept = repeating(pair + len(parts) * np.concatenate(curve), row, node, own)
        if not kept.any():
            return
        pair, row, node, value = pair[kept], row[kept], node[kept], value[kept]
        rows, index = np.unique(
            np.stack([row % dim, pair, row // dim]), axis=1, return_inverse=True
        )
        nodes, column = np.unique(node, return_inverse=True)
        matrix = np.zeros((rows.shape[1], nodes.size, dim))
        np.add.at(matrix, (index.ravel(), column.ravel()), value)
        sticks, pair, slave_node = rows
        redundant = dependent(matrix.reshape(len(matrix), -1)) & (sticks > 0)
        for i in np.unique(pair[redundant]):
            marks = self._contacts[i].redundant.copy()
            marks[slave_node[redundant & (pair == i)]] = True
            self._contacts[i].change(redundant=marks)

    def begin(self) -> None:
        """Clear all marks."""
        for contact in self._contacts:
            contact.change(redundant=np.zeros(contact.slave.num_nodes, bool))


def _curves(contact: Contact) -> Indices:
    """Curve of each slave node of a surface that may touch itself, else 0, (slave nodes,)."""
    curves, roles = np.zeros(contact.slave.num_nodes, np.int64), contact.slave.roles
    if roles is not None:
        curves[contact.slave.facets] = roles.keys[:, 1:]
    return curves


def _entries(contact: Contact) -> tuple[Indices, Indices, Array, Flags]:
    """Normalized entries of D and M at the last accepted state, along the present n and tangents.

    Rows of active gaps and sticks; prescribed components are zero. Entries of nodes that are
    coupled only because positions differ by rounding are dropped.

    Returns:
        Number of the row, dim j for the gap of slave node j, the next ones for its sticks; global
        number of the node; coefficients of its components, shape (entries, dim) [1]; and whether
        the entry is of D, not of M.
    """
    o, partners, parts = contact.operators, contact.partners, []
    sticks = [(contact.sticking, tangent) for tangent in contact.now.tangents]
    for kind, (on, direction) in enumerate([(contact.active, o.n), *sticks]):
        for surface, matrix, free, sign in (
            (contact.slave, partners.D, contact.free, 1.0),
            (contact.master, partners.M, contact.master_free, -1.0),
        ):
            entries = csr_array(matrix).tocoo()
            mine = on[entries.row]
            j, k, c = entries.row[mine], entries.col[mine], sign * entries.data[mine]
            value = c[:, None] * direction[j] * free[k]
            row = o.n.shape[1] * j.astype(np.int64) + kind
            parts.append((row, surface.nodes[k], value, np.full(j.size, sign > 0.0)))
    row, node, value, own = (np.concatenate(fields) for fields in zip(*parts, strict=True))
    length = np.sqrt(np.bincount(row, (value**2).sum(axis=1)))[row]
    value = value / np.where(length > 0.0, length, 1.0)[:, None]
    couples = np.abs(value).max(axis=1) > SAME_PLACE
    return row[couples], node[couples], value[couples], own[couples]


def repeating(pair: Indices, row: Indices, node: Indices, own: Flags) -> Flags:
    """Entries of rows that may be part of a vanishing sum.

    Rows with a slave node that is in no row of another pair are removed, repeatedly.

    Args:
        pair: Number of the pair or curve of each entry, shape (entries,).
        row: Number of its row in the pair, shape (entries,).
        node: Number of its node, shape (entries,).
        own: Whether an entry is that of a slave node, shape (entries,), bool.

    Returns:
        Shape (entries,), bool.
    """
    kept = np.ones(row.size, bool)
    _, number = np.unique(np.stack([pair, row]), axis=1, return_inverse=True)
    number = number.ravel()
    while kept.any():
        couples = np.unique(np.stack([node[kept], pair[kept]]), axis=1)
        found, count = np.unique(couples[0], return_counts=True)
        alone = own & ~np.isin(node, found[count > 1])
        lost = np.bincount(number, alone & kept)[number] > 0
        if not (kept & lost).any():
            break
        kept &= ~lost
    return kept


def dependent(rows: Array) -> Flags:
    """Rows that depend linearly on preceding rows, up to ``DEPENDENT``, shape (rows,), bool.

    Args:
        rows: Normalized or zero rows, shape (rows, columns).
    """
    basis = np.empty((0, rows.shape[1]))
    found = np.zeros(len(rows), bool)
    for i, row in enumerate(rows):
        rest = row - basis.T @ (basis @ row)
        rest -= basis.T @ (basis @ rest)
        size = float(np.linalg.norm(rest))
        found[i] = size < DEPENDENT
        if not found[i]:
            basis = np.vstack([basis, rest / size])
    return found
