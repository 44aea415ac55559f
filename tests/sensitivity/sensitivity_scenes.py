# SPDX-License-Identifier: MIT
"""Scenes and Taylor tests of derivatives through contact."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
from scenes import Scene, pressed_blocks

import fenics_mortar as fm
from fenics_mortar.interface.mortar import EXACT
from fenics_mortar.obstacles.rigid_motion import place_after

comm = MPI.COMM_WORLD
STEPS = 1e-3 * 0.5 ** np.arange(6)
# Relative remainders below this are rounding: sums of some hundred terms, and small slips.
ROUNDING = 1e-11
MESH = {"n_upper": 5, "n_lower": 7, "layers_upper": 2, "layers_lower": 2}


def slope(remainders, steps=STEPS):
    """Slope of a Taylor remainder; inf if all is rounding."""
    used = np.asarray(remainders) > ROUNDING
    if used.sum() < 2:
        return np.inf
    return float(np.polyfit(np.log(steps[used]), np.log(np.asarray(remainders)[used]), 1)[0])


def taylor(value, derivative, steps=STEPS):
    """Slope of |f(t) - f(0) - t f'|, relative to the change at t = 1."""
    start, derivative = np.asarray(value(0.0)), np.asarray(derivative)
    size = np.linalg.norm(derivative) or 1.0
    errors = [np.linalg.norm(value(t) - start - t * derivative) / size for t in steps]
    value(0.0)
    return slope(errors, steps), errors


def exact(problem):
    """Evaluate the operators with all derivatives."""
    problem.equations.linearization = EXACT
    problem.equations.evaluate_operators()
    return problem


def rows(problem, frames):
    """Rows of the multipliers of all pairs, with weights of a given state."""
    pairs = zip(problem.equations.contacts, frames, strict=True)
    return np.concatenate([c.rows.weighted(frame).ravel() for c, frame in pairs])


def random_vector(problem, seed, sizes=(1.0, 1.0, 1.0)):
    """Random entries, equal on any number of ranks; ``sizes``: of u, z, q."""
    rng, bulk = np.random.default_rng(seed), problem.equations.bulk
    everywhere = sizes[0] * rng.uniform(-1.0, 1.0, bulk.r.getSize())
    z = [sizes[1] * rng.uniform(-1.0, 1.0, c.z.shape) for c in problem.equations.contacts]
    q = sizes[2] * rng.uniform(-1.0, 1.0, problem.equations.motions.places.shape)
    return fm.LinearVector(everywhere[bulk.first :][: bulk.num_owned], z, q)


def moved(problem, state, d, t):
    """The state moved by t d; active sets and all other parts are unchanged."""
    u = problem.equations.bulk.u
    kept = u.x.array.copy()
    u.x.array[:] = state.u
    u.x.array[: problem.equations.bulk.num_owned] += t * d.u
    u.x.scatter_forward()
    new, u.x.array[:] = u.x.array.copy(), kept
    interfaces = tuple(
        replace(a, z=a.z + t * dz) for a, dz in zip(state.interfaces, d.z, strict=True)
    )
    after = [place_after(place, t * dq, 1.0) for place, dq in zip(state.places, d.q, strict=True)]
    places = np.reshape(after, state.places.shape)
    return replace(state, u=new, interfaces=interfaces, places=places)


def count_slip_from(problem, state, present):
    """Set the partners of ``state`` and its sets; the present state is otherwise unchanged."""
    e = problem.equations
    e.put(state)
    e.evaluate_operators()
    for contact in e.contacts:
        contact.accept()
    accepted = [contact.accepted_partners for contact in e.contacts]
    e.put(present)
    e.evaluate_operators()
    for contact, partners in zip(e.contacts, accepted, strict=True):
        contact.change(partners=partners)


PUSHES = ((0.0, -0.03), (0.04, -0.05))


def two_steps(law, *, degree=1, pair=None, problem=None, pushes=PUSHES, **mesh):
    """Blocks pressed and then sheared: the problem, and the accepted states of both steps."""
    scene: Scene = pressed_blocks(
        pair={"law": law, **(pair or {})}, degree=degree, problem=problem,
        **{**MESH, "rotation": 0.03, **mesh},
    )  # fmt: skip
    states = []
    for push in pushes:
        scene.loads["push"].value[:] = push
        scene.problem.solve(predict=False)
        states.append(scene.problem.state())
    exact(scene.problem)
    return scene, *states
