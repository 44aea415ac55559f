# SPDX-License-Identifier: MIT
"""Active set and branches of the contact law, from the complementarity function."""

from __future__ import annotations

import numpy as np

from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.contact.laws import KINK
from fenics_mortar.kernels import complementarity
from fenics_mortar.utils.rounding import LAST_DIGITS


def next_sets(f: ContactFields, *, start: bool) -> tuple[ContactFields, int]:
    """Active set and branches by the complementarity function (local).

    Nodes in ``state.force_decided`` take the multipliers of their forces, open nodes those of the
    law. Nodes of idle bodies are open.

    Args:
        f: Fields of the present state.
        start: Whether this precedes the first solve, with unknown pressures: touching nodes become
            active, and multipliers that are nan after a failed solve become zero.

    Returns:
        Fields of the new state, and the number of changed nodes.
    """
    before, state, o = f.state, f.state, f.operators
    z = state.z
    if start and not np.isfinite(z).all():
        z = np.where(np.isfinite(z), z, 0.0)
    if state.force_decided is not None:
        presses, force = state.force_decided
        presses = presses & f.covered
        z = np.where(presses[:, None], force / np.where(presses, o.weight, 1.0)[:, None], z)
    if z is not state.z:
        f = f.after(state.replaced(z=z, force_decided=None))
    may_close = f.covered & ~f.interface.set_aside
    law, active, new = f.interface.pair.law, np.empty(len(o.n), bool), np.empty(o.n.shape)
    resets, moves = complementarity.update_sets(
        f.covered_gap, may_close, f.z_n, f.state.z, o.n, f.adhesion[0], f.attracted,
        bool(law.bridges_gap), float(state.c_n), f.interface.modulus, f.interface.foundation,
        f.nodal_lengths, KINK if start else -np.inf, o.x, LAST_DIGITS, before.active, active, new,
    )  # fmt: skip
    changes = {"active": active} if resets else {}
    if changes or moves:
        f = f.after(f.state.replaced(z=new, **changes))
    branch = f.interface.law_calls.branch(law, f.nodal, before.branch, o.x)
    branched = branch != before.branch
    if branched.any():
        f = f.after(f.state.replaced(branch=branch))
    elif not resets:
        return f, 0
    ruled = f.acts if law.bridges_gap else active
    changed = (active != before.active) | (ruled & f.interface.follows_law & branched)
    return f, int(np.count_nonzero(changed))
