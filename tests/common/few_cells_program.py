# SPDX-License-Identifier: MIT
"""Scenes of few cells on all ranks; rank 0 writes the results to a file.

    mpirun -n 3 /usr/bin/python3 few_cells_program.py FOLDER SECONDS SCENE,CELLS,KIND,DEGREE...

An error on any rank, or a scene that takes longer than the limit, ends the run on all ranks, with a
traceback of each rank.
"""

import faulthandler
import pickle
import sys
import time
import traceback
from pathlib import Path

from mpi4py import MPI

import few_cells_scenes

COMM = MPI.COMM_WORLD
SCENES = {scene.__name__: scene for scene in few_cells_scenes.SCENES}
# Time in which other ranks may print their tracebacks [s].
PATIENCE = 2.0


def collect(name, kind, folder):
    """All results of a scene."""
    return list(SCENES[name](kind, folder))


def parse(text):
    """Name of the scene and kind of the mesh."""
    name, count, cell, degree = text.split(",")
    return name, (int(count), cell, int(degree))


def main(folder, limit, *texts):
    found = {}
    for text in texts:
        faulthandler.dump_traceback_later(float(limit), exit=True)
        place = Path(folder) / text
        if COMM.rank == 0:
            place.mkdir()
        COMM.barrier()
        found[text] = collect(*parse(text), place)
    COMM.barrier()
    faulthandler.cancel_dump_traceback_later()
    if COMM.rank == 0:
        (Path(folder) / "results").write_bytes(pickle.dumps(found))


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except BaseException:
        print(f"rank {COMM.rank}:\n{traceback.format_exc()}", file=sys.stderr, flush=True)
        time.sleep(PATIENCE)
        COMM.Abort(1)
