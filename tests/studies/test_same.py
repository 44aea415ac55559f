# SPDX-License-Identifier: MIT
"""Comparison of the results of two states of the code."""

import copy
import json
import subprocess
import sys

import pytest

from demos.studies.same import house
from demos.studies.same.compare import differences

pytestmark = [pytest.mark.serial, pytest.mark.once]

PROGRAM = """
import sys
import numpy as np
import ufl
import fenics_mortar as fm
from dolfinx import fem
from meshes.mapped_grids import Grid, block, mesh
upper = Grid("upper", block(3, 2, width=1.0, height=1.0, corner=(0.1, 1.0)))
data = mesh([upper, Grid("lower", block(4, 2, width=1.4, height=1.0))])
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
psi = fm.energies.neo_hookean(u, *fm.energies.lame(float(sys.argv[1]), 0.3))
ends = {"lower/bottom": (0.0, 0.0), "upper/top": (0.0, -0.1)}
bcs = [fm.dirichlet(V, data, name, value) for name, value in ends.items()]
pair = fm.ContactPair(data, "upper/bottom", "lower/top")
fm.ContactProblem(
    ufl.derivative(psi * ufl.dx(degree=3), u, v), u, [pair], bcs=bcs, petsc_options_prefix="s_"
).solve()
if len(sys.argv) > 2:
    raise ValueError(sys.argv[2])
"""


def record_of(folder, *arguments):
    script, out = folder / "program.py", folder / "record.json"
    script.write_text(PROGRAM)
    command = [sys.executable, "-m", "demos.studies.same.record", str(out), str(script), *arguments]
    subprocess.run(command, check=True, cwd=folder, timeout=240)
    return json.loads(out.read_text())


def test_records_of_one_program_are_equal_and_others_differ(tmp_path):
    first, again = record_of(tmp_path, "100.0"), record_of(tmp_path, "100.0")
    assert len(first["solves"]) == 1 and first["solves"][0]["iterations"] > 1
    assert list(differences(first, again)) == []
    lines = list(differences(first, record_of(tmp_path, "100.001", "wrong")))
    for said in ("forces differ by 1.0e-05", "ends with 'ValueError: wrong'"):
        assert any(said in line for line in lines), lines
    other = copy.deepcopy(first)
    other["solves"][0]["iterations"] += 1
    assert list(differences(first, other)) == [
        f"solve 1: iterations {other['solves'][0]['iterations']}, "
        f"before {first['solves'][0]['iterations']}"
    ]
    other["solves"].append(other["solves"][0])
    assert "2 solves, before 1" in list(differences(first, other))


def test_figures_of_the_house(tmp_path):
    code = (
        '"""Doc."""\n\nimport os  # comment\n\n\ndef f(\n    a,\n):\n    """Doc."""\n'
        "    b = a\n\n    return (\n        b\n    )\n"
    )
    (tmp_path / "one.py").write_text(code)
    one = house.Module(tmp_path / "one.py")
    assert (one.code, one.framing, one.functions) == (8, 4, [4])
    assert one.imported() == ["os"]
    names = {"a": "import b\nimport c", "b": "from c import d", "c": "x = 1"}
    for name, text in names.items():
        (tmp_path / f"{name}.py").write_text(text)
    modules = {name: house.Module(tmp_path / f"{name}.py") for name in names}
    assert house.longest_chain(modules) == ["a", "b", "c"]
