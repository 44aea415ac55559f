# SPDX-License-Identifier: MIT
"""The laws of an interface: active set, complementarity, friction, ties, and their rows.

In flow mortar operators and multipliers. Out flow nodal quantities (pressure, gap, slip), sets, and
the linearized rows of the multipliers. Bulk and linear algebra are unknown here.
"""
