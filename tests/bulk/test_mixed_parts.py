# SPDX-License-Identifier: MIT
"""Files, states and rejected components of mixed functions."""

from functools import partial

from mpi4py import MPI

import meshio
import numpy as np
import pytest
from scenes import read
from test_mixed import GENERIC, TAYLOR_HOOD, blocks, comm, neo_hookean
from test_results import steps

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.utils import compat
from meshes import two_blocks


def fill(w):
    """Set different values of displacement and pressure at all nodes."""
    w.sub(0).interpolate(lambda X: np.stack([0.1 * X[0] ** 2, X[0] * X[1] - 0.2 * X[1] ** 2]))
    w.sub(1).interpolate(lambda X: X[0] + 10 * X[1])


def test_state_is_read_on_any_number_of_ranks(shared_path):
    file = str(shared_path / "state.npz")
    residual = partial(neo_hookean, nu=0.5)
    together, alone = (blocks(residual, comm=c) for c in (comm, MPI.COMM_SELF))
    fill(together.u)
    fm.save_state(together.problem, file)
    exact = fem.Function(alone.u.function_space)
    fill(exact)
    fm.load_state(alone.problem, file)
    assert np.abs(alone.u.x.array - exact.x.array).max() < 1e-13


def test_files_contain_the_displacement_and_the_pressure(shared_path):
    scene = blocks(partial(neo_hookean, nu=0.5), cell="triangle")
    fill(scene.u)
    scene.u.x.scatter_forward()
    pressure = ufl.split(scene.u)[1]
    with fm.ResultsWriter(shared_path / "series", scene.problem, {"p": pressure}) as writer:
        writer.write(1.0)
    fm.plot(scene.problem, shared_path / "picture", stress=pressure)
    for file in steps(shared_path / "series.pvd")[1.0]:
        grid = meshio.read(file)
        x, y, _ = grid.points.T
        right = np.stack([0.1 * x**2, x * y - 0.2 * y**2], axis=1)
        assert np.abs(grid.point_data["displacement"][:, :2] - right).max() < 1e-14
        corners = grid.points[grid.cells[0].data[:, :3]].mean(axis=1)
        found = grid.cell_data["p"][0]
        assert np.abs(found.ravel() - corners[:, 0] - 10 * corners[:, 1]).max() < 1e-12
    assert (shared_path / "picture.png").exists()


def test_pressure_that_is_not_finite_is_refused():
    scene = blocks(partial(neo_hookean, nu=0.5))
    _, dofs = scene.u.function_space.sub(1).collapse()
    scene.u.x.array[np.ravel(dofs)] = np.nan
    with pytest.raises(fm.MortarError, match="not finite"):
        scene.problem.solve()


def test_missing_sub_space_is_refused():
    data = read(two_blocks.build, **GENERIC)
    w = fem.Function(fm.mixed_space(data.mesh, *TAYLOR_HOOD))
    with pytest.raises(ValueError, match="sub-spaces 0 to 1"):
        fm.ContactProblem(neo_hookean(w, 0.5), w, [], displacement=2, petsc_options_prefix="test_")


def test_scalar_sub_space_as_displacement_is_refused():
    data = read(two_blocks.build, **GENERIC)
    w = fem.Function(fm.mixed_space(data.mesh, *TAYLOR_HOOD))
    with pytest.raises(fm.MortarError, match="plane vectors"):
        fm.ContactProblem(neo_hookean(w, 0.5), w, [], displacement=1, petsc_options_prefix="test_")


def test_function_prescribes_a_sub_space():
    data = read(two_blocks.build, **GENERIC)
    W = fm.mixed_space(data.mesh, *TAYLOR_HOOD)
    value = fem.Function(W.sub(0).collapse()[0])
    value.x.array[:] = 3.0
    bc = fm.dirichlet(W.sub(0), data, "lower/bottom", value)
    values = fem.Function(W).x.array
    compat.set_prescribed(values, [bc])
    _, pressures = W.sub(1).collapse()
    assert comm.allreduce(int((values == 3.0).sum())) > 0
    assert not values[np.ravel(pressures)].any()


@pytest.mark.each
@pytest.mark.parametrize("kind", ["constant", "other degree", "view"])
def test_values_that_do_not_fit_the_sub_space_are_refused(kind):
    data = read(two_blocks.build, **GENERIC)
    W = fm.mixed_space(data.mesh, *TAYLOR_HOOD)
    value = {
        "constant": lambda: fem.Constant(data.mesh, (0.0, 0.0)),
        "other degree": lambda: fem.Function(fm.vector_space(data.mesh, 1)),
        "view": lambda: fem.Function(W).sub(0),
    }[kind]()
    with pytest.raises(fm.MeshError, match="collapsed sub-space"):
        fm.dirichlet(W.sub(0), data, "lower/bottom", value)
