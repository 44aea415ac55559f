# SPDX-License-Identifier: MIT
"""Check that the present state of a problem is a solution for the present values of its data.

Derivatives are those of a solution. At a state for other loads, materials or laws than the present
ones they would be wrong without any indication.
"""

from __future__ import annotations

from fenics_mortar.equations.undo import restored_if_interrupted
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.errors import MortarError

# Residual of a solution over that of Newton's tolerance [1]: the reference force of an iteration
# may have been larger than that of the state.
SOLVED_FACTOR = 1e3


def check_solved(problem: ContactProblem) -> None:
    """Reject a state that is not a solution; one evaluation of the residual (collective).

    Raises:
        MortarError: On all ranks, if the last solve failed, or if displacement, loads, prescribed
            values, material or law were changed after it.
    """
    e = problem.equations
    if not e.last_converged:
        raise MortarError(
            "the present state is not the result of a solve: record a state after solve()"
        )
    with restored_if_interrupted(e):
        e.evaluate_operators()
        e.bulk.assemble_residual()
        if e.floating.bodies:
            e.floating.add_spring_forces()
        e.residual.begin()
        residual = e.residual.measure()
    tolerance = e.newton.residual_tolerance
    allowed = SOLVED_FACTOR * max(tolerance * e.residual.force, e.residual.attainable)
    if not residual <= allowed:
        raise MortarError(
            f"the present state is not a solution: residual {residual:.1e}, allowed {allowed:.1e}. "
            "Displacement, loads, prescribed values, material or law were changed after solve(): "
            "record before changing them, or solve again"
        )
