# SPDX-License-Identifier: MIT
"""Relative differences below which numbers are considered equal."""

from __future__ import annotations

import numpy as np

# Spacing of double precision numbers at one, and the smallest positive normal number.
EPSILON = float(np.finfo(float).eps)
TINY = float(np.finfo(float).tiny)
# Results of a few operations that are equal in exact arithmetic differ by less than this fraction
# of the largest number in them [1]: 45 EPSILON.
LAST_DIGITS = 1e-14
# Results of whole computations that are equal in exact arithmetic differ by less than this fraction
# of the largest number in them [1]: seven digits more than EPSILON, for sums and cancellation.
ROUNDING = 1e-9
# Relative error of sums of up to thousands of terms, without cancellation [1].
SUM_ROUNDING = 1e-12
# Relative roundoff of assembled vectors and their resultants: sums of some hundred products [1].
ASSEMBLY_ROUNDING = 1e-13
# Relative size below which a quantity that vanishes at a solution is zero [1]: Newton's method
# stops at 1e-8.
SOLVED = 1e-6
# Positions are the same within this fraction of a facet [1]: coordinates in files may have as few
# as seven digits.
SAME_PLACE = 1e-6
# Half a facet [facet lengths], the resolution of a mesh. Faceted curves in contact are nearer to
# each other; deeper overlaps, and wider gaps between nodes in contact, are errors.
HALF_FACET = 0.5
# Frames that differ by less than this angle [radian] need not be rotated into each other: vectors,
# as contact forces with small sliding, differ by 2 % across and 0.02 % along, paths of length L by
# L / 200.
SMALL_ANGLE = 0.02
# Maximum number of steps of an iteration per unknown. Bisection of an interval of length 2 down to
# rounding takes 54, Newton's method for a few numbers 3 to 5, Lemke's method less than one pivot
# per variable.
MAX_STEPS = 60
