# SPDX-License-Identifier: MIT
"""All objectives by all controls, for each law, element and kind of path: a table.

    mpirun.openmpi -n 2 /usr/bin/python3 tests/program.py proof_matrix [parts of names]

Each row is a scene: the number of pairs of an objective and a control, the largest difference of
adjoint and tangent-linear derivatives over the sum of the terms, and the smallest slope of the
Taylor remainders; pairs whose remainders are rounding have none.
"""

import sys
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from taylor_scenes import blocks, directions_of, obstacle_on_block, tied_blocks, timed, value_of

import ufl

import fenics_mortar as fm
from fenics_mortar import sensitivity as se
from fenics_mortar.laws import Cohesive, MixedCohesive, Worn
from fenics_mortar.sensitivity.controls import dot
from fenics_mortar.sensitivity.forms import controls_of

# Steps of Taylor tests over the sizes of the changes, each with its halves; the shorter ones are
# for nodes that change their sets.
STEPS, FRACTIONS = (2e-3, 5e-4, 2e-4, 2e-5), (1.0, 0.5, 0.25)
# Of quantities that may be zero: a gap [length], and a work [stress length^2].
UNITS = {"gap": 0.01, "work": 0.01}
# Pressed in two steps, drawn over one and a half facets, and back by a half.
LONG = [(0.002, -0.03), (0.004, -0.05)]
LONG += [(0.01 + 0.37 * k / 13, -0.05) for k in range(13)]
LONG += [(0.35 - 0.02 * k, -0.048) for k in range(5)]
STUCK = [*LONG[:2], *((0.006 + 1e-4 * k, -0.05) for k in range(18))]
# Pressed, then opened and sheared.
OPENING = [(0.001 * k, -0.01 + 0.006 * k) for k in range(20)]
ROLLED = [(0.004 * k, -0.03 - 0.001 * k, 0.02 * k) for k in range(20)]
PATHS = {"step": slice(1, 2), "path": slice(None)}
ELEMENTS = {
    "P1": {},
    "triangles": {"mesh": {"cell": "triangle"}},
    "standard": {"pair": {"basis": "standard"}},
    "P2": {"degree": 2},
    "vertices": {"degree": 2, "pair": {"basis": "vertices"}},
}


class Pulling(fm.Coulomb):
    """Friction, and adhesion that fades with the gap."""

    parameters = ("mu", "pull")

    def __init__(self, mu, pull):
        super().__init__(mu)
        self.pull = pull

    def adhesion(self, gap):
        fading = self.pull * np.exp(-gap / 0.2)
        return fading, -fading / 0.2


LAWS = {
    "none": (fm.Frictionless, {}, LONG),
    "Tresca": (lambda: fm.Tresca(1.0), {"stress": 0.3}, LONG),
    "stick": (lambda: fm.Coulomb(5.0), {}, STUCK),
    "slip": (lambda: fm.Coulomb(0.05), {"mu": 0.05}, LONG),
    "mixed": (lambda: fm.Coulomb(0.3), {"mu": 0.1}, LONG),
    "adhesion": (lambda: Pulling(0.3, 0.5), {"mu": 0.1, "pull": 0.1}, OPENING),
    "cohesive": (lambda: Cohesive(2.0, 0.3), {"strength": 0.3, "reach": 0.02}, OPENING),
    "bond": (
        lambda: MixedCohesive(100.0, 2.0, 0.3),
        {"stiffness": 10.0, "strength": 0.2, "reach": 0.02},
        OPENING,
    ),
    "wear": (lambda: Worn(0.3, 0.05), {"mu": 0.1, "wear": 0.01}, LONG),
}  # fmt: skip

# With a larger bound, nodes at the edge of the contact with a circle have no equilibrium.
WEAK = partial(fm.Tresca, 0.1)


def objectives(scene, *, contact=True):
    """A form, and quantities of the pair."""
    u = scene.u
    form = (ufl.inner(u, u) + 0.1 * u[0] + 0.01 * scene.controls["E"] * u[1]) * ufl.dx
    found = {"form": form, "force": se.TotalForce(0, (1.0, 0.3)), "moment": se.Moment(0)}
    if contact:
        found |= {
            "pressure": se.PressureIntegral(0, 2),
            "fit": se.PressureFunctional(0, lambda p: (p - 2.0) ** 2, lambda p: 2.0 * (p - 2.0)),
            "peak": se.PeakPressure(0, 6.0),
            "gap": se.MeanGap(0),
            "work": se.FrictionWork(0),
            "length": se.ContactLength(0),
            "effective length": se.effective_length(0),
            "function": (se.TotalForce(0, (0.0, 1.0)) - 1.3) ** 2 + se.FrictionWork(0),
        }
    return found


@dataclass
class Row:
    """Result of a scene; ``weak`` are the pairs with a slope below 1.9."""

    pairs: int = 0
    difference: float = 0.0
    slope: float = np.inf
    rounding: int = 0
    weak: list = field(default_factory=list)


def summed(values):
    """Each quantity summed over the steps."""
    return values.sum(axis=0), None


def row_of(scene, sizes, *, contact=True):
    """All objectives by all controls with changes of these sizes."""
    row, named = Row(), objectives(scene, contact=contact)
    names, several = list(sizes), list(named.values())
    controls = [scene.controls[name] for name in names]
    made, along = controls_of(scene.problem, controls), directions_of(scene, names, sizes.values())
    path = scene.solve()
    start = value_of(path, several, summed)
    units = np.array([UNITS.get(name, abs(value)) for name, value in zip(named, start)])
    by_all = [fm.gradient(J, controls, path, over_steps=se.total) for J in several]
    for number, (name, control, direction) in enumerate(zip(names, made, along, strict=True)):
        given = [controls[number]], [direction], path
        tangent = se.tangent_linear(several, *given, over_steps=se.total).derivatives.sum(axis=0)
        sums = np.zeros(len(several))
        for i, gradient in enumerate(by_all):
            parts = gradient.by_step[number]
            sums[i] = sum(abs(dot(scene.problem, control, abs(p), abs(direction))) for p in parts)
            found = dot(scene.problem, control, sum(parts), direction)
            size = sums[i] + 1e-3 * units[i]  # zero of an objective that is zero and remains so
            row.difference = max(row.difference, abs(found - tangent[i]) / (size or 1.0))
        rounding = 1e-11 * (len(path.steps) * np.maximum(units, abs(start)) + sums)
        slopes = slopes_of(scene, name, direction, several, start, tangent, rounding)
        row.pairs += len(several)
        row.rounding += int(np.isinf(slopes).sum())
        row.slope = min(row.slope, slopes.min())
        row.weak += [(J, name, slope) for J, slope in zip(named, slopes) if slope < 1.9]
    return row


def slopes_of(scene, name, direction, several, start, tangent, rounding):
    """Smallest slope of the remainders of each objective, at steps within which no set changes.

    Infinity where the remainders of the first, longest steps are rounding.
    """
    best = np.full(len(several), -np.inf)
    for step in STEPS:
        left = []
        for fraction in FRACTIONS:
            h = fraction * step
            there = value_of(scene.solve([name], [h * direction]), several, summed)
            left.append(np.abs(there - start - h * tangent))
        left = np.array(left)
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = np.log2(left[:-1] / left[1:]).min(axis=0)
        if step == STEPS[0]:
            slopes = np.where(left[-1] <= rounding, np.inf, slopes)
        else:  # a slope of 2 from remainders below the estimated rounding is none by chance
            slopes = np.where(left[-1] <= 0.1 * rounding, -np.inf, slopes)
        best = np.where(best < 1.9, np.maximum(best, slopes), best)
        if (best >= 1.9).all():
            break
    return best


def between_blocks(law, element, path):
    """Scene and sizes of the changes."""
    made, parameters, places = LAWS[law]
    some = slice(9, 10) if places is OPENING and path == "step" else PATHS[path]  # opened
    scene = timed(blocks(made(), places=places[some], **ELEMENTS[element]))
    scene.controls |= {name: se.LawParameter(0, name) for name in parameters}
    scene.controls["offset"] = se.Offset(0)
    sizes = {"E": 10.0, "load": 1.0, "place": 0.01, "interference": 0.003, "offset": 0.003}
    return scene, {**sizes, **parameters}


def on_obstacle(kind, law, degree, path):
    """A circle or a spline, moved or driven by a force, with or without friction."""
    driven, spline = kind == "driven", kind == "spline"
    x = np.linspace(-0.6, 1.7, 9)
    chain = np.stack([x, 1.0 + 0.5 * (x - 0.52) ** 2], axis=1)
    body = fm.Spline(chain) if spline else fm.Circle((0.52, 1.8), 0.8)
    made, parameters, _ = LAWS[law]
    made = WEAK if law == "Tresca" else made
    if driven:
        body.move(y=-0.03)
        body.push(y=-3.0)
    scene = obstacle_on_block(body, made(), degree=degree, places=ROLLED[PATHS[path]])
    scene.controls |= {name: se.LawParameter(0, name) for name in parameters}
    sizes = {"E": 10.0, "points" if spline else "radius": 0.01, **parameters}
    if not driven:
        return scene, {**sizes, "place": 0.003}

    def move(place):
        body.push(y=100.0 * place[1])
        body.move(x=place[0])

    scene.move = move
    return scene, sizes


def scenes():
    """Functions that make scenes and sizes, by name."""
    for law in LAWS:
        for element in ELEMENTS:
            for path in PATHS:
                yield f"{law} {element} {path}", partial(between_blocks, law, element, path), True
    for kind in ("moved", "spline", "driven"):
        for law in ("none", "mixed", "Tresca"):
            for degree in (1, 2):
                for path in PATHS:
                    name = f"obstacle {kind} {law} P{degree} {path}"
                    yield name, partial(on_obstacle, kind, law, degree, path), True
    for degree in (1, 2):
        yield f"tie P{degree} path", partial(tied, degree), False


def tied(degree):
    """Non-matching blocks, joined and sheared in twenty steps."""
    places = [(0.005 * k, -0.002 * k) for k in range(1, 21)]
    return tied_blocks(places, degree=degree), {"E": 10.0, "load": 1.0, "place": 0.01}


def main(parts):
    """Print the table of the scenes whose name has all ``parts``."""
    print(
        "| scene | pairs | adjoint - tangent | smallest slope | rounding |\n|---|---|---|---|---|"
    )
    bad = 0
    for name, make, contact in scenes():
        if not set(parts) <= set(name.split()):
            continue
        scene, sizes = make()
        row = row_of(scene, sizes, contact=contact)
        bad += bool(row.weak) or row.difference > 1e-10
        if scene.problem.equations.comm.rank == 0:
            print(
                f"| {name} | {row.pairs} | {row.difference:.0e} | {row.slope:.2f} "
                f"| {row.rounding} |"
            )
            for weak in row.weak:
                print("  weak:", *weak)
            sys.stdout.flush()
    return bad


if __name__ == "__main__":
    sys.exit(int(main(sys.argv[1:])))
