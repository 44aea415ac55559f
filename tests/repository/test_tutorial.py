# SPDX-License-Identifier: MIT
"""The tutorial runs completely and prints the output shown on its pages."""

import os
import re
from pathlib import Path

import pytest
from test_demos import run

SCRIPT = Path(__file__).resolve().parents[2] / "demos" / "guide" / "tutorial.py"
# Numbers below this are rounding, such as converged residuals, and are not compared.
ROUNDING = 1e-7
TOLERANCE = 0.02  # relative, of all others: the smallest difference noticed by a reader
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]\d+)?")


def shown():
    """Lines of the text blocks of the script."""
    text = "\n".join(line.removeprefix("# ") for line in SCRIPT.read_text().splitlines())
    blocks = re.findall(r"^```text\n(.*?)\n```$", text, re.MULTILINE | re.DOTALL)
    return [line for block in blocks for line in block.splitlines()]


def words(line):
    """The line without numbers and spaces."""
    return re.sub(r"\s+", "", NUMBER.sub("", line))


def numbers(line):
    """Numbers of a line, in order."""
    return [float(number) for number in NUMBER.findall(line)]


def agree(line, other):
    """Whether two lines have the same words and nearly the same numbers."""
    pairs = zip(numbers(line), numbers(other))
    return words(line) == words(other) and all(
        abs(a - b) <= TOLERANCE * abs(b) + ROUNDING or max(abs(a), abs(b)) < ROUNDING
        for a, b in pairs
    )


@pytest.mark.serial
@pytest.mark.demo
@pytest.mark.slow
def test_tutorial_prints_what_its_pages_show(tmp_path):
    finished = run(tmp_path, 1, SCRIPT)
    assert finished.returncode == 0, finished.stdout[-2000:] + finished.stderr[-4000:]
    printed = finished.stdout.splitlines()
    missing = [line for line in shown() if not any(agree(line, other) for other in printed)]
    assert missing == [], finished.stdout
    pictures = {path.name for path in (tmp_path / "results").iterdir()}
    used = set(re.findall(r"pictures/(tutorial_\w+\.png)", SCRIPT.read_text()))
    assert used <= pictures, os.listdir(tmp_path)
