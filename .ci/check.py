# SPDX-License-Identifier: MIT
"""Check that what ``.ci/setup.sh`` installed can be imported; print the releases.

    python check.py KIND

Without gmsh demos may run whose meshes are arrays; for other kinds that is an error.
"""

import platform
import sys
import sysconfig


def fail(*lines):
    """End with lines on what is wrong."""
    sys.exit("\n".join(f"setup: {line}" for line in lines))


def imported():
    """The modules dolfinx, numba and PETSc."""
    try:
        import mpi4py.MPI  # noqa: F401  before dolfinx, whose wheel has its libraries from there
        import petsc4py.PETSc as PETSc

        import numba

        import dolfinx
    except Exception as error:
        fail(
            f"{sys.executable} (Python {platform.python_version()}) cannot import what was "
            f"installed for it: {type(error).__name__}: {error}",
            "a variable such as PETSC_DIR or PYTHONPATH may point elsewhere; sys.path is "
            f"{sys.path}",
        )
    return dolfinx, numba, PETSc


def release_of_gmsh(kind):
    """Release of gmsh, "none" if it cannot be imported and is not needed."""
    try:
        import gmsh
    except (ImportError, OSError) as error:
        from meshes import cure_of_gmsh

        lines = (f"gmsh cannot be imported: {error}", cure_of_gmsh(error))
        if kind != "demo":
            fail(*lines)
        print(f"setup: {lines[0]}")
        print(
            "setup: demos and scripts that import it stop with this error; the main demo does not"
        )
        print(f"setup: {lines[1]}")
        return "none"
    return gmsh.__version__


def main(kind):
    """Import all, and print one line on it; see ``.ci/setup.sh`` for ``kind``."""
    dolfinx, numba, PETSc = imported()
    if PETSc.ScalarType().dtype.kind == "c":
        fail(
            "PETSc computes with complex numbers here; fenics_mortar needs the real build: unset "
            "PETSC_DIR or choose it by: update-alternatives --config petsc"
        )
    gmsh = release_of_gmsh(kind)
    major, minor = (PETSc.Sys.getVersionInfo()[part] for part in ("major", "minor"))
    blas = chosen_blas()
    print(
        f"setup: {sys.executable} {platform.python_version()}, dolfinx {dolfinx.__version__}, "
        f"petsc4py {major}.{minor}, numba {numba.__version__}, gmsh {gmsh}, BLAS: {blas}"
    )
    if blas != "OpenBLAS":
        arch = sysconfig.get_config_var("MULTIARCH")
        print(
            "setup: WARNING: OpenBLAS is installed but another BLAS was chosen; with the reference "
            "BLAS factorizations are 3 to 5 times slower. To change it, as root:\n"
            f"    update-alternatives --auto libblas.so.3-{arch}\n"
            f"    update-alternatives --auto liblapack.so.3-{arch}",
            file=sys.stderr,
        )


def chosen_blas():
    """Name of the BLAS in this process, the path of the library if it is not OpenBLAS."""
    with open("/proc/self/maps") as maps:
        libraries = {line.split()[-1] for line in maps if "/" in line}
    if any("openblas" in path for path in libraries):
        return "OpenBLAS"
    blas = sorted(path for path in libraries if path.rsplit("/", 1)[-1].startswith("libblas.so"))
    return ", ".join(blas) or "unknown"


if __name__ == "__main__":
    main(*sys.argv[1:])
