# SPDX-License-Identifier: MIT
"""Measured costs of linear solvers, by which they are chosen.

A linear bulk needs one factorization, or one in every Newton iteration: both costs are predicted.
In the plane, the cost of MUMPS per unknown is nearly constant from 5,000 to 160,000 unknowns. The
compliance of the contact dofs is a dense matrix with cubic cost. Only ratios of the constants
matter.

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

    def factors(self, unknowns: int, iterations: int) -> float:
        """Time of ``iterations`` iterations with a factorization in each [s] (local)."""
        return 1e-6 * unknowns * (self.first + iterations * self.iteration)

    def compliance(self, unknowns: int, contact_dofs: int) -> float:
        """Time to compute the compliance of the contact dofs [s] (local)."""
        return 1e-6 * (self.once * unknowns + self.dense * contact_dofs**3)

    def fits(self, unknowns: int, contact_dofs: int) -> bool:
        """Whether dense matrices of the contact dofs need at most the memory of the factors."""
        factors = self.per_factor * unknowns * np.log2(max(unknowns, 2))
        return bool(self.per_entry * contact_dofs**2 <= factors)


COSTS = Costs()
