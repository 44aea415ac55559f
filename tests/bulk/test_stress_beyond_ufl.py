# SPDX-License-Identifier: MIT
"""A stress computed by numpy at the quadrature points, with its derivative and its history."""

import numpy as np
import pytest
from history_scenes import Block
from refusal import COMM, refused

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.energies import lame
from fenics_mortar.utils import compat

E, NU, YIELD, H = 200.0, 0.3, 1.0, 10.0
MU, LMBDA = lame(E, NU)
# Components 00, 11 and 01 of tensors of shape (3, 3).
AT = np.array([0, 1, 0]), np.array([0, 1, 1])


def voigt(e):
    """Strains of a displacement: e_00, e_11 and 2 e_01."""
    return ufl.as_vector([e[0, 0], e[1, 1], 2 * e[0, 1]])


def returned(strain, old, alpha):
    """Radial return of arrays (n, 3, 3), (n, 3, 3), (n,): stress, derivative, new values."""
    unit = np.eye(3)
    trace = np.trace(strain, axis1=1, axis2=2)[:, None, None]
    s = 2 * MU * (strain - old - np.trace(strain - old, axis1=1, axis2=2)[:, None, None] * unit / 3)
    size = np.sqrt((s**2).sum(axis=(1, 2)) + 1e-24)
    gamma = np.maximum(size - np.sqrt(2 / 3) * (YIELD + H * alpha), 0.0) / (2 * MU + 2 / 3 * H)
    n = s / size[:, None, None]
    flow = gamma[:, None, None] * n
    stress = LMBDA * trace * unit + 2 * MU * (strain - old - flow)
    theta = 1 - 2 * MU * gamma / size
    other = (gamma > 0) / (1 + H / (3 * MU)) - (1 - theta)
    deviator = (
        0.5 * (np.einsum("ik,jl->ijkl", unit, unit) + np.einsum("il,jk->ijkl", unit, unit))
        - np.einsum("ij,kl->ijkl", unit, unit) / 3
    )
    C = (LMBDA + 2 * MU / 3) * np.einsum("ij,kl->ijkl", unit, unit)
    C = C + 2 * MU * np.einsum("n,ijkl->nijkl", theta, deviator)
    C -= 2 * MU * np.einsum("n,nij,nkl->nijkl", other, n, n)
    return stress, C, old + flow, alpha + np.sqrt(2 / 3) * gamma


class ByNumpy:
    """The plastic block of ``history_scenes``, with its stress by numpy."""

    def __init__(self, **options):
        self.plain = Block()
        data, self.obstacle = self.plain.data, fm.Circle((0.0, 3.0), 2.0)
        V, mesh = self.plain.u.function_space, data.mesh
        self.u, v, du = fem.Function(V), ufl.TestFunction(V), ufl.TrialFunction(V)
        shapes = {"stress": (3,), "C": (3, 3), "old": (3, 3), "new": (3, 3), "p": (), "new_p": ()}
        self.at = {name: fm.quadrature_function(mesh, 2, shape) for name, shape in shapes.items()}
        points = compat.quadrature_points("quadrilateral", ("default", 2))
        self.strain = compat.create_expression(voigt(fm.energies.strain(self.u)), points)
        self.cells = np.arange(compat.dofmap(V).shape[0], dtype=np.int32)
        stress, C, dx = self.at["stress"], self.at["C"], ufl.dx(degree=2)
        tested, change = (voigt(fm.energies.strain(w)) for w in (v, du))
        jacobian = ufl.inner(ufl.dot(C, change), tested) * dx
        history = [(self.at["old"], self.at["new"]), (self.at["p"], self.at["new_p"])]
        bcs = [fm.dirichlet(V, data, "block/bottom", (0.0, 0.0))]
        given = {"jacobian": jacobian, "before_assembly": self.evaluate, "history": history}
        self.problem = fm.ContactProblem(
            ufl.inner(stress, tested) * dx, self.u,
            [fm.ContactPair(data, "block/top", self.obstacle)], bcs=bcs,
            petsc_options_prefix="numpy_", newton=fm.NewtonOptions(residual_tolerance=1e-13),
            **{**given, **options},
        )  # fmt: skip

    def values(self, name):
        """Values of a function at all points of the local cells, (points, ...), a copy."""
        f = self.at[name]
        dofs, size = compat.dofmap(f.function_space), f.function_space.dofmap.bs
        return f.x.array.reshape(-1, size)[dofs].reshape(-1, *f.ufl_shape)

    def set(self, name, values):
        """Set the values of a function."""
        f = self.at[name]
        dofs, size = compat.dofmap(f.function_space), f.function_space.dofmap.bs
        f.x.array.reshape(-1, size)[dofs] = values.reshape(*dofs.shape, size)

    def evaluate(self):
        """Stress, derivative and new values for the present displacement."""
        found = compat.evaluate_expression(self.strain, self.plain.data.mesh, self.cells)
        e = np.asarray(found).reshape(-1, 3)
        strain = np.zeros((len(e), 3, 3))
        strain[:, 0, 0], strain[:, 1, 1] = e[:, 0], e[:, 1]
        strain[:, 0, 1] = strain[:, 1, 0] = 0.5 * e[:, 2]
        stress, C, new, p = returned(strain, self.values("old"), self.values("p"))
        self.set("stress", stress[:, AT[0], AT[1]])
        self.set("C", C[:, AT[0][:, None], AT[1][:, None], AT[0], AT[1]])
        self.set("new", new)
        self.set("new_p", p)


def test_a_return_mapping_in_numpy_equals_that_in_ufl():
    block = ByNumpy()
    for depth in (0.004, 0.008, 0.012, 0.01):
        block.obstacle.move(y=-depth)
        report = block.problem.solve()
        other = block.plain.press(depth)
        assert report.num_iterations <= other.num_iterations + 2
        assert report.certificate.balance < 1e-10
        assert -block.problem.contacts[0].total_force[1] == pytest.approx(
            block.plain.force, rel=1e-9
        )
    slopes = block.problem.check_tangent(print_table=False).slopes
    assert min(slopes["bulk"], slopes["whole"]) > 1.9
    assert np.abs(block.u.x.array - block.plain.u.x.array).max() < 1e-9
    alpha = block.plain.material.shown["alpha"].x.array
    assert np.abs(block.at["p"].x.array - alpha).max(initial=0.0) < 1e-9
    for call in (block.problem.estimate, lambda: fm.sensitivity.RecordedPath(block.problem)):
        with refused(fm.MortarError, "does not support bodies with history"):
            call()


def test_a_function_that_fails_on_one_rank_is_refused_on_all():
    """The problem is not set up; the message on the other ranks has the error."""
    last = COMM.size - 1

    def fail():
        if COMM.rank == last:
            raise ArithmeticError("no stress")

    kind = ArithmeticError if COMM.rank == last else fm.MortarError
    with pytest.raises(kind, match="no stress"):
        ByNumpy(before_assembly=fail)
    COMM.barrier()


@pytest.mark.each
@pytest.mark.parametrize("given", [{"jacobian": None}, {"before_assembly": 1.0}])
def test_a_stress_beyond_ufl_needs_its_derivative(given):
    with refused(ValueError, "before_assembly: expected a function .* and jacobian"):
        ByNumpy(**given)


def test_features_that_differentiate_the_residual_refuse_it_by_name():
    problem = ByNumpy(history=()).problem
    with refused(fm.MortarError, r"estimate\(\) does not support before_assembly"):
        problem.estimate()
