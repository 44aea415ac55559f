# SPDX-License-Identifier: MIT
"""The tutorial runs completely and prints the output shown on its pages."""

import os
import re
from pathlib import Path

import pytest
from printed_lines import missing
from test_demos import run

SCRIPT = Path(__file__).resolve().parents[2] / "demos" / "guide" / "tutorial.py"


def shown():
    """Lines of the text blocks of the script."""
    text = "\n".join(line.removeprefix("# ") for line in SCRIPT.read_text().splitlines())
    blocks = re.findall(r"^```text\n(.*?)\n```$", text, re.MULTILINE | re.DOTALL)
    return [line for block in blocks for line in block.splitlines()]


@pytest.mark.serial
def test_tutorial_prints_what_its_pages_show(tmp_path):
    finished = run(tmp_path, 1, SCRIPT)
    assert finished.returncode == 0, finished.stdout[-2000:] + finished.stderr[-4000:]
    printed = finished.stdout.splitlines()
    assert missing(shown(), printed) == [], finished.stdout
    pictures = {path.name for path in (tmp_path / "results").iterdir()}
    used = set(re.findall(r"pictures/(tutorial_\w+\.png)", SCRIPT.read_text()))
    assert used <= pictures, os.listdir(tmp_path)
