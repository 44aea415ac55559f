# SPDX-License-Identifier: MIT
"""Model hierarchy: cheaper models as starting points, richer models to estimate model errors.

Input: a solved problem. Output: estimates of the errors of its assumptions (linear strain, small
sliding, rigid obstacles, no friction), and solutions of cheaper models if these suffice.
"""
