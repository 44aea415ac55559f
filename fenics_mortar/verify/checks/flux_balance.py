# SPDX-License-Identifier: MIT
"""Balance of the fluxes of scalar fields across contact: loads of both sides and sources.

The sum of all loads on the slave's and the master's dofs is that of the source, since D and M
reproduce constants.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.rounding import ROUNDING
from fenics_mortar.verify.finding import Finding


def of_contact(measured: Any) -> Iterator[Finding]:
    """Imbalance of each flux over the sum of its absolute loads (collective)."""
    contact = measured.contact
    for flux in contact.fluxes:
        if contact.obstacle is not None:
            continue  # what enters an obstacle leaves the system
        source = float(contact.operators.weight @ flux.nodal().heating)
        yield _imbalance(flux.law.field, np.concatenate(flux.loads()), source)


def of_tie(tie: Any) -> Iterator[Finding]:
    """Imbalance of the flux of each tied field over the sum of its absolute loads (collective)."""
    for field in tie.fluxes:
        yield _imbalance(field.field, np.concatenate(field.loads()), 0.0)


def _imbalance(field: int, loads: Array, source: float) -> Finding:
    size = float(np.abs(loads).sum()) + abs(source)
    imbalance = abs(float(loads.sum()) + source)
    return Finding(
        f"balance of field {field}",
        f"imbalance of the flux of field {field}, over the sum of its loads",
        imbalance / size if size > 0.0 else 0.0,
        limit=ROUNDING,
    )
