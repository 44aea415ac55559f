# SPDX-License-Identifier: MIT
"""Partial derivatives of the equations of one pair.

Input: an evaluated contact and, with friction, the state at the start of its step. Output:
derivatives of forces and rows with respect to state, previous state, law, shape and positions as
linear maps, with products along a direction and products of the transpose. Depends on pairs only.
"""
