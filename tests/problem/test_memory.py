# SPDX-License-Identifier: MIT
"""Memory of long runs is that of short ones, for all linear solvers."""

import ctypes
import gc
import resource
import weakref
from pathlib import Path

from mpi4py import MPI

import pytest
from scenes import linear_elastic, neo_hookean, pressed_blocks

import fenics_mortar as fm
from fenics_mortar.utils.compat import free_garbage_of_earlier

comm = MPI.COMM_WORLD
MESH = {"n_upper": 20, "n_lower": 23, "layers_upper": 20, "layers_lower": 20}
WARM, MEASURED = 40, 80
# Allowed growth per iteration [bytes per dof]: a leaked vector of all dofs takes 8.
ALLOWED = 3.0


def memory():
    """Bytes in use by this process; after free pages of the heap are returned."""
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def iterate(scene, least):
    """Solve for varying loads until a number of iterations is reached."""
    done = 0
    while done < least:
        for depth in (0.02, 0.03, 0.04):
            scene.loads["push"].value[1] = -depth
            done += scene.problem.solve().num_iterations
    return done


@pytest.mark.once
@pytest.mark.serial
@pytest.mark.parametrize(
    "material, options",
    [
        (neo_hookean, {"algorithm": "condensed"}),
        (neo_hookean, {"algorithm": "saddle"}),
        (linear_elastic, {"linear_bulk": True}),
    ],
)
def test_iterations_do_not_leak_memory(material, options):
    chosen = {"newton": fm.NewtonOptions(), **options}
    scene = pressed_blocks(material=material, problem=chosen, **MESH)
    iterate(scene, WARM)
    before = memory()
    done = iterate(scene, MEASURED)
    grown = comm.allreduce(memory() - before)
    assert grown < ALLOWED * scene.problem.equations.bulk.r.getSize() * done


@pytest.mark.once
@pytest.mark.serial
def test_results_do_not_leak_memory():
    """Estimates, matrices and the check of the tangent create vectors and matrices."""
    scene = pressed_blocks(n_upper=20, n_lower=23)
    scene.loads["push"].value[1] = -0.02
    problem = scene.problem
    problem.solve()
    size = problem.equations.bulk.r.getSize()

    def evaluate(times):
        for _ in range(times):
            problem.estimate()
            problem.matrices.D(0), problem.matrices.M(0), problem.tangent, problem.matrices.gap()

    evaluate(5)
    before = memory()
    evaluate(40)
    assert comm.allreduce(memory() - before) < 40 * 8 * size


@pytest.mark.each
@pytest.mark.serial
@pytest.mark.parametrize("options", [{}, {"solver": "iterative"}, {"algorithm": "saddle"}])
def test_mesh_of_a_problem_is_freed(options):
    """MPICH has 2048 communicators; each mesh and its problem have nine."""

    def mesh_of_problem():
        scene = pressed_blocks(n_upper=3, n_lower=4, problem=options)
        scene.loads["push"].value[1] = -0.02
        scene.problem.solve()
        return weakref.ref(scene.data.mesh)

    mesh = mesh_of_problem()
    gc.collect()  # a solver of PETSc, which holds its preconditioner until it is destroyed
    free_garbage_of_earlier(comm)  # as the next problem does
    gc.collect()
    assert mesh() is None
