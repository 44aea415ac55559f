# SPDX-License-Identifier: MIT
"""The exceptions of the package, raised on all ranks together, and checks of users' options.

``raise_together`` and ``together`` raise an error of one rank on all of them. In checks such as
``check_number`` an error names the option, its value and the expected one; ``refuse_in_space`` is
for features that are not yet available in three dimensions.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

import numpy as np
import numpy.typing as npt

from ufl.core.expr import Expr

if TYPE_CHECKING:
    from mpi4py import MPI


T = TypeVar("T")


class MortarError(Exception):
    """Base class of the exceptions of this package."""


class MeshError(MortarError):
    """A mesh, a physical name or a tag is not suitable."""


class SurfaceError(MortarError):
    """A contact surface is empty, branching, degenerate or used twice."""


class NotConvergedError(MortarError):
    """A solve or path did not converge; ``report`` is its record so far (local).

    The record of a solve whose last part converged, with springs that hold a body, says that it
    failed, and why.

    Args:
        message: Message of the error.
        report: Record of the solve or path.
    """

    def __init__(self, message: str, report: Any) -> None:
        super().__init__(message)
        self.report = report
        if getattr(report, "converged", False):
            report.converged, report.reason = False, message

    def __reduce__(self) -> tuple[Any, ...]:
        """Function and arguments with which a pickle makes it again (local)."""
        return NotConvergedError, (str(self), self.report)


class RaisedElsewhereError(MortarError):
    """A user's function raised an error on another rank.

    That rank has left the call; this error must therefore not be caught to continue.
    """


class NotFiniteError(MortarError):
    """A user's law or signed distance returned nan or infinity for finite arguments."""


def raise_together(comm: MPI.Comm, error: MortarError | NotImplementedError | None) -> None:
    """Raise on all ranks if any rank has an error (collective).

    Args:
        comm: Communicator of the call.
        error: The error found on this rank, or ``None``.

    Raises:
        MortarError, NotImplementedError: The error of the lowest rank that has one, on every rank.
    """
    failed = error is not None
    if failed if comm.size == 1 else comm.allreduce(failed):
        raise next(e for e in comm.allgather(error) if e is not None)


def call_together(comm: MPI.Comm, what: str, call: Callable[[], T]) -> T:
    """Call a user's function; an error on any rank is raised on all ranks (collective).

    Args:
        comm: Communicator of the call.
        what: Description of the function.
        call: The function. If it contains collective calls, it must not raise on some ranks only
            before these.

    Raises:
        Exception: The error of ``call``, on the ranks where it raised.
        MortarError: On the other ranks; the message has rank and error.
    """
    with together(comm, what):
        result = call()
    return result


def leave_together(comm: MPI.Comm, what: str, error: Exception | None) -> None:
    """Raise on all ranks if any rank has an error of any type (collective).

    Args:
        comm: Communicator of the call.
        what: Description of its source.
        error: The error of this rank, or ``None``.

    Raises:
        Exception: ``error``, on ranks that have one.
        MortarError, NotImplementedError: On the other ranks; the same error if it is one of the
            package, otherwise a ``RaisedElsewhereError`` whose message has rank and error.
    """
    common = isinstance(error, (MortarError, NotImplementedError))
    ours = common and not isinstance(error, NotConvergedError)
    message = f"{what} raised on rank {comm.rank}: {type(error).__name__}: {error}"
    shared = error if ours or error is None else RaisedElsewhereError(message)
    everywhere = [other for other in comm.allgather(shared) if other is not None]
    if error is not None and not ours:
        raise error
    if everywhere:
        raise everywhere[0]


@contextmanager
def together(comm: MPI.Comm, what: str) -> Iterator[None]:
    """Context of local checks: an error on one rank is raised on all ranks (collective).

    Args:
        comm: Communicator of the call.
        what: Description of the values checked.

    Raises:
        Exception: See ``leave_together``.
    """
    error = None
    try:
        yield
    except Exception as exception:  # any error: no rank may leave alone
        error = exception
    leave_together(comm, what, error)


def check_same(comm: MPI.Comm, values: Iterable[tuple[str, npt.ArrayLike]]) -> None:
    """Reject numbers that are not equal on all ranks (collective).

    Args:
        comm: Communicator of the call.
        values: Names and numbers of any shape, with equal shapes on all ranks.

    Raises:
        MortarError: On all ranks.
    """
    if comm.size == 1:
        return
    named, error = [(name, np.ravel(value)) for name, value in values], None
    first = comm.bcast([value for _, value in named])
    for (name, mine), other in zip(named, first, strict=True):
        differ = np.flatnonzero((mine != other) & ~(np.isnan(mine) & np.isnan(other)))
        if differ.size:
            error = MortarError(
                f"{name} is {other[differ[0]]:g} on rank 0 and {mine[differ[0]]:g} on rank "
                f"{comm.rank}; all ranks need the same value"
            )
    raise_together(comm, error)


def check_same_texts(comm: MPI.Comm, what: str, values: Mapping[str, Any]) -> None:
    """Reject options of any type that are not equal on all ranks (collective).

    Args:
        comm: Communicator of the call.
        what: Description of the owner of the options.
        values: Options by name. Objects are compared by type and public numbers and strings.

    Raises:
        MortarError: On all ranks.
    """
    if comm.size == 1:
        return
    mine, error = [(name, as_text(value)) for name, value in values.items()], None
    first = comm.bcast(mine)
    for (name, here), (_, there) in zip(mine, first, strict=False):
        if here != there and error is None:
            error = MortarError(
                f"{what}: {name} is {there} on rank 0 and {here} on rank {comm.rank}; all ranks "
                "need the same"
            )
    raise_together(comm, error)


def as_text(value: Any) -> str:
    """Describe a value, equal for equal values and without addresses in memory (local)."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, float, complex, str)):
        return repr(value)
    if isinstance(value, np.ndarray):
        numbers = ", ".join(map(str, value.ravel()[:6].tolist()))
        return f"[{numbers}] of shape {value.shape}, with a sum of {value.sum():.17g}"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{as_text(k)}: {as_text(v)}' for k, v in value.items())}}}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(as_text, value))}]"
    plain = (bool, int, float, str, np.generic, type(None))
    shown = {k: v for k, v in getattr(value, "__dict__", {}).items() if isinstance(v, plain)}
    numbers = ", ".join(f"{k}={as_text(v)}" for k, v in shown.items() if not k.startswith("_"))
    return f"{type(value).__name__}({numbers})"


def format_point(x: npt.NDArray[np.float64] | tuple[float, ...]) -> str:
    """Format a position (dim,) [length] for messages (local)."""
    return f"({', '.join(f'{value + 0.0:.4g}' for value in x)})"


def count_points(comm: MPI.Comm, points: npt.NDArray[np.float64]) -> tuple[int, str]:
    """Count the positions (n, dim) of all ranks, and format the smallest one (collective)."""
    mine = [tuple(map(float, x)) for x in points]
    everything = [x for lowest in comm.allgather(sorted(mine)[:1]) for x in lowest]
    return comm.allreduce(len(mine)), format_point(min(everything)) if everything else "nowhere"


# What is refused at set-up, by a short key; the table of demos/guide/limits.md has these texts.
NOT_IN_SPACE = {
    "thickness": "an out-of-plane thickness",
    "axisymmetric": "axisymmetry, which belongs to plane meshes",
    "cubic": "cells of order 3",
    "integration": "integration over elements or at nodes",
    "vertices": "dual multipliers at vertices (basis='vertices')",
}  # fmt: skip


def refuse_in_space(what: str, detail: str = "", *, needed: bool = True) -> None:
    """Raise the error of a feature that exists in the plane only (local, equal on all ranks).

    Args:
        what: Key of ``NOT_IN_SPACE``.
        detail: What in the user's input needs the feature, to be added to the sentence.
        needed: Whether it does.

    Raises:
        NotImplementedError: If the feature is needed.
    """
    if needed:
        why = f"{NOT_IN_SPACE[what]}{detail and f' ({detail})'}"
        raise NotImplementedError(f"not yet available in three dimensions: {why}")


def check_choice(name: str, value: Any, allowed: Iterable[str]) -> None:
    """Reject all but the allowed values (local).

    Raises:
        ValueError: For another value.
    """
    if not isinstance(value, str) or value not in allowed:
        raise ValueError(f"{name}={value!r}: expected one of {', '.join(allowed)}")


def is_function(value: Any) -> bool:
    """Whether a value is a function of numbers (local).

    Constants, functions and other expressions of UFL are not, although they can be called: a call
    with arrays may not end.
    """
    return callable(value) and not isinstance(value, Expr)


def check_number(
    name: str, value: Any, expected: str, allows: Callable[[Any], bool], *, whole: bool = False
) -> None:
    """Reject values that are not real numbers, not integers or not allowed (local).

    Args:
        name: Name of the option.
        value: Its value.
        expected: Description of an allowed value.
        allows: Whether a number is allowed, as a function; must return false for nan.
        whole: Whether it has to be an integer.

    Raises:
        ValueError: For another value.
    """
    kind = np.asarray(value, object if np.ndim(value) else None).dtype.kind
    if kind not in ("iu" if whole else "iuf") or not allows(value):
        raise ValueError(f"{name}={value!r}: expected {expected}")


def check_lengths(name: str, values: Any, count: int) -> npt.NDArray[np.float64]:
    """Reject all but finite lengths; return them, shape (count,) [length], not copied (local).

    One number is the length at all nodes.

    Raises:
        ValueError: For other values.
    """
    expected = f"expected finite lengths of shape ({count},), one per slave node, or one for all"
    lengths = np.asarray(values)
    if lengths.ndim == 0:
        lengths = np.full(count, lengths)
    if lengths.shape != (count,) or lengths.dtype.kind not in "iuf":
        raise ValueError(f"{name} has shape {lengths.shape}, type {lengths.dtype}: {expected}")
    bad = np.flatnonzero(~np.isfinite(lengths))
    if bad.size:
        raise ValueError(f"{name}[{bad[0]}]={lengths[bad[0]]}: {expected}")
    return lengths.astype(float, copy=False)


def check_flag(name: str, value: Any) -> None:
    """Reject all but ``True`` and ``False`` (local).

    Raises:
        ValueError: For another value.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name}={value!r}: expected True or False")


def check_kind(name: str, value: Any, kind: type | tuple[type, ...], expected: str) -> None:
    """Reject objects of another type (local).

    Args:
        name: Name of the option.
        value: Its value.
        kind: Allowed types.
        expected: Description of an allowed value.

    Raises:
        ValueError: For another value.
    """
    if not isinstance(value, kind):
        raise ValueError(f"{name}={value!r}: expected {expected}")


def parameters_of(given: Any) -> list[str]:
    """Names of the arguments of an object's constructor (local)."""
    found = inspect.signature(type(given)).parameters.values()
    return [p.name for p in found if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)]


def check_no_effect(owner: str, given: Any, names: Iterable[str], cure: str) -> None:
    """Reject attributes that were set although nothing reads them (local).

    Args:
        owner: Description of the object.
        given: The object.
        names: Names that it does not have itself.
        cure: What to do instead.

    Raises:
        ValueError: If the object has one of them.
    """
    found = sorted(vars(given).keys() & set(names))
    if found:
        raise ValueError(f"{found[0]} of {owner} was set, which has no effect: {cure}")


def check_floats(name: str, values: Any) -> npt.NDArray[np.float64]:
    """Copy of an array of real numbers, of any shape [any unit] (local).

    Raises:
        ValueError: If the values are not real numbers.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{name}={values!r}: expected real numbers")
    return np.array(array, float)


def check_finite(name: str, value: Any, expected: str = "a finite number") -> float:
    """A finite number [any unit], which messages call ``expected`` (local).

    Raises:
        ValueError: For other values.
    """
    check_number(name, value, expected, np.isfinite)
    return float(value)


def check_vector(name: str, value: npt.ArrayLike, *dims: int) -> npt.NDArray[np.float64]:
    """Copy of a finite vector [any unit] (local).

    Args:
        name: Name of the option.
        value: Its value.
        dims: Allowed numbers of components; 2 by default.

    Raises:
        ValueError: For other values.
    """
    vector, sizes = check_floats(name, value), dims or (2,)
    if vector.ndim != 1 or vector.size not in sizes or not np.isfinite(vector).all():
        words = " or ".join({2: "two", 3: "three"}[size] for size in sizes)
        raise ValueError(f"{name}={value!r}: expected {words} finite numbers")
    return vector


def check_direction(name: str, value: npt.ArrayLike, dim: int = 3) -> npt.NDArray[np.float64]:
    """The unit vector along a vector that is not zero, shape (dim,) [1] (local).

    Args:
        name: Name of the option.
        value: Its value, of any length.
        dim: Number of its components.

    Raises:
        ValueError: For other values.
    """
    vector = check_vector(name, value, dim)
    if not np.linalg.norm(vector) > 0.0:
        raise ValueError(f"{name} is zero; expected a direction")
    return np.asarray(vector / np.linalg.norm(vector))


def raise_cause(error: BaseException, *notes: str) -> NoReturn:
    """Raise an error with notes, or the interruption that caused it; see ``as_interruption``."""
    interruption = as_interruption(error)
    for note in notes:
        interruption.add_note(note)
    if interruption is error:
        raise error
    raise interruption from error


def as_interruption(error: BaseException) -> BaseException:
    """Return a KeyboardInterrupt for an error that one in compiled code caused (local).

    Numba reports an exception that is set during a call as a SystemError. Any other error is
    returned unchanged.
    """
    cause: BaseException | None = error
    while isinstance(cause, SystemError):
        cause = cause.__cause__ or cause.__context__
    if isinstance(error, SystemError) and isinstance(cause, KeyboardInterrupt):
        return KeyboardInterrupt(*cause.args)
    return error
