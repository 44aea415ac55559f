# SPDX-License-Identifier: MIT
"""Options of PETSc: defaults of the linear solvers, combined with those of the user."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal

from petsc4py import PETSc

from fenics_mortar.utils import compat

SolverName = Literal["auto", "direct", "iterative"]
# The elimination order is reused while values change; MUMPS then needs up to 50 % more memory than
# estimated by its analysis.
DIRECT = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_14": 50,
}
# Elimination order in blocks: AMD of SuiteSparse, which newer PETSc lists under a separate name, or
# PETSc's nested dissection: on grids its factors have 2 to 7 % more entries. Reports say so.
ORDER = "amd" if compat.petsc_has("suitesparse", "amd") else "nd"
ORDERED = "" if ORDER == "amd" else f" in order {ORDER}, without SuiteSparse"
# PETSc's own factorization without pivoting, for few unknowns on one rank, where MUMPS spends most
# of its time on analysis, pivoting and copies. Only an exact zero pivot is an error; small pivots
# are detected by the residual of the solution.
SMALL = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "petsc",
    "pc_factor_mat_ordering_type": ORDER,
    "pc_factor_zeropivot": 0.0,
}
# Tolerances of conjugate gradients with the cycle; the enclosing GMRES, with a separate tolerance,
# needs one iteration with this one.
TIED = {"ksp_rtol": 1e-9, "ksp_max_it": 500}
# Multigrid's cycle by hypre. Measured: sweeps have half the cost of the default ones and need a few
# more iterations. With this interpolation iterations grow less if contact is curved; on flat
# contact they take 20 % more time. With HMIS and a threshold of 0.5 there are a tenth fewer
# iterations, but a cycle takes a fifth longer. With "l1" the cycle is positive definite on any
# number of ranks; without it CG broke down for small bodies on three ranks.
HYPRE = {
    "pc_type": "hypre",
    "pc_hypre_boomeramg_coarsen_type": "PMIS",
    "pc_hypre_boomeramg_interp_type": "ext+i",
    "pc_hypre_boomeramg_relax_type_down": "l1-Gauss-Seidel",
    "pc_hypre_boomeramg_relax_type_up": "backward-l1-Gauss-Seidel",
    "pc_hypre_boomeramg_no_CF": None,
    "pc_hypre_boomeramg_strong_threshold": 0.25,
    "pc_hypre_boomeramg_P_max": 4,
}
# The cycle by PETSc's smoothed aggregation, with the rigid motions as near-null space, where PETSc
# has no hypre. Iterations for eight digits are in the performance README. Two sweeps save a
# tenth of them, Chebyshev with Jacobi needs a tenth more. An aggregate with fewer dofs than rigid
# motions leaves zero rows on the coarse grid (PETSc 3.18), by whose diagonal SOR would divide: the
# shift [stiffness] is far below rounding of all others.
GAMG = {
    "pc_type": "gamg",
    "mg_levels_ksp_type": "richardson",
    "mg_levels_ksp_max_it": 1,
    "mg_levels_pc_type": "sor",
    "mg_levels_pc_sor_diagonal_shift": 1e-30,
}
CYCLE = TIED | (HYPRE if compat.petsc_has("hypre") else GAMG)
# Largest relative residual with factors without pivoting [1], in the strip without, otherwise after
# one refinement; above it half of the digits are lost by growth of the pivots.
WITHOUT_PIVOTING = 1e-10
# The strip along the contact surfaces. Each rank factorizes all of it: this takes little time, and
# a solve needs one exchange only. Without pivoting a solve takes a fifth of the time.
STRIP_FACTORS, STRIP_PIVOTS = (
    {"pc_type": "redundant"}
    | {f"redundant_{name}": value for name, value in options.items() if name != "ksp_type"}
    for options in (SMALL, DIRECT)
)
# Flexible GMRES stores the preconditioned directions. GMRES forms the solution by one more
# application of multigrid, a tenth of all.
ITERATIVE = {
    "ksp_type": "fgmres",
    "ksp_pc_side": "right",
    "ksp_gmres_restart": 100,
    "ksp_rtol": 1e-8,
    "ksp_max_it": 300,
    "pc_type": "python",
    **{f"cycle_{name}": value for name, value in CYCLE.items()},
}
# Options with this prefix belong to another solver, see ``la.factored``.
COMPLIANCE = "compliance_"
# Prefixes and names of options set in PETSc's database by ``options_added`` at present.
_added: set[tuple[str, str]] = set()


def with_defaults(prefix: str, options: dict[str, Any]) -> dict[str, Any]:
    """Options together with ``DIRECT``, or alone if they do not choose a factorization (local).

    A ``pc_type`` of the user other than "lu" and "cholesky" does not fit MUMPS and "preonly"; with
    it PETSc's own defaults apply.

    Args:
        prefix: Prefix of the options; those in PETSc's database take precedence.
        options: Values by name.
    """
    kind = options.get("pc_type", DIRECT["pc_type"])
    kind = PETSc.Options(prefix).getString("pc_type", str(kind))
    return {**DIRECT, **options} if kind in ("lu", "cholesky") else dict(options)


@contextmanager
def options_added(
    prefix: str, options: dict[str, Any], used: set[str] | None = None
) -> Iterator[None]:
    """Set options in PETSc's database temporarily, except those set by the user.

    Args:
        prefix: Prefix of the options.
        options: Values by name.
        used: Set that receives the names of options read by PETSc.
    """
    database = PETSc.Options(prefix)
    ours = {k: v for k, v in options.items() if not database.hasName(k)}
    try:
        for name, value in ours.items():
            _added.add((prefix, name))
            database.setValue(name, value)
        yield
    finally:
        if used is not None:
            names = {*options, *database.getAll()} - used
            used |= {name for name in names if compat.option_is_used(prefix + name)}
        for name in ours:
            database.delValue(name)
            _added.discard((prefix, name))


def drop_added_options() -> None:
    """Remove options left in PETSc's database by an interrupted ``options_added`` (local)."""
    for prefix, name in list(_added):
        PETSc.Options(prefix).delValue(name)
    _added.clear()
