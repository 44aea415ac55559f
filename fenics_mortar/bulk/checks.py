# SPDX-License-Identifier: MIT
"""Checks at the set-up of a problem: space, mesh, forms and their tags, pairs."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from ufl.coefficient import Coefficient
from ufl.constantvalue import ScalarValue
from ufl.corealg.traversal import unique_pre_traversal
from ufl.geometry import GeometricQuantity

from fenics_mortar.interface.corners import TURN
from fenics_mortar.interface.self_contact import shared_nodes
from fenics_mortar.interface.surfaces import Surface, outward_normals
from fenics_mortar.mesh.data import MeshData, check_solid, check_tags
from fenics_mortar.utils import compat, errors, ranks
from fenics_mortar.utils.arrays import ROUNDING, Array, Indices

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.contact.pair import ContactPair, TiedPair
    from fenics_mortar.mesh.space import DisplacementSpace

# Name of the measure, dimension of the mesh minus that of its entities, and descriptions of one and
# of all of these, by UFL's type of integral.
MEASURES = {
    "cell": ("dx", 0, "cell", "cells"),
    "exterior_facet": ("ds", 1, "facet of the boundary", "the boundary"),
    "interior_facet": ("dS", 1, "facet inside the bodies", "inner facets"),
}


def check_subdomains(what: str, form: Any, mesh: dmesh.Mesh, named: Sequence[MeshData]) -> None:
    """Reject integrals over tags of another mesh, or that no entity has (collective).

    Args:
        what: Description of the form, for the message.
        form: The UFL form.
        mesh: The mesh.
        named: Meshes with names, which are listed in the message.

    Raises:
        MeshError: On all ranks.
    """
    for kind, (measure, codimension, entity, _) in MEASURES.items():
        dim = mesh.topology.dim - codimension
        integrals = [i for i in form.integrals() if i.integral_type() == kind]
        numbers = sorted(set().union(*(_numbers(i.subdomain_id()) for i in integrals)))
        given = (i.subdomain_data() for i in integrals)
        tags: Any = next((data for data in given if data is not None), None)
        if hasattr(tags, "find"):
            check_tags(f"the tags of {measure} in the {what}", tags, mesh)
            if tags.dim != dim:
                raise errors.MeshError(
                    f"the tags of {measure} in the {what} are of dimension {tags.dim}; expected "
                    f"tags of dimension {dim}"
                )
        if not numbers:
            continue
        where = f"the {what} has an integral over {measure}({{}})"
        if tags is None:
            name = "cell_tags" if codimension == 0 else "facet_tags"
            raise errors.MeshError(
                f"{where.format(numbers[0])}, but this measure has no tags, and the integral would "
                f"be zero: give it subdomain_data=data.{name}"
            )
        here = _tags_with_entities(tags, kind, mesh)
        present = sorted(set().union(*mesh.comm.allgather(here)))
        missing = [number for number in numbers if number not in present]
        if missing:
            raise errors.MeshError(
                f"{where.format(missing[0])}, but no {entity} has the tag {missing[0]}, and the "
                f"integral would be zero; the tags there are {_listed(present, tags, named)}: "
                "correct the tag, or leave out the integral"
            )


def _numbers(subdomain: Any) -> set[int]:
    """Tags of an integral, without "everywhere" and "otherwise" (local)."""
    several = subdomain if isinstance(subdomain, tuple) else (subdomain,)
    return {int(number) for number in several if not isinstance(number, str)}


def _tags_with_entities(tags: Any, kind: str, mesh: dmesh.Mesh) -> set[int]:
    """Tags of the entities of this rank over which a form is integrated (local).

    Later releases of dolfinx also take pairs of a tag and its entities.
    """
    if not hasattr(tags, "find"):
        return {int(number) for number, entities in tags if len(entities)}
    dim = mesh.topology.dim
    if kind == "cell":
        used: Indices = np.arange(mesh.topology.index_map(dim).size_local)
    else:
        mesh.topology.create_connectivity(dim - 1, dim)
        used = dmesh.exterior_facet_indices(mesh.topology)
        if kind == "interior_facet":
            used = np.setdiff1d(np.arange(mesh.topology.index_map(dim - 1).size_local), used)
    return {int(tag) for tag in np.unique(tags.values[np.isin(tags.indices, used)])}


def _listed(present: Sequence[int], tags: Any, named: Sequence[MeshData]) -> str:
    """The tags with entities, with their names if they have one (local)."""
    name_of = {
        tag: name
        for data in named
        for own, names in ((data.facet_tags, data.boundaries), (data.cell_tags, data.bodies))
        if own is tags
        for name, tag in names.items()
    }
    shown = [f"{tag} ('{name_of[tag]}')" if tag in name_of else f"{tag}" for tag in present]
    return ", ".join(shown) or "none"


# Nodes of cells of order 2.
NODES_OF_ORDER_2 = {"triangle": 6, "quadrilateral": 9, "tetrahedron": 10, "hexahedron": 27}


def check_space(V: Any, pairs: Sequence[ContactPair | TiedPair]) -> None:
    """Reject unsupported spaces and meshes (collective).

    Raises:
        MortarError: On all ranks.
        NotImplementedError: On all ranks, for pairs in space.
    """
    mesh = V.mesh
    if compat.scalar_is_complex():
        raise errors.MortarError(
            "PETSc has complex scalars; install the build with real scalars (petsc-real)"
        )
    check_solid(mesh)
    _check_coordinates(mesh)
    corners, dim = compat.num_corners(mesh), mesh.geometry.dim
    nodes = {1: corners, 2: NODES_OF_ORDER_2[compat.cell_name(mesh)]}
    layout = V.dofmap.dof_layout
    degrees = [degree for degree, count in nodes.items() if layout.num_dofs == count]
    at_vertices = len(layout.entity_dofs(0, 0)) == 1
    if V.dofmap.index_map_bs != dim or not at_vertices or not degrees:
        vectors = "plane vectors" if dim == 2 else "vectors"
        raise errors.MortarError(
            f"the displacement is not in the Lagrange space of {vectors} of degree 1 or 2 (P1, "
            "Q1, P2 or Q2): use vector_space(mesh, 1) or vector_space(mesh, 2), or a mixed space "
            "with the displacement as its first sub-space"
        )
    if compat.geometry_dofmap(mesh).shape[1] not in (corners, nodes[degrees[0]]):
        raise errors.MeshError(
            "the mesh has curved cells; contact needs straight ones of first order, or cells of "
            "second order with a displacement of degree 2"
        )
    for pair in pairs:
        if pair.data.mesh is not mesh:
            raise errors.MeshError(
                f"the pair '{pair.slave_name}' - '{pair.master_name}' belongs to another mesh"
            )


def _check_coordinates(mesh: Any) -> None:
    """Reject coordinates that are nan or inf, with a node's input number (collective)."""
    bad = ~np.isfinite(mesh.geometry.x).all(axis=1)
    numbers = np.unique(
        np.concatenate(mesh.comm.allgather(np.asarray(mesh.geometry.input_global_indices)[bad]))
    )
    if numbers.size:
        raise errors.MeshError(
            f"coordinates of {numbers.size} nodes are not finite, e.g. of node {numbers[0]} "
            "(counted from 0, in the order of the input)"
        )


def check_slave_nodes(contacts: Sequence[Interface]) -> None:
    """Reject nodes that are slaves of the same master or obstacle in two pairs (local).

    Raises:
        SurfaceError: On all ranks.
    """
    for one, other in combinations(contacts, 2):
        both = np.intersect1d(*(pair.slave.nodes[pair.may_carry] for pair in (one, other)))
        if both.size and _have_common_master(one, other):
            where = one.slave.X[np.flatnonzero(one.slave.nodes == both[0])[0]]
            raise errors.SurfaceError(
                f"{both.size} nodes are slaves of '{one.master.name}' in two pairs, with "
                f"'{one.slave.name}' and '{other.slave.name}', one at "
                f"{errors.format_point(where)}; pass both sides in one list, or make one of the "
                "two a master there"
            )


def _have_common_master(one: Interface, other: Interface) -> bool:
    """Whether two pairs have a common obstacle or a common part of the master (local).

    Masters that meet at a corner, such as two sides of a block, have no common part: a slave node
    in the corner has one multiplier for each.
    """
    if one.obstacle is not None and one.obstacle is other.obstacle:
        return True
    first, second = one.master, other.master
    return have_common_facet(first, second) or _continue(first, second)


def have_common_facet(one: Surface, other: Surface) -> bool:
    """Whether two surfaces have a facet in common (local)."""
    corners = (np.sort(surface.nodes[surface.corners], axis=1) for surface in (one, other))
    first, second = (set(map(tuple, nodes.tolist())) for nodes in corners)
    return bool(first & second)


def _continue(one: Surface, other: Surface) -> bool:
    """Whether one of two surfaces continues the other, without a corner where they meet (local).

    They meet where a facet of each has an edge in common, in the plane where one ends and the other
    begins: two faces of a crack may begin at one node.
    """
    corners = [surface.nodes[surface.corners] for surface in (one, other)]
    facets = np.concatenate(corners)
    count = facets.max(initial=0) + 1  # obstacles have no facets
    common = shared_nodes(facets, count)[: len(one.facets), len(one.facets) :]
    i, j = (common >= one.dim - 1).nonzero()
    cosine = np.einsum("ic,ic->i", _normals(one)[i], _normals(other)[j])
    if one.dim == 2:
        (start, end), (other_start, other_end) = corners[0][i].T, corners[1][j].T
        cosine = cosine[(end == other_start) | (other_end == start)]
    return bool((cosine > np.cos(TURN)).any())


def _normals(surface: Surface) -> Array:
    """Unit normals of the undeformed facets, shape (facets, dim) (local)."""
    n = outward_normals(surface.X[surface.facets])
    return n / np.linalg.norm(n, axis=1)[:, None]


def check_residual(name: str, residual: Any, u: Any, *, contains_u: bool = True) -> None:
    """Reject forms that are not residuals in the space of ``u`` (local).

    Raises:
        ValueError: If the form has not exactly one test function, one of another space, or, with
            ``contains_u``, does not depend on ``u``.
    """
    expected = (
        "the residual needs exactly one test function and no trial function; for an energy, "
        "take ufl.derivative(energy, u, v)"
    )
    _check_form(name, residual, 1, u, expected)
    if contains_u and u not in residual.coefficients():
        raise ValueError(f"the {name} does not depend on u, the function to be solved for")


def check_jacobian(jacobian: Any, u: Any) -> None:
    """Reject forms that are not tangents in the space of ``u`` (local).

    Raises:
        ValueError: If the form does not have two arguments of this space.
    """
    _check_form("jacobian", jacobian, 2, u, "the jacobian needs one test and one trial function")


def check_domain(name: str, form: Any, mesh: Any) -> None:
    """Reject forms with measures, functions or coordinates of another mesh (local).

    Constants are numbers, whatever their mesh. Also the numbers nan and infinity, which form
    compilers do not accept.

    Args:
        name: Description of the form.
        form: The UFL form.
        mesh: UFL domain of the mesh.

    Raises:
        ValueError: If another mesh occurs, or such a number; names the object.
    """
    for integral in form.integrals():
        where = MEASURES.get(integral.integral_type(), ("parts",))[-1]
        if integral.ufl_domain() != mesh:
            raise ValueError(
                f"the {name} has an integral over {where} of another mesh than that of u"
            )
        for part in unique_pre_traversal(integral.integrand()):
            if isinstance(part, ScalarValue) and not np.isfinite(part.value()):
                raise ValueError(
                    f"the {name} contains the number {part.value()} in an integral over {where}: "
                    "expected finite numbers"
                )
            if (
                isinstance(part, (Coefficient, GeometricQuantity))
                and compat.domain_of(part) != mesh
            ):
                is_function = isinstance(part, fem.Function)
                what = f"function '{part.name}'" if is_function else f"{type(part).__name__}"
                raise ValueError(
                    f"the {name} contains {what} of another mesh than that of u: define it on "
                    "u.function_space.mesh"
                )


def _check_form(name: str, form: Any, count: int, u: Any, expected: str) -> None:
    """Reject forms without exactly ``count`` arguments of the space of ``u`` (local)."""
    errors.check_kind(name, form, ufl.Form, "a UFL form")
    check_domain(name, form, u.function_space.ufl_domain())
    try:
        arguments = form.arguments()
    except Exception as error:  # UFL's error, whose type differs between releases
        raise ValueError(f"the {name} has test functions of several spaces: {error}") from error
    if len(arguments) != count:
        raise ValueError(expected)
    V = u.function_space
    for argument in arguments:
        space = argument.ufl_function_space()
        if space.ufl_domain() != V.ufl_domain() or space.ufl_element() != V.ufl_element():
            kind = "test" if argument.number() == 0 else "trial"
            raise ValueError(
                f"the {kind} function of the {name} belongs to another space than u: to "
                f"{space.ufl_element()}, u to {V.ufl_element()}"
                + " on another mesh" * (space.ufl_domain() != V.ufl_domain())
                + f"; expected ufl.{kind.capitalize()}Function(u.function_space)"
            )


def check_cells(bulk: Bulk) -> None:
    """Reject cells without area or volume, and twisted ones (collective).

    Raises:
        MeshError: On all ranks; the message has a position.
    """
    count, where = bulk.cells.flat()
    if count:
        size = "area" if bulk.space.dim == 2 else "volume"
        raise errors.MeshError(f"{count} cells have no {size}, one at {where}")
    count, where = bulk.cells.twisted()
    if count:
        order = "the order of their corners, which go round a cell"
        raise errors.MeshError(
            f"{count} cells are twisted, one at {where}: correct the mesh, or {order}"
        )


def refuse_inertia(bulk: Bulk, what: str) -> None:
    """Reject bodies with inertia (local, equal on all ranks).

    Args:
        bulk: The bodies.
        what: Name of the feature that does not support inertia, for the message.

    Raises:
        MortarError: If the bodies have inertia.
    """
    if bulk.inertia is not None:
        raise errors.MortarError(f"{what} does not support inertia: expected a static problem")


def refuse_history(bulk: Bulk, what: str) -> None:
    """Reject bodies with history functions or stresses beyond UFL (local, equal on all ranks).

    Args:
        bulk: The bodies.
        what: Name of the feature that does not support them, for the message.

    Raises:
        MortarError: If the bodies have them.
    """
    if bulk.history.functions:
        names = ", ".join(f"'{function.name}'" for function in bulk.history.functions)
        raise errors.MortarError(f"{what} does not support bodies with history (here of {names})")
    if bulk.history.before_assembly is not None:
        raise errors.MortarError(f"{what} does not support before_assembly")


def check_rules(residual: Any, u: Any, space: DisplacementSpace) -> None:
    """Reject a residual that the form compiler evaluates at wrong points (collective).

    FFCx 0.5 takes values at the point of a rule of one point for the points of other rules, too,
    on quadrilaterals and curved triangles. If a residual has such rules, it is compared with the
    sum of its integrals, compiled one by one, at a displacement of 1e-3 of the mesh.

    Args:
        residual: UFL form, linear in a test function of the space of ``u``.
        u: Displacement, alone or in a mixed function; unchanged.
        space: The displacement's nodes and dofs.

    Raises:
        MortarError: On all ranks.
    """
    V, integrals = space.V, residual.integrals_by_type("cell")
    rules = {rule for i in integrals for rule, _ in compat.quadrature_rules(residual, i)}
    sizes = {len(compat.quadrature_points(compat.cell_name(V.mesh), rule)) for rule in rules}
    if 1 not in sizes or len(sizes) < 2:
        return
    kept, X = u.x.array.copy(), np.zeros(u.x.array.size)
    X[: space.dofs.max(initial=-1) + 1] = space.positions()
    size = float(ranks.largest_over_ranks(V.mesh.comm, np.abs(X).max(initial=0.0)))
    u.x.array[:] = 1e-3 * size * np.cos(3.0 * X / size + np.arange(X.size) % 2)
    u.x.scatter_forward()
    try:
        parts = [residual, *(ufl.Form([integral]) for integral in residual.integrals())]
        whole, *others = (_assembled(part, u) for part in parts)
    finally:
        u.x.array[:] = kept
    sizes_of = [np.abs(values).max(initial=0.0) for values in (whole - sum(others), whole)]
    error, largest = ranks.largest_over_ranks(V.mesh.comm, np.array(sizes_of))
    if error > ROUNDING * largest:
        raise errors.MortarError(
            "this release of the form compiler evaluates the residual at wrong points: it has "
            "integrals over cells by one point (quadrature_degree 0 or 1) and others by more; take "
            "quadrature_degree=2 or more for all, or a mixed function of displacement and pressure"
        )


def _assembled(form: Any, u: Any) -> Array:
    """A form of rank 1, assembled, (owned dofs,)."""
    vector = compat.create_vector(u.function_space)
    compat.assemble_vector(vector, compat.form(form))
    values = vector.array_r.copy()
    vector.destroy()
    return np.asarray(values)
