# SPDX-License-Identifier: MIT
"""Two curves facing each other, and their mortar integrals without mesh or PETSc."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from closed_form import BOTH, integrate_facet
from derivatives import complex_step

from fenics_mortar.interface.integrals import find_segments, integrate_segments
from fenics_mortar.kernels import projection
from fenics_mortar.kernels.facets import DUAL

LIMITS = (0.1, 1e-10)


@dataclass
class Curves:
    """Slave nodes from left to right (body above), master nodes from right to left."""

    x: np.ndarray
    m: np.ndarray
    basis: int = DUAL
    weighting: int = projection.OPPOSITE
    points: int = 5
    left: np.ndarray | None = None
    gap_weights: int = 0  # BY_BASIS
    radius: float = 10.0
    integration: str = "segments"
    thickness: tuple | None = None  # at the slave nodes, and its derivative by x
    coupled = False  # whether all segments of a facet are paired

    def __post_init__(self):
        count = len(self.x)
        self.slave = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
        self.master = np.stack([np.arange(len(self.m) - 1), np.arange(1, len(self.m))], axis=1)
        self.previous = np.arange(count) - 1
        self.following = np.append(np.arange(1, count), -1)
        if self.left is None:
            self.left = np.full(count - 1, BOTH)
        n, _ = self.normals(self.x)
        self.find(n)

    @property
    def weights(self):
        """H of each facet: hand-over of multiplier functions."""
        of_left = np.array([np.eye(2), [[1, 1], [0, 0]], [[0, 0], [1, 1]]])
        return of_left[self.left]

    def find(self, n):
        """Find the segments as in a problem."""
        moves = self.coupled or (self.thickness is not None and self.thickness[1] != 0.0)
        slave = SimpleNamespace(facets=self.slave, functions_move=moves, roles=None)
        options = SimpleNamespace(
            radius=self.radius, min_cosine=LIMITS[0], integration=self.integration,
            points=self.points,
        )  # fmt: skip
        self.segments = s = find_segments(
            slave, SimpleNamespace(facets=self.master), self.x, n, self.m,
            np.arange(len(self.slave)), options,
        )  # fmt: skip
        self.offsets, self.pair_offsets, self.partial = s.offsets, s.pair_offsets, s.partial
        self.ends, self.nodes, self.pairs = s.ends, (s.slave, s.master), s.pairs
        self.masters = np.searchsorted(self.master[:, 0], s.master[:, 0])

    def normals(self, x):
        n, dn = np.empty_like(x), np.zeros((len(x), 2, 6), x.dtype)
        inner = np.zeros(len(x), bool)
        projection.tabulate_normals(x, self.previous, self.following, inner, self.weighting, n, dn)
        return n, dn

    def columns(self, i):
        """Columns in (x, m) of the 12 derivatives of segment ``i``; -1 is missing."""
        (a, b), (c, d) = self.nodes[0][i], self.nodes[1][i]
        nodes = [self.previous[a], a, b, self.following[b], c + len(self.x), d + len(self.x)]
        return np.ravel([(2 * k, 2 * k + 1) if k >= 0 else (-1, -1) for k in nodes])

    def evaluate(self, positions):
        """D, M, weighted gap and cover, and the derivatives, at ``positions`` = (x, m) stacked.

        The kinds of segment ends are fixed; complex positions yield complex values.
        """
        x, m = positions[: len(self.x)], positions[len(self.x) :]
        n, dn = self.normals(x)
        values = integrate_segments(
            self.segments, self.slave, (x, n, dn, m), self.weights,
            (self.basis, self.gap_weights, True), self.thickness,
        )  # fmt: skip
        return dict(zip(("D", "dD", "M", "dM", "g", "dg", "cover"), values))

    def exact(self, positions):
        """D, M, weighted gap and cover in closed form."""
        x, m = positions[: len(self.x)], positions[len(self.x) :]
        (n, _), s = self.normals(x), self.segments
        D, M, g, cover = (np.zeros((len(self.slave), 2, 2), x.dtype), [], [], [])
        for e, nodes in enumerate(self.slave):
            own = [
                (
                    np.concatenate([x[nodes], n[nodes], m[s.master[i]]]).ravel(),
                    s.end_is_fixed[i], s.ends[i],
                    s.points[slice(*s.spans[i])], s.weights[slice(*s.spans[i])],
                )
                for i in range(self.offsets[e], self.offsets[e + 1])
            ]  # fmt: skip
            g.append(np.zeros(2, x.dtype))
            cover.append(np.zeros(2, x.dtype))
            if own:
                kinds = self.basis, self.gap_weights
                D[e], more, g[e], cover[e] = integrate_facet(kinds, self.left[e], own)
                M += more
        return {"D": D, "M": np.reshape(M, (-1, 2, 2)), "g": np.array(g), "cover": np.array(cover)}

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

    def exact_derivatives(self, evaluate=None):
        """Derivatives of ``evaluate`` by complex steps."""
        evaluate = evaluate or self.evaluate
        values = evaluate(self.positions)
        exact = complex_step(
            lambda moved: np.concatenate(
                [evaluate(moved)[name].ravel() for name in ("D", "M", "g")]
            ),
            self.positions,
        )
        cuts = np.cumsum([values[name].size for name in ("D", "M")])
        return {
            name: part.reshape(*values[name].shape, self.positions.size)
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
    """Curves with ``degree`` + 1 nodes per facet."""

    degree: int = 2
    drop: int | None = None
    share: bool = False  # whether the function of a node inside a facet is handed over to both ends
    coupled = True
    weights = None

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
        projection.tabulate_normals(x, self.previous, self.following, inner, self.weighting, n, dn)
        return n, dn

    def columns(self, i):
        """Columns in (x, m) of the derivatives of segment ``i``; -1 is missing."""
        k, slave = self.degree, self.nodes[0][i]
        near = np.arange(slave[0] - k, slave[-1] + k + 1)
        near[(near < 0) | (near >= len(self.x))] = -1
        nodes = [*near, *(self.nodes[1][i] + len(self.x))]
        return np.ravel([(2 * j, 2 * j + 1) if j >= 0 else (-1, -1) for j in nodes])


def with_inner_nodes(x, seed, bulge=0.1):
    """Nodes of quadratic facets: one near the middle between two nodes of ``x``."""
    rng = np.random.default_rng(seed)
    length = np.linalg.norm(np.diff(x, axis=0), axis=1)[:, None]
    nodes = np.empty((2 * len(x) - 1, 2))
    nodes[::2] = x
    nodes[1::2] = (x[:-1] + x[1:]) / 2 + bulge * length * rng.uniform(-1, 1, (len(x) - 1, 2))
    return nodes


def wavy_curved(seed, bulge=0.1, **options):
    """Two wavy curves of quadratic facets."""
    return tuple(with_inner_nodes(x, seed + k, bulge) for k, x in enumerate(wavy(seed, **options)))
