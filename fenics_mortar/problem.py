# SPDX-License-Identifier: MIT
"""The contact problem that a user sets up: UFL residual, Dirichlet conditions, contact pairs."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, get_args

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from fenics_mortar import compat
from fenics_mortar.bodies import (
    FloatingBody,
    centre_and_size,
    find_floating_bodies,
    label_bodies,
    resistance,
)
from fenics_mortar.bulk import Bulk
from fenics_mortar.certificate import Certificate, certify
from fenics_mortar.contact import Contact, ContactPair
from fenics_mortar.errors import MeshError, MortarError, NotConvergedError, SurfaceError, place
from fenics_mortar.mesh import check_plane
from fenics_mortar.mortar import LINEARIZATIONS
from fenics_mortar.newton import NewtonOptions, NewtonReport, Status, Step, solve
from fenics_mortar.operators import OperatorMatrices
from fenics_mortar.surfaces import Array
from fenics_mortar.system import SYSTEMS, Algorithm, obstacle_to_condensation
from fenics_mortar.tangent import TangentCheck, check_tangent

# Factor on c_n after a cycle of the active set.
LESS_WEIGHT = 0.01
EPSILON = float(np.finfo(float).eps)
# Active contact holds a body if all its free motions close or open gaps by more than this part.
HELD = 1e-10


@dataclass(frozen=True)
class State:
    """Displacement, multipliers and active sets of a problem, as copies; parts of this rank."""

    u: Array
    z: list[Array]
    active: list[npt.NDArray[np.bool_]]
    converged: bool


class ContactProblem:
    """Quasi-static equilibrium of bodies in contact.

    Args:
        residual: UFL form of f_int - f_ext, linear in a test function of the space of ``u``. Give
            its measures a ``quadrature_degree``.
        u: Displacement; its present value is the start of the next solve.
        pairs: Contact pairs.
        bcs: Dirichlet conditions, of dolfinx or from ``dirichlet``; values may change.
        petsc_options_prefix: Prefix of the options of the linear solver.
        petsc_options: Options of the linear solver; MUMPS LU by default.
        algorithm: "condensed" (the paper's Alg. 2, dual multipliers only) or "saddle" (Alg. 1);
            condensed by default where D can be inverted node by node.
        linearization: "full", "no_normals", "no_segments" or "frozen" (fixed point).
        newton: When to stop.
        jacobian: UFL form of the bulk tangent; the derivative of ``residual`` by default.

    Attributes:
        contacts: The pairs bound to the mesh: multipliers, active sets, operators.
        bulk: Bulk residual and tangent.

    Raises:
        MortarError: On all ranks, if mesh, surfaces or PETSc do not fit.
        ValueError: If an option is not one of those named.

    Note:
        All methods are collective.
    """

    def __init__(
        self,
        residual: Any,
        u: Any,
        pairs: Sequence[ContactPair],
        *,
        bcs: Sequence[Any] = (),
        petsc_options_prefix: str,
        petsc_options: dict[str, Any] | None = None,
        algorithm: Algorithm | None = None,
        linearization: str = "full",
        newton: NewtonOptions | None = None,
        jacobian: Any | None = None,
    ) -> None:
        if not isinstance(pairs, Sequence) or not all(isinstance(p, ContactPair) for p in pairs):
            raise ValueError(f"pairs={pairs!r}: right is a list of ContactPair")
        _check_space(u.function_space, pairs)
        if linearization not in LINEARIZATIONS:
            allowed = ", ".join(LINEARIZATIONS)
            raise ValueError(f"linearization={linearization!r}: allowed are {allowed}")
        if algorithm not in (None, *get_args(Algorithm)):
            allowed = ", ".join(get_args(Algorithm))
            raise ValueError(f"algorithm={algorithm!r}: allowed are {allowed}")
        self.newton = newton or NewtonOptions()
        self.linearization = LINEARIZATIONS[linearization]
        self._clock = _Clock()
        self.bulk = Bulk(residual, u, list(bcs), jacobian)
        self.comm: MPI.Comm = self.bulk.comm
        self.contacts = [Contact(pair, self.bulk.V, self.bulk.prescribed) for pair in pairs]
        self._check_slave_nodes()
        self._check_cells()
        self.bulk.check_finite()
        self.bulk.assemble_tangent()
        self._labels, num_bodies = label_bodies(self.bulk.V)
        self._set_stiffness()
        self._floating = find_floating_bodies(self.bulk, self._labels, num_bodies)
        if algorithm is None:
            algorithm = "saddle" if obstacle_to_condensation(self.contacts) else "condensed"
        self.system = SYSTEMS[algorithm](
            self.bulk, self.contacts, petsc_options_prefix, petsc_options or {}
        )
        self._last_converged = False
        self._recent_sets: list[list[npt.NDArray[np.bool_]]] = []
        for contact in self.contacts:
            contact.evaluate(u.x.array, self.linearization)

    # Solving

    def solve(self) -> NewtonReport:
        """Solve for the present loads and prescribed values; move ``u`` and the multipliers.

        Returns:
            The record of the Newton iterations.

        Raises:
            NotConvergedError: On all ranks; holds the record. ``u`` and the multipliers are left
                at the last iterate; to solve again, reset ``u`` and mend what was wrong.
            MortarError: On all ranks, if displacement, loads or prescribed values are not finite.
        """
        self.bulk.check_finite()
        self._clock.read()
        try:
            report = solve(self, self.newton)
        except NotConvergedError:
            self._last_converged = False
            raise
        self._last_converged = True
        return report

    def evaluate(self, *, start: bool) -> Status:
        """Evaluate residual, operators and active sets at the present state."""
        with self._clock("bulk"):
            self.bulk.assemble_residual()
        with self._clock("contact"):
            changed = 0
            if start:
                self._begin()
            for contact in self.contacts:
                contact.evaluate(self.bulk.u.x.array, self.linearization)
                changed += contact.update_active(start=start and not self._last_converged)
            residual, force = self._residual_and_force()
            gaps = [
                np.abs(c.gap / c.nodal_lengths)[c.active].max(initial=0.0) for c in self.contacts
            ]
            active = sum(int(c.active.sum()) for c in self.contacts)
            self._recent_sets.append([c.active.copy() for c in self.contacts])
            sets = b"".join(np.packbits(c.active).tobytes() for c in self.contacts)
            gap = float(max(gaps, default=0.0))
            return Status(residual, force, gap, active, changed, self._noise(), sets)

    def advance(self) -> Step:
        """Solve one linear system and move, less than all the way if cells would invert."""
        with self._clock("bulk"):
            self.bulk.assemble_tangent()
        with self._clock("contact"):
            self._refuse_free_motion()
            self.system.assemble()
        with self._clock("solve"):
            step, multipliers = self.system.solve()
        with self._clock("bulk"):
            part = self.bulk.move(step)
        for contact, z in zip(self.contacts, multipliers, strict=True):
            contact.z = contact.z + part * (z - contact.z) if part < 1.0 else z
        increment = float(step.norm(PETSc.NormType.INFINITY))
        step.destroy()
        size = max(self._largest_displacement(), 1e-8 * self._facet_length(), 1e-300)
        return Step(increment / size, part)

    def merge_sets(self, period: int) -> str:
        """Leave a cycle of the active set; say how.

        All nodes that were active in it are so for one iteration, and gaps weigh less from then on:
        a large c_n releases nodes for the small gaps that a step leaves behind.
        """
        for i, contact in enumerate(self.contacts):
            contact.active = np.any([sets[i] for sets in self._recent_sets[-period:]], axis=0)
            contact.c_n *= LESS_WEIGHT
        return (
            f"the active set went twice through a cycle of {period}; all nodes active in it stay "
            f"so for one iteration, and c_n is {LESS_WEIGHT:g} of what it was"
        )

    def _begin(self) -> None:
        """Forget the cycles of the last solve."""
        self._recent_sets = []
        for contact in self.contacts:
            contact.c_n = contact.pair.c_n

    def seconds(self) -> dict[str, float]:
        """Seconds since the last call by phase: bulk, contact, solve; of the slowest rank."""
        mine = self._clock.read()
        return {name: self.comm.allreduce(value, MPI.MAX) for name, value in mine.items()}

    def diagnose(self) -> str:
        """Count inverted cells, if there are any."""
        count, where = self.bulk.inverted_cells()
        if count:
            return f"{count} cells are inverted, one at {where}: try smaller load steps"
        return ""

    def _residual_and_force(self) -> tuple[float, float]:
        """Norm of all equations and of the forces they are made of [stress length].

        Gaps and distances to prescribed values count as forces by the stiffness of the bulk.
        """
        size, held = self.bulk.num_owned, self.bulk.held
        contact_force = np.zeros(size)
        rows = 0.0
        for contact in self.contacts:
            on_slave, on_master = contact.operators.force(contact.z)
            contact.slave.scatter_add(on_slave, contact_force)
            contact.master.scatter_add(on_master, contact_force)
            tangential = np.einsum("ja,ja->j", contact.operators.tau, contact.z)
            gap = np.where(contact.active, np.nan_to_num(contact.gap), 0.0)
            rows += ((contact.stiffness * gap) ** 2).sum()
            rows += ((contact.operators.diagonal * tangential) ** 2).sum()
        total = self.bulk.r.array_r[:size] + contact_force
        free = total.copy()
        free[held] = self._stiffest * self.bulk.distance_to_prescribed()
        mine = [free @ free, contact_force @ contact_force, total[held] @ total[held]]
        free2, contact2, reaction2 = self.comm.allreduce(np.array(mine))
        return float(np.sqrt(free2 + rows)), float(np.sqrt(max(contact2, reaction2)))

    def _noise(self) -> float:
        """Residual that rounding leaves, however long one iterates [stress length]."""
        num_dofs = self.bulk.r.getSize()
        bulk = np.sqrt(num_dofs) * self._largest_displacement()
        contact = sum(np.sqrt(c.slave.num_nodes) * np.abs(c.slave.X).max() for c in self.contacts)
        return 4.0 * EPSILON * self._stiffest * float(bulk + contact)

    def _largest_displacement(self) -> float:
        u = self.bulk.u.x.array
        return self.comm.allreduce(float(np.abs(u).max(initial=0.0)), MPI.MAX)

    def _facet_length(self) -> float:
        return min((float(c.slave.lengths.min()) for c in self.contacts), default=0.0)

    # Set-up and checks

    def _check_slave_nodes(self) -> None:
        """No node may carry two multipliers."""
        for i, one in enumerate(self.contacts):
            for other in self.contacts[i + 1 :]:
                both = np.intersect1d(one.slave.nodes, other.slave.nodes)
                if both.size:
                    where = one.slave.X[np.flatnonzero(one.slave.nodes == both[0])[0]]
                    raise SurfaceError(
                        f"{both.size} nodes are slaves in two pairs, '{one.slave.name}' and "
                        f"'{other.slave.name}', one at {place(where)}; make one of the two a "
                        "master there"
                    )

    def _check_cells(self) -> None:
        count, where = self.bulk.flat_cells()
        if count:
            raise MeshError(f"{count} cells have no area, one at {where}")

    def _set_stiffness(self) -> None:
        """Give each contact the mean diagonal of K at its slave nodes."""
        diagonal = self.bulk.K.getDiagonal().array_r
        if self.comm.allreduce(not np.isfinite(diagonal).all(), MPI.LOR):
            reason = self.diagnose() or "check the residual form"
            raise MortarError(
                f"the bulk tangent is not finite at the initial displacement: {reason}"
            )
        loose = (diagonal == 0.0) & ~self.bulk.prescribed[: self.bulk.num_owned]
        count, where = self.bulk.count_nodes(loose)
        if count:
            mine = set(self._labels[np.flatnonzero(loose) // 2].tolist())
            bodies = sorted(set().union(*self.comm.allgather(mine)))
            names = ", ".join(self._name_of(label) for label in bodies)
            raise MortarError(
                f"the bulk tangent has no stiffness at {count} nodes, one at {where}, of {names}: "
                "the residual form has to hold the stress of every body"
            )
        largest = float(np.abs(diagonal).max(initial=0.0))
        self._stiffest: float = self.comm.allreduce(largest, MPI.MAX)
        for contact in self.contacts:
            contact.stiffness = np.abs(contact.slave.gather(diagonal)).mean(axis=1)

    def _refuse_free_motion(self) -> None:
        """Raise if a body can move rigidly against neither bulk, supports nor active contact."""
        for body in self._floating:
            none = np.zeros((len(body.motions), 0))
            approach = np.hstack([none, *(self._approach(c, body) for c in self.contacts)])
            norms, motions = resistance(approach, MPI.COMM_SELF)
            if norms[-1] <= HELD:
                raise MortarError(
                    f"{self._name_of(body.label)} can {body.describe(motions[-1])} freely: its "
                    "Dirichlet conditions do not hold it and the active contact does not either"
                )

    def _approach(self, contact: Contact, body: FloatingBody) -> Array:
        """Normal approach of active nodes under the free motions, shape (motions, active nodes)."""
        o = contact.operators
        approach = np.zeros((len(body.motions), contact.slave.num_nodes))
        sides = []
        for surface in (contact.slave, contact.master):
            belongs = self._surface_labels(surface) == body.label
            sides.append(body.displacement(surface.X) * belongs[None, :, None])
        for i, (u_slave, u_master) in enumerate(zip(*sides, strict=True)):
            s = o.segments
            on_slave = np.einsum("ejk,ejc,ekc->ej", o.D, o.n[o.facet_nodes], u_slave[o.facet_nodes])
            on_master = np.einsum("sjl,sjc,slc->sj", o.M, o.n[s.slave], u_master[s.master])
            np.add.at(approach[i], o.facet_nodes, on_slave)
            np.add.at(approach[i], s.slave, -on_master)
        self.comm.Allreduce(MPI.IN_PLACE, approach)
        return approach[:, contact.active] / o.diagonal[contact.active]

    def _surface_labels(self, surface: Any) -> Array:
        labels = np.repeat(self._labels, 2).astype(float)
        return surface.gather(labels)[:, 0]

    def _name_of(self, label: int) -> str:
        """Name of a body from the cell tags, or where it is (collective)."""
        first = compat.dofmap(self.bulk.V)[:, 0]
        for data in (contact.pair.data for contact in self.contacts):
            if data.cell_tags is None:
                continue
            for name, tag in data.bodies.items():
                found = self._labels[first[data.cell_tags.find(tag)]] == label
                if self.comm.allreduce(bool(found.any()), MPI.LOR):
                    return f"body '{name}'"
        X = self.bulk.V.tabulate_dof_coordinates()[: self.bulk.num_owned // 2, :2]
        mine = self._labels[: len(X)] == label
        return f"the body around {place(centre_and_size(X[mine], self.comm)[0])}"

    def state(self) -> State:
        """Copy the present state."""
        return State(
            self.bulk.u.x.array.copy(),
            [contact.z.copy() for contact in self.contacts],
            [contact.active.copy() for contact in self.contacts],
            self._last_converged,
        )

    def restore(self, state: State) -> None:
        """Go back to a state, exactly."""
        self.bulk.u.x.array[:] = state.u
        for contact, z, active in zip(self.contacts, state.z, state.active, strict=True):
            contact.z, contact.active = z.copy(), active.copy()
            contact.evaluate(state.u, self.linearization)
        self._last_converged = state.converged

    def extrapolate(self, before: State, factor: float) -> None:
        """Move on by ``factor`` times the change since ``before``, as far as the cells bear."""
        step = self.bulk.r.duplicate()
        step.array[:] = factor * (self.bulk.u.x.array - before.u)[: self.bulk.num_owned]
        self.bulk.move(step)
        step.destroy()

    def certificates(self) -> list[Certificate]:
        """Measure balance, signs and penetration of each pair; see ``Certificate``."""
        return [certify(self.bulk, contact, self._labels) for contact in self.contacts]

    # For research

    @property
    def matrices(self) -> OperatorMatrices:
        """D, M, gap, normals and their derivatives as PETSc objects, at the present state."""
        return OperatorMatrices(self.bulk, self.contacts)

    @property
    def D(self) -> PETSc.Mat:
        """Slave mortar matrix of the first pair; see ``matrices``."""
        return self.matrices.D(0)

    @property
    def M(self) -> PETSc.Mat:
        """Master mortar matrix of the first pair; see ``matrices``."""
        return self.matrices.M(0)

    @property
    def tangent(self) -> PETSc.Mat:
        """Matrix of the linear system at the present state."""
        self.bulk.assemble_tangent()
        self.bulk.assemble_residual()
        self.system.assemble()
        return self.system.matrix

    def check_tangent(self, **options: Any) -> TangentCheck:
        """Taylor slopes of all derivatives at the present state; see ``tangent.check_tangent``."""
        return check_tangent(self, **options)


class _Clock:
    """Seconds by phase."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, phase: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self._seconds[phase] = self._seconds.get(phase, 0.0) + time.perf_counter() - start

    def read(self) -> dict[str, float]:
        """Seconds since the last call."""
        seconds = {name: self._seconds.get(name, 0.0) for name in ("bulk", "contact", "solve")}
        self._seconds = {}
        return seconds


def _check_space(V: Any, pairs: Sequence[ContactPair]) -> None:
    """Refuse what the package cannot do, before anything is computed (collective)."""
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
