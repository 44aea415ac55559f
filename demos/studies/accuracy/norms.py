# SPDX-License-Identifier: MIT
"""Distances of a solved problem from its exact solution, all relative."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

import ufl

from demos.studies.accuracy.posed import Posed
from fenics_mortar.utils import compat

# Values (n,) at reference positions (2, n)
Traction = Callable[[np.ndarray], np.ndarray]
# Gauss points per direction of a cell and of a facet
POINTS = 4
FACET_POINTS = 12
# Points of a facet at which the largest error is searched: nodes and points between them. The
# pressure is steep at the end of the contact, and errors are smaller at nodes than between them.
LOOKED_AT = np.linspace(-1.0, 1.0, 25)


def errors(posed: Posed) -> dict[str, float]:
    """All errors, by name, and the certificate's moment of the contact forces."""
    (contact,) = posed.problem.equations.contacts
    found = bulk_errors(posed) | contact_errors(posed, contact.pressure)
    found["torque"] = posed.problem.certificate().pairs[0]["moment"].value
    if posed.shear is not None:
        found["shear"] = traction_error(posed, contact.nodal.z_tau, posed.shear)
    return found


@lru_cache
def cell_rule(triangle: bool) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights on the reference cell: a Gauss rule, collapsed for triangles."""
    x, w = np.polynomial.legendre.leggauss(POINTS)
    x, w = (x + 1) / 2, w / 2
    s, t = (a.ravel() for a in np.meshgrid(x, x, indexing="ij"))
    weights = np.outer(w, w).ravel()
    if triangle:
        return np.stack([s, t * (1 - s)], axis=1), weights * (1 - s)
    return np.stack([s, t], axis=1), weights


def bulk_errors(posed: Posed) -> dict[str, float]:
    """Errors of the displacement: energy norm of linear elasticity, and L2."""
    mesh, u = posed.data.mesh, posed.u
    points, weights = cell_rule(compat.cell_name(mesh) == "triangle")
    x, J = ufl.SpatialCoordinate(mesh), ufl.JacobianDeterminant(mesh)
    grad = ufl.grad(u)
    parts = [x[0], x[1], u[0], u[1], *(grad[i, j] for i in range(2) for j in range(2)), J]
    expression = compat.create_expression(ufl.as_vector(parts), points)
    cells = np.arange(mesh.topology.index_map(2).size_local, dtype=np.int32)
    values = compat.evaluate_expression(expression, mesh, cells).reshape(-1, len(parts)).T
    on_slave = np.zeros(cells.size, bool)
    on_slave[posed.data.cell_tags.find(posed.data.body_tag(posed.slave))] = True
    on_slave = np.repeat(on_slave, len(weights))
    volume = np.abs(values[8]) * np.tile(weights, cells.size)
    exact, gradient = posed.displacement(values[:2], on_slave), posed.gradient(values[:2], on_slave)
    off = values[2:4] - exact
    off_gradient = values[4:8].reshape(2, 2, -1) - gradient

    def energy(H: np.ndarray) -> float:
        mu, lmbda = posed.lame
        strain = (H + H.transpose(1, 0, 2)) / 2
        density = 2 * mu * (strain**2).sum(axis=(0, 1)) + lmbda * (H[0, 0] + H[1, 1]) ** 2
        return float(density @ volume)

    return {
        "energy": np.sqrt(energy(off_gradient) / energy(gradient)),
        "displacement": np.sqrt((off**2).sum(axis=0) @ volume / ((exact**2).sum(axis=0) @ volume)),
    }


def contact_errors(posed: Posed, pressure: np.ndarray) -> dict[str, float]:
    """Errors of the pressure interpolated between its values at the slave's nodes (n,)."""
    points, weights = np.polynomial.legendre.leggauss(FACET_POINTS)
    x, measure, found, exact = drawn(posed, pressure, posed.pressure, points)
    measure = weights * measure
    _, _, found_there, exact_there = drawn(posed, pressure, posed.pressure, LOOKED_AT)
    (contact,) = posed.problem.equations.contacts
    result = {
        "pressure": traction_error(posed, pressure, posed.pressure),
        "pressure max": np.abs(found_there - exact_there).max()
        / posed.pressure(contact.slave.X.T).max(),
        "resultant": abs((measure * found).sum() / (measure * exact).sum() - 1),
    }
    if np.isfinite(posed.half_width):
        second = (measure * found * x[0] ** 2).sum() / (measure * found).sum()
        result["half-width"] = abs(2 * np.sqrt(second) / posed.half_width - 1)
    return result


def traction_error(posed: Posed, nodal: np.ndarray, exact: Traction) -> float:
    """Error in L2 of a pressure or shear interpolated between values at the slave's nodes (n,)."""
    points, weights = np.polynomial.legendre.leggauss(FACET_POINTS)
    _, measure, found, right = drawn(posed, nodal, exact, points)
    measure = weights * measure
    return float(np.sqrt((measure * (found - right) ** 2).sum() / (measure * right**2).sum()))


def drawn(posed: Posed, nodal: np.ndarray, exact: Traction, s: np.ndarray) -> tuple:
    """Interpolated nodal values (n,) at points s (q,) of all m facets that carry them.

    Returns:
        Reference positions, shape (2, m, q), d(length)/ds, computed and exact value, shape (m, q).
    """
    (contact,) = posed.problem.equations.contacts
    nodes = contact.slave.facets
    nodes = nodes[contact.multiplier_nodes[nodes[:, [0, -1]]].all(axis=1)]
    shape, slope = facet_shapes(nodes.shape[1], s)
    x = np.einsum("qk,mkc->cmq", shape, contact.slave.X[nodes])
    measure = np.hypot(*np.einsum("qk,mkc->cmq", slope, contact.slave.X[nodes]))
    found = np.einsum("qk,mk->mq", shape, nodal[nodes])
    return x, measure, found, exact(x.reshape(2, -1)).reshape(found.shape)


def facet_shapes(size: int, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions of a facet's nodes along the curve at s in [-1, 1], and slopes, (q, size)."""
    if size == 2:
        return np.stack([1 - s, 1 + s], 1) / 2, np.tile([-0.5, 0.5], (s.size, 1))
    shape = [s * (s - 1) / 2, 1 - s**2, s * (s + 1) / 2]
    return np.stack(shape, 1), np.stack([s - 0.5, -2 * s, s + 0.5], 1)
