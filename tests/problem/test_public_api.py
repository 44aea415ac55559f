# SPDX-License-Identifier: MIT
"""Public names: they exist, are documented, and are few."""

import dataclasses
import inspect
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

from mpi4py import MPI

import pytest
from scenes import pair_options

import fenics_mortar as fm
from fenics_mortar.contact.pair import PRESETS, as_discretization


@pytest.mark.parametrize("name", fm.__all__)
def test_public_name_exists_and_is_documented(name):
    thing = getattr(fm, name)
    assert inspect.getdoc(thing)


@pytest.mark.parametrize(
    "name",
    [
        "ContactPair",
        "ContactProblem",
        "read_gmsh",
        "dirichlet",
        "mesh_from_arrays",
        "mesh_from_meshio",
        "plot",
    ],
)
def test_public_call_documents_arguments_and_errors(name):
    text = inspect.getdoc(getattr(fm, name))
    assert "Args:" in text and "Raises:" in text
    for parameter in inspect.signature(getattr(fm, name)).parameters:
        assert f"{parameter}:" in text, parameter


def test_public_names_are_few():
    """Six of them are shapes of obstacles in space."""
    assert len(fm.__all__) <= 65


def test_public_names_of_a_problem_are_few_and_documented():
    names = [name for name in dir(fm.ContactProblem) if not name.startswith("_")]
    assert "equations:" in inspect.getdoc(fm.ContactProblem) and len(names) <= 16
    assert all(inspect.getdoc(getattr(fm.ContactProblem, name)) for name in names)


RESULTS = [
    "ModelReport",
    "Certificate",
    "ErrorEstimate",
    "NewtonReport",
    "PairCertificate",
    "PathReport",
    "TangentCheck",
]


@pytest.mark.parametrize("name", RESULTS)
def test_result_class_documents_each_attribute(name):
    text = inspect.getdoc(getattr(fm, name))
    for field in dataclasses.fields(getattr(fm, name)):
        assert re.search(rf"^ +(\w+, )*{field.name}(, \w+)*:", text, re.M), field.name


def test_import_from_above_the_clone_gives_a_remedy(tmp_path):
    """In this case the folder of the clone is an empty namespace package of the same name."""
    clone = tmp_path / "fenics_mortar"
    clone.mkdir()
    (clone / "fenics_mortar").symlink_to(Path(fm.__file__).parent)
    with pytest.raises(subprocess.CalledProcessError) as error:
        subprocess.run(
            [sys.executable, "-c", "import fenics_mortar.fenics_mortar"],
            cwd=tmp_path,
            env={"PATH": "/usr/bin"},
            check=True,
            capture_output=True,
            text=True,
        )
    assert "on PYTHONPATH (. .ci/env.sh in the clone)" in error.value.stderr


def test_version_is_a_literal_that_pip_can_read():
    (line,) = re.findall(r'^__version__ = "([^"]+)"', Path(fm.__file__).read_text(), re.M)
    assert line == fm.__version__


def test_presets_are_the_documented_discretizations():
    assert PRESETS["default"] == fm.Discretization()
    usual = fm.Discretization(normals="unit", gap_weights="basis", slip="operators")
    assert as_discretization("other_codes") == PRESETS["other_codes"] == usual
    assert PRESETS["petrov_galerkin"] == fm.Discretization(gap_weights="standard")
    for preset in PRESETS.values():
        preset.check()
        assert as_discretization(preset) is preset
    with pytest.raises(dataclasses.FrozenInstanceError):
        usual.basis = "standard"


@pytest.mark.parametrize(
    "options, allowed",
    [
        ({"basis": "lumped"}, "dual, standard"),
        ({"normals": "mean"}, "opposite, unit, own"),
        ({"points": 1}, "at least 2"),
        ({"search_radius": -1.0}, "positive length"),
        ({"max_angle": 90.0}, "between 0 and 90"),
        ({"c_n": 0.0}, "positive number"),
    ],
)
def test_refused_option_lists_allowed_values(options, allowed):
    data = fm.MeshData(SimpleNamespace(comm=MPI.COMM_SELF), None, None)
    with pytest.raises(ValueError, match=allowed):
        fm.ContactPair(data, 1, 2, **pair_options(options))
