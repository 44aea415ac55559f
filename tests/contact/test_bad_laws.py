# SPDX-License-Identifier: MIT
"""Users' laws with invalid results, with errors, or with differences between ranks."""

import re

import numpy as np
import pytest
from one_rank import LAST, raised_on_the_last_rank, several_ranks
from refusal import refused
from small_scenes import small_blocks
from spoilt_law import Spoilt, rubbing_blocks

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import laws
from fenics_mortar.contact.law import Friction
from fenics_mortar.utils.errors import NotFiniteError


def spoil_row(name):
    return lambda row: row._replace(**{name: np.nan * np.asarray(getattr(row, name))})


WRONG_ANSWERS = [
    ("branch", lambda p: p * np.nan, NotFiniteError, "branch returned numbers .* not finite at 5"),
    ("branch", lambda p: p[:2], ValueError, r"branch returned an array of shape \(2,\)"),
    ("branch", lambda p: None, ValueError, "branch returned an array of .* type object"),
    ("branch", lambda p: p + 0.5, ValueError, "branch returned .*; expected integers"),
    (
        "limit",
        lambda b: (b[0] * np.nan, *b[1:]),
        NotFiniteError,
        "limit returned .* not finite at 5",
    ),
    (
        "limit",
        lambda b: b[0],
        ValueError,
        "limit returned array[^;]*; expected a Row, or the limit",
    ),
    ("tangential", spoil_row("residual"), NotFiniteError, r"not finite at 5 nodes .* one at \("),
    ("tangential", spoil_row("by_slip"), NotFiniteError, "tangential returned numbers"),
    ("tangential", lambda row: None, ValueError, "tangential returned None; expected a Row"),
    ("tangential", lambda row: row._replace(residual=row[0][:2]), ValueError, r"shape \(2,\)"),
    (
        "friction_limit",
        lambda b: b * np.nan,
        NotFiniteError,
        "friction_limit returned nan for a pressure of",
    ),
    (
        "friction_limit",
        lambda b: b - 1.0,
        NotFiniteError,
        "friction_limit returned -0.* for a pressure of",
    ),
    (
        "friction_limit",
        lambda b: b[:2],
        ValueError,
        r"friction_limit returned an array of shape \(2,\)",
    ),
    ("adhesion", lambda a: (a[0] * np.nan, a[1]), NotFiniteError, "adhesion returned numbers"),
    ("adhesion", lambda a: (-a[0], a[1]), ValueError, "adhesion returned -0.1 .* positive stress"),
    ("adhesion", lambda a: a[0], ValueError, "adhesion returned array.* expected two arrays"),
    ("adhesion", lambda a: (a[0][:1], a[1][:1]), ValueError, r"array of shape \(1,\)"),
]


@pytest.mark.each
@pytest.mark.parametrize("method, spoil, kind, message", WRONG_ANSWERS)
def test_invalid_result_of_a_law_is_refused(method, spoil, kind, message):
    law = Spoilt(method, spoil)
    law._on = False
    scene = rubbing_blocks(law)
    scene.problem.solve()
    law._on = True
    scene.loads["push"].value[0] = 0.01
    with refused(kind, r"Spoilt\(.*mu=0.3", message):
        scene.problem.solve()
    law._on = False
    assert scene.problem.solve().converged
    law._on = True
    with refused(kind, message):
        rubbing_blocks(law).problem.solve()


class Numbered(fm.Coulomb):
    """Coulomb's law with branches from 4 on."""

    def branch(self, node, before):
        return super().branch(node, np.where(before == 0, 0, before - 5)) + 5

    def tangential(self, node, branch):
        assert (branch >= 4).all(), "not a branch of this law"
        return super().tangential(node, branch - 5)


def test_law_is_given_only_branches_that_it_returned():
    """Also if the tangent is checked before the first solve."""
    scene = rubbing_blocks(Numbered(0.3))
    scene.problem.check_tangent(print_table=False)
    assert scene.problem.solve().converged


@several_ranks
@pytest.mark.parametrize("method", ["branch", "tangential", "friction_limit", "adhesion"])
@pytest.mark.parametrize("checked", [False, True])
def test_law_that_raises_on_one_rank_raises_on_all(method, checked):
    def fail(answer):
        if LAST:
            raise ZeroDivisionError("no law here")
        return answer

    law = Spoilt(method, fail)
    law._on = False
    model_check = fm.ModelCheck() if checked else None
    scene = small_blocks(pair={"law": law}, problem={"model_check": model_check})
    scene.loads["push"].value[1] = -0.02
    scene.problem.solve()
    law._on = True
    scene.loads["push"].value[0] = 0.01
    with raised_on_the_last_rank(ZeroDivisionError, "no law here"):
        scene.problem.solve()
    law._on = False
    assert scene.problem.solve().converged


@several_ranks
@pytest.mark.parametrize("unit", [1.0, 1e-9])
def test_results_of_a_law_that_differ_on_one_rank_are_refused(unit):
    def doubled(row):
        return row._replace(residual=row[0] * (2.0 if LAST else 1.0))

    law = Spoilt("tangential", doubled, strength=0.1 * unit)
    with refused(fm.MortarError, "equations of contact differ between ranks"):
        rubbing_blocks(law, E=100.0 * unit).problem.solve()


@pytest.mark.parametrize(
    "law, name, value, message",
    [
        (fm.Coulomb(0.3), "mu", -0.5, "mu=-0.5: expected zero or a positive number"),
        (fm.Coulomb(0.3), "mu", np.nan, "mu=nan: expected zero or a positive number"),
        (fm.Coulomb(0.3), "mu", "0.3", "mu='0.3': expected zero or a positive number"),
        (fm.Coulomb(0.3), "mu", None, "mu=None"),
        (fm.Coulomb(0.3), "max_shear", -1.0, "max_shear=-1.0: expected a positive stress"),
        (fm.Coulomb(0.3), "c_t", 0.0, "c_t=0.0: expected a positive number"),
        (fm.Coulomb(0.3), "c_t", np.nan, "c_t=nan: expected a positive number"),
        (fm.Coulomb(0.3), "limit_by", "gap", "limit_by='gap': expected one of trial, pressure"),
        (fm.Tresca(1.0), "stress", -1.0, "stress=-1.0: expected zero or a positive number"),
        (fm.Tresca(1.0), "stress", np.inf, "stress=inf: expected zero or a positive number"),
        (fm.Tresca(1.0), "stress", np.array([0.3]), "stress=.*: expected zero or a positive"),
        (fm.Tresca(1.0), "stress", np.abs, "stress=.*: expected zero or a positive number"),
    ],
)
def test_invalid_parameter_set_later_is_refused(law, name, value, message):
    scene, kept = rubbing_blocks(law), getattr(law, name)
    setattr(law, name, value)
    with refused(ValueError, message):
        scene.problem.solve()
    setattr(law, name, kept)
    assert scene.problem.solve().converged


def test_user_law_checks_its_parameters():
    class Rough(fm.Coulomb):
        def check(self):
            super().check()
            if self.mu > 1.0:
                raise ValueError(f"mu={self.mu}: too rough")

    scene = rubbing_blocks(Rough(0.3))
    scene.contact.pair.law.mu = 2.0
    with refused(ValueError, "mu=2.0: too rough"):
        scene.problem.solve()


@pytest.mark.parametrize("law", [None, 0.3, fm.Coulomb])
def test_object_other_than_a_law_is_refused(law):
    scene = rubbing_blocks(fm.Coulomb(0.3))
    scene.contact.pair.law = law
    with refused(ValueError, "law of ContactPair.*: expected an instance of Frictionless, Coulomb"):
        scene.problem.solve()


@several_ranks
def test_law_whose_parameter_differs_on_one_rank_is_refused():
    scene = rubbing_blocks(fm.Coulomb(0.3))
    scene.contact.pair.law.mu = 0.1 if LAST else 0.3
    with refused(fm.MortarError, r"law of pair 0 is Coulomb\(.*mu=0.3.* on rank 0 and .*mu=0.1"):
        scene.problem.solve()


def test_law_cannot_write_into_the_state():
    class Careless(fm.Coulomb):
        def tangential(self, node, branch):
            node.z_tau[:] = 0.0
            return super().tangential(node, branch)

    with refused(ValueError, "read-only"):
        rubbing_blocks(Careless(0.3)).problem.solve()


def test_law_cannot_write_into_its_memory():
    class Careless(laws.Worn):
        def tangential(self, node, branch):
            node.memory["wear"] = np.zeros_like(node.gap)
            return super().tangential(node, branch)

    with refused(TypeError, "does not support item assignment"):
        rubbing_blocks(Careless(0.3, 0.01)).problem.solve()


class Weak(fm.Coulomb):
    """Coulomb's law with a limit reduced by a constant; ``friction_limit`` is inherited."""

    def limit(self, node):
        limit, by_gap, by_z_n = super().limit(node)
        return limit - 0.5, by_gap, by_z_n


class WeakAtNodes(fm.Coulomb):
    def friction_limit_at(self, node):
        return -0.3 * node.z_n


class Reversed(Friction):
    """Newton's method does not converge."""

    def __init__(self, factor):
        super().__init__()
        self.factor = factor

    def limit(self, node):
        pressed = node.z_n > 0.0
        return -self.factor * np.where(pressed, node.z_n, 0.0), 0.0, -self.factor * pressed


@pytest.mark.each
@pytest.mark.parametrize(
    "law, kind", [(Weak(0.3), NotFiniteError), (WeakAtNodes(0.3), NotFiniteError),
                  (Reversed(0.3), NotFiniteError), (Reversed(3.0), fm.NotConvergedError)],
)  # fmt: skip
def test_negative_friction_limit_is_named_with_law_and_place(law, kind):
    """Without a limit of its own, the certificate would compare with the one of Coulomb's law."""
    scene = small_blocks(pair={"law": law})
    scene.loads["push"].value[:] = 0.02, -0.02
    named = rf"{type(law).__name__}\(.*friction_limit returned -\d.* for a pressure of \d"
    with refused(kind, named + r".*, at 'upper/bottom' \(.*\); expected zero, a positive number"):
        scene.problem.solve()


def test_negative_coefficients_are_refused_with_their_place():
    where = r"on 'upper/bottom' it is -0.4 at \(1.6, 1\) and 0.1 at \(0.6, 1\)"
    with refused(ValueError, r"Coulomb\(function\): mu=-0.4 at a slave node.*" + where):
        small_blocks(pair={"law": fm.Coulomb(lambda X: 0.4 - 0.5 * X[:, 0])})


def test_a_law_whose_parameters_cannot_be_read_is_refused_each_time():
    """Not with the parameters of the law before."""
    problem = small_blocks(pair={"law": fm.Coulomb(0.4)}).problem
    problem.contacts[0].pair.law = fm.Coulomb(lambda X: 0.4 - 0.5 * X[:, 0])
    for _ in range(2):
        with refused(ValueError, r"Coulomb\(function\): mu=-0.4 at a slave node"):
            problem.certificate()


@pytest.mark.serial
@pytest.mark.parametrize(
    "kind, numbers, message",
    [
        (laws.Worn, (0.3, -1.0), "wear=-1.0: expected zero or a positive number"),
        (laws.Worn, (-0.3, 1.0), "mu=-0.3"),
        (laws.SoftLayer, (0.0, 1.0), "k=0.0: expected a positive number"),
        (laws.SoftLayer, (1.0, 0.5), "m=0.5: expected an exponent of at least 1"),
        (laws.SoftLayer, (np.array([1.0, -1.0]), 1.0), "k=-1.0: expected a positive"),
        (laws.SoftLayer, (1.0, np.array([1.0, 0.5])), "m=0.5: expected an exponent"),
        (laws.Worn, (np.array([0.3, 0.3]), lambda X: X), "wear=<function"),
        (laws.Cohesive, (1.0, np.inf), "reach=inf"),
        (laws.MixedCohesive, (-1.0, 1.0, 1.0), "stiffness=-1.0"),
        (laws.MixedCohesive, (10.0, 2.0, 0.2), "above strength / stiffness = 0.2"),
        (laws.Stribeck, (0.4, 0.2, 0.0), "rate=0.0"),
        (laws.Stribeck, (0.4, np.nan, 1.0), "kinetic=nan"),
        (laws.RateAndState, (0.4, 0.0, 0.1, 1.0, 1.0), "a=0.0"),
        (laws.RateAndState, (0.4, 0.1, 0.1, 1.0, 0.0), "v_0=0.0"),
        (laws.RateAndState, (0.4, 0.1, 0.1, 1.0, 1.0, -1.0), "theta_0=-1.0"),
    ],
)
def test_invalid_number_of_a_law_is_refused(kind, numbers, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        kind(*numbers)


def test_invalid_number_of_a_law_set_later_is_refused():
    law = laws.Worn(0.3, 0.01)
    scene = rubbing_blocks(law)
    law.wear = -1.0
    with refused(ValueError, "wear=-1.0: expected zero or a positive number"):
        scene.problem.solve()


@pytest.mark.parametrize("kind", ["thickness", "mu", "heating", "h", "distance"])
def test_expressions_of_ufl_are_no_functions_of_positions(kind):
    """They can be called, but a call with arrays never ends."""
    scene = small_blocks()
    space = fm.scalar_space(scene.data.mesh, 1)
    for value in (fem.Constant(scene.data.mesh, 0.3), fem.Function(space)):
        make = {
            "thickness": lambda v=value: small_blocks(problem={"thickness": v}),
            "mu": lambda v=value: fm.Coulomb(v),
            "heating": lambda v=value: fm.Conductance(1, 1.0, heating=v),
            "h": lambda v=value: fm.Conductance(1, v),
            "distance": lambda v=value: fm.SignedDistance(v),
        }[kind]
        if kind == "mu" and isinstance(value, fem.Function):
            make()  # whose values at the nodes are read
            continue
        with pytest.raises(ValueError, match="expected"):
            make()
