# SPDX-License-Identifier: MIT
"""The model hierarchy: cheaper models to start from, richer models to estimate model errors.

Input is a solved problem. Output are estimates of the errors of its assumptions (linear strain,
small sliding, rigid obstacles, no friction), and solutions of cheaper models where these suffice.
"""
