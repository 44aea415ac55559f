# SPDX-License-Identifier: MIT
"""The log names what is compiled, not what comes from a cache."""

import logging
import uuid

from mpi4py import MPI

import numba
import numpy as np
import pytest

import ufl
from dolfinx import mesh

from fenics_mortar.utils import compat

pytestmark = pytest.mark.serial


def test_a_form_is_named_when_it_is_compiled(caplog):
    caplog.set_level(logging.INFO, "fenics_mortar")
    square = mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
    new = float(uuid.uuid4().int % 10**12)  # in no cache
    area = new * ufl.dx(domain=square)
    compat.form(area)
    (message,) = (record.getMessage() for record in caplog.records)
    assert message.startswith("compiled an integral in ")
    compat.form(area)
    assert len(caplog.records) == 1


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
@pytest.mark.parametrize(
    "module, count", [("fenics_mortar.kernels.one", 1), ("users", 0), (None, 0)]
)
def test_a_kernel_is_named_when_it_is_compiled(module, count, caplog):
    caplog.set_level(logging.INFO, "fenics_mortar")

    def double(x):
        return 2.0 * x

    double.__module__ = module
    compiled = numba.njit(double)
    assert compiled(1.0) == compiled(1.0) == 2.0
    assert len(caplog.records) == count
    assert all("double" in record.getMessage() for record in caplog.records)


def test_wrappers_of_numba_that_have_no_module_are_compiled():
    """``np.full`` with a tuple has such a wrapper; with an empty cache its kernels failed."""

    def filled(n):
        return np.full((n, 2), -1)

    assert numba.njit(filled)(3).sum() == -6
