# SPDX-License-Identifier: MIT
"""Springs of bodies and obstacles: anchored ones for ``proximal``, others in the tangent only.

An anchored spring is part of the residual until it is taken away. A tangent spring regularizes a
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
from fenics_mortar.utils.arrays import Array, Flags, freeze


@dataclass(frozen=True)
class Springs:
    """Anchored springs on dofs or motions, arrays of one shape.

    Attributes:
        stiffness: Stiffness of each [stress].
        anchor: Position at which each is relaxed [length].
    """

    stiffness: Array
    anchor: Array

    def __post_init__(self) -> None:
        """Take copies of arrays that can be written to."""
        freeze(self)

    def forces(self, at: Array) -> Array:
        """Forces of the springs at the positions ``at`` [stress length] (local)."""
        return self.stiffness * (at - self.anchor)

    def energy(self, at: Array) -> float:
        """Energy of these springs at the positions ``at`` [stress length^2] (local)."""
        return 0.5 * float((self.forces(at) * (at - self.anchor)).sum())


def anchored_stiffness(drive: Array, err: Array, length: float, stiffness: Array) -> Array:
    """Stiffness of springs that the forces strain by a given length, (n,) [stress] (local).

    Args:
        drive: Forces that drive the motions, shape (n,) [stress length].
        err: Their discretization error, shape (n,) [stress length].
        length: Strain of the springs under the larger of the two [length].
        stiffness: Of the bulk, shape (n,) or () [stress]; springs are not weaker than a fraction.
    """
    return np.maximum(np.maximum(drive, err) / length, RIGID.weakest_spring * stiffness)


def tangent_stiffness(drive: Array, force: float) -> float:
    """Stiffness of a tangent spring over that of the bulk [1] (local).

    Args:
        drive: Resultant along the motions that it regularizes, shape (n,) [stress length].
        force: Size of all forces [stress length].
    """
    relative = float(np.linalg.norm(drive)) / max(force, 1e-300)
    return float(np.clip(relative, RIGID.weakest_spring, 1.0))


def unresisted(responses: Array) -> Array:
    """Combinations of motions that contact does not resist, orthonormal, (k, motions) (local).

    Args:
        responses: Changes of gaps and slips by each motion, shape (motions, n), on all ranks.
    """
    norms, combinations = resistance(responses, MPI.COMM_SELF)
    return combinations[norms <= RIGID.resisted]


def slides(nodes: Sequence[tuple[Contact, Flags]]) -> bool:
    """Whether all nodes with friction that touch a body slide, so that none fixes it (local).

    Args:
        nodes: The contacts of the body, and which slave nodes act on it, (slave nodes,) each.
    """
    sticks = any((contact.sticking & mine).any() for contact, mine in nodes)
    return not sticks and any((contact.sliding & mine).any() for contact, mine in nodes)
