# SPDX-License-Identifier: MIT
"""Python calls of one Newton iteration, and how often they cross from module to module.

/usr/bin/python3 demos/trace_iteration.py [--functions]

Two blocks, one frictionless pair, 1,300 unknowns; the median of the iterations of a solve. Only
functions of fenics_mortar count, each generator step as one call. With --functions: those that are
called the most.
"""

import sys
from collections import Counter
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / folder) for folder in ("meshes", "tests")]

import numpy as np
from scenes import pressed_blocks

import fenics_mortar as fm

HERE = str(Path(fm.__file__).parent)


class Trace:
    """Counts calls between two calls of ``mark``."""

    def __init__(self):
        self.calls, self.crossings, self.functions = 0, 0, Counter()
        self.stack, self.rows = [""], []

    def __call__(self, frame, event, _):
        """Note a call or a return; the argument of ``sys.setprofile``."""
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


def main():
    scene = pressed_blocks(n_upper=20, n_lower=28)
    problem = scene.problem
    scene.loads["push"].value[1] = -0.01
    problem.solve()
    trace, equations = Trace(), getattr(problem, "equations", problem)
    advance = equations.advance

    def marked():
        trace.mark()
        return advance()

    equations.advance = marked
    scene.loads["push"].value[1] = -0.05
    sys.setprofile(trace)
    report = problem.solve()
    sys.setprofile(None)
    trace.mark()
    rows = trace.rows[1:-1]  # of whole iterations, from one linear system to the next
    calls, crossings = (int(np.median([row[i] for row in rows])) for i in (0, 1))
    print(f"{len(rows) + 1} iterations, {scene.u.x.array.size} unknowns: {report.reason}")
    print(f"an iteration: {calls} Python calls, {crossings} crossings between modules")
    if "--functions" in sys.argv:
        for name, count in rows[-1][2].most_common(40):
            print(f"{count:5d} {name}")


if __name__ == "__main__":
    main()
