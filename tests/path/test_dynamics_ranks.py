# SPDX-License-Identifier: MIT
"""Motions and laws with memory that differ on one rank raise on all, without a hang."""

import pytest
from one_rank import several_ranks
from refusal import COMM, refused
from small_scenes import small_blocks

from dolfinx import fem

import fenics_mortar as fm
from demos.studies.dynamics.scenes import RHO, free_block
from fenics_mortar import sensitivity
from fenics_mortar.laws import Worn

pytestmark = several_ranks


def test_arguments_that_differ_between_ranks_are_refused():
    made = free_block(cells=3)
    given = {"velocity": made.velocity}
    with refused(fm.MortarError, "density is 1.0 on rank 0"):
        fm.Dynamics(made.problem, 1.0 + COMM.rank, **given)
    with refused(fm.MortarError, "a constant of density is 1 on rank 0"):
        fm.Dynamics(made.problem, fem.Constant(made.data.mesh, 1.0 + COMM.rank), **given)
    with refused(fm.MortarError, "energy is False on rank 0"):
        fm.Dynamics(made.problem, RHO, energy=made.energy if COMM.rank else None, **given)
    motion = fm.Dynamics(made.problem, RHO, **given)
    with pytest.raises((fm.MortarError, ValueError), match="dt=-0.01"):
        motion.step(-0.01 if COMM.rank == COMM.size - 1 else 0.01)
    motion.step(0.01)


def test_memory_that_differs_between_ranks_is_refused():
    class Differs(Worn):
        def remember(self, node, branch):
            return {"depth": super().remember(node, branch)["depth"] + COMM.rank}

    scene = small_blocks(pair={"law": Differs(0.3, 0.01)})
    scene.loads["push"].value[:] = (0.0, -0.02)
    with refused(fm.MortarError, "depth of Differs.* on rank 0 and 1"):
        scene.problem.solve()


def test_controls_that_differ_between_ranks_are_refused():
    scene = small_blocks(pair={"law": fm.Coulomb(0.3)})
    scene.loads["push"].value[:] = (0.0, -0.02)
    scene.problem.solve()
    controls = [sensitivity.Interference(0), sensitivity.LawParameter(0, "mu")]
    with refused(fm.MortarError, "gradient: controls is"):
        force = sensitivity.TotalForce(0, (0.0, 1.0))
        fm.gradient(force, controls[: 1 + (COMM.rank > 0)], scene.problem)
