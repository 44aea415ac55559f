# SPDX-License-Identifier: MIT
"""Impacts with known solution, or known energy and momentum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import read_mesh
from fenics_mortar import energies
from meshes.mapped_grids import Grid, block, build, sector

# Young's modulus and density: waves travel 10 lengths per time along a bar.
E, RHO = 100.0, 1.0


@dataclass
class Scene:
    """Bodies ready to move.

    Attributes:
        data: The mesh.
        problem: The static problem.
        energy: Strain energy, a UFL form.
        cell: Length of a cell [length].
        gravity: Acceleration by gravity, a constant of dolfinx [length / time^2].
        velocity: Velocity in the residual.
        spring: Stiffness of horizontal springs in the bodies, a constant of dolfinx
            [stress / length^2].
    """

    data: fm.MeshData
    problem: fm.ContactProblem
    energy: Any
    cell: float
    gravity: fem.Constant
    spring: fem.Constant
    velocity: fm.Velocity

    @property
    def u(self) -> fem.Function:
        """The displacement."""
        return self.problem.equations.bulk.u

    def dynamics(self, scheme: str, rho_inf: float | None = None) -> fm.Dynamics:
        """The motion with a time scheme."""
        options = {"scheme": scheme, "rho_inf": rho_inf, "energy": self.energy}
        options["velocity"] = self.velocity
        return fm.Dynamics(self.problem, RHO, **options)

    def mean(self, component: int) -> float:
        """Mean displacement along x (0) or y (1) of all bodies [length]."""
        one = fem.Constant(self.data.mesh, 1.0)
        forms = (fem.form(f * ufl.dx) for f in (self.u[component], one))
        value, area = (self.problem.equations.comm.allreduce(fem.assemble_scalar(f)) for f in forms)
        return value / area

    def set_velocity(self, motion: fm.Dynamics, velocities: dict[str, Sequence[float]]) -> None:
        """Set velocities and spins of bodies about the origin: (v_x, v_y, omega)."""
        V = motion.velocity.function_space
        self.data.mesh.topology.create_connectivity(2, 2)
        for name, (x, y, spin) in velocities.items():
            cells = self.data.cell_tags.find(self.data.bodies[name])
            dofs = fem.locate_dofs_topological(V, 2, cells)
            X = V.tabulate_dof_coordinates()[dofs]
            values = motion.velocity.x.array.reshape(-1, 2)
            values[dofs, 0], values[dofs, 1] = x - spin * X[:, 1], y + spin * X[:, 0]
        motion.velocity.x.scatter_forward()


def scene(
    grids: Sequence[Grid],
    sides: Sequence[tuple[Any, Any]],
    *,
    prescribed: Sequence[tuple[str, int, float]] = (),
    modulus: float = E,
    nu: float = 0.3,
    is_linear: bool = False,
    damping: float = 0.0,
    degree: int = 1,
    cell: str = "quadrilateral",
    law: Any = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
    **options: Any,
) -> Scene:
    """A problem on grids; ``sides``: slave and master of each pair; ``prescribed``: conditions."""
    data = read_mesh(lambda: build(grids, cell=cell, order=degree), comm)
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V, name="displacement"), ufl.TestFunction(V)
    dx = ufl.dx(metadata={"quadrature_degree": 2 * degree + 2})
    gravity, spring = fem.Constant(data.mesh, (0.0, 0.0)), fem.Constant(data.mesh, 0.0)
    density = energies.linear_elastic if is_linear else energies.neo_hookean
    energy = density(u, *energies.lame(modulus, nu)) * dx
    residual = ufl.derivative(energy, u, v) - RHO * ufl.inner(gravity, v) * dx
    velocity = fm.Velocity(u)
    residual += spring * u[0] * v[0] * dx
    drag = fem.Constant(data.mesh, damping * RHO)
    residual += ufl.inner(drag * velocity.expression, v) * dx
    energy += 0.5 * spring * u[0] ** 2 * dx
    law_option = {} if law is None else {"law": law}
    pairs = [fm.ContactPair(data, slave, master, **law_option) for slave, master in sides]
    bcs = [fm.dirichlet(V, data, name, value, component=c) for name, c, value in prescribed]
    options = {"petsc_options_prefix": "impact_", "bcs": bcs, **options}
    problem = fm.ContactProblem(residual, u, pairs, **options)
    sizes = [np.linalg.norm(np.diff(grid.x[:, 0], axis=0), axis=1).mean() for grid in grids]
    return Scene(data, problem, energy, degree * min(sizes), gravity, spring, velocity)


def bar(cells: int = 40, length: float = 10.0, gap: float = 0.01, **options: Any) -> Scene:
    """A bar that moves along its axis against a rigid wall, a gap below it; nu = 0."""
    grid = Grid("bar", block(2, cells, width=1.0, height=length))
    sides = [("bar/bottom", fm.Plane((0.0, -gap), (0.0, 1.0)))]
    prescribed = [("bar/left", 0, 0.0), ("bar/right", 0, 0.0)]
    made = scene([grid], sides, prescribed=prescribed, nu=0.0, is_linear=True, **options)
    made.cell = length / cells
    return made


def free_block(gap: float = 50.0, cells: int = 4, **options: Any) -> Scene:
    """A block of 1 x 1 about the origin, a gap above a rigid plane."""
    grid = Grid("block", block(cells, cells, width=1.0, height=1.0, corner=(-0.5, -0.5)))
    return scene([grid], [("block/bottom", fm.Plane((0.0, -0.5 - gap), (0.0, 1.0)))], **options)


def changes_in_free_flight(
    scheme: str, rho_inf: float, duration: float, numbers: tuple[int, int, int]
) -> tuple[float, float]:
    """Changes of the displacement with the number of steps, for three numbers [length].

    A neo-Hookean block rotates and vibrates in free flight.
    """
    found = []
    for number in numbers:
        made = free_block(cells=2)
        motion = made.dynamics(scheme, rho_inf)
        made.set_velocity(motion, {"block": (0.5, 0.2, 3.0)})
        for _ in range(number):
            motion.step(duration / number)
        found.append(made.u.x.array.copy())
    first, second, third = found
    return float(np.abs(first - second).max()), float(np.abs(second - third).max())


def oscillator(
    law: Any,
    *,
    pressure: float = 1.0,
    stiffness: float = 4.0,
    modulus: float = E,
    **options: Any,
) -> tuple[Scene, fm.Plane]:
    """A stiff block of 1 x 1 on springs, pressed on a rigid plane by its top; and the plane.

    The mass is 1, the springs have the ``stiffness``; with friction the oscillator is damped. The
    block has Young's ``modulus``.
    """
    grid = Grid("block", block(2, 3, width=1.0, height=1.0))
    plane = fm.Plane((0.0, 0.0), (0.0, 1.0))
    options = {"prescribed": [("block/top", 1, -pressure / modulus)], "law": law, **options}
    made = scene(
        [grid], [("block/bottom", plane)], modulus=modulus, nu=0.0, is_linear=True, **options
    )
    made.spring.value = stiffness
    return made, plane


def dropped_block(cells: int = 8, gap: float = 0.05, **options: Any) -> Scene:
    """A block of 1 x 1 above one of 2 x 1 that is fixed at its bottom."""
    upper = Grid("upper", block(cells, cells, width=1.0, height=1.0, corner=(-0.5, gap)))
    lower = Grid(
        "lower", block(round(1.4 * cells), cells, width=2.0, height=1.0, corner=(-1.0, -1.0))
    )
    prescribed = [("lower/bottom", 0, 0.0), ("lower/bottom", 1, 0.0)]
    return scene([upper, lower], [("upper/bottom", "lower/top")], prescribed=prescribed, **options)


def rings(cells: int = 32, layers: int = 3, **options: Any) -> Scene:
    """Two rings of radius 1 side by side, for an off-centre impact."""
    shapes = {"left": (-1.3, 0.0), "right": (1.0, 0.5)}
    grids = [
        Grid(name, sector(cells, layers, radii=(0.6, 1.0), centre=centre), closed=True)
        for name, centre in shapes.items()
    ]
    return scene(grids, [("left/bottom", "right/bottom")], **options)
