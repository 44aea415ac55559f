# SPDX-License-Identifier: MIT
"""Linear algebra: patterns, saddle-point and condensed systems, multigrid.

Input: bulk tangent and rows of all interfaces. Output: increments of displacements, multipliers and
obstacles, by factorization or by preconditioned iterations.
"""
