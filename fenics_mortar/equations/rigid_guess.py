# SPDX-License-Identifier: MIT
"""Initial guess of bodies whose prescribed values turn: the whole body turns with them.

Newton's method starts from the last state, where only prescribed nodes are elsewhere. If these turn
by more than some degrees, as the hub of an arm, the cells beside them are distorted so much that
the iteration may fail. A body that follows rigidly has the stresses and the contact pressures that
it had before, turned.
"""

from __future__ import annotations

import numpy as np

from fenics_mortar.equations.general import ContactEquations
from fenics_mortar.obstacles.rotations import polar_rotation
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.ranks import sum_over_ranks

# Rotation of prescribed nodes [radian], 6 degrees, below which bodies do not follow them: Newton's
# method needs few iterations then.
TURNED = 0.1
# Distance of prescribed nodes from a rigid motion over their motion [1], below which they move
# rigidly: a stretch of 5 % beside a quarter of a turn.
STRETCHED = 0.05
# Extent of prescribed nodes, in space across a line, over their distance from the origin [1], below
# which they do not tell a rotation.
SLENDER = 1e-6

# Rigid motion: a point, its position after the motion [length], and the rotation (d, d) [1].
Motion = tuple[Array, Array, Array]


def turns_of_prescribed(e: ContactEquations) -> dict[int, Motion]:
    """Rigid motions of prescribed nodes to their values, of the bodies that turn (collective)."""
    bulk, dofs = e.bulk, e.bulk.space.owned_dofs
    values = bulk.values.copy()
    compat.set_prescribed(values, bulk.bcs)
    led = bulk.prescribed[dofs].all(axis=1)
    x, change = bulk.positions()[: len(dofs)], (values - bulk.values)[dofs]
    of_bodies = e.floating.labels[: len(dofs)][led], e.floating.num_bodies
    sums = sum_over_ranks(e.comm, _sums(x[led], (x + change)[led], *of_bodies))
    motions = map(_motion, sums)
    return {body: motion for body, motion in enumerate(motions) if motion is not None}


def turn(e: ContactEquations, motions: dict[int, Motion]) -> None:
    """Move bodies along with their prescribed nodes (local).

    Multipliers of slave nodes turn with their bodies; slip is counted from the accepted state.

    Args:
        e: The equations at the start of the motions; displacements and multipliers are changed.
        motions: Rigid motions by body.
    """
    bulk, dofs, x = e.bulk, e.bulk.space.dofs, e.bulk.positions()
    values = bulk.values.copy()
    compat.set_prescribed(values, bulk.bcs)
    for body, (start, end, R) in motions.items():
        mine = e.floating.labels == body
        at, moved = dofs[mine], end + (x[mine] - start) @ R.T - x[mine]
        bulk.values[at] = np.where(bulk.prescribed[at], values[at], bulk.values[at] + moved)
    for contact in e.contacts:
        z, bodies = contact.z.copy(), e.floating.labels_of(contact.slave)
        for body, (_, _, R) in motions.items():
            z[bodies == body] = z[bodies == body] @ R.T
        contact.change(z=z)


def _sums(x0: Array, x1: Array, bodies: Indices, count: int) -> Array:
    """Sums over nodes (n,) of each body: 1, x0, x1, x1 x0, x0^2 + x1^2, shape (count, k)."""
    n, d = x0.shape
    products = np.einsum("na,nb->nab", x1, x0).reshape(n, d * d)
    squares = (x0**2 + x1**2).sum(axis=1)[:, None]
    rows = np.hstack([np.ones((n, 1)), x0, x1, products, squares])
    found = np.zeros((count, rows.shape[1]))
    np.add.at(found, bodies, rows)
    return found


def _motion(sums: Array) -> Motion | None:
    """Rigid motion of a body that turns, from its row of ``_sums``; else ``None`` (local)."""
    d = {10: 2, 17: 3}[sums.size]
    if not sums[0]:
        return None
    start, end, products = np.split(sums[1:-1] / sums[0], [d, 2 * d])
    A = products.reshape(d, d) - np.outer(end, start)
    sizes = np.linalg.svd(A, compute_uv=False)
    if sizes[d - 2] <= SLENDER * np.sqrt(sums[-1] / sums[0]) * np.sqrt(sizes[0]):
        return None  # one point; in space points on a line
    R = polar_rotation(A)
    chord = float(np.linalg.norm(R - np.eye(d))) / np.sqrt(2.0)  # 2 sin(a / 2)
    moved = chord**2 * float(sizes.sum())
    apart = float(sums[-1] / sums[0] - start @ start - end @ end - 2.0 * (R * A).sum())
    return (start, end, R) if chord > TURNED and apart <= STRETCHED**2 * moved else None
