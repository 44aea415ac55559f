# SPDX-License-Identifier: MIT
"""Choice between all equations and those reduced to the contact dofs of a linear bulk."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk.bodies import find_floating_bodies
from fenics_mortar.contact.pair import ContactPair
from fenics_mortar.contact.tied import Tie
from fenics_mortar.equations.general import ContactEquations
from fenics_mortar.equations.reduced import ReducedEquations, SmallSlidingEquations
from fenics_mortar.equations.reduced_tangent import ReducedTangent
from fenics_mortar.la.options import COMPLIANCE, costs_of
from fenics_mortar.la.sparse import is_symmetric
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.errors import MortarError


class LinearBulk:
    """Choice, before each solve, between all dofs and the contact dofs alone.

    Problems with driven obstacles, or with a body that only ties hold, whose K is singular, are
    solved on all dofs.

    Args:
        general: The general equations.
        requested: Whether to reduce. ``None``: yes with small sliding; otherwise if the residual is
            linear and the predicted cost of the compliance is below the past and future cost of
            factorizations, with no more memory, see ``la.options``. In space that of the dense
            systems counts as well, which the active nodes determine: all nodes, until they are
            known.
        prefix: Prefix of PETSc's options.

    Attributes:
        choice: The last choice and its reason, as text; "" if the bulk is not linear.
    """

    def __init__(self, general: ContactEquations, requested: bool | None, prefix: str) -> None:
        self._general, self._requested, self._prefix = general, requested, f"{prefix}{COMPLIANCE}"
        if requested and general.newton.damped:
            raise ValueError(
                "linear_bulk=True takes full steps: expected no line_search and max_motion, or "
                "linear_bulk=False"
            )
        linear = general.bulk.is_linear if requested is None else requested
        self._given = self._possible = linear and bool(general.contacts)
        self._costs = costs_of(general.bulk.space.dim)
        self._data: list[Array] = []
        self._equations: ReducedEquations | None = None
        self._num_iterations = 0
        self.choice = ""

    def choose(self) -> tuple[ReducedEquations | None, list[str]]:
        """The reduced equations, or ``None`` for all dofs; remarks (collective)."""
        if not self._possible:
            return None, []
        if self._general.newton.damped or self._general.motions.any_driven:
            damped = self._general.newton.damped
            why = "steps are damped" if damped else "motions are driven by forces"
            self.choice = f"linear bulk factored in every iteration: {why}"
            return None, []
        if self._data_changed():
            self._equations, self._num_iterations = None, 0
        if self._equations is not None and not (self._asked or self._iterates_faster()):
            self._equations = None  # many nodes have become active
        if self._equations is None and self._pays():
            obstacle = self._obstacle()
            if obstacle:
                self._possible = False
                self.choice = f"linear bulk factored in every iteration: {obstacle}"
                return None, [f"linear bulk, but {obstacle}: K is factored in every iteration"]
            equations = SmallSlidingEquations if self._slides_little else ReducedEquations
            try:
                with clock("solve"):
                    self._equations = equations(self._general, self._prefix)
            except MortarError:  # singular: the solve on all dofs locates the cause
                if self._requested:
                    raise
                self.choice = "linear bulk factored in every iteration: its stiffness is singular"
                return None, []
            unused = self._general.system.solver.describe_unused(reduced=True)
            return self._equations, [unused]
        return self._equations, []

    def tangent(self) -> ReducedTangent | None:
        """Solves with the tangent by the present factors (collective).

        ``None`` if there are none, if constants or functions of the tangent have changed since, or
        if the residual is not recognized as linear.
        """
        if not self._general.bulk.is_linear:
            return None
        before = self._data
        changed = self._equations is None or self._data_changed()
        self._data = before
        return None if changed or self._equations is None else self._equations.tangent()

    def count(self, num_iterations: int) -> None:
        """Count iterations on all dofs (local)."""
        self._num_iterations += num_iterations

    def reset(self) -> None:
        """Discard the factors of the bulk (local)."""
        self._equations, self._data, self._num_iterations = None, [], 0
        self._possible = self._given

    @property
    def _slides_little(self) -> bool:
        return all(
            isinstance(pair, ContactPair)
            and pair.sliding == "small"
            and not (pair.law.has_friction or pair.law.has_adhesion or pair.law.has_closing_gap)
            for pair in (contact.pair for contact in self._general.contacts)
        )

    @property
    def _asked(self) -> bool:
        """Whether to reduce in any case."""
        return bool(self._requested) or self._slides_little

    @property
    def _dense_size(self) -> int:
        """Size of the dense systems: active nodes, about as many of the master, multipliers.

        All nodes with multipliers before the first solve on all dofs.
        """
        contacts = self._general.contacts
        nodes = [c.active if self._num_iterations else c.multiplier_nodes for c in contacts]
        sizes = [int(n.sum()) * c.slave.dim for n, c in zip(nodes, contacts, strict=True)]
        return 3 * sum(sizes)

    def _iterates_faster(self) -> bool:
        """Whether an iteration with the dense system is predicted to be the faster one (local)."""
        unknowns = self._general.bulk.r.getSize()
        return self._costs.dense_solves(self._dense_size, 1) <= self._costs.factors(unknowns, 1)

    def _pays(self) -> bool:
        """Whether to factorize once; sets ``choice`` (local)."""
        costs, unknowns = self._costs, self._general.bulk.r.getSize()
        dofs = sum(c.slave.dofs.size + c.master.dofs.size for c in self._general.contacts)
        iterations = self._num_iterations + costs.expected
        compliance = costs.compliance(unknowns, dofs)
        compliance += costs.dense_solves(self._dense_size, costs.expected)
        factors, fits = costs.factors(unknowns, iterations), costs.fits(unknowns, dofs)
        cheaper = compliance < factors and self._iterates_faster()
        pays = self._asked or (fits and cheaper)
        if pays:
            self.choice = f"linear bulk factored once, Newton's method on {dofs} contact dofs"
        else:
            self.choice = f"linear bulk factored in every iteration: {dofs} contact dofs are many"
        self.choice += f" of {unknowns} unknowns"
        if self._requested:
            self.choice += " (linear_bulk=True)"
        elif self._slides_little:
            self.choice += " (small sliding)"
        else:
            memory = "" if fits else ", and its matrices would need more memory than factors"
            self.choice += (
                f" (predicted: once {compliance:.2g} s, {iterations} factorizations "
                f"{factors:.2g} s{memory})"
            )
        return pays

    def _obstacle(self) -> str:
        if self._general.motions.remote or self._general.motions.spread:
            return "there are remote loads"
        if any(contact.fluxes for contact in self._general.contacts):
            return "a scalar field flows across contact"
        floating = self._general.floating
        if floating.bodies:
            names = " and ".join(sorted(floating.name_of(body.label) for body in floating.bodies))
            return f"Dirichlet conditions leave {names} free to move"
        self._general.bulk.assemble_tangent()
        if any(isinstance(contact, Tie) for contact in self._general.contacts):
            parts = floating.parts, floating.num_parts
            if find_floating_bodies(self._general.bulk, *parts):
                return "ties alone hold a body"
        return "" if is_symmetric(self._general.bulk.K) else "its tangent is not symmetric"

    def _data_changed(self) -> bool:
        """Whether constants or functions of the tangent have changed since the last call."""
        before, self._data = self._data, self._general.bulk.tangent_data()
        same = len(before) == len(self._data) and all(map(np.array_equal, before, self._data))
        return self._general.comm.allreduce(not same, MPI.LOR)
