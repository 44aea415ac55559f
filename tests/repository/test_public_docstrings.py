# SPDX-License-Identifier: MIT
"""Docstrings of all public classes and functions: arguments, shapes, units, errors, ranks.

Public are the names that the package, ``energies``, ``laws`` and ``sensitivity`` export, and the
classes of all results that their attributes and methods return.
"""

import ast
import inspect
import re
import textwrap
import typing
from functools import cached_property
from pathlib import Path

import pytest

import fenics_mortar as fm
from fenics_mortar import energies, laws, sensitivity
from fenics_mortar.bulk.inertia import Rates
from fenics_mortar.contact.fields import InterfaceState
from fenics_mortar.contact.law import Nodal, Row
from fenics_mortar.contact.view import PairView
from fenics_mortar.equations.general import State
from fenics_mortar.models.model_error import Assumption
from fenics_mortar.newton.loop import Iteration
from fenics_mortar.path.report import Energies, PathStep, TimeStep, Work
from fenics_mortar.sensitivity.gradient import Gradient, TangentLinear
from fenics_mortar.sensitivity.objective import Kink, RecordedStep
from fenics_mortar.verify.finding import Crossing, Finding
from fenics_mortar.verify.node_paths import AcceptedPositions
from fenics_mortar.verify.tangent import OperatorMatrices

RESULTS = (
    PairView, OperatorMatrices, State, InterfaceState, Rates, Nodal, Row, Assumption, Iteration,
    Energies, TimeStep, PathStep, Work, Gradient, Kink, RecordedStep,
    TangentLinear, AcceptedPositions, Crossing, Finding,
)  # fmt: skip
UNIT = re.compile(
    r"\[[\w ^/*.,'\s-]+\]|\[(its|their) units?\]|dimensionless|[Rr]elative|over the", re.S
)
SHAPE = re.compile(r"[Ss]hape|\(\w[\w ]*, ?[\w ]*\)")
RANKS = re.compile(r"\b(collective|local)\b", re.I)
# In the docstring of a class: a statement for all methods, or for all attributes of a result.
ALL_METHODS = re.compile(
    r"(methods?|properties|attributes|constructor|functions)\b[^.]*\b(local|collective)\b"
    r"|[;(]\s*(local|collective)\b|\bCollective\b|\b(collective|local)\.",
    re.I,
)
OF_PACKAGE = "fenics_mortar"
PACKAGE = Path(fm.__file__).parent
# Files of the constructors of data classes, and of protocols, which have no arguments.
GENERATED = "<string>", typing.__file__


def entries(text):
    """Text of each argument and attribute by name, in a docstring."""
    found = {}
    for block in re.split(r"\n(?=[A-Z]\w+:\n)", text):
        if re.match(r"(Args|Attributes):\n", block):
            for entry in re.split(r"\n(?= {4}\S)", block)[1:]:
                match = re.match(r"\s*([\w*, ]+):\s+(.*)", entry, re.S)
                if match:
                    found |= dict.fromkeys(match[1].replace("*", "").split(", "), match[2])
    return found


def own_classes(cls):
    return [base for base in cls.__mro__ if base.__module__.startswith(OF_PACKAGE)]


def documentation(cls):
    return "\n".join(filter(None, (inspect.cleandoc(c.__doc__ or "") for c in own_classes(cls))))


def function_of(value):
    """Function of a method, property or cached property, else the value."""
    if isinstance(value, cached_property):
        return value.func
    return getattr(value, "fget", None) or getattr(value, "__func__", value)


def public_classes():
    names = {name: getattr(fm, name) for name in fm.__all__}
    modules = energies, laws, sensitivity
    names |= {name: getattr(module, name) for module in modules for name in module.__all__}
    classes = dict.fromkeys([value for value in names.values() if inspect.isclass(value)])
    functions = {name: f for name, f in names.items() if inspect.isfunction(f)}
    return [*classes, *(cls for cls in RESULTS if cls not in classes)], functions


def public():
    """Name, function, its documentation and that of its class, of all that users call.

    The documentation of a method includes that of the methods that it overrides.
    """
    classes, functions = public_classes()
    for name, function in functions.items():
        yield name, function, inspect.getdoc(function) or "", ""
    for cls in classes:
        about = documentation(cls)
        constructor = None if cls in RESULTS else cls.__dict__.get("__init__")
        if inspect.isfunction(constructor) and constructor.__code__.co_filename not in GENERATED:
            yield cls.__name__, constructor, about, about
        for attribute in dir(cls):
            call = function_of(inspect.getattr_static(cls, attribute, None))
            if attribute.startswith("_") or not inspect.isfunction(call):
                continue
            if call.__module__.startswith(OF_PACKAGE):
                assert inspect.getdoc(call), f"{cls.__name__}.{attribute} has no docstring"
                texts = [inspect.getdoc(getattr(c, attribute, None)) for c in own_classes(cls)]
                yield f"{cls.__name__}.{attribute}", call, "\n".join(filter(None, texts)), about


PUBLIC = [pytest.param(call, text, about, id=name) for name, call, text, about in public()]
CLASSES = [pytest.param(cls, id=cls.__name__) for cls in public_classes()[0]]


def raises(call):
    """Whether a function raises, or calls a check that does."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(call)))
    calls = [ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)]
    checks = [name for name in calls if re.fullmatch(r"(self\._?|_)?check(_\w+)?|together", name)]
    return bool(checks) or any(isinstance(node, ast.Raise) for node in ast.walk(tree))


@pytest.mark.serial
@pytest.mark.parametrize("call, text, about", PUBLIC)
def test_docstring_states_arguments_shapes_units_errors_and_whether_it_is_collective(
    call, text, about
):
    assert RANKS.search(text) or ALL_METHODS.search(about), "collective or local?"
    signature, described = inspect.signature(call), entries(about) | entries(text)
    for name, argument in signature.parameters.items():
        if name in ("self", "cls"):
            continue
        entry = described.get(name, text)
        assert name in described or re.search(rf"\b{name}\b", text + about), f"argument {name}"
        if argument.annotation in ("Array", "npt.ArrayLike", "Indices", "Flags"):
            assert SHAPE.search(entry), f"shape of {name}"
        if argument.annotation in ("Array", "float", "float | None"):
            assert UNIT.search(entry), f"unit of {name}"
    returns = str(signature.return_annotation)
    is_array = re.search(r"\bArray\b", returns)
    if is_array:
        assert SHAPE.search(text), "shape"
    if is_array or returns == "float":
        assert UNIT.search(text), "unit"
    assert not raises(call) or "Raises:" in text + about, "errors"


@pytest.mark.serial
@pytest.mark.parametrize("cls", CLASSES)
def test_docstring_of_a_class_states_shapes_and_units_of_its_attributes(cls):
    about = documentation(cls)
    described, summary = entries(about), about.split("Attributes:")[0]
    for base in own_classes(cls):
        for name, kind in inspect.get_annotations(base).items():
            if name.startswith("_"):
                continue
            assert name in described, name
            if re.search(r"\b(Array|Indices|Flags)\b", str(kind)):
                assert SHAPE.search(described[name] + summary), f"shape of {name}"
            if re.search(r"\b(Array|float)\b", str(kind)):
                assert UNIT.search(described[name] + summary), f"unit of {name}"


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
