# SPDX-License-Identifier: MIT
"""Numba kernels: arrays in, arrays out; no MPI, PETSc, dolfinx or UFL.

Every kernel runs also with ``NUMBA_DISABLE_JIT=1``. Those without comparisons take complex
numbers, so that each derivative can be checked by a complex step. There is no ``fastmath``: it
may drop the inf and nan by which a failed projection is seen.
"""

import numba

kernel = numba.njit(cache=True, error_model="numpy")
