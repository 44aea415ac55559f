# SPDX-License-Identifier: MIT
"""Checkpoints: all data on which the next solve of a problem depends, in one .npz file.

In addition to the state, with the history functions of the bodies, these are data of earlier
solves: the weight of gaps after a cycle of active sets, offsets, the positions of obstacles for
which the operators of small sliding were evaluated, and the slip counted by a model check.
Partners of slave nodes follow from the state. A run continued from a checkpoint equals the
uninterrupted one, except for the initial guess of its first steps, which is extrapolated from the
last states of the same run only.

A checkpoint is compared with a problem by the names of the pairs, a digest of the cells and the
coordinates of all nodes, which do not depend on the number of ranks. That of a motion continues the
same motion only: scheme, spectral radius and masses are compared, too.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import INDEPENDENT
from fenics_mortar.contact.interface import Reference, place_of
from fenics_mortar.contact.law_calls import Instant
from fenics_mortar.io.paraview import check_problem
from fenics_mortar.mesh.space import mesh_by_input_node, set_by_input_node
from fenics_mortar.utils import errors, files
from fenics_mortar.utils.arrays import ROUNDING

if TYPE_CHECKING:
    from fenics_mortar.problem import ContactProblem

Arrays = dict[str, npt.NDArray[Any]]
# Name in the file of the time scheme of a motion; without it, the file is of a state at rest.
MOTION = "motion"
# Arrays that must be finite.
FINITE = (
    "velocity", "acceleration", "average", "u", "x", "places", "z", "conduction", "c_n", "offset",
    "clock", "memory", "history", "history_start",
)  # fmt: skip


def save_state(problem: ContactProblem, path: str | Path) -> None:
    """Write all data on which the next solve depends to an .npz file (collective).

    See ``checkpoint``. The file can be read on any number of ranks: nodes are identified by their
    number in the mesh input. An older file is replaced only after the new one is complete.

    Args:
        problem: The problem.
        path: Path of the file, used on the first rank; ``.npz`` is appended.

    Raises:
        MortarError: On all ranks, if the file cannot be written; an older file is kept.
    """
    file = _state_file(problem, path)
    files.make_folder(problem.equations.comm, file.parent)
    data, first = _arrays_of(problem), problem.equations.comm.rank == 0
    if problem.equations.model_check is not None:
        data |= problem.equations.model_check.saved_data(problem)
    write = partial(files.write_whole, file, lambda path: np.savez(path, **data))
    files.try_together(problem.equations.comm, first, write, f"cannot write '{file}'")


def load_state(problem: ContactProblem, path: str | Path) -> None:
    """Read a file of ``save_state`` into a problem on the same mesh (collective).

    Args:
        problem: The problem.
        path: Path of the file, used on the first rank; ``.npz`` is appended.

    Raises:
        MortarError: On all ranks, if the file cannot be read, belongs to another problem, mesh or
            motion, or is incomplete.
    """
    file = _state_file(problem, path)
    first, message = problem.equations.comm.rank == 0, f"cannot read '{file}'"
    data = files.try_together(problem.equations.comm, first, partial(_read_arrays, file), message)
    data = problem.equations.comm.bcast(data)
    wrong = next(_misfits(data, _arrays_of(problem)), "")
    if wrong:
        raise errors.MortarError(f"'{file}' {wrong}")
    bulk = problem.equations.bulk
    set_by_input_node(bulk.space, bulk.u, data["nodes"], data["u"])
    for i, contact in enumerate(problem.equations.contacts):
        if isinstance(contact, Contact):
            nodes, place = data[f"multiplier_nodes{i}"], data[f"reference_place{i}"]
            kept = None if np.isnan(place).any() else Reference(None, nodes, place)
            contact.change(reference=kept)
        contact.change(**{name: data[f"{name}{i}"][()] for name in INDEPENDENT})
        time, step = data[f"clock{i}"].tolist()
        memory = dict(zip(contact.accepted_instant.memory, data[f"memory{i}"], strict=True))
        contact.change(accepted_instant=Instant.of(time, step, memory), load_time=time)
    if bulk.inertia is not None:
        bulk.inertia.restore_data(data, bulk.values)
    here = problem.state()
    problem.restore(replace(here, places=data["places"], converged=bool(data["converged"])))
    problem.accept()
    bulk.history.restore_data(data)
    if problem.equations.model_check is not None:
        problem.equations.model_check.restore_data(problem, data)


def _arrays_of(problem: ContactProblem) -> Arrays:
    """Data of a problem for the file, equal on all ranks (collective)."""
    nodes, values = problem.equations.bulk.by_input_node()
    cells, x = mesh_by_input_node(problem.equations.bulk.V.mesh)
    names = [f"'{c.slave.name}' - '{c.master.name}'" for c in problem.equations.contacts]
    data: Arrays = {
        "pairs": np.array(names, str),
        "nodes": nodes,
        "x": x,
        "cells": np.frombuffer(hashlib.sha256(cells.tobytes()).digest(), np.uint8),
        "u": values,
        "places": problem.equations.motions.places,
        "converged": np.array(problem.state().converged),
    }
    inertia = problem.equations.bulk.inertia
    if inertia is not None:
        data |= {MOTION: np.array(inertia.scheme), "mass": np.array(inertia.largest_mass)}
        data |= inertia.saved_data()
    data |= problem.equations.bulk.history.saved_data()
    for i, contact in enumerate(problem.equations.contacts):
        kept = {name: getattr(contact.state, name) for name in INDEPENDENT}
        kept["reference_place"] = place_of(contact.state.reference, contact.obstacle)
        data |= {f"{name}{i}": np.asarray(value) for name, value in kept.items()}
        instant, count = contact.accepted_instant, contact.slave.num_nodes
        data[f"memorized{i}"] = np.array(list(instant.memory), str)
        data[f"clock{i}"] = np.array([instant.time, instant.step])
        data[f"memory{i}"] = np.array(list(instant.memory.values()), float).reshape(-1, count)
    return data


def _misfits(data: Arrays, mine: Arrays) -> Iterator[str]:
    """Reasons why data of a file are not a state of the present problem (local)."""
    other = "is the state of a problem with other pairs, or on another mesh or degree"
    theirs, ours = (str(some.get(MOTION, "")) for some in (data, mine))
    if theirs and not ours:
        yield (
            f"is a state of a motion, of Dynamics with {theirs}, and this problem is one of "
            "statics: set up the same Dynamics of it before load_state"
        )
    if ours and not theirs and "velocity" not in data:
        yield (
            f"is a state at rest, and this problem has a Dynamics with {ours}: use load_state "
            "before Dynamics(...), which starts at rest from it"
        )
    if ours and theirs and ours != theirs:
        yield (
            f"is a state of Dynamics with {theirs}, and this problem has {ours}: set up a Dynamics "
            "with the scheme of the file"
        )
    counts = [sum(n.startswith("history_start") for n in some) for some in (data, mine)]
    if counts[0] != counts[1]:
        theirs, ours = map(str, counts)
        yield f"is the state of a problem with {theirs} history functions; this one has {ours}"
        return
    missing = sorted(set(mine) - set(data))
    if missing:
        yield f"is not a state of this problem: '{missing[0]}' is missing"
    if not np.array_equal(data["pairs"], mine["pairs"]):
        theirs, ours = (", ".join(map(str, some["pairs"].ravel())) for some in (data, mine))
        yield f"is the state of a problem with other pairs: {theirs}; this one has {ours}"
    for name, own in mine.items():
        its = data[name]
        if name.startswith("memorized") and not np.array_equal(its, own):
            theirs, ours = (", ".join(some.tolist()) or "none" for some in (its, own))
            yield f"has the memory of another contact law: {theirs}; this problem has {ours}"
        if its.shape != own.shape or not np.can_cast(its.dtype, own.dtype, "same_kind"):
            yield f"{other}: '{name}' has shape {its.shape}, expected {own.shape}"
        if name.rstrip("0123456789") in FINITE and not np.isfinite(its).all():
            yield f"is not a state to continue from: '{name}' is not finite"
    if not np.array_equal(data["nodes"], mine["nodes"]):
        yield f"{other}: its nodes have other numbers"
    distance = np.abs(data["x"] - mine["x"]).max(axis=1, initial=0.0)
    if not (distance <= ROUNDING * np.abs(mine["x"]).max(initial=0.0)).all():
        where, far = errors.format_point(mine["x"][distance.argmax()]), distance.max()
        yield f"{other}: its node at {where} is {far:.3g} away from this position"
    same = [np.array_equal(data[n], mine[n]) for n in ("cells", "history_cells") if n in mine]
    if not all(same):
        yield f"{other}: its cells have other nodes"
    if ours and not np.isclose(data["mass"], mine["mass"], rtol=ROUNDING, atol=0.0):
        yield (
            f"is a state of bodies with other masses: the largest one of a node is "
            f"{data['mass']:.6g}, here {mine['mass']:.6g}; give Dynamics the density of the file"
        )


def _state_file(problem: ContactProblem, path: str | Path) -> Path:
    """Path with the suffix .npz, which numpy requires; reject other objects (collective)."""
    check_problem(problem)
    stem = files.without_suffix(problem.equations.comm, path, ".npz")
    return stem.with_name(f"{stem.name}.npz")


def _read_arrays(file: Path) -> Arrays:
    """Read all arrays of an .npz file, without pickled objects (local)."""
    with np.load(file) as arrays:
        data = dict(arrays)
    if MOTION in data:  # files of earlier versions do not have it
        data.setdefault("largest_kinetic", np.array(0.0))
    return data
