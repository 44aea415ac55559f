# SPDX-License-Identifier: MIT
"""Contact between sides of rigid bodies: points, normals and tributary lengths."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from demos.studies.stability.random_bodies import Array

# Segments touch if their distance over their length, and the sine of their angle, are below these.
NEAR, PARALLEL = 1e-6, 1e-6
# Covered fraction of a node's length [1] below which it carries no force.
COVERED = 0.05


def touching_lines(one: Array, other: Array) -> list[tuple[Array, float]]:
    """Points where two chains of segments touch, and the tributary length of each.

    Args:
        one: Shape (k, 2) [length].
        other: Shape (m, 2).
    """
    found = []
    for ends, length in touching_segments(one, other):
        found += [(x, 0.5 * length) for x in ends]
    return merged(found)


def touching_segments(one: Array, other: Array) -> list[tuple[Array, float]]:
    """Parts of a chain in contact with another one: ends (2, 2), along the first, and lengths."""
    found = []
    for a, b in itertools.pairwise(one):
        length = float(np.linalg.norm(b - a))
        e = (b - a) / length
        for c, d in itertools.pairwise(other):
            chord = d - c
            if abs(e[0] * chord[1] - e[1] * chord[0]) > PARALLEL * np.linalg.norm(chord):
                continue
            away = c - a
            if abs(e[0] * away[1] - e[1] * away[0]) > NEAR * length:
                continue
            ends = sorted(((c - a) @ e, (d - a) @ e))
            left, right = max(ends[0], 0.0), min(ends[1], length)
            if right - left > NEAR * length:
                found.append((np.array([a + left * e, a + right * e]), right - left))
    return found


def touching_nodes(one: Array, other: Array) -> list[tuple[Array, float]]:
    """Nodes of a chain covered by another one, and the covered length of each.

    These are the points at which forces of a mesh act: a force between an edge and the nearest node
    needs finer facets. Hardly covered nodes are left out, see ``COVERED``.
    """
    lengths = np.linalg.norm(np.diff(one, axis=0), axis=1)
    covered = np.zeros(len(one))
    for k, length in enumerate(lengths):
        for ends, part in touching_segments(one[k : k + 2], other):
            middle = np.linalg.norm(ends.mean(axis=0) - one[k]) / length
            covered[k : k + 2] += part * np.array([1.0 - middle, middle])
    whole = 0.5 * (np.r_[lengths, 0.0] + np.r_[0.0, lengths])
    return [(x, c) for x, c, most in zip(one, covered, whole, strict=True) if c > COVERED * most]


def touching_plane(line: Array, point: Array, normal: Array) -> list[tuple[Array, float]]:
    """Nodes of a chain on a plane, and the tributary length of each."""
    lengths = np.linalg.norm(np.diff(line, axis=0), axis=1)
    near = np.abs((line - point) @ normal) < NEAR * lengths.max()
    flat = 0.5 * lengths * (near[1:] & near[:-1])
    share = np.r_[flat, 0.0] + np.r_[0.0, flat]
    return merged([(x, s) for x, s, on in zip(line, share, near) if on])


def merged(found: Sequence[tuple[Array, float]]) -> list[tuple[Array, float]]:
    """Points with duplicates merged."""
    whole: dict[tuple[float, ...], tuple[Array, float]] = {}
    size = max((float(np.abs(x).max()) for x, _ in found), default=1.0) or 1.0
    for x, share in found:
        key = tuple(np.round(x / size, 9) + 0.0)
        whole[key] = (x, share + whole.get(key, (x, 0.0))[1])
    return list(whole.values())


def normal_of(line: Array, x: Array) -> Array:
    """Normal to the right of the segment of a chain that is nearest to a point."""
    a, e = line[:-1], np.diff(line, axis=0)
    s = np.clip(((x - a) * e).sum(axis=1) / (e**2).sum(axis=1), 0.0, 1.0)
    nearest = np.linalg.norm(x - a - s[:, None] * e, axis=1).argmin()
    n = np.array([e[nearest, 1], -e[nearest, 0]])
    return n / np.linalg.norm(n)
