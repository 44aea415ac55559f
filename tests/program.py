# SPDX-License-Identifier: MIT
"""Run a program of the tests, with all folders of the tests on the path.

    /usr/bin/python3 tests/program.py axisymmetric_table      errors that the tests bound
    /usr/bin/python3 tests/program.py dynamics_table          motions with known solutions
    /usr/bin/python3 tests/program.py self_contact_table      bodies that touch themselves
    /usr/bin/python3 tests/program.py supported_table [name]  supported by friction or adhesion
    mpirun.openmpi -n 2 /usr/bin/python3 tests/program.py proof_matrix [parts]  derivatives

Each prints a table.
"""

import runpy
import sys

import conftest

PROGRAMS = [
    path.stem
    for pattern in ("*_table.py", "proof_matrix.py")
    for path in sorted((conftest.ROOT / "tests").rglob(pattern))
]

if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] not in PROGRAMS:
        sys.exit(f"usage: /usr/bin/python3 tests/program.py NAME, one of {', '.join(PROGRAMS)}")
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name="__main__")
