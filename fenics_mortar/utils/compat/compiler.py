# SPDX-License-Identifier: MIT
"""The form compiler: its output, its options, and forms that it would not free (local)."""

from __future__ import annotations

import inspect
import logging
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import ufl.corealg
from ufl.algorithms import compute_form_data  # noqa: F401 (imports all rules)


def _is_reported(record: logging.LogRecord) -> bool:
    """Whether a log record is a warning or does not come from setuptools."""
    return record.levelno >= logging.WARNING or "distutils" not in record.pathname


@contextmanager
def quiet_compiler() -> Iterator[None]:
    """Context without the lines "INFO:root:building ..." of the form compiler (local).

    For compilation cffi calls setuptools, which sets the level of the root logger and logs each
    command of the C compiler. FFCx hides these records since 0.9. Level and handlers are restored;
    warnings and other records are not suppressed.
    """
    root = logging.getLogger()
    level, handlers = root.level, root.handlers[:]
    root.addFilter(_is_reported)
    try:
        yield
    finally:
        root.removeFilter(_is_reported)
        root.setLevel(level)
        root.handlers[:] = handlers


@contextmanager
def log_compilation(what: str) -> Iterator[None]:
    """Context that logs what the C compiler compiled and its time, level INFO (local).

    Code loaded from a cache is not logged, since no compiler runs then.

    Args:
        what: Description of the code.
    """
    begin, before = time.perf_counter(), os.times()
    yield
    after = os.times()
    if after.children_user > before.children_user:
        seconds = time.perf_counter() - begin
        logger = logging.getLogger("fenics_mortar")
        logger.info("compiled %s in %.1f s; later runs load it from the cache", what, seconds)


def own_options(function: Callable) -> dict[str, dict]:
    """Give ``function`` fresh dictionaries; ``..._params`` became ``..._options`` in 0.6."""
    names = ("form_compiler_params", "form_compiler_options", "jit_params", "jit_options")
    return {name: {} for name in names if name in inspect.signature(function).parameters}


def free_forms() -> None:
    """Let UFL free the forms that it has differentiated (local).

    In Python 3.13.0 and 3.13.1 ``functools.singledispatchmethod`` keeps all its objects alive, by a
    cache whose values refer to their keys (CPython issue 127750). UFL's rules since 2025.1 use it:
    no mesh would be freed, nor its nine communicators, of which MPICH has 2048. The cache is
    replaced by ``None``, by which Python itself turns it off.
    """
    module = getattr(ufl.corealg, "dag_traverser", None)
    rules = [] if module is None else [module.DAGTraverser]
    while rules:
        rule = rules.pop()
        rules += rule.__subclasses__()
        for method in vars(rule).values():
            if getattr(method, "_method_cache", None) is not None:
                method._method_cache = None


free_forms()
