# SPDX-License-Identifier: MIT
"""The discretised interface: surfaces, segments, D, M, the weighted gap, and all derivatives.

In flow the present positions of two surfaces, or of one and an obstacle. Out flow mortar operators,
frozen, with derivatives with respect to the nodes. Forces, laws and active sets are unknown here.
"""
