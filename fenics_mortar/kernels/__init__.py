# SPDX-License-Identifier: MIT
"""Numba kernels: arrays in, arrays out; no MPI, PETSc, dolfinx or UFL.

Every kernel runs also with ``NUMBA_DISABLE_JIT=1``. Those without comparisons take complex
numbers, so that each derivative can be checked by a complex step. There is no ``fastmath``: it
may drop the inf and nan that indicate a failed projection.
"""

import logging

import numba
from numba.core import event


class _Compilations(event.Listener):
    """Logs each kernel of the package that is compiled, not loaded from the cache; level INFO."""

    def on_start(self, begun):
        """Log the name of the kernel."""
        function = begun.data["dispatcher"].py_func
        if str(function.__module__).startswith(__name__):  # numba's own may have none
            logging.getLogger("fenics_mortar").info(
                "compiling the kernel %s; later runs load it from the cache", function.__qualname__
            )

    def on_end(self, ended):
        """Log nothing."""


event.register("numba:compile", _Compilations())
kernel = numba.njit(cache=True, error_model="numpy")
