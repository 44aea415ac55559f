# SPDX-License-Identifier: MIT
"""Checks before each solve of all values that users may set between two solves.

Attributes of laws, obstacles, contacts and options of Newton's method, and places, loads and pivots
of obstacles and remote loads, may be set at any time and are not guarded individually. Instead each
solve starts with a check of all of them: invalid values, changes without effect, and values that
differ between ranks raise an error on all ranks.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk import revolution
from fenics_mortar.bulk.checks import have_common_facet
from fenics_mortar.bulk.residual import Bulk, mark_prescribed
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.law import BUILT_IN, Law, check_names
from fenics_mortar.contact.tied import Tie
from fenics_mortar.contact.view import remarks_on_friction, remarks_on_ties
from fenics_mortar.interface.integrals import evaluate_normals
from fenics_mortar.newton.loop import NewtonOptions
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.obstacles.rigid_motion import DRIVEN_TURNS, RigidMotion
from fenics_mortar.rigid.spread import SpreadLoad
from fenics_mortar.utils import compat, errors
from fenics_mortar.utils.arrays import ROUNDING, SAME_PLACE, Array
from fenics_mortar.verify.checks.obstacles import check_user_gradient

if TYPE_CHECKING:
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.equations.general import ContactEquations


def check_numbers(mover: RigidMotion) -> None:
    """Reject places, loads or pivots that are not numbers (local).

    Raises:
        MortarError: If a value has another shape or type, or is not finite.
        ValueError: If a dimension of a shape of the package was set as an attribute.
    """
    name = f"{mover.kind} '{mover.name}'"
    count = 3 if mover.dim == 2 else 6
    for what, size in (("place", count), ("load", count), ("pivot", mover.dim)):
        given = np.asarray(getattr(mover, what))
        fixed = ", or nan for prescribed motions" if what == "load" else ""
        expected = f"expected {size} finite numbers{fixed}"
        allowed = np.nan_to_num(given, posinf=np.inf, neginf=-np.inf) if what == "load" else given
        if given.shape != (size,) or given.dtype.kind not in "iuf":
            raise errors.MortarError(f"{what} of {name} is {given!r}: {expected}")
        if not np.isfinite(allowed).all():
            raise errors.NotFiniteError(f"{what} of {name} is {given}: {expected}")
    turns = int(np.isfinite(mover.load[mover.dim :]).sum())
    if turns not in DRIVEN_TURNS:
        raise errors.MortarError(
            f"load of {name} is {mover.load}: expected moments about none, one or all of the axes"
        )
    if isinstance(mover, Obstacle) and type(mover).__module__.startswith(
        Obstacle.__module__.rpartition(".")[0]
    ):
        of_shape = [what for what in errors.parameters_of(mover) if what not in ("name", "pivot")]
        shape = " or ".join(f"set_shape({what!r}, ...)" for what in mover.shape())
        cure = f"use {shape or 'another obstacle in a new problem'}"
        errors.check_no_effect(name, mover, of_shape, cure)


def _angle_of(mover: RigidMotion) -> float:
    """The angle by which a mover has turned [radian] (local)."""
    turn = mover.place[mover.dim :]
    return float(turn[0] if mover.dim == 2 else np.linalg.norm(turn))


def _check_pivot(mover: RigidMotion, pivot: Array, angle: float) -> None:
    """Reject a new pivot of what had turned by ``angle`` about ``pivot`` (local)."""
    if np.isfinite(mover.load[mover.dim :]).any():  # driven: turned by the last solve
        angle = _angle_of(mover)
    if angle != 0.0 and (np.asarray(mover.pivot) != pivot).any():
        raise errors.MortarError(
            f"pivot of {mover.kind} '{mover.name}' was changed from {errors.format_point(pivot)} "
            f"to {errors.format_point(mover.pivot)} after the {mover.kind} had turned by "
            f"{angle:.4g} radian, which would shift its surface: set the pivot before it turns, "
            "e.g. Circle(centre, radius, pivot=...)"
        )


def check_axial(mover: RigidMotion) -> None:
    """Reject forces other than axial ones on a mover that is a body of revolution (local).

    Raises:
        MortarError: If its radial motion or its rotation is driven, or a load spread so.
    """
    across = mover.load[[0, 2]]
    if across.any() if isinstance(mover, SpreadLoad) else np.isfinite(across).any():
        raise errors.MortarError(
            f"{mover.kind} '{mover.name}' is pushed radially or turned: a rigid body of revolution "
            "moves along its axis only; expected push(y=...), and move(x=..., angle=...) for tools "
            "that change their shape"
        )


class Inputs:
    """Checks of the values of a problem that users may set.

    Args:
        equations: The equations of the problem.
    """

    def __init__(self, equations: ContactEquations) -> None:
        bulk, contacts, motions = equations.bulk, equations.contacts, equations.motions
        self._bulk, self._contacts, self._outline = bulk, contacts, equations.crossings.outline
        self._as_bound = [_options(contact.pair) for contact in contacts]
        self._movers = [mover.motion for mover in motions.movers]
        self._movers += [load.motion for load in motions.spread]
        self._boundaries: list[tuple[Any, Any]] = [
            (load, mark_prescribed(bulk.space, bulk.u, [bc for bc in bulk.bcs if bc is not load]))
            for load in motions.boundaries
        ]
        self._remember()
        self._conflicts = Conflicts(bulk)
        self._begins, self._on_axis = True, revolution.radial_dofs_on_axis(bulk.space)
        self._first = [revolution.check_radius(bulk.residual, bulk.u, bulk.space)]
        self._first += [*remarks_on_ties(contacts, bulk.space), *remarks_on_friction(contacts)]

    def check(self, newton: Any, **flags: Any) -> list[str]:
        """Reject invalid values; return remarks on questionable ones (collective).

        Args:
            newton: Options of the next solve.
            flags: Options of the next solve, true or false.

        Raises:
            MortarError, ValueError: On all ranks.
        """
        comm = self._bulk.comm
        with errors.together(comm, "the values set for the problem"):
            if self._bulk.inertia is not None and not self._bulk.inertia.moving:
                raise errors.MortarError(
                    "bodies have inertia: expected Dynamics.step or Dynamics.run, since solve() "
                    "and follow_path find states at rest"
                )
            errors.check_kind("newton", newton, NewtonOptions, "an instance of NewtonOptions")
            for name, flag in flags.items():
                errors.check_flag(name, flag)
            for mover, before in zip(self._movers, self._turned, strict=True):
                self._check_mover(mover, *before)
            for contact, as_bound in zip(self._contacts, self._as_bound, strict=True):
                _check_contact(contact, as_bound)
        errors.check_same(comm, list(self._numbers()))
        for contact in self._contacts:
            name = f"offset of '{contact.slave.name}'"
            errors.check_lengths(name, contact.offset, contact.slave.num_nodes)
        numbered = list(enumerate(self._contacts))
        texts: dict[str, Any] = {f"c_n of pair {number}": c.c_n for number, c in numbered}
        laws = [(number, c.pair.law) for number, c in numbered if isinstance(c, Contact)]
        texts |= {f"the law of pair {number}": law for number, law in laws}
        errors.check_same_texts(
            comm, "what was set of the problem", {"newton": newton, **texts, **flags}
        )
        self._check_conditions()
        self._check_distances()
        if self._begins:
            for contact in self._contacts:
                check_user_gradient(contact)
            bulk, self._begins = self._bulk, False
            slaves = [contact.slave for contact in self._contacts]
            given = bulk.residual, bulk.u, bulk.space, slaves
            self._first.append(revolution.remark_on_thickness(*given))
        revolution.check_axis_values(self._bulk.space, self._bulk.u, self._bulk.bcs, self._on_axis)
        self._remember()
        remarks, self._first = self._first, []
        return [*filter(None, remarks), *self._conflicts.describe()]

    def _numbers(self) -> Iterator[tuple[str, Any]]:
        """Arrays that have to be equal on all ranks, by name."""
        for contact in self._contacts:
            yield f"offset of '{contact.slave.name}'", contact.offset
            if isinstance(contact, Tie):
                yield f"jump of {contact.pair!r}", contact.pair.present_jump()
            yield "the time", contact.state.load_time
        for mover in self._movers:
            for what, value in (("place", mover.place), ("push", mover.load)):
                yield f"the {what} of {mover.kind} '{mover.name}'", value
            yield f"the pivot of {mover.kind} '{mover.name}'", mover.pivot

    def _remember(self) -> None:
        """Remember the pivots, and by how much the movers have turned (local)."""
        self._turned = [(mover.pivot.copy(), _angle_of(mover)) for mover in self._movers]

    def _check_mover(self, mover: Any, pivot: Array, angle: float) -> None:
        """Reject invalid values of an obstacle or remote load (local).

        Args:
            mover: The obstacle or load.
            pivot: Its pivot at the last solve, shape (dim,) [length].
            angle: The angle by which it had turned then [radian].
        """
        check_numbers(mover)
        _check_pivot(mover, pivot, angle)
        if self._bulk.space.is_axisymmetric and isinstance(mover, RigidMotion):
            check_axial(mover)
        if isinstance(mover, SpreadLoad) and np.isnan(mover.load).any():
            raise errors.MortarError(
                f"load of {mover.kind} '{mover.name}' is nan: expected numbers"
            )

    def _check_conditions(self) -> None:
        """Reject driven motions of nodes that other conditions prescribe (collective)."""
        for load, prescribed in self._boundaries:
            count, where = self._bulk.input_data.count_nodes(load.driven_dofs() & prescribed)
            if count:
                raise errors.MortarError(
                    f"{count} nodes of rigid boundary '{load.motion.name}', one at {where}, are "
                    "prescribed by another condition in a direction in which a push drives them: "
                    "leave them out of one of both, or prescribe that motion by move()"
                )

    def _check_distances(self) -> None:
        """Reject slaves inside an obstacle, and distances that differ on ranks (collective)."""
        comm = self._bulk.comm
        contacts = [contact for contact in self._contacts if isinstance(contact, Contact)]
        obstacles = [(c, c.obstacle) for c in contacts if c.obstacle is not None]
        positions = [c.slave.X + c.slave.gather(self._bulk.u.x.array) for c, _ in obstacles]
        of_bodies = self._outline.positions(self._bulk.u.x.array)
        sums: list[tuple[float, float]] = []
        with errors.together(comm, "the distance of an obstacle"):
            for (contact, obstacle), x in zip(obstacles, positions, strict=True):
                phi, gradient, _ = obstacle.evaluate(x)
                bodies = np.isin(self._outline.bodies, self._outline.bodies_of(contact.slave))
                _check_side(contact, (x, phi, gradient), of_bodies[bodies])
                of_all = np.concatenate([phi, contact.arm * gradient.ravel()])
                sums.append((float(of_all.sum()), float(np.abs(of_all).sum())))
        for (_, obstacle), (total, size) in zip(obstacles, sums, strict=True):
            low, high = comm.allreduce(total, MPI.MIN), comm.allreduce(total, MPI.MAX)
            if high - low > ROUNDING * comm.allreduce(size, MPI.MAX):
                raise errors.MortarError(f"the distance of '{obstacle.name}' differs between ranks")


class Conflicts:
    """Components for which several Dirichlet conditions prescribe different values.

    The constructor is collective.

    Args:
        bulk: The bodies; the dofs of their conditions do not change.
    """

    def __init__(self, bulk: Bulk) -> None:
        self._bulk = bulk
        dofs = np.concatenate([np.empty(0, np.int32), *(bc.dof_indices()[0] for bc in bulk.bcs)])
        self._twice = np.flatnonzero(np.bincount(dofs) > 1)
        self._any_twice = bulk.comm.allreduce(self._twice.size > 0, MPI.LOR)
        self._described: set[str] = set()

    def describe(self) -> list[str]:
        """Describe conflicts of the present values that were not reported before (collective)."""
        found = self._find() if self._any_twice else []
        new = [texts for texts in found if texts not in self._described]
        self._described.update(new)
        return new

    def _name(self, number: int) -> str:
        """Number of a condition, or the name of a rigid boundary."""
        motion = getattr(self._bulk.bcs[number], "motion", None)
        return f"rigid boundary '{motion.name}'" if motion else str(number)

    def _find(self) -> list[str]:
        bulk, found, size = self._bulk, list[str](), self._bulk.u.x.array.size
        given, here = np.full((len(bulk.bcs), self._twice.size), np.nan), 0.0
        for mine, bc in zip(given, bulk.bcs, strict=True):
            values = np.full(size, np.nan)
            compat.set_prescribed(values, [bc])
            mine[:] = values[self._twice]
            here = np.abs(np.nan_to_num(values)).max(initial=here)
        largest = bulk.comm.allreduce(here, MPI.MAX)
        for (i, one), (j, other) in combinations(enumerate(given), 2):
            marked = np.zeros(size, bool)
            marked[self._twice[np.abs(other - one) > ROUNDING * largest]] = True
            count, where = bulk.input_data.count_nodes(marked)
            if count:
                found.append(
                    f"Dirichlet conditions {self._name(i)} and {self._name(j)} prescribe "
                    f"different values of the same component at {count} nodes, one at {where}: "
                    f"the value of {self._name(j)}, the later one, is used"
                )
        return found


def _options(pair: Any) -> dict[str, str]:
    """Options of a pair that are fixed when a problem is set up (local).

    These are all options but the law. Of conductances, which ones they are is fixed, but not their
    values.
    """
    fixed = {name: value for name, value in vars(pair).items() if name != "law"}
    fixed["fluxes"] = [id(flux) for flux in fixed.get("fluxes", ())]
    return {name: errors.as_text(value) for name, value in fixed.items()}


def _check_contact(contact: Interface, as_bound: dict[str, str]) -> None:
    """Reject invalid values of a pair or of its contact (local)."""
    pair = contact.pair
    for name, texts in _options(pair).items():
        if as_bound.get(name) != texts:
            raise errors.MortarError(
                f"{name} of {pair!r} was set after the problem was set up, which has no effect: "
                "set up a new problem (its law may be set, values of its conductances, "
                "contact.c_n and contact.offset)"
            )
    if isinstance(contact, Tie):
        contact.pair.present_jump()
    if isinstance(contact, Contact):
        expected = "an instance of Frictionless, Coulomb, Tresca or Law"
        errors.check_kind(f"law of {pair!r}", pair.law, Law, expected)
        errors.check_number(
            "contact.c_n", contact.c_n, "a positive number", lambda c: 0.0 < c < np.inf
        )
        check_names(pair.law)
        pair.law.check()
        if type(pair.law) in BUILT_IN:
            known = errors.parameters_of(pair.law)
            others = [name for name in vars(pair.law) if name not in known]
            cure = f"this law has {', '.join(known) or 'no parameters'}"
            errors.check_no_effect(f"{pair.law!r}", pair.law, others, cure)


def _check_side(contact: Contact, on_slave: tuple[Array, Array, Array], bodies: Array) -> None:
    """Reject an obstacle whose solid is on the body's side of the slave surface (local).

    In this case most of the outline, or of the slave surface, lies on or in the obstacle, and at
    the slave node next to its surface, on either side of it, the normal points out of it. The
    normals of a body that merely penetrates too far, or of one that the solid surrounds with an
    interference, point towards the solid.

    Args:
        contact: The contact.
        on_slave: Positions of the slave nodes, distances and their gradients.
        bodies: Positions of the nodes of the outlines of its bodies, shape (n, dim) [length].
    """
    x, phi, gradient = on_slave
    normals, _ = evaluate_normals(contact.slave, x, contact.options.weighting)
    nearest = np.abs(phi - contact.offset).argmin()
    along = normals[nearest] @ gradient[nearest] / np.linalg.norm(gradient[nearest])
    if contact.obstacle is None or along < contact.options.min_cosine:
        return
    level = SAME_PLACE * contact.slave.nodal_lengths.min()
    of_outline = contact.obstacle.evaluate(bodies)[0]
    if any([2 * (at <= level).sum() > at.size for at in (phi - contact.offset, of_outline)]):
        raise errors.MortarError(
            f"'{contact.slave.name}' lies inside obstacle '{contact.obstacle}', on the far side of "
            "its surface: the solid is on the side of the body. The outward normal, along which "
            "the distance increases, has to point to the body (reverse the normal of a Plane, set "
            "inside of a Circle, reverse the order of the points of a Spline). A SignedDistance "
            "has to be negative in the solid: here its sign and that of its derivatives are "
            "probably wrong"
        )


def check_roles(contacts: Sequence[Interface]) -> None:
    """Reject two surfaces that are slave and master of each other in two pairs (local).

    Raises:
        MortarError: On all ranks.
    """
    for one, other in combinations(contacts, 2):
        if have_common_facet(one.slave, other.master) and have_common_facet(
            other.slave, one.master
        ):
            raise errors.MortarError(
                f"{one.pair!r} and {other.pair!r} have the same two surfaces with exchanged "
                "roles: their gaps would be constrained twice; omit one of them"
            )
