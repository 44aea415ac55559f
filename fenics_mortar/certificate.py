# SPDX-License-Identifier: MIT
"""The certificate of a solved state: what must hold, measured after the fact.

Newton says that the equations it was given are solved. Whether they are those of contact, is asked
here of the state alone: balance of slave and master, signs, complementarity, penetration between
the nodes, and nodes inside another body that found no partner.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk import Bulk
from fenics_mortar.contact import Contact
from fenics_mortar.kernels.curved import sample_gaps
from fenics_mortar.surfaces import Indices

SAMPLES = np.linspace(-1.0, 1.0, 5)


@dataclass(frozen=True)
class Certificate:
    """Measured defects of one pair; all are plain numbers, zero is perfect.

    Attributes:
        pair: Names of slave and master.
        force: Sum of all contact forces over the sum of their sizes. Rounding.
        moment: Sum of their moments over forces times lever arms. Of third order in the facets.
        tension: Largest tension, -z_n, over the largest pressure.
        shear: Largest tangential multiplier over the largest pressure.
        overlap: Largest negative mean gap of a slave node over its length.
        complementarity: Largest |z_n g| over largest pressure and length.
        penetration: Deepest point of a segment in the master over its facet's length: what the
            discretisation allows between the nodes, of second order in the facets.
        unpaired: Nodes of the two surfaces inside another body without any partner.
        uncovered: Slave nodes without a partner.
    """

    pair: str
    force: float
    moment: float
    tension: float
    shear: float
    overlap: float
    complementarity: float
    penetration: float
    unpaired: int
    uncovered: int

    def violations(self, tolerance: float = 1e-6, penetration: float = 0.5) -> list[str]:
        """What does not hold, in words; empty for a sound state.

        Args:
            tolerance: For what the equations make zero.
            penetration: For what the mesh makes small [facet lengths].
        """
        return list(self._violations(tolerance, penetration))

    def _violations(self, tolerance: float, penetration: float) -> Iterator[str]:
        for name in ("force", "tension", "shear", "overlap", "complementarity"):
            value = getattr(self, name)
            if not value <= tolerance:
                yield f"{self.pair}: {name} {value:.1e} (allowed {tolerance:.1e})"
        if not self.penetration <= penetration:
            yield f"{self.pair}: penetration of {self.penetration:.2f} facets between the nodes"
        if self.unpaired:
            yield (
                f"{self.pair}: {self.unpaired} nodes are inside another body and have no partner: "
                "contact was missed; take smaller steps or a larger search_radius"
            )


def certify(bulk: Bulk, contact: Contact, labels: Indices) -> Certificate:
    """Measure the present state of one pair (collective).

    Args:
        bulk: The bodies.
        contact: The pair, evaluated at the present state.
        labels: Body of each local node.
    """
    o, z = contact.operators, contact.z
    on_slave, on_master = o.force(z)
    forces, x = np.concatenate([on_slave, on_master]), np.concatenate([o.x, o.m])
    lever = x - x.mean(axis=0)
    moments = lever[:, 0] * forces[:, 1] - lever[:, 1] * forces[:, 0]
    pressure = np.einsum("jc,jc->j", o.n, z)
    shear = np.einsum("jc,jc->j", o.tau, z)
    largest = _positive(float(pressure.max()))
    gap = np.nan_to_num(contact.gap) / contact.nodal_lengths
    sizes = np.abs(forces)
    return Certificate(
        pair=f"{contact.slave.name} - {contact.master.name}",
        force=float(np.abs(forces.sum(axis=0)).max()) / _positive(float(sizes.sum())),
        moment=abs(float(moments.sum()))
        / _positive(float((sizes.max(axis=1) * np.abs(lever).max(axis=1)).sum())),
        tension=max(-float(pressure.min()), 0.0) / largest,
        shear=float(np.abs(shear).max()) / largest,
        overlap=max(-float(gap.min()), 0.0),
        complementarity=float(np.abs(pressure * gap).max()) / largest,
        penetration=_deepest(contact),
        unpaired=_count_unpaired(bulk, contact, labels),
        uncovered=int((contact.carries & ~contact.covered).sum()),
    )


def _positive(value: float) -> float:
    """``value``, or one where there is nothing to compare with."""
    return value if value > 0.0 else 1.0


def _deepest(contact: Contact) -> float:
    """Largest penetration at sample points of all segments over the facet's length (collective)."""
    o, s = contact.operators, contact.operators.segments
    gaps = np.zeros((s.num_segments, SAMPLES.size))
    sample_gaps((o.x, o.n, o.m), (s.slave, s.master), s.end_is_node, SAMPLES, gaps)
    lengths = np.linalg.norm(o.x[s.slave[:, -1]] - o.x[s.slave[:, 0]], axis=1)
    deepest = float((-gaps / lengths[:, None]).max(initial=0.0))
    return contact.slave.comm.allreduce(deepest, MPI.MAX)


def _count_unpaired(bulk: Bulk, contact: Contact, labels: Indices) -> int:
    """Slave and master nodes without a partner that lie inside a cell of another body."""
    o = contact.operators
    lonely = np.ones(contact.master.num_nodes, bool)
    lonely[o.segments.master.ravel()] = False
    contact.slave.comm.Allreduce(MPI.IN_PLACE, lonely, MPI.LAND)
    mine = np.repeat(labels, 2).astype(float)
    found = 0
    for surface, x, alone in (
        (contact.slave, o.x, o.cover == 0.0),
        (contact.master, o.m, lonely),
    ):
        own = surface.gather(mine)[:, 0]
        found += int(bulk.inside_other_body(x[alone], own[alone], labels).sum())
    return found
