# # How long the contact kernels take
#
# Search, integrals and all derivatives of two wavy surfaces that do not match, for growing numbers
# of facets; the median of several runs after the compilation. Run it by itself, without `mpirun`.

# +
import sys
import time
from pathlib import Path

import numpy as np

root = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(root)]
from fenics_mortar.kernels import basis, normals, search, segment

POINTS = np.polynomial.legendre.leggauss(5)
# -


# +
def median(function, repeats=7):
    """Seconds of one call."""
    function()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds))


def measure(facets):
    """Seconds of search and integrals for ``facets`` slave and as many master facets."""
    x = np.stack([np.linspace(0, 1, facets + 1), 0.1 * np.sin(np.linspace(0, 9, facets + 1))], 1)
    m = np.stack(
        [np.linspace(1.01, -0.01, facets + 1), 0.1 * np.sin(np.linspace(9.1, -0.1, facets + 1))], 1
    )
    chain = np.arange(facets + 1)
    slave = master = np.stack([chain[:-1], chain[1:]], axis=1)
    n, dn = np.empty_like(x), np.zeros((facets + 1, 2, 6))
    following = np.append(chain[1:], -1)
    inner = np.zeros(facets + 1, bool)
    normals.tabulate_normals(x, chain - 1, following, inner, normals.OPPOSITE, n, dn)
    find = lambda: search.find_segments((x, n, m), slave, master, 0.5, (0.1, 1e-10))  # noqa: E731
    offsets, masters, end_is_node, _ = find()
    count = masters.size
    nodes = np.repeat(slave, np.diff(offsets), axis=0), master[masters]
    moments = (
        np.empty((count, 2)), np.empty((count, 2, 12)), np.empty((count, 2, 2)),
        np.empty((count, 2, 2, 12)), np.empty((count, 2)), np.empty((count, 2, 12)),
    )  # fmt: skip
    values = (
        np.zeros((facets, 2, 2)), np.empty((count, 2, 2, 12)), np.empty((count, 2, 2)),
        np.zeros((count, 2, 2, 12)), np.zeros((facets, 2)), np.empty((count, 2, 12)),
        np.zeros((facets, 2)),
    )  # fmt: skip
    left, partial = np.full(facets, basis.BOTH), np.zeros(facets, bool)

    def integrate():
        geometry = (x, n, dn, m)
        segment.tabulate_segments(geometry, nodes, end_is_node, POINTS, True, *moments)
        edges = np.diff(x, axis=0)
        own = (edges, left, partial)
        kinds = basis.DUAL, basis.BY_COVER
        basis.tabulate_facets(own, *kinds, offsets, offsets, moments, values)

    return count, median(find), median(integrate)


print("| facets a side | segments | search [s] | integrals [s] | per segment [us] |")
print("|---:|---:|---:|---:|---:|")
for facets in (100, 1000, 10_000, 100_000):
    count, found, integrated = measure(facets)
    print(
        f"| {facets} | {count} | {found:.4f} | {integrated:.5f} | {1e6 * integrated / count:.2f} |"
    )
# -
