# SPDX-License-Identifier: MIT
"""Derivatives of an objective with respect to numerical choices, which are not part of the model.

================  =================================================================================
choice            derivative
================  =================================================================================
nodal offsets     of each slave node; faceting changes gaps by such offsets
c_n               weight of the gap in the active-set test: zero
stiffness         weight k of the rows of contact: zero but for redundant sticks, which are elastic
residual          effect of the remaining residual of Newton's method on the objective
================  =================================================================================

Straight facets change the gap between curved surfaces. Facets of length l are chords of the surface
that was meshed. If it turns to the left by the angle t between two of them, its curvature is t / l,
and it bulges out of the body by l^2 (t / l) / 12 in the mean of a facet, so that the gap of the
mesh is too wide by this length. For facets with a middle node their own bulge is subtracted.
Corners have no curvature. Positions are those of the undeformed mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.interface.corners import TURN
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.control import Control
from fenics_mortar.sensitivity.controls import NumericWeight, Offset
from fenics_mortar.sensitivity.gradient import gradient, recorded
from fenics_mortar.sensitivity.history import Before
from fenics_mortar.sensitivity.over_steps import OverSteps, last
from fenics_mortar.sensitivity.path_record import RecordedPath
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import format_point
from fenics_mortar.utils.files import Markdown


class RemainingResidual(Control):
    """Factor of the remaining residual of Newton's method: 1; with 0 equilibrium is exact.

    The derivative is the error due to the end of Newton's method.
    """

    name = "residual left"

    def get(self, problem: ContactProblem) -> Array:
        """See ``Control``."""
        return np.array(1.0)

    def set(self, problem: ContactProblem, values: Array) -> None:
        """Raise an error: the residual follows from the tolerance of Newton's method."""
        raise ValueError(
            "the remaining residual follows from NewtonOptions: expected another control"
        )

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """See ``Control``; ``before`` is not used."""
        return self._residual(problem) * -float(dm)

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """See ``Control``; ``before`` is not used."""
        return np.array(-self._residual(problem).dot(y, problem.equations.comm))

    def pairs(self, problem: ContactProblem) -> list[int]:
        """See ``PairControl``: none, pairs depend on the residual through the state only."""
        return []

    def _residual(self, problem: ContactProblem) -> LinearVector:
        """Residuals of all equations at the present state (collective)."""
        e = problem.equations
        bulk, contact, _ = e.residual.forces()
        u = bulk + contact
        u[e.bulk.prescribed_dofs] = -e.bulk.distance_to_prescribed()
        z = [c.rows.weighted(c.rows.frame()) for c in e.contacts]
        return LinearVector(u, z, e.motions.residual() * e.motions.scales)


@dataclass(frozen=True)
class PairNumerics:
    """Derivatives of an objective with respect to the numerical choices of one pair; local.

    Attributes:
        pair: Number of the pair.
        X: Undeformed positions of the slave nodes, shape (slave nodes, 2) [length].
        by_offset: Derivative with respect to the nodal offsets, shape (slave nodes,)
            [objective / length].
        faceting: Offsets by which faceting widens the gap, shape (slave nodes,) [length].
        by_c_n: Derivative with respect to the factor of c_n [objective].
        by_stiffness: Derivative with respect to the factor of the stiffness k [objective].
    """

    pair: int
    X: Array
    by_offset: Array
    faceting: Array
    by_c_n: float
    by_stiffness: float

    @property
    def by_faceting(self) -> float:
        """Change of the objective if gaps are those of the exact curves [objective]."""
        return float(self.by_offset @ self.faceting)

    def rows(self) -> list[tuple[str, str, str]]:
        """Rows of the table: choice, derivative, effect."""
        j = int(np.abs(self.by_offset).argmax())
        at, height = format_point(self.X[j]), np.abs(self.faceting).max()
        return [
            (f"pair {self.pair}: offset of all nodes", f"{self.by_offset.sum():.3g}", ""),
            (f"pair {self.pair}: offset of node {j} at {at}", f"{self.by_offset[j]:.3g}", ""),
            (f"pair {self.pair}: faceting, up to {height:.1e}", "", f"{self.by_faceting:.1e}"),
            (f"pair {self.pair}: factor of c_n", f"{self.by_c_n:.1e}", ""),
            (f"pair {self.pair}: factor of the stiffness k", f"{self.by_stiffness:.1e}", ""),
        ]


@dataclass(frozen=True)
class NumericsReport(Markdown):
    """Derivatives with respect to numerical choices; prints as a Markdown table.

    Attributes:
        value: The objective [its unit].
        pairs: Derivatives with respect to the choices of each contact; ties have none.
        residual: Error of the objective due to the remaining residual of Newton's method
            [objective], to first order.
    """

    value: float
    pairs: tuple[PairNumerics, ...]
    residual: float

    def __str__(self) -> str:
        """The table (local)."""
        rows = [row for pair in self.pairs for row in pair.rows()]
        rows.append(("residual left by Newton's method", "", f"{self.residual:.1e}"))
        head = [f"| objective {self.value:.6g}: choice | derivative | effect |", "|---|---:|---:|"]
        return "\n".join([*head, *(f"| {' | '.join(row)} |" for row in rows)])


def by_numerics(
    objective: Any, path: RecordedPath | ContactProblem, *, over_steps: OverSteps = last
) -> NumericsReport:
    """Derivatives of an objective with respect to numerical choices (collective).

    Args:
        objective: See ``gradient``.
        path: See ``gradient``. A choice acts in all of its steps.
        over_steps: See ``gradient``.

    Returns:
        The derivatives, at the cost of one gradient.

    Raises:
        ValueError: See ``gradient``.
        MortarError: See ``gradient``.

    Example:
        Sensitivity of the force to these choices, after a solve::

            force = fm.sensitivity.TotalForce(0, (0.0, 1.0))
            print(fm.sensitivity.by_numerics(force, problem))
    """
    problem, left = recorded(path).problem, RemainingResidual()
    contacts = [(i, c) for i, c in enumerate(problem.equations.contacts) if isinstance(c, Contact)]
    controls = {
        i: (Offset(i), NumericWeight(i, "c_n"), NumericWeight(i, "stiffness")) for i, _ in contacts
    }
    each = [control for several in controls.values() for control in several]
    found = gradient(objective, [*each, left], path, over_steps=over_steps)
    pairs = []
    for i, contact in contacts:
        offset, c_n, stiffness = (found[control] for control in controls[i])
        faceting = offset_by_faceting(contact)
        pairs.append(
            PairNumerics(i, contact.slave.X, offset, faceting, float(c_n), float(stiffness))
        )
    return NumericsReport(found.value, tuple(pairs), float(found[left]))


class Numerics:
    """Argument of a solve: ``report.sensitivity`` then has derivatives, see ``by_numerics``.

    The constructor is local.

    Args:
        objective: See ``gradient``.

    Example:
        ::

            force = fm.sensitivity.TotalForce(0, (0.0, 1.0))
            report = problem.solve(sensitivity=fm.sensitivity.Numerics(force))
            print(report.sensitivity)
    """

    def __init__(self, objective: Any) -> None:
        self.objective = objective

    def of(self, problem: ContactProblem) -> NumericsReport:
        """The derivatives at the present, solved state (collective); see ``by_numerics``."""
        return by_numerics(self.objective, problem)


def offset_by_faceting(contact: Contact) -> Array:
    """Nodal offsets that reduce the gap by the bulges of both surfaces, (slave nodes,) (local).

    The bulge of the master is that at its node nearest to the slave node; obstacles have none
    [length].
    """
    offset, master = mean_bulges(contact.slave), contact.master
    if master.num_nodes:
        o = contact.operators
        distance = np.linalg.norm(o.x[:, None] - o.m[None], axis=2)
        offset = offset + mean_bulges(master)[distance.argmin(axis=1)]
    return offset


def mean_bulges(surface: Surface) -> Array:
    """Mean height of the meshed surface over the facets at each node, (nodes,) [length] (local).

    Positive where the body is convex.
    """
    lengths = surface.lengths
    bulges = _curvatures(surface) * lengths**2 / 12.0
    if surface.degree > 1:
        bulges -= 2.0 / 3.0 * _heights(surface)
    sums = np.zeros((2, surface.num_nodes))
    for total, values in zip(sums, (lengths * bulges, lengths), strict=True):
        np.add.at(total, surface.facets, values[:, None])
    return sums[0] / sums[1]


def _curvatures(surface: Surface) -> Array:
    """Curvature of each facet, the mean of those defined at its ends, (facets,) [1 / length]."""
    inside = (surface.previous >= 0) & (surface.following >= 0) & ~surface.inner
    smooth = np.flatnonzero(inside & (np.abs(surface.turns) <= TURN))
    before, after = surface.chords(surface.X, smooth)
    chords = 0.5 * (np.linalg.norm(before, axis=1) + np.linalg.norm(after, axis=1))
    curvature, counts = np.zeros((2, surface.num_nodes))
    curvature[smooth], counts[smooth] = surface.turns[smooth] / chords, 1.0
    ends = surface.facets[:, [0, -1]]
    return curvature[ends].sum(axis=1) / np.maximum(counts[ends].sum(axis=1), 1.0)


def _heights(surface: Surface) -> Array:
    """Outward height of the middle node of each facet over its chord, (facets,) [length]."""
    a, middle, b = surface.X[surface.facets].swapaxes(0, 1)
    chord = b - a
    outward = np.stack([chord[:, 1], -chord[:, 0]], axis=1) / np.linalg.norm(chord, axis=1)[:, None]
    return np.einsum("fc,fc->f", middle - 0.5 * (a + b), outward)
