# SPDX-License-Identifier: MIT
"""Conductance of an interface for a scalar field: temperature, potential, concentration, pressure.

``Conductance`` is the law of a flux across a contact, with its terms ``PressureConductance`` and
``GapConductance``; ``NodalFlux`` has the fluxes at the slave nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from dolfinx import fem

from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError, check_number, is_function

# Pressure over the reference pressure [1] below which a power law with an exponent below 1, whose
# slope is infinite at zero, is continued by a parabola with the same value and slope: Newton's
# method needs a finite slope where contact closes. The conductance is then 0.1 % of the reference.
SMALL_PRESSURE = 1e-3


class ConductanceValue(NamedTuple):
    """Conductance and its derivatives, each of shape (slave nodes,) or a scalar.

    Attributes:
        h: Conductance [flux / field].
        by_pressure: Its derivative by the pressure [flux / field / stress].
        by_gap: Its derivative by the gap [flux / field / length].
    """

    h: Any
    by_pressure: Any = 0.0
    by_gap: Any = 0.0


# Function of pressures and gaps, (slave nodes,) each, that returns h, dh/dp and dh/dg.
ConductanceFunction = Callable[[Array, Array], Sequence[Any]]
# Function of pressures (slave nodes,) and undeformed positions (slave nodes, dim) that returns
# power per area and its derivative by pressure.
HeatingFunction = Callable[[Array, Array], Sequence[Any]]


@dataclass(frozen=True)
class ClosedConductance:
    """Constant conductance where contact is closed, zero where it is open.

    Attributes:
        h: The conductance [flux / field].
    """

    h: float

    def __call__(self, pressure: Array, gap: Array) -> ConductanceValue:
        """Conductance at pressures [stress] and gaps [length], (slave nodes,) each (local)."""
        return ConductanceValue(np.where(gap <= 0.0, self.h, 0.0))


class _Smooth:
    """Base of conductances that do not jump where contact closes, of positive numbers."""

    def __post_init__(self) -> None:
        """Check all numbers."""
        for name, value in vars(self).items():
            check_number(name, value, "a positive number", lambda number: number > 0.0)


@dataclass(frozen=True)
class PressureConductance(_Smooth):
    """Conductance of rough surfaces in contact, h (p / p_0)^m; zero where contact is open.

    Below 0.1 % of p_0 a parabola replaces powers m < 1, whose slope is infinite at p = 0.

    Attributes:
        h: Conductance at the reference pressure [flux / field].
        pressure: Reference pressure p_0, such as the hardness [stress].
        exponent: m; 0.95 of plastic contact of asperities (Cooper, Mikic & Yovanovich 1969) [1].

    Raises:
        ValueError: If one of them is not a positive number.
    """

    h: float
    pressure: float
    exponent: float = 0.95

    def __call__(self, pressure: Array, gap: Array) -> ConductanceValue:
        """Conductance at pressures [stress] and gaps [length], (slave nodes,) each (local)."""
        ratio, m = np.maximum(pressure, 0.0) / self.pressure, self.exponent
        start = SMALL_PRESSURE if m < 1.0 else 0.0
        large = np.maximum(ratio, start)
        value, slope = large**m, m * large ** (m - 1.0)
        if start:
            s, small = ratio / start, ratio < start
            value = np.where(small, start**m * s * (2.0 - m + (m - 1.0) * s), value)
            parabola = start ** (m - 1.0) * (2.0 - m + 2.0 * (m - 1.0) * s)
            slope = np.where(small, parabola, slope)
        return ConductanceValue(self.h * value, self.h * slope / self.pressure)


@dataclass(frozen=True)
class GapConductance(_Smooth):
    """Conductance through the medium in a gap, k / (g + g_0), also of closed gaps.

    Attributes:
        conductivity: Conductivity k of the medium [flux length / field].
        distance: Mean distance g_0 of closed rough surfaces, the jump distances of a rarefied gas
            included [length].

    Raises:
        ValueError: If one of them is not a positive number.
    """

    conductivity: float
    distance: float

    def __call__(self, pressure: Array, gap: Array) -> ConductanceValue:
        """Conductance at pressures [stress] and gaps [length], (slave nodes,) each (local)."""
        h = self.conductivity / (gap + self.distance)
        return ConductanceValue(h, 0.0, -h / (gap + self.distance))


class Conductance:
    """Flux of a scalar field across a contact, q = h(p, g) (T_slave - T_master) (local).

    The field is a temperature, potential, concentration or pressure, and h a function of contact
    pressure and gap. Frictional power may be a source on both sides. See ``fluxes`` for the weak
    form.

    The field is a sub-space of the mixed function of the problem. Its equation in the residual must
    be that of a flux per area that leaves the slave, with positive sign of the capacity: for a
    temperature T with test function w, ``k * inner(grad(T), grad(w)) * dx - heat * w * dx``.

    Args:
        field: Number of the scalar field's sub-space in the mixed function; or the function of a
            field that the user solves for in a problem of its own, by the loads and derivatives
            ``problem.matrices.flux_loads`` and ``flux_derivative``.
        h: Conductance [flux / field]: a number, which holds where contact is closed, inf for
            perfect conduction: a jump of zero there, and the flux is a multiplier;
            ``PressureConductance`` or ``GapConductance``; a function of pressures and gaps, arrays
            of shape (slave nodes,), that returns finite h, dh/dp and dh/dg; or a list of these,
            which are added.
        heating: Source at closed contact [flux]: "friction", shear times slip over the length of
            the step, see ``ContactProblem.time``; a function of pressures (slave nodes,) and
            undeformed positions (slave nodes, dim) that returns power per area and its derivative
            by pressure, for sliding that is not resolved: mu p omega r of a brake disc; or
            ``None``.
        share: Fraction of the source that enters the slave, between 0 and 1, the rest enters the
            master: e_s / (e_s + e_m) with effusivities e = sqrt(k rho c) of two half spaces [1].
        temperature: Value of the field on a rigid obstacle, which is the master [field]: a number
            or a constant, whose value may change between solves.

    Attributes:
        scale: Factor of h [1]; 1 unless a study changes it, see ``sensitivity.ConductanceScale``.

    Raises:
        ValueError: If an argument has a value that is not allowed.

    Example:
        Temperature is the second part of a mixed function (displacement, temperature)::

            heat = fm.Conductance(1, fm.PressureConductance(2e4, pressure=10.0))
            pair = fm.ContactPair(data, "pin/outer", "hub/inner", fluxes=[heat])
    """

    def __init__(
        self,
        field: int | fem.Function,
        h: float | ConductanceFunction | Sequence[float | ConductanceFunction],
        *,
        heating: Literal["friction"] | HeatingFunction | None = None,
        share: float = 0.5,
        temperature: float | fem.Constant | None = None,
    ) -> None:
        self.field, self.h, self.scale = field, h, 1.0
        self.heating, self.share, self.temperature = heating, share, temperature

    def __setattr__(self, name: str, value: Any) -> None:
        """Set a value after a check; all but the field take effect in the next solve (local).

        Raises:
            ValueError: If it is not allowed, or the field is set again.
        """
        if name not in _CHECKS or (name == "field" and "field" in vars(self)):
            raise ValueError(f"{name} of {self!r} cannot be set; set up a new problem")
        _CHECKS[name](value)
        super().__setattr__(name, value)

    def __repr__(self) -> str:
        """Field and conductance."""
        return f"Conductance({self.field!r}, {self.h!r})"

    def evaluate(self, pressure: Array, gap: Array, *, finite: bool = False) -> ConductanceValue:
        """Conductance of the slave nodes and its derivatives (local).

        Args:
            pressure: Contact pressure, zero where open, shape (slave nodes,) [stress].
            gap: Mean gap, zero where closed, shape (slave nodes,) [length].
            finite: Whether conduction may not be perfect.

        Raises:
            MortarError: If a conductance is negative, or not a number, or inf of a function.
        """
        sums = np.zeros((3, pressure.size))
        for term in _terms_of(self.h):
            found = term(pressure, gap)
            if not isinstance(found, Sequence) or len(found) != 3:
                raise MortarError(
                    f"h: {term!r} returned {found!r}; expected h, dh/dp and dh/dg for arrays of "
                    "pressures and gaps"
                )
            for total, value in zip(sums, found, strict=True):
                total += value
        bad = ~np.isfinite(sums).all(axis=0) | (sums[0] < 0.0)
        bad &= np.isfinite(pressure) & np.isfinite(gap)  # else an iterate of Newton's method fails
        if self.is_perfect and not finite:
            bad &= ~((sums[0] == np.inf) & np.isfinite(sums[1:]).all(axis=0))
        if bad.any():
            j = int(bad.argmax())
            raise MortarError(
                f"{self!r} is {sums[0, j]:.3g} with slopes {sums[1, j]:.3g} and {sums[2, j]:.3g} "
                f"at the pressure {pressure[j]:.3g} and the gap {gap[j]:.3g}: expected a finite "
                "conductance that is not negative"
            )
        return ConductanceValue(*(self.scale * sums))

    def power(self, pressure: Array, X: Array) -> tuple[Array, Array]:
        """Power per area of a ``heating`` function and its derivative by pressure (local).

        Args:
            pressure: Contact pressure, zero where open, shape (slave nodes,) [stress].
            X: Undeformed positions, shape (slave nodes, dim) [length].

        Returns:
            Power [flux] and derivative [flux / stress], (slave nodes,) each.

        Raises:
            MortarError: If the function returns anything but finite numbers of these shapes.
        """
        assert callable(self.heating)
        found = self.heating(pressure, X.copy())
        if not isinstance(found, Sequence) or len(found) != 2:
            raise MortarError(f"heating returned {found!r}; expected power and its derivative by p")
        power, slope = (np.zeros(pressure.size) + part for part in found)
        if not np.isfinite([power, slope]).all():
            raise MortarError("heating returned power or derivative that is not finite")
        return power, slope

    @property
    def jumps(self) -> bool:
        """Whether the conductance may jump where contact closes, as a number does (local)."""
        return not all(isinstance(term, _Smooth) for term in _terms_of(self.h))

    @property
    def is_perfect(self) -> bool:
        """Whether conduction is perfect where contact is closed (local)."""
        return any(term == ClosedConductance(np.inf) for term in _terms_of(self.h))

    @property
    def on_obstacle(self) -> float:
        """Present value of the field on an obstacle, zero without one [field] (local)."""
        given: Any = 0.0 if self.temperature is None else self.temperature
        return float(given.value if isinstance(given, fem.Constant) else given)


def _check_field(field: Any) -> None:
    """Reject all but numbers of sub-spaces and functions."""
    if not isinstance(field, fem.Function):
        expected = "the number of a sub-space, or a function"
        check_number("field", field, expected, lambda n: n >= 0, whole=True)


def _check_heating(heating: Any) -> None:
    """Reject all but "friction", functions and ``None``."""
    if not (heating in (None, "friction") or is_function(heating)):
        raise ValueError(
            f"heating={heating!r}: expected 'friction', a function of pressures and positions, "
            "or None"
        )


def _check_temperature(temperature: Any) -> None:
    """Reject all but finite numbers, constants and ``None``."""
    if not (temperature is None or isinstance(temperature, fem.Constant)):
        check_number("temperature", temperature, "a number or a constant", np.isfinite)


def _terms_of(h: Any) -> list[ConductanceFunction]:
    """Conductances whose sum is ``h``; numbers are those of closed contact.

    Raises:
        ValueError: If one is no conductance, or negative, or there is none.
    """
    terms = list(h) if isinstance(h, Sequence) and not isinstance(h, str) else [h]
    if not terms:
        raise ValueError("h=[]: expected at least one conductance")
    expected = "a conductance: a number that is at least 0, or a function of pressure and gap"
    for term in terms:
        if not is_function(term):
            check_number("h", term, expected, lambda value: value >= 0.0)
    return [term if is_function(term) else ClosedConductance(float(term)) for term in terms]


_CHECKS: dict[str, Callable[[Any], object]] = {
    "field": _check_field,
    "h": _terms_of,
    "heating": _check_heating,
    "share": lambda v: check_number(
        "share", v, "a fraction between 0 and 1", lambda x: 0 <= x <= 1
    ),
    "scale": lambda v: check_number("scale", v, "a positive number", lambda x: 0 < x < np.inf),
    "temperature": _check_temperature,
}


@dataclass(frozen=True)
class NodalFlux:
    """Flux at the slave nodes of a pair, read-only values; each array has shape (slave nodes,).

    Attributes:
        jump: Mean jump T_slave - T_master, zero at nodes without partner [field].
        conductance: h, zero at nodes without partner [flux / field].
        conduction: Flux by conduction from slave to master [flux].
        heating: Source by friction, power per area [flux].
        into_slave: Total that enters the slave [flux length].
        into_master: Total that enters the master or obstacle [flux length].
    """

    jump: Array
    conductance: Array
    conduction: Array
    heating: Array
    into_slave: float
    into_master: float
