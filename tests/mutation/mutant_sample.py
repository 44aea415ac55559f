# SPDX-License-Identifier: MIT
"""Mutants of earlier code, found again in the present code."""

from __future__ import annotations

import json
from difflib import SequenceMatcher
from pathlib import Path

from mutation.mutant_changes import PACKAGE, Changes, Mutant, changed

# Similarities of the changed lines [1] above which the code is the same but for names, and above
# which it has moved to another file.
ALIKE, MOVED = 0.75, 0.95


def read_sample(folder: Path, log: Path) -> list[tuple[Mutant | None, dict]]:
    """Entries of a log (lines of JSON), each with its mutant of the package in ``folder``."""
    entries = [json.loads(line) for line in log.read_text().splitlines()]
    return [(find_change(folder, entry), entry) for entry in entries]


def find_change(folder: Path, entry: dict) -> Mutant | None:
    """The change of the same kind whose lines are most similar, in this file or else in any."""
    same = folder / entry["path"]
    found = most_similar([same], entry, ALIKE) if same.exists() else None
    found = found or most_similar(sorted((folder / PACKAGE).rglob("*.py")), entry, MOVED)
    if found is None:
        return None
    file, *others = found
    return changed(file.relative_to(folder), *others)


def most_similar(files: list[Path], entry: dict, alike: float) -> tuple | None:
    """Arguments of ``changed``; None if no change is more similar than ``alike``."""
    change = None
    for file in files:
        text = file.read_text()
        for node, span, kind, new, function in Changes(text).found:
            if kind == entry["kind"]:
                now = similarity(entry, text, span, new, node.lineno)
                if now > alike:
                    alike, change = now, (file, text, node, span, kind, new, function)
    return change


def similarity(entry: dict, text: str, span: tuple[int, int], new: str, line: int) -> float:
    """Similarity of a change of ``text`` and an entry [1], slightly less far from its line."""
    first, last = text.rfind("\n", 0, span[0]) + 1, text.find("\n", span[1])
    removed = text[first:last].splitlines()
    added = (text[first : span[0]] + new + text[span[1] : last]).splitlines()
    now = signed("-", [each for each in removed if each not in added])
    now += signed("+", [each for each in added if each not in removed])
    old = [line for line in entry["difference"].splitlines() if not line.startswith("@@")]
    before = [each for sign in "-+" for each in signed(sign, [x[1:] for x in old if x[0] == sign])]
    alike = SequenceMatcher(None, "\n".join(before), "\n".join(now), autojunk=False)
    if alike.quick_ratio() <= ALIKE:
        return 0.0
    return alike.ratio() - 1e-4 * min(abs(line - entry["line"]), 100)


def signed(sign: str, lines: list[str]) -> list[str]:
    return [sign + line.strip() for line in lines]
