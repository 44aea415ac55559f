# SPDX-License-Identifier: MIT
"""Derivatives of a cubic spline by its points, and of the distance from it.

With chords h_i of the points P_i and second derivatives M_i at them, the curve between two points
is, at the fraction s of the parameter, r = 1 - s,

    c = r P_i + s P_{i+1} + h_i^2 / 6 [(r^3 - r) M_i + (s^3 - s) M_{i+1}],

where M solves the equations of continuous slopes, a linear system of the h_i. All of it is
differentiated at fixed s. The distance phi of a point with the foot c changes by -n . dc, n the
normal; this is constant along n, so that its gradient is along the tangent.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve

from fenics_mortar.utils.arrays import Array, Indices


class SplineShape:
    """A cubic spline by chord length, and its derivatives along m changes of its points (local).

    Args:
        points: Points, shape (k, 2) [length].
        closed: Whether the curve is closed; it has zero curvature at its ends otherwise.
    """

    def __init__(self, points: Array, *, closed: bool) -> None:
        self._closed = closed
        self._P = np.vstack([points, points[:1]]) if closed else points
        chords = np.diff(self._P, axis=0)
        self._h = np.linalg.norm(chords, axis=1)
        self._along = chords / self._h[:, None]
        self.knots = np.append(0.0, np.cumsum(self._h))
        self._M = self._bends(self._right_side(self._P, self._h))

    def _right_side(self, P: Array, h: Array) -> Array:
        """Jumps of the slopes of the chords at the equations' points, (..., equations, 2)."""
        slopes = np.diff(P, axis=-2) / h[:, None]
        return self._jumps(slopes)

    def _jumps(self, of_intervals: Array) -> Array:
        """Jumps of interval values at the points with an equation, (..., equations, 2)."""
        if self._closed:
            return of_intervals - np.roll(of_intervals, 1, axis=-2)
        return np.diff(of_intervals, axis=-2)

    def _matrix(self, h: Array) -> Array:
        """Matrix of continuous slopes for chords h (..., k - 1): (..., equations, points)."""
        count = len(self._P)
        before = np.arange(count - 1) - 1 if self._closed else np.arange(count - 2)
        after = np.arange(count - 1) if self._closed else np.arange(1, count - 1)
        rows = np.arange(len(after))
        A = np.zeros((*h.shape[:-1], len(rows), count))
        first = before % (count - 1) if self._closed else before
        A[..., rows, first] += h[..., before] / 6.0
        A[..., rows, after] += (h[..., before] + h[..., after]) / 3.0
        A[..., rows, after + 1] += h[..., after] / 6.0
        return A

    def _bends(self, rhs: Array) -> Array:
        """Second derivatives at the points for right-hand sides (..., equations, 2)."""
        A, count = self._matrix(self._h), len(self._P)
        free = slice(0, count - 1) if self._closed else slice(1, count - 1)
        if self._closed:
            A[:, 0] += A[:, -1]
        flat = np.moveaxis(rhs, -2, 0).reshape(rhs.shape[-2], -1)
        found = solve(A[:, free], flat).reshape(rhs.shape[-2], *rhs.shape[:-2], 2)
        M = np.zeros((*rhs.shape[:-2], count, 2))
        M[..., free, :] = np.moveaxis(found, 0, -2)
        if self._closed:
            M[..., -1, :] = M[..., 0, :]
        return M

    def changes(self, t: Array, directions: Array) -> tuple[Array, Array]:
        """Changes dc and d(dc/dt) at fixed fractions of the intervals, (m, n, 2) each.

        Args:
            t: Parameters, shape (n,) [length]; beyond the ends of an open curve it is straight.
            directions: Changes of the points, shape (m, k, 2) [length].

        Returns:
            dc [length] and its derivative by t [1].
        """
        closed = self._closed
        dP = np.concatenate([directions, directions[:, :1]], axis=1) if closed else directions
        dh = np.einsum("ic,mic->mi", self._along, np.diff(dP, axis=1))
        slopes = np.diff(self._P, axis=0) / self._h[:, None]
        by_h = self._jumps(slopes * (dh / self._h)[..., None])
        rhs = self._right_side(dP, self._h) - by_h - self._matrix(dh) @ self._M
        dM = self._bends(rhs)
        on = t % self.knots[-1] if closed else np.clip(t, 0.0, self.knots[-1])
        i: Indices = np.clip(np.searchsorted(self.knots, on, side="right") - 1, 0, len(dh.T) - 1)
        h, beyond = self._h[i, None], 0.0 if closed else (t - on)[:, None]
        s = ((on - self.knots[i]) / self._h[i])[:, None]
        r, stretch = 1.0 - s, (dh[:, i] / self._h[i])[..., None]
        bends, turned = (r**3 - r) * self._M[i], (s**3 - s) * self._M[i + 1]
        of_bends = (r**3 - r) * dM[:, i] + (s**3 - s) * dM[:, i + 1]
        dc = r * dP[:, i] + s * dP[:, i + 1] + h**2 / 6.0 * of_bends
        dc = dc + h**2 / 3.0 * stretch * (bends + turned)
        slope = (1.0 - 3.0 * r**2) * self._M[i] + (3.0 * s**2 - 1.0) * self._M[i + 1]
        of_slope = (1.0 - 3.0 * r**2) * dM[:, i] + (3.0 * s**2 - 1.0) * dM[:, i + 1]
        dd = (dP[:, i + 1] - dP[:, i]) / h + h / 6.0 * of_slope + h / 3.0 * stretch * slope
        return dc + beyond * dd, dd


def distance_changes(
    normal: Array, curvature: Array, speed: Array, phi: Array, dc: Array, dd: Array
) -> tuple[Array, Array]:
    """Changes of distances phi and of their gradients along m changes of a curve (local).

    Args:
        normal: Normals at the feet, shape (n, 2).
        curvature: Curvatures at the feet, positive to the left, shape (n,) [1 / length].
        speed: Speeds |dc/dt| at the feet, shape (n,) [1].
        phi: Distances, shape (n,) [length].
        dc: Changes of the curve at fixed t, shape (m, n, 2) [length].
        dd: Their derivatives by t, shape (m, n, 2) [1].

    Returns:
        Changes of phi (m, n) [length] and of its gradient (m, n, 2) [1].
    """
    tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    of_slope = np.einsum("nc,mnc->mn", normal, dd) / speed
    along = curvature * np.einsum("nc,mnc->mn", tangent, dc) + of_slope
    change = -along / (1.0 + curvature * phi)
    return -np.einsum("nc,mnc->mn", normal, dc), change[..., None] * tangent
