# SPDX-License-Identifier: MIT
"""Certificate of a solved state: contact conditions, measured independently of the solver.

Convergence of Newton's method means that the discrete equations are solved. Whether the state
satisfies the conditions of contact is measured here from the state alone: balance of slave and
master and of reactions and loads, signs, complementarity, penetration between the nodes, nodes
inside another body without a partner, and crossing outlines, whether or not a pair covers them.
Errors at corners, which all these conditions may miss, are estimated in ``corners``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.law_calls import raise_stored
from fenics_mortar.contact.messages import describe_search_radius
from fenics_mortar.contact.tied import Tie
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import format_point
from fenics_mortar.utils.markdown import Markdown
from fenics_mortar.utils.ranks import agreed
from fenics_mortar.verify.balance import action_and_reaction, balance_of_bodies
from fenics_mortar.verify.between_nodes import between_nodes, count_unpaired, paired_nodes
from fenics_mortar.verify.corners import end_pressure, mean_friction, oblique_forces, runs_of
from fenics_mortar.verify.crossing import Crossing
from fenics_mortar.verify.friction_work import compare_work, uncertain_rotation
from fenics_mortar.verify.limits import LIMITS
from fenics_mortar.verify.obstacle_gradient import gradient_error
from fenics_mortar.verify.pair_certificate import PairCertificate
from fenics_mortar.verify.resolution import narrow_regions, uneven_gaps
from fenics_mortar.verify.resultant import beyond_cover
from fenics_mortar.verify.rotation import rotation_since_reference
from fenics_mortar.verify.sharp_obstacle import along_facets


@dataclass(frozen=True)
class Certificate(Markdown):
    """Measured defects of a state; prints as a Markdown table.

    Attributes:
        pairs: One certificate per pair.
        balance: Largest sum of reactions, loads and contact forces of a body or obstacle, over the
            sum of the norms of all forces [1].
        inverted: Number of cells inverted at a point where a form with finite strains is evaluated.
        springs: Largest sum of the forces of springs on a body over the contact force on it [1];
            zero unless the report of the solve records springs.
        drift: From the report of a solve: sliding distance of an obstacle driven by forces over its
            contact width [1], common to all its nodes and beyond the prescribed motion. The state
            is in equilibrium, but may not be reached by a path of equilibria.
        crossings: Crossings of outlines.
        passages: Bodies that passed through each other during the step, as messages.
        possible_passages: Passages on motions that the ends of the step do not tell, as messages.
        tipping: Bodies that pressures on the covered surfaces cannot balance, as messages.
        inverted_nodes: Remark on cells inverted at nodes alone, or with linear strains.
    """

    pairs: list[PairCertificate]
    balance: float
    inverted: int
    springs: float = 0.0
    drift: float = 0.0
    crossings: list[Crossing] = field(default_factory=list)
    passages: list[str] = field(default_factory=list)
    possible_passages: list[str] = field(default_factory=list)
    tipping: list[str] = field(default_factory=list)
    inverted_nodes: str = ""

    def violations(
        self,
        tolerance: float = LIMITS.tolerance,
        penetration: float = LIMITS.penetration,
        springs: float = LIMITS.negligible,
    ) -> list[str]:
        """Describe violated conditions; empty for a sound state (local).

        Args:
            tolerance: Limit for quantities that vanish in a solution of the equations [1].
            penetration: Limit for penetration, distance and crossings [facet lengths].
            springs: Limit for the force of springs over the contact force [1], see ``proximal``.
        """
        found = [v for pair in self.pairs for v in pair.violations(tolerance, penetration)]
        if not self.balance <= tolerance:
            found.append(f"balance of a body {self.balance:.1e} (allowed {tolerance:.1e})")
        if not self.springs <= springs:
            found.append(
                f"springs carry {self.springs:.1e} of the contact force (allowed {springs:.1e})"
            )
        if not self.drift <= 1.0:
            found.append(
                f"an obstacle driven by forces slid away, by {self.drift:.1f} widths of its "
                "contact: the path may lead to another equilibrium; take smaller steps, or "
                "prescribe its motion"
            )
        if self.inverted:
            found.append(f"{self.inverted} cells are inverted")
        found += [str(crossing) for crossing in self.crossings if crossing.facets > penetration]
        return found + self.passages + self.tipping

    def remarks(self) -> list[str]:
        """Describe where the mesh is too coarse or the solution may not be unique (local)."""
        crossings = [c for c in self.crossings if c.facets > LIMITS.coarse_penetration]
        return [
            *(remark for pair in self.pairs for remark in pair.remarks()),
            *(
                f"{crossing}: smaller steps, finer facets, or a pair of these surfaces"
                for crossing in crossings
            ),
            *self.possible_passages,
            *filter(None, (self.inverted_nodes,)),
        ]

    def __str__(self) -> str:
        """Markdown table: one row per measure, one column per pair."""
        names = [f.name for f in fields(PairCertificate) if f.type != "str"]
        lines = ["| | " + " | ".join(pair.pair for pair in self.pairs) + " |"]
        lines.append("|---|" + "---:|" * len(self.pairs))
        for name in names:
            cells = [f"{getattr(pair, name):.2g}" for pair in self.pairs]
            lines.append(f"| {name} | {' | '.join(cells)} |")
        lines.append(
            f"\nbalance of the bodies: {self.balance:.1e}; inverted cells: {self.inverted}"
        )
        return "\n".join([*lines, *(self.violations() or self.remarks())])


def certify(
    bulk: Bulk, contacts: Sequence[Contact | Tie], labels: Indices, unbalanced: Array
) -> Certificate:
    """Measure the present state (collective).

    Args:
        bulk: The bodies, with ``r`` at the present state.
        contacts: The pairs, evaluated there.
        labels: Body of each local node, shape (local nodes,).
        unbalanced: Sums of all forces on the obstacles, equal on all ranks [stress length].

    Raises:
        Exception: An error of a user's law, raised on all ranks.
    """
    paired = np.unique(np.concatenate([np.empty(0, np.int64), *map(paired_nodes, contacts)]))
    inverted, _ = bulk.inverted_cells()
    pairs = [
        _certify_tie(c) if isinstance(c, Tie) else _certify_pair(bulk, c, labels, paired)
        for c in contacts
    ]
    raise_stored(bulk.comm, contacts)
    balance = balance_of_bodies(bulk, contacts, labels, unbalanced)
    return agreed(
        bulk.comm,
        Certificate(pairs, balance, inverted, inverted_nodes=bulk.describe_inverted_nodes()),
    )


def _certify_pair(
    bulk: Bulk, contact: Contact, labels: Indices, paired: Indices
) -> PairCertificate:
    """Measure one pair; ``paired``: global numbers of the nodes with a partner in any pair."""
    pressure = np.einsum("jc,jc->j", contact.operators.n, contact.z)
    limit = contact.now.friction_limit(pressure)
    may_transfer = contact.acts if contact.pair.law.bridges_gap else contact.active
    limit = np.where(may_transfer, limit, 0.0)
    excess, tension = np.abs(contact.z_tau) - limit, contact.now.tension
    smallest = LIMITS.min_pressure * float(contact.modulus.max())
    largest = max(float(np.abs(pressure).max()), smallest)
    gap = contact.now.closing_gap / contact.slave.nodal_lengths
    gap[np.isnan(gap)] = 0.0  # uncovered nodes
    gradient, gradient_at = gradient_error(contact)
    return PairCertificate(
        **action_and_reaction(contact),
        tension=max(float(tension.max()), 0.0) / largest,
        shear=max(float(excess.max()), 0.0) / max(largest, float(limit.max())),
        overlap=max(-float(gap.min()), 0.0),
        overlap_at=f"at {format_point(contact.operators.x[gap.argmin()])}, in facets; partners are "
        f"searched {describe_search_radius(contact)}",
        search_radius=describe_search_radius(contact),
        complementarity=float(np.abs(tension * gap).max()) / largest,
        **between_nodes(contact),
        **oblique_forces(contact, pressure),
        **along_facets(contact),
        **narrow_regions(contact, pressure),
        **uneven_gaps(contact, pressure),
        friction=mean_friction(limit, pressure),
        **end_pressure(contact, pressure),
        **beyond_cover(contact, runs_of(contact)),
        redundant=int(contact.redundant.sum()),
        redundant_at=format_point(contact.operators.x[contact.redundant.argmax()]),
        undecided_at=" and ".join(map(format_point, contact.operators.x[contact.undecided])),
        **uncertain_rotation(contact),
        **compare_work(contact),
        gradient=gradient,
        gradient_at=gradient_at,
        tilt=rotation_since_reference(contact),
        unpaired=count_unpaired(bulk, contact, labels, paired),
        uncovered=int((contact.multiplier_nodes & ~contact.covered).sum()),
    )


def _certify_tie(tie: Tie) -> PairCertificate:
    """Measure one tied pair, which carries tension and shear as well."""
    return PairCertificate(
        **action_and_reaction(tie),
        overlap=float(np.nanmax(tie.gap / tie.slave.nodal_lengths)),
        uncovered=int((~tie.now.has_partner).sum()),
    )
