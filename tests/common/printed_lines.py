# SPDX-License-Identifier: MIT
"""Comparison of lines that a page shows with lines that a script prints."""

import re

# Numbers that the form of the linear algebra decides, as of converged residuals, are not compared.
ROUNDING = 1e-7
TOLERANCE = 0.02  # of all others: the least that a reader would notice
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]\d+)?")


def missing(shown, printed):
    """Those of the lines shown that agree with none of the printed ones."""
    return [line for line in shown if not any(agree(line, other) for other in printed)]


def agree(line, other):
    """Whether two lines have the same words and nearly the same numbers."""
    pairs = zip(numbers(line), numbers(other))
    return words(line) == words(other) and all(
        abs(a - b) <= TOLERANCE * abs(b) + ROUNDING or max(abs(a), abs(b)) < ROUNDING
        for a, b in pairs
    )


def words(line):
    """The line without numbers and spaces."""
    return re.sub(r"\s+", "", NUMBER.sub("", line))


def numbers(line):
    """Numbers of a line, in order."""
    return [float(number) for number in NUMBER.findall(line)]
