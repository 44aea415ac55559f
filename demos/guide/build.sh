#!/bin/bash
# SPDX-License-Identifier: MIT
#
# Build the documentation site into build/site/html, warnings as errors:
#
#     bash demos/guide/build.sh
#
# Sphinx is installed in a virtual environment of its own that sees Debian's packages. Scripts are
# not run: tests/repository runs the demos and the tutorial. MathJax and its fonts come from a
# package there and are put beside the pages, which show their formulas offline.

set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
bash "$root/.ci/setup.sh" lint
# shellcheck source=../../.ci/env.sh
. "$root/.ci/env.sh"
cd "$root"

tools=(sphinx==9.0.4 docutils==0.22.4 myst-parser==5.2.0 sphinx-book-theme==1.4.0
    pydata-sphinx-theme==0.20.0 sphinx-design==0.8.0 sphinx-copybutton==0.5.2 jupytext==1.19.6)
mathjax=django-static-mathjax==3.2.2.1 # its files alone: it needs no Django
venv="${XDG_CACHE_HOME:-$HOME/.cache}/fenics_mortar/site-venv"
wanted="${tools[*]} $mathjax $(/usr/bin/python3 --version)"
if [ "$(cat "$venv/complete" 2>/dev/null || true)" != "$wanted" ]; then
    echo "site: making $venv"
    rm -rf "$venv"
    /usr/bin/python3 -m venv --system-site-packages "$venv"
    # Inside this environment only: PYTHONPATH would hide what is installed there.
    env -u PYTHONPATH "$venv/bin/python" -m pip install --quiet --no-warn-conflicts "${tools[@]}"
    env -u PYTHONPATH "$venv/bin/python" -m pip install --quiet --no-deps "$mathjax"
    echo "$wanted" >"$venv/complete"
fi

rm -rf build/site
packages=$("$venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
(cd "$packages/mathjax/static/mathjax/es5" && pieces=(tex-chtml.js input/tex/extensions output/chtml/fonts) &&
    mkdir -p "$root/build/site/static/mathjax" &&
    cp -r --parents "${pieces[@]}" "$root/build/site/static/mathjax")
"$venv/bin/python" demos/guide/site/gather.py build/site/source
"$venv/bin/python" -m sphinx --fail-on-warning --keep-going --quiet \
    -c demos/guide/site build/site/source build/site/html
loaded='<script[^>]* src="https?://|<link[^>]* rel="stylesheet"[^>]* href="https?://'
if grep -rlE --include='*.html' "$loaded" build/site/html; then
    echo "site: these pages load scripts or styles from elsewhere, and do not work offline" >&2
    exit 1
fi
echo "site: $root/build/site/html/index.html"
