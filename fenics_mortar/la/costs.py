# SPDX-License-Identifier: MIT
"""Measured costs of linear solvers, by which they are chosen.

A linear bulk needs one factorization, or one in every Newton iteration: both costs are predicted.
In the plane, the cost of MUMPS per unknown is nearly constant from 5,000 to 160,000 unknowns; in
space it is that of a square, and an iteration of general equations mostly uses factors of the one
before. The compliance of the contact dofs is a dense matrix with cubic cost. Only ratios of the
constants matter.

CPU time in seconds in space, blocks of hexahedra with 6,000, 20,250 and 48,000 unknowns, of which
600, 1,350 and 2,400 are of contact (``demos.studies.performance.linear_bulk``): factorization 0.15,
1.2 and 6.7, compliance 0.17, 1.8 and 8.9, of which inverse 0.05, 0.5 and 2.4.

CPU time of a Newton iteration, direct over iterative (two blocks): 1.0 with 10,000 unknowns, 1.5
with 41,000, 1.9 with 161,000. CPU time in milliseconds of factorization and solution, by PETSc
without pivoting in blocks (``options.SMALL``) and by MUMPS, whose dense kernels are faster for long
rows: 0.5 and 1.9 with 1,300 unknowns, 26 and 40 with 18,200 and 97 entries, 50 and 53 with 20,800
and 116 entries; on unstructured meshes 20 and 20 with 6,700 and 126 entries, 53 and 38 with 11,900
and 147.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Costs:
    """Measured costs, and sizes at which the choice changes.

    Hertz with 3,600 to 160,000 unknowns, degrees 1 and 2, one core.

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

    def factors(self, unknowns: int, iterations: int) -> float:
        """Time of ``iterations`` iterations with a factorization in each [s] (local)."""
        work = self._work(unknowns) * (self.first + iterations * self.iteration)
        return 1e-6 * (work + iterations * self.per_unknown * unknowns)

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
        """Number that is proportional to that of the entries of the factors."""
        return float(unknowns * np.log2(max(unknowns, 2)))


class SpaceCosts(Costs):
    """Costs in space, where a factorization takes the square of the unknowns."""

    def _work(self, unknowns: int) -> float:
        return float(unknowns) ** 2

    def _fill(self, unknowns: int) -> float:
        return float(unknowns) ** (4.0 / 3.0)


COSTS = Costs()
# Per square of the unknowns, memory per n^(4/3) of n unknowns. In a load step of five iterations
# one or two factorize, a third of a factorization in each; the others use earlier factors. Surfaces
# of flat blocks may be in contact everywhere, so that dense systems count. With 4,400, 13,200 and
# 20,300 unknowns the linear algebra of an iteration took 0.08, 0.4 and 0.6 s.
# CPU time of a solve, direct over iterative, of a half ball on a block: 0.9 with 11,000 unknowns,
# 2.9 with 50,000 (demos.studies.space.waits).
SPACE_COSTS = SpaceCosts(
    iteration=1e-3, first=0.0, once=3e-3, dense=2e-4, per_factor=250.0, per_unknown=13.0,
    per_solve=6e-5, many=15_000,
)  # fmt: skip


def costs_of(dim: int) -> Costs:
    """Costs of problems in the plane or in space (local)."""
    return COSTS if dim == 2 else SPACE_COSTS
