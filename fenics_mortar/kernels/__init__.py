# SPDX-License-Identifier: MIT
"""Numba kernels: arrays in, arrays out; no MPI, PETSc, dolfinx or UFL.

Every kernel runs also with ``NUMBA_DISABLE_JIT=1``. Those without comparisons take complex
numbers, so that each derivative can be checked by a complex step. There is no ``fastmath``: it
may drop the inf and nan that indicate a failed projection.
"""

import fcntl
import gc
import hashlib
import logging
import os
import sys
import time
from collections import Counter
from contextlib import suppress
from functools import cache
from pathlib import Path

import numba
from numba import types
from numba.core.caching import FunctionCache
from numba.core.compiler import Compiler

# Time of compilation between two messages on standard error [s].
INTERVAL = 5.0
# Variables in which Open MPI, MPICH and Slurm give the number of the rank: one rank is enough.
RANK = ("OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK", "SLURM_PROCID")


class _Progress:
    """Kernels defined and compiled in this process, and the time that it took.

    Where compilation takes long, as in the first run, standard error says how far it is.
    """

    def __init__(self) -> None:
        self.defined, self._compiled = Counter[str](), set[tuple[str, str]]()
        self._depth, self._began, self._spent, self._next = 0, 0.0, 0.0, INTERVAL
        self._prints = next((os.environ[v] for v in RANK if v in os.environ), "0") == "0"

    def begin(self, function) -> None:
        """The compilation of a kernel begins, perhaps within that of one that calls it."""
        self._compiled.add((_package(function), function.__qualname__))
        if self._depth == 0:
            self._began = time.monotonic()
        self._depth += 1
        seconds = self._spent + time.monotonic() - self._began
        if seconds >= self._next and self._prints:
            self._next = seconds + INTERVAL
            most = sum(self.defined[package] for package in {p for p, _ in self._compiled})
            print(
                f"fenics_mortar: compiling kernel {len(self._compiled)} of at most {most} "
                f"({seconds:.0f} s; later runs load them from the cache)",
                file=sys.stderr, flush=True,
            )  # fmt: skip

    def end(self) -> None:
        """The compilation of a kernel ends."""
        self._depth -= 1
        if self._depth == 0:
            self._spent += time.monotonic() - self._began


_progress = _Progress()


def _package(function):
    """Name of the package of a function: those of the plane and of space are separate."""
    return function.__module__.rpartition(".")[0]


class _NamingCompiler(Compiler):
    """Numba's compiler, which logs the kernels that it compiles at level INFO.

    Kernels that are loaded from the cache are not logged, nor are functions of others.
    """

    def compile_extra(self, func):
        """Log the name of the kernel, and compile it."""
        logging.getLogger("fenics_mortar").info(
            "compiling the kernel %s; later runs load it from the cache", func.__qualname__
        )
        _progress.begin(func)
        try:
            return super().compile_extra(func)
        finally:
            _progress.end()


class _PartCompiler(_NamingCompiler):
    """Compiles a kernel as part of the kernels that call it.

    LLVM optimises it there, with its caller, and there it becomes machine code and is cached. Numba
    alone does both for each kernel in each kernel on the way to the one that Python calls.
    """

    def compile_extra(self, func):
        """Compile the kernel to LLVM's intermediate representation."""
        library = self.state.targetctx.codegen().create_library(func.__qualname__)
        library._optimize_final_module = lambda: None
        library._finalize_final_module = lambda: setattr(library, "_finalized", True)
        self.state.library = library
        self.state.flags.no_compile = True
        result = super().compile_extra(func)._replace(entry_point=object())
        self.state.targetctx.insert_user_function(result.entry_point, result.fndesc, [library])
        return result


class _Lock:
    """Lock on a file, held by a process while it loads machine code, or compiles and saves it."""

    def __init__(self) -> None:
        self._file: int | None = None

    def take(self, path):
        """Wait for other processes; no process waits if the file cannot be locked."""
        with suppress(OSError):
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT, 0o666)
            fcntl.flock(self._file, fcntl.LOCK_EX)

    def release(self):
        """Let another process go on, if this one holds the lock."""
        if self._file is not None:
            os.close(self._file)
            self._file = None


_lock = _Lock()


@cache
def _digest(*paths):
    """Digest of the contents of files, by default those of all kernels of the package."""
    sources = paths or sorted(Path(__file__).parent.rglob("*.py"))
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()


# Numba compares the time of a kernel's own file with that of its machine code, which contains the
# kernels that it calls: after a change of these in another file it would keep the old code.
DIGEST = _digest()


class _ByContents(FunctionCache._impl_class._locator_classes[0]):
    """Folder in NUMBA_CACHE_DIR, named by the contents of the kernels instead of the clone."""

    @classmethod
    def get_suitable_cache_subpath(cls, py_file):
        """Name of the folder, for which numba takes the path of the file."""
        return f"{Path(py_file).parent.name}-{DIGEST[:12]}"


class _Implementation(FunctionCache._impl_class):
    _locator_classes = (_ByContents, *FunctionCache._impl_class._locator_classes[1:])


class _Cache(FunctionCache):
    """Cache of the machine code of a kernel, known by the contents of files instead of times.

    Of processes that need it at the same time, such as all ranks in the first run, one compiles it.
    It is made when the kernel is used: numba then tests whether it can write files, and few kernels
    are used.
    """

    _impl_class = _Implementation

    def __init__(self, function):
        self._function = function

    def __getattr__(self, name):
        """An attribute of numba's cache, which is made now."""
        super().__init__(self._function)
        path = Path(self._function.__code__.co_filename)
        self._cache_file._source_stamp = DIGEST, _digest(path)
        return super().__getattribute__(name)

    def load_overload(self, sig, target_context):
        """Load the machine code; wait for it if another process is compiling it."""
        found = super().load_overload(sig, target_context)
        if found is None:
            self._impl.locator.ensure_cache_path()
            _lock.take(os.path.join(self.cache_path, f"{self._impl.filename_base}.lock"))
            found = super().load_overload(sig, target_context)
        return found


_options = {"error_model": "numpy", "no_cfunc_wrapper": True}
_compiled = numba.njit(pipeline_class=_NamingCompiler, **_options)
_part = numba.njit(no_cpython_wrapper=True, pipeline_class=_PartCompiler, **_options)


def kernel(function):
    """Decorate a function that numba compiles at its first call with each kind of arguments.

    Calls with different constants share one compiled function, which LLVM inlines where it pays;
    numba alone would compile it for each constant. Nothing is compiled for calls from C. Calls from
    kernels use another compiled function than calls from Python. A kernel cannot call itself.
    """
    _progress.defined[_package(function)] += 1
    compiled = _compiled(function)
    if compiled is not function:  # NUMBA_DISABLE_JIT
        compiled._cache, load_or_compile = _Cache(function), compiled.compile

        def compile_alone(signature):
            """Numba's ``compile``, after which processes go on that wait for the machine code.

            Most objects of numba live until the end: looking for dead ones meanwhile takes 10 % of
            a compilation, and 0.03 s of the first loading.
            """
            collects = gc.isenabled()
            gc.disable()
            try:
                return load_or_compile(signature)
            finally:
                if collects:
                    gc.enable()
                _lock.release()

        @cache
        def part():  # of kernels that are compiled: not where they are loaded from the cache
            made = _part(function)
            made.add_overload = lambda result: made.overloads.__setitem__(
                tuple(result.signature.args), result
            )
            return made

        compiled.compile = compile_alone
        compiled.get_call_template = lambda args, kws: part().get_call_template(
            tuple(map(types.unliteral, args)), {k: types.unliteral(v) for k, v in kws.items()}
        )
        compiled.get_overload = lambda signature: part().get_overload(signature)
    return compiled
