# SPDX-License-Identifier: MIT
"""Was the model rich enough? An estimate of its error, from one step of the next richer one.

At the solution of a cheap model the equations of a richer one leave a residual; one linear solve
with the tangent of the richer model turns it into a correction of displacement and multipliers. To
first order the correction is the model's error, and so is the change of any quantity: it is one
Newton step of the richer model, at the cost of one step. Where the step leaves more of the residual
than a linear problem would, the models are far apart, and a few more are taken: until what is left
of the residual, as a part of the correction, could no longer change any of the quantities by half.
A peak pressure may be right where the contact is not.

The indicators are what the cheap model leaves out: for linear kinematics the rotation, whose
spurious strain is angle^2 / 2, and the strain; for small sliding the slip over a facet's length and
the turn of the normals. What an obstacle stands for may be meshed alone, see ``elastic_tool``: it
gives way to the tractions, and the gaps wider by that are the richer model. Beside it stands what
the facets of that mesh get wrong, in place of the curve: where that is more, refine it before you
model it. Without a mesh there is but a rule: a body of modulus E' = E / (1 - nu^2) against another
one of its shape has the compliance 1/E' + 1/E'_other, so leaving out the other is an error of
E' / E'_other (of forces and pressures under prescribed displacements; half of it, of pressures,
under prescribed forces). Shape and supports may make that three times as much or as little.

Where surfaces might have friction, the richer model lets all stick that touches. What it asks for
is the demand, its shear over its pressure; where that is more than there is, nodes slide in the
steps that follow. Slip counts from where nodes came to touch, over all solves that the check sees:
that of the last step alone would be a part of the shear.

A check that climbs begins each solve on the cheapest of the models that the problem's own form
gives: the bulk linearized at rest and small sliding. The estimate needs a Newton step of the next
model, so that what it costs to find a model too poor is not lost: the next goes on from there, and
rungs that were not enough once are not tried again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

from fenics_mortar.contact import Contact
from fenics_mortar.elastic_tool import ElasticTool
from fenics_mortar.errors import MortarError
from fenics_mortar.laws import Coulomb, Frictionless, Law, Stick
from fenics_mortar.mortar import evaluate_normals
from fenics_mortar.newton import NewtonReport
from fenics_mortar.pair import ContactPair
from fenics_mortar.problem import ContactProblem
from fenics_mortar.surfaces import Array

# Steps of the richer model at the most; one is enough if it leaves the first part of the residual,
# and if what that may change is below the second or half of each error.
MOST_STEPS, LINEAR, SETTLED = 6, 0.1, 1e-3
ENERGY, FORCE, PEAK = "energy norm", "total force", "peak pressure"
QUANTITIES = (ENERGY, FORCE, PEAK)
# A model with a larger error than this is no good to go on from.
FAR = 0.5


@dataclass(frozen=True)
class Assumption:
    """What a model leaves out, and what that is worth.

    Attributes:
        name: The assumption.
        indicator: How far the state is from it, in words.
        errors: Estimated relative error by quantity; nan if nothing is known.
        mesh: What the mesh of the richer model would get wrong, if that is known.
    """

    name: str
    indicator: str
    errors: dict[str, float]
    mesh: Assumption | None = None


@dataclass(frozen=True)
class Adequacy:
    """The assumptions behind a solution; prints as a Markdown table.

    Attributes:
        assumptions: One by one, and where they are several, all together as the last.
        tolerance: Error that is allowed.
        quantity: Of what.
        discretisation: Relative error that the mesh leaves, if it is known.
    """

    assumptions: list[Assumption]
    tolerance: float
    quantity: str
    discretisation: float | None = None

    @property
    def error(self) -> float:
        """Estimated relative error of the quantity by all assumptions."""
        return max((a.errors[self.quantity] for a in self.assumptions), default=0.0)

    @property
    def suffices(self) -> bool:
        """Whether the model is seen to be rich enough."""
        return bool(self.error <= self.tolerance)

    def verdict(self, assumption: Assumption) -> str:
        """Judgement on one assumption, in words."""
        error = assumption.errors[self.quantity]
        if np.isnan(error):
            return "unknown"
        if error <= self.tolerance:
            return "enough"
        of_meshes = [self.discretisation or 0.0]
        of_meshes += [assumption.mesh.errors[self.quantity]] if assumption.mesh else []
        return "refine before you model more" if error <= max(of_meshes) else "not enough"

    def __str__(self) -> str:
        """One row per assumption, and the error of the mesh."""
        lines = ["| assumption | indicator | " + " | ".join(QUANTITIES) + " | verdict |"]
        lines.append("|---|---|" + "---:|" * len(QUANTITIES) + "---|")
        for a in self.assumptions:
            lines.append(_row(a, self.verdict(a)))
            lines += [_row(a.mesh, "")] if a.mesh else []
        if self.discretisation is not None:
            empty = " | " * (len(QUANTITIES) - 1)
            lines.append(f"| mesh | | {100 * self.discretisation:.2g} % {empty} | |")
        lines.append(
            f"\nestimated errors; allowed are {100 * self.tolerance:g} % in {self.quantity}"
        )
        return "\n".join(lines)


def _row(assumption: Assumption, verdict: str) -> str:
    """A line of the table."""
    cells = [f"{100 * assumption.errors[name]:.2g} %" for name in QUANTITIES]
    return f"| {' | '.join([assumption.name, assumption.indicator, *cells, verdict])} |"


class AdequacyCheck:
    """Asks of a solved problem whether its model was rich enough.

    Args:
        tolerance: Relative error that is allowed.
        quantity: Of what: "energy norm", "total force" or "peak pressure".
        finite_strain: UFL form of the residual at finite strain, in the same ``u``, if the
            problem's is linear.
        stiffness_ratio: E / (1 - nu^2) of the bodies over that of what obstacles stand for.
        tools: What obstacles stand for, where there is a mesh of it, in the place of the ratio.
        discretisation: Relative error that the mesh leaves, if it is known.
        friction: Largest coefficient of friction that surfaces may have where the problem has none.
        climb: Whether solves begin on a cheaper model, and go on to the problem's own only if the
            estimated error of the quantity is above both the tolerance and the error of the mesh:
            ``discretisation``, or of energy norms what the problem's ``estimate()`` says.

    Raises:
        ValueError: If a number is not positive or the quantity is another one.

    Example:
        ``ContactProblem(..., adequacy=fm.AdequacyCheck(0.02, finite_strain=residual))``; then
        ``print(problem.solve().adequacy)``.
    """

    def __init__(
        self,
        tolerance: float = 0.01,
        *,
        quantity: str = ENERGY,
        finite_strain: Any | None = None,
        stiffness_ratio: float | None = None,
        tools: Sequence[ElasticTool] = (),
        discretisation: float | None = None,
        friction: float | None = None,
        climb: bool = False,
    ) -> None:
        if quantity not in QUANTITIES:
            raise ValueError(f"quantity={quantity!r}: allowed are {', '.join(QUANTITIES)}")
        numbers = {"tolerance": tolerance, "stiffness_ratio": stiffness_ratio, "friction": friction}
        for name, value in numbers.items():
            if value is not None and not 0.0 < value < np.inf:
                raise ValueError(f"{name}={value}: a positive number")
        self._tolerance, self._quantity = tolerance, quantity
        self._finite_strain, self._stiffness_ratio = finite_strain, stiffness_ratio
        self._discretisation, self._mesh_error = discretisation, discretisation
        self._friction, self._climbs = friction, climb
        self._tools = {tool.obstacle: tool for tool in tools}
        self._richer: dict[str, ContactProblem] = {}
        self._rungs: list[tuple[str, ContactProblem]] = []
        self._climbed: list[Assumption] = []
        self._ended: ContactProblem | None = None
        self._slips: dict[Contact, Array] = {}
        self._seen_mesh_error = (0.0, 0.0)

    def prepare(self, problem: ContactProblem) -> None:
        """Set up the models below a problem, if it is to climb (collective)."""
        if self._climbs:
            self._rungs = list(cheaper_models(problem))

    def climb(self, problem: ContactProblem) -> NewtonReport | None:
        """Solve by the cheapest model that is enough (collective).

        Returns:
            Its record; ``None`` if only the problem's own model is left, which then is to start
            from where the problem is.
        """
        start, self._climbed, self._ended = problem.state(), [], None
        while self._rungs:
            name, rung = self._rungs[0]
            rung.adopt(problem)
            with suppress(MortarError):
                report = rung.solve()
                solved = rung.state()
                errors = correct(rung, problem)
                if errors[ENERGY] < FAR:
                    start = replace(problem.state(), partners=start.partners)
                accepted = self._accepts(problem, errors)
                problem.restore(solved)
                if accepted:
                    self._climbed = [Assumption(name, "the climb ended here", errors)]
                    self._ended = rung
                    return report
            problem.restore(start)
            self._rungs.pop(0)
        return None

    def _accepts(self, problem: ContactProblem, errors: dict[str, float]) -> bool:
        """Whether the error of a rung is below the tolerance, or below that of the mesh.

        That of the mesh is seen at the corrected state: what is wrong with the model is in the
        residual of the rung's own state, too. It is looked for anew where it decides, or where the
        error of the model has doubled since.
        """
        error, self._mesh_error = errors[self._quantity], self._discretisation
        if error <= self._tolerance:
            return True
        if self._mesh_error is None and self._quantity == ENERGY:
            seen_at, seen = self._seen_mesh_error
            if min(2.0 * seen_at, seen) < error < FAR:
                with suppress(MortarError):
                    self._seen_mesh_error = error, problem.estimate().relative
            self._mesh_error = self._seen_mesh_error[1] or None
        return self._mesh_error is not None and error <= self._mesh_error

    def assess(self, problem: ContactProblem) -> Adequacy:
        """Estimate the errors of the present solution; it stays as it is (collective)."""
        found = [*self._climbed, *self._assumptions(problem)]
        if self._ended is not None:  # forces and gaps are those of the rung's operators
            for contact, theirs in zip(problem.contacts, self._ended.contacts, strict=True):
                contact.operators = theirs.operators
        return Adequacy(found, self._tolerance, self._quantity, self._mesh_error)

    def _assumptions(self, problem: ContactProblem) -> Iterator[Assumption]:
        richer: dict[str, dict[str, Any]] = {}
        indicators: dict[str, Callable[[ContactProblem], str]] = {}
        if self._finite_strain is not None:
            richer["linear strain"] = {"residual": self._finite_strain}
            indicators["linear strain"] = describe_strain
        if _sliding_little(problem):
            richer["small sliding"] = {"sliding": "finite"}
            indicators["small sliding"] = describe_sliding
        for name, model in richer.items():
            errors = estimate(problem, self._variant(problem, name, model))
            yield Assumption(name, indicators[name](problem), errors)
        yield from self._rigid(problem)
        yield from self._without_friction(problem)
        if len(richer) > 1:
            everything = {key: value for model in richer.values() for key, value in model.items()}
            name = " and ".join(richer)
            yield Assumption(name, "", estimate(problem, self._variant(problem, name, everything)))

    def _variant(self, problem: ContactProblem, name: str, model: dict[str, Any]) -> ContactProblem:
        if name not in self._richer:
            self._richer[name] = problem.variant(**model)
        return self._richer[name]

    def _rigid(self, problem: ContactProblem) -> Iterator[Assumption]:
        """What obstacles stand for gives way as its mesh says, or by the rule of stiffness."""
        ratio = self._stiffness_ratio
        for obstacle in problem.tools.obstacles:
            if obstacle in self._tools:
                yield from_tool(problem, self._tools[obstacle])
            else:
                known = (
                    f"stiffness ratio {ratio:.2g}" if ratio is not None else "no stiffness_ratio"
                )
                error = np.nan if ratio is None else ratio
                yield Assumption(f"rigid {obstacle}", known, dict.fromkeys(QUANTITIES, error))

    def _without_friction(self, problem: ContactProblem) -> Iterator[Assumption]:
        """What friction could do: all sticks first, and slides where that asks for too much."""
        number = self._friction
        if number is not None and any(map(_is_frictionless, problem.contacts)):
            stick = self._variant(problem, "stick", {"law": partial(_instead, Stick())})
            rough = self._variant(problem, "friction", {"law": partial(_instead, Coulomb(number))})
            kept = problem.state()
            self._count_all_slip(problem)
            errors = estimate(problem, stick, rough)
            problem.restore(kept)
            demand = shear_demand(stick)
            known = f"stick asks for a friction of {demand:.2g}, there may be {number:.2g}"
            yield Assumption("frictionless", known, errors)

    def _count_all_slip(self, problem: ContactProblem) -> None:
        """Let slip count from where nodes came to touch, of all steps that the check has seen."""
        for contact in problem.contacts:
            if not isinstance(contact, Contact) or not _is_frictionless(contact):
                continue
            before = self._slips.get(contact, np.zeros(contact.slave.num_nodes))
            self._slips[contact] = np.where(contact.active, before + contact.slip, 0.0)
            partners = contact.partners
            contact.partners = replace(partners, start=partners.start - before)


@dataclass
class Snapshot:
    """A solution, to be compared with another one on the same mesh.

    Attributes:
        u: Owned displacement dofs.
        force: Total force on each slave, shape (pairs, 2) [stress length].
        peak: Largest pressure of each pair, shape (pairs,) [stress].
    """

    u: Array
    force: Array
    peak: Array

    @classmethod
    def of(cls, problem: ContactProblem) -> Snapshot:
        """The present state of a problem."""
        return cls(
            problem.bulk.u.x.array[: problem.bulk.num_owned].copy(),
            np.array([contact.total_force for contact in problem.contacts]),
            np.array([contact.pressure.max() for contact in problem.contacts]),
        )


def estimate(problem: ContactProblem, *richer: ContactProblem) -> dict[str, float]:
    """Relative errors of a solved problem by quantity; the state stays as it is (collective)."""
    state = problem.state()
    try:
        return correct(problem, *richer)
    finally:
        for model in richer:
            model.system.ksp.reset()
        problem.restore(state)


def correct(problem: ContactProblem, *richer: ContactProblem) -> dict[str, float]:
    """Go on from a solved problem by a step or a few of richer variants in turn (collective).

    Returns:
        Relative errors of the problem by quantity. What the richer model cannot even begin with is
        wrong altogether: inf.
    """
    cheap, last = Snapshot.of(problem), problem
    errors = dict.fromkeys(QUANTITIES, 0.0)
    try:
        for model in richer:
            model.adopt(last)
            errors = go_on(problem, cheap, model)
            last = model
    except MortarError:
        return dict.fromkeys(QUANTITIES, np.inf)
    return errors


def go_on(problem: ContactProblem, cheap: Snapshot, model: ContactProblem) -> dict[str, float]:
    """Take steps of a model until the next one would hardly change any error (collective).

    A step changes the solution by about the part of the residual that the last one left, times what
    the steps before have changed.
    """
    start = model.evaluate(start=True).residual or np.inf
    for _ in range(MOST_STEPS):
        part = model.advance().part
        left = model.evaluate(start=False).residual / start
        errors = differences(problem, cheap, Snapshot.of(model))
        settled = left * errors[ENERGY] <= max(SETTLED, 0.5 * min(errors.values()))
        if part == 1.0 and left <= LINEAR and settled:
            break
    return errors


def from_tool(problem: ContactProblem, tool: ElasticTool) -> Assumption:
    """What it is worth that an obstacle does not give way, and has no facets (collective)."""
    touching = touching_tool(problem, tool)
    give, flatness = tool.give(touching), tool.flatness(touching)
    by_mesh = Assumption(
        f"mesh of {tool.obstacle}",
        f"its facets are off by {largest(flatness):.2g}",
        estimate_wider(problem, touching, flatness),
    )
    return Assumption(
        f"rigid {tool.obstacle}",
        f"it would give way by {largest(give):.2g}",
        estimate_wider(problem, touching, give),
        by_mesh,
    )


def touching_tool(problem: ContactProblem, tool: ElasticTool) -> list[Contact]:
    """The contacts with the obstacle that a mesh is there of."""
    contacts = [contact for contact in problem.contacts if isinstance(contact, Contact)]
    return [contact for contact in contacts if contact.obstacle is tool.obstacle]


def estimate_wider(
    problem: ContactProblem, contacts: Sequence[Contact], lengths: Sequence[Array]
) -> dict[str, float]:
    """Relative errors by quantity if gaps were wider by lengths, (slave nodes,) (collective)."""
    kept = [contact.offset for contact in contacts]
    for contact, length in zip(contacts, lengths, strict=True):
        contact.offset = contact.offset - length
    errors = estimate(problem, problem)
    for contact, offset in zip(contacts, kept, strict=True):
        contact.offset = offset
    problem.restore(problem.state())
    return errors


def largest(lengths: Sequence[Array]) -> float:
    """The largest of all."""
    return max((float(np.abs(length).max(initial=0.0)) for length in lengths), default=0.0)


def cheaper_models(problem: ContactProblem) -> Iterator[tuple[str, ContactProblem]]:
    """Variants of a problem below its own model by what they assume, the cheapest first."""
    linear: dict[str, Any] = {}
    if not problem.bulk.is_linear:
        linear["residual"] = linearized(problem.bulk.residual, problem.bulk.u)
    contacts = [contact for contact in problem.contacts if isinstance(contact, Contact)]
    if len(_sliding_little(problem)) < len(contacts):
        names = "linear strain and small sliding" if linear else "small sliding"
        yield names, problem.variant(**linear, sliding="small")
    if linear:
        yield "linear strain", problem.variant(**linear)


def linearized(residual: Any, u: Any) -> Any:
    """A residual's form to first order in ``u``, about u = 0."""
    zero = fem.Function(u.function_space)
    at_rest = ufl.replace(residual, {u: zero})
    return at_rest + ufl.derivative(at_rest, zero, u)


def differences(problem: ContactProblem, one: Snapshot, other: Snapshot) -> dict[str, float]:
    """Relative differences of two solutions by quantity; energies by the tangent of ``problem``."""
    bulk = problem.bulk
    bulk.assemble_tangent()
    x, y = bulk.K.createVecs()

    def energy(u: Array) -> float:
        x.array[:] = u
        bulk.K.mult(x, y)
        return abs(x.dot(y))

    return {
        ENERGY: float(np.sqrt(_part(energy(one.u - other.u), energy(strained(problem, other.u))))),
        FORCE: _part(np.linalg.norm(one.force - other.force), np.linalg.norm(other.force)),
        PEAK: _part(np.abs(one.peak - other.peak).max(), np.abs(other.peak).max()),
    }


def strained(problem: ContactProblem, u: Array) -> Array:
    """A displacement less the rigid motion of each body that is closest to it (collective).

    A finite rotation would pass for strain in the energy of a tangent.

    Args:
        problem: Knows the bodies.
        u: Owned dofs.
    """
    space, rest = problem.bulk.space, u.copy()
    X = space.V.tabulate_dof_coordinates()[: space.num_nodes, :2]
    labels = problem.floating.labels[: space.num_nodes]
    x = X + u[space.owned_dofs]
    for label in range(problem.comm.allreduce(int(labels.max(initial=0)), MPI.MAX) + 1):
        mine = labels == label
        sums = np.concatenate([[mine.sum()], X[mine].sum(axis=0), x[mine].sum(axis=0)])
        count, *means = problem.comm.allreduce(sums)
        before, now = np.split(np.array(means) / max(count, 1), 2)
        dX, dx = X[mine] - before, x[mine] - now
        along, across = problem.comm.allreduce(
            np.array([(dX * dx).sum(), (dX[:, 0] * dx[:, 1] - dX[:, 1] * dx[:, 0]).sum()])
        )
        cosine, sine = np.array([along, across]) / (np.hypot(along, across) or 1.0)
        rest[space.owned_dofs[mine]] = dx - dX @ np.array([[cosine, sine], [-sine, cosine]])
    return rest


def _part(difference: Any, size: Any) -> float:
    """Difference over size; 0 where both vanish."""
    return float(difference / size) if size > 0.0 else float(np.inf if difference > 0.0 else 0.0)


def describe_strain(problem: ContactProblem) -> str:
    """Largest rotation and strain of all cells, in words (collective)."""
    rotation, strain = largest_strain(problem)
    return f"rotation {np.degrees(rotation):.2g}°, strain {100 * strain:.2g} %"


def largest_strain(problem: ContactProblem) -> tuple[float, float]:
    """Largest rotation [radian] and principal strain of F = R U of all cells' means."""
    F = problem.bulk.deformation_gradients().mean(axis=1)
    rotation = np.arctan2(F[:, 1, 0] - F[:, 0, 1], F[:, 0, 0] + F[:, 1, 1])
    stretches = np.linalg.svd(F, compute_uv=False)
    mine = np.array([np.abs(a).max(initial=0.0) for a in (rotation, stretches - 1.0)])
    problem.comm.Allreduce(MPI.IN_PLACE, mine, MPI.MAX)
    return float(mine[0]), float(mine[1])


def describe_sliding(problem: ContactProblem) -> str:
    """Largest slip and turn of the normals of all pairs that slide little, in words."""
    slip, turn = np.max([largest_slip(contact) for contact in _sliding_little(problem)], axis=0)
    return f"slip {slip:.2g} facets, normals turn by {np.degrees(turn):.2g}°"


def shear_demand(problem: ContactProblem) -> float:
    """Largest mean |z_tau| / z_n of all pairs whose law is to stick."""
    demands = [
        _part(np.abs(c.shear_force).sum(), float(np.abs(c.operators.weight * c.pressure).sum()))
        for c in problem.contacts
        if isinstance(c.pair, ContactPair) and isinstance(c.pair.law, Stick)
    ]
    return max(demands, default=0.0)


def _is_frictionless(contact: Any) -> bool:
    """Whether it is a contact without friction."""
    return isinstance(contact, Contact) and isinstance(contact.pair.law, Frictionless)


def _instead(rough: Law, law: Law) -> Law:
    """A law in the place of no friction."""
    return rough if isinstance(law, Frictionless) else law


def _sliding_little(problem: ContactProblem) -> list[Contact]:
    """The contacts that keep the operators of the undeformed mesh."""
    contacts = [contact for contact in problem.contacts if isinstance(contact, Contact)]
    return [contact for contact in contacts if contact.pair.sliding == "small"]


def largest_slip(contact: Contact) -> tuple[float, float]:
    """Largest slip of active nodes over their length, and turn of their normals [radian]."""
    o, on = contact.operators, contact.active & contact.covered
    jump = o.jump(o.x - contact.slave.X, o.m - contact.master.X)
    slip = np.einsum("jc,jc->j", o.tau, jump)[on] / (o.weight * contact.nodal_lengths)[on]
    before, now = (
        evaluate_normals(contact.slave, x, contact.pair.normals)[0] for x in (contact.slave.X, o.x)
    )
    cosine = np.einsum("jc,jc->j", before, now)[on]
    turn = np.arccos(np.clip(cosine, -1.0, 1.0))
    return float(np.abs(slip).max(initial=0.0)), float(turn.max(initial=0.0))
