#!/bin/bash
# SPDX-License-Identifier: MIT
#
# Set up this machine, then run the tests:
#
#     bash tests/run.sh                in serial, on 2 or 3 ranks, few cells on 3, kernels without JIT
#     bash tests/run.sh serial 3       some of these runs: serial, 2, 3, few, kernels; "five": few cells on 5
#     bash tests/run.sh -k patch       in serial only, with arguments for pytest, which begin with one of
#                                      its options or with a path below tests/
# Before these:
#     --cases N        how many cases of each test function run in serial (2; with arguments for pytest
#                      and 0: all)
#     --without NAMES  what is left out in serial, named as pytest does, "tests/io tests/la/test_a.py::test_b",
#                      or by a marker, "once"
#
# A run in which no test ends for 1200 s counts as hanging; how long a run takes does not matter, as on
# a slow machine.

set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
bash "$root/.ci/setup.sh" test
# shellcheck source=.ci/env.sh
. "$root/.ci/env.sh"
cd "$root"
# Waiting ranks yield: other programs may use the cores during tests.
export OMPI_MCA_mpi_yield_when_idle="${OMPI_MCA_mpi_yield_when_idle:-1}"

limit=1200 # seconds without the end of a test
scratch=$(mktemp -d "${TMPDIR:-/tmp}/fenics_mortar-tests.XXXXXX")
trap 'rm -rf "$scratch"' EXIT
color=no # decided here: mpirun gives each rank a terminal of its own
if [ -t 1 ]; then color=yes; fi
pytest=("$FENICS_MORTAR_PYTHON" -m pytest "--color=$color")
# Files of tests over the cores; each test is on one rank. (nproc would answer with OMP_NUM_THREADS.)
spread=(-n "$(env -u OMP_NUM_THREADS nproc)" --dist loadfile)
# xdist 3.7 and later would begin with files of many tests, not with those of long ones.
if "${pytest[@]}" --help | grep -q no-loadscope-reorder; then spread+=(--no-loadscope-reorder); fi
# Each file runs in serial and on several ranks: on three those that partitions matter to most. Of the
# scenes that friction holds those of test_floating and test_redundancy do.
on_three=(tests/interface/test_{surfaces,bad_surfaces,operators}.py
    tests/contact/test_{contact,initial_gap,friction_history}.py tests/mesh/test_{mesh,dirichlet,mesh_scripts}.py
    tests/problem/test_{not_finite,bad_spaces,bad_options}.py tests/io/test_results.py
    tests/equations/test_{singular,no_convergence}.py tests/la/test_system.py tests/utils/test_compat.py
    tests/bulk/test_cell_blocks.py
    tests/path/test_{stepping,dead_end}.py tests/verification/test_invariance.py)
# Every public method where most ranks have no cells.
few=tests/problem/test_few_cells.py
failed=0
summary=()
without=()

run() { # TITLE COMMAND...: run it, and note how it ended
    local title=$1 code=0 start=$SECONDS outcome=passed
    shift
    echo
    echo "##### $title"
    # Also prints the tests that failed or were running, if the run is stopped.
    "$FENICS_MORTAR_PYTHON" "$root/tests/watch.py" "$limit" "$@" || code=$?
    if [ $code -ne 0 ]; then
        failed=1
        outcome="FAILED (exit code $code)"
        if [ $code -eq 124 ]; then
            outcome="FAILED (stopped: no test ended for $limit s)"
        fi
        echo
        echo "##### $title: $outcome"
    fi
    summary+=("$(printf '%-42s %5d s  %s' "$title" $((SECONDS - start)) "$outcome")")
    return $code
}

run_ranks() { # TITLE N ARGUMENTS...: pytest on N ranks; rank 0 prints, the others only if something failed
    local title="$1 on $2 ranks" ranks=$2 logs file
    logs=$(mktemp -d "$scratch/ranks.XXXXXX")
    shift 2
    # shellcheck disable=SC2016
    if ! run "$title" "$FENICS_MORTAR_MPIRUN" -n "$ranks" bash -c '
        logs=$1; shift
        rank=${OMPI_COMM_WORLD_RANK:-${PMI_RANK:?not started by Open MPI or MPICH}}
        if [ "$rank" != 0 ]; then exec >"$logs/rank-$rank" 2>&1; fi
        exec "$@"' rank "$logs" "${pytest[@]}" -p no:cacheprovider "$@"; then
        for file in "$logs"/rank-*; do
            echo "##### $(basename "$file") of $ranks, the end of its output"
            tail -n 200 "$file" || true
            echo
        done
    fi
}

leave_out() { # NAMES: in serial
    local name markers=""
    for name in $1; do
        case "$name" in
            *::*) without+=("--deselect=$name") ;;
            tests/*) without+=("--ignore=$name") ;;
            *) markers+="${markers:+ and }not $name" ;;
        esac
    done
    if [ -n "$markers" ]; then without+=(-m "$markers"); fi
}

while [[ "${1:-}" == --cases* || "${1:-}" == --without* ]]; do
    if [[ "$1" == *=* ]]; then set -- "${1%%=*}" "${1#*=}" "${@:2}"; fi
    case "$1" in
        --cases) cases=$2 ;;
        --without) leave_out "$2" ;;
    esac
    shift 2
done
if [[ "${1:-}" == -* || "${1:-}" == tests/* || "${1:-}" == /* ]]; then
    run "tests in serial: $*" "${pytest[@]}" "${without[@]}" "--cases=${cases:-0}" "$@" || true
else
    if [ $# = 0 ]; then set -- serial 2 3 few kernels; fi
    pytest+=("--cases=${cases:-2}")
    parallel=(-m "not serial")
    for name in "$@"; do
        case "$name" in
            serial) run "tests in serial" "${pytest[@]}" "${spread[@]}" --durations=15 --durations-min=4 "${without[@]}" || true ;;
            2) run_ranks tests 2 "${parallel[@]}" --ignore-glob='tests/rigid/test_supported*.py' --ignore="$few" "${on_three[@]/#/--ignore=}" ;;
            3) run_ranks tests 3 "${parallel[@]}" "${on_three[@]}" ;;
            few) run_ranks "few cells" 3 "${parallel[@]}" "$few" ;;
            five) run_ranks "few cells" 5 "${parallel[@]}" "$few" ;;
            kernels)
                run "kernel tests without numba's JIT" env NUMBA_DISABLE_JIT=1 \
                    "${pytest[@]}" "${spread[@]}" -p no:cacheprovider tests/kernels || true
                ;;
            *)
                echo "there is no run '$name'; the runs are serial, 2, 3, few, five, kernels" >&2
                exit 2
                ;;
        esac
    done
fi

echo
echo "##### summary"
printf '%s\n' "${summary[@]}"
exit $failed
