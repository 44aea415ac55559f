# SPDX-License-Identifier: MIT
"""The tractive rolling of Carter: shear, stick and creepage of a rigid wheel on a half plane.

    python3 -m demos.studies.accuracy.carter

A rigid wheel, pressed by P on an incompressible body, is driven and rolls to the right under a
force Q < mu P. In the steady state it sticks from the leading edge on, over a length 2 c of the
contact |x| < a, and slides behind (Carter 1926; Johnson, Contact Mechanics, 8.3):

    a^2 = 4 P R / (pi E*),    p0 = 2 P / (pi a),    c = a sqrt(1 - Q / (mu P)),    d = a - c,
    q = mu p0 (sqrt(1 - (x/a)^2) - (c/a) sqrt(1 - (x - d)^2 / c^2)),

the second root within the stick only. Each part of q strains the surface in proportion to x, by 2
mu p0 x / (E* a) and 2 mu p0 (x - d) / (E* a). Their difference, 2 mu p0 d / (E* a), is the
creepage, the excess rotation of the wheel. With p0 = E* a / (2 R) it is

    xi = mu d / R = (mu a / R) (1 - sqrt(1 - Q / (mu P))).

This is valid if pressure does not move the surface tangentially: for bodies of one material, and
for a rigid body on an incompressible one, E* = E / (1 - nu^2) = 4 E / 3, here of Taylor-Hood
elements.

Errors of the problem: those of small strain and small angles are of the order a / (mu R), therefore
R = 1000 a. The half plane is a block, fixed at its bottom and sides, ``SIZE`` half-widths away. As
the load travels, the block is displaced sideways by about P / (E* SIZE) per unit of distance, a
fraction of the creepage of the order a / (mu SIZE): 0.5 % by the last table.

The wheel is pressed by P and pulled by Q, both as forces. Then all its motions are prescribed, so
that the stiffness is factorized only once: as the wheel turns, it is advanced by the distance for
which Q is constant. The creepage is that of the last half-width of the distance; a, c and xi of the
theory are those of the final forces. The shear has roots at the ends of contact and stick: on
uniform facets its error in L2 is of order h.

Writes the tables and a picture to ``results/accuracy/carter.md`` and ``.png``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.accuracy.norms import contact_errors
from demos.studies.accuracy.posed import Posed, read
from demos.studies.accuracy.report import FOLDER, markdown
from meshes.mapped_grids import Grid

# Lengths over the half-width of the contact, stresses over E*
R, FRICTION, PART = 1000.0, 0.3, 0.5  # Q over mu P
FORCE = np.pi / (4 * R)
FINE, SIZE, GROWTH = 3.5, 1000.0, 1.4
DISTANCE = 4.0  # from -DISTANCE / 2 on
FIXED = ("bottom", "left", "right")
FACETS = (4, 8, 16, 32)  # over the half-width
STEPS, SIZES = (0.25, 0.5, 1.0, 2.0), (50.0, 200.0, SIZE)


@dataclass
class Rolled:
    """A wheel that has rolled.

    Attributes:
        posed: The problem; its exact pressure is the shear of the theory.
        rotations: Rotation as a length after each step.
        places: Position after each step, from the middle of the block.
        pulls: Q / (mu P) after each step.
        iterations: Iterations of each step.
    """

    posed: Posed
    rotations: np.ndarray
    places: np.ndarray
    pulls: np.ndarray
    iterations: list[int]

    @property
    def half_widths(self) -> tuple[float, float]:
        """Half-widths of contact and stick, by the theory for the measured forces."""
        a = half_width(self.posed.problem.equations.contacts[0])
        return a, a * np.sqrt(1 - self.pulls[-1])

    @property
    def shear(self) -> np.ndarray:
        """Shear at the nodes of the slave."""
        return np.abs(self.posed.problem.equations.contacts[0].nodal.z_tau)

    @property
    def error(self) -> float:
        """Error of the shear in L2."""
        return contact_errors(self.posed, self.shear)["pressure"]

    @property
    def stuck(self) -> float:
        """Sticking half-width over that of the theory."""
        (contact,) = self.posed.problem.equations.contacts
        return contact.slave.nodal_lengths[contact.sticking].sum() / 2 / self.half_widths[1]

    @property
    def creepage(self) -> float:
        """Creepage over that of the theory."""
        start = np.searchsorted(self.rotations, self.rotations[-1] - 1 - 1e-9)
        travelled, turned = (np.ptp(values[start:]) for values in (self.places, self.rotations))
        return (1 - travelled / turned) / creepage(self.half_widths[0], self.pulls[-1])


def creepage(a: float, part: float) -> float:
    """Creepage for a half-width and Q / (mu P)."""
    return FRICTION * a / R * (1 - np.sqrt(1 - part))


def half_width(contact: Any) -> float:
    """Half-width of the contact for the force on the wheel."""
    return np.sqrt(4 * R * abs(contact.total_force[1]) / np.pi)


def pull(contact: Any) -> float:
    """Q / (mu P) from the forces on the wheel."""
    return abs(contact.total_force[0] / contact.total_force[1]) / FRICTION


def shear_by_theory(x: np.ndarray, a: float, c: float) -> np.ndarray:
    """Shear at distances x from the middle of a contact that moves to the right."""
    outer, inner = (np.maximum(b**2 - y**2, 0.0) for b, y in ((a, x), (c, x - (a - c))))
    return FRICTION / (2 * R) * (np.sqrt(outer) - np.sqrt(inner))  # p0 / a = 1 / (2 R)


def line(h: float, fine: float, size: float) -> np.ndarray:
    """Vertices and midpoints from 0 to ``size``, with spacing h up to ``fine``, then growing."""
    inner = np.linspace(0.0, fine, round(fine / h) + 1)
    count = np.log1p((size - fine) * (GROWTH - 1) / (h * GROWTH)) / np.log(GROWTH)
    beyond = np.cumsum(GROWTH ** np.arange(1, round(count) + 1))
    vertices = np.append(inner, fine + (size - fine) * beyond / beyond[-1])
    return np.interp(np.arange(2 * vertices.size - 1) / 2, np.arange(vertices.size), vertices)


def pose(n: int, size: float) -> tuple[fm.MeshData, Any, fm.ContactProblem, fm.Circle]:
    """A block with n facets to a half-width, and the wheel that touches it."""
    x, depth = line(1 / n, FINE, size), line(1 / n, 0.5, size)
    x = np.append(-x[:0:-1], x)
    grid = np.stack(np.meshgrid(x, -depth[::-1], indexing="ij"), axis=2)
    data = read([Grid("block", grid)], "quadrilateral", 2)
    W = fm.mixed_space(data.mesh, ("Lagrange", 2, (2,)), ("Lagrange", 1))
    w, mu = fem.Function(W), 1 / 4  # E / 3
    energy = fm.energies.mixed_linear_elastic(*ufl.split(w), mu)
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    wheel = fm.Circle((-DISTANCE / 2, R), R, name="wheel")
    problem = fm.ContactProblem(
        ufl.derivative(energy * dx, w),
        w,
        [fm.ContactPair(data, "block/top", wheel, law=fm.Coulomb(FRICTION))],
        bcs=[fm.dirichlet(W.sub(0), data, f"block/{side}", (0.0, 0.0)) for side in FIXED],
        petsc_options_prefix="carter_",
    )
    return data, w, problem, wheel


def roll(n: int, step: float = 1.0, size: float = SIZE, distance: float = DISTANCE) -> Rolled:
    """Press, pull and roll the wheel; n facets to a half-width, steps by the facet."""
    data, w, problem, wheel = pose(n, size)
    (contact,) = problem.equations.contacts
    wheel.push(y=-FORCE)
    problem.solve()
    wheel.push(x=-PART * FRICTION * FORCE)
    problem.solve()
    yields, place = abs(wheel.place[0]) / PART, float(wheel.place[0])
    wheel.move(y=wheel.place[1])
    rotations = np.linspace(0.0, distance, round(distance * n / step) + 1)
    places, pulls, iterations = [place], [pull(contact)], []
    for rotation in np.diff(rotations):
        place += rotation * (1 - creepage(1.0, PART)) + yields * (pulls[-1] - PART)
        wheel.move(x=place, angle=wheel.place[2] - rotation / R)
        iterations.append(problem.solve().num_iterations)
        places.append(place)
        pulls.append(pull(contact))
    places_ = np.array(places) - distance / 2
    a = half_width(contact)
    posed = Posed(
        data,
        w,
        problem,
        "block",
        lambda x, on: np.zeros_like(x),
        lambda x, on: np.zeros((2, *x.shape)),
        lambda x: shear_by_theory(x[0] - places_[-1], a, a * np.sqrt(1 - pulls[-1])),
        (np.inf, np.inf),
    )
    return Rolled(posed, rotations, places_, np.array(pulls), iterations)


HEAD = (
    "facets / a | step / facet | size / a | Q / (mu P) | stick | creepage | error of q | iterations"
)


def table(runs: Sequence[tuple[int, float, float]], known: dict[Any, Rolled]) -> str:
    """A row for each mesh, step and block size: computed values over those of the theory."""
    lines = []
    for run in runs:
        found = known[run] = known.get(run) or roll(*run)
        cells = f"{found.pulls[-1]:.4f}", f"{found.stuck:.3f}", f"{found.creepage:.4f}"
        iterations = f"{np.median(found.iterations):g}"
        lines.append([*map("{:g}".format, run), *cells, f"{100 * found.error:.2f} %", iterations])
        print(lines[-1], flush=True)
    return markdown(HEAD, 0, lines)


def draw(found: Rolled) -> Figure:
    """Computed and theoretical shear, and creepage over the distance."""
    figure = Figure((8, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": (3, 2)})
    a, c = found.half_widths
    x, peak = np.linspace(-1.3, 1.3, 2001), FRICTION * a / (2 * R)
    nodes = found.posed.problem.equations.contacts[0].slave.X[:, 0] - found.places[-1]
    left.plot(x, np.sqrt(np.maximum(1 - x**2, 0)), "k--", lw=1, label="mu times Hertz' pressure")
    left.plot(x, shear_by_theory(a * x, a, c) / peak, "k-", lw=1, label="Carter")
    left.plot(nodes / a, found.shear / peak, "o", ms=3, color="#c8102e", label="computed shear")
    left.set(xlabel="x / a, rolling to the right", ylabel="traction / (mu p0)")
    left.set(xlim=(-1.3, 1.3), ylim=(-0.05, 1.5))
    left.legend(frameon=False, loc="upper left")
    creep = 1 - np.diff(found.places) / np.diff(found.rotations)
    right.plot(found.rotations[1:], creep / creepage(1.0, PART), color="#c8102e")
    right.axhline(1.0, color="k", lw=1)
    right.set(xlabel="distance / a", ylabel="creepage by Carter's", ylim=(0.0, 1.5))
    return figure


def main() -> None:
    known: dict[Any, Rolled] = {}
    tables = [
        table([(n, 1.0, SIZE) for n in FACETS], known),
        table([(8, step, SIZE) for step in STEPS], known),
        table([(8, 1.0, size) for size in SIZES], known),
    ]
    FOLDER.mkdir(parents=True, exist_ok=True)
    print("\n" + "\n".join(tables))
    (FOLDER / "carter.md").write_text("\n".join(tables))
    draw(known[16, 1.0, SIZE]).savefig(FOLDER / "carter.png", dpi=150)


if __name__ == "__main__":
    main()
