# SPDX-License-Identifier: MIT
"""Scales of the unknowns and equations of mixed functions, from the bulk tangent.

One unit of an unknown other than the displacement causes forces of the size of the stiffness, or
residuals that are equivalent to such a force in the other equations; the residual of an equation is
scaled such that one unit of an unknown causes such a force. Results do not depend on the units of
measurement.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Array


def find_units(K: PETSc.Mat, space: DisplacementSpace, stiffness: float) -> tuple[Array, Array]:
    """Find the scales of all owned unknowns and equations (collective).

    Args:
        K: Bulk tangent, as assembled.
        space: The displacement's nodes and dofs.
        stiffness: Force of a displacement of one [stress].

    Returns:
        Amount of each unknown that is equivalent to a displacement of one, and factor that turns
        the residual of each equation into a force, each (owned dofs,); one for displacements.
    """
    units, to_force = np.zeros((2, space.num_owned))
    units[space.owned_dofs] = to_force[space.owned_dofs] = 1.0
    transpose = K.transpose(PETSc.Mat())
    for _ in range(space.whole.num_sub_spaces):  # those found last may be needed for to_force
        sizes = _row_sizes(transpose, to_force), _row_sizes(K, units)
        for known, size in zip((units, to_force), sizes, strict=True):
            reached = (known == 0.0) & (size > 0.0)
            known[reached] = stiffness / size[reached]
    transpose.destroy()
    units, to_force = (np.where(a > 0.0, a, 1.0) for a in (units, to_force))
    return units, to_force


def _row_sizes(matrix: PETSc.Mat, columns: Array) -> Array:
    """Largest absolute entry in each row of matrix diag(columns), shape (owned rows,)."""
    scale = matrix.createVecRight()
    scale.array[:] = columns
    scaled = matrix.copy()
    scaled.diagonalScale(None, scale)
    starts, _, values = scaled.getValuesCSR()
    scaled.destroy()
    rows = np.repeat(np.arange(columns.size), np.diff(starts))
    sizes = np.zeros(columns.size)
    np.maximum.at(sizes, rows, np.abs(values))
    return sizes
