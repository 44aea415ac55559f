#!/bin/bash
# SPDX-License-Identifier: MIT
#
# Install what is missing, then check what is there.
#
#     bash .ci/setup.sh demo     what the demos need
#     bash .ci/setup.sh test     the same and what the tests need
#     bash .ci/setup.sh lint     the same and what .ci/lint.sh needs
#     bash .ci/setup.sh ci       the same and what .ci/run needs
#     bash .ci/setup.sh demo 60  with a line on how far a long command is every 60 s, not 10
#
# On Debian, if no package is missing or we may install it: Debian's packages (.ci/setup_debian.sh).
# Otherwise, on another distribution or without these rights: wheels in a virtual environment, .venv of
# this clone (.ci/setup_venv.sh). Once made, it is used; remove it to decide anew. lint and ci need Debian.
#
# FENICS_MORTAR_SETUP    debian or venv: one of these two, whatever is there
#
# Exit codes: 0 all there; 10 something could not be installed; 1 anything else.

set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(dirname "$here")
kind=${1:-}
way=${FENICS_MORTAR_SETUP:-}
interval=${2:-10}
readonly here root kind interval venv="$root/.venv" not_installed=10

say() { echo "setup: $*"; }
give_up() { # LINES...: what is wrong, and the cure
    printf 'setup: %s\n' "$@" >&2
    exit $not_installed
}

# --- long commands: lines on how far they are, the rest in a log --------------------------------
start_log() {
    log=$(mktemp "${TMPDIR:-/tmp}/fenics_mortar-setup.XXXXXX.log")
    say "what $1 says is kept in $log"
}

logged() { # NAME HOW_FAR COMMAND...: HOW_FAR makes a line of what the command has said up to now
    local name=$1 how_far=$2 start=$SECONDS from code=0 reporter
    shift 2
    from=$(($(wc -l <"$log") + 1))
    echo "+ $*" >>"$log"
    report "$name" "$how_far" "$from" &
    reporter=$!
    "$@" </dev/null >>"$log" 2>&1 || code=$?
    kill "$reporter" 2>/dev/null || true
    wait "$reporter" 2>/dev/null || true
    if [ $code = 0 ]; then
        say "$name: done in $((SECONDS - start)) s"
    else
        say "$name: failed; the end of what it said:" >&2
        tail -n "+$from" "$log" | tail -n 40 >&2
    fi
    return $code
}

report() { # NAME HOW_FAR FROM: a line in each interval, as long as this script runs
    local start=$SECONDS line
    while sleep "$interval" &>/dev/null && kill -0 $$ 2>/dev/null; do
        line=$(tail -n "+$3" "$log" | "$2" || true)
        say "$1, $((SECONDS - start)) s: ${line:-starts}"
    done
}

# --- which way ----------------------------------------------------------------------------------
# shellcheck source=.ci/setup_debian.sh
. "$here/setup_debian.sh"
# shellcheck source=.ci/setup_venv.sh
. "$here/setup_venv.sh"

case "$kind" in
    demo | test) ;;
    lint | ci) way=debian ;;
    *)
        echo "usage: bash .ci/setup.sh demo|test|lint|ci [SECONDS]" >&2
        exit 2
        ;;
esac
case "$way" in
    debian | venv) ;;
    "")
        way=venv
        if [ ! -e "$venv/complete" ] && is_debian; then
            find_missing
            if [ ${#missing[@]} = 0 ] || find_rights; then
                way=debian
            else
                say "Debian's packages are not all there, and you are neither root nor may you use sudo here:"
                say "instead, all is installed by pip, in this clone. For Debian's packages (tested with each"
                say "change) ask an administrator to run this, and then remove $venv:"
                print_install
            fi
        fi
        ;;
    *) give_up "FENICS_MORTAR_SETUP is '$way'; right is debian or venv" ;;
esac
"setup_$way"

# --- what is there -----------------------------------------------------------------------------
# shellcheck source=.ci/env.sh
FENICS_MORTAR_SETUP=$way . "$here/env.sh" 2>/dev/null # the caller sources it too, and shows what it says
"$FENICS_MORTAR_PYTHON" "$here/check.py" "$kind"
