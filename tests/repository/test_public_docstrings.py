# SPDX-License-Identifier: MIT
"""Docstrings: arguments, shapes, units, ranks of all that users call; units of all functions."""

import ast
import inspect
import re
from pathlib import Path

import pytest

import fenics_mortar as fm
from fenics_mortar.contact.state import InterfaceState
from fenics_mortar.contact.view import PairView
from fenics_mortar.equations.state import State
from fenics_mortar.verify.matrices import OperatorMatrices

UNIT = re.compile(r"\[[\w ^/*.,-]+\]")
PACKAGE = Path(fm.__file__).parent


def public():
    """Name, function, its documentation and that of its class, of all that users call.

    The documentation of a method includes that of the methods that it overrides.
    """
    things = {name: getattr(fm, name) for name in fm.__all__}
    things |= {cls.__name__: cls for cls in (PairView, OperatorMatrices, State, InterfaceState)}
    for name, thing in things.items():
        if not inspect.isclass(thing):
            yield name, thing, inspect.getdoc(thing) or "", ""
            continue
        classes = [cls for cls in thing.__mro__ if cls.__module__ != "builtins"]
        about = "\n".join(filter(None, map(inspect.getdoc, classes)))
        for attribute in dir(thing):
            value = inspect.getattr_static(thing, attribute, None)
            call = getattr(value, "fget", None) or getattr(value, "__func__", value)
            if attribute.startswith("_") or not inspect.isfunction(call):
                continue
            if call.__module__.startswith("fenics_mortar"):
                assert inspect.getdoc(call), f"{name}.{attribute} has no docstring"
                texts = [inspect.getdoc(getattr(cls, attribute, None)) for cls in classes]
                yield f"{name}.{attribute}", call, "\n".join(filter(None, texts)), about


PUBLIC = [pytest.param(call, text, about, id=name) for name, call, text, about in public()]


@pytest.mark.serial
@pytest.mark.parametrize("call, text, about", PUBLIC)
def test_docstring_states_arguments_shapes_units_and_whether_it_is_collective(call, text, about):
    assert re.search(r"\b(collective|local)\b", text + about, re.I), "collective or local?"
    signature = inspect.signature(call)
    for name in signature.parameters:
        assert name == "self" or re.search(rf"\b{name}\b", text + about), f"argument {name}"
    returns = str(signature.return_annotation)
    is_array = re.search(r"\bArray\b", returns)
    if is_array:
        assert re.search(r"[Ss]hape|\(\w[\w ]*, ?[\w ]*\)", text), "shape"
    if is_array or returns == "float":
        assert UNIT.search(text), "unit"


def functions():
    """Module, line, function and docstring of all functions and methods that have a public name."""
    for file in sorted(PACKAGE.rglob("*.py")):
        for node in ast.parse(file.read_text()).body:
            body = node.body if isinstance(node, ast.ClassDef) else [node]
            for function in body:
                if isinstance(function, ast.FunctionDef) and not function.name.startswith("_"):
                    yield f"{file.relative_to(PACKAGE)}:{function.lineno}", function


def test_all_functions_that_return_arrays_or_numbers_state_units():
    """Or refer to a function or class that does."""
    without, count = [], 0
    for where, function in functions():
        returns = ast.unparse(function.returns) if function.returns else ""
        text = ast.get_docstring(function) or ""
        if re.search(r"\bArray\b", returns) or returns == "float":
            count += 1
            if not (UNIT.search(text) or re.search("[Ss]ee ``", text)):
                without.append(f"{where} {function.name}")
    assert without == [] and count > 300
