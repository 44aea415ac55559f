# SPDX-License-Identifier: MIT
"""Options of PETSc: defaults of the linear solvers, combined with those of the user."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal

from petsc4py import PETSc

from fenics_mortar.la.multigrid import OPTIONS
from fenics_mortar.utils import compat

Solver = Literal["auto", "direct", "iterative"]
# The elimination order is reused while values change; MUMPS then needs up to 50 % more memory than
# estimated by its analysis.
DIRECT = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_14": 50,
}
# PETSc's own factorization without pivoting, for few unknowns on one rank, where MUMPS spends most
# of its time on analysis, pivoting and copies. Only an exact zero pivot is an error; small pivots
# are detected by the residual of the solution.
SMALL = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "petsc",
    "pc_factor_mat_ordering_type": "amd",
    "pc_factor_zeropivot": 0.0,
}
ITERATIVE = {
    "ksp_type": "gmres",
    "ksp_pc_side": "right",
    "ksp_gmres_restart": 100,
    "ksp_rtol": 1e-8,
    "ksp_max_it": 300,
    "pc_type": "python",
    **OPTIONS,
}
# Number of unknowns from which solver="auto" is iterative. CPU time of a Newton iteration, direct
# over iterative (two blocks): 1.0 with 10,000 unknowns, 1.5 with 41,000, 1.9 with 161,000.
MANY = 100_000
# Number of unknowns up to which ``SMALL`` factors a condensed system, and mean number of entries in
# a row of the factors above which MUMPS is used, since its dense kernels are faster for long rows.
# CPU time in milliseconds of factorization and solution, ``SMALL`` in blocks and MUMPS: 0.5 and 1.9
# with 1,300 unknowns, 26 and 40 with 18,200 and 97 entries, 50 and 53 with 20,800 and 116 entries;
# on unstructured meshes 20 and 20 with 6,700 and 126 entries, 53 and 38 with 11,900 and 147.
FEW = 20_000
LONG_ROWS = 120
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
