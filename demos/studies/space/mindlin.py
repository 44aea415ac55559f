# SPDX-License-Identifier: MIT
"""A sphere on a plane of the same material, pressed and then sheared (Mindlin).

    python3 -m demos.studies.space.mindlin

With a tangential force Q below mu F, the disc r < c of the contact r < a sticks, and the bodies
shift:

    c = a (1 - Q / (mu F))^(1/3),
    shift = 3 mu F (2 - nu) / (8 G a) [1 - (1 - Q / (mu F))^(2/3)]

(Johnson, 7.40 and 7.42; slip is assumed to be along Q, an error of a few per cent). Half of
both bodies is meshed. The radius that is computed is that of a disc of the same area as the
cells of the nodes that stick. Displacements far away are those of point forces: that of Boussinesq,
and for Q that of Cerruti.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from dolfinx import fem

import fenics_mortar as fm
from demos.studies.space.half_spaces import (
    E_STAR,
    KINDS,
    NU,
    OUTER,
    E,
    Kind,
    boussinesq,
    cerruti,
    elastic_residual,
    symmetry,
    two_boxes,
)

R, MU = 1000.0, 0.3
FORCE = 4.0 / 3.0 * E_STAR / R
SHARES = (0.3, 0.6, 0.9)


def shift(share: float) -> float:
    """Relative displacement of points far away, for Q / (mu F)."""
    G = E / (2.0 * (1.0 + NU))
    return 3.0 * MU * FORCE * (2.0 - NU) / (8.0 * G) * (1.0 - (1.0 - share) ** (2.0 / 3.0))


def measure(kind: Kind, n: int) -> list[tuple[float, ...]]:
    """Share Q / (mu F) found, c / a found and of the theory for it, and iterations, per step."""
    sags = lambda x, y: (x**2 + y**2) / (2.0 * R), lambda x, y: 0.0 * x
    data = two_boxes(kind, n, sags, both=True)
    V = fm.vector_space(data.mesh, kind.degree)
    u, far = fem.Function(V), {"upper": fem.Function(V), "lower": fem.Function(V)}
    bcs = symmetry(V, data, list(far))
    for name, value in far.items():
        outside = [f"{name}/{side}" for side in ("left", "right", "back", OUTER[name])]
        bcs.append(fm.dirichlet(V, data, outside, value))
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=fm.Coulomb(MU))
    problem = fm.ContactProblem(
        elastic_residual(u, kind), u, [pair], bcs=bcs, petsc_options_prefix="mindlin_"
    )
    contact, rows = problem.contacts[0], []
    for share in (0.0, *SHARES):
        for name, side, motion in (("upper", 1.0, -1.0 / R), ("lower", -1.0, 0.0)):
            far[name].interpolate(partial(_far, share, side, motion))
        iterations = problem.solve().num_iterations
        force = 2.0 * contact.total_force
        found = abs(force[0]) / (MU * force[2])
        a = (0.75 * force[2] * R / E_STAR) ** (1.0 / 3.0)
        weights = contact.forces[:, 2] / np.maximum(contact.pressure, 1e-9 * E)
        area = 2.0 * weights[contact.sticking].sum()
        rows.append((share, found, np.sqrt(area / np.pi) / a, (1.0 - found) ** (1 / 3), iterations))
    return rows


def _far(share: float, side: float, motion: float, x: np.ndarray) -> np.ndarray:
    """Displacement far away; points of the upper body move by the shift along x too."""
    u = boussinesq(FORCE, side, motion, x) + cerruti(-side * share * MU * FORCE, side, x)
    u[0] += shift(share) if motion else 0.0
    return u


def table(kind: Kind) -> str:
    """Rows of all meshes and steps."""
    lines = [
        f"{kind.name}, Q / (mu F) from the shift of the theory\n",
        "| n | Q / (mu F), theory | computed | c / a, theory for it | computed | iterations |",
        "|---:|---:|---:|---:|---:|---:|",
    ]
    for n in kind.counts[:2] if kind.degree == 2 else (5, 7, 9):
        for share, found, c, exact, iterations in measure(kind, n)[1:]:
            lines.append(f"| {n} | {share} | {found:.4f} | {exact:.3f} | {c:.3f} | {iterations} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    for some in KINDS[:2]:
        print(table(some), flush=True)
