# SPDX-License-Identifier: MIT
"""Arguments of a problem: their checks, and the thresholds that users do not choose.

The checks reject arguments of a wrong type, and in space those that belong to the plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_args

import ufl

from fenics_mortar.bulk.checks import check_jacobian, check_residual
from fenics_mortar.bulk.history import check_history
from fenics_mortar.contact.pair import ContactPair, TiedPair
from fenics_mortar.interface.mortar import LINEARIZATIONS
from fenics_mortar.la.options import Algorithm, SolverName
from fenics_mortar.mesh.space import check_geometry
from fenics_mortar.newton.loop import NewtonOptions
from fenics_mortar.utils.errors import check_choice, check_kind, check_number, refuse_in_space


def check_arguments(pairs: Any, given: dict[str, Any]) -> None:
    """Reject forms, pairs, conditions or history functions of a wrong type (local)."""
    residual, u, jacobian, bcs = (given[name] for name in ("residual", "u", "jacobian", "bcs"))
    check_kind("residual", residual, ufl.Form, "a UFL form")
    if not isinstance(pairs, Sequence) or not all(
        isinstance(p, (ContactPair, TiedPair)) for p in pairs
    ):
        raise ValueError(f"pairs={pairs!r}: expected a list of ContactPair and TiedPair")
    if not isinstance(bcs, Sequence):
        raise ValueError(f"bcs is a {type(bcs).__name__}: expected a list of Dirichlet conditions")
    if not all(hasattr(bc, "dof_indices") for bc in bcs):
        raise ValueError(f"bcs={bcs!r}: expected a list of Dirichlet conditions")
    for pair in pairs:
        pair.check()
    set_before = given["before_assembly"]
    check_residual("residual", residual, u, contains_u=set_before is None)
    if set_before is not None and (not callable(set_before) or jacobian is None):
        raise ValueError(
            "before_assembly: expected a function without arguments, and jacobian, the form with "
            "the derivatives of the functions that it sets"
        )
    if jacobian is not None:
        check_kind("jacobian", jacobian, ufl.Form, "a UFL form, or None")
        check_jacobian(jacobian, u)
    forms = {"residual": residual, "jacobian": jacobian}
    check_history(given["history"], {n: form for n, form in forms.items() if form is not None}, u)


def check_options(given: dict[str, Any], model_check: Any) -> None:
    """Reject options of a wrong type (local)."""
    check_geometry(given["geometry"], given["thickness"])
    check_kind(
        "petsc_options_prefix", given["petsc_options_prefix"], str, "a string, e.g. 'blocks_'"
    )
    for name, kind, expected in (
        ("petsc_options", dict, "a dictionary, or None"),
        ("newton", NewtonOptions, "an instance of NewtonOptions, or None"),
        ("linear_bulk", bool, "True, False or None"),
    ):
        if given[name] is not None:
            check_kind(name, given[name], kind, expected)
    for name in given["petsc_options"] or {}:
        if not isinstance(name, str) or name.startswith("-"):
            raise ValueError(f"petsc_options with {name!r}: expected a name such as 'ksp_rtol'")
    check_choice("linearization", given["linearization"], LINEARIZATIONS)
    check_choice("solver", given["solver"], get_args(SolverName))
    if given["algorithm"] is not None:
        check_choice("algorithm", given["algorithm"], get_args(Algorithm))
    part, expected = given["displacement"], "the number of a sub-space"
    check_number("displacement", part, expected, lambda part: part >= 0, whole=True)
    if model_check is not None and (
        isinstance(model_check, type) or not hasattr(model_check, "prepare")
    ):
        raise ValueError(
            f"model_check={model_check!r}: expected an instance of ModelCheck, or None"
        )


def check_in_space(given: dict[str, Any], pairs: Sequence[Any]) -> None:
    """Reject arguments and pairs that belong to the plane (local, equal on all ranks).

    Args:
        given: Arguments of ``ContactProblem`` by name.
        pairs: Contact and tied pairs.

    Raises:
        NotImplementedError: If the mesh is one of solids, and an argument needs the plane.
    """
    if given["u"].function_space.mesh.geometry.dim != 3:
        return
    refuse_in_space("axisymmetric", needed=given["geometry"] == "axisymmetric")
    refuse_in_space("thickness", needed=given["thickness"] is not None)
    for pair in pairs:
        choice, name = pair.discretization, f"{pair!r}"
        refuse_in_space("integration", name, needed=choice.integration != "segments")
        refuse_in_space("vertices", name, needed=choice.basis == "vertices")


@dataclass(frozen=True)
class EquationOptions:
    """Thresholds of initial guesses and of changes of sets, which are no options of users.

    Attributes:
        longest: Largest ratio of a step to the last one [1], for extrapolated loads and load steps.
        same_direction: Two changes are considered equal if they differ by at most this fraction of
            their size [1], or by 30 degrees for equal sizes. Applied to motions of the contacts on
            a body, and to loads of two solves.
        max_guess_iterations: Number of iterations after which a guess is abandoned: more than any
            guess saves.
        max_residual_left: Largest ratio of the residual after the first iteration from linear
            extrapolation to that before it [1]. Measured on 300 steps of sliding and rolling: above
            it the guess costs more than it saves. The moving frame has no limit: it leaves 0.06 of
            the force where the last state leaves 0.5.
        at_rest: Displacement over the shortest facet [1] below which increments of the solution are
            measured by the facet, for bodies that do not move.
        recent_sets: Number of last iterations in which nodes that open and close are reported.
        max_calls: Largest number of linearized contact problems in a solve: walls and arches need
            one or a few; if there is no equilibrium, more would only take time.
        max_touching: Largest number of nodes that may touch in a linearized contact problem: with
            more nodes, Lemke's method with a dense tableau of four rows per node takes longer than
            the iterations saved (about 2 s for this number).
        spring: Stiffness of the springs on a body over its largest diagonal entry of K [1] where
            its compliance is evaluated: larger than the negative stiffness of its loads, which is
            of the order of the strains, but small enough to have a negligible effect on the elastic
            compliance.
        distortion: Relative motion of a facet's ends over its length above which a step may invert
            cells [1]: the areas of adjacent cells change by about this fraction, and may change by
            0.8, see ``Bulk.move``.
    """

    longest: float = 2.0
    same_direction: float = 0.5
    max_guess_iterations: int = 8
    max_residual_left: float = 0.4
    at_rest: float = 1e-8
    recent_sets: int = 4
    max_calls: int = 8
    max_touching: int = 250
    spring: float = 1e-3
    distortion: float = 0.25


EQUATIONS = EquationOptions()
