# SPDX-License-Identifier: MIT
# shellcheck shell=bash disable=SC2154
# Set-up by Debian's packages, for .ci/setup.sh, which sources this.

# gcc: FFCx compiles each form when it is first used. openblas: see the README. venv: for
# "pip install ." in an environment, as demos/guide/installation.md says.
packages=(python3-dolfinx python3-numba python3-gmsh python3-scipy python3-matplotlib python3-meshio
    libopenblas0-pthread openmpi-bin gcc libc6-dev python3-dev python3-venv)
if [ "$kind" != demo ]; then
    packages+=(python3-pytest python3-pytest-xdist python3-hypothesis python3-setuptools python3-wheel)
fi
if [ "$kind" = ci ]; then packages+=(debootstrap); fi

has_apt() { command -v dpkg-query >/dev/null && command -v apt-get >/dev/null; }

# Not a derivative: the releases of these packages elsewhere are not tested.
is_debian() { has_apt && grep -qx 'ID="\?debian"\?' /etc/os-release; }

find_missing() { # sets $missing
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

find_rights() { # sets $as_root, the command before those of root
    if [ "$(id -u)" = 0 ]; then
        as_root=()
    elif command -v sudo >/dev/null && { sudo -n true 2>/dev/null || { [ -t 0 ] && [ -t 2 ]; }; }; then
        as_root=(sudo)
    else
        return 1
    fi
}

print_install() { # the command for an administrator
    printf '\n    apt-get update && apt-get install --yes --no-install-recommends %s\n\n' "${missing[*]}"
}

setup_debian() {
    has_apt || give_up "this is not a Debian system (no dpkg and apt). Needed are Debian 12 or newer and:" \
        "${packages[*]}" "or a virtual environment, for demos and tests: FENICS_MORTAR_SETUP=venv"
    find_missing
    if [ ${#missing[@]} = 0 ]; then
        say "all ${#packages[@]} Debian packages are installed"
        return
    fi
    say "missing Debian packages: ${missing[*]}"
    if ! find_rights; then
        say "you are neither root nor may you use sudo here. Ask an administrator to run:" >&2
        print_install >&2
        give_up "then run this again: once nothing is missing, no rights are needed"
    fi
    install_packages
    find_missing
    [ ${#missing[@]} = 0 ] || give_up "still missing after apt-get install: ${missing[*]}"
}

install_packages() {
    local apt=(env DEBIAN_FRONTEND=noninteractive LC_ALL=C apt-get) install
    local options=(-o DPkg::Lock::Timeout=300 -o Acquire::Retries=3 -o Dpkg::Use-Pty=0 -q)
    if [ ${#as_root[@]} -gt 0 ]; then say "not root: using ${as_root[*]}"; fi
    start_log apt
    logged "apt-get update" how_far_apt "${as_root[@]}" "${apt[@]}" update "${options[@]}" ||
        say "trying with the package lists that are there" >&2
    install=(install --yes --no-install-recommends "${missing[@]}")
    "${apt[@]}" "${install[@]}" --print-uris 2>>"$log" |
        grep -E '^(Need to get|After this operation)' | sed 's/^/setup: /' || true
    logged "apt-get install" how_far_apt "${as_root[@]}" "${apt[@]}" "${install[@]}" "${options[@]}" ||
        give_up "apt-get could not install: ${missing[*]}" \
            "without these packages: FENICS_MORTAR_SETUP=venv, which installs wheels by pip in this clone"
}

# Of "0 upgraded, 312 newly installed", "Get:57 ... libfoo", "Unpacking libfoo", "Setting up libfoo". (A
# descriptor for apt's status would not pass through sudo, and standard output is that of the packages.)
how_far_apt() {
    awk '$2 == "upgraded," && $4 == "newly" { all = $3 }
        /^Get:/ { loaded++; name = $5 }
        /^Unpacking / { unpacked++; name = $2 }
        /^Setting up / { ready++; name = $3 }
        END {
            of = all ? " of " all : ""
            if (ready) print "setting up " ready of ": " name
            else if (unpacked) print "unpacking " unpacked of ": " name
            else if (loaded) print "loading " loaded of ": " name
        }'
}
