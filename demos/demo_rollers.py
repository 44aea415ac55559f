# # Three-point bending between rigid rollers, beyond the largest force
#
# A beam lies on two rollers and is bent by a third one. Rigid bodies need no mesh.
#
# ## Problem
# A beam of height 1 mm undergoes large deflections (neo-Hookean, plane strain, no friction). By
# symmetry one half is computed. The bending force rises to a maximum; then the beam slips through
# between the rollers. So the punch is driven by a force first, and by a displacement beyond.
#
# ## Implementation

# +
from collections.abc import Callable

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

import this_clone

import fenics_mortar as fm

comm = MPI.COMM_WORLD
length, span, radius = 10.0, 7.0, 1.0  # of half the beam, of half the supports
# -

# The mesh is made by dolfinx; a dictionary gives names to the tags of its surfaces.

# +
corners = [(0.0, 0.0), (length, 1.0)]
domain = mesh.create_rectangle(comm, corners, (60, 6), mesh.CellType.quadrilateral)
boundaries = {
    1: lambda x: np.isclose(x[0], 0.0),
    2: lambda x: np.isclose(x[1], 0.0),
    3: lambda x: np.isclose(x[1], 1.0),
}
found = {tag: mesh.locate_entities_boundary(domain, 1, at) for tag, at in boundaries.items()}
facets = np.concatenate(list(found.values()))
tags = np.repeat(list(found), [len(f) for f in found.values()]).astype(np.int32)
order = np.argsort(facets)
facet_tags = mesh.meshtags(domain, 1, facets[order], tags[order])
data = fm.MeshData(domain, None, facet_tags, boundaries={"middle": 1, "bottom": 2, "top": 3})

V = fm.vector_space(domain, 2)
u, v = fem.Function(V), ufl.TestFunction(V)
E, nu = 1000.0, 0.3
F = ufl.variable(fm.energies.deformation_gradient(u))
psi = fm.energies.neo_hookean(F, *fm.energies.lame(E, nu))
P = ufl.diff(psi, F)
residual = ufl.inner(P, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 4})
# -

# Each roller is an obstacle, paired with the surface that it touches.

support = fm.Circle((span, -radius), radius, name="support")
punch = fm.Circle((0.0, 1.0 + radius), radius, name="punch")
pairs = [fm.ContactPair(data, "bottom", support), fm.ContactPair(data, "top", punch)]
bcs = [fm.dirichlet(V, data, "middle", 0.0, component=0)]
problem = fm.ContactProblem(residual, u, pairs, bcs=bcs, petsc_options_prefix="rollers_")

# ## By force, then by displacement
# `push` prescribes a force and makes the position of the punch an unknown; `move` prescribes the
# position, and the force is a result. A path may change from one to the other.

# +
rows = []


def note(_time: float, _report: object) -> None:
    rows.append((-punch.place[1], punch.reaction[1]))


def follow(set_loads: Callable[[float], None]) -> None:
    fm.follow_path(problem, set_loads, fm.SteppingOptions(step=0.125), on_step=note)


follow(lambda time: punch.push(y=-1.6 * time))
start = punch.place[1]
shown = {"label": "horizontal stress [MPa]", "units": ("mm", "MPa")}
fm.plot(problem, "results/rollers.png", stress=(P * F.T / ufl.det(F))[0, 0], **shown)
follow(lambda time: punch.move(y=start - 4.0 * time))
# -

# ## Comparison
# Small deflections are those of a beam: $w = F l^3 / (3 E I)$ of one half, with the span $l$.

# +
depth, force = np.array(rows).T
table = fm.contact_table(problem)
beam = 3 * E / (1 - nu**2) / 12 / span**3 * depth
if comm.rank == 0:
    print("| deflection [mm] | force [N/mm] | beam theory |\n|---:|---:|---:|")
    for row in zip(depth, force, beam, strict=True):
        print("| " + " | ".join(f"{number:.3f}" for number in row) + " |")
    print(f"\n{table}")
# -

# ## Check

balance = support.reaction[1] + punch.reaction[1]
assert abs(balance) < 1e-6 * force.max()
assert abs(force[0] / beam[0] - 1) < 0.02 and force[-1] < 0.95 * force.max() > 1.6
