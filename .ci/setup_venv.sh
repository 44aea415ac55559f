# SPDX-License-Identifier: MIT
# shellcheck shell=bash disable=SC2154,SC2034
# Set-up of a virtual environment by pip, for .ci/setup.sh, which sources this.

readonly pip_load=270 pip_disk=920 # measured with Python 3.13 [MB]
readonly more="other ways: demos/guide/installation.md"

# What is installed depends on this file; scripts in the environment on where it is.
venv_wanted() { echo "$root $(cksum <"$root/pyproject.toml")"; }

setup_venv() {
    local log python
    if [ "$(cat "$venv/complete" 2>/dev/null)" = "$(venv_wanted)" ] && "$venv/bin/python" -c "" 2>/dev/null; then
        say "$venv is complete"
        return
    fi
    check_system
    find_python
    check_compiler
    if [ -e "$venv" ] && [ ! -e "$venv/made_by_setup" ]; then
        give_up "$venv was not made by this script: remove it, or give it another name"
    fi
    say "$("$python" --version) in $venv: about $pip_load MB to load, $pip_disk MB on disk"
    start_log pip
    rm -rf "$venv"
    mkdir "$venv"
    touch "$venv/made_by_setup"
    "$python" -m venv "$venv" >>"$log" 2>&1 || give_up "$python -m venv failed; it said:" "$(tail -n 5 "$log")"
    # Inside this environment only: PYTHONPATH would hide what is installed there.
    logged "pip" how_far_pip env -u PYTHONPATH -u PYTHONHOME "$venv/bin/python" -m pip install \
        --disable-pip-version-check --progress-bar off --no-input --editable "${root}[dolfinx,test]" ||
        give_up "pip could not install dolfinx and the rest of pyproject.toml in $venv" "$more"
    venv_wanted >"$venv/complete"
}

how_far_pip() { # of "Downloading numpy-2.5.whl (15.7 MB)" and "Using cached ..."
    awk -v load=$pip_load -v disk=$pip_disk -v done="$(du -sm "$venv" | cut -f 1)" '
        $1 " " $2 == "Using cached" { $1 = ""; $0 = $0 }
        $1 ~ /^(Downloading|cached)$/ && $2 ~ /\.whl$/ {
            size = substr($3, 2)
            mb += $4 ~ /^MB/ ? size : $4 ~ /^kB/ ? size / 1000 : 0
            split($2, name, "-")
        }
        /^Installing collected packages/ { installs = 1 }
        END {
            if (installs) printf "installing, %d of about %d MB on disk\n", done, disk
            else if (mb) printf "loading %s, with it %d of about %d MB\n", name[1], mb, load
            else print "looking up what is needed"
        }'
}

# --- what the wheels need -----------------------------------------------------------------------
check_system() {
    local glibc
    [ "$(uname -sm)" = "Linux x86_64" ] || give_up "this is $(uname -sm): there are wheels of dolfinx for" \
        "Linux on x86-64 (x86_64) only; on Debian set FENICS_MORTAR_SETUP=debian; $more"
    glibc=$(getconf GNU_LIBC_VERSION 2>/dev/null || echo "no glibc")
    glibc=${glibc#glibc }
    printf '%s\n' 2.34 "$glibc" | sort -C -V && [[ "$glibc" != no* ]] ||
        give_up "the C library is glibc $glibc; the wheels of dolfinx need glibc 2.34 or newer, as in" \
            "Debian 12, Ubuntu 22.04, Fedora 35, RHEL 9; $more"
}

# Releases for which there are wheels, the newest one first; a name may be there that does not run.
find_python() { # sets $python
    for python in python3.14 python3.13 python3.12 python3; do
        python=$(command -v "$python") || continue
        if "$python" -c "import sys; sys.exit(not (3, 12) <= sys.version_info[:2] <= (3, 14))" 2>/dev/null; then
            return
        fi
    done
    give_up "no Python 3.12 to 3.14 is on PATH. Install one; as root:" \
        "    apt-get install python3 python3-venv python3-dev gcc libc6-dev    (Debian 13, Ubuntu 24.04)" \
        "    dnf install python3.13 python3.13-devel gcc                       (Fedora, RHEL: 3.12)" \
        "or, without root, by conda, pyenv or uv"
}

check_compiler() {
    local lacking=() cc include version said
    if ! "$python" -c "import ensurepip, venv" 2>/dev/null; then
        lacking+=("the Python modules venv and ensurepip")
    fi
    version=$("$python" -c "import sys; print('python%d.%d' % sys.version_info[:2])")
    include=$("$python" -c "import sysconfig; print(sysconfig.get_path('include'))")
    read -ra cc <<<"${CC:-$("$python" -c "import sysconfig; print(sysconfig.get_config_var('CC') or 'cc')")}"
    if ! command -v "${cc[0]}" >/dev/null; then
        lacking+=("the C compiler ${cc[0]}, with which FFCx compiles forms when they are used")
    elif ! said=$("${cc[@]}" -fsyntax-only -I"$include" -x c - 2>&1 <<<"#include <Python.h>"); then
        lacking+=("headers of C and Python, with which FFCx compiles forms when they are used:"
            "    ${said%%$'\n'*}")
    fi
    [ ${#lacking[@]} = 0 ] || give_up "missing for $python:" "${lacking[@]/#/    }" \
        "Install them; as root:" \
        "    apt-get install $version-venv $version-dev gcc libc6-dev    (Debian, Ubuntu)" \
        "    dnf install python3-devel gcc                               (Fedora; else $version-devel)" \
        "or without root a Python that comes with its headers, by conda, pyenv or uv, and the compiler of" \
        "conda-forge, with its name in CC"
}
