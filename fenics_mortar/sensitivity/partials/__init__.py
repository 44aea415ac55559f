# SPDX-License-Identifier: MIT
"""Partial derivatives of the equations of one pair.

Input are an evaluated contact and, with friction, the state at the start of its step. Output are
derivatives of forces and rows with respect to state, previous state, law, shape and positions as
linear maps: products along a direction, and products of the transpose. The folder depends on pairs
only.
"""
