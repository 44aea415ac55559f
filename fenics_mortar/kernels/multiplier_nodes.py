# SPDX-License-Identifier: MIT
"""Slave nodes that carry a multiplier, by their cover; see ``contact.multiplier_nodes``."""

from fenics_mortar.kernels import kernel


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
        helped: Whether the function of a node can be handed to a neighbour: one has twice the cover
            ``share``, and the others also or are not covered; shape (n,), bool; filled.
    """
    count = 0
    for j in range(cover.shape[0]):
        found, safe = False, True
        for side in range(neighbours.shape[0]):
            k = neighbours[side, j]
            if k >= 0:
                is_strong = possible[k] and cover[k] > 2.0 * share
                found = found or is_strong
                safe = safe and (is_strong or cover[k] == 0.0 or not all_strong)
        helped[j] = found and safe
        wanted = possible[j] and not (helped[j] and cover[j] < share)
        new[j] = wanted if changes[j] < most else present[j]
        if new[j] != present[j]:
            count += 1
    return count
