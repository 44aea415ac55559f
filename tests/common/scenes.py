# SPDX-License-Identifier: MIT
"""Scenes shared by the tests: gmsh meshes, materials, whole problems."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies import common
from fenics_mortar.energies import lame
from meshes import two_blocks

TIGHT = fm.NewtonOptions(residual_tolerance=1e-13)
# Blocks that cover each other partly, rotated.
PARTLY_COVERED = {
    "n_upper": 6,
    "n_lower": 5,
    "width_upper": 1.33,
    "width_lower": 1.2,
    "rotation": 0.4,
}


def read(build, comm=MPI.COMM_WORLD, **options):
    """Build a mesh of ``meshes/`` on rank 0 and read it on all ranks."""
    model = None
    if comm.rank == 0:
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        model = build(**options)
    data = fm.read_gmsh(model, comm)
    if comm.rank == 0:
        gmsh.finalize()
    return data


def rectangles(size: float, **boxes: tuple[float, float, float, float]):
    """Build a triangle mesh of rectangles (x, y, width, height), with names body and body/side."""
    model = gmsh.model
    model.add("rectangles")
    surfaces = {
        name: model.occ.addRectangle(x, y, 0.0, w, h) for name, (x, y, w, h) in boxes.items()
    }
    model.occ.synchronize()
    for name, surface in surfaces.items():
        model.setPhysicalName(2, model.addPhysicalGroup(2, [surface]), name)
        curves = [curve for _, curve in model.getBoundary([(2, surface)], oriented=False)]
        for side, curve in zip(("bottom", "right", "top", "left"), curves, strict=True):
            model.setPhysicalName(1, model.addPhysicalGroup(1, [curve]), f"{name}/{side}")
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    model.mesh.generate(2)
    return model


def neo_hookean(u, E, nu):
    """First Piola-Kirchhoff stress of the compressible neo-Hookean law, plane strain."""
    return common.neo_hookean(u, *lame(E, nu))


def linear_elastic(u, E, nu):
    """Cauchy stress of linear elasticity, plane strain."""
    return common.linear_elastic(u, *lame(E, nu))


def internal(u, stress):
    """Virtual work of a stress measure work-conjugate to grad(u)."""
    v = ufl.TestFunction(u.function_space)
    return ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 4})


def pair_options(options: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    """Options of a pair, those of its discretization put into a ``Discretization``."""
    given = {**(options or {}), **more}
    names = {option.name for option in fields(fm.Discretization)} & given.keys()
    if not names:
        return given
    choice = fm.Discretization(**{name: given.pop(name) for name in names})
    return {**given, "discretization": choice}


@dataclass
class Scene:
    """A problem with its loads."""

    data: fm.MeshData
    u: Any
    problem: fm.ContactProblem
    loads: dict[str, Any] = field(default_factory=dict)

    @property
    def contact(self):
        return self.problem.equations.contacts[0]


def pressed_blocks(
    *,
    slave: str = "upper",
    material=neo_hookean,
    E: float = 100.0,
    nu: float = 0.3,
    pair: dict[str, Any] | None = None,
    problem: dict[str, Any] | None = None,
    degree: int = 1,
    comm=MPI.COMM_WORLD,
    **mesh: Any,
) -> Scene:
    """Two blocks, the lower fixed at its bottom, the upper moved by ``loads['push']``."""
    data = read(two_blocks.build, comm=comm, **mesh)
    V = fm.vector_space(data.mesh, degree)
    u = fem.Function(V)
    fixed, push = (fem.Constant(data.mesh, (0.0, 0.0)) for _ in range(2))
    bcs = [
        fm.dirichlet(V, data, "lower/bottom", fixed),
        fm.dirichlet(V, data, "upper/top", push),
    ]
    sides = {"upper": "upper/bottom", "lower": "lower/top"}
    other = {"upper": "lower", "lower": "upper"}[slave]
    contact = fm.ContactPair(data, sides[slave], sides[other], **pair_options(pair))
    options = {"petsc_options_prefix": "test_", "newton": TIGHT, **(problem or {})}
    problem_ = fm.ContactProblem(internal(u, material(u, E, nu)), u, [contact], bcs=bcs, **options)
    return Scene(data, u, problem_, {"push": push})


def homogeneous_blocks(
    gradient: np.ndarray,
    boundaries: list[str],
    *,
    slave: str = "upper",
    material=neo_hookean,
    E: float = 100.0,
    nu: float = 0.3,
    pair: dict[str, Any] | None = None,
    problem: dict[str, Any] | None = None,
    degree: int = 1,
    **mesh: Any,
) -> Scene:
    """Two blocks of equal width with u = gradient . X prescribed on some boundaries."""
    data = read(two_blocks.build, **{"width_upper": 1.0, "width_lower": 1.0, **mesh})
    V = fm.vector_space(data.mesh, degree)
    u, exact = fem.Function(V), fem.Function(V)
    exact.interpolate(lambda X: gradient @ X[:2])
    bcs = [fm.dirichlet(V, data, name, exact) for name in boundaries]
    sides = ["upper/bottom", "lower/top"]
    if slave == "lower":
        sides.reverse()
    options = {"petsc_options_prefix": "test_", "newton": TIGHT, **(problem or {})}
    contact = fm.ContactPair(data, *sides, **pair_options(pair))
    problem_ = fm.ContactProblem(internal(u, material(u, E, nu)), u, [contact], bcs=bcs, **options)
    return Scene(data, u, problem_, {"exact": exact})


def disturbed(scene: Scene) -> Scene:
    """All nodes moved at random, equally on any number of ranks; the covered ones are active."""
    bulk = scene.problem.equations.bulk
    perturbation = np.random.default_rng(0).uniform(-0.01, 0.01, bulk.r.getSize())
    scene.u.x.array[: bulk.num_owned] = perturbation[bulk.first :][: bulk.num_owned]
    scene.u.x.scatter_forward()
    scene.contact.evaluate(scene.u.x.array, scene.problem.equations.linearization)
    scene.contact.change(active=scene.contact.covered)
    return scene


def nodal(problem) -> np.ndarray:
    """Displacement of all nodes in the order of the mesh's input, equal on all ranks.

    Two meshes of the same input may be partitioned differently.
    """
    return problem.equations.bulk.by_input_node()[1]


def rotation(angle: float) -> np.ndarray:
    """Matrix of a rotation by ``angle`` [radian]."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def global_norm(scene: Scene) -> float:
    """Euclidean norm of the owned displacement dofs of all ranks."""
    mine = scene.u.x.array[: scene.problem.equations.bulk.num_owned]
    return float(np.sqrt(MPI.COMM_WORLD.allreduce(float(mine @ mine))))
