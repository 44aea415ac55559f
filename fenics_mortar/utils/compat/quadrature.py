# SPDX-License-Identifier: MIT
"""Quadrature rules of integrals over cells, as FFCx chooses them."""

from __future__ import annotations

from typing import Any

import numpy as np

import basix
import ufl
from ufl.algorithms import compute_form_data

from fenics_mortar.utils.arrays import Array, Indices

# Name of a rule, and its degree, or its points if it is custom.
Rule = tuple[str, Any]


def quadrature_rules(form: ufl.Form, integral: Any) -> list[tuple[Rule, int]]:
    """Rules of one integral over cells of a form, and the subdomain of each (local).

    Returns:
        A rule and the number of its subdomain, -1 for all cells.
    """
    numbers = integral.subdomain_id()
    numbers = [_number(n) for n in (numbers if isinstance(numbers, tuple) else (numbers,))]
    given = integral.metadata() or {}
    name = given.get("quadrature_rule", "default")
    if name == "custom":
        points = tuple(map(tuple, np.asarray(given["quadrature_points"])[:, :2].tolist()))
        return [((name, points), number) for number in numbers]
    degree = given.get("quadrature_degree", -1)
    if isinstance(degree, int) and degree >= 0:
        return [((name, degree), number) for number in numbers]
    estimated = _estimated_degrees(form)
    return [((name, estimated[number]), number) for number in numbers]


def _number(number: Any) -> int:
    return -1 if number in ("everywhere", "otherwise") else int(number)


def _estimated_degrees(form: ufl.Form) -> dict[int, int]:
    """Degrees of the integrals over cells without a given one, by subdomain.

    The options are those of FFCx, on which the estimate depends.
    """
    data = compute_form_data(
        form,
        do_apply_function_pullbacks=True,
        do_apply_integral_scaling=True,
        do_apply_geometry_lowering=True,
        preserve_geometry_types=(ufl.classes.Jacobian,),
        do_apply_restrictions=True,
        do_append_everywhere_integrals=False,
    )
    found = dict[int, int]()
    for group in data.integral_data:
        if group.integral_type != "cell":
            continue
        numbers = group.subdomain_id
        for integral in group.integrals:
            if integral.metadata().get("quadrature_degree", -1) in (-1, None):
                degree = int(np.max(integral.metadata()["estimated_polynomial_degree"]))
                for n in numbers if isinstance(numbers, tuple) else (numbers,):
                    found[_number(n)] = degree
    return found


def quadrature_points(cell_name: str, rule: Rule) -> Array:
    """Points of a rule in the reference cell, shape (p, 2) [1] (local).

    The order of the arguments of ``basix.make_quadrature``, and the names of rules, differ between
    0.5 and 0.7; sets of polynomials, its last argument, are new there.
    """
    name, degree = rule
    cell = getattr(basix.CellType, cell_name)
    if name == "custom":
        return np.array(degree, float)
    if name == "vertex":
        return np.asarray(basix.geometry(cell))
    kinds = {key.lower(): kind for key, kind in basix.QuadratureType.__members__.items()}
    kind = kinds[name.lower().replace("-", "_")]
    rule_first = not hasattr(basix, "PolysetType")
    given = (kind, cell, degree) if rule_first else (cell, degree, kind)
    points, _ = basix.make_quadrature(*given)
    return np.asarray(points)


def subdomain_cells(tags: Any, number: int, count: int) -> Indices:
    """Cells of a subdomain of an integral, of the first ``count`` local cells (local).

    Args:
        tags: Subdomain data of the integral: tags of dolfinx, ``None``, or since 0.7 pairs of a
            number and its cells.
        number: Number of the subdomain, -1 for all cells.
        count: Number of the owned cells.
    """
    if number < 0:
        return np.arange(count)
    if hasattr(tags, "find"):
        cells = tags.find(number)
    else:
        cells = np.concatenate([np.empty(0), *(c for n, c in tags if n == number)])
    return np.asarray(cells[cells < count], np.int64)
