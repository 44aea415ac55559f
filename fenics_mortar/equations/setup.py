# SPDX-License-Identifier: MIT
"""Set-up of a problem: check of arguments, binding of pairs to the mesh (collective).

Outlines of the bodies that limit the search of each pair (local).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from dolfinx import fem

from fenics_mortar.bulk.axis import check_axis, check_radius
from fenics_mortar.bulk.bodies import check_mesh_overlap
from fenics_mortar.bulk.checks import (
    check_cells,
    check_slave_nodes,
    check_space,
    check_subdomains,
    refuse_inertia,
)
from fenics_mortar.bulk.form_points import check_rules
from fenics_mortar.bulk.residual import Bulk, mark_prescribed
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.contact.pair import ContactPair, TiedPair
from fenics_mortar.contact.tied import Tie, bind
from fenics_mortar.equations.arguments import (
    check_arguments,
    check_given_in_space,
    check_options,
    check_pairs_in_space,
)
from fenics_mortar.equations.general import ContactEquations
from fenics_mortar.equations.inputs import check_roles
from fenics_mortar.equations.solver import Solver
from fenics_mortar.interface.mortar import LINEARIZATIONS
from fenics_mortar.interface.outline import Outline
from fenics_mortar.la.choice import system_of
from fenics_mortar.mesh.space import DisplacementSpace, thickness_of
from fenics_mortar.newton.loop import NewtonOptions
from fenics_mortar.rigid.spread import check_remote, sections_of
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import check_kind, check_no_effect, check_same_texts, together
from fenics_mortar.utils.petsc import free_garbage_of_earlier, keep_communicators


def set_outlines(contacts: Sequence[Contact | Tie], outline: Outline, labels: Array) -> None:
    """Pass the outlines of the bodies to each pair, ties first; tied bodies are treated as one.

    Args:
        contacts: The pairs.
        outline: The outlines of the bodies.
        labels: Body of each node of the outlines with tied bodies joined, shape (nodes, 1).
    """
    outline = replace(outline, bodies=labels[:, 0].astype(np.int64))
    for contact in sorted(contacts, key=lambda contact: isinstance(contact, Contact)):
        outline = contact.limit_sight(outline)


def check_given(
    given: dict[str, Any], pairs: Sequence[ContactPair | TiedPair], model_check: Any
) -> None:
    """Reject arguments of a wrong type, or that differ between ranks (collective).

    Args:
        given: Arguments of ``ContactProblem`` by name, without pairs and model check.
        pairs: The pairs.
        model_check: Check of the model, or ``None``.

    Raises:
        ValueError: On all ranks, if an argument has a value that is not allowed.
        MortarError: On all ranks, if arguments differ between ranks.
        NotImplementedError: On all ranks, if an argument needs the plane.
    """
    lists = ("bcs", "remote", "history")
    forms = ("residual", "u", "jacobian", "before_assembly", *lists)
    options = {name: value for name, value in given.items() if name not in forms}
    check_kind("u", given["u"], fem.Function, "a function of dolfinx")
    mesh = given["u"].function_space.mesh
    comm = mesh.comm
    if comm.size > 1:
        compat.settle_coordinate_element(mesh)
    with together(comm, "ContactProblem"):
        check_arguments(pairs, given)
        check_remote(given["remote"])
        check_options(given, model_check)
        beyond = [name for name in ("history", "before_assembly") if given[name]]
        if beyond and model_check is not None:
            raise ValueError(f"model_check does not support {beyond[0]}")
        signature = given["residual"].signature()
        options["residual"] = f"a form with the signature {signature[:8]}"
    check_given_in_space(given)
    options |= {f"pair {number}": vars(pair) for number, pair in enumerate(pairs)}
    counts = {"pairs": len(pairs), **{name: len(given[name]) for name in lists}}
    check_same_texts(comm, "ContactProblem", {**counts, **options})


def check_attributes(problem: Any, given: dict[str, Any]) -> None:
    """Reject arguments of ``ContactProblem`` that were set as attributes later (collective).

    Raises:
        ValueError: On all ranks.
    """
    cure = "set up a new problem, or see variant(); problem.equations.newton may be set"
    with together(problem.equations.comm, "ContactProblem"):
        check_no_effect("the problem", problem, [*given, "pairs", "model_check"], cure)


def equations_of(
    given: dict[str, Any], pairs: Sequence[ContactPair | TiedPair]
) -> ContactEquations:
    """Equations of a problem, for arguments of ``ContactProblem`` by name (collective).

    Gaps of ties are removed from the mesh.

    Raises:
        MortarError: On all ranks, if the mesh or a surface is unsuitable.
        ValueError: On all ranks, if ``u`` is a mixed function and the solver iterative.
    """
    residual, u, jacobian = (given[name] for name in ("residual", "u", "jacobian"))
    free_garbage_of_earlier(u.function_space.mesh.comm)
    weight = thickness_of(given["geometry"], given["thickness"])
    space = DisplacementSpace(u.function_space, given["displacement"], weight)
    check_space(space.V, pairs)
    check_pairs_in_space(pairs)
    for name, form in (("residual", residual), ("jacobian", jacobian)):
        if form is not None:
            check_subdomains(name, form, space.V.mesh, [pair.data for pair in pairs])
    if given["solver"] == "iterative" and space.is_mixed:
        raise ValueError("solver='iterative': mixed functions need solver='direct'")
    loads = [load.bind(space) for load in given["remote"]]
    bcs = [*given["bcs"], *(load for load in loads if hasattr(load, "dof_indices"))]
    prescribed = mark_prescribed(space, u, bcs)
    check_axis(space, prescribed)
    check_radius(residual, u, space)
    check_rules(residual, u, space)
    contacts = bind(
        pairs, space, prescribed, chains=given["algorithm"] != "condensed"
    )  # may move nodes
    for load in loads:
        load.update_reference()
    loads += sections_of(contacts)
    bulk = Bulk(residual, u, bcs, jacobian, space, given["history"], given["before_assembly"])
    bulk.surfaces_slide = any(p.sliding == "finite" for p in pairs if isinstance(p, ContactPair))
    keep_communicators(bulk.comm, bulk.r, bulk.K)
    check_slave_nodes(contacts)
    check_roles(contacts)
    check_cells(bulk)
    check_mesh_overlap(space, contacts)
    bulk.input_data.check()
    linearization, newton = LINEARIZATIONS[given["linearization"]], given["newton"]
    newton = newton or NewtonOptions()
    equations = ContactEquations(bulk, contacts, linearization, newton, loads)
    outline, labels = equations.crossings.outline, equations.floating.labels
    set_outlines(contacts, outline, outline.gather(bulk.space.spread(labels)))
    return equations


def solver_of(equations: ContactEquations, given: dict[str, Any]) -> Solver:
    """Solver of equations, for arguments of ``ContactProblem`` by name (collective)."""
    prefix, solver, linear_bulk = (
        given[name] for name in ("petsc_options_prefix", "solver", "linear_bulk")
    )
    if solver == "iterative" and linear_bulk is None:
        linear_bulk = False  # the factors may exceed the memory
    create_system = system_of(
        equations.bulk, equations.contacts, prefix, given["petsc_options"], given["algorithm"],
        solver, linear_bulk,
    )  # fmt: skip
    return Solver(equations, create_system, linear_bulk=linear_bulk, prefix=prefix)


@contextmanager
def undeformed(equations: ContactEquations, purpose: str) -> Iterator[None]:
    """Context in which the displacement is zero, as a set-up requires (collective).

    Args:
        equations: The equations of a problem.
        purpose: The caller, for the error.

    Raises:
        MortarError: On all ranks, if bodies have inertia.
    """
    refuse_inertia(equations.bulk, purpose)
    u = equations.bulk.u.x.array
    kept = u.copy()
    try:
        u[:] = 0.0
        yield
    finally:
        u[:] = kept


def pairs_with(
    options: dict[str, Any], contacts: Sequence[Interface]
) -> list[ContactPair | TiedPair]:
    """Pairs of interfaces for another problem, contact pairs with new options (local).

    Raises:
        ValueError: If a contact pair has no such attribute.
    """
    pairs = [contact.pair for contact in contacts]
    return [p.with_options(**options) if isinstance(p, ContactPair) else copy(p) for p in pairs]
