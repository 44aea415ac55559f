# SPDX-License-Identifier: MIT
"""Nodal fields of a contact in space, and the rows of its law with two tangential components.

A law relates a shear and a slip along one direction. In space this is the direction e of

    w = z_t + c_t (k / l) s,    z_t = P z,   s = P s^,   P = I - n n^T,

with the vector of slip s^ since the accepted state: z_tau = e . z and u = e . s^ are the arguments
of the law, whose row rho = 0 determines the shear T = z_tau - rho along e. The other tangent,
t = n x e, has the row t . z = 0: shear and slip have the same direction (radial return; Gitterle,
Popp, Gee & Wall 2010). Both are components of the vector

    R = rho e + (t . z) t.

With b = |w| and de = t (t . dw) / b its derivatives are

    e . dR = rho_u e . ds + rho_tau e . dz_t + [rho_u (t . s) + (rho_tau - 1) (t . z)] t . dw / b
    t . dR = t . dz_t - (T / b) t . dw.

The matrix in dz is positive definite for T < b; T / b is limited to ``MAX_RATIO`` in the tangent.
Where a law is linear and isotropic, with stick or without friction, R = rho_u s + rho_tau z_t. On
symmetry planes e is in the plane and the law is that of the plane. At w = 0, where e may be any
tangent, the law resists equally in all directions.

Here are also the fields, in both dimensions, of a law with a closing gap, memory, or parameters
that vary in space.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from fenics_mortar.contact.fields import LAW_ATTRIBUTES, RULED, ContactFields
from fenics_mortar.contact.interface_fields import Parts, field, normal_parts, tangential
from fenics_mortar.contact.law import STICK, Friction, Frictionless, Nodal, Row, Stick, VectorRow
from fenics_mortar.interface.mortar import Block
from fenics_mortar.interface.space_mortar import SpaceOperators
from fenics_mortar.utils.arrays import ASSEMBLY_ROUNDING, Array, Flags


class LawFields(ContactFields):
    """Fields for laws of more than gap, slip and multiplier; see ``Law.needs_nodal_state``.

    In ``nodal`` the closing gap replaces the mean gap.
    """

    covered_gap: Any = property(attrgetter("nodal.gap"))

    @field(*LAW_ATTRIBUTES)
    def of_geometry(self) -> Nodal:
        """Arguments of the law with the mean gap."""
        return ContactFields.nodal.func(self)

    @field(*LAW_ATTRIBUTES)
    def closing(self) -> Row | None:
        """See ``ContactFields``; the mean gap at uncovered nodes, no slip on symmetry planes."""
        law, node = self.interface.pair.law, self.of_geometry
        if not law.has_closing_gap:
            return None
        on, x = self.covered, self.operators.x
        row = self.without_slip_on_planes(self.interface.law_calls.closing_gap(law, node, on, x))
        plain = Row(node.gap, 1.0, 0.0, 0.0, 0.0)
        return Row(*(np.where(on, a, b) for a, b in zip(row, plain, strict=True)))

    @field(*LAW_ATTRIBUTES)
    def nodal(self) -> Nodal:
        """See ``ContactFields``; with the closing gap."""
        row = self.closing
        return self.of_geometry if row is None else replace(self.of_geometry, gap=row.residual)

    @field(*LAW_ATTRIBUTES)
    def closing_gap(self) -> Array:
        """See ``InterfaceFields``."""
        return self.fill_inside(np.where(self.covered, self.nodal.gap, np.nan))

    @property
    def offset(self) -> Array:
        """See ``InterfaceFields``; minus the thickness of the law's layer."""
        return np.asarray(self.state.offset - (self.nodal.gap - self.of_geometry.gap))

    def friction_limit(self, pressure: Array) -> Array:
        """See ``ContactFields``; at closed gaps."""
        node = replace(self.nodal, z_n=pressure, gap=np.zeros_like(pressure))
        return self.interface.law_calls.friction_limit_at(
            self.interface.pair.law, node, self.operators.x
        )


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


class SpaceFields(ContactFields):
    """Fields of a contact in space; slip and z_tau are the components along e, see above."""

    @field("partners")
    def slip_vector(self) -> Array:
        """Vector s^ of slip since the accepted state, shape (slave nodes, 3) [length].

        Zero before there is an accepted state.
        """
        partners = self.state.partners
        return np.zeros_like(self.z_u) if partners is None else partners.slip(self.operators)

    @property
    def acting(self) -> Any:
        """See ``InterfaceFields``."""
        return self.operators.near(self.acts | self.state.z.any(axis=1))

    @property
    def counted_slip(self) -> Array:
        """See ``ContactFields``."""
        return self.slip_vector

    @property
    def _has_slip(self) -> bool:
        return type(self.interface.pair.law) is not Frictionless

    @field(*LAW_ATTRIBUTES)
    def tangential_slip(self) -> Array:
        """Tangential part s of the slip, shape (slave nodes, 3) [length]; zero without friction."""
        n, zero = self.operators.n, np.zeros_like(self.operators.n)
        return tangential(self.slip_vector, n) if self._has_slip else zero

    @field(*LAW_ATTRIBUTES)
    def directions(self) -> Directions:
        """Direction of w; fixed tangents without friction, and where w is zero."""
        n, guided = self.operators.n, self.interface.is_guided
        along, none = self.fixed_tangents, np.zeros(len(n))
        if not self._has_slip:
            return Directions(along, np.cross(n, along), none)
        w = tangential(self.z_u, n) + self.slip_weight[:, None] * self.tangential_slip
        size = np.linalg.norm(w, axis=1)
        free = (size > AT_REST * self.slip_weight * self.interface.slave.extent) & ~guided
        size = np.where(free, size, 1.0)
        along = np.where(free[:, None], w / size[:, None], along)
        return Directions(along, np.cross(n, along), np.where(free, size, 0.0))

    @cached_property
    def fixed_tangents(self) -> Array:
        """Tangents by the axis least aligned with n, or in the symmetry plane, (nodes, 3) [1]."""
        n, guided = self.operators.n, self.interface.is_guided
        tangents = tangential(np.eye(3)[np.abs(n).argmin(axis=1)], n)
        tangents[guided] = np.cross(n[guided], self.interface.guides[guided])
        return tangents / np.linalg.norm(tangents, axis=1)[:, None]

    @property
    def slip_weight(self) -> Array:
        """Weight c_t k / l of the slip in w, shape (slave nodes,) [stress / length]."""
        return getattr(self.interface.pair.law, "c_t", Friction.c_t) * self.interface.foundation

    @field(*LAW_ATTRIBUTES)
    def parts(self) -> Parts:
        """See ``InterfaceFields``; the tangential part is that along e."""
        z_n = normal_parts(self.operators.n, self.z_u)
        return Parts(z_n, normal_parts(self.directions.along, self.z_u))

    @property
    def steepness(self) -> float:
        """See ``ContactFields``; collective. The mean square of d(nodal force)/d(slip), too.

        Each is multiplied by the rounding of the slip over that of a position: functions on a small
        part of a facet with nine nodes may be 1e4 times their mean.
        """
        o, steepest = self.operators, super().steepness
        if not (isinstance(o, SpaceOperators) and self._has_slip):
            return steepest
        forces = o.rounding_of_vectors() * self.interface.foundation * self.state.active
        return max(steepest, float(np.sqrt((forces**2).mean())))

    @property
    def slip_in_space(self) -> Array:
        """See ``InterfaceFields``."""
        return self.tangential_slip

    @field(*LAW_ATTRIBUTES)
    def slip(self) -> Array:
        """See ``InterfaceFields``; the component along e."""
        return np.einsum("ja,ja->j", self.directions.along, self.tangential_slip)

    @property
    def counted_shear(self) -> Array:
        """See ``ContactFields``."""
        return self.shear

    @property
    def shear_of_stick(self) -> Array:
        """See ``ContactFields``; the component along e."""
        return normal_parts(self.directions.along, self.z_u - self.state.partners.shear)

    @property
    def tangents(self) -> tuple[Array, Array]:
        """See ``ContactFields``."""
        return self.fixed_tangents, np.cross(self.operators.n, self.fixed_tangents)

    def along_tangents(self, vectors: Array) -> Array:
        """See ``ContactFields``."""
        return np.stack([normal_parts(tangent, vectors) for tangent in self.tangents], axis=1)

    def at_gaps(self, row: Row) -> Row:
        """The row: slip does not depend on the gap."""
        return row

    @field(*RULED)
    def vector_rows(self) -> tuple[VectorRow, ...]:
        """Rows of the law along e and along t, then along n; see ``ContactFields.law_rows``."""
        tangential, *others = self.law_rows
        return *self._tangential_rows(tangential), *(self.by_vectors(row) for row in others)

    @field(*RULED)
    def row_tangents(self) -> tuple[Array, Array]:
        """Directions e and t of the tangential rows, (slave nodes, 3) each [1]: see the module."""
        fixed = (self.is_isotropic & ~self.interface.is_guided)[:, None]
        along = np.where(fixed, self.fixed_tangents, self.directions.along)
        return along, np.cross(self.operators.n, along)

    def _tangential_rows(self, row: Row) -> tuple[VectorRow, VectorRow]:
        """Rows along e and t, given that of the law; see the module."""
        (e, t), none = self.row_tangents, np.zeros(len(self.z_n))
        rho, by_gap, by_u, by_n, by_tau = (part + none for part in row)
        size, weight = self.directions.size, self.slip_weight
        as_law = self.is_isotropic & ~self.interface.is_guided
        per_size = np.where((size > 0.0) & ~as_law, 1.0 / np.where(size > 0.0, size, 1.0), 0.0)
        redundant, z = self.state.redundant, self.z_u
        if redundant.any():
            z = np.where(redundant[:, None], z - self.state.partners.shear, z)
        (e_z, t_z), (e_s, t_s) = (
            [np.einsum("ja,ja->j", a, v) for a in (e, t)] for v in (z, self.tangential_slip)
        )
        turn = (by_u * t_s + (by_tau - 1.0) * t_z) * per_size
        along = self._row(
            np.where(as_law, by_tau * e_z + by_u * e_s, rho), by_gap, by_n,
            ((by_tau, e), (turn, t)), ((by_u, e), (turn * weight, t)),
        )  # fmt: skip
        most = 1.0 if self.operators.linearization.exact else MAX_RATIO
        ratio = np.clip((e_z - rho) * per_size, 0.0, most)
        isotropic = (as_law | (size == 0.0)) & ~self.interface.is_guided
        of_z = np.where(isotropic, by_tau, 1.0 - ratio)
        of_s = np.where(isotropic, by_u, -ratio * weight)
        across = self._row(
            np.where(isotropic, by_tau * t_z + by_u * t_s, t_z),
            none,
            none,
            ((of_z, t),),
            ((of_s, t),),
        )
        return along, across

    @property
    def slip_by_gap(self) -> Array:
        """See ``ContactFields``: none."""
        return np.zeros(len(self.z_u))

    @property
    def is_isotropic(self) -> Flags:
        """Nodes whose law is linear in shear and slip: both rows are the law's, (slave nodes,)."""
        law, interface = self.interface.pair.law, self.interface
        sticks = isinstance(law, (Friction, Stick)) & (self.state.branch == STICK)
        elastic = self.state.redundant  # see ``redundancy``
        return sticks | elastic | ~interface.follows_law | (type(law) is Frictionless)

    def by_vectors(self, row: Row) -> VectorRow:
        """A row that is one number, as that of open nodes, a closing gap or a power of friction.

        Slip and shear along e are those of the law: d(e . a) = e . da + (t . a) t . dw / b.
        """
        residual, by_gap, by_u, by_n, by_tau = (part + np.zeros(len(self.z_n)) for part in row)
        e, t, size = self.directions
        of_turn = by_u * normal_parts(t, self.tangential_slip) + by_tau * normal_parts(t, self.z_u)
        turn = np.where(size > 0.0, of_turn / np.where(size > 0.0, size, 1.0), 0.0)
        return self._row(
            residual, by_gap, by_n, ((by_tau, e), (turn, t)),
            ((by_u, e), (turn * self.slip_weight, t)),
        )  # fmt: skip

    def slip_derivative(self, along: Array) -> Iterator[Block]:
        """See ``ContactFields``; for vectors ``along`` (slave nodes, 3)."""
        return self.state.partners.derivative(self.operators, along)

    def _row(
        self,
        residual: Array,
        by_gap: Array,
        by_z_n: Array,
        by_shear: tuple[tuple[Array, Array], ...],
        by_slip: tuple[tuple[Array, Array], ...],
    ) -> VectorRow:
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
            normal_slip = np.einsum("ja,ja->j", n, self.slip_vector)
            by_normal = by_normal - (factor * normal_slip)[:, None] * a
        return VectorRow(residual, by_z, of_slip, by_gap, by_normal)


class SpaceLawFields(SpaceFields, LawFields):
    """Fields of a contact in space with a law that depends on the nodal state."""


def kind_of(law: Any, dim: int) -> type[ContactFields]:
    """Class of the fields of a law in the plane or in space."""
    if dim == 2:
        return LawFields if law.needs_nodal_state else ContactFields
    return SpaceLawFields if law.needs_nodal_state else SpaceFields
