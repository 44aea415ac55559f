# SPDX-License-Identifier: MIT
"""What is refused when a problem is set up, before anything is computed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import ufl

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.interface import Interface
from fenics_mortar.mesh.reading import check_plane
from fenics_mortar.utils import compat
from fenics_mortar.utils.arguments import check_kind
from fenics_mortar.utils.errors import MeshError, MortarError, SurfaceError, place


def check_space(V: Any, pairs: Sequence[Any]) -> None:
    """Refuse spaces and meshes that the package cannot work on (collective)."""
    mesh = V.mesh
    if compat.scalar_is_complex():
        raise MortarError("PETSc has complex scalars; install the real build (petsc-real)")
    check_plane(mesh)
    _check_coordinates(mesh)
    corners = {"triangle": 3, "quadrilateral": 4}[compat.cell_name(mesh)]
    nodes = {1: corners, 2: {3: 6, 4: 9}[corners]}
    layout = V.dofmap.dof_layout
    degrees = [degree for degree, count in nodes.items() if layout.num_dofs == count]
    at_vertices = len(layout.entity_dofs(0, 0)) == 1
    if V.dofmap.index_map_bs != 2 or not at_vertices or not degrees:
        raise MortarError(
            "the displacement is not in the Lagrange space of plane vectors of degree 1 or 2 (P1, "
            "Q1, P2 or Q2): use vector_space(mesh, 1) or vector_space(mesh, 2)"
        )
    if compat.geometry_dofmap(mesh).shape[1] not in (corners, nodes[degrees[0]]):
        raise MeshError(
            "the mesh has curved cells; contact needs straight ones, of first order, or of second "
            "order together with a displacement of degree 2"
        )
    for pair in pairs:
        if pair.data.mesh is not mesh:
            raise MeshError(
                f"the pair '{pair.slave_name}' - '{pair.master_name}' belongs to another mesh"
            )


def _check_coordinates(mesh: Any) -> None:
    """Refuse nan and inf; a node without a place is called by its number in the input."""
    bad = ~np.isfinite(mesh.geometry.x).all(axis=1)
    numbers = np.unique(
        np.concatenate(mesh.comm.allgather(np.asarray(mesh.geometry.input_global_indices)[bad]))
    )
    if numbers.size:
        raise MeshError(
            f"coordinates of {numbers.size} nodes are not finite, e.g. of node {numbers[0]} "
            "(counted from 0, as given)"
        )


def check_slave_nodes(contacts: Sequence[Interface]) -> None:
    """Refuse nodes that are slaves of the same master, or of the same obstacle, in two pairs."""
    for i, one in enumerate(contacts):
        for other in contacts[i + 1 :]:
            both = np.intersect1d(one.multiplier_nodes, other.multiplier_nodes)
            if both.size and one.has_master_of(other):
                where = one.slave.X[np.flatnonzero(one.slave.nodes == both[0])[0]]
                raise SurfaceError(
                    f"{both.size} nodes are slaves of '{one.master.name}' in two pairs, with "
                    f"'{one.slave.name}' and '{other.slave.name}', one at {place(where)}; give "
                    "both sides one name, or make one of the two a master there"
                )


def check_residual(name: str, residual: Any, u: Any) -> None:
    """Refuse what is no residual in the space of ``u`` (local).

    Raises:
        ValueError: If the form has another number of test functions, one of another space, or does
            not hold ``u``.
    """
    right = (
        "the residual has to hold one test function and no trial function; of an energy, "
        "it is ufl.derivative(energy, u, v)"
    )
    _check_form(name, residual, 1, u, right)
    if u not in residual.coefficients():
        raise ValueError(f"the {name} does not hold u, the function that is to be solved for")


def check_jacobian(jacobian: Any, u: Any) -> None:
    """Refuse what is no tangent in the space of ``u`` (local).

    Raises:
        ValueError: If the form has another number of arguments, or one of another space.
    """
    right = "the jacobian has to hold one test and one trial function"
    _check_form("jacobian", jacobian, 2, u, right)


def _check_form(name: str, form: Any, count: int, u: Any, right: str) -> None:
    """Refuse a form with another number of arguments than ``count``, or of another space."""
    check_kind(name, form, ufl.Form, "a UFL form")
    try:
        arguments = form.arguments()
    except Exception as error:  # UFL's, of a name that changes
        raise ValueError(f"the {name} holds test functions of several spaces: {error}") from error
    if len(arguments) != count:
        raise ValueError(right)
    V = u.function_space
    for argument in arguments:
        space = argument.ufl_function_space()
        if space.ufl_domain() != V.ufl_domain() or space.ufl_element() != V.ufl_element():
            kind = "test" if argument.number() == 0 else "trial"
            raise ValueError(
                f"the {kind} function of the {name} is of another space than u: it is of "
                f"{space.ufl_element()}, u of {V.ufl_element()}"
                + " on another mesh" * (space.ufl_domain() != V.ufl_domain())
                + f"; right is ufl.{kind.capitalize()}Function(u.function_space)"
            )


def check_cells(bulk: Bulk) -> None:
    """Refuse cells without area (collective)."""
    count, where = bulk.flat_cells()
    if count:
        raise MeshError(f"{count} cells have no area, one at {where}")
