# SPDX-License-Identifier: MIT
"""Mutants of earlier code, at their places in the present code."""

from __future__ import annotations

import json
from difflib import SequenceMatcher
from pathlib import Path

from mutation.mutant_changes import PACKAGE, Changes, Mutant, changed

# Similarity of the changed lines [1] above which the code is the same but for names.
ALIKE = 0.75


def read_sample(folder: Path, log: Path) -> tuple[list[Mutant], list[dict]]:
    """Mutants of a log (lines of JSON) in the package in ``folder``, and those without a place."""
    mutants, gone = [], []
    for line in log.read_text().splitlines():
        entry = json.loads(line)
        mutant = place(folder, entry)
        if mutant is None:
            gone.append(entry)
        else:
            mutants.append(mutant)
    return mutants, gone


def place(folder: Path, entry: dict) -> Mutant | None:
    """The change of the same kind whose lines are most similar, in this file or one of its name."""
    same = folder / entry["path"]
    files = [same] if same.exists() else sorted((folder / PACKAGE).rglob(same.name))
    alike, change = ALIKE, None
    for file in files:
        text = file.read_text()
        for node, span, kind, new, function in Changes(text).found:
            if kind == entry["kind"]:
                now = similarity(entry, text, span, new, node.lineno)
                if now > alike:
                    alike, change = now, (file, text, node, span, kind, new, function)
    if change is None:
        return None
    file, *others = change
    return changed(file.relative_to(folder), *others)


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
