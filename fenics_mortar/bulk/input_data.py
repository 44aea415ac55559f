# SPDX-License-Identifier: MIT
"""Checks before each solve: displacement, prescribed values, data of the forms, and the mesh."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mpi4py import MPI

import numpy as np

from dolfinx import fem

from fenics_mortar.utils import compat, errors, ranks
from fenics_mortar.utils.arrays import ROUNDING, Array, Flags, Indices


class InputData:
    """Values that users may change between two solves.

    They are checked before each solve, as are displacement, prescribed values and the mesh.

    Args:
        bulk: The bodies.
        forms: UFL forms whose constants and functions are checked.
    """

    def __init__(self, bulk: Any, forms: Sequence[Any]) -> None:
        self._u, self._bcs, self._space = bulk.u, bulk.bcs, bulk.space
        self._mesh, self._comm = bulk.V.mesh, bulk.comm
        self._constants = list(dict.fromkeys(c for form in forms for c in form.constants()))
        self._coefficients = {c for form in forms for c in form.coefficients()}
        self._loads = self._coefficients - {bulk.u, *bulk.history.functions}
        self._prescribed = fem.Function(bulk.u.function_space)
        self._nodes = self._mesh.geometry.x.copy()
        self._X = bulk.V.tabulate_dof_coordinates()[:, : bulk.space.dim].copy()

    def check(self) -> None:
        """Reject values that are not finite or differ between ranks, and moved meshes (collective).

        Raises:
            MortarError: On all ranks; the message has the value and its position.
        """
        self._check_mesh()
        values = self._u.x.array.copy()
        wrong = (
            "the displacement is not finite at {} nodes, one at {}; reset it, for example to a "
            "copy made before the last solve",
            "the prescribed displacement is not finite at {} nodes, one at {}",
        )
        for message, bcs in zip(wrong, ([], self._bcs), strict=True):
            compat.set_prescribed(values, bcs)
            count, where = self.count_nodes(~np.isfinite(values))
            if count:
                raise errors.MortarError(message.format(count, where))
        data = [(c.value, f"a constant of the residual is {c.value}") for c in self._constants]
        data += [
            (f.x.array, f"function '{f.name}' of the residual is not finite")
            for f in self._coefficients
        ]
        messages = [message for value, message in data if not np.isfinite(value).all()]
        if ranks.on_any_rank(self._comm, bool(messages)):
            everywhere = set().union(*self._comm.allgather(set(messages)))
            raise errors.MortarError("; ".join(sorted(everywhere)))
        same = [("a constant of the residual", c.value) for c in self._constants]
        same += [("a prescribed displacement", compat.prescribed_value(bc)) for bc in self._bcs]
        errors.check_same(self._comm, same)
        self._check_ghosts()

    def _check_ghosts(self) -> None:
        """Reject functions whose values at ghosts are not those of the owner (collective).

        Ghosts in cells of other ranks, over which this rank does not integrate, do not matter.

        Raises:
            MortarError: On all ranks.
        """
        if self._comm.size == 1:
            return
        self._prescribed.x.array[:] = self._u.x.array
        self._prescribed.x.scatter_forward()
        compat.set_prescribed(self._prescribed.x.array, self._bcs)
        named = [("the prescribed displacement", self._prescribed)] + [
            (f"function '{function.name}' of the residual", function)
            for function in sorted(self._coefficients - {self._u}, key=lambda f: f.count())
        ]
        for name, function in named:
            given = function.x.array.copy()
            function.x.scatter_forward()
            change = np.abs(function.x.array - given)[_dofs_of_owned_cells(function)]
            function.x.array[:] = given
            largest = self._comm.allreduce(float(np.abs(given).max(initial=0.0)), MPI.MAX)
            wrong = self._comm.allreduce(int((change > ROUNDING * largest).sum()))
            if wrong:
                raise errors.MortarError(
                    f"{name} has other values at {wrong} ghost dofs than on the rank that owns "
                    "them: set it on all ranks, and call x.scatter_forward() of the function"
                )

    def loads(self) -> list[Array]:
        """Copies of prescribed values, constants and functions, in a fixed order (local).

        Without u and history functions; each of its own shape and unit [any].
        """
        values = np.zeros_like(self._u.x.array)
        found = []
        for bc in self._bcs:
            compat.set_prescribed(values, [bc])
            found.append(values[bc.dof_indices()[0]])
        functions = sorted(self._loads, key=lambda f: f.count())
        found += [np.array(c.value, float).ravel() for c in self._constants]
        return found + [f.x.array.copy() for f in functions]

    def _check_mesh(self) -> None:
        """Reject a moved mesh: surfaces and tangent belong to the mesh at set-up (collective).

        Motions by rounding, as by a tied pair of a second problem on the mesh, are accepted.
        """
        if ranks.on_all_ranks(self._comm, np.array_equal(self._mesh.geometry.x, self._nodes)):
            return
        far = self._comm.allreduce(float(np.abs(self._nodes).max(initial=0.0)), MPI.MAX)
        same = np.abs(self._mesh.geometry.x - self._nodes) <= ROUNDING * far
        moved = np.unique(np.nonzero(~same)[0])
        count, where = errors.count_points(self._comm, self._nodes[moved, : self._space.dim])
        if count:
            raise errors.MortarError(
                f"the mesh was moved after the problem was set up, one node was at {where}; move "
                "it back, or set up a new problem on the moved mesh"
            )

    def count_nodes(self, dofs: Flags) -> tuple[int, str]:
        """Number of nodes with any of the marked local dofs, and the position of one (collective).

        Unknowns other than the displacement are counted as nodes at the midpoint of a cell.

        Args:
            dofs: Marks of all local dofs, ghosts included, shape (local dofs,), bool.
        """
        if not ranks.on_any_rank(self._comm, bool(dofs.any())):
            return 0, "nowhere"
        space = self._space
        others = dofs[: space.num_owned].copy()
        others[space.owned_dofs] = False
        points = [self._X[: space.num_nodes][dofs[space.owned_dofs].any(axis=1)]]
        if space.is_mixed:
            cells = compat.dofmap(space.whole)
            middle = np.empty((self._u.x.array.size, space.dim))
            middle[cells] = self._X[compat.dofmap(space.V)].mean(axis=1)[:, None]
            points.append(middle[np.flatnonzero(others)])
        return errors.count_points(self._comm, np.concatenate(points))


def _dofs_of_owned_cells(function: Any) -> Indices:
    """Local dofs of a function in the cells of this rank, shape (k,) (local)."""
    V = function.function_space
    owned = V.mesh.topology.index_map(V.mesh.topology.dim).size_local
    dofs, size = np.unique(compat.dofmap(V)[:owned]).astype(np.int64), V.dofmap.bs
    return np.asarray(size * dofs[:, None] + np.arange(size)).ravel()
