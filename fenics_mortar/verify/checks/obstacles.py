# SPDX-License-Identifier: MIT
"""Obstacles: edges and tips between nodes of the slave, gradients of users' signed distances."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.view import or_other_weights
from fenics_mortar.interface.facing import linear_facets
from fenics_mortar.obstacles.obstacle import DIFFERENCE, Obstacle, is_of_package
from fenics_mortar.utils.arrays import TINY, first_largest, nonnegative_least_squares, norms
from fenics_mortar.utils.errors import MortarError, call_together, format_point
from fenics_mortar.verify.checks.balance import positive_or_one
from fenics_mortar.verify.checks.corners import facet_angles
from fenics_mortar.verify.finding import LIMITS, Finding, Measured

if TYPE_CHECKING:
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.utils.arrays import Array, Flags, Indices

# Largest admissible sine of the angle between a user's gradient and difference quotients [1],
# slightly below the error of forces along averaged normals.
WRONG_GRADIENT = 0.04
# Largest factor between changes of a user's distance and distances near the surface [1] without a
# remark: gaps are wrong by more than the discretization. Forces where surfaces touch do not depend
# on it, so that other level set functions may be used.
OTHER_SCALE = 1.1
# Distance to the surface within which nodes are near it [facet lengths].
FACETS_FROM_SURFACE = 1.0


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Loaded nodes away from an obstacle, and directions of its forces (collective).

    **Loaded nodes that are away from an obstacle in space, at edges between its nodes.** Gaps are
    zero in the mean, weighted by multiplier functions. Dual functions are negative at the other
    nodes of a facet: where it reaches beyond the edge of a flat punch, the distance of that part
    presses the inner node, and the force may be several times too large.

    **Errors of the contact direction where an obstacle is sharper than the facets of the slave.**
    The force on a slave node acts along the normal of the obstacle at its nearest point. Where a
    corner of the obstacle presses between two nodes of a flat surface, the forces on both act along
    the sides of the corner: they compress the facet and support the body sideways. The correct
    direction is that of the facets, in the cone of the normals of the facets at the node. At the
    rim of a surface the body may continue at any angle: the cone contains the outward directions
    across the rim as well. A node whose force leans inwards has the contact beside it, within the
    facet: on the end of a cantilever sheet below a cylinder, of a radius little larger than the
    facets, the force was 12 times too small.
    """
    contact = measured.contact
    if contact.obstacle is None:
        return
    if contact.slave.dim == 3 and contact.now.closing is None:
        yield _loaded_away(contact)
    yield _along_facets(measured)
    error, where = gradient_error(contact)
    yield Finding(
        "obstacle_gradient", "error of the gradient of the obstacle's distance", error,
        "the gradient of the obstacle's distance is turned by "
        f"{np.degrees(np.arcsin(min(error, 1.0))):.1f} degrees from difference quotients at "
        f"{where}, and so is the direction of the contact forces; correct the function of the "
        "obstacle",
        limit=WRONG_GRADIENT, remark=LIMITS.negligible, unit="sine", where=where,
    )  # fmt: skip
    factor, length, where = scale_error(contact)
    yield Finding(
        "obstacle_scale", "scale of the obstacle's distance", factor,
        f"the gradient of the obstacle's distance has the length {length:.3g} at {where}; expected "
        "1 near the surface, where gaps are values of the distance: divide the function and its "
        "derivatives by this length",
        remark=OTHER_SCALE, unit="factor", where=where,
    )  # fmt: skip


def _loaded_away(contact: Contact) -> Finding:
    """Mean distance of nodes from the obstacle, weighted by their forces (local)."""
    o = contact.operators
    forces = np.abs(np.einsum("jc,jc->j", contact.now.forces[0], o.n))
    away = forces * np.abs(o.phi - contact.now.offset) / contact.slave.nodal_lengths
    part = float(away.sum()) / positive_or_one(float(forces.sum()))
    where = format_point(o.x[first_largest(away)])
    return Finding(
        "obstacle_edges",
        "mean distance of loaded nodes from the obstacle",
        part,
        f"loaded nodes are {part:.2f} facets away from the obstacle, that with the largest product "
        f"at {where}: facets reach beyond an edge of the obstacle, and the force may be several "
        "times too large; refine them until they are smaller than the rounding of the edge"
        f"{or_other_weights(contact)}",
        limit=LIMITS.penetration,
        remark=LIMITS.coarse_distance,
        unit="facet lengths",
        where=where,
    )


def _along_facets(measured: Measured) -> Finding:
    """Fraction of an obstacle's normal forces along the slave's facets (local).

    A multiplier acts along the normal of its node, also on nodes without one.
    """
    contact, o = measured.contact, measured.contact.operators
    forces = np.abs(measured.pressure) * o.weight
    off_cones = _off_cones_of_curve if contact.slave.dim == 2 else _off_cones_of_faces
    along = forces * off_cones(contact, forces > 0.0)
    part = float(along.sum()) / positive_or_one(float(forces.sum()))
    where = format_point(o.x[first_largest(along)])
    return Finding(
        "obstacle_angle", "angle between obstacle and facets", part,
        f"{part:.0%} of the normal forces act along the facets of the slave, most of them at "
        f"{where}, where the obstacle is sharper than they are: refine the facets there, or round "
        "the obstacle",
        remark=LIMITS.at_corners, unit="sine", where=where,
    )  # fmt: skip


def _off_cones_of_curve(contact: Contact, nodes: Flags) -> Array:
    """Sines of the angles from the normals at ``nodes`` (n,) to the cones, (n,) (local)."""
    before, after = facet_angles(contact)
    off = np.maximum(np.minimum(before, after), -np.maximum(before, after))
    is_mirrored = np.isfinite(contact.plane_normals).all(axis=1)  # with the cone beside it
    return np.where(nodes & ~is_mirrored, np.sin(np.clip(off, 0.0, 0.5 * np.pi)), 0.0)


def _off_cones_of_faces(contact: Contact, nodes: Flags) -> Array:
    """The same in space: distances of unit vectors from the cones (local)."""
    n, (cones, starts) = contact.operators.n, _cones_of_faces(contact)
    sines = np.zeros(len(n))
    for j in np.flatnonzero(nodes):
        directions = cones[starts[j] : starts[j + 1]].reshape(-1, 3)
        directions = directions[directions.any(axis=1)]
        factors = nonnegative_least_squares(directions.T, n[j])  # of the nearest point of the cone
        sines[j] = np.linalg.norm(factors @ directions - n[j])
    return sines


def _cones_of_faces(contact: Contact) -> tuple[Array, Indices]:
    """Directions that span the cones of the nodes (local).

    Returns:
        Normals of the linear facets at each node, with the outward directions across those of their
        two edges there that are on the rim, else zero, shape (e, 3, 3), and where each node's
        begin, shape (n + 1,). On symmetry planes, where each has a mirror image, their components
        along the plane.
    """
    slave, x = contact.slave, contact.operators.x
    mirrored = np.isfinite(contact.plane_normals) & (contact.free == 0.0)
    facets, (starts, at, place) = linear_facets(slave.facets, slave.num_nodes)
    following = np.roll(facets, -1, axis=1)
    after = x[following] - x[facets]
    before = np.roll(after, 1, axis=1)
    normals = np.cross(before, after)
    size = slave.num_nodes
    is_rim = ~np.isin(facets * size + following, following * size + facets)
    is_rim &= ~(mirrored[facets] & mirrored[following]).any(axis=2)
    across_after = np.cross(after, normals) * is_rim[..., None]
    across_before = np.cross(before, normals) * np.roll(is_rim, 1, axis=1)[..., None]
    cones = np.stack([normals, across_after, across_before], axis=2)
    cones = np.where(mirrored[facets][:, :, None], 0.0, cones)[at, place]
    return cones / np.maximum(np.linalg.norm(cones, axis=2), TINY)[..., None], starts


def scale_error(contact: Contact) -> tuple[float, float, str]:
    """Factor between changes of a user's distance and lengths near its surface (collective).

    Gaps and overlaps are values of the distance. If the length of its gradient is not 1, they are
    scaled by this length, as are laws that depend on gaps.

    Returns:
        Median, over active nodes and those within ``FACETS_FROM_SURFACE`` of the surface, of the
        larger one of the length of the difference quotients and its inverse [1], with the length
        and the position of that node; 1 for the obstacles of the package and without such nodes.

    Raises:
        Exception: An error of the user's function, on all ranks.
    """
    obstacle, comm = contact.obstacle, contact.slave.comm
    if obstacle is None or is_of_package(obstacle):
        return 1.0, 1.0, ""
    call = partial(_lengths, obstacle, contact)
    lengths, x = call_together(comm, f"the distance of '{obstacle.name}'", call)
    if not len(lengths):
        return max(comm.allgather((1.0, 1.0, "")))
    factors = np.maximum(lengths, 1.0 / np.maximum(lengths, TINY))
    middle = int(np.argsort(factors)[(len(factors) - 1) // 2])
    found = float(factors[middle]), float(lengths[middle]), format_point(x[middle])
    return max(comm.allgather(found))


def _lengths(obstacle: Obstacle, contact: Contact) -> tuple[Array, Array]:
    """Lengths (k,) [1] of difference quotients at the k nodes (k, d) near the surface (local)."""
    x, size = contact.operators.x, contact.slave.nodal_lengths
    step = DIFFERENCE * size
    lengths = norms(_differences(obstacle, x, step)) / (2.0 * step)
    phi = np.abs(obstacle.evaluate(x)[0])
    near = contact.active | (phi <= FACETS_FROM_SURFACE * size * lengths)
    return lengths[near], x[near]


def gradient_error(contact: Contact) -> tuple[float, str]:
    """Directional error of a user's gradient at active nodes, and its position (collective).

    Contact forces act along the gradient of an obstacle's distance. A wrong gradient would change
    the direction of these forces without violating any other condition.

    Returns:
        Median of the sine of the angle between gradient and difference quotients (the median, since
        a node may lie on a kink; the sine is set to one if they are opposed), and the position of
        the node with the largest value. Zero for the obstacles of the package and without active
        nodes.

    Raises:
        Exception: An error of the user's function, on all ranks.
    """
    obstacle, comm = contact.obstacle, contact.slave.comm
    if obstacle is None or not contact.active.any() or is_of_package(obstacle):
        return 0.0, ""
    call = partial(_errors, obstacle, contact, contact.active)
    errors = call_together(comm, f"the distance of '{obstacle.name}'", call)
    where = format_point(contact.operators.x[contact.active][first_largest(errors)])
    return max(comm.allgather((float(np.median(errors)), where)))


def check_user_gradient(contact: Interface) -> None:
    """Reject a user's gradient that points against the increase of its distance (collective).

    Raises:
        MortarError: On all ranks, if this is so at most slave nodes.
    """
    obstacle = contact.obstacle
    if not isinstance(contact, Contact) or obstacle is None or is_of_package(obstacle):
        return
    everywhere = np.ones(contact.slave.num_nodes, bool)
    call = partial(_errors, obstacle, contact, everywhere)
    errors = call_together(contact.slave.comm, f"the distance of '{obstacle.name}'", call)
    if np.median(errors) == 1.0:
        raise MortarError(
            f"the gradient of the distance of '{obstacle.name}' points against its increase at "
            f"most nodes of '{contact.slave.name}', one at "
            f"{format_point(contact.operators.x[first_largest(errors)])}: the sign of the distance "
            "or that of its gradient is wrong; expected negative distances in the solid, and the "
            "gradient out of it"
        )


def _errors(obstacle: Obstacle, contact: Contact, nodes: Flags) -> Array:
    """Sine of the angle between gradient and difference quotients at ``nodes``, (k,) (local)."""
    x = contact.operators.x[nodes]
    step = DIFFERENCE * contact.slave.nodal_lengths[nodes]
    _, gradient, _ = obstacle.evaluate(x)
    quotients = _differences(obstacle, x, step)  # only the direction matters
    unit = quotients / np.maximum(norms(quotients), TINY)[:, None]
    along = (gradient * unit).sum(axis=1)
    across = norms(gradient - along[:, None] * unit)
    sine = across / np.maximum(np.hypot(across, along), TINY)
    return np.where(along > 0.0, sine, 1.0)


def _differences(obstacle: Obstacle, x: Array, step: Array) -> Array:
    """Central differences of the distance along each axis, of shape (k, d) [length] (local).

    Args:
        obstacle: The obstacle.
        x: Points, shape (k, d) [length].
        step: Steps to both sides, shape (k,) [length].
    """
    moves = [step[:, None] * axis for axis in np.eye(obstacle.dim)]
    ahead, behind = (
        np.stack([obstacle.evaluate(x + sign * move)[0] for move in moves], axis=1)
        for sign in (1.0, -1.0)
    )
    return ahead - behind
