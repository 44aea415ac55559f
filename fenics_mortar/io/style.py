# SPDX-License-Identifier: MIT
"""Style of pictures: colours, and what the user chooses."""

from __future__ import annotations

from typing import Any, NamedTuple

from fenics_mortar.utils.arrays import Array

INK, GREY, PRESSURE = "#222222", "#999999", "#c8102e"
BODIES = "#dfe6ea"
SEQUENTIAL, DIVERGING = "YlGnBu", "RdBu_r"
# A field has both signs if the largest value of one sign is at least this fraction of the largest
# of the other sign [1]: smaller values may be discretization errors, and half of the colours would
# not be used.
SIGNED = 0.2


class Style(NamedTuple):
    """Arguments of ``plot``, see there."""

    label: str
    title: str | None
    scale: float
    units: tuple[str, str] | None
    limits: tuple[float, float] | None
    cmap: Any


def colours(values: Array, style: Style) -> dict[str, Any]:
    """Colour map and norm of a field, diverging about zero if it has both signs (local)."""
    from matplotlib.colors import Normalize, TwoSlopeNorm

    low, high = (values.min(), values.max()) if style.limits is None else style.limits
    smaller, larger = sorted((abs(low), abs(high)))
    if not (low < 0.0 < high and smaller > SIGNED * larger):
        return {"norm": Normalize(low, high), "cmap": style.cmap or SEQUENTIAL}
    if style.limits is None:
        low, high = -larger, larger
    return {"norm": TwoSlopeNorm(0.0, low, high), "cmap": style.cmap or DIVERGING}


def pressure_label(contacts: list[Any], contact: Any, style: Style) -> str:
    """Entry of the legend on the largest pressure of a contact (local)."""
    slaves = [other.slave.name for other in contacts]
    name = contact.slave.name
    if slaves.count(name) > 1:
        name += f" by {contact.pair.master_name}"
    unit = "" if style.units is None else f" {style.units[1]}"
    return f"pressure on {name}, maximum {contact.pressure.max():.4g}{unit}"
