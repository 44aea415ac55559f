# SPDX-License-Identifier: MIT
"""Nodal fields of a contact in space, and the rows of its law with two tangential components."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fenics_mortar.contact import fields
from fenics_mortar.contact.law import STICK, Friction, Frictionless, Row, Stick, VectorRow
from fenics_mortar.contact.law_calls import in_components, summed_slip_of
from fenics_mortar.utils.arrays import ASSEMBLY_ROUNDING, Array, Flags

if TYPE_CHECKING:
    from fenics_mortar.interface.mortar import Block


# Largest ratio of shear and |w| in the tangent [1], which is singular at 1: the node is about to
# stick. Derivatives of a solution have the ratio itself. With 1 - 1e-4 systems of bodies that
# friction alone holds are singular.
MAX_RATIO = 0.999
# Slip of rounding over the extent of the surface [1], with a shear that corresponds to it: w has no
# direction.
AT_REST = ASSEMBLY_ROUNDING


class Directions(NamedTuple):
    """Tangents e and t of the slave nodes, shapes (slave nodes, 3) [1].

    Attributes:
        along: Direction e.
        across: Direction t = n x e.
        size: |w| where e is the direction of w; zero where it is fixed, shape (slave nodes,)
            [stress].
    """

    along: Array
    across: Array
    size: Array


class SpaceFields(fields.ContactFields):
    """Fields of a contact in space, and the rows of its law with two tangential components.

    A law relates a shear and a slip along one direction. In space this is the direction e of

        w = z_t + c_t (k / l) s,    z_t = P z,   s = P s^,   P = I - n n^T,

    with the vector of slip s^ since the accepted state: z_tau = e . z and u = e . s^ are the
    arguments of the law, whose row rho = 0 determines the shear T = z_tau - rho along e. The other
    tangent, t = n x e, has the row t . z = 0: shear and slip have the same direction (radial
    return; Gitterle, Popp, Gee & Wall 2010). Both are components of the vector

        R = rho e + (t . z) t.

    With b = |w| and de = t (t . dw) / b its derivatives are

        e . dR = rho_u e . ds + rho_tau e . dz_t + c t . dw / b,
        t . dR = t . dz_t - (T / b) t . dw,
        c = rho_u (t . s) + (rho_tau - 1) (t . z).

    The matrix in dz is positive definite for T < b; T / b is limited to ``MAX_RATIO`` in the
    tangent. Where a law is linear and isotropic, with stick or without friction,
    R = rho_u s + rho_tau z_t. On symmetry planes e is in the plane and the law is that of the
    plane. At w = 0, where e may be any tangent, the law resists equally in all directions. The
    fields ``slip`` and ``z_tau`` are the components along e.
    """

    counted_slip: Any = property(attrgetter("slip_vector"))
    surface_slip: Any = property(attrgetter("tangential_slip"))

    @fields.field("partners")
    def slip_vector(self) -> Array:
        """Vector s^ of slip since the accepted state, shape (slave nodes, 3) [length].

        Zero before there is an accepted state.
        """
        partners = self.state.partners
        return np.zeros_like(self.z_u) if partners is None else partners.slip(self.operators)

    @property
    def acting(self) -> Any:
        """Operators with derivatives of the facets whose multipliers act or are not zero."""
        return self.operators.near(self.acts | self.state.z.any(axis=1))

    @property
    def _has_slip(self) -> bool:
        return type(self.interface.pair.law) is not Frictionless

    @fields.field(*fields.LAW_ATTRIBUTES)
    def tangential_slip(self) -> Array:
        """Tangential part s of the slip, shape (slave nodes, 3) [length]; zero without friction."""
        n, zero = self.operators.n, np.zeros_like(self.operators.n)
        return fields.tangential(self.slip_vector, n) if self._has_slip else zero

    @fields.field(*fields.LAW_ATTRIBUTES)
    def carried(self) -> Array:
        """Summed slip until the start of the step, turned with the slave, (n, 3) [length]."""
        law, partners = self.interface.pair.law, self.state.partners
        if not law.summed_slip or partners is None:
            return np.zeros_like(self.z_u)
        before = summed_slip_of(law, self.state.start_instant.memory)
        return np.einsum("jab,jb->ja", partners.rotation_of_slave(self.operators), before)

    @fields.field(*fields.LAW_ATTRIBUTES)
    def total_slip(self) -> Array:
        """Tangential part of the slip on which the law depends, (slave nodes, 3) [length]."""
        if not self.interface.pair.law.summed_slip:
            return self.tangential_slip
        return self.tangential_slip + fields.tangential(self.carried, self.operators.n)

    @property
    def memory_of_law(self) -> Mapping[str, Array]:
        """Memory at the start of the step as the law has it, in space along e [its units]."""
        law, memory = self.interface.pair.law, self.state.start_instant.memory
        if not law.summed_slip:
            return memory
        along = fields.normal_parts(self.directions.along, self.carried)
        return {name: memory.get(name, along) for name in law.memory}

    def remembered(self, memory: Mapping[str, Array]) -> Mapping[str, Array]:
        """Memory of the law at the end of the step, as it is stored [its units]."""
        law = self.interface.pair.law
        return in_components(law, memory, self.total_slip) if law.summed_slip else memory

    def slip_derivative(self, along: Array, *, summed: bool = True) -> Iterator[Block]:
        """Blocks of ``along`` times the derivative of the slip of the law, of this rank.

        ``summed``: with the summed slip of former steps, which turns with the slave.
        """
        o, partners = self.operators, self.state.partners
        yield from partners.derivative(o, along)
        if summed and self.interface.pair.law.summed_slip:
            yield from partners.carried_derivative(o, self.carried, along)

    @property
    def rubbing(self) -> VectorRow:
        """Power z_t . s of the shear along the slip of the step, with its derivatives."""
        n, z, s = self.operators.n, self.z_u, self.slip_vector
        z_n, s_n = fields.normal_parts(n, z)[:, None], fields.normal_parts(n, s)[:, None]
        z_t, s_t = z - z_n * n, s - s_n * n
        power, none = np.einsum("ja,ja->j", z_t, s_t), np.zeros(len(z))
        return VectorRow(power, s_t, z_t, none, -s_n * z - z_n * s)

    @fields.field(*fields.LAW_ATTRIBUTES)
    def directions(self) -> Directions:
        """Direction of w; fixed tangents without friction, and where w is zero."""
        n, guided = self.operators.n, self.interface.is_guided
        along, none = self.fixed_tangents, np.zeros(len(n))
        if not self._has_slip:
            return Directions(along, np.cross(n, along), none)
        w = fields.tangential(self.z_u, n) + self.slip_weight[:, None] * self.total_slip
        size = np.linalg.norm(w, axis=1)
        free = (size > AT_REST * self.slip_weight * self.interface.slave.extent) & ~guided
        size = np.where(free, size, 1.0)
        along = np.where(free[:, None], w / size[:, None], along)
        return Directions(along, np.cross(n, along), np.where(free, size, 0.0))

    @cached_property
    def fixed_tangents(self) -> Array:
        """Tangents by the axis least aligned with n, or in the symmetry plane, (nodes, 3) [1]."""
        n, guided = self.operators.n, self.interface.is_guided
        tangents = fields.tangential(np.eye(3)[np.abs(n).argmin(axis=1)], n)
        tangents[guided] = np.cross(n[guided], self.interface.guides[guided])
        return tangents / np.linalg.norm(tangents, axis=1)[:, None]

    @property
    def slip_weight(self) -> Array:
        """Weight c_t k / l of the slip in w, shape (slave nodes,) [stress / length]."""
        return getattr(self.interface.pair.law, "c_t", Friction.c_t) * self.interface.foundation

    @fields.field(*fields.LAW_ATTRIBUTES)
    def parts(self) -> fields.Parts:
        """Normal part of the multipliers, and their part along e."""
        z_n = fields.normal_parts(self.operators.n, self.z_u)
        return fields.Parts(z_n, fields.normal_parts(self.directions.along, self.z_u))

    @property
    def steepness(self) -> float:
        """See ``ContactFields``; includes the mean square of d(nodal force)/d(slip); collective.

        Each is multiplied by the rounding of the slip over that of a position: functions on a small
        part of a facet with nine nodes may be 1e4 times their mean.
        """
        steepest = super().steepness
        if not self._has_slip:
            return steepest
        forces = (
            self.operators.rounding_of_vectors() * self.interface.foundation * self.state.active
        )
        return max(steepest, float(np.sqrt((forces**2).mean())))

    @fields.field(*fields.LAW_ATTRIBUTES)
    def slip(self) -> Array:
        """Component along e of the slip since the last accepted step, (slave nodes,) [length]."""
        return np.einsum("ja,ja->j", self.directions.along, self.tangential_slip)

    @property
    def shear_of_stick(self) -> Array:
        """Component along e of the shear of redundant sticks since the accepted state [stress]."""
        return fields.normal_parts(self.directions.along, self.z_u - self.state.partners.shear)

    @property
    def tangents(self) -> tuple[Array, Array]:
        """Tangents that laws do not turn, one or two in space, (slave nodes, dim) each [1]."""
        return self.fixed_tangents, np.cross(self.operators.n, self.fixed_tangents)

    def along_tangents(self, vectors: Array) -> Array:
        """Components of vectors (..., slave nodes, dim) along ``tangents`` [their unit]."""
        return np.stack(
            [fields.normal_parts(tangent, vectors) for tangent in self.tangents], axis=-1
        )

    @fields.field(*fields.RULED)
    def vector_rows(self) -> tuple[VectorRow, ...]:
        """``law_rows`` with derivatives by vectors; in space along two tangents, then along n."""
        friction, *others = self.law_rows
        return *self._tangential_rows(friction), *(self.by_vectors(row) for row in others)

    @fields.field(*fields.RULED)
    def row_tangents(self) -> tuple[Array, Array]:
        """Directions e and t of the tangential rows, (slave nodes, 3) each [1]: see the class."""
        fixed = (self.is_isotropic & ~self.interface.is_guided)[:, None]
        along = np.where(fixed, self.fixed_tangents, self.directions.along)
        return along, np.cross(self.operators.n, along)

    def _tangential_rows(self, row: Row) -> tuple[VectorRow, VectorRow]:
        """Rows along e and t, given that of the law; see the class."""
        (e, t), none = self.row_tangents, np.zeros(len(self.z_n))
        rho, by_gap, by_u, by_n, by_tau, _ = np.broadcast_arrays(*row, none)
        size, weight = self.directions.size, self.slip_weight
        as_law = self.is_isotropic & ~self.interface.is_guided
        per_size = np.where((size > 0.0) & ~as_law, 1.0 / np.where(size > 0.0, size, 1.0), 0.0)
        redundant, z = self.state.redundant, self.z_u
        if redundant.any():
            z = np.where(redundant[:, None], z - self.state.partners.shear, z)
        (e_z, t_z), (e_s, t_s) = (
            [np.einsum("ja,ja->j", a, v) for a in (e, t)] for v in (z, self.total_slip)
        )
        turn = (by_u * t_s + (by_tau - 1.0) * t_z) * per_size
        along = self._row(
            np.where(as_law, by_tau * e_z + by_u * e_s, rho), by_gap, by_n,
            ((by_tau, e), (turn, t)), ((by_u, e), (turn * weight, t)),
        )  # fmt: skip
        ratio = (e_z - rho) * per_size
        if not self.operators.linearization.exact:
            ratio = np.clip(ratio, 0.0, MAX_RATIO)
        isotropic = (as_law | (size == 0.0)) & ~self.interface.is_guided
        of_z = np.where(isotropic, by_tau, 1.0 - ratio)
        of_s = np.where(isotropic, by_u, -ratio * weight)
        residual = np.where(isotropic, by_tau * t_z + by_u * t_s, t_z)
        return along, self._row(residual, none, none, ((of_z, t),), ((of_s, t),))

    @property
    def slip_by_gap(self) -> Array:
        """Derivative of the slip with respect to the mean gap [1]: zero."""
        return np.zeros(len(self.z_u))

    @property
    def is_isotropic(self) -> Flags:
        """Nodes whose law is linear in shear and slip: both rows are the law's, (slave nodes,)."""
        law, interface = self.interface.pair.law, self.interface
        sticks = isinstance(law, (Friction, Stick)) & (self.state.branch == STICK)
        elastic = self.state.redundant  # see ``linearized_contact``
        return sticks | elastic | ~interface.follows_law | (type(law) is Frictionless)

    def by_vectors(self, row: Row) -> VectorRow:
        """A row that is one number, as that of open nodes, a closing gap or a power of friction.

        Slip and shear along e are those of the law: d(e . a) = e . da + (t . a) t . dw / b.
        """
        residual, by_gap, by_u, by_n, by_tau, _ = np.broadcast_arrays(*row, self.z_n)
        e, t, size = self.directions
        slip, shear = (fields.normal_parts(t, each) for each in (self.total_slip, self.z_u))
        of_turn = by_u * slip + by_tau * shear
        turn = np.where(size > 0.0, of_turn / np.where(size > 0.0, size, 1.0), 0.0)
        return self._row(
            residual, by_gap, by_n, ((by_tau, e), (turn, t)),
            ((by_u, e), (turn * self.slip_weight, t)),
        )  # fmt: skip

    def _row(
        self, residual: Array, by_gap: Array, by_z_n: Array,
        by_shear: tuple[tuple[Array, Array], ...], by_slip: tuple[tuple[Array, Array], ...],
    ) -> VectorRow:  # fmt: skip
        """A row by its derivatives: of a . z_t and a . s for tangents a, and by z_n.

        d(a . z_t) = a . dz - z_n a . dn, d(a . s) = a . ds^ - (n . s^) a . dn.
        """
        n, z = self.operators.n, self.z_u
        by_z, by_normal = by_z_n[:, None] * n, by_z_n[:, None] * z
        of_slip = np.zeros_like(n)
        for factor, a in by_shear:
            by_z = by_z + factor[:, None] * a
            by_normal = by_normal - (factor * self.z_n)[:, None] * a
        for factor, a in by_slip:
            if not factor.any():
                continue
            of_slip = of_slip + factor[:, None] * a
            normal_slip = np.einsum("ja,ja->j", n, self.slip_vector + self.carried)
            by_normal = by_normal - (factor * normal_slip)[:, None] * a
        return VectorRow(residual, by_z, of_slip, by_gap, by_normal)
