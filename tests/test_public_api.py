# SPDX-License-Identifier: MIT
"""What users import: it exists, is documented, and stays small."""

import inspect

import pytest

import fenics_mortar as fm


@pytest.mark.parametrize("name", fm.__all__)
def test_public_name_exists_and_is_documented(name):
    thing = getattr(fm, name)
    assert inspect.getdoc(thing)


@pytest.mark.parametrize(
    "name", ["ContactPair", "ContactProblem", "read_gmsh", "dirichlet", "plot"]
)
def test_public_call_documents_arguments_and_errors(name):
    text = inspect.getdoc(getattr(fm, name))
    assert "Args:" in text and "Raises:" in text
    for parameter in inspect.signature(getattr(fm, name)).parameters:
        assert f"{parameter}:" in text, parameter


def test_public_names_are_few():
    assert len(fm.__all__) <= 33


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
def test_refused_option_says_what_is_allowed(options, allowed):
    data = fm.MeshData(None, None, None)
    with pytest.raises(ValueError, match=allowed):
        fm.ContactPair(data, 1, 2, **options)
