# SPDX-License-Identifier: MIT
"""Public functions and methods of the package, and those that are called in a context."""

import cProfile
import inspect
from contextlib import contextmanager

import fenics_mortar as fm
from fenics_mortar import sensitivity


def public():
    """Code of each public function, method and property by its name."""
    found = {}
    for module in (fm, sensitivity):
        for name in module.__all__:
            thing = getattr(module, name)
            if inspect.isclass(thing):
                found |= {f"{name}.{what}": code for what, code in methods(thing)}
            elif inspect.isfunction(thing):
                found[name] = thing.__code__
    return found


def methods(kind):
    """Names and codes of the public methods and properties of a class, and of its set-up."""
    for name in dir(kind):
        if name.startswith("_") and name not in ("__init__", "__call__", "__str__", "__getitem__"):
            continue
        member = inspect.getattr_static(kind, name)
        parts = [member.fget, member.fset] if isinstance(member, property) else [member]
        for part, suffix in zip(parts, ("", " =")):
            function = inspect.unwrap(getattr(part, "__func__", part)) if part else None
            code = getattr(function, "__code__", None)
            if code is not None and fm.__name__ in code.co_filename:
                yield name + suffix, code


@contextmanager
def calls():
    """Context that yields a set, to which the codes of all functions called in it are added."""
    profile, found = cProfile.Profile(), set()
    profile.enable()
    try:
        yield found
    finally:
        profile.disable()
        found.update(entry.code for entry in profile.getstats())
