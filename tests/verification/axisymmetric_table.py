# SPDX-License-Identifier: MIT
"""Table of the errors that ``test_axisymmetric`` bounds; about ten seconds, in serial.

``/usr/bin/python3 tests/program.py axisymmetric_table``.
"""

import numpy as np
import revolved
import test_axisymmetric as proofs
import test_half_space as space
from revolved import cylinders, disturbed, pressed_cylinders

import fenics_mortar as fm

# Radii, pressures and weights of the nodes.
Profile = tuple[np.ndarray, np.ndarray, np.ndarray]


def row(what: str, *errors: float) -> None:
    """Print errors, and the rates between them for meshes of half the size each."""
    rates = np.log2(np.abs(np.array(errors[:-1]) / np.array(errors[1:])))
    cells = [what, ", ".join(f"{error:.1e}" for error in errors)]
    print(f"| {' | '.join(cells)} | {', '.join(f'{rate:.2f}' for rate in rates)} |", flush=True)


def patches() -> None:
    """Uniform pressure between cylinders and on a cone, tied cylinders."""
    for material in proofs.MATERIALS:
        a, pressure = proofs.uniaxial(material)
        largest = 0.0
        for degree, cell in ((1, "triangle"), (2, "quadrilateral")):
            data = cylinders((5, 7), widths=(1.0, 1.0), bulge=False, cell=cell)
            for sides in proofs.SLAVES:
                stretches = a, proofs.STRETCH
                problem, _ = proofs.homogeneous(
                    material, stretches, proofs.ENDS, data, sides, degree
                )
                problem.solve()
                found = problem.contacts[0].pressure
                largest = max(largest, float(np.abs(found / pressure - 1).max()))
        row(f"uniform axial pressure, {material.__name__}", largest)


def tubes() -> None:
    """Press fits, quadratic displacements, 4, 8, 16 and 128 cells in a wall."""
    counts, options = (4, 8, 16, 128), {"overlap": False, "sliding": "small"}
    exact = proofs.lame_pressure()
    found = [proofs.pressed_on(n, revolved.linear_elastic, **options) for n in counts]
    row("press fit, Lame", *(np.array(found[:3]) / exact - 1))
    row("the same with 128 cells", found[3] / exact - 1)
    exact = proofs.exact_pressure()
    found = [proofs.pressed_on(n, revolved.neo_hookean, overlap=True) for n in counts]
    row("press fit, finite strain", *(np.array(found[:3]) / exact - 1))
    row("the same with 128 cells", found[3] / exact - 1)


def spaces(counts: tuple[int, ...] = (10, 20, 40)) -> None:
    """Sphere, ball, cone and punch; facets of 1/10, 1/20 and 1/40 of the contact radius.

    Cells grow by 20, 10 and 5 % away from there, so that the far mesh gets finer, too.
    """

    def pressed(body: fm.Obstacle, force: float, reach: float) -> list[Profile]:
        options = [{"reach": reach, "growth": 2.0 / n} for n in counts]
        every = zip(counts, options, strict=True)
        return [space.pressed_space(n, body, force, **chosen)[:3] for n, chosen in every]

    slope, hertz = space.SLOPE, 4 / 3 * space.SLOPE
    sphere = fm.Circle((0.0, 1 / slope - slope), 1 / slope)
    cone = fm.Plane((0.0, -np.pi / 2 * slope), (slope, -1.0))
    punch = fm.Plane((0.0, -slope), (0.0, -1.0))
    rigid = pressed(sphere, hertz, 1.5)
    ball = [space.elastic_ball(n, 2.0 / n) for n in counts]
    for name, found, force in (("rigid sphere", rigid, hertz), ("elastic ball", ball, hertz / 2)):
        row(f"{name}, pressure in L2", *(space.error_of_hertz(*f, force) for f in found))
        radii = [np.sqrt(2.5 * space.second_moment(*f)) - 1 for f in found]
        row(f"{name}, contact radius", *radii)
        row(f"{name}, force", *(p @ w / force - 1 for _, p, w in found))
        peaks = [p[r.argmin()] / (1.5 * (p @ w) / np.pi) - 1 for r, p, w in found]
        row(f"{name}, peak over 1.5 mean", *peaks)
    found = pressed(cone, np.pi / 2 * slope, 1.5)
    row("cone, force", *(p @ w / (np.pi / 2 * slope) - 1 for _, p, w in found))
    row("cone, contact radius", *(np.sqrt(3 * space.second_moment(*f)) - 1 for f in found))
    found = pressed(punch, 2 * slope, 1.0)
    row("flat punch, force", *(p @ w / (2 * slope) - 1 for _, p, w in found))
    inside = [(r[r < 0.7], p[r < 0.7]) for r, p, _ in found]
    errors = [np.abs(p * np.pi * np.sqrt(1 - r**2) / slope - 1).max() for r, p in inside]
    row("flat punch, pressure for r < 0.7 a", *errors)


def slopes() -> None:
    """Taylor slopes of all derivatives, with friction, off the solution."""
    for law in (None, fm.Coulomb(0.3), fm.Tresca(1.0)):
        made = disturbed(pressed_cylinders(pair={"law": law}))
        found = made.problem.check_tangent(print_table=False).slopes
        listed = ", ".join(f"{name} {slope:.3f}" for name, slope in found.items())
        print(f"| Taylor slopes, {law} | {listed} | |", flush=True)


def main() -> None:
    """Print all."""
    print("| proof | errors | rates |\n|---|---|---|")
    for part in (patches, tubes, spaces, slopes):
        part()


if __name__ == "__main__":
    main()
