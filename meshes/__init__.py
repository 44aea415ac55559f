# SPDX-License-Identifier: MIT
"""Meshes of the demos, studies and tests: functions that build gmsh models, or arrays of grids."""
