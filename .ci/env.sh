# SPDX-License-Identifier: MIT
# shellcheck shell=bash
# Environment for running fenics_mortar from its checkout. To be sourced (". .ci/env.sh"), by bash
# or zsh; demos/run.sh and tests/run.sh do so. Values that are set already are kept.

_fm_root=$(cd "$(dirname "${BASH_SOURCE[0]:-$0}")/.." && pwd)
case ":${PYTHONPATH:-}:" in
    *":$_fm_root:"*) ;;
    *) export PYTHONPATH="$_fm_root${PYTHONPATH:+:$PYTHONPATH}" ;;
esac
# The Python and the mpirun of the set-up (.ci/setup.sh): those of this clone's .venv, if it was made, or
# Debian's. Neither sees packages of another Python or of ~/.local, which may hold a numpy that
# dolfinx was not built with.
if [ -e "$_fm_root/.venv/complete" ] && [ "${FENICS_MORTAR_SETUP:-}" != debian ]; then
    export FENICS_MORTAR_PYTHON="$_fm_root/.venv/bin/python"
    export FENICS_MORTAR_MPIRUN="$_fm_root/.venv/bin/mpirun"
    case ":$PATH:" in
        *":$_fm_root/.venv/bin:"*) ;;
        *) export PATH="$_fm_root/.venv/bin:$PATH" ;;
    esac
else
    export FENICS_MORTAR_PYTHON=/usr/bin/python3
    export FENICS_MORTAR_MPIRUN=/usr/bin/mpirun.openmpi
fi
unset PYTHONHOME
export PYTHONNOUSERSITE=1

# One thread per rank: the ranks share the cores.
export OMP_NUM_THREADS="${OMP_NUM_THREADS:-1}"
export OPENBLAS_NUM_THREADS="${OPENBLAS_NUM_THREADS:-1}"
export NUMBA_NUM_THREADS="${NUMBA_NUM_THREADS:-1}"

# Open MPI: may run as root (a container), and with more ranks than cores. (Waiting ranks then yield; if
# they always did, two ranks on two cores would take 4 % longer.) The word for "more ranks than cores"
# changes with each release. From release 5 on, only the transports within one machine: else a machine
# without network brings warnings. On several machines, unset pml and btl.
export OMPI_ALLOW_RUN_AS_ROOT="${OMPI_ALLOW_RUN_AS_ROOT:-1}"
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="${OMPI_ALLOW_RUN_AS_ROOT_CONFIRM:-1}"
export HWLOC_HIDE_ERRORS="${HWLOC_HIDE_ERRORS:-2}"
_fm_mpi=$(dpkg-query -W -f '${Version}' openmpi-bin 2>/dev/null || true)
_fm_mpi=${_fm_mpi%%.*}
case "$_fm_mpi" in
    [1-4])
        export OMPI_MCA_rmaps_base_oversubscribe="${OMPI_MCA_rmaps_base_oversubscribe:-1}"
        ;;
    5)
        export PRTE_MCA_rmaps_default_mapping_policy="${PRTE_MCA_rmaps_default_mapping_policy:-:oversubscribe}"
        ;;
    *)
        export PRTE_MCA_mapby="${PRTE_MCA_mapby:-:oversubscribe}"
        ;;
esac
case "$_fm_mpi" in
    [1-4]) ;;
    *)
        export OMPI_MCA_pml="${OMPI_MCA_pml:-ob1}"
        export OMPI_MCA_btl="${OMPI_MCA_btl:-self,sm}"
        ;;
esac

# FFCx and numba cache what they compile below $XDG_CACHE_HOME or ~/.cache, if that can be written.
_fm_cache="${XDG_CACHE_HOME:-${HOME:-/nonexistent}/.cache}"
if ! { mkdir -p "$_fm_cache" && [ -w "$_fm_cache" ]; } 2>/dev/null; then
    _fm_cache="${TMPDIR:-/tmp}/fenics_mortar-cache-$(id -u)"
    (umask 077 && mkdir -p "$_fm_cache")
    if [ -O "$_fm_cache" ]; then
        export XDG_CACHE_HOME="$_fm_cache"
        export MPLCONFIGDIR="${MPLCONFIGDIR:-$_fm_cache/matplotlib}"
        echo "fenics_mortar: the home folder cannot be written; caches are in $_fm_cache" >&2
    else
        echo "fenics_mortar: no writable cache folder; set XDG_CACHE_HOME" >&2
    fi
fi
unset _fm_root _fm_mpi _fm_cache
