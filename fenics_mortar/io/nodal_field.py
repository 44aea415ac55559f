# SPDX-License-Identifier: MIT
"""Continuous Lagrange functions evaluated at the nodes of the displacement."""

from __future__ import annotations

from typing import Any

import numpy as np

from dolfinx import fem

from fenics_mortar.bulk.reference_cell import DEGREES
from fenics_mortar.io.shared import owned_cells
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices


class NodalField:
    """A Lagrange function interpolated to the nodes of the displacement (collective).

    Args:
        problem: The problem on whose mesh the function is defined.
        function: A scalar or plane vector function for which ``has_nodes`` is true.
    """

    def __init__(self, problem: ContactProblem, function: fem.Function) -> None:
        V = problem.equations.bulk.V
        self._function, self._is_scalar = function, function.ufl_shape == ()
        self._space, self._parent_dofs = _space_of(function)
        self._own = fem.Function(self._space)
        degree = DEGREES[V.dofmap.dof_layout.num_dofs]
        space = compat.scalar_space if self._is_scalar else compat.vector_space
        self._at_nodes = fem.Function(space(V.mesh, degree))
        cells = owned_cells(problem)
        first = np.unique(cells, return_index=True)[1]
        self._dofs = compat.dofmap(self._at_nodes.function_space)[: len(cells)].ravel()[first]

    def evaluate(self) -> Array:
        """Values [unit of the field] at the nodes of owned cells, shape (nodes,) or (nodes, 2).

        Nodes are in the order of the dofs of the displacement (local).
        """
        self._own.x.array[:] = self._function.x.array[self._parent_dofs]
        self._at_nodes.interpolate(self._own)
        values = self._at_nodes.x.array
        return values[self._dofs] if self._is_scalar else values.reshape(-1, 2)[self._dofs]


def has_nodes(problem: ContactProblem, field: Any) -> bool:
    """Whether a field has values at nodes (collective).

    This holds for scalar and plane vector functions of Lagrange spaces on the mesh of the problem,
    with a degree up to that of the displacement, and for such parts of mixed functions.
    """
    V = problem.equations.bulk.V
    if not isinstance(field, fem.Function) or field.ufl_shape not in ((), (2,)):
        return False
    if field.function_space.mesh is not V.mesh:
        return False
    layout = _space_of(field)[0].dofmap.dof_layout
    degree = DEGREES.get(layout.num_dofs, 0)
    at_vertices = len(layout.entity_dofs(0, 0)) == 1
    return at_vertices and 1 <= degree <= DEGREES[V.dofmap.dof_layout.num_dofs]


def _space_of(function: fem.Function) -> tuple[fem.FunctionSpace, slice | Indices]:
    """Space of a function, or of a part of a mixed one, and its dofs in the array."""
    space = function.function_space
    if not compat.is_sub_space(space):
        return space, slice(None)
    collapsed, dofs = space.collapse()
    return collapsed, np.asarray(dofs, dtype=np.int64)
