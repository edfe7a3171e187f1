"""Compiled kernels: loops over numbers that numba compiles at their first call and keeps on disk for the next process.

A kernel is a plain function of numbers and arrays. numba is not imported, and nothing compiled, before one is called:
then all kernels of its module are. What is compiled is kept beside the source, in the user's cache directory where that
cannot be written, and nowhere where neither can; where that takes long, the logger "pulsepath" says so, once. It is
found again by all that was frozen into it: see `fingerprint`. With NUMBA_DISABLE_JIT=1 the same source runs as Python:
for debuggers and for coverage.
"""

import logging
import os
import pickle
import sys
from collections.abc import Callable
from contextlib import suppress
from enum import EnumMeta
from functools import cache, update_wrapper
from hashlib import sha256
from multiprocessing import parent_process
from pathlib import Path
from threading import RLock, Thread, local
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

PATIENCE = 1.0
"""s after which the first call of a kernel that is not on disk is said to be compiling."""
KEPT = 24
"""Files of one kernel that are kept, those used last: of several signatures, versions and checkouts."""
_LOCK, _HERE = RLock(), local()
_LOST: list[str] = []  # why something compiled could not be kept
_HELD: list[Any] = []  # numba's lock, during a fork


class Kernel:
    """A function that is compiled at its first call."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.compiled: Callable[..., Any] | None = None
        self._called = False
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        if self.compiled is None:
            if getattr(_HERE, "plain", False):
                return self.function(*arguments)
            with _LOCK:
                _compile_module(sys.modules[self.function.__module__])
        assert self.compiled is not None  # with its module
        if self._called:
            return self.compiled(*arguments)
        outcome = _run_in_thread(self.compiled, arguments)
        self._called = True
        return outcome


def _run_in_thread(work: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """What work returns or raises. The compiler cannot bear what a signal raises: here it is raised beside it."""
    outcome: list[Any] = []
    failure: list[BaseException] = []
    # kernels that are not on disk
    missed = [work] if hasattr(work, "py_func") and not isinstance(getattr(work, "_cache", None), _Store) else []

    def run() -> None:
        _HERE.missed = missed
        try:
            outcome.append(work(*arguments))
        except BaseException as error:
            failure.append(error)

    thread = Thread(target=run, daemon=True)
    thread.start()
    thread.join(PATIENCE)
    while thread.is_alive():  # on a busy computer, what is on disk may take longer too
        if missed or _LOST:
            _announce()
            thread.join()
        thread.join(PATIENCE)
    if failure:
        raise failure[0]
    return outcome[0]


@cache
def _announce() -> None:
    """Said once: of several processes that compile the same, by the first."""
    if parent_process() is not None:
        return
    told = (
        f"every run, some 45 s, {_advise()}"
        if _LOST
        else "once for each kind of work, up to 45 s; later runs find them on disk"
    )
    logging.getLogger("pulsepath").warning("compiling numerical kernels: %s", told)


@cache
def _tell_lost() -> None:
    logging.getLogger("pulsepath").warning("compiled kernels are lost with this process, %s", _advise())


def _advise() -> str:
    return f"as they cannot be kept on disk ({_LOST[0]}): set NUMBA_CACHE_DIR to a folder that can be written"


def compiler_is_loaded() -> bool:
    """Whether numba is imported already, which takes a third of a second."""
    return "numba" in sys.modules


def call_light(function: Callable[..., Any], *arguments: Any) -> Any:
    """A kernel, and what it calls, as Python where the compiler is not loaded: for what is too little to load it."""
    if compiler_is_loaded() or not isinstance(function, Kernel):
        return function(*arguments)
    _HERE.plain = True
    try:
        return function.function(*arguments)
    finally:
        _HERE.plain = False


kernel = Kernel
"""Decorator: `@kernel` before a function that loops over numbers."""


def _compile_module(module: Any) -> None:
    """Puts the compiled functions into the place of a module's kernels, so that they call each other compiled."""
    import numba

    for name, value in list(vars(module).items()):
        if not isinstance(value, Kernel):
            continue
        if value.function.__module__ != module.__name__:
            _compile_module(sys.modules[value.function.__module__])
        elif value.compiled is None:
            value.compiled = numba.njit(error_model="numpy")(value.function)
            if hasattr(value.compiled, "py_func"):  # not with NUMBA_DISABLE_JIT
                _keep(value.compiled)
        setattr(module, name, value.compiled)


def _keep(compiled: Any) -> None:
    """Gives a compiled function its place on disk, where there is one."""
    try:
        compiled._cache = _Store(compiled.py_func)
    except Exception as error:  # no folder that can be written
        _LOST.append(str(error))


class _Store:
    """What was compiled of one kernel, on disk: a file for each fingerprint and signature, in place of numba's files.

    numba's own hold one kernel's source against its file, not what that takes from others, and several processes that
    write at once may mix up their signatures. A file begins with its checksum; one that is damaged is compiled anew.
    """

    def __init__(self, function: Any) -> None:
        from numba.core import caching

        implementation: Any = caching.CompileResultCacheImpl
        self._impl = implementation(function)
        self.cache_path = self._impl.locator.get_cache_path()
        self._name = f"{function.__module__.rpartition('.')[2]}.{function.__qualname__.replace('<locals>', '')}"
        self._function = function

    def _path(self, signature: Any, codegen: Any) -> Path | None:
        if " at 0x" in str(signature):  # a function as an argument: its address tells nothing to another process
            return None
        key = sha256(repr((fingerprint(self._function), str(signature), codegen.magic_tuple())).encode()).hexdigest()
        return Path(self.cache_path) / f"{self._name}-{key[:40]}.kernel"

    def load_overload(self, signature: Any, context: Any) -> Any:
        """What was compiled for a signature, or None."""
        found = self._read(signature, context)
        if found is None:
            getattr(_HERE, "missed", []).append(self._function)
        return found

    def _read(self, signature: Any, context: Any) -> Any:
        context.refresh()
        with suppress(Exception):  # whatever is wrong with a file, it is compiled anew, and replaced
            path = self._path(signature, context.codegen())
            if path is None:
                return None
            content = path.read_bytes()
            if sha256(content[32:]).digest() == content[:32]:
                outcome = self._impl.rebuild(context, pickle.loads(content[32:]))
                with suppress(OSError):
                    os.utime(path)
                return outcome
        return None

    def save_overload(self, signature: Any, outcome: Any) -> None:
        """Keeps what was compiled, where it can be; else says, once, that it is lost."""
        from numba.core import serialize

        dumps: Any = serialize.dumps
        try:
            path = self._path(signature, outcome.codegen)
            if path is None or not self._impl.check_cachable(outcome):
                return
            content = dumps(self._impl.reduce(outcome))
            path.parent.mkdir(parents=True, exist_ok=True)
            part = path.with_suffix(f".{os.getpid()}.part")
            try:
                part.write_bytes(sha256(content).digest() + content)
                part.replace(path)
            finally:
                part.unlink(missing_ok=True)
            self._clear()
        except Exception as error:  # whatever keeps it from being kept: it is compiled, and works
            _LOST.append(str(error))
            _tell_lost()

    def _clear(self) -> None:
        """Removes what was used least lately; a process that misses it compiles it."""
        used: list[tuple[float, Path]] = []
        for path in Path(self.cache_path).glob(f"{self._name}-*"):
            with suppress(OSError):
                used.append((path.stat().st_mtime, path))
        for _, path in sorted(used)[:-KEPT]:
            with suppress(OSError):
                path.unlink()


def fingerprint(function: Any) -> str:
    """Hash of all that is frozen into a kernel's machine code, whichever file it comes from.

    That is its instructions and constants, the values of the global names that it reads, the kernels that it calls with
    theirs, and the versions of Python, numba, llvmlite, numpy and casadi. TypeError: a name stands for something else.
    """
    parts = [_versions()]
    _collect(function, parts, set())
    return sha256("\n".join(parts).encode()).hexdigest()


@cache
def _versions() -> str:
    from importlib.metadata import version

    return repr((sys.version, [version(name) for name in ("numba", "llvmlite", "numpy", "casadi")]))


def _collect(value: Any, parts: list[str], seen: set[int]) -> None:
    """Appends what tells a frozen value from another."""
    import numpy as np

    value = getattr(value, "py_func", value.function if isinstance(value, Kernel) else value)
    if isinstance(value, FunctionType):
        parts.append(f"{value.__module__}.{value.__qualname__}")
        if id(value) not in seen and not value.__module__.startswith(("numpy", "numba")):  # these have versions
            seen.add(id(value))
            cells = tuple(cell.cell_contents for cell in value.__closure__ or ())
            _collect((value.__defaults__, cells), parts, seen)
            _collect_code(value.__code__, value.__globals__, parts, seen)
    elif isinstance(value, (tuple, frozenset)):
        parts.append(f"{type(value).__name__} of {len(value)}")
        for each in value if isinstance(value, tuple) else sorted(value, key=repr):
            _collect(each, parts, seen)
    elif isinstance(value, np.ndarray) and not value.dtype.hasobject:
        parts.append(f"{value.dtype.str} {value.shape} {sha256(value.tobytes()).hexdigest()}")
    elif value is None or value is ... or isinstance(value, (int, float, complex, str, bytes, np.generic)):
        parts.append(f"{type(value).__name__} {value!r}")
    elif isinstance(value, EnumMeta):
        members: Any = value.__members__
        parts.append(repr({name: member.value for name, member in members.items()}))
    elif isinstance(value, (type, BuiltinFunctionType, np.ufunc, ModuleType)) or type(value).__module__ == "numpy":
        parts.append(f"{getattr(value, '__module__', '')} {value.__name__} {getattr(value, '_fields', '')}")
    else:
        raise TypeError(f"a kernel takes {value!r} from outside, of which no fingerprint is known")


def _collect_code(code: CodeType, names: dict[str, Any], parts: list[str], seen: set[int]) -> None:
    parts.append(f"{code.co_code.hex()} {code.co_names} {code.co_varnames} {code.co_freevars}")
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            _collect_code(constant, names, parts, seen)
        else:
            _collect(constant, parts, seen)
    for name in code.co_names:
        if name not in names:
            continue
        value = names[name]
        _collect(value, parts, seen)
        if isinstance(value, ModuleType):
            for attribute in code.co_names:
                if hasattr(value, attribute):
                    _collect(getattr(value, attribute), parts, seen)


def _hold_compiler() -> None:
    """Before a fork: a child of a process whose compiler is at work in a thread would never have it again."""
    _LOCK.acquire()
    module = sys.modules.get("numba.core.compiler_lock")
    held = getattr(module, "global_compiler_lock", None)
    if held is not None:
        held.acquire()
    _HELD.append(held)


def _release_compiler() -> None:
    held = _HELD.pop()
    if held is not None:
        held.release()
    _LOCK.release()


if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
    os.register_at_fork(before=_hold_compiler, after_in_parent=_release_compiler, after_in_child=_release_compiler)
