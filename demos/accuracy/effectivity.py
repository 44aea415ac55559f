# SPDX-License-Identifier: MIT
"""The error that is estimated by the true one, on all exact problems and all elements.

    python3 demos/accuracy/effectivity.py            three meshes each
    python3 demos/accuracy/effectivity.py --quick    the two coarser ones

Writes ``effectivity.md`` to ``results/accuracy``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial

from norms import errors
from report import FOLDER, markdown
from scenes_exact import ELEMENTS, Choice, Posed, curved, flat, hertz, press_fit

# Problem by name and its coarsest mesh: facets of degree 1 of the slave
PROBLEMS: dict[str, tuple[Callable[[int, Choice], Posed], int]] = {
    "Hertz": (hertz, 16),
    "press fit": (press_fit, 24),
    "linear press fit": (partial(press_fit, law="linear"), 24),
    "flat": (flat, 6),
    "curved, sticks": (curved, 6),
    "curved, tied": (partial(curved, tied=True), 6),
}


def effectivity(scene: Callable[[int, Choice], Posed], n: int, element: str) -> float:
    """Estimated by true error of the energy norm."""
    posed = scene(n, Choice(element))
    posed.problem.solve()
    return posed.problem.estimate().relative / errors(posed)["energy"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two meshes each")
    levels = range(2 if parser.parse_args().quick else 3)
    lines = [
        [name, element, *(f"{effectivity(scene, n * 2**k, element):.2f}" for k in levels)]
        for name, (scene, n) in PROBLEMS.items()
        for element in ELEMENTS
    ]
    sizes = " | ".join(["n", "2 n", "4 n"][: len(levels)])
    text = markdown(f"problem | element | {sizes}", 2, lines)
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / "effectivity.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
