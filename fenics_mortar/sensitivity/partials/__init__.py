# SPDX-License-Identifier: MIT
"""Partial derivatives of the equations of one pair.

Input: an evaluated contact and, with friction, the state at the start of its step. Output:
derivatives of forces, rows and memory with respect to state, previous state, law, shape and
positions as sparse matrices, equal on all ranks. Depends on pairs only.
"""
