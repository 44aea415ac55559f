# SPDX-License-Identifier: MIT
"""Contact of a pair: weighted gap, active set, complementarity, and the rows of the multiplier.

The complementarity function of slave node j is (Popp, Gee & Wall 2009; Foltyn & Vlach 2016, eq. 6)

    C_j = z_n - max(0, z_n - c_j g_j / w_j),    z_n = n_j . z_j,

with g_j the weighted gap and w_j = int Phi_j, the row sum of D and D_jj of most dual functions; the
node is active where z_n - c_j g_j / w_j > 0. For the increment dd of the displacement and the new
multiplier z, its two rows in the linear system are

    active:     G_j dd = -g_j,     d(tau_j) . z_j^k + tau_j . z_j = 0
    inactive:   z_j = 0.

The second row of an active node is that of frictionless contact; in general it is the linearized
rho_j = 0 of the contact law, see ``law``, with the slip of ``slip``. With adhesion a(g), z_n + a
replaces z_n in the complementarity function, and the normal row of an inactive node under adhesion
is z_n + a(g_j / w_j) = 0.

c_j = c k_j / l_j with k_j the mean diagonal entry of the bulk tangent at the node (about Young's
modulus), l_j its length and c a number without unit: results do not depend on the system of units.

``begin_step``, ``instants_of`` and ``commit`` start and end a step of all pairs: slip, time and
memory.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.contact import interface, law_calls
from fenics_mortar.contact.fields import MAX_SOFTENING, ContactFields
from fenics_mortar.contact.fluxes import Flux
from fenics_mortar.contact.law import Frictionless, Nodal
from fenics_mortar.contact.rows import (
    ContactRows,
    MultiplierNodes,
    change_along,
    next_sets,
    normals_on_planes,
)
from fenics_mortar.contact.slip import find_partners
from fenics_mortar.contact.space_fields import SpaceFields
from fenics_mortar.interface.facing import face
from fenics_mortar.interface.integrals import Segments, evaluate_normals
from fenics_mortar.interface.self_contact import in_contact_with_itself, starts_of_holes
from fenics_mortar.utils.arrays import HALF_FACET, Array, Flags, Indices
from fenics_mortar.utils.errors import MortarError, SurfaceError, check_lengths, check_same

if TYPE_CHECKING:
    from fenics_mortar.contact.pair import ContactPair, Measure
    from fenics_mortar.interface.mortar import Linearization, MortarOperators
    from fenics_mortar.interface.outline import Outline
    from fenics_mortar.mesh.space import DisplacementSpace


class Contact(interface.Interface):
    """One pair bound to a displacement space: surfaces, multipliers, active set, operators.

    Replicated: all attributes except the blocks in ``operators`` are equal on all ranks.

    Attributes:
        evaluation: Evaluation of the operators.
        arm: Length by which angles of the obstacle are multiplied [length].
        master_free: 1 where a component of a master node is not prescribed, else 0, (nodes, dim).
        law_calls: Calls of the pair's law, with checks of the results.
        parameters: Parameters of the law that vary in space, by name, (slave nodes,) each.
        follows_law: Whether the contact law applies to a node: false if a component is prescribed,
            unless it is guided, shape (slave nodes,), bool.
        is_guided: Whether a node in space can slide in one direction of a symmetry plane, shape
            (slave nodes,), bool.
        guides: Normals of the planes of guided nodes, zero elsewhere, shape (slave nodes, dim).
        plane_normals: Normals of slave nodes on symmetry planes, nan elsewhere, (slave nodes, dim).
        master_planes: Normals of master nodes on symmetry planes, nan elsewhere, (nodes, dim).
        set_aside: Nodes of bodies that are set aside in a solve, see ``rigid.idle``, shape (slave
            nodes,), bool.
        turns: Function of the angles by which rigid boundaries have turned the bodies of the slave
            and the master nodes, nan without one, (nodes,) each [radian].
        offset: Length subtracted from the pointwise gap, shape (slave nodes,) [length]. May be set.
    """

    now: ContactFields
    rows: ContactRows

    offset = interface.settable(
        "offset", lambda self, value: check_lengths("offset", value, self.slave.num_nodes)
    )

    nodal, sliding = interface.read_only("now.nodal"), interface.read_only("now.sliding")
    attracted, arm = interface.read_only("now.attracted"), interface.read_only("evaluation.arm")

    def __init__(
        self, pair: ContactPair, space: DisplacementSpace, prescribed: Flags,
        welds: Indices, tied: Indices,
    ) -> None:  # fmt: skip
        """Extract the surfaces (collective); see ``Interface``.

        Args:
            pair: See ``Interface``, as the next three.
            space: Nodes and dofs of the displacement.
            prescribed: Whether a local dof has a Dirichlet value, shape (local dofs,), bool.
            welds: Pairs of nodes to be merged, shape (k, 2).
            tied: Global nodes with the multiplier of a tie, shape (k,). They hand their multiplier
                functions of the contact over to their neighbours, if there are any.
        """
        super().__init__(pair, space, prescribed, welds)
        self._kind = ContactFields if self.slave.dim == 2 else SpaceFields
        self.rows = ContactRows(self)
        choice = pair.discretization
        normals, _ = evaluate_normals(self.slave, self.slave.X, choice.normals)
        nodes = MultiplierNodes(self.slave, normals, self.free, at_vertices=self.at_vertices)
        self._multiplier_nodes = nodes
        self.master_free: Array = 1.0 - self.master.gather(prescribed.astype(float))
        on_master, _ = evaluate_normals(self.master, self.master.X, "opposite")
        self.master_planes: Array = normals_on_planes(on_master, self.master_free)
        nodes.possible &= ~(self.slave.weightless | self.shared)
        self.tied: Flags = np.isin(self.slave.nodes, tied)
        if (nodes.possible & ~self.tied).any():
            nodes.possible &= ~self.tied
        self.may_carry, self.oblique = nodes.possible, nodes.oblique
        self.plane_normals = nodes.plane_normals
        planes = self._find_guides()
        if self.master is self.slave:
            self.may_carry[starts_of_holes(self.slave)] = False
            self.slave = self.master = in_contact_with_itself(self.slave, self.may_carry)
        if not self.may_carry.any():
            raise SurfaceError(f"all nodes of slave surface '{pair.slave_name}' are prescribed")
        self.omit_softening(always=False)
        self.set_aside: Flags = np.zeros(self.slave.num_nodes, bool)
        self.turns: Callable[[], tuple[Array, ...]] = lambda: ()
        radius = min(self.slave.extent, self.master.extent) if self.obstacle is None else np.inf
        points = interface.points_per_segment(pair, self.slave, self.master)
        self.options = choice.options(self.basis, points, pair.search_radius or radius)
        given = self.slave, self.master, self.obstacle, self.slave.extent, planes, self.options
        self.evaluation = interface.OperatorEvaluation(*given, small=pair.sliding == "small")
        slave = self.slave
        self._parameters = law_calls.Parameters(
            space.V.mesh, slave.name, slave.X, lambda f: slave.gather(space.nodal_values(f))[:, 0]
        )
        self.law_calls = law_calls.LawCalls(pair)
        self.adopt_law()
        none, X = np.zeros(slave.num_nodes), slave.X
        memory = dict.fromkeys(pair.law.memory, none) | self.state.accepted_instant.memory
        times = 0.0, 1.0, memory, self.parameters
        start = Nodal(none, none, none, none, none + 1.0, none, X, X, *times)
        # ``tangential`` is given branches of the law also before the first active set
        branch = self.law_calls.branch(start, np.zeros(none.size, np.int64))
        self.change(multiplier_nodes=self.may_carry, branch=branch, c_n=choice.c_n)
        law_calls.raise_stored(self.slave.comm, [self])
        self.all_fluxes = [Flux(h, i, space, self, prescribed) for i, h in enumerate(pair.fluxes)]
        self.change(conduction=np.zeros((self.slave.num_nodes, len(pair.fluxes))))
        self.fluxes = [flux for flux in self.all_fluxes if not flux.is_separate]
        self.conductances = self.fluxes

    def _find_guides(self) -> Array:
        """Find nodes to which the law applies, and directions in which those on planes are held.

        Where one component in space is prescribed, the law applies along the symmetry plane.

        Returns:
            ``OperatorEvaluation.planes``.
        """
        num_free = self.free.sum(axis=1)
        on_plane = np.isfinite(self.plane_normals[:, 0])
        self.is_guided: Flags = on_plane & (num_free == 2.0) & (self.slave.dim == 3)
        self.guides: Array = np.where(self.is_guided[:, None], 1.0 - self.free, 0.0)
        self.follows_law: Flags = (num_free == self.slave.dim) | self.is_guided
        if self.slave.dim == 2:
            return self.plane_normals
        kept = np.where(on_plane[:, None], self.free, 1.0)
        return kept[:, :, None] * np.eye(self.slave.dim)

    @cached_property
    def across_planes(self) -> Any:
        """Symmetry planes, where surfaces rotate with their mirror images [1].

        In the plane ``master_planes``, in space the components of slave and master nodes across
        planes, shapes (nodes, 3), bool; ``None`` with small sliding: surfaces do not rotate.
        """
        if self.pair.sliding == "small":
            return None
        if self.slave.dim == 2:
            return self.master_planes
        planes = (self.plane_normals, self.free), (self.master_planes, self.master_free)
        return [np.isfinite(n[:, :1]) & (free == 0.0) for n, free in planes]

    def leave_out(self, nodes: Flags) -> None:
        """Leave slave nodes (slave nodes,), bool, out of contact, see ``set_aside`` (local)."""
        self.set_aside = nodes

    def limit_sight(self, outline: Outline) -> Outline:
        """Store the outlines, which limit the distance of partners behind the slave (local)."""
        self.evaluation.limit_sight(outline)
        return outline

    def evaluate(self, u: Array, linearization: Linearization) -> None:
        """Evaluate the operators at the displacement ``u``, shape (local dofs,) (collective)."""
        law, start = self.pair.law, self._state.start_instant
        names = law_calls.names_of_memory(law, self.slave.dim)
        if self._law is not law or tuple(start.memory) != names:
            self._read_law(start)
        operators, reference = self.evaluation.evaluate(u, self._state, linearization)
        if reference is not self._state.reference:
            self.change(reference=reference)
        self.set_operators(operators)  # also if they are cached: the law may have changed
        if self.slip_measure == "operators":
            _ = self.operators.vectors  # collective: evaluated on all ranks
        for flux in self.fluxes:
            flux.evaluate(u)

    @cached_property
    def slip_measure(self) -> Measure:
        """The pair's measure of slip.

        Always "partners" on obstacles and with small sliding, else "operators" in space.
        """
        if self.obstacle is not None or self.pair.sliding == "small":
            return "partners"
        return "operators" if self.slave.dim == 3 else self.pair.discretization.slip

    @property
    def depends_on_slip(self) -> bool:
        """Whether forces depend on a slip that is counted from partners."""
        return self.pair.sliding != "small" and self.pair.law.needs_slip

    @property
    def partner_operators(self) -> Any:
        """Operators at the positions that define the partners; undeformed if sliding is small."""
        if self.pair.sliding == "small" and self._state.reference is not None:
            return self._state.reference.operators
        return self.operators

    def intersections(self) -> Segments:
        """Intersections of this rank's slave facets with the master, for any integration."""
        return self.evaluation.intersections(self.partner_operators)

    def set_arm(self, arm: float) -> None:
        """Set the length by which angles of the obstacle are multiplied [length]."""
        self.evaluation.arm = arm

    def adopt(self, other: Contact) -> None:
        """Copy offset, c_n and frozen operators from this pair in another model (local)."""
        reference = other.state.reference or self.state.reference
        self.change(offset=other.offset, c_n=other.c_n, reference=reference)
        self.evaluation.behind = other.evaluation.behind or self.evaluation.behind

    def begin(self) -> None:
        """Reset the counts of changes, turns and openings, and the forces of the last solve."""
        self._multiplier_nodes.begin()
        self.change(force_decided=None, heading=None, opened=None)

    def move(self, z: Array, fraction: float, step: Array) -> None:
        """See ``Interface``; also marks nodes with tensile multiplier and compressive force.

        Collective. The linear system contains the force w z of a node to first order, w_old z + dw
        z_old. If the weight more than doubles, as at a sliding edge, dw z_old may exceed the force,
        and z becomes tensile. The active set of such a node is therefore decided by its force; if
        decided by z, the node would be open for one or two iterations.
        """
        old, o, adhesion = self.z, self.operators, self.now.pull.residual
        acting = self.now.acting  # whose derivatives the linear system has
        z = old + fraction * (z - old) if fraction < 1.0 else z
        self.change(z=z, force_decided=None)
        pulls = self.active & (self.now.z_n + adhesion < 0.0)
        if pulls.any():
            sides = self.slave.gather(step), self.master.gather(step)
            change = fraction * change_along(self.now, acting.weight_derivative(), *sides)
            pulls &= change > o.weight
            force = o.weight[:, None] * z + change[:, None] * old
            min_force = -o.weight * adhesion
            force_decided = (pulls & (np.einsum("ja,ja->j", o.n, force) > min_force), force)
            self.change(force_decided=force_decided)

    def accept(self, slid: Flags | None = None) -> None:
        """Find the partners at the last evaluated state (collective).

        Args:
            slid: Nodes that keep their present slip, shape (slave nodes,), bool.
        """
        now = self.now
        found = find_partners(now)
        slip, shear = found.counted, now.surface_shear.copy()
        shear[~self.active] = 0.0
        turns = self.turns() if slid is None else self.partners.turns
        if slid is not None:  # rigid moves before a solve leave prescribed nodes behind
            slip = np.zeros_like(slip)
            slip[slid] = now.counted_slip[slid]
        o, between = now.operators, self.slave.dim == 2 and self.obstacle is None
        found = replace(
            found, facing=face(o, o.segments) if between and self.pair.law.has_friction else None,
            counted=slip, shear=shear, pressure=np.where(self.active, now.z_n, 0.0),
            gap=np.where(self.covered, now.mean_gap, np.inf), turns=turns,
        )  # fmt: skip
        self.change(accepted_partners=found)

    def lead_by(self, turns: Callable[[], tuple[Array, ...]]) -> None:
        """Set ``turns``: rigid boundaries lead the bodies of some nodes (local)."""
        self.turns = turns

    def start_step(self) -> None:
        """Count slip and memory from the accepted state (local)."""
        self.change(partners=self.accepted_partners, start_instant=self._state.accepted_instant)

    def omit_softening(self, *, always: bool) -> None:
        """Leave the derivative of softening adhesion out, always or of fast softening (local)."""
        self.max_softening = 0.0 if always else MAX_SOFTENING

    def adopt_law(self) -> None:
        """Adopt the present law of the pair (collective).

        Parameters that vary in space are evaluated. If the names in memory differ from those of the
        last law, memory starts from its initial values.
        """
        before = self._state.accepted_instant
        if self._read_law(before) is not before:
            self.change(accepted_instant=self._state.start_instant)

    def _read_law(self, before: law_calls.Instant) -> law_calls.Instant:
        """Read parameters and memory of the present law; results may be asked for at any time.

        Collective.

        Args:
            before: Time and memory to start from, if the names are those of the law.

        Returns:
            These, or the first ones of the law, which are then those of the start of the step.
        """
        law = self.pair.law
        self.parameters = self._parameters.sample(law) if law.fields else {}
        self._law = law  # not one whose parameters cannot be read
        if tuple(before.memory) == law_calls.names_of_memory(law, self.slave.dim):
            return before
        first = law_calls.first_instant(law, self.slave.X, before.time, self.slave.comm)
        self.change(start_instant=first)
        return first

    def coupled_by_slip(self) -> tuple[Indices, Indices]:
        """Slave nodes and the master nodes coupled to them by slip, each (k,)."""
        law = self.pair.law
        if type(law) is Frictionless or not law.needs_slip:
            return interface.NO_PAIRS
        return self.partners.pairs(self.operators)

    def update_multiplier_nodes(self) -> int:
        """Update the multiplier nodes, see ``rows``; return the number of changes.

        After a change the operators must be evaluated again. No node changes with
        integration="nodes".
        """
        if self.options.integration == "nodes":
            return 0
        cover = _covered_fraction(self.operators)
        new, changed = self._multiplier_nodes.update(self.multiplier_nodes, cover)
        if changed:
            self.change(multiplier_nodes=new)
        return changed

    @property
    def undecided(self) -> Indices:
        """Nodes whose cover is at the limit, (k,); see ``MultiplierNodes.undecided``."""
        if self.options.integration == "nodes":
            return np.empty(0, np.int64)
        return self._multiplier_nodes.undecided(_covered_fraction(self.operators), self.active)

    def set_initial_gap(self) -> None:
        """Set the offset such that nodes near the other surface have the pair's ``initial_gap``."""
        if self.pair.initial_gap is not None:
            radius = HALF_FACET * self.slave.nodal_lengths
            near = np.abs(np.nan_to_num(self.gap, nan=np.inf)) <= radius
            self.offset = np.where(near, np.nan_to_num(self.gap) - self.pair.initial_gap, 0.0)

    def update_active(self, *, start: bool = False) -> int:
        """Set the active set by the complementarity function; return the number of changes.

        Args:
            start: Whether this precedes the first solve; see ``rows``.
        """
        self.now, changed = next_sets(self.now, start=start)
        self._state = self.now.state
        return changed


def _covered_fraction(o: MortarOperators) -> Array:
    """Cover of slave nodes over that of fully covered facets, (slave nodes,) [1] (local)."""
    alone = o.slave.weightless
    return np.where(alone, 0.0, o.cover / np.where(alone, 1.0, o.slave.full_cover))


def begin_step(contacts: Sequence[interface.Interface]) -> None:
    """Adopt the present laws, and start a step at the accepted state (collective).

    Raises:
        MortarError: On all ranks, if a law needs the length of the step and the time is not later
            than that of the accepted state.
        Exception: Any error of a law, on all ranks.
    """
    for contact in contacts:
        if isinstance(contact, Contact):
            contact.adopt_law()
            _check_time(contact)
        contact.start_step()


def needing_time(contact: Contact) -> list[Any]:
    """Laws and conductances of a contact that need the length of the step (local)."""
    law, fluxes = contact.pair.law, contact.pair.fluxes
    heated = [flux for flux in fluxes if flux.heating == "friction"] if law.has_friction else []
    return [law, *heated] if law.needs_time else heated


def _check_time(contact: Contact) -> None:
    """Raise an error for a step of zero length if a law or a source needs the length (local)."""
    now, before = contact.state.load_time, contact.state.accepted_instant.time
    needing = needing_time(contact)
    if needing and not now > before:
        raise MortarError(
            f"{needing[0]!r} needs the length of the step, but the time {now:g} is not later "
            f"than {before:g}, that of the last accepted state: set problem.time before each "
            "solve, or use follow_path or Dynamics, which set it"
        )


def instants_of(comm: MPI.Comm, contacts: Sequence[interface.Interface]) -> list[law_calls.Instant]:
    """Time and memory of all pairs at the end of the present step (collective).

    Raises:
        Exception: Any error of a law, on all ranks.
        MortarError: On all ranks, if the memory of a law differs between ranks.
    """
    found = [_instant_of(c) if isinstance(c, Contact) else c.accepted_instant for c in contacts]
    law_calls.raise_stored(comm, contacts)
    memories = [
        (f"{name} of {contact.pair.law!r}", values)
        for contact, instant in zip(contacts, found, strict=True)
        for name, values in instant.memory.items()
    ]
    if memories:
        check_same(comm, memories)
    return found


def _instant_of(contact: Contact) -> law_calls.Instant:
    """Time and memory at the end of the present step (local)."""
    node, memory = contact.nodal, contact.nodal.memory
    if contact.pair.law.memory:
        memory = contact.now.remembered(contact.law_calls.remember(node, contact.branch))
    return law_calls.Instant.of(contact.state.load_time, node.step, memory)


def commit(contacts: Sequence[interface.Interface], instants: Sequence[law_calls.Instant]) -> None:
    """Set the accepted time and memory, from which the next step starts (local)."""
    for contact, instant in zip(contacts, instants, strict=True):
        contact.change(accepted_instant=instant)


def start_clock(contacts: Sequence[interface.Interface], time: float) -> None:
    """Set the time of the accepted state (local)."""
    for contact in contacts:
        instant = replace(contact.accepted_instant, time=time)
        contact.change(accepted_instant=instant, load_time=time)
