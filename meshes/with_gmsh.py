# SPDX-License-Identifier: MIT
"""The module ``gmsh`` of the demos and of these meshes: ``from meshes.with_gmsh import gmsh``.

Where it cannot be imported, as without the libraries of a desktop that its wheel needs, the error
is that of ``fm.read_gmsh``, which says what to install.
"""

__all__ = ["gmsh"]

try:
    import gmsh
except (ImportError, OSError) as error:
    from fenics_mortar.utils.compat import missing_gmsh

    raise missing_gmsh("to create this mesh", error) from None
