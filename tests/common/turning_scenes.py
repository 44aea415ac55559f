# SPDX-License-Identifier: MIT
"""Wheels and shafts that turn with friction."""

from typing import NamedTuple

import numpy as np
from friction_scenes import NU, E, block_on
from scenes import TIGHT, internal, neo_hookean, pair_options, read, rotation

from dolfinx import fem

import fenics_mortar as fm
from meshes import mapped_grids
from meshes.mapped_grids import Grid, sector

RADIUS = 0.5


def wheel_under_block(law, *, radius=RADIUS, depth=0.02):
    """A rigid wheel pressed from below into a block clamped at its top; pressed, not turned."""
    wheel = fm.Circle((0.5, -radius), radius, name="wheel")
    problem, _ = block_on(wheel, law=law)
    wheel.move(y=depth)
    problem.solve()
    return problem, wheel


class Shaft(NamedTuple):
    """A hollow shaft in a ring with interference; the bore and the outer side are prescribed."""

    problem: fm.ContactProblem
    bore: fem.Function
    outside: fem.Function
    axle: fm.RigidBoundary | None = None

    def turn(self, angle, **options):
        """Turn the bore to an angle; return the report."""
        self.set_angle(angle)
        return self.problem.solve(**options)

    def set_angle(self, angle):
        """Prescribe an angle of the bore."""
        _turn(self.bore, angle)
        if self.axle is not None:
            self.axle.move(angle=angle)

    def set_both(self, angle):
        """Prescribe an angle of the bore and of the outer side."""
        _turn(self.bore, angle)
        _turn(self.outside, angle)

    @property
    def moment(self):
        """Moment of the contact forces on the slave about the axis."""
        contact = self.problem.equations.contacts[0]
        force, _ = contact.now.forces
        x = contact.operators.x
        return float((x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0]).sum())


def _turn(values, angle):
    """Set displacements to those of a rotation about the origin."""
    values.interpolate(lambda x: (rotation(angle) - np.eye(2)) @ x[:2])


def shaft_in_ring(
    law, *, slave="shaft", columns=24, interference=0.03, degree=1, on_axle=False,
    material=neo_hookean, **pair,
):  # fmt: skip
    """Shaft of radii 0.4 and 1 in a ring of radii 1 and 1.4, whose outer side is fixed at first.

    The bore is prescribed by Dirichlet values, or is a rigid boundary ``on_axle``.
    """
    angles = (0.1, 0.1 + 2.0 * np.pi)
    inner = sector(columns * degree, 2 * degree, radii=(0.4, 1.0 + interference))
    outer = sector((columns + 4) * degree, 2 * degree, radii=(1.0, 1.4), angles=angles)
    grids = [Grid("shaft", inner, closed=True), Grid("ring", outer, closed=True)]
    data = read(lambda: mapped_grids.build(grids, order=degree))
    V = fm.vector_space(data.mesh, degree)
    u, bore, outside = fem.Function(V), fem.Function(V), fem.Function(V)
    bcs = [fm.dirichlet(V, data, "ring/bottom", outside)]
    axle = fm.RigidBoundary(data, "shaft/top", pivot=(0.0, 0.0)) if on_axle else None
    if axle is None:
        bcs.append(fm.dirichlet(V, data, "shaft/top", bore))
    sides = ["shaft/bottom", "ring/top"][:: 1 if slave == "shaft" else -1]
    pair = fm.ContactPair(data, *sides, **pair_options({"law": law, **pair}))
    residual = internal(u, material(u, E, NU))
    problem = fm.ContactProblem(
        residual, u, [pair], bcs=bcs, petsc_options_prefix="test_", newton=TIGHT,
        remote=[axle] if axle else [],
    )  # fmt: skip
    shaft = Shaft(problem, bore, outside, axle)
    shaft.turn(0.0)
    return shaft


def problem_of(grids, pairs, **given):
    """Neo-Hookean bodies; ``pairs`` and further arguments are functions of data and space."""
    data = mapped_grids.mesh(grids)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    return fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)), u, pairs(data), newton=TIGHT,
        petsc_options_prefix="turns_", **{name: each(data, V) for name, each in given.items()},
    )  # fmt: skip


def rollers(law, *, columns=(40, 46), radii=(0.5, 0.5), hubs=(0.2, 0.2), layers=3, degree=1):
    """Two tyres on rigid hubs, side by side: the problem and both hubs; nothing is pressed yet."""
    centres, starts = [(0.0, 0.0), (sum(radii), 0.0)], (0.02, 0.1)
    grids = [
        Grid(
            name,
            sector(
                count * degree, layers * degree, radii=(hub, radius),
                angles=(start, start + 2.0 * np.pi), centre=centre,
            ),
            closed=True,
        )
        for name, count, hub, radius, start, centre in zip(
            ("left", "right"), columns, hubs, radii, starts, centres, strict=True
        )
    ]  # fmt: skip
    data = mapped_grids.mesh(grids, order=degree)
    u = fem.Function(fm.vector_space(data.mesh, degree))
    left, right = (
        fm.RigidBoundary(data, f"{grid.name}/top", pivot=centre)
        for grid, centre in zip(grids, centres, strict=True)
    )
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 50.0, 0.3)), u,
        [fm.ContactPair(data, "left/bottom", "right/bottom", law=law)],
        remote=[left, right], newton=TIGHT, petsc_options_prefix="rollers_",
    )  # fmt: skip
    return problem, left, right
