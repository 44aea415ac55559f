# SPDX-License-Identifier: MIT
"""Bodies with remote loads: a ring with a rigid bore, a wheel on a road, a lever, two blocks."""

from __future__ import annotations

import numpy as np
import revolved
from array_meshes import tagged
from refusal import COMM
from scenes import TIGHT, internal, neo_hookean, read

from dolfinx import fem
from dolfinx import mesh as dmesh

import fenics_mortar as fm
from meshes import two_blocks
from meshes.mapped_grids import Grid, block, mesh, sector

E, NU = 100.0, 0.3
INNER, OUTER = 1.0, 2.0


def ring(material=neo_hookean, columns=24, rows=3, load=fm.RigidBoundary, pivot=(0.0, 0.0)):
    """A ring of curved quadratic cells, fixed at its outer edge, with its bore as a hub."""
    x = sector(2 * columns, 2 * rows, radii=(INNER, OUTER))
    data = mesh([Grid("ring", x, closed=True)], order=2)
    V = fm.vector_space(data.mesh, 2)
    u = fem.Function(V)
    hub = load(data, "ring/top", pivot=pivot, name="hub")
    problem = fm.ContactProblem(
        internal(u, material(u, E, NU)),
        u,
        [],
        bcs=[fm.dirichlet(V, data, "ring/bottom", (0.0, 0.0))],
        remote=[hub],
        newton=TIGHT,
        petsc_options_prefix="ring_",
    )
    return problem, hub


def wheel(gap=0.05, mu=0.4, columns=64, newton=None):
    """A wheel above a road, on an axle that is its only support."""
    x = sector(columns, 4, radii=(0.3, 1.0), centre=(0.0, 1.0 + gap))
    data = mesh([Grid("wheel", x, closed=True)])
    u = fem.Function(fm.vector_space(data.mesh, 1))
    road = fm.Plane((0.0, 0.0), (0.0, 1.0), name="road")
    axle = fm.RigidBoundary(data, "wheel/top", pivot=(0.0, 1.0 + gap), name="axle")
    pair = fm.ContactPair(data, "wheel/bottom", road, law=fm.Coulomb(mu))
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)),
        u,
        [pair],
        remote=[axle],
        newton=newton,
        petsc_options_prefix="wheel_",
    )
    return problem, axle, road


def lever():
    """A beam on a hinge, with a handle at its long end and a stop above the short one.

    Returns:
        The problem, hinge, handle and stop.
    """
    shape = dmesh.CellType.quadrilateral
    grid = dmesh.create_rectangle(COMM, [(0.0, 0.0), (3.0, 0.3)], (60, 4), shape)
    data = tagged(
        grid,
        hinge=lambda x: np.isclose(x[1], 0.0) & (np.abs(x[0] - 1.0) < 0.11),
        handle=lambda x: np.isclose(x[0], 3.0),
        top=lambda x: np.isclose(x[1], 0.3) & (x[0] < 0.41),
    )
    u = fem.Function(fm.vector_space(grid, 1))
    stop = fm.Plane((0.0, 0.35), (0.0, -1.0), name="stop")
    hinge = fm.RigidBoundary(data, "hinge", pivot=(1.0, 0.0))
    handle = fm.RigidBoundary(data, "handle", pivot=(3.2, 0.1))
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)),
        u,
        [fm.ContactPair(data, "top", stop)],
        remote=[hinge, handle],
        newton=TIGHT,
        petsc_options_prefix="lever_",
    )
    return problem, hinge, handle, stop


def blocks(rigid, *, slave="lower", degree=1, law=None, spread=None, more=(), **options):
    """Two blocks, the upper one on a rigid boundary, with its pivot beside its centre."""
    data = read(two_blocks.build)
    V = fm.vector_space(data.mesh, degree)
    u = fem.Function(V)
    sides = {"upper": "upper/bottom", "lower": "lower/top"}
    other = {"upper": "lower", "lower": "upper"}[slave]
    law = law or fm.Coulomb(0.5)
    grip = fm.RigidBoundary(data, rigid, pivot=(0.3, 1.2), name="grip")
    if spread:
        more = [*more, fm.SpreadLoad(data, spread, pivot=(1.5, 1.9))]
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)),
        u,
        [fm.ContactPair(data, sides[slave], sides[other], law=law)],
        bcs=[fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0))],
        remote=[grip, *more],
        newton=TIGHT,
        petsc_options_prefix="blocks_",
        **options,
    )
    return problem, grip


def joint(material, load, *, inset=0.0):
    """A bolt beside two plates in contact, of one height and without Poisson's effect.

    Args:
        material: Stress of a displacement, E and nu.
        load: ``RigidBoundary`` or ``SpreadLoad``, on the tops of both.
        inset: Distance of the ends of the upper plate from those of the lower one; where both
            coincide, the covered part has a kink.

    Returns:
        The problem, the section of the bolt, the load, and both stiffnesses.
    """
    width, across, height = 0.5, 1.5, 2.0
    half = height / 2.0
    data = mesh(
        [
            Grid("nut", block(2, 4, width=width, height=half)),
            Grid("bolt", block(3, 4, width=width, height=half, corner=(0.0, half))),
            Grid("plate", block(6, 4, width=across, height=half, corner=(1.0, 0.0))),
            Grid(
                "cover",
                block(5, 3, width=across - 2 * inset, height=half, corner=(1.0 + inset, half)),
            ),
        ]
    )
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    section = fm.Pretension(data, slave="bolt/bottom", master="nut/top", name="bolt")
    top = load(data, ["bolt/top", "cover/top"], pivot=(0.7, height), name="top")
    problem = fm.ContactProblem(
        internal(u, material(u, E, 0.0)),
        u,
        [section, fm.ContactPair(data, "cover/bottom", "plate/top")],
        bcs=[fm.dirichlet(V, data, ["nut/bottom", "plate/bottom"], (0.0, 0.0))],
        remote=[top],
        newton=TIGHT,
        petsc_options_prefix="joint_",
    )
    return problem, section, top, (E * width / height, E * across / height)


def cylinder(load=fm.RigidBoundary):
    """A solid cylinder on a fixed bottom, with a remote load on its end."""
    grid = dmesh.create_rectangle(COMM, [(0.0, 0.0), (1.0, 2.0)], (4, 8))
    data = tagged(
        grid,
        axis=lambda x: np.isclose(x[0], 0.0),
        bottom=lambda x: np.isclose(x[1], 0.0),
        end=lambda x: np.isclose(x[1], 2.0),
    )
    V = fm.vector_space(grid, 1)
    u = fem.Function(V)
    end = load(data, "end", pivot=(0.0, 2.0))
    problem = fm.ContactProblem(
        revolved.internal(u, revolved.neo_hookean(u, E, NU)),
        u,
        [],
        bcs=[
            fm.dirichlet(V, data, "bottom", (0.0, 0.0)),
            fm.dirichlet(V, data, "axis", 0.0, component=0),
        ],
        remote=[end],
        geometry="axisymmetric",
        newton=TIGHT,
        petsc_options_prefix="cylinder_",
    )
    return problem, end
