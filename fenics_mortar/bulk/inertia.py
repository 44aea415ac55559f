# SPDX-License-Identifier: MIT
"""Inertia of the bodies: mass matrix, velocity, accelerations, and forces in a time step.

The acceleration at the end of a time step is linear in the displacement at this time,
w = c (u - o). M w is added to the residual of the bulk and c M to its tangent; c and o are those of
the time scheme.

``Inertia`` has the mass matrix and the rates, ``Velocity`` is the velocity in the forms of users.
``redistributed`` takes the mass from some nodes, those of contact, without a change of rigid-body
inertia.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from itertools import combinations_with_replacement
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from scipy.sparse import coo_array, csr_array

import ufl
from dolfinx import fem

from fenics_mortar.bulk.bodies import centre_and_size, label_bodies
from fenics_mortar.mesh.space import DisplacementSpace, by_input_node, set_by_input_node
from fenics_mortar.obstacles.rigid_motion import moments_of
from fenics_mortar.utils import arrays, compat
from fenics_mortar.utils.arrays import Array, Flags, Indices, Value
from fenics_mortar.utils.errors import MortarError, format_point
from fenics_mortar.utils.ranks import from_all_ranks

# Pairs of the fields 1, x, y (and z) whose products are the moments of a body, by dimension.
MOMENTS = {dim: list(combinations_with_replacement(range(1 + dim), 2)) for dim in (2, 3)}
# Function from offsets of points to their weights; None if there are too few points.
Weigh = Callable[[Array], Array | None]


def redistributed(space: DisplacementSpace, M: PETSc.Mat, nodes: Indices) -> tuple[Any, Any]:
    """The matrices M_r and P (collective).

    Matrix M_r without mass at the nodes S, and with unchanged rigid-body inertia.

    The kinetic energy of the nodes S is taken from the velocity of their nearest neighbours inside
    the body: v_S = W v_I with weights W of sum one. With P = (I, W) the matrix P^T M P has zero
    rows and columns at S and the same total mass; masses are shifted by about a cell. A quadratic
    polynomial s of the position, one for each body, restores centre of mass and moments of inertia:

        M_r = S P^T M P S,    S = diag(s(X_i)),    s = 1 + O(h^2).

    (Khenous, Laborde & Renard 2008 obtain such a matrix by optimization.) If a body has so few
    cells across that s is not positive, W are the smallest weights that extrapolate affine fields.
    They preserve all moments without s, but the pressure behind a wave then oscillates with the
    frequency of a cell.

    Args:
        space: The displacement's nodes and dofs.
        M: The mass matrix.
        nodes: Global numbers of the nodes S, equal on all ranks, shape (k,).

    Raises:
        MortarError: On all ranks, if a body is a single layer of cells.
    """
    P = _projection(space, M, nodes, _nearest)
    moved = M.ptap(P)
    values = _scales(space, M, moved)
    if values is None:
        P = _projection(space, M, nodes, _extrapolating)
        return M.ptap(P), P
    scales = moved.createVecLeft()
    scales.array[:] = values
    moved.diagonalScale(scales, scales)
    return moved, P


def _scales(space: DisplacementSpace, M: PETSc.Mat, moved: PETSc.Mat) -> Array | None:
    """Factors of owned dofs that restore the moments of M; ``None`` if there are none."""
    comm, dofs, dim = space.V.mesh.comm, space.owned_dofs, space.dim
    labels, count = label_bodies(space.V)
    labels, X = labels[: len(dofs)], space.V.tabulate_dof_coordinates()[: len(dofs), :dim]
    num_nodes, scales = space.V.dofmap.index_map.size_global, np.ones(space.num_owned)
    for label in range(count):
        mine = labels == label
        centre, size = centre_and_size(X[mine], comm)
        fields = np.zeros((1 + dim, space.num_owned))  # 1, x, y (and z) as first components
        fields[0, dofs[mine, 0]] = 1.0
        fields[1:, dofs[mine, 0]] = ((X[mine] - centre) / size).T
        powers = np.array([fields[a] * fields[b] for a, b in MOMENTS[dim]])
        target = _moments(M, fields, fields, comm)
        factors = np.zeros(len(MOMENTS[dim]))
        for _ in range(arrays.MAX_STEPS):
            scaled = (1.0 + factors @ powers) * fields
            missing = target - _moments(moved, scaled, scaled, comm)
            # the number of all nodes: no rank may leave this loop alone
            if np.abs(missing).max() <= arrays.EPSILON * num_nodes * np.abs(target).max():
                break
            by_factors = [2.0 * _moments(moved, scaled, p * fields, comm) for p in powers]
            factors = factors + np.linalg.lstsq(np.transpose(by_factors), missing, rcond=None)[0]
        mass = 1.0 + factors @ powers[:, dofs[mine, 0]]
        smallest = comm.allreduce(float(mass.min(initial=np.inf)), min)
        if np.abs(missing).max() > arrays.ROUNDING * np.abs(target).max() or smallest <= 0.0:
            return None
        scales[dofs[mine]] = mass[:, None]
    return scales


def _moments(M: PETSc.Mat, one: Array, other: Array, comm: MPI.Comm) -> Array:
    """Symmetric parts of one_a . M other_b for all ``MOMENTS``, equal on all ranks."""
    found = comm.allreduce(one @ compat.products(M, other).T)
    return np.array([0.5 * (found[a, b] + found[b, a]) for a, b in MOMENTS[len(one) - 1]])


def _projection(
    space: DisplacementSpace, layout: PETSc.Mat, nodes: Indices, weigh: Weigh
) -> PETSc.Mat:
    """The matrix P, shape (N, N); its columns at dofs of S are zero (collective)."""
    first, last = space.V.dofmap.index_map.local_range
    (dofs,) = from_all_ranks(space.V.mesh.comm, [space.owned_dofs + space.first])  # of all nodes
    stencils = _stencils(space.V, np.unique(nodes), weigh)
    mine = np.array([node for node in stencils if first <= node < last], np.int64)
    start, end = layout.getOwnershipRange()
    rest = np.setdiff1d(np.arange(start, end), dofs[mine])
    entries = [(rest, rest, np.ones(rest.size))]
    for node in mine.tolist():
        around, weights = stencils[node]
        for row, columns in zip(dofs[node], dofs[around].T, strict=True):
            entries.append((np.full(weights.size, row), columns, weights))
    i, j, values = map(np.concatenate, zip(*entries, strict=True))
    table = coo_array((values, (i - start, j)), shape=(end - start, layout.getSize()[1])).tocsr()
    table.sort_indices()
    csr = (table.indptr.astype(PETSc.IntType), table.indices.astype(PETSc.IntType), table.data)
    P = PETSc.Mat().createAIJ(layout.getSizes(), csr=csr, comm=layout.comm)
    P.setBlockSizes(*layout.getBlockSizes())
    return P


def _stencils(V: Any, nodes: Indices, weigh: Weigh) -> dict[int, tuple[Indices, Array]]:
    """Neighbours inside the body and their weights for each node, equal on all ranks.

    They are within two rings of nodes around it, or three where these are not enough, as at a
    corner of a single tetrahedron.
    """
    found, few = dict[int, tuple[Indices, Array]](), nodes
    for rings in (2, 3):
        found |= _within(V, few, nodes, weigh, rings) if few.size else {}
        few = np.setdiff1d(few, list(found))
    if few.size:
        numbers, positions = _cells_at(V, few[:1])
        where = format_point(positions[numbers == few[0]][0])
        raise MortarError(
            f"the body at {where} has fewer than two layers of nodes behind the slave surface, "
            "which could carry its mass: refine the body, take the other side as the slave, or use "
            "scheme='generalized_alpha'"
        )
    return found


def _within(
    V: Any, nodes: Indices, without: Indices, weigh: Weigh, rings: int
) -> dict[int, tuple[Indices, Array]]:
    """Stencils of those of ``nodes`` that have enough neighbours within some rings."""
    near, found = nodes, dict[int, tuple[Indices, Array]]()
    for _ in range(rings):
        near, at = _cells_at(V, np.unique(near))
    numbers, cells = np.unique(near, return_inverse=True)
    X, cells = np.empty((numbers.size, at.shape[2])), cells.reshape(near.shape)
    X[cells] = at
    ends = np.arange(len(near) + 1) * near.shape[1]
    nodes_of = csr_array((np.ones(near.size), cells.ravel(), ends), (len(near), numbers.size))
    ring = within = csr_array(nodes_of.T @ nodes_of)
    for _ in range(rings - 1):
        within = within @ ring
    inside = ~np.isin(numbers, without)
    for row in np.searchsorted(numbers, nodes):
        for reached in (within,) if weigh is _extrapolating else (ring, within):
            around = reached.indices[reached.indptr[row] : reached.indptr[row + 1]]
            around = around[inside[around]]
            if around.size:
                break
        around = around[np.lexsort(X[around].T[::-1])]
        weights = weigh(X[around] - X[row])
        if weights is not None:
            found[int(numbers[row])] = numbers[around], weights
    return found


def _nearest(offsets: Array) -> Array | None:
    """Weights of points at ``offsets`` (n, dim) for a value at the origin: 1 for the nearest."""
    square = (offsets**2).sum(axis=1)
    weights = (square.min(initial=np.inf) / square) ** 2
    return weights / weights.sum() if weights.size else None


def _extrapolating(offsets: Array) -> Array | None:
    """Smallest weights of points at ``offsets`` (n, dim) that extrapolate affine fields to zero.

    Squared weights are multiplied by r^2 in the norm, so that near points have larger weights.
    """
    square = (offsets**2).sum(axis=1)
    size = np.sqrt(square.max(initial=0.0)) or 1.0
    fields = np.vstack([np.ones(len(offsets)), offsets.T / size])
    gram = (fields / square) @ fields.T
    negligible = arrays.SAME_PLACE * np.abs(gram).max(initial=1.0)
    if np.linalg.matrix_rank(gram, tol=negligible) < len(gram):
        return None
    return (np.linalg.solve(gram, np.eye(len(gram))[0]) @ fields) / square


def _cells_at(V: Any, nodes: Indices) -> tuple[Indices, Array]:
    """Nodes (n, k) of all cells at ``nodes``, and their positions (n, k, dim) [length]."""
    comm, mesh = V.mesh.comm, V.mesh
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    local = compat.dofmap(V)[:owned]
    index_map = V.dofmap.index_map
    count = index_map.size_local + index_map.num_ghosts
    numbers = index_map.local_to_global(np.arange(count, dtype=np.int32))
    touched = np.isin(numbers, nodes)[local].any(axis=1)
    cells = comm.allgather(numbers[local[touched]])
    positions = comm.allgather(V.tabulate_dof_coordinates()[local[touched], : mesh.geometry.dim])
    return np.concatenate(cells).astype(np.int64), np.concatenate(positions)


class Origin(fem.Function):
    """Displacement at which a ``Velocity`` is zero; its type identifies it in a residual."""


class Velocity:
    """Velocity at the end of a time step, linear in the displacement u there; methods are local.

    Its ``expression`` may be used in a residual like u, for instance Rayleigh's damping
    ``alpha * rho * inner(v, w) * dx + beta * inner(stress(v), grad(w)) * dx``. Its derivative is
    part of the tangent. The velocity is zero until ``Dynamics(..., velocity=...)`` sets it.

    Args:
        u: Displacement, alone or in a mixed function.

    Attributes:
        expression: factor (u - origin), a UFL expression [length / time].
        u: The displacement, or the mixed function.
        factor: Constant of dolfinx [1 / time].
        origin: Function of the space of ``u``, its values have the shape (local dofs,) [length].
    """

    def __init__(self, u: Any) -> None:
        self.u = u
        self.factor = fem.Constant(u.function_space.mesh, 0.0)
        self.origin = Origin(u.function_space, name="velocity_origin")
        self.expression = self.factor * (u - self.origin)

    def set(self, factor: float, origin: Array) -> None:
        """Set ``factor`` [1 / time] and ``origin``, shape (local dofs,) [length] (local)."""
        self.factor.value = factor
        self.origin.x.array[:] = origin


@dataclass(frozen=True, eq=False)
class Rates(Value):
    """Velocity and accelerations of a state, a value (local).

    Attributes:
        velocity: Velocity, shape (local dofs,) [length / time].
        acceleration: Acceleration that balances all forces, shape (local dofs,) [length / time^2].
        average: Auxiliary acceleration of the scheme, an average over a step, shape (local dofs,)
            [length / time^2].
        time: Time [time].
        begun: Whether the accelerations are known.
        energy_deficit: Energy lost by errors of the time steps and not returned yet, see
            ``path.time_steps`` [stress length^2].
        largest_kinetic: Largest kinetic energy so far [stress length^2].
    """

    velocity: Array
    acceleration: Array
    average: Array
    time: float = 0.0
    begun: bool = False
    energy_deficit: float = 0.0
    largest_kinetic: float = 0.0


class Inertia:
    """Mass matrix and rates of the bodies; all methods are collective.

    Args:
        space: The displacement's nodes and dofs.
        density: Mass per area of the mesh, a number or UFL expression [stress time^2 / length^2].
        massless: Global numbers of nodes without mass, equal on all ranks.

    Attributes:
        M: Mass matrix, shape (N, N) [stress time^2].
        velocity: Velocity, a function of the whole space; may be set.
        factor: c [1 / time^2].
        origin: o, array of all local dofs [length].
        moving: Whether a time step is being solved; otherwise c and o follow from the rates.
        rate: Velocity in the forms of the bodies, or ``None``.
        scheme: Description of the time scheme to which the rates belong.

    Raises:
        MortarError: On all ranks, if a mass is not positive, or the body is too thin.
    """

    def __init__(self, space: DisplacementSpace, density: Any, massless: Indices) -> None:
        self._space = space
        self.M = self._assemble(density)
        self._P: PETSc.Mat | None = None
        self.massless = massless
        if massless.size:
            self.M, self._P = redistributed(space, self.M, massless)
        diagonal = self.M.getDiagonal()
        self.largest_mass: float = diagonal.max()[1]
        self._no_mass: Flags = diagonal.array_r == 0.0
        self._input, self._output = self.M.createVecs()
        self._solver: PETSc.KSP | None = None
        self.velocity = fem.Function(space.whole, name="velocity")
        self.factor, self.moving = 0.0, False
        self.rate: Velocity | None = None
        self.scheme = ""
        zero = np.zeros_like(self.velocity.x.array)
        self.origin: Array = zero
        self._rates = Rates(zero, zero, zero)

    def _assemble(self, density: Any) -> PETSc.Mat:
        """The consistent mass matrix."""
        space = self._space
        parts = ufl.TrialFunction(space.whole), ufl.TestFunction(space.whole)
        a, b = (ufl.split(f)[space.part] if space.is_mixed else f for f in parts)
        form = compat.form(density * ufl.inner(a, b) * ufl.dx)
        M = compat.create_matrix(form)
        compat.assemble_matrix(M, form)
        masses = M.getDiagonal().array_r[space.owned_dofs]
        smallest = space.V.mesh.comm.allreduce(float(masses.min(initial=np.inf)), min)
        if not 0.0 < smallest < np.inf:
            raise MortarError(
                f"the smallest mass of a node is {smallest:.3g}: expected a positive finite density"
            )
        return M

    @property
    def rates(self) -> Rates:
        """The present rates (local)."""
        return replace(self._rates, velocity=self.velocity.x.array)

    @rates.setter
    def rates(self, rates: Rates) -> None:
        self._rates = rates
        self.velocity.x.array[:] = rates.velocity

    def set_rates(self, rates: Rates, u: Array) -> None:
        """Set the rates, and c and o: w at ``u`` (local dofs,) is their acceleration (local).

        The velocity in forms is that of the rates at ``u``.
        """
        self.rates = rates
        self.factor, self.origin = 1.0, u - rates.acceleration
        if self.rate is not None:
            self.rate.set(1.0, u - rates.velocity)

    # Checkpoints

    def saved_data(self) -> dict[str, Any]:
        """All rates at the nodes of the mesh input, equal on all ranks."""
        data = dict[str, Any]()
        for name, value in vars(self.rates).items():
            if isinstance(value, np.ndarray):
                _, value = by_input_node(self._space, self._function(value))
            data[name] = np.asarray(value)
        return data

    def restore_data(self, data: Mapping[str, Any], u: Array) -> None:
        """Restore the rates of ``saved_data`` for the displacement ``u`` (local dofs,)."""
        given = dict[str, Any]()
        for attribute in fields(Rates):
            value = data[attribute.name]
            if value.ndim:
                function = self._function(u)
                set_by_input_node(self._space, function, data["nodes"], value)
                given[attribute.name] = function.x.array.copy()
            else:
                given[attribute.name] = value[()]
        self.set_rates(Rates(**given), u)

    def _function(self, values: Array) -> fem.Function:
        """A function of the whole space."""
        function = fem.Function(self._space.whole)
        function.x.array[:] = values
        return function

    # Contributions to the equations

    def add_to_tangent(self, K: PETSc.Mat, *, includes_mass: bool) -> None:
        """Add c M; ``includes_mass``: whether the pattern of M is part of that of ``K``."""
        pattern = PETSc.Mat.Structure
        K.axpy(self.factor, self.M, pattern.SUBSET if includes_mass else pattern.DIFFERENT)

    def forces(self, u: Array) -> Array:
        """Inertia forces M c (u - o) at the owned dofs [stress length]."""
        return self.times_mass(self.factor * (u - self.origin))

    @property
    def stiffness(self) -> float:
        """Largest diagonal entry of c M [stress] (local)."""
        return self.factor * self.largest_mass

    # Products

    def times_mass(self, values: Array) -> Array:
        """M times an array of all local dofs, (owned dofs,) [mass times its unit]."""
        self._input.array[:] = values[: self._space.num_owned]
        self.M.mult(self._input, self._output)
        return self._output.array_r.copy()

    def product(self, a: Array, b: Array) -> float:
        """A . M b of two arrays of shape (local dofs,) [mass times both units] (collective)."""
        mine = float(a[: self._space.num_owned] @ self.times_mass(b))
        return self._space.V.mesh.comm.allreduce(mine)

    def momentum(self, x: Array, velocity: Array) -> Array:
        """Linear momentum and angular momentum about the origin at positions x.

        Shape (3,), in space (6,).

        Args:
            x: Positions, an array of all local dofs [length].
            velocity: Velocity, likewise.
        """
        dofs = self._space.owned_dofs
        p, x = self.times_mass(velocity)[dofs], x[dofs]
        mine = np.concatenate([p.sum(axis=0), moments_of(x, p).sum(axis=1)])
        return self._space.V.mesh.comm.allreduce(mine)

    def acceleration_of(self, force: Array, prescribed: Flags) -> Array:
        """Acceleration due to forces on the bodies, zero at prescribed dofs.

        Forces on nodes without mass are transferred to the nodes that carry their mass.

        Args:
            force: Forces at the owned dofs, shape (num_owned,) [stress length].
            prescribed: Marks of the local dofs with prescribed values.

        Returns:
            The acceleration, an array of all local dofs [length / time^2].
        """
        if self._solver is None:
            self._solver = self._create_solver(prescribed)
        right, solution = self._input, self._output
        right.array[:] = self.carried(force)
        right.array[self._fixed(prescribed)] = 0.0
        self._solver.solve(right, solution)
        return self.with_ghosts(solution.array_r)

    def carried(self, force: Array) -> Array:
        """Forces at the owned dofs as forces on nodes with mass, (owned dofs,) [stress length]."""
        if self._P is None:
            return force
        self._input.array[:] = force
        self._P.multTranspose(self._input, self._output)
        return self._output.array_r.copy()

    def with_ghosts(self, values: Array) -> Array:
        """``values`` (owned dofs,) as an array of all local dofs [their unit]."""
        result = fem.Function(self._space.whole)
        result.x.array[: self._space.num_owned] = values
        result.x.scatter_forward()
        return result.x.array.copy()

    def _fixed(self, prescribed: Flags) -> Flags:
        """Marks of the owned dofs that are prescribed or have no mass."""
        return prescribed[: self._space.num_owned] | self._no_mass

    def _create_solver(self, prescribed: Flags) -> PETSc.KSP:
        """Solver for accelerations; accelerations and forces are zero where ``_fixed``.

        Rows and columns of these dofs are zero: conjugate gradients stay in the space of the other
        dofs.
        """
        M, moves = self.M.copy(), self.M.createVecLeft()
        moves.array[:] = ~self._fixed(prescribed)
        M.diagonalScale(moves, moves)
        solver = PETSc.KSP().create(M.comm)
        solver.setType(PETSc.KSP.Type.CG)
        solver.getPC().setType(PETSc.PC.Type.JACOBI)
        solver.setOperators(M)
        solver.setTolerances(
            rtol=arrays.ASSEMBLY_ROUNDING, atol=arrays.TINY, max_it=10 * M.getSize()[0]
        )
        return solver
