# SPDX-License-Identifier: MIT
"""Two blocks in space, one on the other, for tests of contacts and ties."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
from scipy.spatial.transform import Rotation

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from fenics_mortar.utils import compat
from meshes import mapped_boxes
from meshes.mapped_boxes import Box, block

TIGHT = fm.NewtonOptions(residual_tolerance=1e-13)
YOUNG = 100.0
KINDS = [("tetrahedron", 1), ("hexahedron", 1), ("tetrahedron", 2), ("hexahedron", 2)]
ROLES = [("upper/bottom", "lower/top"), ("lower/top", "upper/bottom")]
TILTED = Rotation.from_rotvec([0.4, -0.7, 0.5]).as_matrix()
UPRIGHT = np.eye(3)


@dataclass
class Stack:
    """An upper block on a lower one, turned as a whole by the matrix ``turn``."""

    data: fm.MeshData
    u: Any
    residual: Any
    bcs: list[Any]
    turn: np.ndarray
    problem: Any = None
    push: Any = None

    @property
    def contact(self):
        return self.problem.contacts[0]

    def hold(self, side, value=(0.0, 0.0, 0.0)):
        """Prescribe a displacement before the turn on a side; return the constant."""
        given = np.array(value, float) @ self.turn.T
        constant = fem.Constant(self.data.mesh, given)
        self.bcs.append(fm.dirichlet(self.u.function_space, self.data, side, constant))
        return constant

    def roll(self, side, component, value=0.0):
        """Prescribe one component on a side of blocks that are not turned."""
        V = self.u.function_space
        self.bcs.append(fm.dirichlet(V, self.data, side, value, component))

    def press(self, motion=(0.0, 0.0, 0.0)):
        """Fix the bottom, and move the top by ``push``."""
        self.hold("lower/bottom")
        self.push = self.hold("upper/top", motion)
        return self

    def move(self, *motion):
        """Set the motion of the top, before the turn, and solve."""
        self.push.value[:] = self.turn @ np.array(motion, float)
        return self.problem.solve()

    def set_up(self, law=None, *, roles=ROLES[0], tie=False, pair=None, **options):
        """Set up the problem with one pair; ``pair`` has its options."""
        kind = fm.TiedPair if tie else fm.ContactPair
        more = {} if tie else {"law": law}
        made = kind(self.data, *roles, **more, **(pair or {}))
        self.problem = fm.ContactProblem(
            self.residual, self.u, [made],
            **{"bcs": self.bcs, "petsc_options_prefix": "pairs_", "newton": TIGHT, **options},
        )  # fmt: skip
        return self


def stack(
    cell="hexahedron",
    degree=1,
    *,
    upper=(3, 2, 1),
    lower=(2, 3, 1),
    sizes=((1.0, 1.0, 0.5), (1.0, 1.0, 0.5)),
    offset=(0.0, 0.0, 0.0),
    turn=UPRIGHT,
    jiggle=0.2,
    order=1,
    bend=0.0,
    poisson=0.0,
    energy=energies.neo_hookean,
    quadrature=4,
    comm=MPI.COMM_WORLD,
):
    """Two blocks that meet at z = 0 before the turn, without conditions.

    Args:
        cell: Kind of the cells.
        degree: Degree of the displacement.
        upper: Numbers of cells of the upper block.
        lower: Numbers of cells of the lower block.
        sizes: Sizes of the upper and of the lower block.
        offset: Corner of the upper block; that of the lower one is below the origin.
        turn: Matrix of a rotation.
        jiggle: See ``mapped_boxes.mapped``.
        order: Order of the cells.
        bend: Curvature of the edges of cells of order 2, in all planes.
        poisson: Poisson's ratio.
        energy: Energy of both bodies.
        quadrature: Degree of the quadrature.
        comm: Communicator.
    """
    corners = np.array(offset, float), np.array([0.0, 0.0, -sizes[1][2]])
    boxes = []
    for seed, (name, counts, size, corner) in enumerate(
        zip(("upper", "lower"), (upper, lower), sizes, corners, strict=True), 1
    ):
        x = block(counts, size=size, corner=corner, jiggle=jiggle, seed=seed, order=order)
        if bend:
            s, t, r = ((x - corner) / size).transpose(3, 0, 1, 2)
            way = (s * (1 - s) * (t + r), t * (1 - t) * (r - s), r * (1 - r) * (s + t))
            x = x + bend * np.stack(way, axis=3)
        boxes.append(Box(name, x @ turn.T))
    data = mapped_boxes.mesh(boxes, cell=cell, order=order, comm=comm)
    u = fem.Function(fm.vector_space(data.mesh, degree), name="u")
    psi = energy(u, *energies.lame(YOUNG, poisson)) * ufl.dx(degree=quadrature)
    return Stack(data, u, ufl.derivative(psi, u), [], turn)


def pressed(
    cell="hexahedron", degree=1, *, law=None, roles=ROLES[0], pair=None, problem=None, **options
):
    """A smaller block on a larger one with a Poisson's ratio, top and bottom held, set up.

    They overlap a little: without a gap rounding would decide which nodes are active first.
    """
    given = {
        "sizes": ((0.8, 0.7, 0.5), (1.2, 1.2, 0.5)), "offset": (0.25, 0.2, -0.003), "poisson": 0.3,
        **options,
    }  # fmt: skip
    scene = stack(cell, degree, **given).press()
    return scene.set_up(law, roles=roles, pair=pair, **(problem or {}))


def off(scene, exact):
    """Largest difference of the displacement from a function of the position, before the turn."""
    u = scene.u
    function = fem.Function(u.function_space)
    function.interpolate(lambda x: scene.turn @ exact(scene.turn.T @ x))
    error = np.abs(u.x.array - function.x.array).max(initial=0.0)
    return u.function_space.mesh.comm.allreduce(error, MPI.MAX)


def slopes(scene, **options):
    """Slopes of the Taylor remainders of all blocks."""
    return scene.problem.check_tangent(print_table=False, **options).slopes


def integral(scene, integrand, degree=4):
    """Integral over all bodies (collective)."""
    dx = ufl.dx(domain=scene.data.mesh, degree=degree)
    form = compat.form(integrand * dx)
    return scene.data.mesh.comm.allreduce(fem.assemble_scalar(form))
