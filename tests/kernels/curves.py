# SPDX-License-Identifier: MIT
"""Two curves facing each other, and the mortar integrals of them without mesh or PETSc."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from derivatives import complex_step

from fenics_mortar.interface.segments import find_segments
from fenics_mortar.kernels import basis, curved, normals, segment

LIMITS = (0.1, 1e-10)


@dataclass
class Curves:
    """Slave nodes from left to right (body above), master nodes from right to left."""

    x: np.ndarray
    m: np.ndarray
    basis: int = basis.DUAL
    weighting: int = normals.OPPOSITE
    points: int = 5
    left: np.ndarray | None = None
    gap_weights: int = 0  # BY_BASIS
    radius: float = 10.0
    integration: str = "segments"
    coupled = False  # whether all segments of a facet make pairs

    def __post_init__(self):
        count = len(self.x)
        self.slave = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
        self.master = np.stack([np.arange(len(self.m) - 1), np.arange(1, len(self.m))], axis=1)
        self.previous = np.arange(count) - 1
        self.following = np.append(np.arange(1, count), -1)
        if self.left is None:
            self.left = np.full(count - 1, basis.BOTH)
        n, _ = self.normals(self.x)
        self.find(n)

    def find(self, n):
        """Find the segments as a problem does."""
        slave = SimpleNamespace(facets=self.slave, degree=2 if self.coupled else 1)
        self.segments = s = find_segments(
            slave, SimpleNamespace(facets=self.master), self.x, n, self.m,
            facets=np.arange(len(self.slave)), radius=self.radius, least_cosine=LIMITS[0],
            integration=self.integration, points=self.points,
        )  # fmt: skip
        self.offsets, self.pair_offsets, self.partial = s.offsets, s.pair_offsets, s.partial
        self.ends, self.nodes, self.pairs = s.ends, (s.slave, s.master), s.pairs
        self.masters = np.searchsorted(self.master[:, 0], s.master[:, 0])

    def normals(self, x):
        n, dn = np.empty_like(x), np.zeros((len(x), 2, 6), x.dtype)
        inner = np.zeros(len(x), bool)
        normals.tabulate_normals(x, self.previous, self.following, inner, self.weighting, n, dn)
        return n, dn

    def columns(self, i):
        """Columns in (x, m) of the 12 derivatives of segment ``i``; -1 is missing."""
        (a, b), (c, d) = self.nodes[0][i], self.nodes[1][i]
        nodes = [self.previous[a], a, b, self.following[b], c + len(self.x), d + len(self.x)]
        return np.ravel([(2 * k, 2 * k + 1) if k >= 0 else (-1, -1) for k in nodes])

    def evaluate(self, positions):
        """D, M, weighted gap and cover, and the derivatives, at ``positions`` = (x, m) stacked.

        The segments keep the kind of their ends; complex positions give complex values.
        """
        kind = positions.dtype
        x, m = positions[: len(self.x)], positions[len(self.x) :]
        n, dn = self.normals(x)
        count, facets = len(self.masters), len(self.slave)

        def empty(*shape):
            return np.zeros(shape, kind)

        s = self.segments
        ends, dends, *moments = (
            s.ends.astype(kind), empty(count, 2, 12), empty(count, 2, 2),
            empty(count, 2, 2, 12), empty(count, 2), empty(count, 2, 12),
        )  # fmt: skip
        segment.tabulate_segments(
            (x, n, dn, m), self.nodes, s.end_is_fixed, s.rule, True, ends, dends, *moments
        )
        moments = ends, dends, s.spread, *moments
        D, dD = empty(facets, 2, 2), empty(count, 2, 2, 12)
        M, dM = empty(count, 2, 2), empty(len(self.pairs), 2, 2, 12)
        g, dg, cover = empty(facets, 2), empty(count, 2, 12), empty(facets, 2)
        edges = x[self.slave[:, 1]] - x[self.slave[:, 0]]
        values = (D, dD, M, dM, g, dg, cover)
        own = (edges, self.left, self.partial)
        kinds = self.basis, self.gap_weights
        basis.tabulate_facets(own, *kinds, self.offsets, self.pair_offsets, moments, values)
        return {"D": D, "M": M, "g": g, "dD": dD, "dM": dM, "dg": dg, "cover": cover}

    def assemble(self, values):
        """Dense derivatives of D (f, K, K), M (n, K, K) and g (f, K) by all positions."""
        count = 2 * len(self.positions)
        facet = np.repeat(np.arange(len(self.slave)), np.diff(self.offsets))
        found = {name: np.zeros((*values[name].shape, count + 1)) for name in ("D", "M", "g")}
        for k in range(len(self.masters)):
            found["D"][facet[k]][..., self.columns(k)] += values["dD"][k]
            found["g"][facet[k]][..., self.columns(k)] += values["dg"][k]
        for p, (i, k) in enumerate(self.pairs):
            found["M"][i][..., self.columns(k)] += values["dM"][p]
        return {name: array[..., :-1] for name, array in found.items()}

    def exact_derivatives(self):
        """The same by complex steps."""
        values = self.evaluate(self.positions)
        exact = complex_step(
            lambda moved: np.concatenate(
                [self.evaluate(moved)[name].ravel() for name in ("D", "M", "g")]
            ),
            self.positions,
        )
        cuts = np.cumsum([values[name].size for name in ("D", "M")])
        return {
            name: part.reshape(*values[name].shape, -1)
            for name, part in zip(("D", "M", "g"), np.split(exact, cuts))
        }

    @property
    def positions(self):
        return np.concatenate([self.x, self.m])


def wavy(seed, slaves=5, masters=8, start=-0.05, stop=1.05):
    """Two wavy curves with uneven nodes; the master from ``stop`` to ``start``."""
    rng = np.random.default_rng(seed)

    def curve(first, last, count, depth):
        x = np.linspace(first, last, count)
        step = x[1] - x[0]
        x[1:-1] += 0.3 * step * rng.uniform(-1, 1, count - 2)
        y = depth + 0.05 * np.sin(4 * x) + 0.05 * step * rng.uniform(-1, 1, count)
        return np.stack([x, y], axis=1)

    return curve(0.0, 1.0, slaves, 0.0), curve(stop, start, masters, -0.02)


@dataclass
class CurvedCurves(Curves):
    """The same by the kernels for any number of nodes per facet, ``degree`` + 1."""

    degree: int = 2
    drop: int | None = None
    share: bool = False  # whether the node inside a facet hands its function to both ends
    coupled = True

    def __post_init__(self):
        k = self.degree
        self.slave, self.master = (
            k * np.arange((len(nodes) - 1) // k)[:, None] + np.arange(k + 1)
            for nodes in (self.x, self.m)
        )
        count = len(self.x)
        self.previous = np.arange(count) - 1
        self.following = np.append(np.arange(1, count), -1)
        n, _ = self.normals(self.x)
        self.find(n)
        self.weights = np.tile(np.eye(k + 1), (len(self.slave), 1, 1))
        if self.drop is not None:
            near = min(self.drop + 1, k) if self.drop < k else k - 1
            self.weights[:, :, self.drop] = np.eye(k + 1)[near]
        if self.share:
            self.weights[:, :, 1] = [0.5, 0.0, 0.5]

    def normals(self, x):
        n, dn = np.empty_like(x), np.zeros((len(x), 2, 4 * self.degree + 2), x.dtype)
        inner = np.arange(len(x)) % self.degree != 0
        normals.tabulate_normals(x, self.previous, self.following, inner, self.weighting, n, dn)
        return n, dn

    def columns(self, i):
        """Columns in (x, m) of the derivatives of segment ``i``; -1 is missing."""
        k, slave = self.degree, self.nodes[0][i]
        near = np.arange(slave[0] - k, slave[-1] + k + 1)
        near[(near < 0) | (near >= len(self.x))] = -1
        nodes = [*near, *(self.nodes[1][i] + len(self.x))]
        return np.ravel([(2 * j, 2 * j + 1) if j >= 0 else (-1, -1) for j in nodes])

    def evaluate(self, positions):
        """As for two nodes."""
        kind, size = positions.dtype, self.degree + 1
        x, m = positions[: len(self.x)], positions[len(self.x) :]
        n, dn = self.normals(x)
        count, facets, columns = len(self.masters), len(self.slave), 8 * size - 4

        def zeros(*shape):
            return np.zeros(shape, kind)

        values = (
            zeros(facets, size, size), zeros(count, size, size, columns),
            zeros(count, size, size), zeros(len(self.pairs), size, size, columns),
            zeros(facets, size), zeros(count, size, columns), zeros(facets, size),
        )  # fmt: skip
        curved.tabulate_facets(
            (x, n, dn, m),
            (self.slave, self.weights),
            (self.segments.master, self.segments.end_is_fixed, self.segments.ends),
            self.offsets,
            self.pair_offsets,
            self.segments.rule,
            (self.basis, self.gap_weights, True),
            values,
        )
        return dict(zip(("D", "dD", "M", "dM", "g", "dg", "cover"), values))


def with_inner_nodes(x, seed, bulge=0.1):
    """Nodes of quadratic facets: between two nodes of ``x`` one near the middle."""
    rng = np.random.default_rng(seed)
    length = np.linalg.norm(np.diff(x, axis=0), axis=1)[:, None]
    nodes = np.empty((2 * len(x) - 1, 2))
    nodes[::2] = x
    nodes[1::2] = (x[:-1] + x[1:]) / 2 + bulge * length * rng.uniform(-1, 1, (len(x) - 1, 2))
    return nodes


def wavy_curved(seed, bulge=0.1, **options):
    """Two wavy curves of quadratic facets."""
    return tuple(with_inner_nodes(x, seed + k, bulge) for k, x in enumerate(wavy(seed, **options)))
