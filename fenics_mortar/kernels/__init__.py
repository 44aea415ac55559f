# SPDX-License-Identifier: MIT
"""Numba kernels: arrays in, arrays out; no MPI, PETSc, dolfinx or UFL.

Every kernel runs also with ``NUMBA_DISABLE_JIT=1``. Those without comparisons take complex
numbers, so that each derivative can be checked by a complex step. There is no ``fastmath``: it
may drop the inf and nan that indicate a failed projection.
"""

import logging

import numba
from numba.core.compiler import Compiler


class _NamingCompiler(Compiler):
    """Numba's compiler, which logs the kernels that it compiles at level INFO.

    Kernels that are loaded from the cache are not logged, nor are functions of others.
    """

    def compile_extra(self, func):
        """Log the name of the kernel, and compile it."""
        logging.getLogger("fenics_mortar").info(
            "compiling the kernel %s; later runs load it from the cache", func.__qualname__
        )
        return super().compile_extra(func)


kernel = numba.njit(cache=True, error_model="numpy", pipeline_class=_NamingCompiler)
