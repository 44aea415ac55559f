# SPDX-License-Identifier: MIT
"""A stress by dolfinx-external-operator, where it is installed, as the guide describes it."""

import numpy as np
import pytest
from history_scenes import in_space

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_grids import Grid, block, mesh

external = pytest.importorskip("dolfinx_external_operator")

MU, LMBDA = fm.energies.lame(210.0, 0.3)
YIELD, C = 0.7, 25.0  # yield stress, modulus of Prager's kinematic hardening
DX = ufl.dx(degree=2)
# Strains and stresses as vectors: 11, 22, 33 and sqrt(2) 12.
UNIT = np.array([1.0, 1.0, 1.0, 0.0])
DEVIATOR = np.eye(4) - np.outer(UNIT, UNIT) / 3.0


def as_vector(e):
    """Plane strain as a vector of four components."""
    return ufl.as_vector([e[0, 0], e[1, 1], 0.0, np.sqrt(2.0) * e[0, 1]])


class Blocks:
    """A block of the width 1 on one of the width 2, with friction, both plastic.

    Attributes:
        problem: The problem.
        plastic: Plastic strain, a history function.
        push: Displacement of the top.
    """

    def __init__(self):
        """Set up the problem."""
        wide = block(8, 4, width=2.0, height=1.0)
        narrow = block(6, 4, width=1.0, height=1.0) + np.array([0.0, 1.0])
        self.data = mesh([Grid("lower", wide), Grid("upper", narrow)], cell="triangle", order=2)
        V = fm.vector_space(self.data.mesh, 2)
        self.u, self.v = fem.Function(V), ufl.TestFunction(V)
        self.push = fem.Constant(self.data.mesh, (0.0, 0.0))
        pair = fm.ContactPair(self.data, "upper/bottom", "lower/top", law=fm.laws.Coulomb(0.3))
        residual, options = self.material()
        bcs = [fm.dirichlet(V, self.data, "lower/bottom", (0.0, 0.0))]
        bcs += [fm.dirichlet(V, self.data, "upper/top", self.push)]
        self.problem = fm.ContactProblem(
            residual, self.u, [pair], bcs=bcs, petsc_options_prefix="external_",
            newton=fm.NewtonOptions(residual_tolerance=1e-13), **options,
        )  # fmt: skip


class ByUfl(Blocks):
    """The stress in UFL."""

    def material(self):
        """Residual, and options of the problem."""
        self.plastic = old = fm.quadrature_function(self.data.mesh, 2, (3, 3))
        strain = in_space(fm.energies.strain(self.u))
        s = 2 * MU * ufl.dev(strain - old)
        xi = s - 2 / 3 * C * old
        q = ufl.sqrt(1.5 * ufl.inner(xi, xi) + 1e-20)
        dp = ufl.conditional(q > (1 + 1e-9) * YIELD, q - YIELD, 0.0) / (3 * MU + C)
        flow = 1.5 * dp / q * xi
        stress = s - 2 * MU * flow + (LMBDA + 2 * MU / 3) * ufl.tr(strain) * ufl.Identity(3)
        residual = ufl.inner(stress, in_space(fm.energies.strain(self.v))) * DX
        return residual, {"history": [(old, old + flow)]}


class ByOperator(Blocks):
    """The stress by an external operator."""

    def material(self):
        """Residual, and options of the problem."""
        self.plastic, self.new = (fm.quadrature_function(self.data.mesh, 2, (4,)) for _ in range(2))
        strain, tested = (as_vector(fm.energies.strain(w)) for w in (self.u, self.v))
        stress = external.FEMExternalOperator(strain, function_space=self.plastic.function_space)
        stress.external_function = {(1,): self.returned}.__getitem__
        residual = ufl.inner(stress, tested) * DX
        jacobian = ufl.derivative(residual, self.u, ufl.TrialFunction(self.u.function_space))
        residual, self.stresses = external.replace_external_operators(residual)
        jacobian, self.derivatives = external.replace_external_operators(jacobian)
        options = {"jacobian": jacobian, "before_assembly": self.evaluate}
        return residual, {"history": [(self.plastic, self.new)], **options}

    def returned(self, strain):
        """Radial return: derivative, stress and plastic strain at all points."""
        strain, old = strain.reshape(-1, 4), self.plastic.x.array.reshape(-1, 4)
        s = 2 * MU * (strain - old) @ DEVIATOR
        xi = s - 2 / 3 * C * old
        q = np.sqrt(1.5 * (xi**2).sum(axis=1) + 1e-20)
        dp = np.maximum(q - YIELD, 0.0) / (3 * MU + C)
        n = 1.5 * xi / q[:, None]
        new = old + dp[:, None] * n
        bulk = LMBDA + 2 * MU / 3
        stress = s - 2 * MU * dp[:, None] * n + bulk * (strain @ UNIT)[:, None] * UNIT
        # The derivative of dp is 2 mu / (3 mu + C) n, that of n 3 mu / q (deviator - 2/3 n n).
        both = np.einsum("ni,nj->nij", n, n)
        theta = (6 * MU**2 * dp / q)[:, None, None]
        tangent = (
            bulk * np.outer(UNIT, UNIT) + 2 * MU * DEVIATOR - theta * (DEVIATOR - 2 / 3 * both)
        )
        tangent -= (4 * MU**2 / (3 * MU + C) * (dp > 0))[:, None, None] * both
        return tangent.ravel(), stress.ravel(), new.ravel()

    def evaluate(self):
        """Stress, its derivative and the new plastic strain for the present displacement."""
        operands = external.evaluate_operands(self.derivatives)
        ((_, stress, new),) = external.evaluate_external_operators(self.derivatives, operands)
        self.stresses[0].ref_coefficient.x.array[:] = stress
        self.new.x.array[:] = new


def test_a_stress_by_an_external_operator_equals_that_in_ufl():
    plain, block = ByUfl(), ByOperator()
    for x, y in ((0.0, -0.004), (0.0, -0.02), (0.01, -0.02), (0.01, -0.018)):
        for scene in (plain, block):
            scene.push.value[:] = x, y
            report = scene.problem.solve()
            assert report.num_iterations <= 7 and report.certificate.balance < 1e-10
        assert np.abs(block.u.x.array - plain.u.x.array).max(initial=0.0) < 1e-13
    assert block.problem.check_tangent(print_table=False).slopes["bulk"] > 1.9
    old = plain.plastic.x.array.reshape(-1, 9)[:, [0, 4, 8, 1]] * [1.0, 1.0, 1.0, np.sqrt(2.0)]
    assert np.abs(block.plastic.x.array - old.ravel()).max(initial=0.0) < 1e-13
