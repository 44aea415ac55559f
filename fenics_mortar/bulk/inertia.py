# SPDX-License-Identifier: MIT
"""Inertia of the bodies: mass matrix, velocity, accelerations, and forces in a time step.

The acceleration at the end of a time step is linear in the displacement at this time, w = c
(u - o). M w is added to the residual of the bulk and c M to its tangent; c and o are those of the
time scheme.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from petsc4py import PETSc

import numpy as np

import ufl
from dolfinx import fem

from fenics_mortar.bulk.massless import redistributed
from fenics_mortar.mesh.numbering import by_input_node, set_by_input_node
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.obstacles.rotations import moments_of
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Flags, Indices, Value
from fenics_mortar.utils.errors import MortarError
from fenics_mortar.utils.rounding import ASSEMBLY_ROUNDING, TINY


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
            ``path.energy`` [stress length^2].
    """

    velocity: Array
    acceleration: Array
    average: Array
    time: float = 0.0
    begun: bool = False
    energy_deficit: float = 0.0


class Inertia:
    """Mass matrix and rates of the bodies; all methods are collective.

    Args:
        space: The displacement's nodes and dofs.
        density: Mass per area of the mesh, a number or UFL expression [stress time^2 / length^2].
        massless: Global numbers of nodes without mass, equal on all ranks; see ``massless``.

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
        if space.is_mixed:
            a, b = (ufl.split(function)[space.part] for function in parts)
        else:
            a, b = parts
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
        rates, data = self.rates, dict[str, Any]()
        for attribute in fields(rates):
            value = getattr(rates, attribute.name)
            if isinstance(value, np.ndarray):
                _, value = by_input_node(self._space, self._function(value))
            data[attribute.name] = np.asarray(value)
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

    def add_to_residual(self, r: PETSc.Vec, u: Array) -> None:
        """Add the inertia forces at the displacement ``u``, shape (local dofs,) [length]."""
        r.array[: self._space.num_owned] += self.forces(u)

    def add_to_tangent(self, K: PETSc.Mat, *, includes_mass: bool) -> None:
        """Add c M; ``includes_mass``: whether the pattern of M is part of that of ``K``."""
        structures = PETSc.Mat.Structure
        structure = (
            structures.SUBSET_NONZERO_PATTERN
            if includes_mass
            else structures.DIFFERENT_NONZERO_PATTERN
        )
        K.axpy(self.factor, self.M, structure)

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
        solver.setTolerances(rtol=ASSEMBLY_ROUNDING, atol=TINY, max_it=10 * M.getSize()[0])
        return solver
