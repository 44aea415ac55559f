# SPDX-License-Identifier: MIT
"""The problem of Hertz, solved by Kratos' mortar contact (augmented Lagrangian, frictionless).

    python3 -m venv --system-site-packages kratos
    kratos/bin/pip install KratosContactStructuralMechanicsApplication
    kratos/bin/pip install KratosConstitutiveLawsApplication  # for finite strain
    kratos/bin/python -m demos.studies.accuracy.peer_kratos

Kratos' contact in the plane has facets of two nodes: triangles and quadrilaterals of degree 1. In
space tetrahedra and hexahedra of degree 1 are posed here.
Settings are its defaults, except for tolerances adapted to this small load. The linear solver is
its fastest direct one in the package, or multigrid (AMGCL): in the plane this takes a fifth less
time on the finest uniform mesh, but converges to a wrong solution on graded ones; in space it is
many times faster. At finite strain the search lost
contact along the way with the long surface as slave; the other one is taken. There, derivatives of
the normal ("normal_variation") make the matrix singular; the default leaves them out.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version

import KratosMultiphysics as Kratos
import KratosMultiphysics.ContactStructuralMechanicsApplication as Contact
import KratosMultiphysics.StructuralMechanicsApplication as Structural
import numpy as np
from KratosMultiphysics.ContactStructuralMechanicsApplication import alm_contact_process
from KratosMultiphysics.ContactStructuralMechanicsApplication import (
    contact_structural_mechanics_static_solver as static_solver,
)

from demos.studies.accuracy.peer import Answer, Given, Solve, run

DISPLACEMENT = (Kratos.DISPLACEMENT_X, Kratos.DISPLACEMENT_Y, Kratos.DISPLACEMENT_Z)
# By dimension and number of nodes of a facet
CONDITIONS = {
    (2, 2): "LineCondition2D2N",
    (3, 3): "SurfaceCondition3D3N",
    (3, 4): "SurfaceCondition3D4N",
}
SOLVER = """{
    "solver_type": "static",
    "model_part_name": "Structure",
    "domain_size": 2,
    "echo_level": 0,
    "analysis_type": "non_linear",
    "model_import_settings": {"input_type": "use_input_model_part"},
    "time_stepping": {"time_step": 1.0},
    "contact_settings": {
        "mortar_type": "ALMContactFrictionless",
        "fancy_convergence_criterion": false,
        "contact_residual_relative_tolerance": 1e-8,
        "contact_residual_absolute_tolerance": 1e-14
    },
    "convergence_criterion": "contact_residual_criterion",
    "residual_relative_tolerance": 1e-8,
    "residual_absolute_tolerance": 1e-14,
    "max_iteration": 50,
    "compute_reactions": false,
    "linear_solver_settings": {"solver_type": ""}
}"""
LINEAR_SOLVERS = {"auto": "LinearSolversApplication.sparse_lu", "iterative": "amgcl"}
CONTACT = """{
    "model_part_name": "Structure",
    "contact_model_part": {"0": ["Surfaces"]},
    "assume_master_slave": {"0": ["Slave"]},
    "contact_type": "Frictionless"
}"""


def pose(problem: Given, linear: str = "auto") -> Solve:
    """A function that solves for prescribed displacements, by factors or ``"iterative"``."""
    dim = problem.x.shape[1]
    if (dim, problem.facets.shape[1]) not in CONDITIONS:
        raise NotImplementedError("contact in the plane only with facets of two nodes")
    if problem.finite:
        problem = problem.exchanged()
    model = Kratos.Model()
    part = model.CreateModelPart("Structure")
    part.ProcessInfo[Kratos.DOMAIN_SIZE] = dim
    settings = Kratos.Parameters(SOLVER)
    settings["domain_size"].SetInt(dim)
    name = LINEAR_SOLVERS[linear]
    settings["linear_solver_settings"]["solver_type"].SetString(name)
    solver = static_solver.CreateSolver(model, settings)
    solver.AddVariables()
    solver.ImportModelPart()
    fill(part, problem)
    solver.PrepareModelPart()
    solver.AddDofs()
    fix(part, problem)
    contact = alm_contact_process.ALMContactProcess(model, Kratos.Parameters(CONTACT))
    contact.ExecuteInitialize()
    solver.Initialize()
    contact.ExecuteBeforeSolutionLoop()

    def solve(values: np.ndarray) -> Answer:
        solver.AdvanceInTime(part.ProcessInfo[Kratos.TIME])
        prescribe(part, problem, values)
        contact.ExecuteInitializeSolutionStep()
        solver.InitializeSolutionStep()
        solver.Predict()
        if not solver.SolveSolutionStep():
            raise RuntimeError("Kratos did not converge")
        solver.FinalizeSolutionStep()
        contact.ExecuteFinalizeSolutionStep()
        return answer(part, problem, name)

    return solve


def answer(part: Kratos.ModelPart, problem: Given, linear: str) -> Answer:
    """The present solution, of systems solved by ``linear``."""
    variables = Kratos.VariableUtils()
    dim = problem.x.shape[1]
    u = variables.GetSolutionStepValuesVector(part.Nodes, Kratos.DISPLACEMENT, 0, dim)
    pressure = variables.GetSolutionStepValuesVector(
        part.Nodes, Contact.LAGRANGE_MULTIPLIER_CONTACT_PRESSURE, 0
    )
    scale = part.ProcessInfo[Kratos.SCALE_FACTOR]
    return Answer(
        np.array(u).reshape(-1, dim),
        -scale * np.array(pressure)[problem.slave],
        part.ProcessInfo[Kratos.NL_ITERATION_NUMBER],
        f"mortar, augmented Lagrangian, {linear}",
    )


def fill(part: Kratos.ModelPart, problem: Given) -> None:
    """Create nodes, cells, loads and the two surfaces; Kratos counts from 1."""
    bodies = [material(part, problem, upper) for upper in (False, True)]
    dim = problem.x.shape[1]
    for number, x in enumerate(problem.x.tolist(), 1):
        part.CreateNewNode(number, *x, *(3 - dim) * [0.0])
    kind = "TotalLagrangian" if problem.finite else "SmallDisplacement"
    element = f"{kind}Element{dim}D{problem.cells.shape[1]}N"
    for number, nodes in enumerate((problem.cells + 1).tolist(), 1):
        part.CreateNewElement(element, number, nodes, bodies[int(problem.upper[number - 1])])
    slave = problem.slave[problem.facets]
    condition = CONDITIONS[dim, slave.shape[1]]
    conditions = [(condition, facet) for facet in np.vstack([slave, problem.master]) + 1]
    loaded = np.flatnonzero(np.any(problem.load, axis=1)) + 1
    conditions += [(f"PointLoadCondition{dim}D1N", [node]) for node in loaded]
    for number, (kind, nodes) in enumerate(conditions, 1):
        part.CreateNewCondition(kind, number, [int(node) for node in nodes], bodies[1])
    surfaces, mine = part.CreateSubModelPart("Surfaces"), part.CreateSubModelPart("Slave")
    both = np.union1d(slave, problem.master) + 1
    surfaces.AddNodes(both.tolist())
    surfaces.AddConditions(list(range(1, len(slave) + len(problem.master) + 1)))
    mine.AddNodes((problem.slave + 1).tolist())
    mine.AddConditions(list(range(1, len(slave) + 1)))


def material(part: Kratos.ModelPart, problem: Given, upper: bool) -> Kratos.Properties:
    """Properties of a body."""
    factor = 1.0 if upper else problem.stiffness
    properties = part.CreateNewProperties(1 + int(upper))
    properties.SetValue(Kratos.YOUNG_MODULUS, factor * problem.E)
    properties.SetValue(Kratos.POISSON_RATIO, problem.nu)
    properties.SetValue(Kratos.THICKNESS, 1.0)
    source, kind = Structural, "LinearElastic"
    if problem.finite:
        source = import_module("KratosMultiphysics.ConstitutiveLawsApplication")
        kind = "HyperElastic"
    dim = problem.x.shape[1]
    law = getattr(source, f"{kind}{'PlaneStrain' if dim == 2 else ''}{dim}DLaw")
    properties.SetValue(Kratos.CONSTITUTIVE_LAW, law())
    return properties


def fix(part: Kratos.ModelPart, problem: Given) -> None:
    """Fix the prescribed dofs; apply the loads."""
    for node in np.flatnonzero(np.any(problem.load, axis=1)).tolist():
        part.GetNode(node + 1).SetSolutionStepValue(
            Structural.POINT_LOAD, [*problem.load[node], 0.0][:3]
        )
    for node, component in np.argwhere(problem.prescribed).tolist():
        part.GetNode(node + 1).Fix(DISPLACEMENT[component])


def prescribe(part: Kratos.ModelPart, problem: Given, values: np.ndarray) -> None:
    """Set the prescribed displacements."""
    for node, component in np.argwhere(problem.prescribed).tolist():
        place, name = part.GetNode(node + 1), DISPLACEMENT[component]
        place.SetSolutionStepValue(name, values[node, component])


if __name__ == "__main__":
    Kratos.Logger.GetDefaultOutput().SetSeverity(Kratos.Logger.Severity.WARNING)
    run(f"Kratos {version('KratosMultiphysics')}", pose, ("P1", "Q1"))
