# SPDX-License-Identifier: MIT
"""All contact laws of the package, and the names with which users write their own.

Input: parameters. Output: laws, an argument of ``fm.ContactPair``. ``Frictionless``, ``Coulomb``
and ``Tresca`` are laws without memory. The others are written as users write theirs, with the base
classes ``Law`` and ``Friction``, the state ``Nodal`` of the nodes, the result ``Row``, and the
helpers ``row_of`` and ``magnitude``: ``demos/guide/laws.md`` explains how.

>>> SoftLayer(k=50.0, m=2.0, mu=0.3)
SoftLayer(c_t=0.1, mu=0.3, max_shear=inf, limit_by='trial', k=50.0, m=2.0)
"""

from fenics_mortar.contact.law import (
    Coulomb,
    Friction,
    Frictionless,
    Law,
    Nodal,
    Row,
    Tresca,
    magnitude,
    row_of,
)
from fenics_mortar.laws.layers import Cohesive, MixedCohesive, SoftLayer, Worn
from fenics_mortar.laws.rates import RateAndState, Stribeck

__all__ = [
    "Cohesive", "Coulomb", "Friction", "Frictionless", "Law", "MixedCohesive", "Nodal",
    "RateAndState", "Row", "SoftLayer", "Stribeck", "Tresca", "Worn", "magnitude", "row_of",
]  # fmt: skip
