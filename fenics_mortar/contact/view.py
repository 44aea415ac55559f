# SPDX-License-Identifier: MIT
"""What users see of a pair: nodal fields and forces, nodes of its sides, and messages.

``PairView`` has the results along the slave surface, a ``PairSide`` the nodes of one side. Messages
are on overlaps, interference, the search radius, friction, ties that do little and other options.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface, read_only
from fenics_mortar.contact.law import Coulomb
from fenics_mortar.contact.tied import Tie
from fenics_mortar.interface.surfaces import Surface, replicate
from fenics_mortar.kernels.sight import BEHIND
from fenics_mortar.mesh.space import DisplacementSpace, numbered_dofs
from fenics_mortar.utils.arrays import SAME_PLACE, Array, Flags, Indices
from fenics_mortar.utils.errors import format_point
from fenics_mortar.utils.ranks import on_any_rank

if TYPE_CHECKING:
    from fenics_mortar.contact.conductance import NodalFlux
    from fenics_mortar.contact.fields import InterfaceState


@dataclass(frozen=True)
class PairSide:
    """Nodes of one side of a pair, ``problem.contacts[i].slave`` or ``.master``.

    The rows of ``problem.matrices.D(i)`` and ``M(i)`` and the columns of ``D(i)`` are the nodes of
    the slave in this order, the columns of ``M(i)`` those of the master: the shapes are (slave
    nodes, slave nodes) and (slave nodes, master nodes). All arrays are equal on all ranks. A rigid
    obstacle has no nodes.

    Attributes:
        name: Name of the boundary.
        X: Reference positions, shape (n, 2) [length].
        nodes: Global numbers in the space of the displacement, shape (n,).
        input_nodes: Numbers in the mesh input, see ``MeshData.node_dofs``; -1 for nodes that the
            input does not have, such as middles of straight edges; shape (n,).
        dofs: Global dofs of both components in the space of ``u``, shape (n, 2).

    Example:
        The contact forces D^T z on the slave and -M^T z on the master as a vector of all dofs, with
        the sign of internal forces; other terms on the interface are assembled likewise::

            contact, matrices = problem.contacts[0], problem.matrices
            forces = PETSc.Vec().createMPI((2 * V.dofmap.index_map.size_local, None), comm=comm)
            sides = (matrices.D(0), contact.slave, 1.0), (matrices.M(0), contact.master, -1.0)
            for matrix, side, sign in sides:
                on_nodes, rows = matrix.createVecs()
                (first, stop), (begin, end) = (v.getOwnershipRange() for v in (rows, on_nodes))
                for component in (0, 1):
                    rows.array[:] = contact.tractions[first:stop, component]
                    matrix.multTranspose(rows, on_nodes)
                    dofs = side.dofs[begin:end, component].astype(PETSc.IntType)
                    forces.setValues(dofs, sign * on_nodes.array, PETSc.InsertMode.ADD_VALUES)
            forces.assemble()
    """

    name: str
    X: Array
    nodes: Indices
    input_nodes: Indices
    dofs: Indices


def side_of(surface: Surface, space: DisplacementSpace) -> PairSide:
    """Nodes of a surface for users (collective)."""
    local, numbers = numbered_dofs(space.V)
    number_of = np.full(space.num_nodes, -1)
    owned = local < space.num_nodes
    number_of[local[owned]] = numbers[owned]
    first = space.V.dofmap.index_map.local_range[0]
    mine = number_of[surface.nodes[surface.owned] - first]
    input_nodes = replicate(np.stack([mine, mine], axis=1), surface.owners, surface.comm)[:, 0]
    X, nodes, dofs = surface.X.copy(), surface.nodes.copy(), surface.dofs.copy()
    return PairSide(surface.name, X, nodes, input_nodes, dofs)


def copied(name: str) -> Any:
    """Read-only attribute of a view: copy of an array of its interface."""
    return property(partial(_copy, attrgetter(f"_interface.{name}")), doc="See ``PairView``.")


def _copy(read: Callable[[PairView], Array], view: PairView) -> Array:
    return np.array(read(view))


class PairView:
    """Results on a contact or tied pair of a problem, ``problem.contacts[i]``.

    Forces and pressures are those on the slave. The outward normal of the slave is n, its tangent
    tau = (-n_y, n_x); slip and shear are positive along tau. In space these are tangential vectors,
    lengths of nodes are the roots of their areas, and all integrals are over areas.

    All arrays are copies, equal on all ranks. Nodal arrays follow the slave nodes along the
    surface, at the present multipliers and the last evaluated displacement; after a solve this is
    the solution. With degree 2, ends and midpoints of facets alternate along each curve, which
    begins with an end. All attributes but ``forces``, ``fluxes``, ``slave`` and ``master`` are
    local. Only ``offset`` and ``c_n`` may be set.

    Attributes:
        pair: The ``ContactPair`` or ``TiedPair``; its ``law`` may be set.
        state: Multipliers, active set and all other quantities of the interface's state, as a
            value.
        nodes: Global numbers of the slave nodes in the displacement's space V, shape (slave
            nodes,). Values of a function of V at the slave nodes that a rank owns::

                first, end = V.dofmap.index_map.local_range
                mine = (first <= contact.nodes) & (contact.nodes < end)
                values = u.x.array.reshape(-1, dim)[contact.nodes[mine] - first]

        positions: Present positions of the slave nodes, shape (slave nodes, dim) [length]; before
            the first solve those in the mesh.
        normals: Outward unit normals of the slave nodes, shape (slave nodes, dim) [1].
        lengths: Tributary length of each node, undeformed, shape (slave nodes,) [length].
        tractions: Multipliers z, minus the tractions on the slave, shape (slave nodes, dim)
            [stress].
        pressure: Contact pressure z_n, positive in compression, shape (slave nodes,) [stress].
        shear: Multiplier z_tau along tau, shape (slave nodes,) [stress]; in space the tangential
            part of the multiplier, a vector, (slave nodes, 3). It has the sign of the slip: the
            shear traction on the slave is -z_tau.
        slip: Slip of the slave relative to the master in the last step, since the accepted state
            before the solve, along tau, shape (slave nodes,), in space (slave nodes, 3) [length].
        gap: Mean gap g_j / w_j, nan at nodes without partner, shape (slave nodes,) [length].
        active: Active set, the nodes whose gap is closed, shape (slave nodes,), bool.
        sticking: Active nodes that stick or are tied, shape (slave nodes,), bool.
        total_force: Total contact force on the slave body, shape (dim,) [stress length].
        friction_work: Work of friction in the last step [stress length^2], by the shear at its end
            along the slip in it, as the law dissipates it: not negative. Of laws whose slip is
            elastic in part, as bonds, it includes stored energy. ``PathReport.friction_work`` is
            its sum over a path.

    Example:
        Pressure along the surface after a solve, as columns x, y, pressure::

            contact = problem.contacts[0]
            np.savetxt("pressure.txt", np.column_stack([contact.positions, contact.pressure]))
    """

    # A law set here instead of in the pair is an error, not a new attribute without effect.
    __slots__ = ("_interface", "_space")

    pair: Any = read_only("_interface.pair")
    state: InterfaceState = read_only("_interface.state")
    nodes: Indices = copied("slave.nodes")
    positions: Array = copied("operators.x")
    normals: Array = copied("operators.n")
    lengths: Array = copied("slave.nodal_lengths")
    tractions: Array = copied("z_u")
    pressure: Array = copied("pressure")
    shear: Array = copied("now.surface_shear")
    slip: Array = copied("now.surface_slip")
    gap: Array = copied("gap")
    active: Flags = copied("active")
    sticking: Flags = copied("sticking")
    total_force: Array = copied("total_force")
    friction_work: float = read_only("_interface.now.friction_work")

    def __init__(self, interface: Interface, space: DisplacementSpace) -> None:
        self._interface, self._space = interface, space

    def __repr__(self) -> str:
        """Pair, total force and number of active nodes."""
        force = ", ".join(f"{component + 0.0:.6g}" for component in self.total_force)
        return f"<{self.pair!r}: force ({force}), {self.active.sum()} nodes active>"

    def __dir__(self) -> list[str]:
        """The public attributes."""
        return [name for name in vars(type(self)) if not name.startswith("_")]

    @property
    def slave(self) -> PairSide:
        """Nodes and dofs of the slave, the rows of D and M; collective."""
        return side_of(self._interface.slave, self._space)

    @property
    def master(self) -> PairSide:
        """Nodes and dofs of the master, the columns of M; without nodes on obstacles; collective.

        Those of the slave if its surface may touch itself.
        """
        return side_of(self._interface.master, self._space)

    @property
    def status(self) -> npt.NDArray[np.str_]:
        """Status "open", "stick" or "slip" (also without friction), shape (slave nodes,)."""
        return np.where(self.active, np.where(self.sticking, "stick", "slip"), "open")

    @property
    def forces(self) -> Array:
        """Contact forces on the slave nodes, shape (slave nodes, dim) [stress length].

        With a thickness, as for bodies of revolution, forces on the whole bodies [force].

        Collective.
        """
        return -self._interface.operators.force(self._interface.z_u)[0]

    @property
    def fluxes(self) -> list[NodalFlux]:
        """Fluxes of scalar fields, in the order of ``fluxes`` or ``fields``; collective."""
        return [flux.nodal() for flux in self._interface.all_fluxes]

    @property
    def offset(self) -> Array:
        """Length subtracted from the pointwise gap, shape (slave nodes,) [length].

        May be set, also by one number for all nodes. An interference of the mesh is ramped by
        ``contact.offset = (1 - t) * overlap`` with ``t`` from 0 to 1, where
        ``overlap = np.nan_to_num(contact.gap).clip(max=0)`` at the start; the wear of the last step
        is removed by ``contact.offset -= depth``.

        Raises:
            ValueError: If the new offset has a wrong shape or is not finite.
        """
        return self._interface.offset.copy()

    @offset.setter
    def offset(self, lengths: Array | float) -> None:
        self._interface.offset = lengths

    @property
    def memory(self) -> dict[str, Array]:
        """Memory of the law at the last accepted state by name, (slave nodes,) each [its units]."""
        return {n: v.copy() for n, v in self._interface.accepted_instant.memory.items()}

    @property
    def c_n(self) -> float:
        """Weight of the gap in the complementarity function [1]; may be set."""
        return self._interface.c_n

    @c_n.setter
    def c_n(self, weight: float) -> None:
        self._interface.c_n = weight


# Points of each segment at which surfaces may overlap [1].
POINTS = np.linspace(-1.0, 1.0, 9)


def describe_start(contact: Interface) -> str:
    """Message on an overlap or on missing partners of the present state; "" if not needed.

    An interference that the user prescribed is no overlap, nor is the mean gap of a node that
    touches a curve, negative since dual functions have negative parts. Collective.
    """
    if not isinstance(contact, Contact):
        return ""
    if not contact.covered.any():
        return (
            f"no node of '{contact.slave.name}' faced '{contact.master.name}' before the first "
            f"solve: no partner within {contact.options.radius:.3g} along the normals; the pair "
            f"transmits no force until the surfaces approach"
        )
    overlap = -np.nan_to_num(contact.gap)
    not_prescribed = overlap - _interference(contact)
    j = int(np.argmax(not_prescribed / contact.slave.nodal_lengths))
    if not_prescribed[j] <= SAME_PLACE * contact.slave.nodal_lengths[j]:
        return ""
    if not _overlaps(contact):
        return ""
    cure = "move the bodies apart in the mesh"
    if contact.obstacle is not None:
        cure = "move the obstacle back"
    return (
        f"'{contact.slave.name}' and '{contact.master.name}' overlap by up to {overlap[j]:.3g} at "
        f"{format_point(contact.operators.x[j])} before the first solve, treated as interference; "
        f"if none is meant, {cure} (initial_gap=0 closes gaps and overlaps of up to half a facet)"
    )


def _overlaps(contact: Contact) -> bool:
    """Whether a point of a facet overlaps by more than the user prescribed (collective)."""
    o, s = contact.operators, contact.intersections()
    if contact.slave.dim == 3:
        gaps = o.smallest_gaps(contact.offset)[0][:, None]
    else:
        gaps = o.sample_gaps(o.x + contact.offset[:, None] * o.n, s, POINTS)
    admitted = _interference(contact) + SAME_PLACE * contact.slave.nodal_lengths
    deep = gaps < -admitted[s.slave].max(axis=1, initial=0.0)[:, None]
    return on_any_rank(contact.slave.comm, bool(deep.any()))


def _interference(contact: Contact) -> Array:
    """Interference of each slave node that the user prescribed, (slave nodes,) [length]."""
    if contact.pair.initial_gap is None:
        return np.maximum(contact.offset, 0.0)
    return np.full(contact.slave.num_nodes, max(-contact.pair.initial_gap, 0.0))


def describe_search_radius(contact: Contact) -> str:
    """Search radius as text."""
    if contact.obstacle is not None:
        return f"up to {contact.options.radius:.3g}"
    return (
        f"up to {contact.options.radius:.3g}, behind the surface at most up to half the thickness "
        "of both bodies"
    )


def describe_overlap(contact: Interface) -> str:
    """Message on the largest overlap of an active node; "" if it is small."""
    if not isinstance(contact, Contact):
        return ""
    sizes, interference = contact.slave.nodal_lengths, _interference(contact)
    overlap = np.where(contact.active, -np.nan_to_num(contact.now.closing_gap) / sizes, 0.0)
    j = int(np.argmax(overlap))
    if overlap[j] <= BEHIND:
        return ""
    depth = overlap[j] * sizes[j]
    if overlap[j] - interference[j] / sizes[j] <= BEHIND:
        return (
            f"'{contact.slave.name}' has an interference of {interference[j]:.3g} "
            f"({interference[j] / sizes[j]:.1f} facets) with '{contact.master.name}' at "
            f"{format_point(contact.operators.x[j])}: increase it in steps, by the offset of the "
            "pair in problem.contacts"
        )
    return (
        f"the node at {format_point(contact.operators.x[j])} of '{contact.slave.name}' overlaps "
        f"'{contact.master.name}' by {overlap[j]:.1f} facets; partners are searched "
        f"{describe_search_radius(contact)}: take smaller steps or, if this is not a contact, set "
        f"search_radius below {depth:.3g}"
    )


# Coefficient of friction above which no dry surfaces are known, rubber included [1]; angles in
# degrees and per cents are above.
LARGE = 5.0
# The same up to which these may be meant [1]; what lets surfaces stick, such as 1000, is above.
PER_CENT = 100.0


def remarks_on_friction(contacts: Sequence[Interface]) -> Iterator[str]:
    """Name coefficients of friction that look like angles or per cents, of all pairs (local)."""
    for contact in contacts:
        if not (isinstance(contact, Contact) and isinstance(contact.pair.law, Coulomb)):
            continue
        mu = np.max(contact.parameters.get("mu", contact.pair.law.mu))
        if LARGE < mu < PER_CENT:
            yield (
                f"{contact.pair!r}: the coefficient of friction is {mu:g}, the ratio of shear to "
                f"pressure: {mu:g} per cent are {mu / 100:g}, and an angle of friction of phi "
                "degrees is tan(radians(phi))"
            )


def remarks_on_ties(contacts: Sequence[Interface], space: DisplacementSpace) -> Iterator[str]:
    """Describe unknowns and nodes that are not tied, and pressures that are not unique.

    Args:
        contacts: All pairs.
        space: The displacement's nodes, and the mixed space.
    """
    for tie in [tie for tie in contacts if isinstance(tie, Tie)]:
        yield from filter(None, [_other_fields(tie, space), _open_ends(tie)])
        yield from _divided_slaves(tie, [c for c in contacts if isinstance(c, Contact)])


def _other_fields(tie: Tie, space: DisplacementSpace) -> str:
    """Name the unknowns that are not tied; "" if all are."""
    if not space.is_mixed:
        return ""
    tied = (space.part, *tie.pair.fields)
    others = [part for part in range(space.whole.num_sub_spaces) if part not in tied]
    if not others:
        return ""
    numbers = " and ".join(map(str, others))
    return (
        f"{tie.pair!r} does not tie sub-space {numbers} of the mixed function u, which may jump "
        f"there. A pressure of incompressible bodies need not be tied; of a temperature nothing "
        f"flows across, with fields={[*tie.pair.fields, *others]} it would"
    )


def _open_ends(tie: Tie) -> str:
    """Describe nodes at which the tie yielded to other pairs; "" if there are none."""
    alone = tie.open_ends
    if not alone.any():
        return ""
    return (
        f"{tie.pair!r} has no multiplier at {alone.sum()} nodes, one at "
        f"{format_point(tie.slave.X[alone.argmax()])}, since other pairs have one there: the joint "
        "may open by a fraction of the displacement of a facet; omit algorithm='condensed', refine "
        "the slaves, or exchange slave and master"
    )


def _divided_slaves(tie: Tie, contacts: Sequence[Contact]) -> Iterator[str]:
    """Describe slaves of two contacts whose masters meet at the end of a joint."""
    for merged, kept in tie.welds():
        here = [c for c in contacts if np.isin((merged, kept), c.master.nodes).any()]
        for i, one in enumerate(here):
            for other in here[i + 1 :]:
                if np.intersect1d(one.slave.nodes, other.slave.nodes).size:
                    where = tie.slave.X[np.flatnonzero(tie.slave.nodes == merged)[0]]
                    yield (
                        f"'{one.slave.name}' is the slave of '{one.master.name}' and of "
                        f"'{other.master.name}', which {tie.pair!r} joins at "
                        f"{format_point(where)}: their pressures may oscillate there; pass both "
                        "masters in one list, which makes them one surface"
                    )


def or_other_weights(contact: Interface) -> str:
    """Advice to weight gaps by standard functions, if these are positive and not taken; else ""."""
    linear = contact.basis == "vertices" or (contact.basis == "dual" and contact.slave.degree == 1)
    others = contact.pair.discretization.gap_weights != "standard"
    return ", or take Discretization(gap_weights='standard')" * (linear and others)
