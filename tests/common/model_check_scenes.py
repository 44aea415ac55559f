# SPDX-License-Identifier: MIT
"""Pressed blocks by one of the models."""

from scenes import internal, linear_elastic, neo_hookean, pressed_blocks

from dolfinx import fem

import fenics_mortar as fm

MESH = {"n_upper": 7, "n_lower": 11, "layers_upper": 4, "layers_lower": 4}


def blocks(push, *, strain="linear", sliding="finite", solve=True, **check):
    """Two blocks solved by a model and checked by the finite-strain residual."""
    scene = pressed_blocks(**MESH)
    data, V, bcs = scene.data, scene.u.function_space, scene.problem.equations.bulk.bcs
    u = fem.Function(V)
    materials = {"linear": linear_elastic, "finite": neo_hookean}
    forms = {name: internal(u, law(u, 100.0, 0.3)) for name, law in materials.items()}
    richer = {"finite_strain": forms["finite"]} if strain == "linear" else {}
    problem = fm.ContactProblem(
        forms[strain], u, [fm.ContactPair(data, "upper/bottom", "lower/top", sliding=sliding)],
        bcs=bcs, petsc_options_prefix="test_",
        model_check=fm.ModelCheck(**{"tolerance": 0.02, **richer, **check}),
    )  # fmt: skip
    scene.loads["push"].value[:] = push
    return problem, (problem.solve() if solve else None)
