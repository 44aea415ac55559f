# SPDX-License-Identifier: MIT
"""The problem of Hertz, solved by GetFEM's integral contact between nonmatching meshes.

    apt install python3-getfem
    python3 -m demos.studies.accuracy.peer_getfem

The multiplier is of degree 1, continuous, on the slave surface; the formulation is the symmetric
augmented Lagrangian one, its parameter Young's modulus, the range recommended by GetFEM's manual.
"""

from __future__ import annotations

import getfem as gf
import numpy as np
from scipy.spatial import cKDTree

from demos.studies.accuracy.peer import Answer, Given, run

SIDES, CONTACT, PRESCRIBED = 1, 2, 3
SYMMETRIC = 2
# By number of nodes of a cell: geometry, and our nodes in GetFEM's order
SHAPES = {
    3: ("GT_PK(2,1)", "FEM_PK(2,1)", "IM_TRIANGLE(2)", [0, 1, 2]),
    4: ("GT_QK(2,1)", "FEM_QK(2,1)", "IM_GAUSS_PARALLELEPIPED(2,3)", [0, 1, 3, 2]),
    6: ("GT_PK(2,2)", "FEM_PK(2,2)", "IM_TRIANGLE(4)", [0, 3, 1, 5, 4, 2]),
    9: ("GT_QK(2,2)", "FEM_QK(2,2)", "IM_GAUSS_PARALLELEPIPED(2,5)", [0, 4, 1, 7, 8, 5, 3, 6, 2]),
}


def solve(problem: Given) -> Answer:
    """Solve from the arrays."""
    model = gf.Model("real")
    mu = problem.E / (2 * (1 + problem.nu))
    model.add_initialized_data("mu", [mu])
    model.add_initialized_data("lmbda", [2 * mu * problem.nu / (1 - 2 * problem.nu)])
    model.add_initialized_data("r", [problem.E])
    bodies = [add_body(model, problem, number) for number in (1, 2)]
    mesh, integration, _, _ = bodies[0]
    multipliers = gf.MeshFem(mesh, 1)
    multipliers.set_classical_fem(1)
    model.add_filtered_fem_variable("pressure", multipliers, CONTACT)
    model.add_integral_contact_between_nonmatching_meshes_brick(
        integration, "u1", "u2", "pressure", "r", CONTACT, CONTACT, SYMMETRIC
    )
    iterations, _ = model.solve(
        "max_res", 1e-8 * np.abs(problem.load).sum(), "max_iter", 50, "lsolver", "mumps"
    )
    u = np.zeros_like(problem.x)
    for number, (_, _, _, nodes) in enumerate(bodies, 1):
        u[nodes] = model.variable(f"u{number}").reshape(-1, 2)
    return Answer(u, pressure(model, multipliers, problem), int(iterations))


def add_body(model: gf.Model, problem: Given, number: int) -> tuple:
    """Add the upper body, 1, or the lower one; return mesh, integration, space and our nodes."""
    cells = problem.cells[problem.upper == (number == 1)]
    geometry, element, rule, order = SHAPES[cells.shape[1]]
    mesh = gf.Mesh("empty", 2)
    mesh.add_convex(gf.GeoTrans(geometry), problem.x[cells[:, order]].transpose(2, 1, 0))
    space, integration = gf.MeshFem(mesh, 2), gf.MeshIm(mesh, gf.Integ(rule))
    space.set_fem(gf.Fem(element))
    places = space.basic_dof_nodes()[:, ::2].T
    used = np.unique(cells)
    nodes = used[cKDTree(problem.x[used]).query(places)[1]]
    surface = problem.slave if number == 1 else np.unique(problem.master)
    for region, on in (
        (CONTACT, surface),
        (PRESCRIBED, np.flatnonzero(problem.prescribed.any(axis=1))),
    ):
        points = mesh.pid_from_coords(problem.x[np.intersect1d(on, used)].T, 1e-9)
        mesh.set_region(region, mesh.faces_from_pid(points))
    name = f"u{number}"
    model.add_fem_variable(name, space)
    model.add_isotropic_linearized_elasticity_brick(integration, name, "lmbda", "mu")
    model.add_initialized_fem_data(f"prescribed{number}", space, problem.values[nodes].ravel())
    model.add_Dirichlet_condition_with_simplification(name, PRESCRIBED, f"prescribed{number}")
    model.add_explicit_rhs(name, problem.load[nodes].ravel())
    return mesh, integration, space, nodes


def pressure(model: gf.Model, multipliers: gf.MeshFem, problem: Given) -> np.ndarray:
    """Pressure at the slave's nodes, (k,); at the middle of a facet it is the mean of its ends."""
    on = multipliers.basic_dof_on_region(CONTACT)
    places = multipliers.basic_dof_nodes()[:, on].T
    values = -model.variable("pressure")
    ends = problem.facets[:, :2]
    nearest = cKDTree(places).query(problem.x[problem.slave])[1]
    found = values[nearest]
    if problem.facets.shape[1] == 3:
        found[problem.facets[:, 2]] = found[ends].mean(axis=1)
    return found


if __name__ == "__main__":
    gf.util_trace_level(0)
    run("GetFEM", solve, ("P1", "Q1", "P2", "Q2"))
