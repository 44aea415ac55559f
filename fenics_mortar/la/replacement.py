# SPDX-License-Identifier: MIT
"""Choice of the time at which multigrid's cycle is rebuilt.

A cycle built for an earlier matrix needs more iterations. It is replaced when its excess iterations
have cost a quarter of a new one; more are expected where the active set has changed since.

Iterations per digit also depend on the right-hand side. The first one of a load step is smooth and
takes 1.4 per digit, the next ones, which are concentrated at the contact, up to 1.8 even with a new
cycle. A solve is therefore compared with the first one by the same cycle at the same place in
Newton's method; at a place without one, with the slowest of the first ones at other places. Rates
at one place vary by a tenth where only the right-hand side changes, which is not counted: a new
cycle would be no better.
"""

from __future__ import annotations

# Excess iterations, so far and expected, after which the cycle is rebuilt. A new cycle costs as
# much as about twenty iterations but is used in several solves.
MAX_EXCESS = 5
# Excess iterations of a solve over the first one at its place [1] that are not counted: rates vary
# by as much where only the right-hand side changes.
IGNORED_EXCESS = 0.1
# Excess iterations per digit of a cycle made for a different active set, over the share of active
# nodes that have changed since [1]. The cycle for the first three nodes in contact needs 7 to 15
# more iterations for five digits with about a hundred active nodes, however many of them change.
EXCESS_OF_OTHER_SET = 2


class Replacement:
    """Excess iterations of a cycle since it was built; all methods are local."""

    def __init__(self) -> None:
        self._rates = dict[int, float]()  # iterations per digit of the first solve at each place
        self._excess = 0.0

    def is_due(self, changed: float, digits: float) -> bool:
        """Whether a new cycle costs less than the excess iterations, those expected included.

        Args:
            changed: Nodes that have entered or left the contact since the cycle was built, over
                those in contact [1].
            digits: Digits of the next solve [1].
        """
        return self._excess + EXCESS_OF_OTHER_SET * changed * digits > MAX_EXCESS

    def record(self, iterations: int, digits: float, place: int) -> None:
        """Record a solve.

        Args:
            iterations: Linear iterations.
            digits: Decimal logarithm of the factor by which the residual has decreased, positive.
            place: Number of earlier solves in the same load step.
        """
        rate = iterations / digits
        if place in self._rates:
            usual = (1.0 + IGNORED_EXCESS) * self._rates[place]
        else:
            usual = max(self._rates.values(), default=rate)
            self._rates[place] = rate
        excess = self._excess + iterations - usual * digits
        self._excess = max(excess, 0.0)  # a difficult first solve is not credited
