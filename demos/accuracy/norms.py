# SPDX-License-Identifier: MIT
"""Distances of a solved problem from its exact solution, all relative."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scenes_exact import Posed

import ufl

from fenics_mortar import compat

# Gauss points per direction of a cell and of a facet
POINTS = 4
FACET_POINTS = 12


def errors(posed: Posed) -> dict[str, float]:
    """All errors, by name."""
    return {**bulk_errors(posed), **contact_errors(posed)}


@lru_cache
def cell_rule(triangle: bool) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights on the reference cell, of Gauss or made of it by collapsing a side."""
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


def contact_errors(posed: Posed) -> dict[str, float]:
    """Errors of the pressure, as drawn through its nodal values, of its sum and of its width."""
    (contact,) = posed.problem.contacts
    nodes = contact.slave.facets
    nodes = nodes[contact.carries[nodes].all(axis=1)]
    shape, slope, w = facet_rule(nodes.shape[1])
    X = np.einsum("qk,mkc->mqc", shape, contact.slave.X[nodes])
    measure = w * np.hypot(*np.einsum("qk,mkc->cmq", slope, contact.slave.X[nodes]))
    found = np.einsum("qk,mk->mq", shape, contact.pressure[nodes])
    exact = posed.pressure(X.reshape(-1, 2).T).reshape(found.shape)
    at_nodes = posed.pressure(contact.slave.X.T)
    nodal = np.abs(contact.pressure - at_nodes)[contact.carries].max()
    integral = (measure * exact).sum()
    result = {
        "pressure": np.sqrt((measure * (found - exact) ** 2).sum() / (measure * exact**2).sum()),
        "pressure max": nodal / at_nodes.max(),
        "resultant": abs((measure * found).sum() / integral - 1),
        "torque": posed.problem.certificate().pairs[0].moment,
    }
    if np.isfinite(posed.half_width):
        second = (measure * found * X[..., 0] ** 2).sum() / (measure * found).sum()
        result["half-width"] = abs(2 * np.sqrt(second) / posed.half_width - 1)
    return result


def facet_rule(size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shape functions (points, size) on a facet, their slopes, and Gauss weights."""
    s, w = np.polynomial.legendre.leggauss(FACET_POINTS)
    if size == 2:
        return np.stack([1 - s, 1 + s], 1) / 2, np.tile([-0.5, 0.5], (s.size, 1)), w
    middle = 1 if size == 3 else None
    shape, slope = [s * (s - 1) / 2, s * (s + 1) / 2], [s - 0.5, s + 0.5]
    shape.insert(middle, 1 - s**2)
    slope.insert(middle, -2 * s)
    return np.stack(shape, 1), np.stack(slope, 1), w
