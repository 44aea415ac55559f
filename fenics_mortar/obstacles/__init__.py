# SPDX-License-Identifier: MIT
"""Rigid obstacles: signed distances with gradient and Hessian, their place, their loads.

In flow points of space; out flow distances and derivatives. Users place obstacles or load them;
meshes and multipliers are unknown here.
"""
