# SPDX-License-Identifier: MIT
"""Linear algebra: patterns, saddle-point and condensed systems, multigrid.

In flow the bulk tangent and the rows of all interfaces. Out flow the increments of displacements,
multipliers and obstacles, by factors or by preconditioned iterations.
"""
