# SPDX-License-Identifier: MIT
"""The discretised interface: surfaces, segments, D, M, the weighted gap, and all derivatives.

Input: present positions of two surfaces, or of a surface and an obstacle. Output: mortar operators
as frozen values, with derivatives with respect to nodal positions. Independent of forces, laws and
active sets.
"""
