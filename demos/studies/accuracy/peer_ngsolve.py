# SPDX-License-Identifier: MIT
"""The problem of Hertz, solved by NGSolve's contact with a penalty energy.

    python3 -m venv --system-site-packages ngsolve
    ngsolve/bin/pip install ngsolve mkl
    ngsolve/bin/python -m demos.studies.accuracy.peer_ngsolve

``ContactBoundary`` integrates the energy of the overlap over the slave surface, as in NGSolve's
tutorial on contact. Newton's method is NGSolve's own, factors are those of MKL's Pardiso; bodies
start from a translation, as in the tutorial. Pairs of points are found before Newton's method,
twice where the deformed surfaces are in contact: once, the force of ironing is off by 3 % instead
of 1.7 %; in each iteration, Newton's method does not converge. The user chooses penalty and
quadrature: the pressure of Hertz is worse with a penalty of 1 or 100 instead of 20.
"""

from __future__ import annotations

from importlib.metadata import version

import netgen.meshing as netgen
import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from ngsolve.nonlinearsolvers import NewtonSolver
from scipy.sparse.linalg import splu

from demos.studies.accuracy.peer import Answer, Given, Solve, areas, run

# Corners of NGSolve's reference cells, by dimension and number of corners
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
CORNERS = {
    (2, 3): [(1, 0), (0, 1), (0, 0)],
    (2, 4): SQUARE,
    (3, 4): [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0)],
    (3, 8): [(*corner, height) for height in (0, 1) for corner in SQUARE],
}
# Penalty times facet length over Young's modulus [1], order of the quadrature of the overlap
PENALTY, ORDER = 20.0, 8


def pose(problem: Given) -> Solve:
    """A function that solves for prescribed displacements."""
    space = Space(problem)
    u, form, load = space.fes.TrialFunction(), ng.BilinearForm(space.fes), ng.LinearForm(space.fes)
    for upper, body in ((True, "upper"), (False, "lower")):
        energy = energy_density(u, *problem.lame(upper), problem.finite)
        form += ng.Variation(energy.Compile() * ng.dx(body))
    load.Assemble()
    load.vec.FV().NumPy()[:] = space.moments(problem.load)
    overlap, contact = ng.BilinearForm(space.fes), space.contact(problem.E)
    solver = NewtonSolver(form, space.u, load, space.free, inverse="pardiso")
    tolerance = 1e-8 * np.sqrt(problem.E) * np.abs(problem.values).max()

    def solve(values: np.ndarray) -> Answer:
        space.put(space.u, moved(problem, space.nodal(space.u), values))
        iterations = 0
        for _ in range(2 if problem.deformed else 1):
            contact.Update(space.u, form, ORDER)
            failed, more = solver.Solve(maxit=50, maxerr=tolerance)
            iterations += more
            if failed:
                raise RuntimeError("NGSolve did not converge")
        contact.Update(space.u, overlap, ORDER)
        overlap.Apply(space.u.vec, solver.r)
        forces = space.forces(solver.r)[problem.slave]
        pressure = np.linalg.norm(forces, axis=1) / areas(problem)
        how = "contact by penalty, factors by pardiso"
        return Answer(space.nodal(space.u), pressure, iterations, how)

    return solve


def moved(problem: Given, u: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Displacement to start from: bodies follow the mean of their prescribed displacements."""
    u = u.copy()
    for upper in (False, True):
        nodes = np.unique(problem.cells_of(upper))
        on = nodes[problem.prescribed[nodes].all(axis=1)]
        u[nodes] += (values[on] - u[on]).mean(axis=0)
    return np.where(problem.prescribed, values, u)


def energy_density(u: ng.CF, mu: float, lmbda: float, finite: bool) -> ng.CF:
    """Energy of linear elasticity or of the neo-Hookean law per area [stress]."""
    if not finite:
        strain = ng.Sym(ng.Grad(u))
        return mu * ng.InnerProduct(strain, strain) + lmbda / 2 * ng.Trace(strain) ** 2
    F = ng.Id(u.dim) + ng.Grad(u)
    log = ng.log(ng.Det(F))
    return mu / 2 * (ng.InnerProduct(F, F) - u.dim) - mu * log + lmbda / 2 * log**2


class Space:
    """NGSolve's mesh and space, and the displacement.

    Attributes:
        mesh: The mesh, with the boundaries "slave" and "master".
        fes: The space.
        basis: Its basis functions of one component at our nodes, sparse, shape (n, n).
        free: Dofs that are not prescribed.
        facet: Shortest facet of the slave [length].
        u: The displacement.
    """

    def __init__(self, problem: Given) -> None:
        self._dim, count = problem.x.shape[1], problem.cells.shape[1]
        corners = {6: 3, 9: 4}.get(count, count)
        order = 1 if corners == count else 2
        self.mesh = ng.Mesh(netgen_mesh(problem, corners))
        self.fes = ng.VectorH1(self.mesh, order=order)
        self.basis = basis_at_nodes(ng.H1(self.mesh, order=order), problem, corners)
        self._factors = splu(self.basis)
        node = np.asarray(abs(self.basis).argmax(axis=0)).ravel()
        self.free = ng.BitArray((~problem.prescribed[node]).T.ravel().tolist())
        ends = problem.x[problem.slave[problem.facets]]
        self.facet = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).min()
        self.u = ng.GridFunction(self.fes)
        if order == 2:
            self._curved = ng.GridFunction(self.fes)
            self.put(self._curved, problem.x)
            self._curved.vec.FV().NumPy().reshape(self._dim, -1)[:, : self.mesh.nv] = 0.0
            self.mesh.SetDeformation(self._curved)

    def put(self, function: ng.GridFunction, values: np.ndarray) -> None:
        """Set a function to nodal values, shape (n, d)."""
        function.vec.FV().NumPy()[:] = self._factors.solve(values).T.ravel()

    def nodal(self, function: ng.GridFunction) -> np.ndarray:
        """Nodal values of a function, shape (n, d)."""
        return self.basis @ function.vec.FV().NumPy().reshape(self._dim, -1).T

    def moments(self, forces: np.ndarray) -> np.ndarray:
        """Work of nodal forces (n, d) on NGSolve's basis functions, shape (d n,)."""
        return (self.basis.T @ forces).T.ravel()

    def forces(self, moments: ng.BaseVector) -> np.ndarray:
        """Nodal forces of such work, shape (n, d)."""
        return self._factors.solve(moments.FV().NumPy().reshape(self._dim, -1).T, trans="T")

    def contact(self, E: float) -> ng.ContactBoundary:
        """The contact with its energy."""
        contact = ng.ContactBoundary(*map(self.mesh.Boundaries, ("slave", "master")))
        x, u = ng.CF((ng.x, ng.y, ng.z)[: self._dim]), self.fes.TrialFunction()
        overlap = (x + u - x.Other() - u.Other()) * contact.normal
        penalty = PENALTY * E / self.facet
        contact.AddEnergy(ng.IfPos(overlap, penalty / 2 * overlap**2, 0))
        return contact


def netgen_mesh(problem: Given, corners: int) -> netgen.Mesh:
    """Mesh of straight cells with the two surfaces."""
    dim = problem.x.shape[1]
    mesh = netgen.Mesh(dim=dim)
    used, number = np.unique(problem.cells[:, :corners]), np.zeros(len(problem.x), np.int32)
    number[used] = np.arange(used.size)
    mesh.AddPoints(np.pad(problem.x[used], ((0, 0), (0, 3 - dim))))
    for body, upper in (("lower", False), ("upper", True)):
        region = mesh.AddRegion(body, dim=dim)
        mesh.AddElements(dim, region, number[problem.cells_of(upper)[:, :corners]], base=0)
    for surface, facets in (("slave", problem.slave[problem.facets]), ("master", problem.master)):
        region = mesh.AddRegion(surface, dim=dim - 1)
        shape = facets[:, :2] if dim == 2 else facets[:, ::-1]
        mesh.AddElements(dim - 1, region, number[shape], base=0)
    return mesh


def basis_at_nodes(scalar: ng.FESpace, problem: Given, corners: int) -> sp.csc_matrix:
    """Values of NGSolve's basis functions (columns) at our nodes (rows)."""
    cells = np.concatenate([problem.cells_of(False), problem.cells_of(True)])
    places = np.array(CORNERS[problem.x.shape[1], corners], float)
    middles = (places + np.roll(places, -1, axis=0)) / 2
    places = np.vstack([places, middles, places.mean(axis=0)])[: cells.shape[1]]
    shape = scalar.GetFE(ng.ElementId(0))
    values = np.array([list(shape.CalcShape(*place)) for place in places])
    dofs = np.array([scalar.GetDofNrs(cell) for cell in scalar.mesh.Elements()])
    rows = np.repeat(cells, dofs.shape[1], axis=1).ravel()
    columns = np.tile(dofs, cells.shape[1]).ravel()
    _, first = np.unique(rows * len(problem.x) + columns, return_index=True)
    entries = np.tile(values.ravel(), len(cells))[first]
    basis = sp.csc_matrix((entries, (rows[first], columns[first])))
    basis.eliminate_zeros()
    return basis


if __name__ == "__main__":
    run(f"NGSolve {version('ngsolve')}", pose, ("P1", "Q1", "P2", "Q2"))
