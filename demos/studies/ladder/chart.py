# SPDX-License-Identifier: MIT
"""True error, estimate and cost of simpler models.

    python3 -m demos.studies.ladder.chart

writes ``results/ladder/ladder.md`` and ``ladder.png``; a few minutes, in serial. Measured rows are
stored in the same folder: ``--problem NAME`` measures one problem again and draws all, ``--redraw``
only draws.

The true error is the difference from the full model on the same mesh, on the soft body alone if the
tool is rigid. In this case the error includes that of the facets of the meshed tool, and so does
the estimate. The error of that mesh is given as well: for the energy norm by
``problem.estimate()``, for forces and pressures as the difference from the full model on a mesh of
half the size. Seconds are CPU times, independent of other work on the machine.
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
    parser.add_argument("--problem", help="measure only this one anew")
    parser.add_argument("--redraw", action="store_true", help="draw earlier measurements")
    options = parser.parse_args()
    if not options.redraw:
        list(measure(SCENES[1], SCENES[1].loads[-1]))  # compiles forms, loads kernels
    folder = Path("results/ladder")
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for scene in SCENES:
        kept = folder / f"{scene.name.replace(' ', '_')}.json"
        if options.problem in (None, scene.name) and not options.redraw:
            mine = list(measure_all(scene))
            kept.write_text(json.dumps([asdict(row) for row in mine]))
        if kept.exists():
            rows += [Row(**row) for row in json.loads(kept.read_text())]
    (folder / "ladder.md").write_text(report(rows))
    draw(rows).savefig(folder / "ladder.png", dpi=130)
    print(report(rows))


if __name__ == "__main__":
    main()
