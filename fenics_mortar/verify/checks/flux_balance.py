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
from fenics_mortar.utils.ranks import largest_over_ranks
from fenics_mortar.utils.rounding import ROUNDING
from fenics_mortar.verify.finding import Finding
from fenics_mortar.verify.limits import LIMITS


def of_contact(measured: Any) -> Iterator[Finding]:
    """Imbalance of each flux over the sum of its absolute loads (collective)."""
    contact = measured.contact
    for flux in contact.fluxes:
        yield _stiffness(flux, contact, measured.bulk)
        if contact.obstacle is not None:
            continue  # what enters an obstacle leaves the system
        source = float(contact.operators.weight @ flux.nodal().heating)
        yield _imbalance(flux.law.field, np.concatenate(flux.loads()), source)


def _stiffness(flux: Any, contact: Any, bulk: Any) -> Finding:
    """Largest conductance of a node over the conduction of the cells beside it (collective)."""
    first = bulk.first
    mine = flux.dofs[(flux.dofs >= first) & (flux.dofs < first + bulk.num_owned)] - first
    per_flux = float((bulk.units[mine] * bulk.to_force[mine]).max(initial=0.0))
    per_flux = float(largest_over_ranks(bulk.comm, per_flux)) / (bulk.stiffness or 1.0)
    h = flux.nodal().conductance * contact.operators.weight
    value, field = float(h.max(initial=0.0)) * per_flux, flux.law.field
    return Finding(
        f"conductance of field {field}",
        f"conductance of field {field} over the conduction of cells",
        value,
        f"the conductance of field {field} is {value:.0e} times the conduction of the cells beside "
        "it: Newton's method and digits of the flux suffer; 1e4 times is almost perfect conduction",
        limit=LIMITS.lost_conductance,
        remark=LIMITS.large_conductance,
    )


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
