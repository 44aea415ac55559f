# SPDX-License-Identifier: MIT
"""Results of scenes of few cells; as a program it writes them to the file ``results`` of a folder.

/usr/bin/python3 few_cells_program.py FOLDER SCENE,CELLS,KIND,DEGREE...
"""

import pickle
import sys
from pathlib import Path

import few_cells_scenes

SCENES = {scene.__name__: scene for scene in few_cells_scenes.SCENES}


def collect(name, kind, folder):
    """All results of a scene."""
    return list(SCENES[name](kind, folder))


def parse(text):
    """Name of the scene and kind of the mesh."""
    name, count, cell, degree = text.split(",")
    return name, (int(count), cell, int(degree))


def main(folder, *texts):
    found = {}
    for text in texts:
        place = Path(folder) / text
        place.mkdir()
        found[text] = collect(*parse(text), place)
    (Path(folder) / "results").write_bytes(pickle.dumps(found))


if __name__ == "__main__":
    main(*sys.argv[1:])
