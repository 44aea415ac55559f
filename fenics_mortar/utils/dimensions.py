# SPDX-License-Identifier: MIT
"""Features that are not yet available in three dimensions, and the error that names them."""

from __future__ import annotations

# What is refused at set-up, by a short key; the table of demos/guide/limits.md has these texts.
NOT_IN_SPACE = {
    "model_check": "estimates of the error of a model (model_check)",
    "thickness": "an out-of-plane thickness",
    "axisymmetric": "axisymmetry, which belongs to plane meshes",
    "cubic": "cells of order 3",
    "integration": "integration over elements or at nodes",
    "vertices": "dual multipliers at vertices (basis='vertices')",
    "self_contact": "contact of a surface with itself",
}  # fmt: skip


def refuse_in_space(what: str, detail: str = "") -> None:
    """Raise the error of a feature that exists in the plane only (local, equal on all ranks).

    Args:
        what: Key of ``NOT_IN_SPACE``.
        detail: What in the user's input needs the feature, to be added to the sentence.

    Raises:
        NotImplementedError: Always.
    """
    raise NotImplementedError(
        f"not yet available in three dimensions: {NOT_IN_SPACE[what]}{detail and f' ({detail})'}"
    )
