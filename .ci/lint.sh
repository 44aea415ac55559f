#!/bin/bash
# SPDX-License-Identifier: MIT
#
# Style, types and the import contract: ruff, mypy, import-linter, in a virtual environment of their
# own that sees Debian's packages. --fix: let ruff rewrite the files first.

set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
bash "$root/.ci/setup.sh" lint
# shellcheck source=.ci/env.sh
. "$root/.ci/env.sh"
cd "$root"

tools=(ruff==0.17.5 mypy==2.4.1 import-linter==2.16)
venv="${XDG_CACHE_HOME:-$HOME/.cache}/fenics_mortar/lint-venv"
wanted="${tools[*]} $(/usr/bin/python3 --version)"
if [ "$(cat "$venv/complete" 2>/dev/null || true)" != "$wanted" ]; then
    echo "lint: making $venv"
    rm -rf "$venv"
    /usr/bin/python3 -m venv --system-site-packages "$venv"
    # Inside this environment only: PYTHONPATH would hide what is installed there.
    env -u PYTHONPATH "$venv/bin/python" -m pip install --quiet "${tools[@]}"
    echo "$wanted" >"$venv/complete"
fi

failed=0
check() {
    echo
    echo "+ $*"
    "$venv/bin/$1" "${@:2}" || failed=1
}
if [ "${1:-}" = --fix ]; then
    check ruff check --fix .
    check ruff format .
fi
check ruff check .
check ruff format --check .
check mypy
check lint-imports
if [ $failed -ne 0 ]; then
    echo "lint: FAILED (bash .ci/lint.sh --fix repairs what can be repaired without thought)"
fi
exit $failed
