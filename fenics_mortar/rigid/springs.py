# SPDX-License-Identifier: MIT
"""Springs on bodies and obstacles: anchored springs of ``proximal``, and tangent springs.

An anchored spring is part of the residual until it is removed. A tangent spring regularizes a
motion that active contact does not resist. Its stiffness is in proportion to the force that drives
the motion, so it vanishes at equilibrium (Levenberg-Marquardt), and the converged solution is
unaffected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk.bodies import resistance
from fenics_mortar.contact.contact import Contact
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.utils.arrays import Array, Flags, Indices, Value
from fenics_mortar.utils.rounding import TINY


@dataclass(frozen=True)
class Springs(Value):
    """Anchored springs on dofs or motions, as arrays of equal shape.

    Attributes:
        stiffness: Stiffness of each [stress].
        anchor: Position at which each is relaxed [length].
    """

    stiffness: Array
    anchor: Array

    def without(self, dofs: Indices) -> Springs:
        """These springs without those on some dofs (local)."""
        stiffness = self.stiffness.copy()
        stiffness[dofs] = 0.0
        return self.replaced(stiffness=stiffness)

    def forces(self, at: Array) -> Array:
        """Forces of the springs at ``at``, of the shape of ``anchor`` [stress length] (local)."""
        return self.stiffness * (at - self.anchor)

    def energy(self, at: Array) -> float:
        """Energy of the springs at ``at``, of the shape of ``anchor`` [stress length^2] (local)."""
        return 0.5 * float((self.forces(at) * (at - self.anchor)).sum())


def anchored_stiffness(drive: Array, err: Array, length: float, stiffness: Array) -> Array:
    """Stiffness of springs with a given elongation under given forces, (n,) [stress] (local).

    Args:
        drive: Forces that drive the motions, shape (n,) [stress length].
        err: Discretization error of these forces, shape (n,) [stress length].
        length: Elongation of the springs under the larger of both [length].
        stiffness: Stiffness of the bulk, shape (n,) or () [stress]; springs of bodies without
            forces have the fraction ``RIGID.weakest_spring`` of it.
    """
    springs = np.maximum(drive, err) / length
    forceless = springs < RIGID.weakest_anchor * stiffness
    return np.where(forceless, RIGID.weakest_spring * stiffness, springs)


def over_contact(springs: float, contact: float) -> float:
    """Force of springs over the contact force [1]; inf if only springs act (local)."""
    if contact > 0.0:
        return springs / contact
    return np.inf if springs > 0.0 else 0.0


def tangent_stiffness(drive: Array, force: float) -> float:
    """Stiffness of a tangent spring over that of the bulk [1] (local).

    Args:
        drive: Resultant along the regularized motions, shape (n,) [stress length].
        force: Size of all forces [stress length].
    """
    relative = float(np.linalg.norm(drive)) / max(force, TINY)
    return float(np.clip(relative, RIGID.weakest_spring, 1.0))


def unresisted(responses: Array) -> Array:
    """Orthonormal combinations of motions that contact does not resist, (k, motions) [1] (local).

    Args:
        responses: Changes of gaps and slips due to each motion, shape (motions, n), replicated.
    """
    norms, combinations = resistance(responses, MPI.COMM_SELF)
    return combinations[norms <= RIGID.resisted]


def slides(nodes: Sequence[tuple[Contact, Flags]]) -> bool:
    """Whether all nodes of a body with friction slide (local).

    Args:
        nodes: Contacts of the body, each with the slave nodes that act on it, (slave nodes,).
    """
    sticks = any((contact.sticking & mine).any() for contact, mine in nodes)
    return not sticks and any((contact.sliding & mine).any() for contact, mine in nodes)
