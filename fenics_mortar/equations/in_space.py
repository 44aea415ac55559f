# SPDX-License-Identifier: MIT
"""Refusal of what problems in space cannot do yet; see ``utils.dimensions``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from fenics_mortar.utils.dimensions import refuse_in_space


def check_given_in_space(given: dict[str, Any], model_check: Any) -> None:
    """Reject arguments of ``ContactProblem`` that belong to the plane (local, equal on all ranks).

    Args:
        given: Arguments by name.
        model_check: Check of the model, or ``None``.

    Raises:
        NotImplementedError: If the mesh is one of solids, and an argument needs the plane.
    """
    if given["u"].function_space.mesh.geometry.dim != 3:
        return
    for what, needed in (
        ("axisymmetric", given["geometry"] == "axisymmetric"),
        ("thickness", given["thickness"] is not None),
        ("model_check", model_check is not None),
    ):
        if needed:
            refuse_in_space(what)


def check_pairs_in_space(pairs: Sequence[Any]) -> None:
    """Reject pairs that belong to the plane (local, equal on all ranks).

    Args:
        pairs: Contact and tied pairs.

    Raises:
        NotImplementedError: If a pair on a mesh of solids has what is not available there.
    """
    for pair in pairs:
        if pair.data.mesh.geometry.dim != 3:
            continue
        integration = pair.discretization.integration
        for what, needed in (
            ("self_contact", pair.master is None),
            ("integration", integration != "segments"),
            ("vertices", pair.discretization.basis == "vertices"),
        ):
            if needed:
                refuse_in_space(what, f"{pair!r}")
