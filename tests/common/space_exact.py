# SPDX-License-Identifier: MIT
"""Bodies in space with polynomial displacements, by body forces and tractions, and their errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from fenics_mortar.utils import compat
from meshes import mapped_boxes
from meshes.mapped_boxes import SIDES, Box, block

# Displacements over the size of the blocks: contact is then linear to this part.
SMALL = 1e-5
FRICTION = 0.2
UPRIGHT = np.eye(3)


@dataclass
class Exact:
    """A problem and its exact solution ``u_e``; stresses are those of linear elasticity."""

    data: Any
    u: Any
    u_e: Any
    mu: float
    lmbda: float
    problem: Any = None

    def stress(self, u):
        strain = ufl.sym(ufl.grad(u))
        return 2 * self.mu * strain + self.lmbda * ufl.tr(strain) * ufl.Identity(3)

    def error(self):
        """Error in the energy norm (collective)."""
        e = self.u - self.u_e
        form = compat.form(ufl.inner(self.stress(e), ufl.grad(e)) * ufl.dx(degree=5))
        return np.sqrt(self.data.mesh.comm.allreduce(fem.assemble_scalar(form)))

    def solve(self):
        """Solve, and return the estimate (collective)."""
        self.problem.solve()
        return self.problem.estimate()


def curved(x, y, z):
    """Symmetric about z = 0, where shear is zero, under pressure."""
    return (
        0.5 * x**2 * y * (1 + 2 * z**2), x * z**2 + 0.3 * y**2,
        z**3 - z * (3 + x**2 + y),
    )  # fmt: skip


def sheared(x, y, z):
    """As ``curved``, with shear on z = 0."""
    u_x, u_y, u_z = curved(x, y, z)
    return u_x + z * (1 + y**2), u_y - 0.5 * z * x, u_z


def sliding(x, y, z):
    """With uniform stress on z = 0, where shear along x is ``FRICTION`` times the pressure.

    For Poisson's ratio 0.3: sigma_zz = -3 (2 mu + lambda), sigma_xz = 0.7 / 0.2 mu FRICTION 3.
    """
    slope = 3.0 * FRICTION * 0.7 / 0.2
    u_x, u_y, u_z = z**2 * (x * y + z), z**2 * (x**2 + z), z**2 * (1 + x - y**2)
    return u_x + slope * z, u_y, u_z - 3.0 * z


def exact(
    boxes, field, held, sides=(), *, cell="hexahedron", degree=1, make=None, length=1.0,
    stress=10.0, turn=UPRIGHT, shift=None, comm=MPI.COMM_WORLD,
):  # fmt: skip
    """A problem whose solution is ``field``.

    Args:
        boxes: The bodies.
        field: Displacement over ``SMALL`` by coordinates.
        held: Sides with the exact displacement; on others there are tractions.
        sides: Slave and master of the pair, without tractions.
        cell: Kind of cells.
        degree: Degree of the displacement.
        make: Makes the pair of the data and ``sides``.
        length: Factor of all lengths.
        stress: Young's modulus.
        turn: Rotation of everything.
        shift: Motion of the body "upper" along x beyond the field, over ``SMALL``.
        comm: Communicator.
    """
    boxes = [Box(box.name, length * box.x @ turn.T) for box in boxes]
    data = mapped_boxes.mesh(boxes, cell=cell, comm=comm)
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V, name="u"), ufl.TestFunction(V)
    place = ufl.SpatialCoordinate(data.mesh) / length
    matrix = ufl.as_matrix(turn.tolist())
    u_e = length * SMALL * matrix * ufl.as_vector(field(*(matrix.T * place)))
    scene = Exact(data, u, u_e, *energies.lame(stress, 0.3))
    dx = ufl.Measure("dx", domain=data.mesh, metadata={"quadrature_degree": 5})
    ds = ufl.Measure("ds", domain=data.mesh, subdomain_data=data.facet_tags,
                     metadata={"quadrature_degree": 5})  # fmt: skip
    residual = ufl.inner(scene.stress(u), ufl.grad(v)) * dx
    residual += ufl.inner(ufl.div(scene.stress(u_e)), v) * dx
    loaded = [f"{box.name}/{side}" for box in boxes for side in SIDES]
    traction = scene.stress(u_e) * ufl.FacetNormal(data.mesh)
    for side in loaded:
        if side not in (*held, *sides):
            residual -= ufl.inner(traction, v) * ds(data.boundary_tag(side))
    bcs = []
    for side in held:
        value, more = fem.Function(V), np.zeros(3)
        if shift is not None and side.startswith("upper"):
            more[0] = shift
        value.interpolate(lambda X, more=more: motion(field, X, length, turn, more))
        bcs.append(fm.dirichlet(V, data, side, value))
    pairs = [make(data, *sides)] if sides else []
    scene.problem = fm.ContactProblem(residual, u, pairs, bcs=bcs, petsc_options_prefix="exact_")
    return scene


def motion(field, X, length, turn, more):
    """Displacements (3, n) at places X (3, n)."""
    x = turn.T @ X / length
    return length * SMALL * turn @ (np.stack(field(*x)) + more[:, None])


def one_block(n, field=curved, **options):
    """A block of n x n x n cubes, held below."""
    return exact([Box("block", block((n, n, n), jiggle=0.15))], field, ["block/bottom"], **options)


def two_blocks(n, make, field=curved, *, reverse=False, **options):
    """Blocks that meet at z = 0 with meshes that do not match, held at top and bottom."""
    size = (1.0, 1.0, 0.5)
    fine = n + n // 2
    upper = block((n, n, n // 2), size=size, jiggle=0.15, seed=1)
    lower = block((fine, fine, fine // 2), size=size, corner=(0, 0, -0.5), jiggle=0.15, seed=2)
    sides = ("upper/bottom", "lower/top")
    boxes = [Box("upper", upper), Box("lower", lower)]
    return exact(
        boxes, field, ["upper/top", "lower/bottom"], sides[::-1] if reverse else sides, make=make,
        **options,
    )  # fmt: skip
