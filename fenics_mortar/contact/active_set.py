# SPDX-License-Identifier: MIT
"""Active set and branches of the contact law, from the complementarity function.

Not every slave node carries a multiplier. A node with prescribed components whose normal is
approximately along the free ones lies on a symmetry plane; its normal is set to its part along
these. Oblique normals are unchanged. A node prescribed along its normal, or in both components,
carries no multiplier. Neither does the tip of a crack, a node of both faces: its gap is zero.

The multiplier function of a hardly covered node is added to that of a neighbour. The nodal force
w_j z_j does not vanish with the weight w_j; z_j would therefore grow without bound as the cover
vanishes. Row scaling keeps the linear systems regular, but z_j would still be large and the active
set unstable. An edge pressed by 2 % and slid past 2.5 slave nodes in 40 steps
(block on block, mean pressure 1.4):

==========================  ==========  ================  ================
41 load steps               friction    handed over       never
==========================  ==========  ================  ================
iterations                  0           129, at most 4    134, at most 6
largest nodal pressure      0           9.6               671
iterations                  0.3         132, at most 5    156, at most 12
largest nodal pressure      0.3         24                5e4
steps without solution      0.3         0                 2
==========================  ==========  ================  ================

Total forces agree to 0.6 %. A gradual transfer, s Phi_j to the node and (1 - s) Phi_j to its
neighbour, has no effect: for s > 0 the functions span the original space.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.contact.law import KINK, STICK, Branches
from fenics_mortar.interface.surfaces import MIN_SHARE
from fenics_mortar.kernels import complementarity
from fenics_mortar.kernels.complementarity import choose
from fenics_mortar.utils.arrays import LAST_DIGITS, Array, Flags, Indices


def next_sets(f: ContactFields, *, start: bool) -> tuple[ContactFields, int]:
    """Active set and branches by the complementarity function (local).

    Nodes in ``state.force_decided`` take the multipliers of their forces, open nodes those of the
    law. Nodes of idle bodies are open.

    Args:
        f: Fields of the present state.
        start: Whether this precedes the first solve, with unknown pressures: touching nodes become
            active, and multipliers that are nan after a failed solve become zero.

    Returns:
        Fields of the new state, and the number of changed nodes.
    """
    before, state, o = f.state, f.state, f.operators
    z = state.z
    if start and not np.isfinite(z).all():
        z = np.where(np.isfinite(z), z, 0.0)
    if state.force_decided is not None:
        presses, force = state.force_decided
        presses = presses & f.covered
        z = np.where(presses[:, None], force / np.where(presses, o.weight, 1.0)[:, None], z)
    if z is not state.z:
        f = f.after(state.replaced(z=z, force_decided=None))
    may_close = f.covered & ~f.interface.set_aside
    law, active, new = f.interface.pair.law, np.empty(len(o.n), bool), np.empty(o.n.shape)
    resets, moves = complementarity.update_sets(
        f.covered_gap, may_close, f.z_n, f.state.z, o.n, f.adhesion[0], f.attracted,
        bool(law.bridges_gap), float(state.c_n), f.interface.modulus, f.interface.foundation,
        f.nodal_lengths, KINK if start else -np.inf, o.x, LAST_DIGITS, before.active, active, new,
    )  # fmt: skip
    changes = {"active": active} if resets else {}
    if changes or moves:
        f = f.after(f.state.replaced(z=new, **changes))
    branch = f.interface.law_calls.branch(law, f.nodal, before.branch, o.x)
    if o.n.shape[1] == 3 and law.has_friction:
        branch, heading = stick_where_turning_back(f, branch, before.heading, start=start)
        f = f.after(f.state.replaced(heading=heading))
    branched = branch != before.branch
    if branched.any():
        f = f.after(f.state.replaced(branch=branch))
    elif not resets:
        return f, 0
    ruled = f.acts if law.bridges_gap else active
    changed = (active != before.active) | (ruled & f.interface.follows_law & branched)
    return f, int(np.count_nonzero(changed))


# Number of times that a node may turn back in a solve before it sticks first. The first time may be
# that of a load that is reversed, which needs no iteration with stick.
MAX_TURNS_BACK = 1


def stick_where_turning_back(
    f: Any, branch: Branches, before: tuple[Array, Array] | None, *, start: bool
) -> tuple[Branches, tuple[Array, Array]]:
    """Branches of nodes in space, with stick for one iteration where sliding turns back (local).

    A node that slides in the direction e with w . e < 0 in the next iterate slides in the opposite
    direction then. With weights c_t (k / l) of the slip that exceed the stiffness of the node, as
    that of corners of facets with nine nodes, it jumps over stick each time, and turns back for
    ever. In the plane the two directions are branches of their own, and cycles of them are found.

    Args:
        f: Fields in space.
        branch: Branches of the law, shape (slave nodes,), int.
        before: ``InterfaceState.heading`` of the last iterate.
        start: Whether this precedes the first iteration.

    Returns:
        Branches, shape (slave nodes,), and the new heading [1].
    """
    slides = f.acts & (branch != STICK) & (f.directions.size > 0.0)
    count = np.zeros(branch.size) if start or before is None else before[1]
    if not start and before is not None:
        back = slides & (np.einsum("ja,ja->j", f.directions.along, before[0]) < 0.0)
        count = count + back
        stuck = back & (count > MAX_TURNS_BACK)
        branch, slides = np.where(stuck, STICK, branch), slides & ~stuck
    return branch, (np.where(slides[:, None], f.directions.along, 0.0), count)


# Cosine of the angle between the normal of a slave node with one prescribed component and the free
# component [1]. Above the first value (20 degrees) the node is on a symmetry plane; below the
# second one it is prescribed along its normal.
PLANE_COSINE, OBLIQUE_COSINE = 0.94, 0.1
# Largest number of changes of a node in one solve. The cover may depend on whether the node carries
# a multiplier; without the limit the iteration might not end.
MAX_CHANGES = 4
# Distance of the cover from MIN_SHARE, over MIN_SHARE [1], within which a node is undecided: the
# cover changes by about this much with the multiplier.
UNDECIDED = 0.1


def normals_on_planes(normals: Array, free: Array) -> Array:
    """Normals of nodes on symmetry planes, nan elsewhere, shape (nodes, dim) [1].

    Args:
        normals: Normals of the undeformed surface, shape (nodes, dim).
        free: 1 where a component of a node is not prescribed, else 0, shape (nodes, dim).
    """
    inside = _cosines(normals, free)
    on_plane = _is_partly_prescribed(free) & (inside > PLANE_COSINE)
    if normals.shape[1] == 2:
        return np.where(on_plane[:, None], np.sign(normals) * free, np.nan)
    scale = np.where(on_plane, inside, 1.0)[:, None]
    return np.where(on_plane[:, None], normals * free / scale, np.nan)


def _is_partly_prescribed(free: Array) -> Flags:
    """Whether some components of a node are prescribed, and others are not, (nodes,)."""
    count = free.sum(axis=1)
    return (count > 0.0) & (count < free.shape[1])


def _cosines(normals: Array, free: Array) -> Array:
    """Lengths of the parts of normals along the free components, (nodes,) [1]."""
    return np.asarray(np.sqrt(((normals * free) ** 2).sum(axis=1)))


class MultiplierNodes:
    """Slave nodes that may carry multipliers, and those that do; equal on all ranks.

    Args:
        slave: The slave surface.
        normals: Normals of the undeformed surface, shape (slave nodes, dim).
        free: 1 where a component of a slave node is not prescribed, else 0, (slave nodes, dim).
        at_vertices: Whether nodes inside facets have no multipliers.

    Attributes:
        possible: Whether a node carries a multiplier if it is covered, shape (slave nodes,), bool.
        oblique: Whether a node's prescribed components are neither along nor across its normal,
            shape (slave nodes,), bool.
        plane_normals: Normals on symmetry planes, nan elsewhere, shape (slave nodes, dim).
    """

    def __init__(self, slave: Any, normals: Array, free: Array, *, at_vertices: bool) -> None:
        self.plane_normals = normals_on_planes(normals, free)
        on_plane, partly = np.isfinite(self.plane_normals[:, 0]), _is_partly_prescribed(free)
        self.oblique = partly & ~on_plane & (_cosines(normals, free) > OBLIQUE_COSINE)
        self.possible = free.all(axis=1) | on_plane | self.oblique
        if at_vertices:
            self.possible &= ~slave.inner
        # Between two neighbours on a curve both have to be strong; in space the edge of the cover
        # runs along the neighbours, and one is enough.
        self._all_strong = slave.dim == 2
        if slave.dim == 2:
            step = slave.degree if at_vertices else 1
            neighbours = slave.along(np.arange(slave.num_nodes), range(-step, step + 1, 2 * step))
        else:
            neighbours = slave.neighbours
        self._neighbours: Indices = np.ascontiguousarray(neighbours.T)
        self._changes: Indices = np.zeros(slave.num_nodes, np.int64)

    def begin(self) -> None:
        """Reset the counts of changes."""
        self._changes[:] = 0

    def update(
        self, multiplier_nodes: npt.NDArray[np.bool_], cover: Array
    ) -> tuple[npt.NDArray[np.bool_], int]:
        """New multiplier nodes, shape (slave nodes,), bool, and number of changed nodes (local).

        Args:
            multiplier_nodes: Present multiplier nodes, shape (slave nodes,), bool.
            cover: Covered fraction of each node, shape (slave nodes,) [1].
        """
        new, _, changed = self._choose(cover, multiplier_nodes)
        if changed:
            self._changes += new != multiplier_nodes
        return new, changed

    def undecided(self, cover: Array, active: npt.NDArray[np.bool_]) -> Indices:
        """Nodes next to active ones whose cover is close to ``MIN_SHARE`` (local).

        Their cover depends on whether they carry a multiplier; there may be two solutions.

        Args:
            cover: Covered fraction of each node, shape (slave nodes,) [1].
            active: Active set, shape (slave nodes,), bool.

        Returns:
            Numbers of the nodes, shape (k,).
        """
        _, helped, _ = self._choose(cover, active)
        near = helped & (np.abs(cover - MIN_SHARE) < UNDECIDED * MIN_SHARE)
        beside = ((self._neighbours >= 0) & active[self._neighbours]).any(axis=0)
        return np.flatnonzero(near & beside)

    def _choose(
        self, cover: Array, present: npt.NDArray[np.bool_]
    ) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_], int]:
        """New multiplier nodes, nodes whose function can be handed over, number of changes."""
        new, helped = np.empty((2, cover.size), bool)
        changed = choose(
            cover, self.possible, self._neighbours, MIN_SHARE, present, self._changes, MAX_CHANGES,
            self._all_strong, new, helped,
        )  # fmt: skip
        return new, helped, changed
