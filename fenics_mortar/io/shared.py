# SPDX-License-Identifier: MIT
"""Helpers of all output: cells of this rank, padded arrays, paths."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils import compat
from fenics_mortar.utils.arguments import check_kind
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.files import make_folder, without_suffix


def check_problem(problem: Any) -> None:
    """Reject objects that are not problems (local).

    Raises:
        ValueError: If the object is not a problem.
    """
    check_kind("problem", problem, ContactProblem, "a ContactProblem")


def owned_cells(problem: ContactProblem) -> Indices:
    """Nodes of the owned cells, shape (cells, nodes), in the order of dolfinx (local)."""
    num_cells = problem.equations.bulk.V.mesh.topology.index_map(2).size_local
    return compat.dofmap(problem.equations.bulk.V)[:num_cells].astype(np.int64)


def pad(values: Array) -> Array:
    """Pad ``values`` with zeros to three dimensions, in their unit, as VTK expects them (local).

    Args:
        values: Scalars (n,), vectors (n, a) or tensors (n, a, b) with a and b up to 3 [any unit].

    Returns:
        Scalars unchanged, vectors (n, 3), tensors row by row, shape (n, 9).
    """
    rank = values.ndim - 1
    padded = np.zeros((len(values), *rank * (3,)))
    padded[tuple(slice(size) for size in values.shape)] = values
    return padded.reshape(len(values), 3**rank) if rank else padded


def prepare_path(comm: MPI.Comm, path: str | Path, suffix: str) -> Path:
    """Create the folder; return the path of the first rank without its suffix (collective).

    Raises:
        MortarError: On all ranks, if the path has no file name or the folder cannot be created.
    """
    path = without_suffix(comm, path, suffix)
    make_folder(comm, path.parent)
    return path
