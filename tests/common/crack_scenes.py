# SPDX-License-Identifier: MIT
"""Cracks: meshes cut along edges, and plates with the displacement of a crack in a plane."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from mpi4py import MPI

import numpy as np
from scenes import Scene, internal, linear_elastic

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.energies import lame
from fenics_mortar.interface.traces import extract_surface
from fenics_mortar.mesh.space import DisplacementSpace

COMM = MPI.COMM_WORLD
E, NU = 100.0, 0.3
MU, LMBDA = lame(E, NU)


@dataclass
class Cells:
    """Nodes (n, 2), cells with nodes counterclockwise (m, k), boundaries by name (f, 2)."""

    x: Any
    cells: Any
    boundaries: dict[str, Any] = field(default_factory=dict)

    def edges(self):
        """Every edge of every cell in its direction, the cell on the left: (m, k, 2)."""
        return np.stack([self.cells, np.roll(self.cells, -1, axis=1)], axis=2)

    def cut(self, **faces):
        """Cut along edges; names of the two sides of each run of edges, (nodes,) in order.

        ``faces``: by name of the left side of a run, (nodes of the run, name of the right side).
        Nodes are split into as many as the cut leaves separate fans of cells at them; the ends of
        runs inside the mesh have one fan and stay single.
        """
        along = {}
        for left, (run, right) in faces.items():
            for a, b in pairwise(run):
                along[int(a), int(b)], along[int(b), int(a)] = left, right
        edges = self.edges()
        fans = np.arange(self.cells.size).reshape(self.cells.shape)  # corners of cells
        corner_of = {
            (int(a), int(b)): (c, i)
            for c, of_cell in enumerate(edges) for i, (a, b) in enumerate(of_cell)
        }  # fmt: skip
        root = fans.ravel().copy()

        def top(i):
            while root[i] != i:
                i = root[i]
            return i

        size = self.cells.shape[1]
        for (a, b), (c, i) in corner_of.items():
            if (a, b) in along or (b, a) not in corner_of:
                continue
            d, k = corner_of[b, a]
            for one, other in (
                (fans[c, i], fans[d, (k + 1) % size]),
                (fans[c, (i + 1) % size], fans[d, k]),
            ):
                root[top(one)] = top(other)
        tops = np.array([top(i) for i in range(root.size)])
        old = self.cells.ravel()
        _, first, inverse = np.unique(tops, return_index=True, return_inverse=True)
        cells = inverse.reshape(self.cells.shape)
        boundaries = {name: [] for name in (*self.boundaries, *along.values())}
        outer = {
            frozenset(map(int, pair)): name
            for name, pairs in self.boundaries.items() for pair in pairs
        }  # fmt: skip
        for (a, b), (c, i) in corner_of.items():
            name = along.get((a, b)) or outer.get(frozenset((a, b)))
            if name:
                boundaries[name].append((cells[c, i], cells[c, (i + 1) % size]))
        return Cells(
            self.x[old[first]], cells, {name: np.array(f) for name, f in boundaries.items()}
        )

    def data(self, order=1):
        """The mesh; order 2 adds middles of edges."""
        none = (None, None, {}, {})
        if COMM.rank:
            return fm.mesh_from_arrays(*none)
        x, cells = self.x, self.cells
        if order == 2:
            x, cells = _second_order(self)
        return fm.mesh_from_arrays(x, cells, {"plate": np.arange(len(cells))}, self.boundaries)


def _second_order(mesh):
    edges = np.sort(mesh.edges().reshape(-1, 2), axis=1)
    pairs, inverse = np.unique(edges, axis=0, return_inverse=True)
    middles = len(mesh.x) + inverse.reshape(mesh.cells.shape)
    parts = [mesh.x, mesh.x[pairs].mean(axis=1)]
    columns = [mesh.cells, middles]
    if mesh.cells.shape[1] == 4:
        columns.append(len(mesh.x) + len(pairs) + np.arange(len(mesh.cells))[:, None])
        parts.append(mesh.x[mesh.cells].mean(axis=1))
    return np.concatenate(parts), np.concatenate(columns, axis=1)


def grid(xs, ys, cell="quadrilateral"):
    """Grid with lines at ``xs`` and ``ys``; its four sides are named ``rim``."""
    X, Y = np.meshgrid(xs, ys)
    x = np.stack([X.ravel(), Y.ravel()], axis=1)
    nx, ny = len(xs) - 1, len(ys) - 1
    number = np.arange((nx + 1) * (ny + 1)).reshape(ny + 1, nx + 1)
    corners = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    a, b, c, d = (part.ravel() for part in corners)
    cells = np.stack([a, b, c, d], axis=1)
    rim = np.concatenate([
        np.stack([line[:-1], line[1:]], axis=1)
        for line in (number[0], number[-1], number[:, 0], number[:, -1])
    ])  # fmt: skip
    if cell == "triangle":  # with diagonals in both directions, round a node in the middle
        middle = len(x) + np.arange(len(cells))
        x = np.concatenate([x, x[cells].mean(axis=1)])
        cells = np.concatenate([
            np.stack([p, q, middle], axis=1) for p, q in ((a, b), (b, c), (c, d), (d, a))
        ])  # fmt: skip
    return Cells(x, cells, {"rim": rim})


def line_of(mesh, *points):
    """Numbers of the nodes on a straight line through ``points`` in order along it."""
    a, b = np.array(points[0]), np.array(points[-1])
    along = (mesh.x - a) @ (b - a) / np.sum((b - a) ** 2)
    off = np.abs((mesh.x - a) @ np.array([a[1] - b[1], b[0] - a[0]]))
    on = np.flatnonzero((off < 1e-9) & (along > -1e-9) & (along < 1 + 1e-9))
    return on[np.argsort(along[on])]


def lines(*stops, count, ratio=1.0):
    """Grid lines between stops, each part with ``count`` cells, finer by ``ratio`` at the stops."""
    s = np.linspace(-1.0, 1.0, count + 1)
    s = 0.5 + 0.5 * np.sign(s) * (1 - (1 - np.abs(s)) ** ratio)
    parts = [a + (b - a) * s[:-1] for a, b in pairwise(stops)]
    return np.append(np.concatenate(parts), stops[-1])


def slit(count=8, width=2.0, cell="quadrilateral", ratio=1.5):
    """Plate with a crack of half-length 1 on the x axis, faces ``upper`` and ``lower``."""
    stops = np.array([-width, -1.0, 1.0, width])
    parts = zip(stops[:-1], stops[1:], (count // 2, count, count // 2), strict=True)
    xs = np.unique(np.concatenate([lines(a, b, count=n, ratio=ratio) for a, b, n in parts]))
    ys = lines(-width, 0.0, width, count=count, ratio=ratio)
    mesh = grid(xs, ys, cell)
    run = line_of(mesh, (-1.0, 0.0), (1.0, 0.0))
    return mesh.cut(upper=(run, "lower"))


def around_crack(x, y, stress, mu_f=0.0):
    """Displacement (2, ...) of a plane with a crack |x| < 1, y = 0, far-field (sxx, syy, sxy).

    Plane strain. The crack is open for syy > 0 and closed with friction ``mu_f`` for syy < 0.
    """
    sxx, syy, sxy = stress
    kappa = 3.0 - 4.0 * NU
    szz = NU * (sxx + syy)
    exx, eyy = (s - NU * (sxx + syy + szz - s) for s in (sxx, syy))
    u = np.stack([exx * x / E + sxy / (2 * MU) * y, eyy * y / E + sxy / (2 * MU) * x])
    opening = max(syy, 0.0)
    shear = sxy if syy > 0 else np.sign(sxy) * max(abs(sxy) + mu_f * syy, 0.0)
    z = x + 1j * y
    root = np.sqrt(z - 1) * np.sqrt(z + 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        Z, W = z / root - 1.0, root - z
        Z = np.where(np.isfinite(Z), Z, 0.0)
    one = np.stack([(kappa - 1) / 2 * W.real - y * Z.imag, (kappa + 1) / 2 * W.imag - y * Z.real])
    two = np.stack([(kappa + 1) / 2 * W.imag + y * Z.real, -(kappa - 1) / 2 * W.real - y * Z.imag])
    return u + (opening * one + shear * two) / (2 * MU)


def jump_of_crack(stress):
    """Relative displacement at the centre of a crack by a stress that its faces do not carry."""
    return 4 * (1 - NU**2) / E * stress


def turned(mesh, angle):
    """The mesh, turned counterclockwise."""
    c, s = np.cos(angle), np.sin(angle)
    return Cells(mesh.x @ np.array([[c, s], [-s, c]]), mesh.cells, mesh.boundaries)


def branched(n=8, cell="triangle", by="face"):
    """Square with three cracks that meet in the middle.

    Names by face: ``a1`` and ``a2``, ... on the left and right of each crack, seen from the middle;
    by part: ``w1``, ``w2``, ``w3`` round the middle.
    """
    mesh = grid(np.linspace(-1.0, 1.0, n + 1), np.linspace(-1.0, 1.0, n + 1), cell)
    a, b, c = (line_of(mesh, (0.0, 0.0), end) for end in ((-0.5, 0.0), (0.5, 0.5), (0.5, -0.5)))
    if by == "face":
        return mesh.cut(a1=(a, "a2"), b1=(b, "b2"), c1=(c, "c2"))
    return mesh.cut(w3=(a, "w1"), w1=(b, "w2"), w2=(c, "w3"))


def crossed(arms, n=8, cell="quadrilateral"):
    """Square with cracks from the middle along the axes, ``arms``: some of "left right down up".

    Names: ``left1`` and ``left2``, ... on the left and right of each crack, seen from the middle.
    """
    ends = {"left": (-0.5, 0.0), "right": (0.5, 0.0), "down": (0.0, -0.5), "up": (0.0, 0.5)}
    mesh = grid(np.linspace(-1.0, 1.0, n + 1), np.linspace(-1.0, 1.0, n + 1), cell)
    runs = {arm: line_of(mesh, (0.0, 0.0), ends[arm]) for arm in arms.split()}
    return mesh.cut(**{f"{arm}1": (run, f"{arm}2") for arm, run in runs.items()})


def edge_crack(n=8, cell="quadrilateral"):
    """Square with a crack from the left side to the middle; left and right side are free."""
    left = lines(-1.0, 0.0, count=n // 2, ratio=1.5)
    xs = np.concatenate([left[:-1], lines(0.0, 1.0, count=n, ratio=1.5)])
    mesh = grid(xs, lines(-1.0, 0.0, 1.0, count=n, ratio=1.5), cell)
    of_side = mesh.x[mesh.boundaries["rim"]].mean(axis=1)
    mesh.boundaries["rim"] = mesh.boundaries["rim"][np.abs(of_side[:, 1]) > 1.0 - 1e-9]
    return mesh.cut(upper=(line_of(mesh, (-1.0, 0.0), (0.0, 0.0)), "lower"))


def two(*names, law=None, **options):
    """Pairs of the two faces of each crack."""
    names = names or (("upper", "lower"),)
    return lambda data: [fm.ContactPair(data, *sides, law=law, **options) for sides in names]


def one(*names, law=None, **options):
    """One surface of all faces, which may touch itself."""
    names = list(names or ("upper", "lower"))
    return lambda data: [fm.ContactPair(data, names, law=law, **options)]


def problem_with(
    data, pairs, rim, *, degree=2, material=linear_elastic, loads=(1.0,), sides="rim", **options
):
    """Problem with the displacement ``rim(x, load)`` on outer sides, solved for all loads."""
    V = fm.vector_space(data.mesh, degree)
    u, prescribed = fem.Function(V), fem.Function(V)
    bcs = [fm.dirichlet(V, data, sides, prescribed)]
    problem = fm.ContactProblem(
        internal(u, material(u, E, NU)), u, pairs(data), bcs=bcs, petsc_options_prefix="crack_",
        **options,
    )  # fmt: skip
    for load in loads:
        prescribed.interpolate(lambda x, load=load: rim(x[:2], load))
        problem.solve()
    return Scene(data, u, problem)


def strained(data, pairs, gradient, **options):
    """Problem with a displacement of uniform gradient on the rim."""
    G = np.array(gradient)
    return problem_with(data, pairs, lambda x, load: load * (G @ x), **options)


def in_plane(mesh, pairs, stress, *, mu_f=0.0, order=1, angle=0.0, **options):
    """Plate with the displacement of a slit in a plane on its rim.

    ``stress`` (sxx, syy, sxy) is far from the crack, in its axes; the plate is turned by ``angle``.
    """
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, -s], [s, c]])

    def rim(x, load):
        return R @ around_crack(*(R.T @ x), load * np.array(stress), mu_f)

    return problem_with(turned(mesh, angle).data(order), pairs, rim, **options)


def jump_at(scene, where, names=("upper", "lower"), angle=0.0):
    """Displacement of the first face less that of the second at a point, in axes of the crack."""
    c, s = np.cos(angle), np.sin(angle)
    R, values = np.array([[c, -s], [s, c]]), []
    space = DisplacementSpace(scene.u.function_space)
    for name in names:
        side = extract_surface(space, scene.data.facet_tags, scene.data.boundary_tags(name), name)
        near = np.linalg.norm(side.X - R @ where, axis=1).argmin()
        values.append(side.gather(scene.u.x.array)[near])
    return R.T @ (values[0] - values[1])
