# SPDX-License-Identifier: MIT
"""Problems of the study: one at a load by a model, statically or in time steps."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import linear_elastic, neo_hookean, read_mesh
from demos.studies.ladder.scenes import TOLERANCE, Model, Scene
from fenics_mortar.energies import displacement_gradient, lame
from fenics_mortar.mesh.space import Geometry
from meshes import mapped_grids
from meshes.mapped_grids import Grid

NU = 0.3
MU, LMBDA = lame(1.0, NU)


def first_piola(u: Any, strain: str, geometry: Geometry = "plane") -> Any:
    """Stress of a body of Young's modulus 1, linear elastic or neo-Hookean."""
    return (linear_elastic if strain == "linear" else neo_hookean)(u, MU, LMBDA, geometry)


def read(scene: Scene, load: float, bodies: str = "soft tool", finer: int = 1) -> Any:
    """Mesh of some bodies, each cell divided into ``finer`` cells along its sides."""
    soft, tool = Grid("soft", scene.soft(load, finer)), scene.tool(load, finer)
    grids = [grid for grid in (soft, tool) if grid.name in bodies.split()]
    return read_mesh(lambda: mapped_grids.build(grids), MPI.COMM_SELF)


@dataclass
class Posed:
    """A problem, its residual at finite strain, the function that sets loads, and its motion."""

    problem: fm.ContactProblem
    finite: Any
    set_time: Callable[[float], None]
    dynamics: fm.Dynamics | None = None

    def solve(self, dt: float) -> fm.NewtonReport:
        """Solve the present load step, or take a time step of ``dt``."""
        if self.dynamics is not None:
            return self.dynamics.step(dt)
        return self.problem.solve(accept_violations=True)  # also of poor models


def internal_forces(scene: Scene, u: Any, data: Any, strain: str) -> Any:
    """Residual of the bodies of a mesh."""
    turned = scene.geometry == "axisymmetric"
    width = 2 * np.pi * ufl.SpatialCoordinate(data.mesh)[0] if turned else 1
    degree = 2 + turned
    dx = ufl.dx(subdomain_data=data.cell_tags, metadata={"quadrature_degree": degree})
    v = ufl.TestFunction(u.function_space)
    stress = first_piola(u, strain, scene.geometry)
    work = width * ufl.inner(stress, displacement_gradient(v, scene.geometry))
    moduli = {"soft": 1.0, "tool": scene.ratio}
    return sum(moduli[name] * work * dx(tag) for name, tag in data.bodies.items())


def fix(V: Any, data: Any, places: Iterable[tuple[str, int | None]]) -> list[Any]:
    """Conditions that fix boundaries in a component, or altogether."""
    return [
        fm.dirichlet(V, data, name, np.zeros(2) if which is None else 0.0, which)
        for name, which in places
    ]


def pose(scene: Scene, load: float, model: Model, data: Any, friction: float = 0.0) -> Posed:
    """Set up a problem by a model."""
    V = fm.vector_space(data.mesh, 1)
    u, grip = fem.Function(V), fem.Function(V)
    radius, centre = scene.circle(load)
    circle = fm.Circle(centre, radius)
    bcs = fix(V, data, scene.fixed + (() if model.rigid else scene.symmetry))
    if scene.grip and not model.rigid:
        bcs.append(fm.dirichlet(V, data, scene.grip, grip))
    master = None if scene.pressure else circle if model.rigid else "tool/bottom"
    law = fm.Coulomb(friction) if friction else scene.law(load) if scene.law else None
    check = fm.ModelCheck(TOLERANCE, friction=model.leaves_out) if model.leaves_out else None
    push = fem.Constant(data.mesh, 0.0)
    loads = pressed(u, data, push) if scene.pressure else 0
    problem = fm.ContactProblem(
        internal_forces(scene, u, data, model.strain) + loads,
        u,
        [fm.ContactPair(data, scene.slave, master, law=law, sliding=model.sliding)],
        bcs=bcs,
        petsc_options_prefix="ladder_",
        linearization=model.linearization,
        newton=fm.NewtonOptions(max_iterations=100),
        model_check=check,
        geometry=scene.geometry,
    )
    overlap = np.nan_to_num(problem.equations.contacts[0].gap)

    def set_time(t: float) -> None:
        x, y, angle = scene.motion(load, t)
        if scene.interference:
            problem.equations.contacts[0].offset = (1 - t) * overlap
        if scene.pressure:
            push.value = t * scene.pressure(load)
        circle.move(x=x, y=y, angle=angle)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        middle = np.array(centre)[:, None]
        shift = np.array([[x], [y]])
        grip.interpolate(lambda X: turn @ (X[:2] - middle) + middle + shift - X[:2])

    finite = internal_forces(scene, u, data, "finite") + loads
    return Posed(problem, finite, set_time, thrown(problem, load) if scene.duration else None)


def pressed(u: Any, data: Any, push: Any) -> Any:
    """Residual of the dead pressure ``push`` on the outer boundary of the soft body."""
    (tag,) = data.boundary_tags("soft/top")
    ds = ufl.ds(data.mesh, subdomain_data=data.facet_tags)
    normal = ufl.FacetNormal(data.mesh)
    return push * ufl.inner(normal, ufl.TestFunction(u.function_space)) * ds(tag)


def thrown(problem: fm.ContactProblem, speed: float) -> fm.Dynamics:
    """The soft body, of density 1, flies up; waves along a bar of it have the speed 1."""
    motion = fm.Dynamics(problem, 1.0)
    space = problem.equations.bulk.space
    soft = space.V.tabulate_dof_coordinates()[:, 1] <= 0.0
    label = problem.equations.floating.labels
    mine = label == label[np.flatnonzero(soft)[0]]
    motion.velocity.x.array[space.dofs[mine, 1]] = speed
    return motion


def elastic_tool(scene: Scene, circle: fm.Obstacle, data: Any) -> fm.ElasticObstacle:
    """The elastic tool that the rigid circle represents, on a mesh of the tool alone."""
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    gripped = ((scene.grip, None),) if scene.grip else ()
    bcs = fix(V, data, (*scene.symmetry, *gripped))
    residual = internal_forces(scene, u, data, "linear")
    return fm.ElasticObstacle(circle, residual, u, data, "tool/bottom", bcs=bcs)
