# SPDX-License-Identifier: MIT
"""Demos by subject and difficulty, as `demos/README.md` lists them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[3]


class Demo(NamedTuple):
    """A demo as the gallery shows it: script, title, difficulty, and what it prints and draws."""

    script: Path
    title: str
    level: str
    text: str

    @property
    def name(self) -> str:
        """Name without ``demo_``."""
        return self.script.stem.removeprefix("demo_")


def demos() -> dict[str, list[Demo]]:
    """All demos by subject, in the order of the gallery."""
    subjects = re.split(r"^## ", (ROOT / "demos" / "README.md").read_text(), flags=re.MULTILINE)
    entry = re.compile(
        r"^### ([^\n]*)\n\n`(\w+\.py)`, (\w+)\. (.*?)(?=^### |\Z)", re.MULTILINE | re.DOTALL
    )
    return {
        subject.split("\n", 1)[0]: [
            Demo(ROOT / "demos" / file, title, level, text)
            for title, file, level, text in entry.findall(subject)
        ]
        for subject in subjects[1:]
    }


def all_demos() -> list[Demo]:
    """All demos, the easiest of the first subject first."""
    return [demo for of_subject in demos().values() for demo in of_subject]
