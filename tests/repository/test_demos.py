# SPDX-License-Identifier: MIT
"""Every demo as a separate process, in serial or on several ranks; each ends with assertions.

Numbers in the gallery are lines printed by the demo.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from printed_lines import missing

from demos.studies.processes import mpirun, outer_environment

GALLERY = Path(__file__).resolve().parents[2] / "demos" / "README.md"
DEMOS = sorted((Path(__file__).resolve().parents[2] / "demos").glob("demo_*.py"))
# two_blocks runs on two ranks in the set-up of each machine; many steps take long on busy cores
ON_RANKS = {"demo_tied": 2}
# four to thirty seconds each, for many steps, solves or meshes; .ci/run runs these on the machine
# itself, the others in trixie
LONG = (
    "demo_ball", "demo_identify", "demo_interference", "demo_ironing", "demo_plasticity",
    "demo_profile", "demo_relaxation", "demo_rollers", "demo_seal", "demo_snap_fit", "demo_tied",
    "demo_wear", "demo_hot_punch",
    "demo_crossed_cylinders", "demo_ironing_in_space", "demo_pyramid", "demo_screw", "demo_sphere",
    "demo_strip", "demo_rings",
)  # fmt: skip
# time limit of a demo [s]: a minute, four on a loaded machine
LIMIT = 240


def run(folder, ranks, *arguments):
    """Run Python as a separate process, or as one on each of several ranks."""
    return subprocess.run(
        [*mpirun(ranks), sys.executable, *map(str, arguments)],
        cwd=folder, env=outer_environment(), capture_output=True, text=True, timeout=LIMIT,
    )  # fmt: skip


def _stem(demo):
    return demo.stem


def shown(demo):
    """Lines of text blocks and rows of tables that follow the name of a demo in the gallery."""
    lines, named = [], None
    names = r"`(demo_\w+)\.py`|^```text\n(.*?)\n```$|^(\|[^\n]*)$"
    for name, block, row in re.findall(names, GALLERY.read_text(), re.MULTILINE | re.DOTALL):
        named = name or named
        lines += (block or row).splitlines() if named == demo.stem else []
    return lines


def code_lines(demo):
    lines = [line.strip() for line in demo.read_text().splitlines()]
    return [line for line in lines if line and not line.startswith("#")]


def ends_with_what_the_gallery_shows(demo, folder):
    finished = run(folder, ON_RANKS.get(demo.stem, 1), demo)
    assert finished.returncode == 0, finished.stdout[-2000:] + finished.stderr[-4000:]
    assert missing(shown(demo), finished.stdout.splitlines()) == [], finished.stdout


@pytest.mark.serial
@pytest.mark.parametrize("demo", [demo for demo in DEMOS if demo.stem not in LONG], ids=_stem)
def test_demo_runs(demo, tmp_path):
    ends_with_what_the_gallery_shows(demo, tmp_path)


@pytest.mark.serial
@pytest.mark.once
@pytest.mark.parametrize("demo", [demo for demo in DEMOS if demo.stem in LONG], ids=_stem)
def test_long_demo_runs(demo, tmp_path):
    ends_with_what_the_gallery_shows(demo, tmp_path)


@pytest.mark.serial
@pytest.mark.parametrize("demo", DEMOS, ids=_stem)
def test_demo_is_in_the_gallery_with_what_it_prints(demo):
    assert shown(demo)


@pytest.mark.serial
@pytest.mark.parametrize("demo", DEMOS, ids=_stem)
def test_demo_is_short_and_ends_in_an_assertion(demo):
    lines = code_lines(demo)
    assert len(lines) < 60
    assert lines[-1].startswith("assert")
