# SPDX-License-Identifier: MIT
"""Parameters of contact laws that vary in space, evaluated at the slave nodes."""

from __future__ import annotations

from functools import cached_property, partial
from typing import Any

import numpy as np

from dolfinx import fem

from fenics_mortar.contact.instant import check_numbers
from fenics_mortar.contact.law import Law
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import call_together, check_same, format_point


class Parameters:
    """Evaluation of the parameters in ``Law.fields`` that are not numbers.

    Args:
        space: Nodes and dofs of the displacement.
        slave: The slave surface.
    """

    def __init__(self, space: DisplacementSpace, slave: Surface) -> None:
        self._space, self._slave = space, slave

    def sample(self, law: Law) -> dict[str, Array]:
        """Values at the slave nodes by name, shape (slave nodes,) each [its unit] (collective).

        Raises:
            Exception: Any error of a user's function, on all ranks.
            ValueError: If values are not finite, not one per slave node, or not allowed; or if a
                function of dolfinx is not scalar and continuous, on the mesh of the problem.
            MortarError: If values differ between ranks.
        """
        comm, sampled = self._slave.comm, {}
        for name, value in law.varying.items():
            if isinstance(value, fem.Function):
                call_together(comm, f"{law!r}", partial(self._check_function, law, name, value))
                value = self._at_nodes(value)
            values = call_together(comm, f"{law!r}", partial(self._values, law, name, value))
            check_same(comm, [(f"{name} of {law!r}", values)])
            sampled[name] = values
        return sampled

    def _values(self, law: Law, name: str, value: Any) -> Array:
        """One parameter at the slave nodes, checked (local)."""
        found = value(self._slave.X.copy()) if callable(value) else value
        numbers = check_numbers(law, name, found, self._slave.num_nodes)
        try:
            law.check_field(name, numbers)
        except ValueError as error:
            low, high = (
                f"{numbers[j]:g} at {format_point(self._slave.X[j])}"
                for j in (numbers.argmin(), numbers.argmax())
            )
            on = f"on '{self._slave.name}' it is {low} and {high}"
            raise ValueError(f"{law!r}: {error} ({on})") from error
        return numbers

    def _check_function(self, law: Law, name: str, function: fem.Function) -> None:
        """Raise for functions on another mesh, vectors and discontinuous functions (local)."""
        V, mesh = function.function_space, self._space.V.mesh
        per_cell = V.dofmap.dof_layout.num_dofs
        cells = mesh.topology.index_map(mesh.topology.dim).size_global
        whole = V.dofmap.index_map.size_global
        if V.mesh is not mesh or function.ufl_shape != () or (whole == cells * per_cell > 1):
            raise ValueError(
                f"{law!r}: {name} is {function}; expected a scalar and continuous function on the "
                "mesh of the problem"
            )

    @cached_property
    def _scalar(self) -> tuple[fem.Function, Indices]:
        """A function of one component of the displacement's space, and local nodes of its dofs."""
        V, dofs = self._space.V.sub(0).collapse()
        return fem.Function(V), np.asarray(dofs, np.int64) // 2

    def _at_nodes(self, function: fem.Function) -> Array:
        """Values of a function at the slave nodes (collective)."""
        scalar, nodes = self._scalar
        scalar.interpolate(function)
        scalar.x.scatter_forward()
        values = np.zeros(len(self._space.dofs))
        values[nodes] = scalar.x.array
        return self._slave.gather(self._space.spread(values))[:, 0]
