#!/bin/bash
# SPDX-License-Identifier: MIT
#
# Set up this machine, then run a demo:
#
#     bash demos/run.sh              demo_two_blocks.py on 2 ranks
#     bash demos/run.sh hertz 4      demo_hertz.py on 4 ranks

set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

name=${1:-two_blocks}
ranks=${2:-2}
name=$(basename "$name" .py)
name=${name#demo_}
script="$root/demos/demo_$name.py"
if [ $# -gt 2 ] || [ ! -f "$script" ] || ! [[ "$ranks" =~ ^[1-9][0-9]*$ ]]; then
    echo "usage: bash demos/run.sh [DEMO [RANKS]]" >&2
    echo "demos:" >&2
    for file in "$root"/demos/demo_*.py; do
        file=$(basename "$file" .py)
        echo "    ${file#demo_}" >&2
    done
    exit 2
fi

bash "$root/.ci/setup.sh" demo
# shellcheck source=.ci/env.sh
. "$root/.ci/env.sh"
command=("$FENICS_MORTAR_MPIRUN" -n "$ranks" "$FENICS_MORTAR_PYTHON" "$script")
echo "+ ${command[*]}"
echo "(the first run compiles the kernels and forms, and keeps them for the next)"
start=$(date +%s)
"${command[@]}" </dev/null
if [ -n "$(find results -type f -newermt "@$start" -print -quit 2>/dev/null)" ]; then
    echo "done; the files are in $PWD/results"
else
    echo "done; this demo wrote no files (those that do, write to $PWD/results)"
fi
