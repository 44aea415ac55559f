# SPDX-License-Identifier: MIT
"""Error of a solved problem's model, from a Newton step of a richer model.

At the solution of a cheap model the equations of a richer model have a residual. One linear solve
with the tangent of the richer model, a Newton step, yields a correction of displacement and
multipliers. To first order the correction is the error of the model, and so is the change of any
quantity. If the remaining residual is larger than in a nearly linear problem, the models are far
apart, and a few more steps follow, until the remaining residual, as a fraction of the correction,
cannot change any quantity by half. All quantities are checked, since a peak pressure may be
accurate while the contact area is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError, RaisedElsewhereError
from fenics_mortar.utils.ranks import agreed

ENERGY, FORCE, PEAK = "energy norm", "total force", "peak pressure"
QUANTITIES = (ENERGY, FORCE, PEAK)
Errors = dict[str, float]
# Largest number of steps of the richer model.
MAX_CORRECTIONS = 6
# Remaining fraction of the residual after a step [1] above which another step follows.
LINEAR_FRACTION = 0.1
# Expected change of an error by another step, relative to the solution [1], that is always
# accepted.
SETTLED = 1e-3


@dataclass
class SolutionQuantities:
    """Quantities of a solution, for comparison with another one on the same mesh.

    Attributes:
        u: Displacement, shape (owned dofs,) [length].
        force: Total force on each slave, shape (pairs, 2) [stress length].
        peak: Largest pressure of each pair, shape (pairs,) [stress].
    """

    u: Array
    force: Array
    peak: Array

    @classmethod
    def of(cls, problem: ContactProblem) -> SolutionQuantities:
        """Copy the quantities of the present state of a problem (collective)."""
        return cls(
            problem.equations.bulk.u.x.array[: problem.equations.bulk.num_owned].copy(),
            np.array([contact.total_force for contact in problem.equations.contacts]),
            np.array([contact.pressure.max() for contact in problem.equations.contacts]),
        )


def adopt(problem: ContactProblem, other: ContactProblem) -> None:
    """Set the state of ``problem`` to the present one of ``other``, its variant (collective)."""
    ours, theirs = problem.equations.contacts, other.equations.contacts
    for contact, of_other in zip(ours, theirs, strict=True):
        if isinstance(contact, Contact) and isinstance(of_other, Contact):
            contact.adopt(of_other)
    problem.restore(other.state())


def estimate(problem: ContactProblem, *richer: ContactProblem) -> Errors:
    """Relative errors of a solved problem by quantity; its state is restored (collective).

    Args:
        problem: The problem.
        richer: Richer variants in the order of their steps.
    """
    state = problem.state()
    try:
        return correct(problem, *richer)
    finally:
        for model in richer:
            model.equations.system.ksp.reset()
        problem.restore(state)


def correct(problem: ContactProblem, *richer: ContactProblem) -> Errors:
    """Continue from a solved problem by steps of richer variants, one after the other (collective).

    Returns:
        Relative errors of the problem by quantity; inf where the richer model fails.
    """
    cheap, last = SolutionQuantities.of(problem), problem
    errors = dict.fromkeys(QUANTITIES, 0.0)
    try:
        for model in richer:
            adopt(model, last)
            errors = take_steps(problem, cheap, model)
            last = model
    except RaisedElsewhereError:
        raise
    except MortarError:
        return dict.fromkeys(QUANTITIES, np.inf)
    return errors


def take_steps(problem: ContactProblem, cheap: SolutionQuantities, model: ContactProblem) -> Errors:
    """Take steps of a model until another step would hardly change any error (collective).

    The expected change by a step is the remaining fraction of the residual after the last step,
    times the change by all previous steps.
    """
    start = model.equations.evaluate(start=True).residual or np.inf
    for _ in range(MAX_CORRECTIONS):
        fraction = model.equations.advance().fraction
        left = model.equations.evaluate(start=False).residual / start
        errors = differences(problem, cheap, SolutionQuantities.of(model))
        settled = left * errors[ENERGY] <= max(SETTLED, 0.5 * min(errors.values()))
        if fraction == 1.0 and left <= LINEAR_FRACTION and settled:
            break
    return errors


def estimate_wider(
    problem: ContactProblem, contacts: Sequence[Contact], lengths: Sequence[Array]
) -> Errors:
    """Relative errors by quantity of neglecting an increase of gaps (collective).

    Args:
        problem: The solved problem; its state is restored.
        contacts: Pairs whose gaps increase.
        lengths: Increase for each pair, shape (slave nodes,) [length].
    """
    kept = [contact.offset for contact in contacts]
    for contact, length in zip(contacts, lengths, strict=True):
        contact.change(offset=contact.offset - length)
    errors = estimate(problem, problem)
    for contact, offset in zip(contacts, kept, strict=True):
        contact.change(offset=offset)
    problem.restore(problem.state())
    return errors


def differences(
    problem: ContactProblem, one: SolutionQuantities, other: SolutionQuantities
) -> Errors:
    """Relative differences of two solutions by quantity (collective).

    Energies are those of the bulk tangent of ``problem``.
    """
    bulk = problem.equations.bulk
    bulk.assemble_tangent()
    x, y = bulk.K.createVecs()

    def energy(u: Array) -> float:
        x.array[:] = u
        bulk.K.mult(x, y)
        return abs(x.dot(y))

    errors = {
        ENERGY: float(
            np.sqrt(relative(energy(one.u - other.u), energy(strained(problem, other.u))))
        ),
        FORCE: relative(np.linalg.norm(one.force - other.force), np.linalg.norm(other.force)),
        PEAK: relative(np.abs(one.peak - other.peak).max(), np.abs(other.peak).max()),
    }
    return agreed(problem.equations.comm, errors)


def strained(problem: ContactProblem, u: Array) -> Array:
    """Subtract from a displacement the closest rigid motion of each body (collective).

    Otherwise a finite rotation would contribute strain to the energy of a tangent. The only rigid
    motion of a body of revolution is along the axis, for which the tangent is exact.

    Args:
        problem: The problem with its bodies.
        u: Displacement, shape (owned dofs,) [length].

    Returns:
        The remainder, shape (owned dofs,) [length].
    """
    space, rest = problem.equations.bulk.space, u.copy()
    if space.is_axisymmetric:
        return rest
    X = space.V.tabulate_dof_coordinates()[: space.num_nodes, :2]
    labels = problem.equations.floating.labels[: space.num_nodes]
    x = X + u[space.owned_dofs]
    for label in range(problem.equations.comm.allreduce(int(labels.max(initial=0)), MPI.MAX) + 1):
        mine = labels == label
        sums = np.concatenate([[mine.sum()], X[mine].sum(axis=0), x[mine].sum(axis=0)])
        count, *means = problem.equations.comm.allreduce(sums)
        before, now = np.split(np.array(means) / max(count, 1), 2)
        dX, dx = X[mine] - before, x[mine] - now
        along, across = problem.equations.comm.allreduce(
            np.array([(dX * dx).sum(), (dX[:, 0] * dx[:, 1] - dX[:, 1] * dx[:, 0]).sum()])
        )
        cosine, sine = np.array([along, across]) / (np.hypot(along, across) or 1.0)
        rest[space.owned_dofs[mine]] = dx - dX @ np.array([[cosine, sine], [-sine, cosine]])
    return rest


def relative(difference: Any, size: Any) -> float:
    """Difference over size [1]; 0 if both vanish, inf if only the size does (local)."""
    return float(difference / size) if size > 0.0 else float(np.inf if difference > 0.0 else 0.0)
