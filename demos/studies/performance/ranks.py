# # Speed-up by ranks, their communication, and a simulation of a thousand ranks
#
# The blocks of `newton.py`, first with a fixed number of unknowns (strong scaling), then with a
# fixed number on each rank (weak scaling). Run it on each number of ranks:
#
#     for n in 1 2 4 8; do mpirun -n $n python3 -m demos.studies.performance.ranks 40_000; done
#
# With more ranks than cores times are meaningless; force and iterations must be those of one rank.
# Calls and bytes are those of one Newton iteration, counted in the communicator of the surfaces; a
# load step has more evaluations than solves: "bytes, in total" is the sum per iteration.
#
# The tables for up to a thousand ranks are simulated, not run: the deformed interface is refined,
# the bodies are cut into squares of equal size, and the data that the busiest rank stores and
# receives in one Newton iteration are counted. "Now": every rank has both surfaces. "Ghosted": a
# rank has its own slave nodes, the next ones of others, and the master facets whose boxes touch its
# own. A collective call is counted as 2 log2(ranks) messages.

# +
import sys
import time

from mpi4py import MPI

import numpy as np

from demos.studies.performance.scene import comm, size_of, two_pressed_blocks

STEPS = 3
DOFS = int(next(iter(sys.argv[1:]), 40_000))
LENGTHS, AREA = (1.0, 2.2), 3.2  # of slave and master, of both bodies together
RADIUS = 2.0  # largest distance of a master facet from a slave facet paired with it [slave facets]
# -


class Counting:
    """A communicator that counts calls and bytes of arrays."""

    def __init__(self, inner):
        self.inner, self.calls, self.bytes = inner, 0, 0

    def __getattr__(self, name):
        """Attributes that are not counted."""
        return getattr(self.inner, name)

    def _count(self, array):
        self.calls += 1
        self.bytes += array.nbytes

    def Allreduce(self, send, receive, *more):
        """Count, then call."""
        self._count(receive)
        return self.inner.Allreduce(send, receive, *more)

    def Allgatherv(self, send, receive):
        """Count, then call."""
        self._count(receive[0])
        return self.inner.Allgatherv(send, receive)

    def allreduce(self, value, *more):
        """Count, then call."""
        self._count(np.asarray(value))
        return self.inner.allreduce(value, *more)


def show(line):
    if comm.rank == 0:
        print(line, flush=True)


# +
def bytes_of(contact, S, M):
    """Bytes by the formula for numbers of nodes, with outlines in the same proportion as here."""
    nodes = contact.slave.num_nodes + contact.master.num_nodes
    outline = len(contact.evaluation.sight.outline.X) / nodes
    return 72 * S + 16 * M + 16 * outline * (S + M)


def measure(kind, dofs):
    """Print a row; return the problem."""
    problem, _, top = two_pressed_blocks(dofs, solver="iterative")
    problem.solve()
    contact, counting = (
        problem.equations.contacts[0],
        Counting(problem.equations.contacts[0].slave.comm),
    )
    for part in (contact.slave, contact.master, contact.evaluation.sight.outline):
        object.__setattr__(part, "comm", counting)
    problem.equations.evaluate(start=True)
    counting.calls = counting.bytes = 0
    problem.equations.advance()
    problem.equations.evaluate(start=False)
    calls, sent = counting.calls, counting.bytes
    counting.calls = counting.bytes = 0
    iterations, clock, cpu, phases = 0, 0.0, 0.0, 0.0
    for _ in range(STEPS):
        top.value[0] += 0.5 / contact.slave.num_nodes
        comm.barrier()
        start = time.perf_counter(), time.process_time()
        report = problem.solve()
        clock += time.perf_counter() - start[0]
        cpu += comm.allreduce(time.process_time() - start[1], MPI.MAX)
        seconds = report.total_seconds()
        phases += seconds["search"] + seconds["integrals"]
        iterations += report.num_iterations
    segments = comm.allgather(contact.operators.segments.num_segments)
    sent_now = bytes_of(contact, contact.slave.num_nodes, contact.master.num_nodes)
    cells = [kind, f"{comm.size}", f"{size_of(problem)}"]
    cells += [f"{iterations}", *(f"{1e3 * t / iterations:.1f}" for t in (clock, cpu, phases))]
    least, most = (100 * share / sum(segments) for share in (min(segments), max(segments)))
    cells += [f"{least:.1f} to {most:.1f}", f"{calls}", f"{sent}", f"{sent_now:.0f}"]
    cells += [f"{counting.bytes / iterations:.0f}", f"{contact.total_force[1]:.9f}"]
    show(f"| {' | '.join(cells)} |")
    return problem, calls, sent / sent_now


titles = ["scaling", "ranks", "dofs", "iterations", "clock [ms]", "CPU [ms]"]
titles += ["search, integrals [ms]", "segments of a rank [%]", "calls", "bytes"]
titles += ["72 S + 16 M + 16 B", "bytes, in total", "force"]
show(f"per Newton iteration\n\n| {' | '.join(titles)} |\n|{'---:|' * len(titles)}")
measure("weak", DOFS * comm.size)
problem, CALLS, FACTOR = measure("strong", DOFS)
contact = problem.equations.contacts[0]
# -

# ## A thousand ranks


# +
def refined(x, count):
    """A number of nodes along a curve (n, 2)."""
    places = np.linspace(0.0, len(x) - 1.0, count)
    return np.stack([np.interp(places, np.arange(len(x)), c) for c in x.T], axis=1)


def branches(count, length, ranks):
    """First and last node (count,) of each of the squares along a surface."""
    side = np.sqrt(AREA / ranks)
    parts = min(ranks, max(1, round(length / side)))
    bounds = np.arange(parts + 1) * (count - 1) // parts
    return bounds[:-1], bounds[1:] + 1


def bytes_in_memory():
    """Measured memory of one slave node, one master node and one segment."""
    o, per = contact.operators, []
    for surface, arrays in (
        (contact.slave, (o.x, o.n, o.dn, o.gap, o.cover, o.weight, o.diagonal, contact.z)),
        (contact.master, (o.m,)),
    ):
        own = (surface.X, surface.facets, surface.previous, surface.following)
        own += (surface.nodes, surface.owners, surface.dofs)
        per.append(sum(array.nbytes for array in own + arrays) / surface.num_nodes)
    s = o.segments
    arrays = (o.D, o.M, o.dD, o.dM, o.dgap, s.slave, s.master, s.ends, s.points, s.weights, s.pairs)
    segments = max(s.num_segments, 1)
    return *per, sum(array.nbytes for array in arrays) / segments


def ghosts(x, m, ranks):
    """For each rank along the slave: owned nodes, needed nodes of other ranks, and these ranks."""
    reach = RADIUS * np.linalg.norm(np.diff(x, axis=0), axis=1).max()
    starts, ends = branches(len(m), LENGTHS[1], ranks)
    rows = []
    for first, last in zip(*branches(len(x), LENGTHS[0], ranks), strict=True):
        box = x[first:last].min(axis=0) - reach, x[first:last].max(axis=0) + reach
        low, high = np.minimum(m[:-1], m[1:]), np.maximum(m[:-1], m[1:])
        touched = np.flatnonzero(((high >= box[0]) & (low <= box[1])).all(axis=1))
        needed = np.unique([touched, touched + 1])
        sides = (first > 0) + (last < len(x))
        partners = ((ends > needed[0]) & (starts <= needed[-1])).sum() + sides
        rows.append((last - first, 2 * sides, needed.size, partners))
    return np.array(rows).max(axis=0)


def simulate(dofs):
    """Print the storage and communication of the busiest rank."""
    k = round(np.sqrt(dofs / 6))
    x, m = refined(contact.operators.x, k + 1), refined(contact.operators.m, 2 * k + 1)
    S, M, segments = len(x), len(m), 2 * k  # about two segments to a slave facet
    slave, master, segment = bytes_in_memory()
    strip = problem.equations.system.solver.multigrid._strip.num_rows / (
        contact.slave.num_nodes + contact.master.num_nodes
    )
    show(f"\n{dofs:.0e} dofs: S = {S}, M = {M}, {strip * (S + M):.0f} dofs in the strip\n")
    show("| ranks | now: memory [MB] | bytes | messages | strip: bytes per linear iteration "
        "| ghosted: ranks at the interface | memory [MB] | bytes | messages |")  # fmt: skip
    show("|" + "---:|" * 9)
    for ranks in (1, 10, 100, 1000):
        now = S * slave + M * master + segments / ranks * segment
        own, other, needed, partners = ghosts(x, m, ranks)
        at = len(branches(S, LENGTHS[0], ranks)[0])
        ghosted = (own + other) * slave + needed * master + segments / at * segment
        # positions and forces of master nodes; positions, forces, sums of slave nodes of others
        sent = 32 * needed * (ranks > 1) + 80 * other
        sent_now = FACTOR * bytes_of(contact, S, M) * (ranks > 1)
        cells = [f"{ranks}", f"{now / 1e6:.1f}", f"{sent_now:.0f}"]
        cells += [f"{CALLS * 2 * np.ceil(np.log2(ranks)):.0f}"]
        cells += [f"{8 * strip * (S + M) * (ranks > 1):.0f}"]
        cells += [f"{at}", f"{ghosted / 1e6:.1f}", f"{sent}", f"{4 * partners * (ranks > 1)}"]
        show(f"| {' | '.join(cells)} |")


if comm.size == 1:
    for dofs in (1e6, 1e9):
        simulate(dofs)
# -
