# SPDX-License-Identifier: MIT
"""Derivatives of the nodal fields, rows and forces of a pair, by its state, positions and obstacle.

Rows, memory of laws and functionals depend on state and controls through the fields w (weights), g
(weighted gaps), z_n, z_tau, slip of the step at constant gaps, and z; see ``through_fields``. In
space slip and z_tau are components along the law's direction, see ``contact.fields``; rows depend
on the vectors of slip and normals, "slip_vector" and "normal".

``fields_by_state`` and ``rows_by_fields`` have the derivatives by the state, ``by_positions`` those
by the shapes of the bodies, ``fields_by_shape`` those by the shape of the obstacle. Derivatives by
the vector of the pair, see ``Layout``, are sparse matrices, equal on all ranks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cached_property, reduce
from operator import add
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from scipy.sparse import bsr_array, csr_array, eye, vstack

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import ContactFields, VectorRow
from fenics_mortar.contact.law import Row
from fenics_mortar.contact.rows import row_by_displacements, row_by_motions
from fenics_mortar.contact.space_fields import SpaceFields
from fenics_mortar.interface.mortar import Block, entries_of
from fenics_mortar.interface.on_obstacle import ObstacleOperators, gaps_along, on_facets, points_of
from fenics_mortar.interface.reference import facet_rule
from fenics_mortar.utils import errors, ranks

if TYPE_CHECKING:
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.interface.curve_surface import Curve
    from fenics_mortar.utils.arrays import Array, Indices

NO_BLOCK = Block(np.empty((0, 1), np.int64), np.empty((0, 1), np.int64), np.empty((0, 1, 1)))


# Matrices are sparse, or dense if they have few columns; equal on all ranks.
Matrix: TypeAlias = "csr_array | Array"
# Derivatives of nodal fields by their names, shape (slave nodes, m) each; those of fields with c
# components (slave nodes c, m).
Changes = dict[str, Matrix]


class Layout:
    """Places of the values of a pair in its vector.

    The vector of a pair has all values on which its equations depend: displacements of the slave
    and master nodes [length], multipliers [stress], and motions of the obstacle [length]. Residuals
    have the forces on these in the same places, and the rows of the multipliers in place of the
    multipliers. Values of the nodes are stored node by node: the entry (j, c) of an array
    (nodes, n) is at n j + c. Vectors have d components, and obstacles m motions: 2 and 3 in the
    plane, 3 and 6 in space.

    Args:
        contact: The pair.

    Attributes:
        dim: Number of coordinates d.
        num_motions: Number of motions m, 0 without an obstacle.
        on_slave, on_master: Displacements of both surfaces.
        z: Multipliers.
        motion: Motions of the obstacle.
        size: Length of the vector.
    """

    def __init__(self, contact: Interface) -> None:
        self._sides = contact.slave, contact.master
        self.dim: int = contact.slave.dim
        obstacle = contact.obstacle
        self.num_motions: int = 0 if obstacle is None else obstacle.place.size
        sizes = [side.dofs.size for side in self._sides] + [contact.z.size, self.num_motions]
        ends = np.cumsum([0, *sizes]).tolist()
        self.on_slave, self.on_master, self.z, self.motion = map(slice, ends[:-1], ends[1:])
        self.size: int = ends[-1]

    @cached_property
    def _sorted(self) -> tuple[Indices, Indices]:
        """Places of all displacement dofs in the order of the dofs, and the dofs in this order."""
        dofs = np.concatenate([side.dofs.ravel() for side in self._sides])
        order = np.argsort(dofs, kind="stable")
        return order, dofs[order]

    def places(self, dofs: Indices) -> Indices:
        """Places of displacement dofs, any shape; -1 for -1 (local)."""
        order, in_order = self._sorted
        at = np.searchsorted(in_order, np.maximum(dofs, in_order[0]))
        return np.where(dofs >= 0, order[at], -1)

    def only(self, part: slice) -> Matrix:
        """Derivative of a part of the vector, as ``z``, by the vector (local)."""
        return csr_array(eye(part.stop - part.start, self.size, part.start))

    def matrix(
        self, blocks: Iterable[Block], count: int, by_z: Array | None = None,
        by_motion: Array | None = None,
    ) -> Matrix:  # fmt: skip
        """Derivative of some numbers, shape (count, size) (collective).

        Args:
            blocks: Derivative with respect to displacements: columns are global dofs; each rank has
                a part. Rows and columns of -1 are ignored.
            count: Number of rows.
            by_z: That of a number of each slave node with respect to its multiplier, shape (slave
                nodes, d), equal on all ranks.
            by_motion: That with respect to the motions of the obstacle, (count, m), likewise.
        """
        parts = zip(*map(entries_of, [NO_BLOCK, *blocks]), strict=True)
        mine = [np.concatenate(several) for several in parts]
        rows, columns, values = ranks.from_all_ranks(self._sides[0].comm, mine)
        on = (rows >= 0) & (columns >= 0)
        at = rows[on], self.places(columns[on])
        found = csr_array((values[on], at), shape=(count, self.size))
        if by_z is not None:
            found = found + by_node(by_z[:, None]) @ self.only(self.z)
        if by_motion is not None:
            found = found + csr_array(by_motion) @ self.only(self.motion)
        return found


def by_node(values: Array) -> Matrix:
    """Matrix of r values of each node that depend on c values of the same node (local).

    Args:
        values: The blocks, shape (nodes, r, c).

    Returns:
        Shape (nodes r, nodes c).
    """
    count, r, c = values.shape
    nodes = np.arange(count + 1)
    return bsr_array((values, nodes[:-1], nodes), shape=(count * r, count * c))


def through_fields(by: Mapping[str, Array], changes: Changes) -> Matrix:
    """Chain rule: derivative of values of the nodes that depend on nodal fields (local).

    Args:
        by: Derivatives of n values of a node with respect to its fields, (slave nodes, n) each;
            with respect to fields with c components (slave nodes, n, c).
        changes: Derivatives of fields, at least of one, shape (slave nodes, m) each; those on which
            the values do not depend are ignored.

    Returns:
        Shape (slave nodes n, m).
    """
    count, n = next(iter(by.values())).shape[:2]
    factors = {name: by_node(by[name].reshape(count, n, -1)) for name in changes if name in by}
    if not factors:
        return csr_array((count * n, next(iter(changes.values())).shape[1]))
    return reduce(add, (factor @ changes[name] for name, factor in factors.items()))


def rows_at_nodes(slave: Curve, columns: Indices, values: Array) -> Block:
    """Block with one row per slave node, of the nodes owned by this rank (local).

    Args:
        slave: The slave surface.
        columns: Global dofs, shape (slave nodes, c).
        values: Shape (slave nodes, c).
    """
    j = slave.owned
    return Block(j[:, None], columns[j], values[j][:, None, :])


def fields_by_state(contact: Interface, names: Iterable[str]) -> Changes:
    """Derivatives of fields with respect to the vector of the pair, (slave nodes, size) each.

    Collective. That of "z" has the shape (d slave nodes, size).
    """
    layout = Layout(contact)
    return {name: DERIVATIVES[name](contact, layout) for name in names}


def _weighted_gap(contact: Interface, layout: Layout) -> Matrix:
    o = contact.operators
    by_motion = o.dgap_dq if isinstance(o, ObstacleOperators) else None
    return layout.matrix(o.gap_derivative(), o.slave.num_nodes, by_motion=by_motion)


def _z_n(contact: Interface, layout: Layout) -> Matrix:
    o, z = contact.operators, contact.z
    blocks = [rows_at_nodes(o.slave, o.normal_columns(), o.normal_derivative(z))]
    by_motion = np.einsum("jc,jcm->jm", z, o.dn_dq) if isinstance(o, ObstacleOperators) else None
    return layout.matrix(blocks, o.slave.num_nodes, o.n, by_motion)


def of_law(f: ContactFields, layout: Layout, name: str) -> Matrix:
    """Derivative of z_tau or slip at constant mean gaps, (slave nodes, size) (collective)."""
    row = OF_LAW[name] if layout.dim == 3 else f.without_slip_on_planes(OF_LAW[name])
    return by_vectors(f, layout, f.by_vectors(row))


def by_vectors(f: ContactFields, layout: Layout, row: VectorRow, *, summed: bool = True) -> Matrix:
    """Derivative of a function of multiplier, slip and normal of a node (collective).

    Shape (slave nodes, size). ``summed``: see ``row_by_displacements``.
    """
    on_obstacle = isinstance(f.operators, ObstacleOperators)
    by_motion = row_by_motions(f, row) if on_obstacle else None
    blocks = row_by_displacements(f, row, summed=summed)
    return layout.matrix(blocks, len(row.by_z), row.by_z, by_motion)


DERIVATIVES: dict[str, Callable[[Any, Layout], Matrix]] = {
    "weight": lambda contact, layout: layout.matrix(
        contact.operators.weight_derivative(), contact.slave.num_nodes
    ),
    "gap": _weighted_gap, "z_n": _z_n, "z": lambda contact, layout: layout.only(layout.z),
    "z_tau": lambda contact, layout: of_law(contact.now, layout, "z_tau"),
    "slip": lambda contact, layout: of_law(contact.now, layout, "slip"),
    "rubbing": lambda c, layout: by_vectors(c.now, layout, c.now.rubbing, summed=False),
    "total_slip": lambda contact, layout: tangential_derivative(
        contact.now, layout, contact.now.slip_vector + contact.now.carried, of_slip=True
    ),
}  # fmt: skip

# Numbers of a node as functions of the law's arguments.
OF_LAW = {
    "z_n": Row(0.0, by_z_n=1.0),
    "z_tau": Row(0.0, by_z_tau=1.0),
    "slip": Row(0.0, by_slip=1.0),
}


def of_vectors(f: ContactFields) -> dict[str, dict[str, Array]]:
    """Derivatives of arguments of the law by the normals, in space also by vectors of slip (local).

    By their names, shape (slave nodes, 1, d) each [unit of the argument over that of the vector].
    """
    rows = {name: f.by_vectors(row) for name, row in OF_LAW.items()}
    return {
        name: {"slip_vector": row.by_slip[:, None], "normal": row.by_normal[:, None]}
        for name, row in rows.items()
    }


def of_slips(f: SpaceFields) -> dict[str, dict[str, Array]]:
    """Derivatives in space of the power of the shear, and of the total slip (local).

    Shape (slave nodes, 1, 3) and (slave nodes, 3, 3) [unit of the quantity over the vector's].
    """
    n, s, rubbing = f.operators.n, f.slip_vector + f.carried, f.rubbing
    s_n = np.einsum("ja,ja->j", n, s)[:, None, None]
    return {
        "rubbing": {"slip_of_step": rubbing.by_slip[:, None], "normal": rubbing.by_normal[:, None]},
        "total_slip": {
            "slip_vector": np.eye(3) - n[:, :, None] * n[:, None],
            "normal": -s_n * np.eye(3) - n[:, :, None] * s[:, None],
        },
    }


def tangential_derivative(
    f: SpaceFields, layout: Layout, vectors: Array, *, of_slip: bool
) -> Matrix:
    """Derivative of P v in space, (3 slave nodes, size) (collective).

    Args:
        f: Fields in space.
        layout: Places of the values of the pair.
        vectors: The vectors v, multipliers or the slip of the law, shape (slave nodes, 3).
        of_slip: Whether they are the slip.
    """
    n, none, found = f.operators.n, np.zeros(len(vectors)), []
    v_n, (count, dim) = np.einsum("ja,ja->j", n, vectors)[:, None], vectors.shape
    for a in np.eye(dim):
        n_a = (n @ a)[:, None]
        by = [a - n_a * n, np.zeros_like(n)]
        by_z, by_slip = by[::-1] if of_slip else by
        row = VectorRow(none, by_z, by_slip, none, -v_n * a - n_a * vectors)
        found.append(by_vectors(f, layout, row))
    node_by_node = np.arange(dim * count).reshape(dim, count).T.ravel()
    return vstack(found, format="csr")[node_by_node]


def rows_by_fields(contact: Contact) -> dict[str, Array]:
    """Derivatives of the d rows of a node with respect to its fields (local).

    Those with respect to gaps (slave nodes, d), to other numbers (slave nodes, d, 1), and to
    vectors, in space, (slave nodes, d, d); fields without effect are missing. Multipliers, active
    set and weights of the rows are fixed. Rows of closed gaps and of the law depend on gaps. In the
    unit of the rows [stress length] over that of the field.
    """
    f = contact.now
    normal, _, *weights = contact.rows.frame()
    by, rows = {"gap": normal.copy()}, f.law_rows
    names = {name: f"by_{name}" for name in ("z_n", "z_tau", "slip")}
    if isinstance(f, SpaceFields):
        rows, names = f.vector_rows, {"slip_vector": "by_slip", "normal": "by_normal"}
    for weight, row in zip(weights, rows, strict=True):
        by["gap"] -= weight * (row.by_gap * f.per_weight)[:, None]
        for name, attribute in names.items():
            by_row = getattr(row, attribute).reshape(len(normal), 1, -1)
            by[name] = by.get(name, 0.0) - weight[:, :, None] * by_row
    return by


def moment(contact: Interface, about: Array, axis: Array | None) -> float:
    """Moment of the contact forces on the slave body [stress length^2] (collective).

    In space its component along the unit vector ``axis`` (3,).
    """
    force, _ = contact.now.forces
    return -float((_around(axis, contact.operators.x - about) * force).sum())


def _around(axis: Array | None, vectors: Array) -> Array:
    """Products of the axis, in the plane that across it, and vectors (n, d) (local)."""
    if axis is None:
        return np.stack([-vectors[:, 1], vectors[:, 0]], axis=1)
    return np.cross(axis, vectors)


def moment_gradient(contact: Interface, about: Array, axis: Array | None) -> Array:
    """Derivative of ``moment`` about a point (d,), a vector of the pair (collective).

    [unit of the moment over those of the vector].
    """
    o, z, layout = contact.operators, contact.z, Layout(contact)
    force, _ = contact.now.forces
    turned = _around(axis, o.x - about)
    total = np.zeros(layout.size)
    total[layout.on_slave] = _around(axis, force).ravel()
    total[layout.z] = -o.jump(turned, np.zeros_like(contact.master.X)).ravel()
    if o.linearization.frozen:
        return total
    rows, columns, values = o.slave_force_derivative(z)
    by_x = layout.matrix([Block(layout.places(rows), columns, values)], layout.size)
    weights = np.zeros(layout.size)
    weights[layout.on_slave] = turned.ravel()
    return total - by_x.T @ weights


def by_positions(contact: Interface) -> Matrix:
    """Derivative of forces, rows, and forces on the obstacle by the positions of all nodes.

    Shape (size, size) of the vector of the pair: its columns of displacements are not zero
    (collective).

    With finite sliding, the equations depend on the present positions x = X + u of the nodes:
    forces and rows change with X as with the displacement, at fixed sets, offset and weights of the
    rows. Lengths of undeformed facets occur only in weights of rows, and in the stiffness of
    redundant sticks and of users' laws, which is considered fixed.
    """
    assert isinstance(contact, Contact)
    layout, o = Layout(contact), contact.operators
    blocks = [
        Block(layout.places(rows), columns, values)
        for rows, columns, values in o.force_derivative(contact.z)
    ]
    blocks += [
        Block(rows + layout.z.start, columns, values)
        for rows, columns, values in contact.rows.linearized().blocks
    ]
    if isinstance(o, ObstacleOperators):
        j = contact.slave.owned
        by_nodes = np.swapaxes(o.motion_force_derivatives(contact.z)[0], 0, 1)[j]
        motions = layout.motion.start + 0 * j[:, None] + np.arange(layout.num_motions)
        blocks.append(Block(motions, contact.slave.dofs[j], by_nodes))
    return layout.matrix(blocks, layout.size)


def check_positions(contact: Interface) -> None:
    """Reject contacts whose equations depend on the undeformed mesh in other ways (local).

    Raises:
        MortarError: For ties, small sliding, thickness or parameters of laws that are functions of
            the position.
    """
    if not isinstance(contact, Contact) or contact.pair.sliding == "small":
        raise errors.MortarError(
            f"{contact.pair!r} has D and M of the undeformed mesh: nodal positions as controls "
            "need contact with sliding='finite'"
        )
    for name, value in contact.pair.law.varying.items():
        if not isinstance(value, np.ndarray):
            raise errors.MortarError(f"{name} of {contact.pair.law!r} varies with the position")
    thickness = contact.slave.thickness
    if thickness is not None and thickness.by_x == 0.0 and np.ptp(thickness.at(contact.slave.X)):
        raise errors.MortarError(
            "the thickness depends on the position: there are no derivatives by nodal positions"
        )


def fields_by_shape(contact: Contact, name: str) -> Changes:
    """Derivatives of gap, z_n, z_tau and slip with respect to a parameter of the shape.

    Collective. Also those of the normals.

    If the shape changes, the distance of a point changes by dphi, its gradient by dgrad. This
    changes the weighted gaps int Phi_j phi, the normals n = -grad phi / |grad phi| of the slave
    nodes, and the slip: in the plane through the present tangents, in space through the nearest
    points of the accepted state from which it is counted. Forces of given multipliers do not depend
    on the obstacle.

    Args:
        contact: The contact, evaluated, with the obstacle at its present position.
        name: Name of the parameter, see ``Obstacle.shape``.

    Returns:
        Shape (slave nodes, m) each, of normals (d slave nodes, m), for the m numbers of the
        parameter.

    Raises:
        MortarError: If sliding is small.
    """
    if contact.pair.sliding == "small":
        raise errors.MortarError("shapes of obstacles cannot be controls with sliding='small'")
    f, o = contact.now, contact.operators
    value = np.asarray(o.obstacle.shape()[name])
    units = np.eye(value.size).reshape(value.size, *value.shape)
    what = f"the derivative of '{o.obstacle.name}' by '{name}'"
    gap, dn = errors.call_together(
        o.slave.comm, what, lambda: (_gap(contact, name, units), _normals(contact, o, name, units))
    )
    gap = ranks.sum_over_ranks(o.slave.comm, gap).T
    found, vectors = {"normal": dn.reshape(len(dn), -1).T, "gap": gap}, of_vectors(f)
    if isinstance(f, SpaceFields):
        vectors |= of_slips(f)
    else:
        del vectors["slip"]
        if contact.pair.law.needs_slip:
            by_normal = contact.partners.by_normal(o)
            by_normal[np.isfinite(contact.plane_normals[:, 0])] = 0.0
            vectors["slip"] = {"normal": by_normal[:, None]}
    return found | {name: through_fields(by, found) for name, by in vectors.items()}


def _distances(o: Any, x: Array, name: str, directions: Array) -> tuple[Array, Array]:
    """Changes of phi (m, n) and of its gradient (m, n, d) at points ``x`` in space (local)."""
    phi, gradient = o.local_by_shapes(o.to_own_frame(x), name, directions)
    return phi, gradient @ o.rotation.T


def _gap(contact: Contact, name: str, directions: Array) -> Array:
    """This rank's share of the change of the weighted gaps, (m, slave nodes) [length^2] (local)."""
    o, slave, nodes = contact.operators, contact.slave, contact.operators.facet_nodes
    gap = np.zeros((len(directions), slave.num_nodes))
    if len(nodes):
        options, size = contact.options, nodes.shape[1]
        rule = facet_rule(options.integration, size, options.points, slave.dim)
        at = points_of(o.x[nodes], rule[0])
        phi, _ = _distances(contact.obstacle, at.reshape(-1, slave.dim), name, directions)
        phi = phi.reshape(-1, *at.shape[:2])
        of_facets = gaps_along(on_facets(contact, o.x, nodes, rule), phi)
        for total, share in zip(gap, of_facets, strict=True):
            np.add.at(total, nodes, share)
    return gap


def _normals(contact: Contact, o: ObstacleOperators, name: str, directions: Array) -> Array:
    """Change of the normals of the slave nodes, on symmetry planes along them (m, slave nodes, d).

    Zero on those of the plane.
    """
    gradient, change = o.obstacle.evaluate(o.x)[1], _distances(o.obstacle, o.x, name, directions)[1]
    in_plane = contact.slave.dim == 2
    if not in_plane:
        projectors = contact.evaluation.planes
        gradient = np.einsum("jab,jb->ja", projectors, gradient)
        change = np.einsum("jab,mjb->mja", projectors, change)
    change = change / np.linalg.norm(gradient, axis=1)[:, None]
    dn = -(change - np.einsum("jc,mjc->mj", o.n, change)[..., None] * o.n)
    return np.where(in_plane & np.isfinite(contact.plane_normals), 0.0, dn)
