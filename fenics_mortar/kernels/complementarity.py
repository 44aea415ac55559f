# SPDX-License-Identifier: MIT
"""Nodal fields of a contact, its active set and its residual, node by node.

==========  ==========================================================================
symbol      meaning, at slave node j
==========  ==========================================================================
g, w        weighted gap and weight; the mean gap is g / w
D           diagonal entry of D
z_n, z_tau  normal and tangential part of the multiplier, with tau = (-n_y, n_x)
a           adhesion at the mean gap, zero without one
==========  ==========================================================================

Slave nodes that carry a multiplier, by their cover; see ``contact.rows``.
"""

from fenics_mortar.kernels import kernel


@kernel
def tabulate_gaps(g, w, diagonal, areas, carries, least, covered, mean):
    """Find the covered nodes and their mean gaps.

    Args:
        g: Weighted gaps, shape (n,) [length^2].
        w: Weights, shape (n,) [length].
        diagonal: Diagonal entries of D, shape (n,) [length].
        areas: Nodal areas, shape (n,) [length].
        carries: Whether a node carries a multiplier, shape (n,), bool.
        least: Smallest diagonal entry over the nodal area of a covered node [1].
        covered: Whether a node carries a multiplier and has a partner, (n,), bool; filled.
        mean: Mean gaps, zero at other nodes, shape (n,) [length]; filled.
    """
    for j in range(g.shape[0]):
        covered[j] = carries[j] and diagonal[j] > least * areas[j]
        mean[j] = g[j] / w[j] if covered[j] else 0.0


@kernel
def split_multipliers(n, z, z_n, z_tau):
    """Fill z_n and z_tau (n,) [stress] from normals and multipliers (n, 2)."""
    for j in range(z.shape[0]):
        z_n[j] = n[j, 0] * z[j, 0] + n[j, 1] * z[j, 1]
        z_tau[j] = n[j, 0] * z[j, 1] - n[j, 1] * z[j, 0]


@kernel
def update_sets(
    gap, covered, z_n, z, n, a, attracted, keeps_shear, c_n, modulus, foundation, lengths, touching,
    x, digits, before, active, new,
):  # fmt: skip
    """Update the active set, and the multipliers of open nodes by the law.

    Nodes with z_n + a > c_n (k / l) g are active; z_n + a = 0 at open nodes under adhesion. A node
    is unchanged if both terms are rounding, of the modulus k or of the largest coordinate.

    Args:
        gap: Gap that contact closes, zero at uncovered nodes, shape (n,) [length].
        covered: Whether a node carries a multiplier and has a partner, shape (n,), bool.
        z_n: Normal part of the multipliers, shape (n,) [stress].
        z: Multipliers, shape (n, 2) [stress].
        n: Normals, shape (n, 2).
        a: Adhesion, shape (n,) [stress].
        attracted: Open nodes under adhesion, shape (n,), bool.
        keeps_shear: Whether such nodes keep z_tau.
        c_n: Weight of the gap [1].
        modulus: Stiffness k of the bulk, shape (n,) [stress].
        foundation: k / l, shape (n,) [stress / length].
        lengths: Lengths l of the nodes, shape (n,) [length].
        touching: Gap over l up to which nodes are active in any case [1].
        x: Positions of the nodes, shape (n, 2) [length].
        digits: Rounding [1].
        before: Last active set, shape (n,), bool.
        active: Shape (n,), bool; filled.
        new: Multipliers: z of active nodes, else -a n and possibly the shear, (n, dim); filled.

    Returns:
        Whether the active set changes, and whether multipliers do.
    """
    largest, resets, moves = 0.0, False, False
    for j in range(x.shape[0]):
        for c in range(x.shape[1]):
            largest = max(largest, abs(x[j, c]))
    for j in range(gap.shape[0]):
        push = 0.0 if attracted[j] else z_n[j] + a[j]
        closes = push - c_n * foundation[j] * gap[j] > 0.0
        if abs(push) <= digits * modulus[j] and abs(gap[j]) <= digits * largest:
            closes = before[j]
        active[j] = covered[j] and (closes or gap[j] <= touching * lengths[j])
        resets = resets or active[j] != before[j]
        for c in range(z.shape[1]):
            shear = 0.0
            if attracted[j] and keeps_shear:
                shear = z[j, c] - z_n[j] * n[j, c]
            new[j, c] = z[j, c] if active[j] else shear - a[j] * n[j, c]
            moves = moves or new[j, c] != z[j, c]
    return resets, moves


@kernel
def measure_rows(gap, lengths, stiffness, diagonal, opening, tangential, active, attracted):
    """Measure the normal and tangential rows of a contact as forces.

    The rows are k g of active nodes, D (z_n + a) of open nodes under adhesion, and D rho of both.

    Args:
        gap: Gap that contact closes, shape (n,) [length].
        lengths: Lengths of the nodes, shape (n,) [length].
        stiffness: Stiffness k of the bulk, shape (n,) [stress].
        diagonal: Diagonal entries of D, shape (n,) [length].
        opening: z_n + a, shape (n,) [stress].
        tangential: Residual rho of the law, shape (n,) [stress].
        active: Active set, shape (n,), bool.
        attracted: Open nodes under adhesion, shape (n,), bool.

    Returns:
        Sum of the squares of all rows [stress^2 length^2], and the largest gap of an active node
        over its length [1].
    """
    squares = largest = 0.0
    for j in range(gap.shape[0]):
        if active[j]:
            squares += (stiffness[j] * gap[j]) ** 2
            largest = max(largest, abs(gap[j]) / lengths[j])
        elif attracted[j]:
            squares += (diagonal[j] * opening[j]) ** 2
        if active[j] or attracted[j]:
            squares += (diagonal[j] * tangential[j]) ** 2
    return squares, largest


@kernel
def choose(cover, possible, neighbours, share, present, changes, most, all_strong, new,
           helped):  # fmt: skip
    """Choose the multiplier nodes; return the number of changed nodes.

    Args:
        cover: Covered fraction of each node, shape (n,) [1].
        possible: Whether a node may carry a multiplier, shape (n,), bool.
        neighbours: Those of each node along the surface, -1 for none, shape (s, n).
        share: Cover below which a node hands its function to a neighbour [1].
        present: Present multiplier nodes, shape (n,), bool.
        changes: Number of changes of each node so far, shape (n,).
        most: Number of changes after which a node stays as it is.
        all_strong: Whether all neighbours of a node that hands its function over need a large or no
            cover.
        new: Shape (n,), bool; filled.
        helped: Whether the function of a node can be handed to a neighbour: the cover of one is
            larger by ``share`` than that of the node, or twice ``share``, and the others also or
            are not covered; shape (n,), bool; filled.
    """
    count = 0
    for j in range(cover.shape[0]):
        found, safe = False, True
        for side in range(neighbours.shape[0]):
            k = neighbours[side, j]
            if k >= 0:
                is_strong = possible[k] and cover[k] > share + min(cover[j], share)
                found = found or is_strong
                safe = safe and (is_strong or cover[k] == 0.0 or not all_strong)
        helped[j] = found and safe
        wanted = possible[j] and not (helped[j] and cover[j] < share)
        new[j] = wanted if changes[j] < most else present[j]
        if new[j] != present[j]:
            count += 1
    return count
