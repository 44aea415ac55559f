# SPDX-License-Identifier: MIT
"""Derivatives at the present state: a Taylor test of all, and mortar operators as PETSc objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk.revolution import radial_dofs_on_axis
from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface.integrals import share_of
from fenics_mortar.interface.mortar import Block
from fenics_mortar.la.sparse import BlockMatrix
from fenics_mortar.la.system import SaddleSystem
from fenics_mortar.rigid.driven import by_spread, linearize_balance
from fenics_mortar.utils import compat, files
from fenics_mortar.utils.arrays import ASSEMBLY_ROUNDING, Array, Indices

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.fluxes import Flux
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.interface.surfaces import Surface


class OperatorMatrices:
    """Mortar operators of the present state as PETSc objects, for users' block solvers and studies.

    They are created on demand from the operators of a pair (all methods collective).

    Rows of D, M, gap and normals are slave nodes in their order along the surface, those of
    ``PairView.slave``, distributed evenly over the ranks; columns of D and M are slave and master
    nodes likewise, the latter those of ``PairView.master``. Columns of derivatives are the
    displacement dofs of the space (global numbers dim node + component).
    """

    def __init__(self, bulk: Bulk, contacts: Sequence[Interface]) -> None:
        self._bulk, self._contacts = bulk, contacts

    def D(self, pair: int = 0) -> PETSc.Mat:
        """Slave matrix, shape (slave nodes, slave nodes) [length]."""
        o = self._contacts[pair].operators
        blocks = [Block(o.facet_nodes, o.facet_nodes, o.D)]
        return self._assemble(blocks, o.slave.num_nodes, o.slave.num_nodes)

    def M(self, pair: int = 0) -> PETSc.Mat:
        """Master matrix, shape (slave nodes, master nodes) [length]."""
        o = self._contacts[pair].operators
        blocks = [Block(o.segments.slave, o.segments.master, o.M)]
        return self._assemble(blocks, o.slave.num_nodes, o.master.num_nodes)

    def gap(self, pair: int = 0) -> PETSc.Vec:
        """Weighted gap, shape (slave nodes,) [length^2]."""
        return self._vector(self._contacts[pair].operators.gap[:, None])

    def normals(self, pair: int = 0) -> PETSc.Vec:
        """Averaged unit normals, shape (dim slave nodes,)."""
        return self._vector(self._contacts[pair].operators.n)

    def gap_derivative(self, pair: int = 0) -> PETSc.Mat:
        """dg/dd, shape (slave nodes, N) [length]."""
        o = self._contacts[pair].operators
        return self._assemble(o.gap_derivative(), o.slave.num_nodes, None)

    def normals_derivative(self, pair: int = 0) -> PETSc.Mat:
        """dn/dd, shape (dim slave nodes, N) [1 / length]."""
        o = self._contacts[pair].operators
        mine, dim = o.slave.owned, o.slave.dim
        block = Block(dim * mine[:, None] + np.arange(dim), o.normal_columns()[mine], o.dn[mine])
        return self._assemble([block], dim * o.slave.num_nodes, None)

    def slave_force_derivative(self, z: Array, pair: int = 0) -> PETSc.Mat:
        """d(D^T z)/dd at fixed ``z`` (slave nodes, dim), shape (N, N) [stress]."""
        blocks = [self._contacts[pair].operators.slave_force_derivative(z)]
        return self._assemble(blocks, None, None)

    def master_force_derivative(self, z: Array, pair: int = 0) -> PETSc.Mat:
        """-d(M^T z)/dd at fixed ``z`` (slave nodes, dim), shape (N, N) [stress]."""
        blocks = [self._contacts[pair].operators.master_force_derivative(z)]
        return self._assemble(blocks, None, None)

    def flux_loads(self, pair: int = 0, number: int = 0) -> PETSc.Vec:
        """Loads of a flux in the equation of its field, shape (dofs,) [flux length].

        Args:
            pair: Number of the pair.
            number: Number of the flux in the pair's ``fluxes``, with the field's own function.
        """
        flux = self._flux(pair, number)
        vector = compat.create_vector(flux.law.field.function_space)
        flux.add_loads(vector.array)
        return vector

    def flux_derivative(self, pair: int = 0, number: int = 0) -> PETSc.Mat:
        """Derivative of ``flux_loads`` by the field, shape (dofs, dofs) [flux length / field].

        Args:
            pair: Number of the pair.
            number: Number of the flux in the pair's ``fluxes``, with the field's own function.
        """
        flux = self._flux(pair, number)
        size = flux.law.field.function_space.dofmap.index_map.size_local
        self._bulk.free_garbage()
        derivative = flux.now.derivative([flux.now.by_field()])
        return BlockMatrix(self._bulk.comm, size, size).assemble([derivative])

    def _flux(self, pair: int, number: int) -> Any:
        """A flux whose field is solved for in a problem of its own, with its present values.

        Raises:
            ValueError: On all ranks, if it is part of the mixed function.
        """
        contact: Any = self._contacts[pair]
        flux: Flux = contact.all_fluxes[number]
        if not flux.is_separate:
            raise ValueError(
                f"{flux.law!r}: the field is solved for with the displacement; expected "
                "Conductance(T, h) with the field's own function T"
            )
        flux.evaluate(np.empty(0))  # it may have changed since
        return flux

    def _assemble(self, blocks: list[Block], rows: int | None, columns: int | None) -> PETSc.Mat:
        """Assemble blocks; ``None`` means the displacement dofs as rows or columns."""
        self._bulk.free_garbage()
        comm, owned = self._bulk.comm, self._bulk.num_owned
        sizes = [
            owned if size is None else share_of(np.arange(size), comm).size
            for size in (rows, columns)
        ]
        return BlockMatrix(comm, *sizes).assemble(blocks)

    def _vector(self, values: Array) -> PETSc.Vec:
        self._bulk.free_garbage()
        flat = values.ravel()
        mine: Indices = share_of(np.arange(flat.size), self._bulk.comm)
        vector = PETSc.Vec().createMPI((mine.size, None), comm=self._bulk.comm)
        vector.array[:] = flat[mine]
        return vector


@dataclass(frozen=True)
class TangentCheck(files.Markdown):
    """Remainders of a Taylor test; all methods are local.

    Attributes:
        steps: Step sizes over the shortest slave facet, shape (s,) [1].
        remainders: Relative remainders [1] of each block, shape (s,) each; blocks "bulk", "n", "g",
            "D", "M" and "whole", the assembled saddle-point matrix with rigid motions.
    """

    steps: Array
    remainders: dict[str, Array]

    def __str__(self) -> str:
        """The table."""
        return self.table()

    @property
    def slopes(self) -> dict[str, float]:
        """Slope of each block [1], from remainders above roundoff; inf if all are roundoff."""
        return {name: self._slope(values) for name, values in self.remainders.items()}

    def _slope(self, values: Array) -> float:
        large = values > ASSEMBLY_ROUNDING  # smaller ones do not define a slope
        if large.sum() < 2:
            return np.inf
        return float(np.polyfit(np.log(self.steps[large]), np.log(values[large]), 1)[0])

    def table(self) -> str:
        """Markdown table: remainder per block and step; the last row has the slopes."""
        names = list(self.remainders)
        rows = [
            [f"{step:.1e}", *(f"{self.remainders[name][i]:.2e}" for name in names)]
            for i, step in enumerate(self.steps)
        ]
        rows.append(["slope", *(f"{slope:.2f}" for slope in self.slopes.values())])
        return files.markdown_table(["step / facet", *names], rows)


def check_tangent(
    problem: Any, *, steps: Array | None = None, seed: int = 0, print_table: bool = True
) -> TangentCheck:
    """Taylor test at the present displacement, multipliers and active set (collective).

    Every derivative is tested, block by block. For a function f with derivative f' the remainder
    |f(x + t v) - f(x) - t f'(x) v| decreases as t^2: the slope in t is 2 if the derivative is
    correct and 1 if a term is missing.

    The state is restored. Zero multipliers are replaced by random ones of the size of the largest,
    or of 1 % of the stiffness, so that the derivatives of D and M contribute.

    Args:
        problem: The equations of a ``ContactProblem``.
        steps: Step sizes over the shortest slave facet, shape (s,) [1].
        seed: Seed of the random direction, drawn by global dof: it depends on the number of ranks.
        print_table: Whether rank 0 prints the table.

    Returns:
        Remainders and slopes.
    """
    steps = 1e-3 * 0.5 ** np.arange(6) if steps is None else np.asarray(steps)
    before = problem.state()
    try:
        check = _check(_Probe(problem, seed), steps)
    finally:
        problem.restore(before)
        problem.bulk.assemble_residual()
    if print_table and problem.comm.rank == 0:
        print(check.table())
    return check


def _check(probe: _Probe, steps: Array) -> TangentCheck:
    derivative = probe.derivative()
    start = probe.values(0.0)
    size = {name: probe.norm(start[name]) + probe.norm(derivative[name]) for name in start}
    remainders: dict[str, list[float]] = {name: [] for name in start}
    for step in steps:
        now = probe.values(step)
        for name, value in now.items():
            remainder = value - start[name] - step * derivative[name]
            remainders[name].append(probe.norm(remainder) / (size[name] or 1.0))
    return TangentCheck(steps, {name: np.array(values) for name, values in remainders.items()})


class _Probe:
    """Functions of a problem along one random direction, and their derivatives."""

    def __init__(self, problem: Any, seed: int) -> None:
        self.problem, self.bulk, self.contacts = (problem, problem.bulk, problem.contacts)
        self.comm = problem.comm
        self._of_pairs = ("n", "g", "D", "M") if self.contacts else ()
        rng = np.random.default_rng(seed)
        sizes = [float(contact.slave.facet_sizes.min()) for contact in self.contacts]
        length = min(sizes) if sizes else self.bulk.cells.mean_size()
        size = self.bulk.num_owned
        everywhere = rng.uniform(-length, length, self.bulk.r.getSize())
        self.du: Array = self.bulk.units * everywhere[self.bulk.first : self.bulk.first + size]
        self.du[radial_dofs_on_axis(self.bulk.space)] = 0.0
        if self.bulk.space.dim == 3:
            # On symmetry planes edges of both sides coincide, where D and M have one-sided slopes.
            self.du[problem.floating.prescribed_otherwise[:size]] = 0.0
        self.u0 = self.bulk.u.x.array[:size].copy()
        self.motions, self.places = problem.motions, problem.motions.places
        self.dq: Array = rng.uniform(-length, length, self.places.shape)
        self.active = [contact.active for contact in self.contacts]
        self.z0 = [self._fill(contact, rng) for contact in self.contacts]
        self.dz = [np.abs(z).max(axis=0) * rng.uniform(-1.0, 1.0, z.shape) for z in self.z0]
        self._move(0.0)
        for flux in (flux for contact in self.contacts for flux in contact.conductances):
            flux.settle()
        self._frames: list[Any] = [contact.rows.frame() for contact in self.contacts]

    def _fill(self, contact: Interface, rng: np.random.Generator) -> Array:
        """Multipliers, random where zero: of the size of others, else of strains of 1 %."""
        per_force = contact.components.scale / contact.components.scale[:, :1]
        size = np.abs(contact.z / per_force).max() or 0.01 * contact.modulus.max()
        random = size * per_force * rng.uniform(0.5, 1.0, contact.z.shape)
        return np.where(contact.z == 0.0, random, contact.z)

    def _move(self, step: float) -> None:
        u = self.bulk.u
        u.x.array[: self.bulk.num_owned] = self.u0 + step * self.du
        u.x.scatter_forward()
        self.motions.places = self.places
        self.motions.move(step * self.dq)
        self.bulk.assemble_residual()
        for contact, active, z, dz in zip(
            self.contacts, self.active, self.z0, self.dz, strict=True
        ):
            contact.change(z=z + step * dz, active=active)
            contact.evaluate(u.x.array, self.problem.linearization)

    def values(self, step: float) -> dict[str, Array]:
        """All functions at the step; owned entries of arrays [their units] (collective)."""
        self._move(step)
        found: dict[str, list[Array]] = {name: [] for name in self._of_pairs}
        force = self.bulk.r.array_r[: self.bulk.num_owned].copy()
        bulk, rows = self.bulk.to_force * (force + self._spread()), []
        for contact, z0, frame in zip(self.contacts, self.z0, self._frames, strict=True):
            o = contact.operators
            on_slave, on_master = o.force(z0[:, : o.slave.dim])
            on_slave = self._by_dof(contact.slave, on_slave)
            on_master = self._by_dof(contact.master, on_master)
            for name, value in (("n", o.n), ("g", o.gap), ("D", on_slave), ("M", on_master)):
                found[name].append(value.ravel())
            row = contact.rows.weighted(frame) * contact.components.to_force
            rows.append(row[contact.slave.owned].ravel())
            contact.change(z=np.where(contact.components.acts, contact.z, 0.0))  # as in the system
            contact.add_loads(force)
            for flux in contact.conductances:
                now = flux.now
                flux.add(now.by_conduction(now.next_q - now.q), force)
        replicated = {name: self._mine(np.concatenate(parts)) for name, parts in found.items()}
        pushed = self._mine(self.motions.forces().ravel())
        force, parts = self.bulk.to_force * force, []
        if self.motions.remote:
            parts = [-self.bulk.stiffness * self.bulk.distance_to_prescribed()]
        return {"bulk": bulk, **replicated, "whole": np.concatenate([force, *rows, *parts, pushed])}

    def derivative(self) -> dict[str, Array]:
        """Derivatives of ``values`` at step 0 [their units], from the matrices (collective)."""
        self._move(0.0)
        self.bulk.assemble_tangent()
        matrices = OperatorMatrices(self.bulk, self.contacts)
        found: dict[str, list[Array]] = {name: [] for name in self._of_pairs}
        for pair, (contact, z0) in enumerate(zip(self.contacts, self.z0, strict=True)):
            matrix, of_u = matrices.normals_derivative(pair), z0[:, : contact.slave.dim]
            by_motions = self._by_motions(contact)
            found["n"].append(self._replicate(self._apply(matrix)) + by_motions[0].ravel())
            change = self._replicate(self._apply(matrices.gap_derivative(pair)))
            found["g"].append(change + by_motions[1])
            change = self._apply(matrices.slave_force_derivative(of_u, pair))
            found["D"].append(contact.slave.gather(change).ravel())
            change = self._apply(matrices.master_force_derivative(of_u, pair))
            found["M"].append(contact.master.gather(change).ravel())
        replicated = {name: self._mine(np.concatenate(parts)) for name, parts in found.items()}
        bulk = self.bulk.to_force * self._apply(self.bulk.K)
        return {"bulk": bulk, **replicated, "whole": self._whole()}

    def _by_motions(self, contact: Interface) -> tuple[Array, Array]:
        """Derivatives of normals and gap along the motions of the pair's obstacle (local)."""
        if not isinstance(contact, Contact) or contact.obstacle is None:
            return np.zeros(1), np.zeros(1)
        dq = self.motions.of_obstacle(contact, self.dq)
        o = contact.operators
        return o.dn_dq @ dq, o.dgap_dq @ dq

    def _whole(self) -> Array:
        """The four blocks of the saddle-point system times (du, dz), with motions of obstacles."""
        for contact in self.contacts:  # normalized as in the system
            contact.change(z=np.where(contact.components.acts, contact.z, 0.0))
        system = SaddleSystem(self.bulk, self.contacts, "fenics_mortar_check_tangent_", {})
        K, B_T, C, A_z = system.blocks()
        zeta = A_z.createVecRight()
        for contact, dz, z_dofs in zip(self.contacts, self.dz, system.z_dofs, strict=True):
            scaled = dz / contact.components.scale
            zeta.array[system.local(contact, z_dofs)] = scaled[contact.slave.owned]
        force, law = self._apply(K), self._apply(C)
        for load in self.motions.boundaries:
            load.take_bulk_rows()
        balance, dofs = linearize_balance(self.motions, system), self.bulk.prescribed_dofs
        coupled = np.zeros(self.dq.size)
        for load in self.motions.spread:
            border = load.linearize(system)
            both = self.comm.allreduce(border.rows @ system.join(self.du, self.dz))
            force = force + both @ border.columns[:, : force.size]
            coupled += by_spread(balance, border, system) @ both
        moved, by_motions = np.split(self.dq.ravel() @ balance.columns, [force.size])
        distance = self.bulk.stiffness * (self.du + moved)[dofs]  # of rigid boundaries
        if self.motions.remote:
            moved[dofs] = 0.0
        force = self.bulk.to_force * (force + (B_T * zeta).array + moved)
        law = law + (A_z * zeta).array + by_motions
        parts = []
        for contact, z_dofs in zip(self.contacts, system.z_dofs, strict=True):
            row = np.zeros(contact.z.shape)
            row[contact.slave.owned] = law[system.local(contact, z_dofs)]
            row = row * contact.components.to_force
            parts.append(row[contact.slave.owned].ravel())
        parts += [distance] if self.motions.remote else []
        pushed = self.comm.allreduce(balance.rows @ system.join(self.du, self.dz))
        pushed = pushed + balance.corner @ self.dq.ravel() + coupled
        return np.concatenate([force, *parts, self._mine(pushed)])

    def _spread(self) -> Array:
        """Forces of spread loads, which K does not contain, (owned dofs,) [stress length]."""
        size = self.bulk.num_owned
        return sum((load.forces(size) for load in self.motions.spread), np.zeros(size))

    def _by_dof(self, surface: Surface, nodal: Array) -> Array:
        """Sums of nodal values (n, 2) at the same dofs, as at the tip of a crack (collective)."""
        total = np.zeros(self.bulk.num_owned)
        surface.scatter_add(nodal, total)
        return surface.gather(total)

    def _apply(self, matrix: PETSc.Mat) -> Array:
        direction, result = matrix.createVecs()
        direction.array[:] = self.du
        matrix.mult(direction, result)
        return result.array

    def _replicate(self, mine: Array) -> Array:
        return np.concatenate(self.comm.allgather(mine))

    def _mine(self, replicated: Array) -> Array:
        """Keep replicated arrays on the first rank only."""
        return replicated if self.comm.rank == 0 else replicated[:0]

    def norm(self, mine: Array) -> float:
        """Euclidean norm over all ranks [unit of the values] (collective)."""
        return float(np.sqrt(self.comm.allreduce(float(mine @ mine))))
