# SPDX-License-Identifier: MIT
"""Active set and branches of the contact law, from the complementarity function."""

from __future__ import annotations

import numpy as np

from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.contact.laws import KINK
from fenics_mortar.utils.arrays import Flags
from fenics_mortar.utils.rounding import LAST_DIGITS


def next_sets(f: ContactFields, *, start: bool) -> tuple[ContactFields, Flags]:
    """Active set and branches by the complementarity function (local).

    Nodes in ``state.force_decided`` take the multipliers of their forces, open nodes those of the
    law.

    Args:
        f: Fields of the present state.
        start: Whether this precedes the first solve, with unknown pressures: touching nodes become
            active, and multipliers that are nan after a failed solve become zero.

    Returns:
        Fields of the new state, and marks of the changed nodes, shape (slave nodes,), bool.
    """
    before, state, o = f.state, f.state, f.operators
    z = np.where(np.isfinite(state.z), state.z, 0.0) if start else state.z
    if state.force_decided is not None:
        presses, force = state.force_decided
        presses = presses & f.covered
        z = np.where(presses[:, None], force / np.where(presses, o.weight, 1.0)[:, None], z)
    if z is not state.z:
        f = f.after(state.replaced(z=z, force_decided=None))
    active = _active(f, start=start)
    open_z = -f.adhesion[0][:, None] * o.n
    if f.sides.pair.law.bridges_gap:
        open_z += np.where(f.attracted, np.einsum("ja,ja->j", o.tau, z), 0.0)[:, None] * o.tau
    z = np.where(active[:, None], z, open_z)
    changed = active != before.active
    state = f.state.replaced(
        active=active if changed.any() else before.active, z=z, force_decided=None
    )
    f = f.after(state)
    branch = f.sides.law_calls.branch(f.sides.pair.law, f.nodal, state.branch, o.x)
    branched = branch != state.branch
    if branched.any():
        f = f.after(state.replaced(branch=branch))
    ruled = f.acts if f.sides.pair.law.bridges_gap else active
    return f, changed | (ruled & f.sides.follows_law & branched)


def _active(f: ContactFields, *, start: bool) -> Flags:
    """Nodes with z_n + a - c_n g > 0 (local).

    Unchanged if both are rounding: the pressure relative to the stiffness, the gap relative to the
    largest coordinate. With ``start``, touching nodes of unknown pressure are active, too.
    """
    stiffness, on = f.sides.modulus, f.covered
    gap = np.where(on, f.closing_gap, 0.0)
    push = np.where(f.attracted, 0.0, -f.tension)  # open nodes: z_n = -a
    trial = np.where(on, push - f.state.c_n * stiffness / f.nodal_lengths * gap, 0.0)
    rounding = (np.abs(push) <= LAST_DIGITS * stiffness) & (
        np.abs(gap) <= LAST_DIGITS * np.abs(f.operators.x).max()
    )
    active = np.where(rounding, f.state.active & on, trial > 0.0)
    if start:
        active |= on & (np.where(on, gap, np.inf) <= KINK * f.nodal_lengths)
    return active
