# SPDX-License-Identifier: MIT
"""The module ``gmsh`` of the demos and of these meshes: ``from meshes.with_gmsh import gmsh``.

Where it cannot be imported, as without the libraries of a desktop that its wheel needs, the error
says what to install.
"""

__all__ = ["gmsh"]

try:
    import gmsh
except (ImportError, OSError) as error:
    from fenics_mortar.utils.errors import MeshError
    from meshes import cure_of_gmsh

    raise MeshError(
        f"the Python module gmsh is needed to create this mesh: {error}; {cure_of_gmsh(error)}"
    ) from None
