# SPDX-License-Identifier: MIT
"""Two blocks of few cells: pressed, or pushed and hardly supported."""

from petsc4py import PETSc

import numpy as np
from scenes import internal, neo_hookean, pressed_blocks, read

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

import fenics_mortar as fm
from meshes import two_blocks

SMALL = {"n_upper": 4, "n_lower": 6, "layers_upper": 3, "layers_lower": 3}


def small_blocks(**options):
    return pressed_blocks(**SMALL, **options)


def pushed_block(*, gap=0.0, pin=(), load=-1.0, slant=0.0, law=None, algorithm=None):
    """Upper block under a traction, whose only Dirichlet conditions are those of a corner."""
    data = read(two_blocks.build, **SMALL, gap=gap)
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    ds = ufl.Measure("ds", domain=data.mesh, subdomain_data=data.facet_tags)
    traction = fem.Constant(data.mesh, (slant, load))
    work = ufl.inner(traction, v) * ds(data.boundaries["upper/top"])
    bcs = [fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0))]
    data.mesh.topology.create_connectivity(0, 2)
    corner = dmesh.locate_entities(
        data.mesh, 0, lambda x: np.isclose(x[0], 0.6) & np.isclose(x[1], 2.0 + gap)
    )
    for component in pin:
        dofs = fem.locate_dofs_topological(V.sub(component), 0, corner)
        bcs.append(fem.dirichletbc(PETSc.ScalarType(0.0), dofs, V.sub(component)))
    return fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)) - work,
        u,
        [fm.ContactPair(data, "upper/bottom", "lower/top", law=law or fm.Frictionless())],
        bcs=bcs,
        algorithm=algorithm,
        petsc_options_prefix="test_errors_",
    )
