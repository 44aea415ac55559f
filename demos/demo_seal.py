# # An O-ring seals: fluid pressure on the open part of a contact surface
#
# This demo shows how to
# - bring a whole outline into contact with several rigid obstacles,
# - use Taylor-Hood elements for an incompressible body,
# - let a load depend on contact: the fluid acts where no contact seals the surface from it.
#
# ## Problem
# A cord of rubber (neo-Hookean, incompressible, plane strain, friction 0.1) of radius 1 mm lies in
# a groove. Its lid comes down by 0.4 mm; then a fluid presses on the cord from the left, with up to
# three times its shear modulus; then the lid lifts. Such seals are self-energizing: the contact
# pressure grows with that of the fluid.
#
# ## Implementation

# +
from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes.with_gmsh import gmsh

comm, mu = MPI.COMM_WORLD, 1.0
if comm.rank == 0:
    gmsh.initialize(["", "-v", "0"])
    gmsh.model.occ.addDisk(0, 0, 0, 1, 1)
    gmsh.model.occ.synchronize()
    for dim, name in ((2, "cord"), (1, "cord/outline")):
        gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [1]), name)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.12)
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setOrder(2)
data = fm.read_gmsh(gmsh.model, comm)
# -

# The fluid acts on the deformed surface. It wets the upper half of the cord up to `above` and the
# lower half up to `below`, reference positions x [mm].

# +
W = fm.mixed_space(data.mesh, ("Lagrange", 2, (2,)), ("Lagrange", 1))
w = fem.Function(W)
(u, p), v = ufl.split(w), ufl.TestFunctions(W)[0]
F = fm.energies.deformation_gradient(u)
energy = fm.energies.mixed_neo_hookean(F, p, mu)
X, N = ufl.SpatialCoordinate(data.mesh), ufl.FacetNormal(data.mesh)
fluid, above, below = (fem.Constant(data.mesh, value) for value in (0.0, -1.0, -1.0))
wet = ufl.conditional(X[0] < ufl.conditional(X[1] > 0, above, below), fluid, 0.0)
residual = ufl.derivative(energy * ufl.dx(degree=4), w)
residual += wet * ufl.det(F) * ufl.inner(ufl.dot(ufl.inv(F).T, N), v) * ufl.ds(degree=20)
# -

# Only contact supports the cord, which touches the wall of the groove. Every other node along its
# outline is the end of a facet. With full steps, Newton's method may leave the groove when the lid
# lifts.

# +
planes = {"lid": ((0, 1), (0, -1)), "floor": ((0, -1), (0, 1)), "wall": ((1, 0), (-1, 0))}
walls = [fm.Plane(*plane, name=name) for name, plane in planes.items()]
pairs = [fm.ContactPair(data, "cord/outline", wall, law=fm.Coulomb(0.1)) for wall in walls]
problem = fm.ContactProblem(residual, w, pairs, petsc_options_prefix="seal_")
lid, floor, _ = problem.contacts
x, errors, excess = lid.positions[::2, 0], [], []  # at facet ends, not deformed yet
for y in (-0.1, -0.2, -0.3):
    walls[0].move(y=y)
    problem.solve()
# -

# ## Fluid
# The ends of the wetted part depend on the solution: solve until they no longer change. At the full
# pressure of the fluid the lid lifts again.

# +
path = [(0.5 * k, -0.4) for k in range(7)] + [(3.0, 0.1 * k) for k in (-3, -2, -1, 0)]
wet_to = None
for fluid.value, y in path:
    walls[0].move(y=y)
    while True:
        problem.solve()
        ends = [np.where(side.active[::2], x, 1.0).argmin() for side in (lid, floor)]
        if ends == wet_to:
            break
        wet_to, (above.value, below.value) = ends, x[ends]
    width, rise = lid.positions[::2][ends[0]] - floor.positions[::2][ends[1]]
    contact = sum(contact.total_force for contact in problem.contacts)
    errors.append(np.abs(contact + fluid.value * np.array([rise, -width])).max())
    excess.append(min(lid.pressure.max(), floor.pressure.max()) - fluid.value)
    if comm.rank == 0:
        print(f"fluid {fluid.value:.1f} MPa, lid at {1 + y:.1f} mm, excess {excess[-1]:.3f} MPa")
fm.plot(problem, "results/seal.png", stress=-p, label="pressure [MPa]", units=("mm", "MPa"))
# -

# ## Check
# The resultant of the fluid is its pressure times the chord of the wetted part, and the contact
# forces balance it. The seal is tight: the contact pressure exceeds that of the fluid.

assert max(errors) < 1e-8 and min(excess) > 0.0
