# SPDX-License-Identifier: MIT
"""Numbers in the README and on the site are equal to recorded results of the studies.

The studies take too long for a test; their records are Markdown tables. Numbers of the demos and
of the tutorial are compared with a run, see ``test_demos.py`` and ``test_tutorial.py``.
"""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SITE, STUDIES = ROOT / "demos" / "guide" / "site", ROOT / "demos" / "studies"
pytestmark = pytest.mark.serial


def rows(file):
    """Cells of all table rows of a Markdown file."""
    lines = [line for line in file.read_text().splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def quoted(file, pattern):
    """Numbers matched by a pattern, which must be in the file; commas separate thousands."""
    text = re.sub(r"\s+", " ", file.read_text())
    found = re.search(pattern, text)
    assert found, f"{file.name} does not contain '{pattern}'"
    return [float(number.replace(",", "")) for number in found.groups()]


@pytest.fixture(scope="module")
def outcomes():
    """Numbers of scenes of the atlas by method: converged, cut, wrong, failed, dead end."""
    table = rows(STUDIES / "stability" / "atlas.md")
    end = next(i for i, row in enumerate(table) if row[0] == "remedy")
    return {row[0]: [int(cell) for cell in row[1:6]] for row in table[2:end]}


def test_scenes_and_methods_of_the_atlas(outcomes):
    scenes = sum(outcomes["default"])
    for file in (ROOT / "README.md", SITE / "verification.md"):
        pattern = (
            r"(\d+) problems that are known to break contact codes, (?:solved )?by up to (\d+)"
        )
        assert quoted(file, pattern) == [scenes, len(outcomes)]
    assert quoted(STUDIES / "stability" / "README.md", r"what becomes of (\d+) difficult") == [
        scenes
    ]


def test_outcomes_of_the_default_method(outcomes):
    converged, cut, wrong, failed, dead_end = outcomes["default"]
    unsolved = wrong + failed + dead_end
    scenes = converged + cut + unsolved
    assert quoted(ROOT / "README.md", r"the default solves all but (\d+) without") == [unsolved]
    pattern = r"of (\d+) difficult ones, (\d+) converge at once, (\d+) with cut steps, and (\d+) "
    assert quoted(SITE / "choices.md", pattern) == [scenes, converged, cut, unsolved]


def test_random_scenes():
    (total,) = [row for row in rows(STUDIES / "stability" / "README.md") if row[0] == "all"]
    for file in (ROOT / "README.md", SITE / "verification.md"):
        assert quoted(file, r"(\d+) random problems") == [int(total[1])]


def test_share_of_contact_in_an_iteration():
    table = rows(STUDIES / "performance" / "README.md")
    sizes = next(row for row in table if row[0] == "unknowns" and "645 000" in row)
    shares = next(row for row in table if row[0] == "factors" and len(row) == len(sizes))
    share = {float(n.replace(" ", "")): float(s) for n, s in zip(sizes[1:], shares[1:])}
    pattern = r"takes ([\d.]+) % of a Newton iteration at ([\d,]+) unknowns, ([\d.]+) % at ([\d,]+)"
    small, n_small, large, n_large = quoted(ROOT / "README.md", pattern)
    assert (small, large) == (round(share[n_small]), share[n_large])


def test_factors_of_the_ladder_and_of_the_estimate():
    ladder, accuracy = STUDIES / "ladder" / "README.md", STUDIES / "accuracy" / "README.md"
    choices = SITE / "choices.md"
    assert quoted(choices, r"within a factor of ([\d.]+) of the true") == quoted(
        ladder, r"within a factor ([\d.]+) \(energy"
    )
    cheaper = r"takes ([\d.]+) to ([\d.]+) of the full model's time"
    assert quoted(choices, cheaper) == quoted(ladder, cheaper)
    assert quoted(SITE / "verification.md", r"it is ([\d.]+) to ([\d.]+) times the true") == quoted(
        accuracy, r"the estimate is ([\d.]+) to ([\d.]+) of the true"
    )


def test_cost_of_an_accuracy_and_gain_of_grading():
    accuracy, choices = STUDIES / "accuracy" / "README.md", SITE / "choices.md"
    number = r"([\d.]+)"
    uniform, graded = rf"{number} s and P2 {number} s on", rf"{number}(?: s)? and {number} s on"
    first = rf"energy error of 1 %,? Q2 \w+ {uniform} uniform meshes, {graded} graded ones; Q1 .*?"
    pattern = rf"{first}{number} s and P1 {number} s"
    assert quoted(choices, pattern) == quoted(accuracy, pattern)
    gains = quoted(accuracy, rf"with {number} \(P1\) and {number} \(P2\) times fewer")
    assert quoted(choices, rf"with {number} \(P1\) and {number} \(P2\) times fewer") == [
        round(gain) for gain in gains
    ]


def test_the_readme_has_one_table_with_all_demos_and_eight_limits():
    text = (ROOT / "README.md").read_text()
    parts = dict(re.findall(r"^## ([^\n]*)\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL))
    assert len(re.findall(r"^\|---", text, re.MULTILINE)) == 1
    assert len(re.findall(r"^- ", parts["Limits"], re.MULTILINE)) == 8
    demos = {file.stem for file in (ROOT / "demos").glob("demo_*.py")}
    assert demos == set(re.findall(r"demos/(demo_\w+)\.py", parts["What it does"]))


def test_links_to_sections_of_the_limits_lead_to_sections():
    titles = re.findall(r"^#+ (.*)$", (ROOT / "demos/guide/limits.md").read_text(), re.MULTILINE)
    sections = {title.lower().replace(" ", "-") for title in titles}
    pages = [ROOT / "README.md", *(ROOT / "demos").glob("**/*.md")]
    linked = {
        anchor for page in pages for anchor in re.findall(r"limits\.md#([\w-]+)", page.read_text())
    }
    assert len(linked) >= 7 and linked <= sections
