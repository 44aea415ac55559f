# SPDX-License-Identifier: MIT
"""Materials with history in UFL, and blocks of them under contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.energies import lame
from meshes.mapped_grids import Grid, mapped, mesh

# Tolerance of Newton's method: stresses of the tests are compared to ten digits.
TIGHT = fm.NewtonOptions(residual_tolerance=1e-13)


def in_space(e):
    """Plane strain as a tensor of shape (3, 3)."""
    return ufl.as_tensor([[e[0, 0], e[0, 1], 0], [e[1, 0], e[1, 1], 0], [0, 0, 0]])


@dataclass
class Material:
    """Stress (3, 3) at the end of a step, history functions, and values to look at."""

    stress: Any
    history: list[tuple[Any, Any]]
    shown: dict[str, Any]


def plastic(u, degree, dt=None, *, mesh=None, E=200.0, nu=0.3, sigma_y=1.0, H=10.0):
    """Von Mises plasticity, linear isotropic hardening, small strains, plane strain.

    ``mesh`` has to be given for a ``u`` that is a part of a mixed function.
    """
    mesh = mesh or u.function_space.mesh
    old = fm.quadrature_function(mesh, degree, (3, 3))
    alpha = fm.quadrature_function(mesh, degree)
    old.name, alpha.name = "plastic_strain", "alpha"
    mu, lmbda = lame(E, nu)
    strain = in_space(fm.energies.strain(u))
    s = 2 * mu * ufl.dev(strain - old)
    size = ufl.sqrt(ufl.inner(s, s) + (1e-12 * sigma_y) ** 2)
    f = size - np.sqrt(2 / 3) * (sigma_y + H * alpha)
    gamma = ufl.conditional(f > 1e-9 * sigma_y, f / (2 * mu + 2 / 3 * H), 0.0)
    flow = gamma / size * s
    stress = lmbda * ufl.tr(strain) * ufl.Identity(3) + 2 * mu * (strain - old - flow)
    history = [(old, old + flow), (alpha, alpha + np.sqrt(2 / 3) * gamma)]
    return Material(stress, history, {"alpha": alpha})


def viscous(u, degree, dt, *, E=200.0, nu=0.3, share=0.75, tau=1.0):
    """Zener's solid with constant nu, of the relaxation function ``relaxed``.

    The strain of its dashpot, tau q' + q = strain, is exact for a strain that is linear in time in
    each step.
    """
    mesh = u.function_space.mesh
    q, before, kept = (fm.quadrature_function(mesh, degree, (3, 3)) for _ in range(3))
    q.name, before.name, kept.name = "dashpot", "strain", "stress"
    mu, lmbda = lame(E, nu)
    strain = in_space(fm.energies.strain(u))
    decay = ufl.exp(-dt / tau)
    mean = (1 - decay) * tau / dt
    new = decay * q + (1 - mean) * strain + (mean - decay) * before
    elastic = strain - share * new
    stress = lmbda * ufl.tr(elastic) * ufl.Identity(3) + 2 * mu * elastic
    history = [(q, new), (before, strain), (kept, stress)]
    return Material(stress, history, {"stress": kept})


def relaxed(t, ramp, *, share=0.75, tau=1.0):
    """Force at the times t over its elastic value, for a strain that grows until ``ramp``.

    The mean of G(t - s) / G(0) = 1 - share + share exp(-(t - s) / tau) over the ramp, times the
    part of the ramp that has passed.
    """
    t = np.asarray(t, float)
    end = np.minimum(t, ramp)
    return ((1 - share) * end + share * tau * (np.exp((end - t) / tau) - np.exp(-t / tau))) / ramp


class Block:
    """A block of the size 2 x 1 on its fixed bottom, under a rigid obstacle.

    Attributes:
        data: The mesh, with the names of its boundaries.
        u: The displacement.
        obstacle: A roller, at first just above the block, or another obstacle.
        dt: Length of the step of time.
        material: Stress and history of the block.
        problem: The problem.
    """

    def __init__(
        self, law=plastic, *, columns=8, rows=4, cell="quadrilateral", degree=1, obstacle=None,
        comm=MPI.COMM_WORLD, bottom=(0.0, 0.0), **options,
    ):  # fmt: skip
        """Set up the problem; ``law`` makes the material of displacement, degree and step."""
        x = mapped(degree * columns, degree * rows, lambda s, t: (2 * s - 1, t))
        self.data = mesh([Grid("block", x)], cell=cell, order=degree, comm=comm)
        V = fm.vector_space(self.data.mesh, degree)
        self.u, v = fem.Function(V, name="u"), ufl.TestFunction(V)
        points, self.dt = 2 * degree, fem.Constant(self.data.mesh, 1.0)
        self.material = law(self.u, points, self.dt)
        strain = in_space(fm.energies.strain(v))
        residual = ufl.inner(self.material.stress, strain) * ufl.dx(degree=points)
        self.obstacle = obstacle or fm.Circle((0.0, 3.0), 2.0)
        bcs = [fm.dirichlet(V, self.data, "block/bottom", bottom)]
        self.problem = fm.ContactProblem(
            residual, self.u, [fm.ContactPair(self.data, "block/top", self.obstacle)], bcs=bcs,
            **{"history": self.material.history, "newton": TIGHT, **options},
            petsc_options_prefix="history_",
        )  # fmt: skip

    def press(self, depth, dt=1.0, **options):
        """Solve with the obstacle lowered by a depth in all, after a step of time."""
        self.dt.value = dt
        self.obstacle.move(y=-depth)
        return self.problem.solve(**options)

    @property
    def force(self):
        """Force on the obstacle, downwards."""
        return float(-self.problem.contacts[0].total_force[1])

    @property
    def values(self):
        """All numbers of the present state."""
        state = self.problem.state()
        return np.concatenate([state.u, state.interfaces[0].z.ravel(), state.history.accepted])
