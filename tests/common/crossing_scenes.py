# SPDX-License-Identifier: MIT
"""Problems with bodies that may cross, and the messages on crossings."""

from __future__ import annotations

import numpy as np
from scenes import internal, neo_hookean, rotation

import ufl

import fenics_mortar as fm

DX = ufl.dx(metadata={"quadrature_degree": 2})


def messages_with(report, word):
    return [violation for violation in report.certificate.violations() if word in violation]


def is_silent(report):
    return not (report.certificate.violations() or report.certificate.passages)


def problem_of(data, pairs, bcs, u, load=0.0, **options):
    residual = internal(u, neo_hookean(u, 100.0, 0.3)) - load
    return fm.ContactProblem(residual, u, pairs, bcs=bcs, petsc_options_prefix="cross_", **options)


def move_body(problem, where, new):
    """Move the nodes of the body at ``where`` (x -> bool) to ``new`` (x) directly."""
    bulk, labels = problem.equations.bulk, problem.equations.floating.labels
    x = bulk.positions()
    found = {
        body
        for mine in problem.equations.comm.allgather(labels[where(x)].tolist())
        for body in mine
    }
    assert len(found) == 1
    mine = labels == found.pop()
    bulk.u.x.array[bulk.space.dofs[mine]] += (new(x) - x)[mine]


def turned(centre, degrees):
    return lambda x: (x - centre) @ rotation(np.radians(degrees)).T + centre
