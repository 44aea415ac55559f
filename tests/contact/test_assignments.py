# SPDX-License-Identifier: MIT
"""No module assigns to an attribute of a contact but the contact's own: states are replaced."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import fenics_mortar as fm

PACKAGE = Path(fm.__file__).parent
# Classes whose objects are contacts; their modules may assign to all their own parts.
CONTACTS = ("Interface", "Contact", "Tie")
# Classes whose objects are parts of a contact.
PARTS = (
    "InterfaceState", "OperatorEvaluation", "InterfaceFields", "ContactFields", "TiedFields",
    "MultiplierNodes",
)  # fmt: skip
# What users may set on a pair: the view passes it on.
FOR_USERS = {("contact/view.py", "offset"), ("contact/view.py", "c_n")}


def leaves(target: ast.expr) -> Iterator[ast.expr]:
    """The single targets of an assignment."""
    if isinstance(target, ast.Tuple | ast.List):
        for part in target.elts:
            yield from leaves(part)
    elif isinstance(target, ast.Starred | ast.Subscript):
        yield from leaves(target.value)
    else:
        yield target


def targets(node: ast.AST) -> list[ast.expr]:
    """Targets to which a node assigns, also by loops, contexts, ``del`` and ``setattr``."""
    if isinstance(node, ast.Assign | ast.Delete):
        return list(node.targets)
    if isinstance(node, ast.AugAssign | ast.AnnAssign | ast.For | ast.comprehension):
        return [node.target]
    if isinstance(node, ast.With):
        return [item.optional_vars for item in node.items if item.optional_vars]
    if isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("setattr", "__setattr__")):
        name = node.args[1]
        known = name.value if isinstance(name, ast.Constant) else "(any)"
        return [ast.Attribute(node.args[0], known)]
    return []


def assigned(tree: ast.AST) -> Iterator[tuple[ast.expr, str, int]]:
    """Owner, attribute and line of each assignment to an attribute."""
    for node in ast.walk(tree):
        for target in targets(node):
            for leaf in leaves(target):
                if isinstance(leaf, ast.Attribute):
                    yield leaf.value, leaf.attr, node.lineno if hasattr(node, "lineno") else 0
                elif isinstance(leaf, ast.Call) and ast.unparse(leaf.func) == "vars":
                    yield leaf.args[0], "(any)", node.lineno


def is_self(owner: ast.expr) -> bool:
    return isinstance(owner, ast.Name) and owner.id == "self"


def attributes(kind: ast.ClassDef) -> set[str]:
    """All attributes of a class: those of its body, and those set by its methods."""
    found = {attribute for owner, attribute, _ in assigned(kind) if is_self(owner)}
    for node in kind.body:
        for target in targets(node):
            found |= {leaf.id for leaf in leaves(target) if isinstance(leaf, ast.Name)}
    return found


def attributes_by_module(names: tuple[str, ...]) -> dict[str, set[str]]:
    """Attributes of the classes with these names, by the modules that define them."""
    found: dict[str, set[str]] = {}
    for path in sorted((PACKAGE / "contact").glob("*.py")):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef) and node.name in names:
                module = str(path.relative_to(PACKAGE))
                found[module] = found.get(module, set()) | attributes(node)
    return found


OF_KINDS = attributes_by_module(CONTACTS)
ATTRIBUTES = attributes_by_module(CONTACTS + PARTS)
OF_CONTACTS = set().union(*ATTRIBUTES.values())


def outside(module: str, text: str) -> list[str]:
    """Assignments in a module to attributes of contacts that are not its own."""
    if module in OF_KINDS:
        return []
    return [
        f"{module}:{line}: {ast.unparse(owner)}.{name}"
        for owner, name, line in assigned(ast.parse(text))
        if name in OF_CONTACTS
        and not is_self(owner)
        and name not in ATTRIBUTES.get(module, ())
        and (module, name) not in FOR_USERS
    ]


@pytest.mark.once
def test_no_module_assigns_to_a_contact_outside_its_own():
    assert len(OF_KINDS) == len(CONTACTS)
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        found += outside(str(path.relative_to(PACKAGE)), path.read_text())
    assert found == []
    assert {"z", "active", "offset", "c_n", "_state", "now", "behind", "stiffness"} <= OF_CONTACTS
    assert len(OF_CONTACTS) > 60


@pytest.mark.each
@pytest.mark.parametrize(
    "line",
    [
        "contact.z = z",
        "contact.c_n *= 0.5",
        "contact.state.z[0] = 1.0",
        "for contact.active in sets: pass",
        "a, (contact.branch, b) = values",
        "self.contacts[0]._state = state",
        "setattr(contact, 'partners', None)",
        "object.__setattr__(state, 'z', z)",
        "contact.evaluation.behind = behind",
        "with this as contact.now: pass",
        "del contact.now",
        "contact.offset: float = 0.0",
    ],
)
def test_each_way_to_assign_is_found(line):
    assert len(outside("path/anything.py", line)) == 1
    assert outside("contact/contact.py", line) == []
