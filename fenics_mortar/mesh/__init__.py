# SPDX-License-Identifier: MIT
"""Meshes with named bodies and boundaries, and the space of displacements.

In flow geometries of gmsh, files and the function space of a user. Out flow cell and facet tags by
name, Dirichlet conditions, and the dofs of the displacement. Contact is unknown here.
"""
