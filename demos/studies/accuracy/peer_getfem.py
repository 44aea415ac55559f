# SPDX-License-Identifier: MIT
"""The problem of Hertz, solved by GetFEM's integral contact between nonmatching meshes.

    apt install python3-getfem
    python3 -m demos.studies.accuracy.peer_getfem

The multiplier is of degree 1, continuous, on the slave surface; the formulation is the symmetric
augmented Lagrangian one, its parameter Young's modulus, the range recommended by GetFEM's manual.
This type of contact does not detect surfaces that are separated at first; for contact of the
deformed surfaces ray tracing is used instead, with line search, without which it does not converge.
"""

from __future__ import annotations

from typing import NamedTuple

import getfem as gf
import numpy as np
from scipy.spatial import cKDTree

from demos.studies.accuracy.peer import Answer, Given, Solve, run

SIDES, CONTACT, PRESCRIBED, HELD = 1, 2, 3, 4
PENALTY = 1e6  # of symmetry planes, over Young's modulus [1 / length]
SYMMETRIC = 2
# Release distance of contact by ray tracing over the longest facet [1]
RELEASE = 3.0
# By dimension and number of nodes of a cell: geometry, and our nodes in GetFEM's order
SHAPES = {
    (3, 4): ("GT_PK(3,1)", "FEM_PK(3,1)", "IM_TETRAHEDRON(2)", [0, 1, 2, 3]),
    (3, 8): (
        "GT_QK(3,1)",
        "FEM_QK(3,1)",
        "IM_GAUSS_PARALLELEPIPED(3,3)",
        [0, 1, 3, 2, 4, 5, 7, 6],
    ),
    (2, 3): ("GT_PK(2,1)", "FEM_PK(2,1)", "IM_TRIANGLE(2)", [0, 1, 2]),
    (2, 4): ("GT_QK(2,1)", "FEM_QK(2,1)", "IM_GAUSS_PARALLELEPIPED(2,3)", [0, 1, 3, 2]),
    (2, 6): ("GT_PK(2,2)", "FEM_PK(2,2)", "IM_TRIANGLE(4)", [0, 3, 1, 5, 4, 2]),
    (2, 9): (
        "GT_QK(2,2)",
        "FEM_QK(2,2)",
        "IM_GAUSS_PARALLELEPIPED(2,5)",
        [0, 4, 1, 7, 8, 5, 3, 6, 2],
    ),
}


class Body(NamedTuple):
    """Mesh, integration method and, by GetFEM's nodes, ours."""

    mesh: gf.Mesh
    integration: gf.MeshIm
    nodes: np.ndarray


def pose(problem: Given) -> Solve:
    """A function that solves for prescribed displacements."""
    model = gf.Model("real")
    model.add_initialized_data("r", [problem.E])
    bodies = [add_body(model, problem, number) for number in (1, 2)]
    multipliers = add_contact(model, bodies, problem)
    line_search = ("lsearch", "simplest", "alpha min", 0.3) if problem.deformed else ()
    tolerance = 1e-8 * (np.abs(problem.load).sum() or np.abs(problem.values).max() * problem.E)

    def solve(values: np.ndarray) -> Answer:
        for number, body in enumerate(bodies, 1):
            model.set_variable(f"prescribed{number}", values[body.nodes].ravel())
        iterations, converged = model.solve(
            *("max_res", tolerance, "max_iter", 50, "lsolver", "mumps"), *line_search
        )
        if not converged:
            raise RuntimeError("GetFEM did not converge")
        u = np.zeros_like(problem.x)
        for number, body in enumerate(bodies, 1):
            u[body.nodes] = model.variable(f"u{number}").reshape(-1, u.shape[1])
        kind = "ray tracing" if problem.deformed else "integral contact"
        solver = f"{kind}, augmented Lagrangian, factors by mumps"
        return Answer(u, pressure(model, multipliers, problem), int(iterations), solver)

    return solve


def add_contact(model: gf.Model, bodies: list[Body], problem: Given) -> gf.MeshFem:
    """Add the multiplier and the contact; return the space of the multiplier."""
    slave, master = bodies
    dim = problem.x.shape[1]
    multipliers = gf.MeshFem(slave.mesh, dim if problem.deformed else 1)
    multipliers.set_classical_fem(1)
    model.add_filtered_fem_variable("pressure", multipliers, CONTACT)
    if not problem.deformed:
        model.add_integral_contact_between_nonmatching_meshes_brick(
            slave.integration, "u1", "u2", "pressure", "r", CONTACT, CONTACT, SYMMETRIC
        )
        return multipliers
    ends = problem.x[problem.slave[problem.facets[:, :2]]]
    release = RELEASE * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max()
    brick = model.add_integral_large_sliding_contact_brick_raytracing("r", release)
    model.add_slave_contact_boundary_to_large_sliding_contact_brick(
        brick, slave.integration, CONTACT, "u1", "pressure"
    )
    model.add_master_contact_boundary_to_large_sliding_contact_brick(
        brick, master.integration, CONTACT, "u2"
    )
    return multipliers


def add_body(model: gf.Model, problem: Given, number: int) -> Body:
    """Add the upper body, 1, or the lower one."""
    cells = problem.cells_of(number == 1)
    dim = problem.x.shape[1]
    geometry, element, rule, order = SHAPES[dim, cells.shape[1]]
    mesh = gf.Mesh("empty", dim)
    mesh.add_convex(gf.GeoTrans(geometry), problem.x[cells[:, order]].transpose(2, 1, 0))
    space, integration = gf.MeshFem(mesh, dim), gf.MeshIm(mesh, gf.Integ(rule))
    space.set_fem(gf.Fem(element))
    places = space.basic_dof_nodes()[:, ::dim].T
    used = np.unique(cells)
    nodes = used[cKDTree(problem.x[used]).query(places)[1]]
    surface = problem.slave if number == 1 else np.unique(problem.master)
    whole = problem.prescribed.all(axis=1)
    held = np.flatnonzero(whole if dim == 3 else problem.prescribed.any(axis=1))
    for region, on in ((CONTACT, surface), (PRESCRIBED, held)):
        points = mesh.pid_from_coords(problem.x[np.intersect1d(on, used)].T, 1e-9)
        mesh.set_region(region, mesh.faces_from_pid(points))
    u, mu, lmbda = (f"{name}{number}" for name in ("u", "mu", "lmbda"))
    model.add_fem_variable(u, space)
    for name, value in zip((mu, lmbda), problem.lame(number == 1)):
        model.add_initialized_data(name, [value])
    if problem.finite:
        F = f"(Id({dim})+Grad_{u})"
        stress = f"{mu}*({F}-Inv({F})')+{lmbda}*log(Det({F}))*Inv({F})'"
        model.add_nonlinear_term(integration, f"({stress}):Grad_Test_{u}")
    else:
        model.add_isotropic_linearized_elasticity_brick(integration, u, lmbda, mu)
    model.add_initialized_fem_data(f"prescribed{number}", space, problem.values[nodes].ravel())
    model.add_Dirichlet_condition_with_simplification(u, PRESCRIBED, f"prescribed{number}")
    model.add_explicit_rhs(u, problem.load[nodes].ravel())
    for component in range(dim if dim == 3 else 0):
        on = np.flatnonzero(problem.prescribed[:, component] & ~whole)
        slide(model, integration, u, mesh, problem.x[np.intersect1d(on, used)], component)
    return Body(mesh, integration, nodes)


def slide(
    model: gf.Model, integration: gf.MeshIm, u: str, mesh: gf.Mesh, x: np.ndarray, component: int
) -> None:
    """Hold one component on the symmetry plane on which nodes are at ``x``, by a penalty."""
    if len(x) == 0:
        return
    plane = np.isclose(mesh.pts()[component], x[0, component])
    region, name = HELD + component, f"H{component}{u}"
    mesh.set_region(region, mesh.faces_from_pid(np.flatnonzero(plane)))
    only = np.diag(np.eye(mesh.dim())[component])
    model.add_initialized_data(name, only.ravel(), only.shape)
    model.add_initialized_data(f"r{name}", np.zeros(mesh.dim()))
    stiffness = PENALTY * model.variable("r")[0]
    model.add_generalized_Dirichlet_condition_with_penalization(
        integration, u, stiffness, region, f"r{name}", name
    )


def pressure(model: gf.Model, multipliers: gf.MeshFem, problem: Given) -> np.ndarray:
    """Pressure at the slave's nodes, (k,); at the middle of a facet it is the mean of its ends."""
    on = multipliers.basic_dof_on_region(CONTACT)
    places = multipliers.basic_dof_nodes()[:, on].T
    values = -model.variable("pressure")
    if problem.deformed:  # a vector at each node
        dim = problem.x.shape[1]
        values, places = np.linalg.norm(values.reshape(-1, dim), axis=1), places[::dim]
    nearest = cKDTree(places).query(problem.x[problem.slave])[1]
    found = values[nearest]
    if problem.x.shape[1] == 2 and problem.facets.shape[1] == 3:
        found[problem.facets[:, 2]] = found[problem.facets[:, :2]].mean(axis=1)
    return found


if __name__ == "__main__":
    gf.util_trace_level(0)
    run("GetFEM", pose, ("P1", "Q1", "P2", "Q2"))
