# SPDX-License-Identifier: MIT
"""Rates of all exact problems and elements, and ratio of estimated and true error.

    python3 -m demos.studies.accuracy.effectivity            three meshes each
    python3 -m demos.studies.accuracy.effectivity --quick    the two coarser ones
    python3 -m demos.studies.accuracy.effectivity flat Hertz    names that contain one of these

Rates are those of the last halving; for contact that ends, over both halvings, after which the ends
have the same position in a facet again. Theoretical rates are in brackets. A smooth solution has
the rates of the element, and those of pressure and shear in L2 are at least half an order below
that of the energy; ends of a contact limit the rates to 3/2 for the energy and 1 for pressure and
shear. With straight facets the rings of the press fit overlap by too little; this additional error,
of order 3/2, is small on fine meshes only. Writes ``effectivity.md`` to ``results/accuracy``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from demos.studies.accuracy.norms import errors
from demos.studies.accuracy.posed import ELEMENTS, Choice, Posed
from demos.studies.accuracy.report import FOLDER, PREDICTED, markdown
from demos.studies.accuracy.scenes_exact import cattaneo, curved, flat, hertz, press_fit

# Names of errors and of the estimate
NAMES = ("energy", "displacement", "pressure", "shear")
ESTIMATE = "estimate"


class Problem(NamedTuple):
    """An exact problem.

    Attributes:
        pose: Function that creates it.
        n: Facets of degree 1 of the slave on the coarsest mesh.
        smooth: Whether the solution is smooth; otherwise contact has ends.
    """

    pose: Callable[[int, Choice], Posed]
    n: int
    smooth: bool = True

    def predicted(self, element: str) -> dict[str, str]:
        """Theoretical rates by name, if known."""
        degree = ELEMENTS[element][1]
        if self.smooth:
            least = f">= {degree - 0.5:g}"
            full = {"energy": f"{degree}", "displacement": f"{degree + 1}"}
            return full | dict.fromkeys(("pressure", "shear"), least)
        rates = {name: f"{rate:g}" for name, rate in PREDICTED[degree].items()}
        return rates | {"shear": rates["pressure"]}

    def measure(self, n: int, element: str) -> dict[str, float]:
        """All errors, and the ratio of estimated and true error of the energy."""
        posed = self.pose(n, Choice(element))
        posed.problem.solve()
        found = errors(posed)
        return found | {ESTIMATE: posed.problem.estimate().relative / found["energy"]}


PROBLEMS = {
    "Hertz": Problem(hertz, 16, smooth=False),
    "Cattaneo and Mindlin": Problem(cattaneo, 32, smooth=False),
    "press fit": Problem(press_fit, 48),
    "linear press fit": Problem(partial(press_fit, law="linear"), 96),
    "flat": Problem(flat, 12),
    "flat, slides": Problem(partial(flat, friction=0.3), 12),
    "flat, ends in a jump": Problem(partial(flat, friction=0.1, ends=0.1), 12),
    "curved, sticks": Problem(curved, 12),
    "curved, tied": Problem(partial(curved, tied=True), 6),
}


def row(name: str, element: str, levels: int) -> list[str]:
    """Cells of the table: rates, and ratio of estimate and error on each mesh."""
    problem = PROBLEMS[name]
    found = [problem.measure(problem.n * 2**k, element) for k in range(levels)]
    predicted = problem.predicted(element)
    halvings = 1 if problem.smooth else levels - 1
    cells = [name, element]
    for what in NAMES:
        if what not in found[0]:
            cells.append("")
            continue
        rate = np.log2(found[-1 - halvings][what] / found[-1][what]) / halvings
        expected = f" ({predicted[what]})" if what in predicted else ""
        cells.append(f"{rate:.2f}{expected}")
    return cells + [f"{one[ESTIMATE]:.2f}" for one in found]


def table(names: Sequence[str], levels: int) -> str:
    """Markdown table of the named problems."""
    lines = [row(name, element, levels) for name in names for element in ELEMENTS]
    sizes = ["n", "2 n", "4 n"][:levels]
    return markdown(" | ".join(["problem", "element", *NAMES, *sizes]), 2, lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two meshes each")
    parser.add_argument("names", nargs="*", help="parts of the names of problems; all by default")
    options = parser.parse_args()
    names = [n for n in PROBLEMS if any(w in n for w in options.names or [""])]
    text = table(names, 2 if options.quick else 3)
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / "effectivity.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
