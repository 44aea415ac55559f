# SPDX-License-Identifier: MIT
"""Contact laws with adhesion: the normal row of open nodes."""

import numpy as np
import pytest
from friction_scenes import block_on
from scenes import TIGHT, internal, linear_elastic, neo_hookean, nodal, pressed_blocks, read
from scipy.optimize import brentq

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.energies import lame
from meshes import two_blocks

E, NU = 100.0, 0.3
# Below the stiffness of a column, 134 / 2: otherwise it would jump.
STRESS, RANGE = 4.0, 0.1
MESH = {"n_upper": 3, "n_lower": 4, "layers_upper": 2, "layers_lower": 2}


class Sticky(fm.Coulomb):
    """Adhesion that decreases exponentially, as in the docstring of ``laws``."""

    def adhesion(self, gap):
        pull = STRESS * np.exp(-gap / RANGE)
        return pull, -pull / RANGE


class Clinging(fm.Frictionless):
    """Adhesion alone."""

    adhesion = Sticky.adhesion


class Glued(Sticky):
    """Friction proportional to pressure plus adhesion."""

    def limit(self, node):
        bound, by_gap, by_z_n = super().limit(replaced(node, z_n=node.z_n + STRESS))
        return bound, by_gap, by_z_n

    def friction_limit(self, pressure):
        return super().friction_limit(pressure + STRESS)


def replaced(node, **values):
    return type(node)(**{**vars(node), **values})


def columns(law, *, degree=1, material=neo_hookean, sliding="finite", **problem):
    """Two blocks between frictionless walls, and the constant that moves the top [length]."""
    data = read(two_blocks.build, width_upper=1.0, width_lower=1.0, **MESH)
    V = fm.vector_space(data.mesh, degree)
    u, lift = fem.Function(V), fem.Constant(data.mesh, 0.0)
    walls = [f"{body}/{side}" for body in ("upper", "lower") for side in ("left", "right")]
    fixed = [fm.dirichlet(V, data, wall, 0.0, component=0) for wall in walls]
    fixed += [
        fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0)),
        fm.dirichlet(V, data, "upper/top", lift, component=1),
    ]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=law, sliding=sliding)
    problem_ = fm.ContactProblem(
        internal(u, material(u, E, NU)), u, [pair], bcs=fixed,
        petsc_options_prefix="test_", newton=TIGHT, **problem,
    )  # fmt: skip
    return problem_, lift


def traction(stretch: float) -> float:
    """First Piola-Kirchhoff stress, and Cauchy's, under uniaxial strain."""
    mu, lmbda = lame(E, NU)
    return mu * (stretch - 1.0 / stretch) + lmbda * np.log(stretch) / stretch


@pytest.mark.once
@pytest.mark.parametrize(
    "law, options",
    [
        (Sticky(0.3), {"algorithm": "condensed"}),
        (Sticky(0.3), {"algorithm": "saddle"}),
        (Clinging(), {"algorithm": "condensed"}),
    ],
)
@pytest.mark.parametrize("degree", [1, 2])
def test_columns_are_pulled_by_the_closed_form(degree, law, options):
    """The stress of two columns of height 2 is the adhesion across their gap, to rounding.

    Closed gaps transmit tensions up to a(0), open gaps a(g).
    """
    problem, lift = columns(law, degree=degree, **options)
    height = 2.0
    contact = problem.equations.contacts[0]
    for up in (-0.02, 0.03, 0.08, 0.12, 0.2):
        lift.value = up
        record = problem.solve()
        assert record.certificate.violations() == []
        closed = traction(1.0 + up / height)
        if closed <= STRESS:
            assert contact.active[contact.covered].all()
            gap, pull = 0.0, closed
        else:
            assert contact.attracted[contact.covered].all()
            gap = brentq(lambda g, up=up: balance(g, up, height), 0.0, up, xtol=1e-15)
            pull = STRESS * np.exp(-gap / RANGE)
        on = contact.covered
        assert contact.pressure[on] == pytest.approx(-pull, rel=1e-10)
        assert contact.gap[on] == pytest.approx(gap, abs=1e-12)
        assert np.abs(contact.z_tau).max() < 1e-10


def balance(gap: float, up: float, height: float) -> float:
    return traction(1.0 + (up - gap) / height) - STRESS * np.exp(-gap / RANGE)


@pytest.mark.once
@pytest.mark.parametrize("law", [Sticky(0.3), Glued(0.3)])
@pytest.mark.parametrize("degree", [1, 2])
def test_tangent_has_slope_two(degree, law):
    """Pressed at one end and opened at the other; half of the nodes are set to open."""
    scene = pressed_blocks(degree=degree, pair={"law": law}, **MESH)
    push, problem, contact = scene.loads["push"], scene.problem, scene.contact
    push.value[:] = (0.0, -0.01)
    problem.solve()
    push.value[:] = (0.01, 0.03)
    problem.solve()
    first = np.arange(contact.active.size) < contact.active.size // 2
    contact.change(active=contact.active & ~first)
    assert contact.active.any() and contact.attracted.any()
    for branches in ([0], [1, 0, -1]):
        contact.change(branch=np.resize(branches, contact.branch.size))
        assert problem.check_tangent(print_table=False).slopes["whole"] == pytest.approx(
            2.0, abs=0.02
        )


@pytest.mark.once
def test_tangent_with_an_adhesive_obstacle_has_slope_two():
    """The motions of the obstacle are directions of the test, too."""
    circle = fm.Circle((0.5, -2.0), 2.01)
    problem, _ = block_on(circle, law=Sticky(0.3))
    record = problem.solve()
    contact = problem.equations.contacts[0]
    assert record.certificate.violations() == []
    assert contact.active.any() and contact.attracted.any()
    assert problem.check_tangent(print_table=False).slopes["whole"] == pytest.approx(2.0, abs=0.02)


@pytest.mark.once
@pytest.mark.parametrize(
    "options",
    [{"algorithm": "saddle"}, {"solver": "iterative"}, {"linear_bulk": True}],
    ids=lambda options: next(iter(options)),
)
@pytest.mark.parametrize(
    "pair", [{"law": Sticky(0.3)}, {"law": Clinging(), "sliding": "small"}], ids=["large", "small"]
)
def test_all_solvers_agree(pair, options):
    """Partly closed, partly open gaps."""
    states = []
    for problem in ({"linear_bulk": False, "solver": "direct"}, options):
        scene = pressed_blocks(material=linear_elastic, pair=pair, problem=problem, **MESH)
        for place in ((0.0, -0.01), (0.02, 0.08)):
            scene.loads["push"].value[:] = place
            scene.problem.solve()
        states.append((nodal(scene.problem), scene.contact.z))
        assert scene.contact.attracted.any()
    for one, other in zip(*states, strict=True):
        assert np.abs(one - other).max() < 1e-9 * np.abs(one).max()


@pytest.mark.once
def test_friction_limit_includes_adhesion():
    """Blocks under tension have friction, too."""
    scene = pressed_blocks(pair={"law": Glued(0.3)}, **MESH)
    push, contact = scene.loads["push"], scene.contact
    for place in ((0.0, -0.01), (0.0, 0.01), (0.1, 0.01), (0.2, 0.01)):
        push.value[:] = place
        assert scene.problem.solve().certificate.violations() == []
    on = contact.active
    assert on.any() and (contact.pressure[on] < 0.0).any() and contact.sliding[on].all()
    bound = 0.3 * (contact.pressure + STRESS)
    assert np.abs(contact.z_tau)[on] == pytest.approx(bound[on], rel=1e-9)
