# SPDX-License-Identifier: MIT
"""Table of contact forces."""

from __future__ import annotations

from fenics_mortar.io.fields import check_problem, evaluated_contacts
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.files import MarkdownText


def contact_table(problem: ContactProblem) -> MarkdownText:
    """Markdown table of forces, active nodes, pressure and gap of each pair (collective).

    Forces act on the bodies [stress length], or on whole bodies of revolution [force]. The pressure
    is the largest nodal value [stress]; the last column is the smallest mean gap of a slave node
    over its length [1].

    Raises:
        ValueError: If ``problem`` is not a ``ContactProblem``.
    """
    check_problem(problem)
    head = "pair|force on slave|force on master|sum|active|max pressure|min gap/length".split("|")
    rows = [f"| {' | '.join(head)} |", "|---|---:|---:|---:|---:|---:|---:|"]
    for contact in evaluated_contacts(problem):
        o, z = contact.operators, contact.z_u
        forces = [-force.sum(axis=0) for force in (o.force(z)[0], o.reaction(z)[1])]
        gap = (contact.gap / contact.slave.nodal_lengths)[contact.covered]
        cells = [f"{contact.slave.name} - {contact.master.name}"]
        sums = [force + 0.0 for force in (*forces, forces[0] + forces[1])]  # -0.0 becomes 0.0
        cells += [f"({f[0]:.4e}, {f[1]:.4e})" for f in sums]
        cells += [f"{contact.active.sum()} of {contact.slave.num_nodes}"]
        gap_text = f"{gap.min() + 0.0:.2e}" if gap.size else "-"
        cells += [f"{contact.pressure.max() + 0.0:.4e}", gap_text]
        rows.append(f"| {' | '.join(cells)} |")
    return MarkdownText("\n".join(rows))
