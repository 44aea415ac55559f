# SPDX-License-Identifier: MIT
"""The ladder of models: true error, estimate and cost of every rung and of the automatic climb.

    python3 -m demos.studies.ladder.chart

writes ``results/ladder/ladder.md`` and ``ladder.png``; a few minutes, in serial. Measured rows
are kept beside them: ``--scene NAME`` measures one scene anew and draws all, ``--redraw`` none.

The true error is the difference from the full model on the same mesh, on the soft body alone where
the tool is rigid: then a part of it is that the meshed tool has facets in place of a curve, and the
estimate counts that in. The error of that mesh stands beside it: of the norm of energy as
``problem.estimate()`` says, of forces and pressures the difference from the full model on a mesh of
half the size. Seconds are those of the processor, so that other work on the machine does not count.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from demos.studies.ladder.drawing import draw
from demos.studies.ladder.measured import measure, measure_all
from demos.studies.ladder.row import Row
from demos.studies.ladder.scenes import SCENES
from demos.studies.ladder.tables import report


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", help="measure only this one anew")
    parser.add_argument("--redraw", action="store_true", help="draw what was measured before")
    options = parser.parse_args()
    if not options.redraw:
        list(measure(SCENES[1], SCENES[1].loads[-1]))  # forms are compiled, kernels loaded
    folder = Path("results/ladder")
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for scene in SCENES:
        kept = folder / f"{scene.name.replace(' ', '_')}.json"
        if options.scene in (None, scene.name) and not options.redraw:
            mine = list(measure_all(scene))
            kept.write_text(json.dumps([asdict(row) for row in mine]))
        if kept.exists():
            rows += [Row(**row) for row in json.loads(kept.read_text())]
    (folder / "ladder.md").write_text(report(rows))
    draw(rows).savefig(folder / "ladder.png", dpi=130)
    print(report(rows))


if __name__ == "__main__":
    main()
