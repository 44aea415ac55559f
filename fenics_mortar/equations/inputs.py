# SPDX-License-Identifier: MIT
"""What users may set between two solves, looked at before each: refused on all ranks or on none.

Laws, obstacles, contacts and options of Newton's method are plain objects whose attributes may be
set at any time. Instead of guarding every attribute, a solve begins with a look at all of them:
what has no meaning, what has no effect any more, and what differs between the ranks is refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.laws import Law
from fenics_mortar.contact.tied import Tie
from fenics_mortar.interface.integrals import evaluate_normals
from fenics_mortar.newton.loop import NewtonOptions
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils import compat
from fenics_mortar.utils.arguments import check_flag, check_kind, check_lengths, check_number
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import (
    MortarError,
    NotFiniteError,
    check_same,
    check_same_words,
    in_words,
    together,
)

# A node lies on an obstacle within this part of its length.
ON = 1e-6
# Distances that all ranks compute from the same numbers may differ by this part.
ALIKE = 1e-9
# Prescribed values are the same within this part of the largest.
SAME = 1e-12


class Inputs:
    """Looks at what was set of a problem.

    Args:
        bulk: Its bodies.
        contacts: Its pairs, as bound.
        obstacles: Their obstacles.
    """

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Contact | Tie], obstacles: Sequence[Obstacle]
    ) -> None:
        self._bulk, self._contacts, self._obstacles = bulk, contacts, obstacles
        self._as_bound = [_options(contact.pair) for contact in contacts]
        self._conflicts = Conflicts(bulk)

    def check(self, newton: Any, accept_violations: Any) -> list[str]:
        """Refuse what cannot be right; remarks on what may be (collective).

        Args:
            newton: Options of the solve to come.
            accept_violations: Another one of its options.

        Raises:
            MortarError, ValueError: On all ranks.
        """
        comm = self._bulk.comm
        with together(comm, "what was set of the problem"):
            check_kind("newton", newton, NewtonOptions, "an instance of NewtonOptions")
            check_flag("accept_violations", accept_violations)
            for contact, as_bound in zip(self._contacts, self._as_bound, strict=True):
                _check_contact(contact, as_bound)
            for obstacle in self._obstacles:
                check_obstacle(obstacle)
        check_same(comm, self._numbers())
        for contact in self._contacts:
            name = f"offset of '{contact.slave.name}'"
            check_lengths(name, contact.offset, contact.slave.num_nodes)
        words = {**dict(self._words(newton)), "accept_violations": accept_violations}
        check_same_words(comm, "what was set of the problem", words)
        self._check_distances()
        return self._conflicts.describe()

    def _numbers(self) -> Iterator[tuple[str, Any]]:
        """Arrays that have to be the same on all ranks."""
        for contact in self._contacts:
            yield f"offset of '{contact.slave.name}'", contact.offset
        for obstacle in self._obstacles:
            yield f"the place of obstacle '{obstacle.name}'", obstacle.place
            yield f"the push of obstacle '{obstacle.name}'", obstacle.load
            yield f"the pivot of obstacle '{obstacle.name}'", obstacle.pivot

    def _words(self, newton: NewtonOptions) -> Iterator[tuple[str, Any]]:
        """Options and laws that have to be the same on all ranks."""
        yield "newton", newton
        for number, contact in enumerate(self._contacts):
            yield f"c_n of pair {number}", contact.c_n
            if isinstance(contact, Contact):
                yield f"the law of pair {number}", contact.pair.law

    def _check_distances(self) -> None:
        """Refuse obstacles that the slave lies in, and distances that differ (collective)."""
        comm = self._bulk.comm
        contacts = [contact for contact in self._contacts if isinstance(contact, Contact)]
        obstacles = [(c, c.obstacle) for c in contacts if c.obstacle is not None]
        positions = [c.slave.X + c.slave.gather(self._bulk.u.x.array) for c, _ in obstacles]
        sums: list[tuple[float, float]] = []
        with together(comm, "the distance of an obstacle"):
            for (contact, obstacle), x in zip(obstacles, positions, strict=True):
                phi, gradient, _ = obstacle.evaluate(x)
                _check_side(contact, x, phi, gradient)
                of_all = np.concatenate([phi, contact.arm * gradient.ravel()])
                sums.append((float(of_all.sum()), float(np.abs(of_all).sum())))
        for (_, obstacle), (total, size) in zip(obstacles, sums, strict=True):
            low, high = comm.allreduce(total, MPI.MIN), comm.allreduce(total, MPI.MAX)
            if high - low > ALIKE * comm.allreduce(size, MPI.MAX):
                raise MortarError(f"the distance of '{obstacle.name}' is not the same on all ranks")


class Conflicts:
    """Components for which several Dirichlet conditions prescribe different values.

    Args:
        bulk: Its conditions; which dofs they have does not change.
    """

    def __init__(self, bulk: Bulk) -> None:
        self._bulk = bulk
        dofs = [bc.dof_indices()[0] for bc in bulk.bcs]
        here = sum(map(len, dofs)) > len(np.unique(np.concatenate([*dofs, np.empty(0, np.int32)])))
        self._any_twice = bulk.comm.allreduce(here, MPI.LOR)
        self._told: set[str] = set()

    def describe(self) -> list[str]:
        """The conflicts of the present values, in words, each once (collective)."""
        found = self._find() if self._any_twice else []
        new = [words for words in found if words not in self._told]
        self._told.update(new)
        return new

    def _find(self) -> list[str]:
        bulk, found = self._bulk, list[str]()
        first = np.full(bulk.u.x.array.size, -1)
        values = np.zeros(first.size)
        for number, bc in enumerate(bulk.bcs):
            mine, dofs = np.zeros(first.size), bc.dof_indices()[0]
            compat.set_prescribed(mine, [bc])
            largest = bulk.comm.allreduce(np.abs([*values, *mine[dofs]]).max(initial=0.0), MPI.MAX)
            differ = (first[dofs] >= 0) & (np.abs(mine[dofs] - values[dofs]) > SAME * largest)
            for other in range(number):
                marked = np.zeros(first.size, bool)
                marked[dofs[differ & (first[dofs] == other)]] = True
                count, where = bulk.count_nodes(marked)
                if count:
                    found.append(
                        f"Dirichlet conditions {other} and {number} prescribe different values of "
                        f"the same component at {count} nodes, one at {where}: that of {number}, "
                        "the later one, counts"
                    )
            first[dofs], values[dofs] = number, mine[dofs]
        return found


def _options(pair: Any) -> dict[str, str]:
    """What a problem takes over from a pair when it is set up; the law is asked at any time."""
    return {name: in_words(value) for name, value in vars(pair).items() if name != "law"}


def _check_contact(contact: Contact | Tie, as_bound: dict[str, str]) -> None:
    """Refuse what was set of a pair or of its contact (local)."""
    pair = contact.pair
    for name, words in _options(pair).items():
        if as_bound.get(name) != words:
            raise MortarError(
                f"{name} of {pair!r} was set after the problem was set up, which has no effect: "
                "set up a new problem (its law may be set, and contact.c_n and contact.offset)"
            )
    count = contact.slave.num_nodes
    for name, shape, kind in (
        ("z", (count, 2), float),
        ("active", (count,), bool),
        ("carries", (count,), bool),
        ("piece", (count,), int),
    ):
        given = getattr(contact, name)
        check_kind(f"{name} of {pair!r}", given, np.ndarray, "an array")
        if given.shape != shape or not np.can_cast(given.dtype, kind, "same_kind"):
            raise MortarError(
                f"{name} of {pair!r} has shape {given.shape} and type {given.dtype}; right are "
                f"{shape} and {kind.__name__}"
            )
    if isinstance(contact, Contact):
        right = "an instance of Frictionless, Coulomb, Tresca or Law"
        check_kind(f"law of {pair!r}", pair.law, Law, right)
        check_number("contact.c_n", contact.c_n, "a positive number", lambda c: 0.0 < c < np.inf)
        pair.law.check()


def check_obstacle(obstacle: Obstacle) -> None:
    """Refuse a place, a push or a pivot that is none (local)."""
    name = obstacle.name
    for what, size in (("place", 3), ("load", 3), ("pivot", 2)):
        given = np.asarray(getattr(obstacle, what))
        right = f"{size} finite numbers" + ", or nan where nothing pushes" * (what == "load")
        allowed = np.nan_to_num(given, posinf=np.inf, neginf=-np.inf) if what == "load" else given
        if given.shape != (size,) or given.dtype.kind not in "iuf":
            raise MortarError(f"{what} of obstacle '{name}' is {given!r}: {right}")
        if not np.isfinite(allowed).all():
            raise NotFiniteError(f"{what} of obstacle '{name}' is {given}: {right}")


def _check_side(contact: Contact, x: Array, phi: Array, gradient: Array) -> None:
    """Refuse an obstacle whose solid is on the body's side of the slave surface (local).

    All nodes lie on or in it then, and none of their normals points to it. A body that has only
    gone too deep still faces it.
    """
    normals, _ = evaluate_normals(contact.slave, x, contact.options.weighting)
    along = (normals * gradient).sum(axis=1) / np.linalg.norm(gradient, axis=1)
    within = phi - contact.offset <= ON * contact.nodal_lengths
    if (within & (along >= contact.options.least_cosine)).all():
        raise MortarError(
            f"'{contact.slave.name}' lies in obstacle '{contact.obstacle}', on the far side of its "
            "surface: the solid is where the body is. Its outward normal, which the distance grows "
            "along, has to point to the body (of a Plane turn the normal, of a Circle set inside, "
            "of a Spline turn the order of the points)"
        )


def check_roles(contacts: Sequence[Contact | Tie]) -> None:
    """Refuse two sides that are slave and master of each other in two pairs (local).

    Raises:
        MortarError: On all ranks.
    """
    for i, one in enumerate(contacts):
        for other in contacts[i + 1 :]:
            if _shared_facets(one.slave, other.master) and _shared_facets(other.slave, one.master):
                raise MortarError(
                    f"{one.pair!r} and {other.pair!r} are the same two sides with exchanged roles: "
                    "their gaps would be constrained twice; leave one of them out"
                )


def _shared_facets(one: Any, other: Any) -> bool:
    """Whether two surfaces have a facet in common."""
    ends = [s.nodes[s.facets[:, [0, -1]]].reshape(-1, 2) for s in (one, other)]
    return bool(set(map(tuple, ends[0].tolist())) & set(map(tuple, ends[1].tolist())))
