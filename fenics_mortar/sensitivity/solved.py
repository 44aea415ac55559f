# SPDX-License-Identifier: MIT
"""Whether the present state of a problem is a solution for the present values of its data.

Derivatives are those of a solution: at a state of other loads, materials or laws than the present
ones they would be wrong without a sign.
"""

from __future__ import annotations

from fenics_mortar.equations.undo import undone_if_interrupted
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.errors import MortarError

# Residual of a solution over that of Newton's tolerance [1]: the reference force of an iteration
# may have been larger than that of the state.
MAX_EXCESS = 1e3


def check_solved(problem: ContactProblem) -> None:
    """Refuse a state that is no solution; one evaluation of the residual (collective).

    Raises:
        MortarError: On all ranks, if the last solve failed, or if displacement, loads, prescribed
            values, material or law were changed after it.
    """
    e = problem.equations
    if not e.last_converged:
        raise MortarError(
            "the present state is not the result of a solve: record a state after solve()"
        )
    with undone_if_interrupted(e, problem.adequacy):
        e.evaluate_operators()
        e.bulk.assemble_residual()
        if e.floating.bodies:
            e.floating.add_spring_forces()
        residual = e.residual.measure()
    tolerance = e.newton.residual_tolerance
    allowed = MAX_EXCESS * max(tolerance * e.residual.force, e.residual.attainable)
    if not residual <= allowed:
        raise MortarError(
            f"the present state is no solution: residual {residual:.1e}, allowed {allowed:.1e}. "
            "Displacement, loads, prescribed values, material or law were changed after solve(): "
            "record before changing them, or solve again"
        )
