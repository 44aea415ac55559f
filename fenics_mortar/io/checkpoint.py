# SPDX-License-Identifier: MIT
"""Checkpoints: all that the next solve of a problem depends on, in one .npz file.

Beside the state these are what earlier solves have left behind: the weight of gaps after a cycle of
sets, offsets, the places of obstacles for which the operators of small sliding were evaluated, and
how far a climb through cheaper models has come. What slave nodes faced follows from the state. A
run that goes on from a checkpoint is the uninterrupted one, but for the start of its first step:
``follow_path`` extrapolates the steps that it has taken itself.

Whether a checkpoint belongs to a problem is seen from the names of its pairs, a digest of the cells
and the coordinates of all nodes, none of which depends on the number of ranks.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.contact import Contact
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils import compat
from fenics_mortar.utils.errors import MortarError, place
from fenics_mortar.utils.files import make_folder, try_together, without_suffix, write_whole
from fenics_mortar.utils.rounding import ROUNDING

Arrays = dict[str, npt.NDArray[Any]]
# What of a contact is written to a file.
KEPT = ("z", "active", "carries", "piece", "c_n", "offset", "reference_place")
# The place of a reference that there is not.
NO_PLACE = np.full(3, np.nan)
# What is refused if it is not finite.
FINITE = ("u", "x", "places", "z", "c_n", "offset")


def save_state(problem: ContactProblem, path: str | Path) -> None:
    """Write all that the next solve depends on as .npz (collective); see ``checkpoint``.

    It can be read on any number of ranks: nodes are known by their number in the mesh's input. The
    file replaces an older one only when it is whole.

    Raises:
        MortarError: On all ranks, if the file cannot be written; an older one is still there.
    """
    file = _state_file(problem, path)
    make_folder(problem.comm, file.parent)
    data, first = _arrays_of(problem), problem.comm.rank == 0
    if problem.adequacy is not None:
        data |= problem.adequacy.kept(problem)
    write = partial(write_whole, file, partial(_write_arrays, data))
    try_together(problem.comm, first, write, f"cannot write '{file}'")


def load_state(problem: ContactProblem, path: str | Path) -> None:
    """Read what ``save_state`` wrote into a problem on the same mesh (collective).

    Raises:
        MortarError: On all ranks, if there is no such file, if it is that of another problem or
            mesh, or if something of it is missing.
    """
    file = _state_file(problem, path)
    first, message = problem.comm.rank == 0, f"cannot read '{file}'"
    data = try_together(problem.comm, first, partial(_read_arrays, file), message)
    data = problem.comm.bcast(data)
    wrong = next(_misfits(data, _arrays_of(problem)), "")
    if wrong:
        raise MortarError(f"'{file}' {wrong}")
    problem.bulk.set_by_input_node(data["nodes"], data["u"])
    kept: dict[str, list[Any]] = {
        name: [data[f"{name}{i}"] for i in range(len(problem.contacts))] for name in KEPT
    }
    for i, contact in enumerate(problem.contacts):
        contact.c_n, contact.offset = float(kept["c_n"][i]), kept["offset"][i]
        if isinstance(contact, Contact):
            contact.refer_to(kept["reference_place"][i], kept["carries"][i])
    state: dict[str, Any] = {name: kept[name] for name in ("z", "active", "carries", "piece")}
    state |= {"places": data["places"], "converged": bool(data["converged"])}
    problem.restore(replace(problem.state(), **state))
    problem.accept()
    if problem.adequacy is not None:
        problem.adequacy.take(problem, data)


def _arrays_of(problem: ContactProblem) -> Arrays:
    """All that is written of a problem, the same on all ranks (collective)."""
    nodes, values = problem.bulk.by_input_node()
    cells, x = compat.mesh_by_input_node(problem.bulk.V.mesh)
    names = [f"'{c.slave.name}' - '{c.master.name}'" for c in problem.contacts]
    data: Arrays = {
        "pairs": np.array(names, str),
        "nodes": nodes,
        "x": x,
        "cells": np.frombuffer(hashlib.sha256(cells.tobytes()).digest(), np.uint8),
        "u": values,
        "places": problem.tools.places,
        "converged": np.array(problem.state().converged),
    }
    for i, contact in enumerate(problem.contacts):
        kept = {name: getattr(contact, name, NO_PLACE) for name in KEPT}  # ties have none
        data |= {f"{name}{i}": np.asarray(value) for name, value in kept.items()}
    return data


def _misfits(data: Arrays, mine: Arrays) -> Iterator[str]:
    """Why what was read cannot be taken for a state of the present problem, in words."""
    other = "is the state of a problem with other pairs, or on another mesh or degree"
    missing = sorted(set(mine) - set(data))
    if missing:
        yield f"is no state of this problem: '{missing[0]}' is missing in it"
    if not np.array_equal(data["pairs"], mine["pairs"]):
        theirs, ours = (", ".join(map(str, some["pairs"].ravel())) for some in (data, mine))
        yield f"is the state of a problem with other pairs: {theirs}; here are {ours}"
    for name, own in mine.items():
        its = data[name]
        if its.shape != own.shape or not np.can_cast(its.dtype, own.dtype, "same_kind"):
            yield f"{other}: '{name}' has the shape {its.shape}, here it is {own.shape}"
        if name.rstrip("0123456789") in FINITE and not np.isfinite(its).all():
            yield f"is no state to go on from: '{name}' is not finite"
    if not np.array_equal(data["nodes"], mine["nodes"]):
        yield f"{other}: its nodes have other numbers"
    apart = np.abs(data["x"] - mine["x"]).max(axis=1, initial=0.0)
    if not (apart <= ROUNDING * np.abs(mine["x"]).max(initial=0.0)).all():
        where = mine["x"][apart.argmax()]
        yield f"{other}: the node at {place(where)} is {apart.max():.3g} elsewhere in it"
    if not np.array_equal(data["cells"], mine["cells"]):
        yield f"{other}: its cells join other nodes"


def _state_file(problem: ContactProblem, path: str | Path) -> Path:
    """Numpy writes to names that end in .npz only (collective)."""
    stem = without_suffix(problem.comm, path, ".npz")
    return stem.with_name(f"{stem.name}.npz")


def _write_arrays(data: Arrays, path: Path) -> None:
    np.savez(path, **data)


def _read_arrays(file: Path) -> Arrays:
    """All arrays of an .npz file, without pickled objects."""
    with np.load(file) as arrays:
        return dict(arrays)
