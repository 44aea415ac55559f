# SPDX-License-Identifier: MIT
"""Choice of the linear system and of a direct or iterative solver."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from petsc4py import PETSc

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.interface import Interface
from fenics_mortar.la.condensed import CondensedSystem, obstacle_to_condensation
from fenics_mortar.la.options import ITERATIVE, SMALL, Algorithm, SolverName, costs_of
from fenics_mortar.la.system import LinearSystem, SaddleSystem

SYSTEMS: dict[str, type[LinearSystem]] = {"condensed": CondensedSystem, "saddle": SaddleSystem}


def system_of(
    bulk: Bulk,
    contacts: Sequence[Interface],
    prefix: str,
    options: dict[str, Any] | None,
    algorithm: Algorithm | None,
    solver: SolverName,
    linear_bulk: bool | None,
) -> Callable[[], LinearSystem]:
    """A function that creates the linear system of a problem; see ``ContactProblem``.

    Args:
        bulk: The bodies.
        contacts: All pairs.
        prefix: Prefix of PETSc's options.
        options: Options of the linear solver given by the user.
        algorithm: Condensed or saddle-point system; ``None``: condensed if possible.
        solver: Direct or iterative; "auto" depends on the size of the problem.
        linear_bulk: Whether the bulk is factorized only once.

    Raises:
        ValueError: On all ranks, for an iterative solver and a surface in contact with itself.
    """
    if algorithm is None:
        why = obstacle_to_condensation(contacts) or ""
        algorithm = "saddle" if why else "condensed"
    else:
        why = f"algorithm='{algorithm}'"
    form: Callable[..., LinearSystem] = SYSTEMS[algorithm]
    automatic, with_itself = (
        solver == "auto",
        next((c.slave.name for c in contacts if c.slave is c.master), ""),
    )
    if with_itself and solver == "iterative":
        raise ValueError(
            f"solver='iterative': multigrid needs separate slave and master surfaces, but "
            f"'{with_itself}' is in contact with itself; expected solver='direct' or 'auto'"
        )
    against = _against_multigrid(bulk, prefix, options, linear_bulk)
    reason = f"solver='{solver}'"
    if automatic:
        against = f"'{with_itself}' is in contact with itself" if with_itself else against
        reason = against or f"at least {costs_of(bulk.space.dim).many:,} unknowns"
        solver = "direct" if against else solver
    small = solver == "direct" and form is CondensedSystem and _is_small(bulk, prefix, options)
    if small:
        reason += f", at most {costs_of(bulk.space.dim).few:,} on one rank"
    defaults: dict[str, Any] = (SMALL if small else {}) if solver == "direct" else ITERATIVE

    def create() -> LinearSystem:
        system = form(bulk, contacts, prefix, defaults | (options or {}))
        system.solver.given = set(options or {})
        system.solver.may_factor = small or solver == "auto"
        system.solver.reason, system.reason = reason, why
        system.solver.long_factors = bulk.space.dim == 3
        return system

    return create


def _is_small(bulk: Bulk, prefix: str, options: dict[str, Any] | None) -> bool:
    """Whether factorization without pivoting is tried first: few unknowns on one rank.

    Not in space, where even small factors have long rows.
    """
    given = PETSc.Options(prefix).getAll() or options
    few = bulk.space.dim == 2 and bulk.comm.size == 1 and bulk.r.getSize() <= costs_of(2).few
    return few and not given


def _against_multigrid(
    bulk: Bulk, prefix: str, options: dict[str, Any] | None, linear_bulk: bool | None
) -> str:
    """Reason why "auto" is direct, "" if it is iterative (collective)."""
    if PETSc.Options(prefix).getAll() or options:
        return "PETSc options are given"
    if bulk.space.is_mixed:
        return "mixed functions"
    # in space multigrid is faster where only some solves, if any, reduce to the contact dofs
    if bulk.is_linear and (linear_bulk or (linear_bulk is None and bulk.space.dim == 2)):
        return "the bulk is linear"
    many = costs_of(bulk.space.dim).many
    return "" if bulk.r.getSize() >= many else f"fewer than {many:,} unknowns"
