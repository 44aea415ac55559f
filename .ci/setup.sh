#!/bin/bash
# SPDX-License-Identifier: MIT
#
# Install the Debian packages that are missing, then check what is there.
#
#     bash .ci/setup.sh demo     what the demos need
#     bash .ci/setup.sh test     the same and what the tests need
#     bash .ci/setup.sh lint     the same and what .ci/lint.sh needs
#     bash .ci/setup.sh ci       the same and what .ci/run needs
#
# Exit codes: 0 all there; 10 packages could not be installed; 1 anything else.

set -euo pipefail
readonly not_installed=10
readonly python=/usr/bin/python3
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)

say() { echo "setup: $*"; }

# gcc: FFCx compiles each form when it is first used. openblas: see the README. venv: for
# "pip install ." in an environment, as demos/guide/installation.md says.
demo=(python3-dolfinx python3-numba python3-gmsh python3-scipy python3-matplotlib python3-meshio
    libopenblas0-pthread openmpi-bin gcc libc6-dev python3-dev python3-venv)
test=("${demo[@]}" python3-pytest python3-pytest-xdist python3-hypothesis
    python3-setuptools python3-wheel)
lint=("${test[@]}")
ci=("${lint[@]}" debootstrap)

case "${1:-}" in
    demo) packages=("${demo[@]}") ;;
    test) packages=("${test[@]}") ;;
    lint) packages=("${lint[@]}") ;;
    ci) packages=("${ci[@]}") ;;
    *)
        echo "usage: bash .ci/setup.sh demo|test|lint|ci" >&2
        exit 2
        ;;
esac

if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
    say "this is not a Debian system (no dpkg and apt): fenics_mortar is set up by Debian packages" >&2
    say "needed are Debian 12 or newer and: ${packages[*]}" >&2
    exit $not_installed
fi

# --- packages ----------------------------------------------------------------------------------
find_missing() {
    local installed package
    installed=" $(dpkg-query -W -f '${Package}=${db:Status-Status} ' "${packages[@]}" 2>/dev/null || true)"
    missing=()
    for package in "${packages[@]}"; do
        case "$installed" in
            *" $package=installed "*) ;;
            *) missing+=("$package") ;;
        esac
    done
}

find_missing
if [ ${#missing[@]} -gt 0 ]; then
    say "missing Debian packages: ${missing[*]}"
    install=(apt-get install --yes --no-install-recommends "${missing[@]}")
    if [ "$(id -u)" = 0 ]; then
        as_root=()
    elif command -v sudo >/dev/null && { sudo -n true 2>/dev/null || { [ -t 0 ] && [ -t 2 ]; }; }; then
        as_root=(sudo)
        say "not root: using sudo"
    else
        {
            say "you are neither root nor may you use sudo here. Ask an administrator to run:"
            echo
            echo "    apt-get update && ${install[*]}"
            echo
            say "then run this again: once nothing is missing, no rights are needed"
        } >&2
        exit $not_installed
    fi
    # One line for each step; what apt says is in the log, and shown if it fails.
    log=$(mktemp "${TMPDIR:-/tmp}/fenics_mortar-setup.XXXXXX.log")
    say "what apt says is kept in $log"
    as_admin() {
        local command=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive "$@") start=$SECONDS from
        from=$(($(wc -l <"$log") + 1))
        echo "+ ${command[*]}" >>"$log"
        if "${command[@]}" </dev/null >>"$log" 2>&1; then
            say "apt-get $2: done in $((SECONDS - start)) s"
        else
            say "apt-get $2: failed; the end of what it said:" >&2
            tail -n "+$from" "$log" | tail -n 40 >&2
            return 1
        fi
    }
    options=(-o DPkg::Lock::Timeout=300 -o Acquire::Retries=3 -o Dpkg::Use-Pty=0 -q)
    if ! as_admin apt-get update "${options[@]}"; then
        say "apt-get update failed; trying with the package lists that are there" >&2
    fi
    if ! as_admin "${install[@]}" "${options[@]}"; then
        say "apt-get could not install: ${missing[*]}" >&2
        exit $not_installed
    fi
    find_missing
    if [ ${#missing[@]} -gt 0 ]; then
        say "still missing after apt-get install: ${missing[*]}" >&2
        exit $not_installed
    fi
else
    say "all ${#packages[@]} Debian packages are installed"
fi

# --- what is there -----------------------------------------------------------------------------
# shellcheck source=.ci/env.sh
. "$here/env.sh" 2>/dev/null # the caller sources it too, and shows what it says
"$python" - <<'PYTHON'
import platform
import sys

try:
    import dolfinx
    import gmsh
    import numba
    import petsc4py.PETSc as PETSc
except Exception as error:
    sys.exit(
        f"setup: {sys.executable} (Python {platform.python_version()}) cannot import what Debian's "
        f"python3-dolfinx, python3-gmsh and python3-numba should give it: "
        f"{type(error).__name__}: {error}\n"
        f"setup: a variable such as PETSC_DIR or PYTHONPATH may point elsewhere; sys.path is {sys.path}"
    )
if PETSc.ScalarType is not __import__("numpy").float64:
    sys.exit(
        "setup: PETSc computes with complex numbers here; fenics_mortar needs the real build: unset "
        "PETSC_DIR or choose it by: update-alternatives --config petsc"
    )

with open("/proc/self/maps") as maps:
    libraries = {line.split()[-1] for line in maps if "/" in line}
blas = sorted(path for path in libraries if path.rsplit("/", 1)[-1].startswith("libblas.so"))
openblas = any("openblas" in path for path in libraries)
print(
    f"setup: {sys.executable} {platform.python_version()}, dolfinx {dolfinx.__version__}, "
    f"petsc4py {PETSc.Sys.getVersionInfo()['major']}.{PETSc.Sys.getVersionInfo()['minor']}, "
    f"numba {numba.__version__}, gmsh {gmsh.__version__}, "
    f"BLAS: {'OpenBLAS' if openblas else ', '.join(blas) or 'unknown'}"
)
if not openblas:
    import sysconfig

    arch = sysconfig.get_config_var("MULTIARCH")
    print(
        "setup: WARNING: OpenBLAS is installed but another BLAS was chosen; with the reference BLAS "
        "factorizations are 3 to 5 times slower. To change it, as root:\n"
        f"    update-alternatives --auto libblas.so.3-{arch}\n"
        f"    update-alternatives --auto liblapack.so.3-{arch}",
        file=sys.stderr,
    )
PYTHON
