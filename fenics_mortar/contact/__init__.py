# SPDX-License-Identifier: MIT
"""Laws of an interface: active set, complementarity, friction, ties, and their rows.

Input: mortar operators and multipliers. Output: nodal quantities (pressure, gap, slip), active
sets, and the linearized rows of the multipliers. Independent of bulk and linear algebra.
"""
