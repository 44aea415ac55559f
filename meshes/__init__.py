# SPDX-License-Identifier: MIT
"""Meshes of the demos, studies and tests: functions that build gmsh models, or arrays of grids."""


def cure_of_gmsh(error: Exception) -> str:
    """What to install after an ``import gmsh`` that failed with ``error`` (local).

    The wheel needs libraries of a desktop, which it does not bring.
    """
    if isinstance(error, ImportError):
        return "install gmsh: by apt-get install python3-gmsh (Debian), or pip install gmsh"
    return (
        "gmsh's wheel needs libraries of the system; as root: apt-get install libglu1-mesa libgl1 "
        "libxcursor1 libxft2 libxinerama1 libgomp1 (Debian, Ubuntu), or dnf install mesa-libGLU "
        "mesa-libGL libXcursor libXft libXinerama libgomp (Fedora)"
    )
