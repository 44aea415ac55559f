# SPDX-License-Identifier: MIT
"""Rigid obstacles: signed distances with gradient and Hessian, their place, their loads.

Input: points in space; output: distances and derivatives. Users prescribe positions or loads.
Independent of meshes and multipliers.
"""
