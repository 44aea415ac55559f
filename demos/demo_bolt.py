# # A bolt tightened by a force, then loaded
#
# The shank is cut in the mesh. The two faces of the cut are tied but for the shortening of the
# bolt, which a given force determines; then it is locked.
#
# ## Problem
# A bolt clamps two round plates of steel by 20 kN; then a force pulls the plates apart. The bolt
# carries only a part of it, as long as the plates touch. Bolt and plates are two springs: the part
# follows from the shortenings by a preload and by an external load at constant preload,
#
# $$\Phi = - \frac{\partial s / \partial F}{\partial s / \partial F_0} .$$
#
# ## Implementation

# +
from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes.bolted_joint import mesh

comm, data = MPI.COMM_WORLD, mesh()
E, nu, preload = 210e3, 0.3, 20e3
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
r = ufl.SpatialCoordinate(data.mesh)[0]
strain = ufl.variable(fm.energies.strain(u, "axisymmetric"))
energy = fm.energies.linear_elastic(strain, *fm.energies.lame(E, nu))
residual = ufl.derivative(2 * np.pi * r * energy * ufl.dx(degree=3), u, v)
# -

# Nothing but contact with friction supports the bolt. The lower plate is fixed around the nut; the
# force on the upper one, given at a point, is spread around the head.

# +
bolt = fm.Pretension(data, slave="head/cut", master="nut/cut", name="bolt")
touching = [("upper/seat", "head/under"), ("lower/seat", "nut/under")]
touching += [("upper/joint", "lower/joint")]
pairs = [fm.ContactPair(data, *sides, law=fm.Coulomb(0.2)) for sides in touching]
pull = fm.SpreadLoad(data, "upper/shoulder", pivot=(0.0, 10.0))
bcs = [
    fm.dirichlet(V, data, ["head/axis", "nut/axis"], 0.0, component=0),
    fm.dirichlet(V, data, "lower/shoulder", 0.0, component=1),
]
options = {"geometry": "axisymmetric", "petsc_options_prefix": "bolt_"}
problem = fm.ContactProblem(residual, u, [bolt, *pairs], bcs=bcs, remote=[pull], **options)
# -

# ## Preload by force, then lock
# `push` prescribes the force in the section, `lock` keeps its shortening.


# +
def shortening(force: float, external: float) -> float:
    bolt.push(force)
    pull.push(y=external)
    problem.solve()
    return bolt.shortening


before, tight, pulled = [shortening(*loads) for loads in ((19e3, 0), (preload, 0), (preload, 1e3))]
part = -(pulled - tight) / 1e3 / ((tight - before) / (preload - 19e3))
shortening(preload, 0.0)
shown = {"label": "axial stress [MPa]", "units": ("mm", "MPa")}
fm.plot(problem, "results/bolt.png", stress=ufl.diff(energy, strain)[1, 1], **shown)
bolt.lock()
loads, force = 1e3 * np.array([0, 5, 10, 15, 20, 25, 30]), []
for load in loads:
    pull.push(y=load)
    problem.solve()
    force.append(bolt.force)
# -

# ## Comparison
# At last the plates separate, and the bolt carries all of the load.

# +
springs = preload + part * loads
if comm.rank == 0:
    print(f"shortening {1e3 * tight:.2f} um, part of the load on the bolt {part:.4f}")
    print("| external load [kN] | bolt [kN] | two springs |\n|---:|---:|---:|")
    for row in zip(loads / 1e3, np.array(force) / 1e3, springs / 1e3, strict=True):
        print("| " + " | ".join(f"{number:.2f}" for number in row) + " |")
# -

# ## Check

assert abs(force[0] / preload - 1) < 1e-9
assert abs((force[2] - force[0]) / (springs[2] - springs[0]) - 1) < 0.05
assert abs(force[-1] / loads[-1] - 1) < 1e-9
