# SPDX-License-Identifier: MIT
"""Random problems beyond plane statics, checked by closed forms, conservation or own sums.

==============  ============================================================================
family          problems and judges
==============  ============================================================================
revolved        stacked cylinders: uniform pressure; tubes with interference: Lame; both
                axisymmetric
moving          two blocks that collide in flight: momentum, energy; a bar on a wall: waves
memory          a column on a turned plane: wear, soft layer, cohesive zone, Stribeck,
                rate and state
itself          C-rings closed by found and by chosen sides; folding honeycombs
turning         obstacles that turn by up to 8 radian in a step: sampled motion
spinning        wheels and shafts with friction: work is moment times angle; whole problems
idle            bodies without load beside a pressed block: no force, no overlap
cracks          straight cracks that open, slide or stick as in a plane; two ways
towers          in space: blocks without supports; limit analysis, own sums and distances
patches         in space: blocks pulled in any direction; own sums, distances and slips
plates          in space: thin plates bent onto balls; likewise
tools           in space: rough obstacles that move and turn; likewise
==============  ============================================================================

Each draw returns the drawn values as text, and a function that solves the problem and returns the
reports of its solves, messages on errors, and remarks.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from typing import Any

import numpy as np

import fenics_mortar as fm
from demos.studies.stability.random_cracks import draw_cracks
from demos.studies.stability.random_idle import draw_idle
from demos.studies.stability.random_itself import draw_itself
from demos.studies.stability.random_memory import draw_memory
from demos.studies.stability.random_moving import draw_moving
from demos.studies.stability.random_patches import draw_patches
from demos.studies.stability.random_plates import draw_plates
from demos.studies.stability.random_revolved import draw_revolved
from demos.studies.stability.random_spinning import draw_spinning
from demos.studies.stability.random_tools import draw_tools
from demos.studies.stability.random_towers import draw_towers
from demos.studies.stability.random_turning import draw_turning

DRAWS: dict[str, Callable[[np.random.Generator], tuple[dict[str, Any], Callable[[], Any]]]] = {
    "revolved": draw_revolved,
    "moving": draw_moving,
    "memory": draw_memory,
    "itself": draw_itself,
    "turning": draw_turning,
    "spinning": draw_spinning,
    "idle": draw_idle,
    "cracks": draw_cracks,
    "towers": draw_towers,
    "patches": draw_patches,
    "plates": draw_plates,
    "tools": draw_tools,
}


def run_physics(family: str, number: int) -> dict[str, Any]:
    """Record of one case, see ``trial``: drawn from its number, solved and judged."""
    about, solve = DRAWS[family](np.random.default_rng(number))
    record: dict[str, Any] = {"seed": number, "outcome": "crash", "reason": "", **about}
    begin = time.perf_counter()
    try:
        reports, errors, remarks = solve()
        per_step = [report.num_iterations for report in reports]
        record |= {"outcome": "wrong" if errors else "converged", "reason": "; ".join(errors)}
        record |= {"steps": len(per_step), "cuts": 0, "per_step": per_step, "remarks": remarks}
    except fm.MortarError as error:
        record |= {"outcome": "failed", "reason": str(error)}
    except Exception as error:
        record |= {"reason": repr(error), "traceback": traceback.format_exc()}
    record["seconds"] = time.perf_counter() - begin
    return record
