# SPDX-License-Identifier: MIT
"""Deviations of a state from the assumptions of its model, as numbers and as text.

For linear strain: the rotation, whose spurious strain is angle^2 / 2, and the strain; for small
sliding: the slip over a facet's length and the rotation of the normals; without friction: the
friction that sticking would require.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.laws import Stick
from fenics_mortar.contact.pair import ContactPair
from fenics_mortar.interface.integrals import evaluate_normals
from fenics_mortar.models.model_error import relative
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.ranks import agreed, largest_over_ranks

# Names of assumptions, which the bulk and the pairs of a variant make.
LINEAR, SMALL = "linear strain", "small sliding"


def deviations(problem: ContactProblem, assumptions: Collection[str]) -> Array:
    """Deviations of a solved problem from some of its assumptions, shape (n,) [1] (collective)."""
    found: list[float] = []
    if LINEAR in assumptions:
        rotation, strain = largest_strain(problem)
        found += [strain, relative(rotation**2, strain)]
    if SMALL in assumptions:
        found += largest_sliding(problem)
    return agreed(problem.equations.comm, np.array(found))


def describe(problem: ContactProblem, assumption: str) -> str:
    """The deviations of a solved problem from an assumption, as text (collective)."""
    if assumption == LINEAR:
        rotation, strain = largest_strain(problem)
        return f"rotation {np.degrees(rotation):.2g}°, strain {100 * strain:.2g} %"
    slip, angle = largest_sliding(problem)
    return f"slip {slip:.2g} facets, normals rotate by {np.degrees(angle):.2g}°"


def largest_strain(problem: ContactProblem) -> tuple[float, float]:
    """Largest rotation [radian] and principal strain of F = R U, cell means (collective)."""
    bulk = problem.equations.bulk
    (a, b), (c, d) = np.moveaxis(bulk.cells.deformation_gradients(bulk.positions()), 0, 2)
    rotation = np.arctan2(c - b, a + d)
    mean, spread = 0.5 * np.hypot(a + d, c - b), 0.5 * np.hypot(a - d, b + c)
    strains = np.abs(mean - 1.0) + spread  # the larger of mean +- spread
    if bulk.space.is_axisymmetric:
        strains = np.maximum(strains, np.abs(bulk.cells.hoop_strains(bulk.positions())))
    mine = np.array([np.abs(values).max(initial=0.0) for values in (rotation, strains)])
    rotation, strain = largest_over_ranks(problem.equations.comm, mine)
    return float(rotation), float(strain)


def all_contacts(problem: ContactProblem) -> list[Contact]:
    """The contacts of a problem, without its ties (local)."""
    return [contact for contact in problem.equations.contacts if isinstance(contact, Contact)]


def sliding_little(problem: ContactProblem) -> list[Contact]:
    """Contacts with small sliding, which use the operators of the undeformed mesh (local)."""
    return [contact for contact in all_contacts(problem) if contact.pair.sliding == "small"]


def largest_sliding(problem: ContactProblem) -> list[float]:
    """Largest slip over a facet's length and rotation of normals of ``sliding_little`` (local)."""
    found = [_largest_slip(contact) for contact in sliding_little(problem)]
    return list(np.max(found, axis=0).tolist())


def _largest_slip(contact: Contact) -> tuple[float, float]:
    """Largest slip of active nodes over their length, and rotation of normals [radian] (local)."""
    o, on = contact.operators, contact.active & contact.covered
    jump = o.jump(o.x - contact.slave.X, o.m - contact.master.X)
    slip = np.einsum("jc,jc->j", o.tau, jump)[on] / (o.weight * contact.slave.nodal_lengths)[on]
    weighting = contact.pair.discretization.normals
    before, now = (evaluate_normals(contact.slave, x, weighting)[0] for x in (contact.slave.X, o.x))
    cosine = np.einsum("jc,jc->j", before, now)[on]
    angles = np.arccos(np.clip(cosine, -1.0, 1.0))
    return float(np.abs(slip).max(initial=0.0)), float(angles.max(initial=0.0))


def shear_demand(problem: ContactProblem) -> float:
    """Largest mean |z_tau| / z_n of all pairs with a sticking law [1] (local)."""
    demands = [
        relative(np.abs(c.shear_force).sum(), float(np.abs(c.operators.weight * c.pressure).sum()))
        for c in problem.equations.contacts
        if isinstance(c.pair, ContactPair) and isinstance(c.pair.law, Stick)
    ]
    return max(demands, default=0.0)
