# # Step 1: two blocks
#
# The tutorial takes about an hour and assumes experience with dolfinx. It is one script in five
# steps, of more than 350 lines, because each step uses functions and objects of the previous ones.
# You will
#
# 1. press two elastic blocks together,
# 2. give them finite strain and follow a load path in adaptive steps,
# 3. add friction,
# 4. find out whether the model was rich enough and the mesh fine enough,
# 5. write a contact law, verify its derivatives, and use the mortar matrices.
#
# Lengths are in mm and stresses in MPa, hence forces in N per mm of thickness. Any other consistent
# set of units gives the same iterations.
#
# ## The mesh
#
# Both bodies are parts of one mesh. Their surfaces need not match: here ten facets of the upper
# block meet sixteen of the lower one. gmsh carries the names of bodies and boundaries as physical
# groups, and every later line refers to these names.

# +
from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm

comm = MPI.COMM_WORLD


def add_block(name, x, y, width, height, columns, rows):
    """Add a block of quadrilaterals with its lower left corner at (x, y), and name its sides."""
    geo = gmsh.model.geo
    corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
    points = [geo.addPoint(a, b, 0.0) for a, b in corners]
    lines = [geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
    for line, facets in zip(lines, (columns, rows, columns, rows)):
        geo.mesh.setTransfiniteCurve(line, facets + 1)
    surface = geo.addPlaneSurface([geo.addCurveLoop(lines)])
    geo.mesh.setTransfiniteSurface(surface)
    geo.mesh.setRecombine(2, surface)
    geo.synchronize()
    sides = [f"{name}/{side}" for side in ("bottom", "right", "top", "left")]
    for dim, named in ((2, {name: surface}), (1, dict(zip(sides, lines)))):
        for group, entity in named.items():
            tag = gmsh.model.addPhysicalGroup(dim, [entity])
            gmsh.model.setPhysicalName(dim, tag, group)


def two_blocks(refinement=1):
    """Mesh of a block of 1 x 0.5 mm upon one of 2 x 0.8 mm."""
    if comm.rank == 0:  # gmsh runs on the first rank; the mesh is distributed to all
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("two_blocks")
        add_block("lower", -1.0, -0.8, 2.0, 0.8, 16 * refinement, 6 * refinement)
        add_block("upper", -0.5, 0.0, 1.0, 0.5, 10 * refinement, 5 * refinement)
        gmsh.model.mesh.generate(2)
    data = fm.read_gmsh(gmsh.model if comm.rank == 0 else None, comm)
    if comm.rank == 0:
        gmsh.finalize()
    return data


blocks = two_blocks()
# -

# `fm.read_gmsh("blocks.msh", comm)` reads a file instead. `blocks.mesh` is an ordinary dolfinx
# mesh, and `blocks.boundaries` maps names to the tags in `blocks.facet_tags`.
#
# ## The bodies
#
# The bulk is plain UFL: a residual in an unknown function `u`. This first step uses linear
# elasticity in plane strain, one of the usual energies in
# [`fm.energies`](../../fenics_mortar/energies.py); write any other expression in its place.

# +
E, nu = 100.0, 0.3  # [MPa], [1]
mu, lmbda = fm.energies.lame(E, nu)
dx = ufl.dx(metadata={"quadrature_degree": 3})


def linear_stress(u):
    """Stress of linear elasticity [MPa]."""
    return fm.energies.stress(fm.energies.linear_elastic, fm.energies.strain(u), mu, lmbda)


V = fm.vector_space(blocks.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
linear = ufl.inner(linear_stress(u), ufl.grad(v)) * dx
# -

# Supports are Dirichlet conditions on named boundaries. Values that change later are `Constant`s.

fixed = fem.Constant(blocks.mesh, (0.0, 0.0))
push = fem.Constant(blocks.mesh, (0.0, 0.0))
bcs = [fm.dirichlet(V, blocks, "lower/bottom", fixed), fm.dirichlet(V, blocks, "upper/top", push)]

# ## The contact
#
# One line. The **slave** is the side that carries the contact pressure as an unknown, the
# **master** the other one. Take the finer or softer side as the slave.

contact = fm.ContactPair(blocks, slave="upper/bottom", master="lower/top")
problem = fm.ContactProblem(linear, u, [contact], bcs=bcs, petsc_options_prefix="step_1_")

# Move the top of the upper block down by 0.02 mm and solve. `solve` returns a report of the Newton
# iterations. If they do not converge, it raises `NotConvergedError`, which holds the same report.

push.value[:] = (0.0, -0.02)
report = problem.solve()
if comm.rank == 0:
    print("iterations:", report.num_iterations)
    print("active nodes:", [iteration.num_active for iteration in report.iterations])

# ```text
# iterations: 4
# active nodes: [11, 11, 11, 11, 11]
# ```
#
# All eleven slave nodes touch from the start and stay in the *active set*, the set of nodes in
# contact. The bodies are linear, but contact is not: gap, normals and integrals belong to the
# deformed surfaces. `print(report)` shows the whole table. For loads so small that this makes no
# difference, `ContactPair(..., sliding="small")` keeps the integrals of the undeformed mesh.
#
# ## Results
#
# `problem.contacts[0]` has the results on the pair as arrays along the slave surface: `pressure`,
# `gap`, `slip`, `status`, `forces` and more. They are the same on all ranks.

side = problem.contacts[0]
if comm.rank == 0:
    print("pressure [MPa]:", side.pressure.round(2))
    print("force on the upper block [N/mm]:", side.total_force.round(4))

# ```text
# pressure [MPa]: [3.04 2.13 1.94 1.96 1.93 1.93 1.93 1.96 1.94 2.13 3.04]
# force on the upper block [N/mm]: [-0. 2.1123]
# ```
#
# The pressure rises towards the edges of the upper block, as below any block with sharp corners:
# the exact pressure is infinite there, and the corner nodes take its peak.
#
# Each solve also measures its own result: balance of forces, overlap, tension, complementarity. A
# state that violates this *certificate* raises an error, so there is no need to check the state
# by hand.

if comm.rank == 0:
    print("violations:", report.certificate.violations())
shown = {"label": "compression [MPa]", "units": ("mm", "MPa")}
fm.plot(problem, "results/tutorial_1", stress=-linear_stress(u)[1, 1], **shown)

# ```text
# violations: []
# ```
#
# ![Two blocks: vertical compression and contact pressure](../pictures/tutorial_1.png)

# # Step 2: finite strain and load steps
#
# Large deformation needs two changes: an energy for finite strain, and a load path. The contact
# line stays. Search, gap, normals and their derivatives always refer to the deformed surfaces.
#
# The energy per undeformed volume is that of the compressible neo-Hookean law,
# mu/2 (tr C - 3) - mu ln J + lambda/2 (ln J)^2. Its derivatives are the residual and the stress.

# +
F = ufl.variable(fm.energies.deformation_gradient(u))  # 1 + grad u
psi = fm.energies.neo_hookean(F, mu, lmbda)
stress = ufl.diff(psi, F) * F.T / ufl.det(F)  # Cauchy [MPa]
finite = ufl.derivative(psi * dx, u, v)
u.x.array[:] = 0.0
problem = fm.ContactProblem(finite, u, [contact], bcs=bcs, petsc_options_prefix="step_2_")
# -

# ## A load path
#
# `set_loads` maps a time to loads and prescribed displacements. Here the top goes down by 0.2 mm
# until time 1, and to the right by 0.4 mm until time 2, which is four facets of the upper block.


# +
def set_loads(time):
    push.value[:] = (0.4 * max(time - 1.0, 0.0), -0.2 * min(time, 1.0))


forces = []


def record(time, report):
    forces.append((time, *problem.contacts[0].total_force))


path = fm.follow_path(
    problem, set_loads, fm.SteppingOptions(step=0.25, largest=0.5), stop=2.0, on_step=record
)
# -

# `follow_path` chooses the steps: a step with few iterations is followed by a longer one; a failed
# step is reverted exactly and cut. `on_step` is called after each accepted step: record results
# there, or write files for ParaView with a `fm.ResultsWriter`.

if comm.rank == 0:
    for step in path.steps:
        print(f"time {step.time:.2f}: {step.report.num_iterations} iterations")
    print("force at the end [N/mm]:", np.round(forces[-1][1:], 3))

# ```text
# time 0.25: 4 iterations
# time 0.75: 4 iterations
# time 1.25: 5 iterations
# time 1.75: 6 iterations
# time 2.00: 4 iterations
# force at the end [N/mm]: [0.617 23.666]
# ```
#
# The number of iterations is small because the tangent is exact. Newton's method converges
# quadratically: the number of correct digits doubles in each of the last iterations.

if comm.rank == 0:
    last = path.steps[-1].report
    print("residuals / force:", [f"{r / last.force:.0e}" for r in last.residuals])
fm.plot(problem, "results/tutorial_2", stress=-stress[1, 1], **shown)

# ```text
# residuals / force: ['1e-01', '4e-03', '4e-05', '8e-10', '5e-15']
# ```
#
# ![The upper block pressed into the lower one and moved to the right](../pictures/tutorial_2.png)
#
# ## If a step fails
#
# A plain loop, `for ...: push.value[:] = ...; problem.solve()`, works as well. The difference
# shows when a load step is too large: `solve` raises `NotConvergedError`, `follow_path` cuts the
# step. Where no step leads further, because a surface slipped off an edge for instance,
# `follow_path` raises with the reason. `fm.save_state` and `fm.load_state` store and load the
# state of a path on any number of ranks.

# # Step 3: friction
#
# The law of contact is an argument of the pair. `fm.Coulomb(0.3)` admits a shear of at most 0.3
# times the pressure: nodes stick below that limit and slide at it.

u.x.array[:] = 0.0
rough = fm.ContactPair(blocks, "upper/bottom", "lower/top", law=fm.Coulomb(0.3))
problem = fm.ContactProblem(finite, u, [rough], bcs=bcs, petsc_options_prefix="step_3_")

# Press by 0.05 mm, then shear by 0.08 mm. With friction, slip is counted from the last solved step:
# the result depends on the path and not only on its end. Press and shear in several steps.


# +
def press_and_shear(time):
    push.value[:] = (0.08 * max(time - 1.0, 0.0), -0.05 * min(time, 1.0))


curve = []


def record_friction(time, report):
    side = problem.contacts[0]
    pressed, sheared = side.total_force[1], -side.total_force[0]
    curve.append((time, pressed, sheared, np.sum(side.status == "stick")))


fm.follow_path(
    problem, press_and_shear, fm.SteppingOptions(step=0.125), stop=2.0, on_step=record_friction
)
if comm.rank == 0:
    print("time   normal   shear  shear / normal  sticking nodes")
    for time, pressed, sheared, sticking in curve[7::2]:
        ratio = sheared / pressed
        print(f"{time:.2f}   {pressed:.3f}   {sheared:.3f}       {ratio:.3f}          {sticking}")
# -

# ```text
# time   normal   shear  shear / normal  sticking nodes
# 1.00   5.597   0.000       0.000          11
# 1.25   5.590   0.607       0.109          10
# 1.50   5.563   1.193       0.214          6
# 1.75   5.482   1.564       0.285          2
# 2.00   5.466   1.578       0.289          0
# ```
#
# The shear grows while nodes stick. Once all slide, the shear of each node is 0.3 times its
# pressure. The ratio of the horizontal and the vertical force stays slightly below, since the
# interface tilts.

fm.plot(problem, "results/tutorial_3", stress=stress[0, 1], label="shear stress [MPa]")
if comm.rank == 0:
    from matplotlib.figure import Figure

    time, pressed, sheared, _ = np.array(curve).T
    figure = Figure((5, 3), layout="constrained")
    axes = figure.add_subplot(xlabel="time", ylabel="force [N/mm]")
    axes.plot(time, 0.3 * pressed, "k--", lw=1, label="0.3 times normal force")
    axes.plot(time, sheared, "o-", ms=3, color="#c8102e", label="shear force")
    axes.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncol=2)
    figure.savefig("results/tutorial_3_forces.png", dpi=150)

# ![Shear force over time: it grows until all nodes slide](../pictures/tutorial_3_forces.png)
#
# `fm.Tresca(stress)` limits the shear by a constant, and a law may also have adhesion; step 5
# shows how to write a law.

# # Step 4: errors of the model and of the mesh
#
# Each result raises two questions. The answers cost little compared with the solve.
#
# ## The model
#
# Step 1 used linear elasticity. Is it accurate enough at a compression of 0.02 mm? A
# `ModelCheck` estimates the error of the simpler model from one Newton step of the richer
# one, here the neo-Hookean residual.

# +
u.x.array[:] = 0.0
check = fm.ModelCheck(0.02, finite_strain=finite)
problem = fm.ContactProblem(
    linear, u, [contact], bcs=bcs, petsc_options_prefix="step_4_", model_check=check
)
for depth in (0.002, 0.02, 0.1):
    push.value[:] = (0.0, -depth)
    found = problem.solve().model_check
    if comm.rank == 0:
        print(f"depth {depth} mm: error {100 * found.error:.1f} %, enough: {found.suffices}")
# -

# ```text
# depth 0.002 mm: error 0.1 %, enough: True
# depth 0.02 mm: error 0.9 %, enough: True
# depth 0.1 mm: error 4.2 %, enough: False
# ```
#
# `print(found)` lists each assumption: linear kinematics, small sliding, a rigid obstacle, no
# friction.
#
# ## The mesh
#
# `problem.estimate()` returns the estimated error in the energy norm with an indicator for each
# cell.

# +
errors = []
for refinement in (1, 2, 4):
    fine = two_blocks(refinement)
    W = fm.vector_space(fine.mesh, 1)
    w = fem.Function(W)
    down = fem.Constant(fine.mesh, (0.0, -0.02))
    pair = fm.ContactPair(fine, "upper/bottom", "lower/top")
    supports = [
        fm.dirichlet(W, fine, "lower/bottom", np.zeros(2)),
        fm.dirichlet(W, fine, "upper/top", down),
    ]
    form = ufl.inner(linear_stress(w), ufl.grad(ufl.TestFunction(W))) * dx
    refined = fm.ContactProblem(
        form, w, [pair], bcs=supports, petsc_options_prefix=f"mesh_{refinement}_"
    )
    refined.solve()
    estimate = refined.estimate()
    errors.append(estimate.relative)
    marked = comm.allreduce(estimate.mark(0.5).size)
    cells = fine.mesh.topology.index_map(2).size_global
    if comm.rank == 0:
        print(
            f"{cells:5d} cells: error {100 * estimate.relative:.1f} %, half of it in {marked} cells"
        )
# -

# ```text
#   146 cells: error 12.6 %, half of it in 10 cells
#   584 cells: error 7.8 %, half of it in 10 cells
#  2336 cells: error 4.8 %, half of it in 12 cells
# ```
#
# Uniform refinement gains little: half of the squared error is in a few cells at the corners of
# the upper block. Refine these cells instead (`estimate.mark(0.5)` returns them), or take degree
# 2, `fm.vector_space(mesh, 2)`. [Which element, basis, solver, model](site/choices.md) has
# measured advice.

# # Step 5: a research step
#
# A new contact law, its derivatives verified, and the matrices to work with.
#
# ## A user-defined law
#
# A law states one equation per active slave node, `rho(g, slip, z_n, z_tau) = 0`, with its
# derivatives. The multiplier is minus the traction on the slave: `z_n` is the pressure, and
# `z_tau` has the sign of the slip. The law below is Coulomb's law regularized by a length: the
# shear grows smoothly with the slip of the step and tends to 0.3 times the pressure. All
# arguments are arrays over the slave nodes.


# +
class Creeping(fm.Law):
    """z_tau = mu z_n tanh(slip / length)."""

    def __init__(self, mu, length):
        self.mu, self.length = mu, length

    def branch(self, node, before):
        """One smooth branch: no node ever sticks."""
        return np.ones_like(before)

    def tangential(self, node, branch):
        """The equation and its derivatives."""
        fraction = np.tanh(node.slip / self.length)
        return fm.laws.Row(
            node.z_tau - self.mu * node.z_n * fraction,
            by_slip=-self.mu * node.z_n * (1 - fraction**2) / self.length,
            by_z_n=-self.mu * fraction,
            by_z_tau=1.0,
        )

    def friction_limit(self, pressure):
        """Largest shear; the certificate and limit analysis use it."""
        return self.mu * pressure


u.x.array[:] = 0.0
creeping = fm.ContactPair(blocks, "upper/bottom", "lower/top", law=Creeping(0.3, 0.002))
problem = fm.ContactProblem(finite, u, [creeping], bcs=bcs, petsc_options_prefix="step_5_")
for place in ((0.0, -0.02), (0.0, -0.05), (0.01, -0.05), (0.02, -0.05)):
    push.value[:] = place
    report = problem.solve()
side = problem.contacts[0]
if comm.rank == 0:
    print("iterations of the last step:", report.num_iterations)
    print("shear / normal:", np.round(-side.total_force[0] / side.total_force[1], 3))
# -

# ```text
# iterations of the last step: 4
# shear / normal: 0.103
# ```
#
# `fm.laws.row_of(function, node)` returns such a `Row` from the equation alone. Memory, wear, rates
# and parameters that vary in space: [user-defined contact laws](laws.md).
#
# ## Are the derivatives right?
#
# `check_tangent` compares each derivative with differences of the function itself. A correct
# derivative leaves a remainder of second order: halve the step, and the remainder falls to a
# quarter.

check = problem.check_tangent()

# ```text
# | slope | 2.00 | 2.00 | 2.00 | 2.00 | 2.00 | 2.00 |
# ```
#
# The columns are the bulk, normals, gap, D, M and the whole system of equations. A wrong sign in
# `by_slip` shows as a slope of 1 in the last column.
#
# ## The matrices
#
# D and M, the weighted gap, normals and their derivatives are PETSc objects. D integrates slave
# functions against slave functions and is diagonal with the dual basis; M integrates them against
# the master's. Rows of both have the same sums, which is why the forces of both sides cancel
# exactly.

D, M = problem.matrices.D(), problem.matrices.M()
rows = [matrix.createVecLeft() for matrix in (D, M)]
for matrix, row in zip((D, M), rows):
    ones = matrix.createVecRight()
    ones.set(1.0)
    matrix.mult(ones, row)
defect = (rows[0] - rows[1]).norm() / rows[0].norm()
if comm.rank == 0:
    print("sizes:", D.size, M.size)
    print("largest difference of row sums is rounding:", defect < 1e-12)

# ```text
# sizes: (11, 11) (11, 17)
# largest difference of row sums is rounding: True
# ```
#
# ## A sensitivity
#
# `linear_solve` solves with the converged tangent, or its transpose. The change of the solution
# by a force on the bodies is one solve; the gradient of one number with respect to many
# parameters is one transposed solve. Here: the displacement of the upper block's middle per unit
# force on it, in both ways.

# +
dofs = fem.locate_dofs_geometrical(
    V, lambda x: np.isclose(x[0], 0.0, atol=1e-9) & np.isclose(x[1], 0.2)
)
owned = V.dofmap.index_map.size_local
unit = np.zeros(2 * owned)
unit[2 * dofs[dofs < owned]] = 1.0  # x-component
load = fm.LinearVector(u=unit)
forward = load.dot(problem.linear_solve(load), comm)
adjoint = problem.linear_solve(load, transpose=True).dot(load, comm)
if comm.rank == 0:
    print(f"compliance [mm^2/N]: {forward:.5f}, by the transposed solve {adjoint:.5f}")
# -

# ```text
# compliance [mm^2/N]: 0.01155, by the transposed solve 0.01155
# ```
#
# `fm.gradient` does this for whole paths of load steps, with the derivatives of forces, pressures
# and laws provided.
#
# ## Where to go
#
# [The demos](../README.md) are complete problems with their references. [Theory](site/theory.md)
# derives all symbols, [troubleshooting](site/troubleshooting.md) starts from an error message,
# and the [API reference](site/reference.md) has every public name.

assert np.isclose(forward, adjoint, rtol=1e-8)
