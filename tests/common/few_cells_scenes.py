# SPDX-License-Identifier: MIT
"""Every public function and method, called on bodies of few cells.

Each scene is a function of the number of cells, their kind and the degree, and a folder for files;
it yields names and values that do not depend on the number of ranks.
"""

from __future__ import annotations

import history_scenes
import meshio
import numpy as np
import revolved
import scenes
import space_scenes
from few_cells import Blocks, arrays, bcs_of
from few_cells import mesh as small_mesh
from scenes import TIGHT, internal, linear_elastic, neo_hookean, nodal

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import sensitivity
from fenics_mortar.laws import Cohesive, SoftLayer, Worn
from meshes import mapped_grids

MU = 0.3
CUBE = {"counts": (1, 1, 1), "size": (1.0, 1.0, 1.0), "jiggle": 0.0}


def results(problem, report=None):
    """Displacements, all fields of the pairs, and verdicts."""
    yield "u", nodal(problem)
    for number, view in enumerate(problem.contacts):
        order = np.lexsort(np.round(view.positions, 6).T)
        for name in dir(view):
            value = getattr(view, name)
            if isinstance(value, np.ndarray) and len(value) == len(order) and name != "nodes":
                value = value[order]
            if isinstance(value, (np.ndarray, float)) and name != "nodes":
                yield f"{name} of pair {number}", value
        yield f"name of pair {number}", repr(view).split(":")[0]
    certificate = problem.certificate() if report is None else report.certificate
    yield "inverted", certificate.inverted
    yield "verdict", " ".join(certificate.violations())
    yield "number of remarks", len(certificate.remarks())
    for pair in certificate.pairs:
        yield "violations of a pair", " ".join(pair.violations())
        yield "remarks on a pair", len(pair.remarks())
        yield "verdicts on a pair", " ".join(finding.verdict for finding in pair.findings)
        assert pair["force"].value < 1e-9
    yield "balance is small", certificate.balance < 1e-9
    assert "| imbalance of all forces on a body |" in str(certificate)


def pressed(kind, folder):
    """A solve and its record."""
    blocks = Blocks(*kind, law=fm.Coulomb(MU))
    report = blocks.press()
    yield "iterations", report.num_iterations
    yield "residuals", np.array(report.residuals)[:2]
    assert sum(report.total_seconds().values()) > 0.0 and "iteration" in str(report.table())
    assert str(report) and "solved" not in repr(blocks.problem.state())
    yield from results(blocks.problem, report)
    yield from results(blocks.problem)
    data, u = blocks.data, blocks.u
    yield "values at nodes", data.nodal_values(u, np.arange(4))
    here = data.node_dofs(u.function_space, np.arange(4))
    yield "dofs on any rank", data.mesh.comm.allreduce((here >= 0).astype(int)) > 0
    assert data.body_tag("lower") == 1 and data.boundary_tags(["lower/top"]) == [2]
    assert data.boundary_tag("lower/fixed") == 1
    assert data.mesh.comm.allreduce(data.boundary_facets("lower/top").size) >= 1
    view = blocks.problem.contacts[0]
    view.offset, view.c_n = 0.001 + view.offset, 2.0 * view.c_n
    blocks.problem.time = 0.5
    yield "time", blocks.problem.time
    blocks.problem.accept()
    yield from results(blocks.problem, blocks.press())


def measured(kind, folder):
    """Forces, matrices, states and estimates of a solved problem."""
    blocks = Blocks(*kind, law=fm.Coulomb(MU))
    problem, comm = blocks.problem, blocks.data.mesh.comm
    blocks.press()
    *forces, on_obstacles = problem.forces()
    yield "forces", np.sqrt([comm.allreduce(float(f @ f)) for f in forces])
    yield "no obstacles", on_obstacles
    for name in ("lower/fixed", "upper/moved"):
        force, moment, about = problem.reaction(name, about=(0.2, 0.1))
        yield f"reaction of {name}", np.array([*force, moment, *about])
    estimate = problem.estimate()
    yield "error", np.array([estimate.total, estimate.relative, estimate.size])
    yield "parts of the error", np.array(list(estimate.parts.values()))
    yield "marked cells", comm.allreduce(len(estimate.mark(0.9)))
    assert "estimated error" in str(estimate)
    check = problem.check_tangent(print_table=False)
    slopes = {name: slope for name, slope in check.slopes.items() if np.isfinite(slope)}
    yield "slopes", all(abs(slope - 2.0) < 0.1 for slope in slopes.values()) or str(check.slopes)
    assert "slope" in check.table() and str(check) == check.table()
    matrices = problem.matrices
    for name in ("D", "M"):
        yield name, getattr(matrices, name)().norm()
    yield "tangent", problem.tangent.norm()
    rhs = fm.LinearVector(*zeros(problem))
    rhs.z[0][:] = 1.0
    for transpose in (False, True):
        solution = problem.linear_solve(rhs, transpose=transpose)
        yield "linear solve", solution.dot(solution, comm)
    state = problem.state()
    blocks.press(0.01, -0.03)
    problem.restore(state)
    yield "restored", nodal(problem)
    other = problem.variant(sliding="small")
    other.solve()
    yield "small sliding", nodal(other)
    problem.restore(state.counting_slip_from(state).towards(state, 0.5).with_settings_of(state))
    yield "halfway", nodal(problem)


def zeros(problem):
    """A vector of the unknowns, zero."""
    e = problem.equations
    return np.zeros(e.bulk.num_owned), [0.0 * c.z for c in e.contacts], 0.0 * e.motions.places


def written(kind, folder):
    """Files, pictures and tables."""
    blocks = Blocks(*kind, law=fm.Coulomb(MU))
    problem, comm = blocks.problem, blocks.data.mesh.comm
    energy = ufl.inner(ufl.grad(blocks.u), ufl.grad(blocks.u))
    writer = fm.ResultsWriter(folder / "run", problem, fields={"energy": energy, "v": blocks.u})
    for step in range(2):
        blocks.press(0.0, -0.01 * step)
        writer.write(float(step))
    fm.plot(problem, folder / "picture", stress=energy)
    fm.plot(problem, folder / "picture")
    yield "rows of the table", len(str(fm.contact_table(problem)).splitlines())
    fm.save_state(problem, folder / "state")
    before = nodal(problem)
    blocks.press(0.0, -0.02)
    fm.load_state(problem, folder / "state")
    yield "loaded", np.abs(nodal(problem) - before).max()
    comm.barrier()
    yield "files", sorted(path.suffix for path in folder.iterdir())


def paths(kind, folder):
    """Load paths and their derivatives."""
    blocks = Blocks(*kind, law=fm.Coulomb(MU))
    problem = blocks.problem
    path = sensitivity.RecordedPath(problem)

    def load(time):
        blocks.push.value[:] = 0.01 * time, -0.03 * time

    report = fm.follow_path(problem, load, fm.SteppingOptions(0.5), on_step=path.record)
    yield "cuts", report.num_cuts
    yield "friction work", report.friction_work
    assert report.num_iterations and report.table() and str(report)
    yield from results(problem)
    mu, force = sensitivity.LawParameter(0, "mu"), quantities()["force"]
    gradient = fm.gradient(list(quantities().values()), [mu, blocks.push], path)
    yield "quantities", gradient.values
    yield "derivatives", np.array([gradient[mu], *gradient[blocks.push]])
    assert str(gradient)
    controls = [sensitivity.Offset(0), sensitivity.Interference(0)]
    controls += [sensitivity.NodalPositions()] * (kind[2] == 1)
    yield from both_ways(path, force, [mu, *controls])
    yield "kinks", len(gradient.undecided)
    assert str(gradient.nearest_change)
    squares = sensitivity.least_squares(np.ones((2, 1)), 2.0)
    for over in (sensitivity.total, sensitivity.last, squares):
        along = sensitivity.tangent_linear(force, [mu], [1.0], path, over_steps=over)
        yield "directional derivative", along.derivative
        assert str(along)
    form = ufl.inner(blocks.u, blocks.u) * ufl.dx(metadata={"quadrature_degree": 4})
    yield "form", fm.gradient(form, blocks.push, path)[blocks.push]
    start = path.start

    def run():
        problem.restore(start)
        blocks.press()
        return problem

    simulation = sensitivity.Simulation(problem, run, force, [mu])
    yield "simulation", simulation(0.3)
    yield "pullback", simulation.pullback([[1.0]], 0.3)[0]


def both_ways(path, quantity, controls):
    """Derivatives with respect to controls by the adjoint method, and in one direction each."""
    problem = path if isinstance(path, fm.ContactProblem) else path.problem
    comm = problem.equations.comm
    gradient = fm.gradient(quantity, controls, path)
    for control in controls:
        values = control.get(problem)
        mine = gradient[control]
        square = float((np.asarray(mine) ** 2).sum())
        everywhere = getattr(control, "is_distributed", False)
        yield control.name, comm.allreduce(square) if everywhere else square
        # Positions are stretched: a translation of all nodes changes nothing.
        direction = 1.0 + np.asarray(values) if everywhere else np.ones(values.shape)
        along = sensitivity.tangent_linear(quantity, control, direction, path)
        yield f"{control.name} in one direction", along.derivative
        if not everywhere:
            control.set(problem, values)


def quantities():
    """Quantities of the first pair by name."""
    squares = sensitivity.PressureFunctional(0, lambda p: p**2, lambda p: 2.0 * p)
    force = sensitivity.TotalForce(0, (0.3, 1.0))
    return {
        "force": force,
        "moment": sensitivity.Moment(0, (0.2, 0.1)),
        "pressure": sensitivity.PressureIntegral(0),
        "squares": squares,
        "peak": sensitivity.PeakPressure(0, 6.0),
        "gap": sensitivity.MeanGap(0, np.array([0, 1])),
        "work": sensitivity.FrictionWork(0),
        "length": sensitivity.ContactLength(0),
        "effective length": sensitivity.effective_length(0),
        "function": (2.0 * force - 1.3) ** 2 + sensitivity.FrictionWork(0),
    }


# Options of a problem, and of its pair
OPTIONS = {
    "saddle": ({"algorithm": "saddle"}, {}),
    "condensed": ({"algorithm": "condensed"}, {}),
    "standard basis": ({}, {"basis": "standard"}),
    "other codes": ({}, {"discretization": "other_codes"}),
    "Petrov-Galerkin": ({}, {"discretization": "petrov_galerkin"}),
    "slip by operators": ({}, {"slip": "operators"}),
    "iterative": ({"solver": "iterative"}, {}),
    "direct": ({"solver": "direct"}, {}),
    "frozen": ({"linearization": "frozen", "newton": fm.NewtonOptions(max_iterations=60)}, {}),
    "damped": ({"newton": fm.NewtonOptions(line_search=True)}, {}),
    "linear bulk": ({"material": linear_elastic, "linear_bulk": True}, {}),
    "linear bulk on all dofs": ({"material": linear_elastic, "linear_bulk": False}, {}),
    "small sliding": ({}, {"sliding": "small"}),
    "small sliding, linear": ({"material": linear_elastic}, {"sliding": "small"}),
    "no gap": ({}, {"initial_gap": 0.0}),
    "thickness": ({"thickness": 2.0}, {}),
}


def options(kind, folder):
    """Systems, solvers and discretizations: one half of them if the number of cells is even."""
    data = small_mesh(*kind)
    for name, (problem, pair) in list(OPTIONS.items())[kind[0] % 2 :: 2]:
        pairs = [fm.ContactPair(data, "upper/bottom", "lower/top", **scenes.pair_options(pair))]
        blocks = Blocks(*kind, data=data, pairs=pairs, **problem)
        report = blocks.press(0.0, -0.02)
        for what, value in results(blocks.problem, report):
            yield f"{name}: {what}", value


OBSTACLES = {
    "plane": lambda: fm.Plane((0.5, 2.0), (0.05, -1.0)),
    "circle": lambda: fm.Circle((0.5, 22.0), 20.0),
    "spline": lambda: fm.Spline([(-1.0, 2.2), (0.5, 2.0), (2.0, 2.1)]),
    "polygon": lambda: fm.Polygon([(-3.0, 2.0), (3.0, 2.0), (0.0, 5.0)], 0.1),
    "function": lambda: fm.SignedDistance(sphere),
}


def sphere(x):
    """Distance from a circle, its gradient and its second derivatives."""
    return fm.Circle((0.5, 22.0), 20.0).local(x)


def obstacles(kind, folder):
    """Rigid obstacles on the lower body, moved and pushed: one half of them, see ``options``."""
    force = sensitivity.TotalForce(0, (0.3, 1.0))
    for name, make in list(OBSTACLES.items())[kind[0] % 2 :: 2]:
        data, obstacle = small_mesh(*kind), make()
        obstacle.move(y=-1.02)
        pairs = [fm.ContactPair(data, "lower/top", obstacle)]
        blocks = Blocks(*kind, data=data, pairs=pairs)
        report = blocks.press(0.0, 2.0)
        for what, value in results(blocks.problem, report):
            yield f"{name}: {what}", value
        yield f"{name}: reaction", obstacle.reaction
        yield f"{name}: evaluated", obstacle.evaluate(np.array([(0.4, 0.9)]))[0]
        controls = [sensitivity.ObstacleShape(obstacle, n) for n in obstacle.shape()]
        place = sensitivity.ObstaclePlace(obstacle)
        for what, value in both_ways(blocks.problem, force, [place, *controls]):
            yield f"{name}: {what}", value
        obstacle.push(y=-1.1 * obstacle.reaction[1])
        blocks.problem.solve()
        yield f"{name}: pushed to", obstacle.place
        for what, value in both_ways(blocks.problem, force, [sensitivity.ObstacleLoad(obstacle)]):
            yield f"{name}: {what}", value
        yield f"{name}: forces", blocks.problem.forces()[2]
        assert blocks.problem.obstacles == [obstacle] and str(obstacle) == obstacle.name


ALONG = (0.0, 1.0, 0.0)
CORNERS = [(3.0, -0.02), (-3.0, -0.02), (0.0, -5.0)]  # the second axis is -z
# Solids that touch the top of the unit cube.
IN_SPACE = {
    "plane": lambda: fm.Plane((0.5, 0.5, 1.0), (0.05, 0.0, -1.0)),
    "sphere": lambda: fm.Sphere((0.5, 0.5, 21.0), 20.0),
    "cylinder": lambda: fm.Cylinder((0.5, 0.0, 21.0), ALONG, 20.0),
    "cone": lambda: fm.Cone((0.5, 0.5, 1.0), (0.0, 0.0, 1.0), 1.4),
    "torus": lambda: fm.Torus((0.5, 0.5, 21.0), ALONG, 15.0, 5.0),
    "extruded": lambda: fm.Extruded(
        fm.Polygon(CORNERS, 0.01), axis=ALONG, first=(1.0, 0.0, 0.0), origin=(0.0, 0.0, 1.0)
    ),
    "revolved": lambda: fm.Revolved(
        fm.Circle((0.5, 20.0), 20.0), axis=(0.0, 0.0, 1.0), origin=(0.5, 0.5, 1.0)
    ),
}


def in_space(kind, folder):
    """Obstacles in space, pressed on one hexahedron or six tetrahedra: one half of them."""
    even = kind[0] % 2 == 0
    for name, make in list(IN_SPACE.items())[kind[0] % 2 :: 2]:
        scene = space_scenes.solid("hexahedron" if even else "tetrahedron", **CUBE)
        space_scenes.held(scene)
        obstacle = make()
        obstacle.move(x=0.01, y=0.01, z=-0.03, angle=(0.0, 0.0, 0.1))
        pair = fm.ContactPair(scene.data, "block/top", obstacle, law=fm.Coulomb(MU))
        scene.set_up([pair], solver="iterative")
        report = scene.problem.solve()
        for what, value in results(scene.problem, report):
            yield f"{name}: {what}", value
        yield f"{name}: error", scene.problem.estimate().total
        yield f"{name}: reaction", obstacle.reaction
        yield f"{name}: evaluated", obstacle.evaluate(np.array([(0.4, 0.3, 0.9)]))[0]
        obstacle.push(z=-1.1 * obstacle.reaction[2])
        scene.problem.solve(accept_violations=True)
        yield f"{name}: pushed to", obstacle.place
    scene = space_scenes.solid("hexahedron" if even else "tetrahedron", **CUBE)
    grip = fm.RigidBoundary(scene.data, "block/bottom", pivot=(0.5, 0.5, -0.5))
    pull = fm.SpreadLoad(scene.data, "block/top", pivot=(0.5, 0.5, 1.5))
    scene.set_up(remote=[grip, pull])
    grip.move(x=0.1, angle=(0.1, -0.2, 0.3))
    pull.push(x=0.1, z=-0.1, moment=(0.02, 0.01, -0.03))
    scene.problem.solve()
    yield "at points", [*grip.reaction, *pull.place]


def section(kind, folder):
    """A square of one cell or two triangles, a section of a cube; and models of the cube."""
    even = kind[0] % 2 == 0
    square = mapped_grids.Grid("block", mapped_grids.block(1, 1, width=1.0, height=1.0))
    cell = "quadrilateral" if even else "triangle"
    data = fm.mesh_from_arrays(**mapped_grids.arrays([square], cell=cell))
    scene = space_scenes.solid(
        "hexahedron" if even else "tetrahedron", energy=fm.energies.linear_elastic, **CUBE
    )
    space_scenes.held(scene)
    floor = fm.Plane((0.5, 0.5, 1.0), (0.0, 0.0, -1.0))
    material = fm.energies.lame(space_scenes.YOUNG, space_scenes.POISSON)
    richer = ufl.derivative(fm.energies.neo_hookean(scene.u, *material) * ufl.dx(degree=4), scene.u)
    body = space_scenes.solid("hexahedron" if even else "tetrahedron", **CUBE)
    space_scenes.held(body)
    elastic = fm.ElasticObstacle(floor, body.residual, body.u, body.data, "block/top", bcs=body.bcs)
    check = fm.ModelCheck(finite_strain=richer, friction=0.2, elastic_obstacles=[elastic])
    pair = fm.ContactPair(scene.data, "block/top", floor, sliding="small")
    scene.set_up([pair], model_check=check)
    frame = {"axis": (0.0, -1.0, 0.0), "first": (1.0, 0.0, 0.0)}
    in_space = fm.InSpace(scene.problem, **frame)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    line = fm.Plane((0.5, 1.0), (0.0, -1.0))
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, space_scenes.YOUNG, space_scenes.POISSON)), u,
        [fm.ContactPair(data, "block/top", line)],
        bcs=[fm.dirichlet(V, data, "block/bottom", (0.0, 0.0))], petsc_options_prefix="few_plane_",
        model_check=fm.ModelCheck(stiffness_ratio=0.1, in_space=in_space),
    )  # fmt: skip
    line.move(y=-0.01)
    floor.move(z=-0.01)
    yield "estimated", errors(problem.solve().model_check)
    fm.save_state(problem, folder / "section")
    fm.load_state(problem, folder / "section")
    yield "in space", errors(scene.problem.solve().model_check)
    yield "true", [error for _, error in sorted(in_space.compare(problem).errors.items())]


def tied(kind, folder):
    """Joined bodies, pulled; with contact on an obstacle, too."""
    for gap in ("removed", "kept"):
        data = small_mesh(*kind)
        pairs = [fm.TiedPair(data, "upper/bottom", "lower/top", gap=gap)]
        blocks = Blocks(*kind, data=data, pairs=pairs)
        report = blocks.press(0.01, 0.02)
        for what, value in results(blocks.problem, report):
            yield f"{gap}: {what}", value
        yield f"{gap}: error", blocks.problem.estimate().total
        check = blocks.problem.check_tangent(print_table=False)
        yield f"{gap}: slopes", all(s > 1.9 for s in check.slopes.values()) or str(check.slopes)


def tied_heat(kind, folder):
    """Joined bodies that exchange heat: temperature and displacement are tied."""
    count, cell, degree = kind
    data = small_mesh(count, cell, degree)
    W = fm.mixed_space(data.mesh, ("Lagrange", degree, (2,)), ("Lagrange", 1))
    w, (v, s) = fem.Function(W), ufl.TestFunctions(W)
    u, T = ufl.split(w)
    strain = ufl.sym(ufl.grad(u)) - 1e-3 * T * ufl.Identity(2)
    residual = 100.0 * ufl.inner(strain, ufl.sym(ufl.grad(v))) * ufl.dx(degree=2)
    residual += 5.0 * ufl.inner(ufl.grad(T), ufl.grad(s)) * ufl.dx(degree=2)
    ends = ("lower/fixed", 0.0), ("upper/moved", 10.0)
    bcs = [fm.dirichlet(W.sub(0), data, name, 0.0, i) for name, _ in ends for i in (0, 1)]
    bcs += [fm.dirichlet(W.sub(1), data, name, value) for name, value in ends]
    pair = fm.TiedPair(data, "upper/bottom", "lower/top", fields=[1])
    problem = fm.ContactProblem(
        residual, w, [pair], bcs=bcs, newton=TIGHT, petsc_options_prefix="few_"
    )
    report = problem.solve()
    flux = problem.contacts[0].fluxes[0]
    yield "force", problem.contacts[0].total_force
    yield "fluxes", np.array([flux.into_slave, flux.into_master])
    yield "verdict", " ".join(report.certificate.violations())
    slopes = problem.check_tangent(print_table=False).slopes
    yield "slopes", all(slope > 1.9 for slope in slopes.values()) or str(slopes)


def at_points(kind, folder):
    """Loads and motions at points: a rigid boundary, a spread load, a section under pretension."""
    data = small_mesh(*kind)
    V = fm.vector_space(data.mesh, kind[2])
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, "lower/fixed", (0.0, 0.0))]
    grip = fm.RigidBoundary(data, "upper/moved", pivot=(0.3, 1.8), name="grip")
    pull = fm.SpreadLoad(data, "lower/top", pivot=(0.2, 1.1))
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=fm.Coulomb(MU))
    residual = internal(u, neo_hookean(u, 100.0, 0.3))
    options = {"remote": [grip, pull], "newton": TIGHT, "petsc_options_prefix": "few_"}
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, **options)
    grip.move(x=0.001, y=-0.02, angle=0.001)
    yield from results(problem, problem.solve())
    yield "reaction", grip.reaction
    yield "reaction by name", problem.reaction("upper/moved", about=(0.3, 1.8)).force
    grip.push(y=1.02 * grip.reaction[1])
    pull.push(x=0.01, y=-0.02, moment=0.001)
    yield from results(problem, problem.solve())
    yield "place", grip.place
    yield "mean motion", pull.place
    slopes = problem.check_tangent(print_table=False).slopes
    yield "slopes", all(s > 1.9 for s in slopes.values()) or str(slopes)
    rhs = fm.LinearVector(q=np.array([[0.0, 1.0, 0.0]]))
    for transpose in (False, True):
        yield "linear solve", problem.linear_solve(rhs, transpose=transpose).q
    assert repr(grip) == "RigidBoundary('grip')" and repr(pull) == "SpreadLoad('lower/top')"
    try:
        pull.move(x=0.0)
    except ValueError as error:
        yield "refused", str(error)
    bolt = fm.Pretension(data, "upper/bottom", "lower/top", name="bolt")
    blocks = Blocks(*kind, data=data, pairs=[bolt])
    bolt.push(0.5)
    yield from results(blocks.problem, blocks.press())
    bolt.lock()
    yield from results(blocks.problem, blocks.press(0.0, 0.01))
    yield "section", np.array([bolt.force, bolt.shortening])


def itself(kind, folder):
    """Surfaces that may all touch each other."""
    data = small_mesh(*kind)
    pairs = [fm.ContactPair(data, ["upper/bottom", "lower/top"])]
    blocks = Blocks(*kind, data=data, pairs=pairs)
    yield from results(blocks.problem, blocks.press())


def floating(kind, folder):
    """The upper body supported by contact alone, under a load; then none can support it."""
    data = small_mesh(*kind)
    V = fm.vector_space(data.mesh, kind[2])
    u, v = fem.Function(V), ufl.TestFunction(V)
    load = fem.Constant(data.mesh, (0.0, -1.0))
    dx = ufl.dx(metadata={"quadrature_degree": 4}, subdomain_data=data.cell_tags)
    residual = ufl.inner(neo_hookean(u, 100.0, 0.3), ufl.grad(v)) * dx
    residual -= ufl.inner(load, v) * dx(data.bodies["upper"])
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=fm.Coulomb(MU))
    problem = fm.ContactProblem(
        residual, u, [pair], petsc_options_prefix="few_",
        newton=TIGHT, bcs=[fm.dirichlet(V, data, "lower/fixed", (0.0, 0.0))],
    )  # fmt: skip
    yield from results(problem, problem.solve())
    load.value[:] = 1.0, 1.0
    try:
        problem.solve()
    except fm.NotConvergedError as error:
        yield "refused", type(error).__name__


def moving(kind, folder):
    """An impact; the masses of slave nodes need a second layer of nodes behind them."""
    schemes = ["generalized_alpha"] if kind[2] == 1 else ["conserving", "massless"]
    for scheme in schemes:
        data = small_mesh(*kind)
        V = fm.vector_space(data.mesh, kind[2])
        u = fem.Function(V)
        velocity = fm.Velocity(u)
        v, rate = ufl.TestFunction(V), velocity.expression
        dx = ufl.dx(metadata={"quadrature_degree": 4})
        damping = 0.01 * ufl.inner(rate, v) * dx
        pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=fm.Coulomb(MU))
        problem = fm.ContactProblem(
            internal(u, neo_hookean(u, 100.0, 0.3)) + damping, u, [pair], newton=TIGHT,
            petsc_options_prefix="few_", bcs=[fm.dirichlet(V, data, "lower/fixed", (0.0, 0.0))],
        )  # fmt: skip
        energy = 0.5 * ufl.inner(ufl.grad(u), ufl.grad(u)) * dx
        motion = fm.Dynamics(problem, 1.0, scheme=scheme, velocity=velocity, energy=energy)
        cells = data.cell_tags.find(data.bodies["upper"])
        motion.velocity.interpolate(lambda x: np.stack([0 * x[0], 0 * x[1] - 0.5]), cells)
        motion.velocity.x.scatter_forward()
        before = problem.state()
        motion.step(0.01)
        yield f"{scheme}: error", motion.error(before, 0.01)
        record = motion.run(0.05, fm.SteppingOptions(step=0.01))
        yield f"{scheme}: energies", np.array(motion.energies()[:2])
        yield f"{scheme}: momentum", motion.momentum()
        yield f"{scheme}: time", motion.time
        yield f"{scheme}: work", np.array([record.contact_energy, record.friction_work])
        assert record.num_iterations and record.table() and str(record)
        yield f"{scheme}: remark", bool(record.remark())
        yield f"{scheme}: u", nodal(problem)


def models(kind, folder):
    """Errors of models, cheaper models first, and an elastic body instead of an obstacle."""
    data = small_mesh(*kind)
    V = fm.vector_space(data.mesh, kind[2])
    for quantity in ("energy norm", "total force", "peak pressure"):
        u = fem.Function(V)
        richer = internal(u, neo_hookean(u, 100.0, 0.3))
        check = fm.ModelCheck(
            0.01,
            quantity=quantity,
            finite_strain=richer,
            friction=0.2,
        )
        problem, push = linear_blocks(data, u, check)
        push.value[:] = 0.0, -0.02
        report = problem.solve()
        yield f"{quantity}: errors", errors(report.model_check)
        yield f"{quantity}: suffices", report.model_check.suffices
        yield f"{quantity}: sum", report.model_check.error
        verdicts = [report.model_check.verdict(a) for a in report.model_check.assumptions]
        yield f"{quantity}: verdicts", verdicts
        assert str(report.model_check)
        if quantity == "energy norm":
            fm.save_state(problem, folder / "checked")
            fm.load_state(problem, folder / "checked")
    obstacle = fm.Plane((0.5, 1.0), (0.0, 1.0))
    w = fem.Function(fm.vector_space(data.mesh, kind[2]))
    grips = bcs_of(data, w.function_space, (0.0, 0.0))
    elastic = fm.ElasticObstacle(
        obstacle, internal(w, linear_elastic(w, 100.0, 0.3)), w, data, "lower/top", bcs=grips
    )
    u = fem.Function(V)
    check = fm.ModelCheck(elastic_obstacles=[elastic])
    problem, push = linear_blocks(data, u, check, obstacle)
    push.value[:] = 0.0, -0.02
    report = problem.solve()
    yield "elastic obstacle", errors(report.model_check)
    yield "bent", np.sort(elastic.displacements(problem.equations.contacts)[0])
    yield "flat", np.sort(elastic.flatness(problem.equations.contacts)[0])


def errors(model_check):
    """All errors of a report on the errors of a model."""
    return [a.errors[name] for a in model_check.assumptions for name in sorted(a.errors)]


def linear_blocks(data, u, check, master="lower/top"):
    """Linear elastic blocks with a check of the model."""
    V = u.function_space
    push = fem.Constant(data.mesh, (0.0, 0.0))
    bcs = bcs_of(data, V, push)
    pair = fm.ContactPair(data, "upper/bottom", master)
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, 100.0, 0.3)), u, [pair], bcs=bcs, newton=TIGHT,
        petsc_options_prefix="few_", model_check=check,
    )  # fmt: skip
    return problem, push


def mixed(kind, folder):
    """Displacement and pressure."""
    count, cell, _ = kind
    data = small_mesh(count, cell, 2)
    W = fm.mixed_space(data.mesh, ("Lagrange", 2, (2,)), ("Lagrange", 1))
    w = fem.Function(W)
    energy = fm.energies.mixed_linear_elastic(*ufl.split(w), 40.0, 0.01)
    residual = ufl.derivative(energy * ufl.dx(metadata={"quadrature_degree": 4}), w)
    push = fem.Function(W.sub(0).collapse()[0])
    push.interpolate(lambda x: np.stack([0.0 * x[0], -0.02 * (x[1] > 1.0)]))
    names = "lower/fixed", "upper/moved"
    bcs = [fm.dirichlet(W.sub(0), data, name, push) for name in names]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    problem = fm.ContactProblem(
        residual, w, [pair], bcs=bcs, newton=TIGHT, petsc_options_prefix="few_"
    )
    report = problem.solve()
    yield "force", problem.contacts[0].total_force
    yield "verdict", " ".join(report.certificate.violations())
    yield "error", problem.estimate().total


def heated(kind, folder):
    """Displacement and temperature, with a flux across the contact."""
    count, cell, degree = kind
    data = small_mesh(count, cell, degree)
    W = fm.mixed_space(data.mesh, ("Lagrange", degree, (2,)), ("Lagrange", 1))
    w, (v, s) = fem.Function(W), ufl.TestFunctions(W)
    u, T = ufl.split(w)
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    strain = fm.energies.elastic_strain(u, 1e-3 * T)
    stress = fm.energies.stress(fm.energies.linear_elastic, strain, 40.0, 60.0)
    residual = ufl.inner(stress, fm.energies.elastic_strain(v)) * dx
    residual += 5.0 * ufl.inner(ufl.grad(T), ufl.grad(s)) * dx
    push, hot = (fem.Constant(data.mesh, value) for value in (-0.02, 10.0))
    of_u = [("lower/fixed", 0.0, 0), ("lower/fixed", 0.0, 1), ("upper/moved", 0.0, 0)]
    bcs = [fm.dirichlet(W.sub(0), data, *given) for given in [*of_u, ("upper/moved", push, 1)]]
    bcs += [fm.dirichlet(W.sub(1), data, "lower/fixed", 0.0)]
    bcs += [fm.dirichlet(W.sub(1), data, "upper/moved", hot)]
    given = {"bcs": bcs, "newton": TIGHT, "petsc_options_prefix": "few_"}
    h = [fm.PressureConductance(3.0, 5.0), fm.GapConductance(0.02, 0.1)]
    floor = fm.Plane((0.0, 1.0), (0.0, 1.0))

    def power(p, X):
        return p * X[:, 0], X[:, 0]

    options = {"share": 0.3}, {"heating": power, "temperature": 1.0}
    for master, more in zip(("lower/top", floor), options, strict=True):
        law = fm.Conductance(1, h, **more)
        pair = fm.ContactPair(data, "upper/bottom", master, law=fm.Coulomb(MU), fluxes=[law])
        problem = fm.ContactProblem(residual, w, [pair], **given)
        report = problem.solve()
        flux = problem.contacts[0].fluxes[0]
        yield "force", problem.contacts[0].total_force
        yield "fluxes", np.array([flux.into_slave, flux.into_master, flux.jump.sum()])
        yield "verdict", " ".join(report.certificate.violations())
        scale, form = sensitivity.ConductanceScale(0, 1), T * ufl.dx(degree=2)
        yield "gradient", fm.gradient(form, scale, problem)[scale]
        yield "direction", sensitivity.tangent_linear(form, scale, 1.0, problem).derivative
        scale.set(problem, 2.0)
        assert scale.get(problem) == 2.0 and repr(law).startswith("Conductance(1")
        assert flux.heating.any() == ("heating" in more)
        covered = problem.equations.contacts[0].covered
        np.testing.assert_array_equal(flux.conductance > 0.0, covered)


def plastic_bodies(kind, folder):
    """Bodies with history, restored and from a file."""
    data, degree = small_mesh(*kind), 2 * kind[2]
    V = fm.vector_space(data.mesh, kind[2])
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, -0.02))
    material = history_scenes.plastic(u, degree, sigma_y=0.5)
    strain = history_scenes.in_space(fm.energies.strain(ufl.TestFunction(V)))
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    problem = fm.ContactProblem(
        ufl.inner(material.stress, strain) * ufl.dx(degree=degree), u, [pair], newton=TIGHT,
        bcs=bcs_of(data, V, push), history=material.history, petsc_options_prefix="few_",
    )  # fmt: skip
    problem.solve()
    state, shown = problem.state(), material.shown["alpha"]
    fm.save_state(problem, folder / "plastic")
    for restore in (problem.restore, lambda _: fm.load_state(problem, folder / "plastic")):
        push.value[:] = 0.0, -0.022
        yield from results(problem, problem.solve())
        restore(state)
        yield "hardening", data.mesh.comm.allreduce(shown.x.array.max(initial=0.0), max)


def of_revolution(kind, folder):
    """Bodies of revolution, away from the axis."""
    data = small_mesh(*kind)
    data.mesh.geometry.x[:, 0] += 1.0
    V = fm.vector_space(data.mesh, kind[2])
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, -0.02))
    bcs = bcs_of(data, V, push)
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    problem = fm.ContactProblem(
        revolved.internal(u, revolved.linear_elastic(u, 100.0, 0.3)), u, [pair], bcs=bcs,
        geometry="axisymmetric", newton=TIGHT, petsc_options_prefix="few_",
    )  # fmt: skip
    yield from results(problem, problem.solve())
    yield "error", problem.estimate().total


def of_gmsh(kind, folder):
    """Two cells read from gmsh."""
    sizes = {"n_upper": 1, "n_lower": kind[0] - 1, "layers_upper": 1, "layers_lower": 1}
    scene = scenes.pressed_blocks(degree=kind[2], **sizes)
    scene.loads["push"].value[:] = 0.0, -0.02
    yield from results(scene.problem, scene.problem.solve())


def of_meshio(kind, folder):
    """Bodies and boundaries from sets of meshio."""
    points, cells, bodies, boundaries = arrays(*kind)
    types = {3: "triangle", 4: "quad", 6: "triangle6", 9: "quad9"}
    blocks = [(types[cells.shape[1]], cells), *(("line", ends) for ends in boundaries.values())]
    none = [None] * len(blocks)
    sets = {name: [numbers, *none[1:]] for name, numbers in bodies.items()}
    for number, (name, ends) in enumerate(boundaries.items(), 1):
        sets[name] = [*none[:number], np.arange(len(ends)), *none[number + 1 :]]
    mesh = meshio.Mesh(points, blocks, cell_sets=sets)
    made = Blocks(*kind, data=fm.mesh_from_meshio(mesh))
    yield from results(made.problem, made.press())


def refused(kind, folder):
    """States that are not found, and one that violates its certificate."""
    blocks = Blocks(*kind, newton=fm.NewtonOptions(max_iterations=1))
    try:
        blocks.press()
    except fm.NotConvergedError as error:
        yield "not converged", type(error.report).__name__
    blocks = Blocks(*kind)
    blocks.problem.solve()
    blocks.push.value[:] = 0.0, -0.9
    try:
        report = blocks.problem.solve(accept_violations=True)
        yield "violated", report.certificate.violations() != []
    except fm.NotConvergedError as error:
        yield "refused", type(error.report).__name__
    blocks = Blocks(*kind)

    def load(time):
        blocks.push.value[:] = 0.0, -0.9 * time

    try:
        fm.follow_path(blocks.problem, load, fm.SteppingOptions(0.5, smallest=0.25))
    except fm.NotConvergedError as error:
        yield "dead end", type(error.report).__name__


def laws(kind, folder):
    """A given friction limit, and laws of users with memory, a soft layer and adhesion."""
    users = Worn(MU, 0.01), SoftLayer(1e3, 1.0, MU), Cohesive(1.0, 0.1)
    for law in (fm.Tresca(1.0), *users):
        name = type(law).__name__
        blocks = Blocks(*kind, law=law)
        path = sensitivity.RecordedPath(blocks.problem)
        for step in (1, 2):
            blocks.problem.time = 0.5 * step
            for what, value in results(blocks.problem, blocks.press(0.01 * step, -0.02)):
                yield f"{name}: {what}", value
            path.record()
        force = sensitivity.TotalForce(0, (0.3, 1.0))
        yield f"{name}: derivative", fm.gradient(force, blocks.push, path)[blocks.push]


SCENES = [
    pressed, measured, written, paths, options, obstacles, tied, tied_heat, at_points,
    itself, floating, moving, models, mixed, heated, of_revolution, of_gmsh, refused, laws,
    of_meshio, plastic_bodies, in_space, section,
]  # fmt: skip
