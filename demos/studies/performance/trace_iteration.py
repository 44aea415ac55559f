# SPDX-License-Identifier: MIT
"""Python calls of one Newton iteration, calls between modules, the way to the first integral.

/usr/bin/python3 -m demos.studies.performance.trace_iteration [--functions]

Two blocks, one frictionless pair, 1,100 unknowns; the median of the iterations of a solve. Only
functions of fenics_mortar are counted, each generator step as one call. With --functions: the most
frequently called functions.
"""

import sys
from collections import Counter
from pathlib import Path

import numpy as np

import fenics_mortar as fm
from demos.studies.performance.scene import pressed, read, size_of
from meshes import two_blocks

# Close to rounding, so that the median is that of several iterations.
TIGHT = fm.NewtonOptions(residual_tolerance=1e-13)
HERE = str(Path(fm.__file__).parent)


class Trace:
    """Counts of calls between two calls of ``mark``."""

    def __init__(self):
        self.calls, self.crossings, self.functions = 0, 0, Counter()
        self.stack, self.rows = [""], []

    def __call__(self, frame, event, _):
        """Record a call or a return; the argument of ``sys.setprofile``."""
        file = frame.f_code.co_filename
        if not file.startswith(HERE):
            return
        if event == "call":
            self.calls += 1
            self.crossings += file != self.stack[-1]
            self.functions[f"{file[len(HERE) + 1 :]}:{frame.f_code.co_name}"] += 1
            self.stack.append(file)
        elif event == "return" and len(self.stack) > 1:
            self.stack.pop()

    def mark(self):
        """End the counts of one iteration."""
        self.rows.append((self.calls, self.crossings, self.functions))
        self.calls, self.crossings, self.functions = 0, 0, Counter()


class Way:
    """The way to the first integral over the interface, and that of the displacement.

    Args:
        u: The displacement, a function of dolfinx.

    Attributes:
        frames: Functions from ``problem.solve`` to the first integral, both included.
        modules: Modules with a function that has u, or an array in its memory, as an argument.
    """

    def __init__(self, u):
        self._u, self.frames, self.modules = u, list[str](), set[str]()

    def __call__(self, frame, event, _):
        """Look at the arguments of a call; the argument of ``sys.setprofile``."""
        file = frame.f_code.co_filename
        if event != "call" or not file.startswith(HERE):
            return
        if not self.frames and frame.f_code.co_name == "integrate_segments":
            self.frames = self._to(frame)
        for value in frame.f_locals.values():
            is_array = isinstance(value, np.ndarray)
            if value is self._u or (is_array and np.may_share_memory(value, self._u.x.array)):
                self.modules.add(file[len(HERE) + 1 :])

    def _to(self, frame):
        found = []
        while frame is not None and "problem.py:solve" not in found:
            if frame.f_code.co_filename.startswith(HERE):
                found.append(f"{frame.f_code.co_filename[len(HERE) + 1 :]}:{frame.f_code.co_name}")
            frame = frame.f_back
        return found[::-1]


def pressed_blocks():
    """Two blocks after the first contact, the constant that moves the upper one, and its next z."""
    data = read(two_blocks.build, n_upper=20, n_lower=28)
    sides = ("lower", "lower/bottom", "lower/top"), ("upper", "upper/top", "upper/bottom")
    problem, top = pressed(data, *sides, degree=3, newton=TIGHT)
    top.value[1] = -0.01
    problem.solve()
    return problem, top, -0.05


def trace_way():
    """The ``Way`` of a load step."""
    problem, top, top.value[1] = pressed_blocks()
    way = Way(problem.equations.bulk.u)
    sys.setprofile(way)
    problem.solve()
    sys.setprofile(None)
    return way


def measure():
    """Trace a solve.

    Returns:
        The report, the problem, the rows of the trace of whole iterations, and the medians of calls
        and crossings.
    """
    problem, top, push = pressed_blocks()
    trace, equations = Trace(), getattr(problem, "equations", problem)
    advance = equations.advance

    def marked():
        trace.mark()
        return advance()

    equations.advance = marked
    top.value[1] = push
    sys.setprofile(trace)
    report = problem.solve()
    sys.setprofile(None)
    trace.mark()
    rows = trace.rows[1:-1]  # of whole iterations, from one linear system to the next
    calls, crossings = (int(np.median([row[i] for row in rows])) for i in (0, 1))
    return report, problem, rows, calls, crossings


def main():
    report, problem, rows, calls, crossings = measure()
    print(f"{len(rows) + 1} iterations, {size_of(problem)} unknowns: {report.reason}")
    print(f"an iteration: {calls} Python calls, {crossings} crossings between modules")
    way = trace_way()
    print(f"{len(way.frames)} frames to the first integral; u passes {len(way.modules)} modules")
    if "--functions" in sys.argv:
        print("\n".join([*way.frames, *sorted(way.modules)]))
        for name, count in rows[-1][2].most_common(40):
            print(f"{count:5d} {name}")


if __name__ == "__main__":
    main()
