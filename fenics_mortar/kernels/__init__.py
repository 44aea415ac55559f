# SPDX-License-Identifier: MIT
"""Numba kernels: arrays in, arrays out; no MPI, PETSc, dolfinx or UFL.

Every kernel runs also with ``NUMBA_DISABLE_JIT=1``. Those without comparisons take complex
numbers, so that each derivative can be checked by a complex step. There is no ``fastmath``: it
may drop the inf and nan that indicate a failed projection.
"""

import logging
import os
import sys
import time

import numba
from numba import types
from numba.core.compiler import Compiler

# Time of compilation between two messages on standard error [s].
INTERVAL = 5.0
# Variables in which Open MPI, MPICH and Slurm give the number of the rank: one rank is enough.
RANK = ("OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK", "SLURM_PROCID")


class _Progress:
    """Kernels defined and compiled in this process, and the time that it took.

    Where compilation takes long, as in the first run, standard error says how far it is.
    """

    def __init__(self) -> None:
        self.defined = self.compiled = 0
        self._depth, self._began, self._spent, self._next = 0, 0.0, 0.0, INTERVAL
        self._prints = next((os.environ[v] for v in RANK if v in os.environ), "0") == "0"

    def begin(self) -> None:
        """A kernel is compiled now, perhaps within another one that calls it."""
        self.compiled += 1
        if self._depth == 0:
            self._began = time.monotonic()
        self._depth += 1
        seconds = self._spent + time.monotonic() - self._began
        if seconds >= self._next and self._prints:
            self._next = seconds + INTERVAL
            print(
                f"fenics_mortar: compiling kernel {self.compiled} of about {self.defined} "
                f"({seconds:.0f} s; later runs load them from the cache)",
                file=sys.stderr, flush=True,
            )  # fmt: skip

    def end(self) -> None:
        """The kernel is compiled."""
        self._depth -= 1
        if self._depth == 0:
            self._spent += time.monotonic() - self._began


_progress = _Progress()


class _NamingCompiler(Compiler):
    """Numba's compiler, which logs the kernels that it compiles at level INFO.

    Kernels that are loaded from the cache are not logged, nor are functions of others.
    """

    def compile_extra(self, func):
        """Log the name of the kernel, and compile it."""
        logging.getLogger("fenics_mortar").info(
            "compiling the kernel %s; later runs load it from the cache", func.__qualname__
        )
        _progress.begin()
        try:
            return super().compile_extra(func)
        finally:
            _progress.end()


_compiled = numba.njit(
    cache=True, error_model="numpy", no_cfunc_wrapper=True, pipeline_class=_NamingCompiler
)


def kernel(function):
    """Decorate a function that numba compiles at its first call with each kind of arguments.

    Calls with different constants share one compiled function, which LLVM inlines where it pays;
    numba alone would compile it for each constant. Nothing is compiled for calls from C.
    """
    _progress.defined += 1
    compiled = _compiled(function)
    if compiled is not function:  # NUMBA_DISABLE_JIT
        template = compiled.get_call_template
        compiled.get_call_template = lambda args, kws: template(
            tuple(map(types.unliteral, args)), {k: types.unliteral(v) for k, v in kws.items()}
        )
    return compiled
