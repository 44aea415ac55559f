# SPDX-License-Identifier: MIT
"""Meshes with named bodies and boundaries, and the space of displacements.

Input are models and files of gmsh and the function space of a user. Output are cell and facet tags
by name, Dirichlet conditions, and the dofs of the displacement. Nothing depends on contact.
"""
