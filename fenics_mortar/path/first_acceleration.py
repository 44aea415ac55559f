# SPDX-License-Identifier: MIT
"""Accelerations at the start of a motion, also of rigid boundaries that forces drive.

With V_m the motions of a boundary's nodes k, and the angular velocity w of these,

    u''_k = sum_m a_m V_m,k - w^2 (x_k - x_P),    V_m . (M u'' + f) = push_m,

where free nodes follow from M u'' + f = 0: a solve with M for each driven motion. The forces of
sections act on both faces.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fenics_mortar.bulk.inertia import Inertia
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.ranks import sum_over_ranks


def first_acceleration(problem: ContactProblem, inertia: Inertia) -> Array:
    """Accelerations that balance the forces, (local dofs,) [length / time^2] (collective).

    Those of nodes with prescribed motions are zero.

    Args:
        problem: The problem, with rates of which the acceleration is zero.
        inertia: Mass and velocity.
    """
    bulk, comm = problem.equations.bulk, problem.equations.comm
    remote: list[Any] = list(problem.equations.motions.remote)
    forces, contact, _ = problem.forces()
    total = forces + contact - sum(load.pushed_nodes() for load in remote if load not in bulk.bcs)
    w = inertia.acceleration_of(-total, bulk.prescribed)
    driven = [
        (load, np.isfinite(load.motion.load))
        for load in remote
        if load in bulk.bcs and np.isfinite(load.motion.load).any()
    ]
    if not driven:
        return w
    turning = [load.centripetal(inertia.velocity.x.array) for load, _ in driven]
    w = w + _followed(inertia, bulk, sum(turning))
    V = np.concatenate([load.nodal_motions()[on] for load, on in driven])
    fields = [_followed(inertia, bulk, motion) for motion in V]
    of_motions = [inertia.times_mass(field) for field in fields]
    at_present = inertia.times_mass(w) + inertia.carried(total)
    products = sum_over_ranks(comm, V @ np.column_stack([*of_motions, at_present]))
    push = np.concatenate([load.push()[on] for load, on in driven])
    a = np.linalg.solve(products[:, :-1], push - products[:, -1])
    return w + np.tensordot(a, np.array(fields), axes=1)


def _followed(inertia: Inertia, bulk: Any, on_boundary: Array) -> Array:
    """Accelerations ``on_boundary`` (owned dofs,), with those of free nodes without other forces.

    An array of all local dofs (collective).
    """
    given = inertia.with_ghosts(on_boundary)
    return given + inertia.acceleration_of(-inertia.times_mass(given), bulk.prescribed)
