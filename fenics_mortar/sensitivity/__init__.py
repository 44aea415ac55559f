# SPDX-License-Identifier: MIT
"""Derivatives of solutions by loads, material, laws and shapes, through the steps of a path.

Input are a solved problem or a recorded path, an objective and controls. Output are the derivatives
of the objective by the controls, exact at the active sets and branches of the states: by the
adjoint method (``gradient``) or in one direction (``tangent_linear``).
"""
