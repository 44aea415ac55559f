# SPDX-License-Identifier: MIT
"""Compliance of all bodies, with weak springs on floating bodies.

The compliance of a floating body is that of the elastic body on springs, corrected by a low-rank
term that weakens the springs on its rigid motions. Without this correction, with weak springs in
the stiffness, the stiffness of a body that is unstable under its loads, such as an inverted
pendulum, would not be positive definite.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.equations.options import EQUATIONS
from fenics_mortar.la.factored import column_groups, factored_bulk
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.utils.arrays import Array

PREFIX = "fenics_mortar_settling_"


class BodyCompliance:
    """Compliance of all bodies, with weak springs on floating bodies (collective).

    Args:
        bulk: The bodies; springs are added to their tangent, which has to be assembled.
        floating: The floating bodies.
    """

    def __init__(self, bulk: Bulk, floating: FloatingBodies) -> None:
        self._bulk = bulk
        springs = np.zeros(bulk.num_owned)
        motions, added = [np.zeros((0, bulk.num_owned))], [np.zeros(0)]
        for body in floating.bodies:
            mine = floating.labels[: bulk.space.num_nodes] == body.label
            dofs = bulk.space.owned_dofs[mine]
            each = EQUATIONS.spring * body.stiffest / body.num_nodes
            weak = RIGID.weakest_spring * body.stiffest / body.num_nodes
            springs[dofs] = each
            rigid = np.zeros((len(body.motions), bulk.num_owned))
            rigid[:, dofs.ravel()] = floating.motions(body)[1]
            products = bulk.comm.allreduce(rigid @ rigid.T)
            motions.append(np.linalg.solve(np.linalg.cholesky(products), rigid))
            added.append(np.full(len(rigid), 1.0 / weak - 1.0 / each))
        self._motions, self._added = np.concatenate(motions), np.concatenate(added)
        bulk.add_to_diagonal(springs)
        self._factors = factored_bulk(bulk, PREFIX)

    def displacements(self, forces: Array) -> Array:
        """Displacements [length] due to forces [stress length], both (owned dofs, k)."""
        bulk, found = self._bulk, []
        forces = np.where(bulk.prescribed[: bulk.num_owned, None], 0.0, forces)
        for group in column_groups(forces.shape[1]):
            sizes = (bulk.num_owned, None), (None, group.size)
            load = np.asfortranarray(forces[:, group]).ravel(order="F")
            loads = PETSc.Mat().createDense(sizes, array=load, comm=bulk.comm)
            loads.assemble()
            responses = loads.duplicate()
            self._factors.getFactorMatrix().matSolve(loads, responses)
            found.append(responses.getDenseArray().copy())
            loads.destroy()
            responses.destroy()
        along = bulk.comm.allreduce(self._motions @ forces)
        return np.concatenate(found, axis=1) + self._motions.T @ (self._added[:, None] * along)
