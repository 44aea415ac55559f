# # Time of the contact kernels
#
# Search, integrals and all derivatives for two wavy surfaces with nonmatching meshes, for
# increasing numbers of facets, and for each kind of integration; the median of several runs after
# the compilation. Run it by itself, without `mpirun`.

# +
import time
from types import SimpleNamespace

import numpy as np

from fenics_mortar.interface.integrals import find_segments, integrate_segments
from fenics_mortar.interface.surfaces import POINTS
from fenics_mortar.kernels import projection
from fenics_mortar.kernels.facets import BY_COVER, DUAL, STANDARD

# -


# +
def median(function, repeats=7):
    """Median seconds of one call."""
    function()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds))


def measure(facets, **integration):
    """Segments, seconds of search and of integrals for a number of slave and master facets."""
    x = np.stack([np.linspace(0, 1, facets + 1), 0.1 * np.sin(np.linspace(0, 9, facets + 1))], 1)
    m = np.stack(
        [np.linspace(1.01, -0.01, facets + 1), 0.1 * np.sin(np.linspace(9.1, -0.1, facets + 1))], 1
    )
    chain = np.arange(facets + 1)
    surface = SimpleNamespace(
        facets=np.stack([chain[:-1], chain[1:]], axis=1),
        functions_move=False,
        roles=None,
    )
    n, dn = np.empty_like(x), np.zeros((facets + 1, 2, 6))
    following = np.append(chain[1:], -1)
    inner = np.zeros(facets + 1, bool)
    projection.tabulate_normals(x, chain - 1, following, inner, projection.OPPOSITE, n, dn)

    def find():
        given = {"integration": "segments", "points": POINTS, **integration}
        options = SimpleNamespace(radius=0.5, min_cosine=0.1, **given)
        return find_segments(surface, surface, x, n, m, chain[:-1], options)

    s = find()
    weights = np.tile(np.eye(2), (facets, 1, 1))
    nodal = integration.get("integration") == "nodes"
    options = STANDARD if nodal else DUAL, BY_COVER, True

    def integrate():
        integrate_segments(s, surface.facets, (x, n, dn, m), weights, options, None)

    return s.num_segments, median(find), median(integrate)


print("| facets a side | segments | search [s] | integrals [s] | per segment [us] |")
print("|---:|---:|---:|---:|---:|")
for facets in (100, 1000, 10_000, 100_000):
    count, found, integrated = measure(facets)
    print(
        f"| {facets} | {count} | {found:.4f} | {integrated:.5f} | {1e6 * integrated / count:.2f} |"
    )

# Per slave facet:

print("\n| integration | segments | search [us] | integrals [us] |")
print("|---|---:|---:|---:|")
for name, points in (("segments", 5), ("elements", 5), ("elements", 20), ("nodes", 2)):
    count, *seconds = measure(1000, integration=name, points=points)
    per_facet = " | ".join(f"{1e3 * s:.2f}" for s in seconds)
    print(f"| {name}, {points} points | {count / 1000:.2f} | {per_facet} |")
# -
