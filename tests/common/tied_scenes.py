# SPDX-License-Identifier: MIT
"""Tied blocks and rings, and a tool on tied halves."""

from mpi4py import MPI

import numpy as np
from scenes import TIGHT, internal, linear_elastic, neo_hookean, read

from dolfinx import fem

import fenics_mortar as fm
from meshes import two_blocks
from meshes.mapped_grids import Grid, block, build, sector

comm = MPI.COMM_WORLD
ROLES = [("upper/bottom", "lower/top"), ("lower/top", "upper/bottom")]
STRAIN = np.array([[1.1, 0.2], [0.05, 0.9]])
ENDS = ["lower/bottom", "upper/top"]
AROUND = [*ENDS, *(f"{block}/{side}" for block in ("upper", "lower") for side in ("left", "right"))]
# for displacements of size 1, after solves with matrices of condition 1e3
EXACT = 1e-12


def neo(u):
    return internal(u, neo_hookean(u, 100.0, 0.3))


def linear(u):
    return internal(u, linear_elastic(u, 100.0, 0.0))


def tied(data, pairs, names, gradient, *, degree=1, start=0.9, law=neo, **options):
    """A problem with the displacement gradient . X prescribed on boundaries, and this field."""
    V = fm.vector_space(data.mesh, degree)
    u, exact = fem.Function(V), fem.Function(V)
    exact.interpolate(lambda X: gradient @ X[:2])
    bcs = [fm.dirichlet(V, data, name, exact) for name in names]
    u.x.array[:] = start * exact.x.array
    options = {"petsc_options_prefix": "tied_", "newton": TIGHT, **options}
    return fm.ContactProblem(law(u), u, pairs, bcs=bcs, **options), exact


def blocks(counts=(5, 7), comm=comm, **mesh):
    mesh = {"width_upper": 1.0, "width_lower": 1.0, "layers_upper": 3, "layers_lower": 4, **mesh}
    return read(two_blocks.build, comm=comm, n_upper=counts[0], n_lower=counts[1], **mesh)


def ring_data(degree):
    """Two rings with 12 and 20 facets where they meet, with curved cells if the degree is 2."""
    grids = [
        Grid(name, sector(count * degree, 2 * degree, radii=radii), closed=True)
        for name, count, radii in (("inner", 12, (1.0, 2.0)), ("outer", 20, (2.0, 3.0)))
    ]
    return read(build, grids=grids, order=degree)


def four_blocks(roles=(True, True, True, True)):
    """Blocks a b over c d of 3 to 7 cells a side; whether the first is the slave of each pair."""
    places = {"a": (3, 0, 1), "b": (4, 1, 1), "c": (5, 0, 0), "d": (7, 1, 0)}
    grids = [
        Grid(name, block(n, n, width=1.0, height=1.0, corner=(x, y)))
        for name, (n, x, y) in places.items()
    ]
    data = read(build, grids=grids)
    sides = ["a/right", "b/left"], ["b/bottom", "d/top"], ["d/left", "c/right"]
    both = zip((*sides, ["c/top", "a/bottom"]), roles, strict=True)
    return data, [fm.TiedPair(data, *(pair if first else pair[::-1])) for pair, first in both]


def off(problem, exact):
    return comm.allreduce(np.abs(problem.equations.bulk.u.x.array - exact.x.array).max(), MPI.MAX)


def tool_on_halves(comm=comm, slave="tool", joined=True, law=None):
    """A tool pressed on a base of two tied halves, and slid over the joint of these."""
    names = {"top": "ground", "bottom": "floor"} if slave != "left/top" else {"bottom": "floor"}
    tool = block(10, 4, width=1.0, height=0.5, corner=(-0.5, 0.0))
    left = block(8 if joined else 16, 6, width=2.0 if joined else 4.0, height=1.0, corner=(-2, -1))
    grids = [Grid("tool", tool), Grid("left", left, names)]
    if joined:
        grids.append(Grid("right", block(6, 4, width=2.0, height=1.0, corner=(0, -1)), names))
    data = read(build, comm=comm, grids=grids)
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    sides = ("tool/bottom", "ground") if slave == "tool" else (slave, "tool/bottom")
    pairs = [fm.ContactPair(data, *sides, law=law)]
    if joined:
        pairs.append(fm.TiedPair(data, "left/right", "right/left"))
    bcs = [
        fm.dirichlet(V, data, "floor", np.zeros(2)),
        fm.dirichlet(V, data, "tool/top", push),
    ]
    problem = fm.ContactProblem(
        neo(u), u, pairs, bcs=bcs, petsc_options_prefix="halves_", newton=TIGHT
    )
    reports = []
    for place in ((0.0, -0.02), (0.0, -0.05), (0.1, -0.05), (0.2, -0.05), (0.3, -0.05)):
        push.value[:] = place
        # If the right half is in no pair, the tool penetrates it: an intended violation.
        missed = slave == "left/top"
        reports.append(problem.solve(accept_violations=missed))
    return problem, reports
