# SPDX-License-Identifier: MIT
"""Checks of the arguments of ``Dynamics`` and of the velocity that users set.

Accelerations at the start of a motion, also of rigid boundaries that forces drive.

With V_m the motions of a boundary's nodes k, and the angular velocity w of these,

    u''_k = sum_m a_m V_m,k - w^2 (x_k - x_P),    V_m . (M u'' + f) = push_m,

where free nodes follow from M u'' + f = 0: a solve with M for each driven motion. The forces of
sections act on both faces.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import ufl
from ufl.algorithms.analysis import extract_arguments, extract_coefficients, extract_constants
from ufl.domain import extract_domains

from fenics_mortar.bulk.checks import check_domain, check_subdomains
from fenics_mortar.bulk.inertia import Inertia, Origin, Rates, Velocity
from fenics_mortar.equations.state import State
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arguments import check_choice, check_kind, check_number
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError, check_same, check_same_texts, together
from fenics_mortar.utils.ranks import sum_over_ranks

# Default spectral radius at infinite frequency by scheme [1]: no dissipation, or dissipation of the
# frequencies excited by impacts and not resolved by the time step.
SCHEMES = {"conserving": 1.0, "massless": 1.0, "generalized_alpha": 0.8}


def check_dynamics(
    problem: ContactProblem, density: Any, scheme: Any, rho_inf: Any, velocity: Any, energy: Any
) -> None:
    """Reject arguments of ``Dynamics``, also those that differ between ranks (collective).

    Raises:
        ValueError: On all ranks, if an argument is not allowed.
        MortarError: On all ranks, if arguments differ, or a tag is unknown.
    """
    comm, bulk = problem.equations.comm, problem.equations.bulk
    with together(comm, "Dynamics"):
        check_choice("scheme", scheme, SCHEMES)
        if scheme == "conserving" and bulk.history.functions:
            raise ValueError(
                "scheme='conserving' returns lost energy, and does not support bodies with "
                "history, which dissipate: expected scheme='massless' or 'generalized_alpha'"
            )
        if rho_inf is not None:
            check_number("rho_inf", rho_inf, "a number from 0 to 1", lambda rho: 0.0 <= rho <= 1.0)
        mesh = bulk.V.ufl_domain()
        _check_density(density, mesh)
        _check_energy(energy, mesh)
        _check_velocity(velocity, problem)
        if problem.equations.model_check is not None:
            raise ValueError("problem has a ModelCheck, whose models have no inertia")
        if bulk.inertia is not None:
            raise ValueError(
                "problem has inertia already, from another Dynamics: set up a new problem"
            )
    is_number = not isinstance(density, ufl.core.expr.Expr)
    given = {
        "scheme": scheme, "rho_inf": rho_inf, "velocity": velocity is not None,
        "energy": energy is not None, "density": density if is_number else "a UFL expression",
    }  # fmt: skip
    check_same_texts(comm, "Dynamics", given)
    constants = [] if is_number else extract_constants(density)
    check_same(comm, [("a constant of density", c.value) for c in constants])
    if energy is not None:
        named = [contact.pair.data for contact in problem.equations.contacts]
        check_subdomains("energy", energy, bulk.V.mesh, named)


def _check_density(density: Any, mesh: Any) -> None:
    if not isinstance(density, ufl.core.expr.Expr):
        check_number("density", density, "a positive number", lambda rho: 0.0 < rho < np.inf)
        return
    if density.ufl_shape:
        raise ValueError(f"density has the shape {density.ufl_shape}: expected a scalar")
    if extract_arguments(density):
        raise ValueError("density has a test function: expected a number or a function")
    if any(domain != mesh for domain in extract_domains(density)):
        raise ValueError("density belongs to another mesh than the problem")


def _check_velocity(velocity: Any, problem: ContactProblem) -> None:
    """Reject a velocity that the residual does not contain, and a missing one."""
    bulk = problem.equations.bulk
    if velocity is not None:
        check_kind("velocity", velocity, Velocity, "a Velocity(u)")
        if velocity.u is not bulk.u:
            raise ValueError("velocity is that of another function: expected Velocity(u)")
    given = None if velocity is None else velocity.origin
    used = [data for data in bulk.data if isinstance(data, Origin)]
    if given is not None and not any(origin is given for origin in used):
        raise ValueError("velocity has no effect: the residual does not contain its expression")
    if any(origin is not given for origin in used):
        raise ValueError(
            "the residual contains a Velocity that would remain zero: expected velocity=..., the "
            "same object"
        )


def _check_energy(energy: Any, mesh: Any) -> None:
    if energy is None:
        return
    check_kind("energy", energy, ufl.Form, "a UFL form, such as psi * dx")
    if energy.arguments():
        raise ValueError("energy has a test function: expected a scalar form, such as psi * dx")
    check_domain("energy", energy, mesh)


class DensityValues:
    """Values of a density at the time when masses were assembled (local).

    Args:
        density: Number or UFL expression.
    """

    def __init__(self, density: Any) -> None:
        is_number = not isinstance(density, ufl.core.expr.Expr)
        self._constants = [] if is_number else extract_constants(density)
        self._functions = [] if is_number else extract_coefficients(density)
        self._values = self._present()

    def check(self, problem: ContactProblem) -> None:
        """Reject a density that has changed (collective).

        Raises:
            MortarError: On all ranks.
        """
        pairs = zip(self._values, self._present(), strict=True)
        changed = not all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)
        if problem.equations.comm.allreduce(int(changed)):
            raise MortarError(
                "the density has changed since Dynamics(...), whose masses are constant: set up a "
                "new problem, and give its Dynamics the velocity"
            )

    def _present(self) -> list[Array]:
        values = [np.array(constant.value) for constant in self._constants]
        return values + [function.x.array.copy() for function in self._functions]


def check_step(dt: Any, time: float) -> None:
    """Reject a step that is not positive, or lost in the rounding of ``time`` (local).

    Raises:
        ValueError: If the step is not allowed.
    """
    check_number("dt", dt, "a positive number", lambda dt: 0.0 < dt < np.inf)
    expected = f"a step that the time {time:g} can resolve"
    check_number("dt", dt, expected, lambda dt: time + dt > time and 0.0 < dt * dt < np.inf)


def check_rates(problem: ContactProblem) -> None:
    """Reject a velocity that is not finite (collective).

    Raises:
        MortarError: On all ranks.
    """
    velocity = problem.equations.bulk.inertia.velocity
    velocity.x.scatter_forward()
    bad = int(np.count_nonzero(~np.isfinite(velocity.x.array)))
    if problem.equations.comm.allreduce(bad):
        raise MortarError("the velocity of Dynamics is not finite")


def rates_of(state: Any) -> Rates:
    """Rates of a state of a motion (local).

    Raises:
        ValueError: If it is not a state of a motion.
    """
    check_kind("before", state, State, "a state of the problem")
    if state.rates is None:
        raise ValueError("before has no velocity: expected a state of the motion")
    rates: Rates = state.rates
    return rates


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
