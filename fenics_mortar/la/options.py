# SPDX-License-Identifier: MIT
"""Options of PETSc: defaults of the linear solvers, and measured costs by which they are chosen.

``with_defaults`` and ``options_added`` combine the defaults with the options of the user.

Linear solvers are chosen by their measured costs. A linear bulk needs one factorization, or one in
every Newton iteration: both costs are predicted. In the plane, the cost of MUMPS per unknown is
nearly constant from 5,000 to 160,000 unknowns; in space it is that of a square, and an iteration of
general equations mostly uses factors of the one before. The compliance of the contact dofs is a
dense matrix with cubic cost. Only ratios of the constants matter. See ``Costs``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal

from petsc4py import PETSc

import numpy as np

from fenics_mortar.utils import compat

Algorithm = Literal["condensed", "saddle"]
SolverName = Literal["auto", "direct", "iterative"]
# The elimination order is reused while values change; MUMPS then needs up to 50 % more memory than
# estimated by its analysis.
DIRECT = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_14": 50,
}
# After a failure: pivots of saddle points, as where friction holds a block of 27 nodes in a box,
# may need far more than the estimate (MUMPS error -9).
MORE_MEMORY = {"mat_mumps_icntl_14": 1000}
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
# In space, where weak connections are those of stretched cells. Linear iterations of three loads of
# a sphere with 0.25 and 0.5: 418 and 122 on hexahedra stretched by 60, 558 and 165 if these are
# quadratic, of a half ball of tetrahedra that are not stretched 68 and 73.
HYPRE_IN_SPACE = {"pc_hypre_boomeramg_strong_threshold": 0.5}
# With linear elements in space the finest level is coarsened aggressively: half the time of a cycle
# and of its set-up for a fifth more linear iterations (half ball, 53,000 unknowns: 28 and 14 ms,
# 73 and 87). Quadratic ones need more than twice as many. Near incompressibility it does not pay:
# CPU seconds and linear iterations with it and without, two blocks with friction, 43,000 unknowns,
# hexahedra with Poisson's ratio 0.3: 10.9 and 11.5, 72 and 57; with 0.499: 32.9 and 30.1, 613 and
# 365; tetrahedra with 0.499: 33.2 and 23.5, 1168 and 448, where one solve fails.
HYPRE_LINEAR = {"pc_hypre_boomeramg_agg_nl": 1}
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
# one refinement; above it half of the digits are lost by growth of the pivots, unless the rest is
# rounding of terms of A x that cancel, as of rows in other units.
WITHOUT_PIVOTING = 1e-10
# The strip along the contact surfaces in the plane. Each rank factorizes all of it: this takes
# little time, and a solve needs one exchange only. Without pivoting a solve takes a fifth of the
# time.
STRIP_FACTORS, STRIP_PIVOTS = (
    {"pc_type": "redundant"}
    | {f"redundant_{name}": value for name, value in options.items() if name != "ksp_type"}
    for options in (SMALL, DIRECT)
)
# In space the factors, a fifth of all memory, are shared by the ranks. Incomplete factors are as
# fast for bodies of one material, but GMRES does not converge with a slave 1000 times as stiff as
# its master, or with Poisson's ratio 0.499.
STRIP_IN_SPACE = {name: value for name, value in DIRECT.items() if name != "ksp_type"}
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


def iterative(dim: int, *, is_linear: bool) -> dict[str, Any]:
    """Options of GMRES with multigrid in the plane or in space, for linear elements (local)."""
    if dim == 2 or not compat.petsc_has("hypre"):
        return ITERATIVE
    cycle = HYPRE_IN_SPACE | (HYPRE_LINEAR if is_linear else {})
    return ITERATIVE | {f"cycle_{name}": value for name, value in cycle.items()}


# Options with this prefix belong to another solver, see ``la.solver``.
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


@dataclass(frozen=True)
class Costs:
    """Measured costs, and sizes at which the choice changes.

    Hertz with 3,600 to 160,000 unknowns, degrees 1 and 2, one core.

    CPU time of a Newton iteration, direct over iterative (two blocks): 1.0 with 10,000 unknowns,
    1.5 with 41,000, 1.9 with 161,000. CPU time in milliseconds of factorization and solution, by
    PETSc without pivoting in blocks (``SMALL``) and by MUMPS, whose dense kernels are faster for
    long rows: 0.5 and 1.9 with 1,300 unknowns, 26 and 40 with 18,200 and 97 entries, 50 and 53 with
    20,800 and 116 entries; on unstructured meshes 20 and 20 with 6,700 and 126 entries, 53 and 38
    with 11,900 and 147.

    Attributes:
        iteration: Tangent, factorization and solution of an iteration, per unknown [us].
        first: Additional cost of the first iteration, the elimination order, per unknown [us].
        once: Factorization of the constant bulk and its elimination order, per unknown [us].
        dense: Schur complement and inverse, per cube of the contact dofs [us].
        expected: Iterations of a solve; between 4, for a contact that hardly changes, and 9.
        per_factor: Memory of unsymmetric factors over n log2(n) of n unknowns [bytes].
        per_entry: Memory of the dense matrices that exist at a time, per entry [bytes].
        many: Number of unknowns from which solver="auto" is iterative.
        few: Number of unknowns up to which ``SMALL`` factors a condensed system.
        long_rows: Mean number of entries in a row of the factors above which MUMPS is used.
        per_unknown: Terms of an iteration that grow with the unknowns, where its factorization
            grows faster, per unknown [us].
        per_solve: Dense system in each iteration of a factored bulk, per cube of its size [us]; not
            counted in the plane, where few nodes of long surfaces are active.
        by_multigrid: Iteration by multigrid, per unknown [us]; not used for a linear bulk in the
            plane.
    """

    iteration: float = 5.0
    first: float = 2.0
    once: float = 4.0
    dense: float = 1e-4
    expected: int = 5
    per_factor: float = 62.0
    per_entry: float = 24.0
    many: int = 100_000
    few: int = 20_000
    long_rows: int = 120
    per_unknown: float = 0.0
    per_solve: float = 0.0
    by_multigrid: float = math.inf

    def factors(self, unknowns: int, iterations: int) -> float:
        """Time of ``iterations`` iterations with a factorization in each [s] (local)."""
        work = self._work(unknowns) * (self.first + iterations * self.iteration)
        return 1e-6 * (work + iterations * self.per_unknown * unknowns)

    def multigrid(self, unknowns: int, iterations: int) -> float:
        """Time of ``iterations`` iterations by multigrid [s] (local)."""
        return 1e-6 * iterations * self.by_multigrid * unknowns

    def compliance(self, unknowns: int, contact_dofs: int) -> float:
        """Time to compute the compliance of the contact dofs [s] (local)."""
        return 1e-6 * (self.once * self._work(unknowns) + self.dense * contact_dofs**3)

    def dense_solves(self, size: int, iterations: int) -> float:
        """Time to solve a dense system of a size in each of ``iterations`` [s] (local)."""
        return 1e-6 * iterations * self.per_solve * size**3

    def fits(self, unknowns: int, contact_dofs: int) -> bool:
        """Whether dense matrices of the contact dofs need at most the memory of the factors."""
        factors = self.per_factor * self._fill(unknowns)
        return bool(self.per_entry * contact_dofs**2 <= factors)

    def _work(self, unknowns: int) -> float:
        """Unknowns to the power with which the time of a factorization grows."""
        return float(unknowns)

    def _fill(self, unknowns: int) -> float:
        """Number that is proportional to the number of entries of the factors."""
        return float(unknowns * np.log2(max(unknowns, 2)))


class SpaceCosts(Costs):
    """Costs in space, where a factorization takes the square of the unknowns.

    CPU time in seconds in space, blocks of hexahedra with 6,000, 20,250 and 48,000 unknowns, of
    which 600, 1,350 and 2,400 are of contact (``demos.studies.performance.linear_bulk``):
    factorization 0.15, 1.2 and 6.7, compliance 0.17, 1.8 and 8.9, of which inverse 0.05, 0.5 and
    2.4.
    """

    def _work(self, unknowns: int) -> float:
        return float(unknowns) ** 2

    def _fill(self, unknowns: int) -> float:
        return float(unknowns) ** (4.0 / 3.0)


COSTS = Costs()
# Per square of the unknowns, memory per n^(4/3) of n unknowns. In a load step of five iterations
# one or two factorize, a third of a factorization in each; the others use earlier factors. Surfaces
# of flat blocks may be in contact everywhere, so that dense systems count. With 4,400, 13,200 and
# 20,300 unknowns the linear algebra of an iteration took 0.08, 0.4 and 0.6 s.
# Inverses of 1,950 to 8,583 contact dofs took 2.6e-5 to 4.2e-5 us per cube. Multigrid took 14 us
# per unknown on tetrahedra (24,000 to 152,000 unknowns), 15 on hexahedra stretched by 60, 30 if
# these are quadratic; factors of the constant bulk serve all load steps.
# CPU time of a solve, direct over iterative, of a half ball on a block: 0.9 with 11,000 unknowns,
# 2.9 with 50,000 (demos.studies.space.waits).
SPACE_COSTS = SpaceCosts(
    iteration=1e-3, first=0.0, once=3e-3, dense=4e-5, per_factor=250.0, per_unknown=13.0,
    per_solve=6e-5, many=15_000, by_multigrid=30.0,
)  # fmt: skip


def costs_of(dim: int) -> Costs:
    """Costs of problems in the plane or in space (local)."""
    return COSTS if dim == 2 else SPACE_COSTS
