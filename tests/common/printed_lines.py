# SPDX-License-Identifier: MIT
"""Comparison of lines on a page with lines printed by a script."""

import re

# Numbers below this are rounding, such as converged residuals, and are not compared.
ROUNDING = 1e-7
TOLERANCE = 0.02  # relative, of all others: the smallest difference noticed by a reader
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]\d+)?")


def missing(shown, printed):
    """Lines on the page that agree with no printed line."""
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
