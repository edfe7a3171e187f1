"""Compiled kernels: loops over numbers that numba compiles once and stores on disk.

A kernel is a plain function of numbers and arrays. Its annotations state the type of every
argument: there is one compiled version, and it can be compiled before it is called. The first call
imports numba, and compiles the kernel and its callees. numba stores the machine code in a folder of
NUMBA_CACHE_DIR, or of the user's cache. The folder is named after all on which machine code
depends: see `find_folder` and `find_kernel_folder`.

With NUMBA_DISABLE_JIT=1 the same source runs as Python: for debuggers and for coverage.
"""

import gc
import logging
import math
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache, update_wrapper
from hashlib import sha256
from importlib import import_module
from multiprocessing import parent_process
from pathlib import Path
from threading import RLock, Thread, local
from time import monotonic
from types import FunctionType, ModuleType
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

# s after which a first call is reported as compiling.
PATIENCE = 1.0
# s between two looks at a thread that compiles.
LOOK = 0.05
# Folders that are retained, those used last: of several versions, settings and checkouts.
MOST_FOLDERS = 8

_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]
_Flags = NDArray[np.bool_]

# Types of arguments. The number counts dimensions. Arrays are contiguous, rows first, and may be
# written to. `Fixed` ones may be read-only; `Strided` ones may be views of other arrays.
Floats1 = Annotated[_Floats, "float64", 1, "C", True]
Floats2 = Annotated[_Floats, "float64", 2, "C", True]
Floats3 = Annotated[_Floats, "float64", 3, "C", True]
Floats4 = Annotated[_Floats, "float64", 4, "C", True]
Floats5 = Annotated[_Floats, "float64", 5, "C", True]
Ints1 = Annotated[_Ints, "int64", 1, "C", True]
Ints2 = Annotated[_Ints, "int64", 2, "C", True]
Flags1 = Annotated[_Flags, "boolean", 1, "C", True]
Flags2 = Annotated[_Flags, "boolean", 2, "C", True]
Flags3 = Annotated[_Flags, "boolean", 3, "C", True]
FixedFloats3 = Annotated[_Floats, "float64", 3, "C", False]
FixedFloats4 = Annotated[_Floats, "float64", 4, "C", False]
FixedInts1 = Annotated[_Ints, "int64", 1, "C", False]
FixedInts2 = Annotated[_Ints, "int64", 2, "C", False]
FixedFlags2 = Annotated[_Flags, "boolean", 2, "C", False]
Strided1 = Annotated[_Floats, "float64", 1, "A", True]
Strided2 = Annotated[_Floats, "float64", 2, "A", True]
Strided3 = Annotated[_Floats, "float64", 3, "A", True]
FixedStrided1 = Annotated[_Floats, "float64", 1, "A", False]
FixedStrided2 = Annotated[_Floats, "float64", 2, "A", False]

_LOCK = RLock()
_THREAD = local()
# Why compiled code could not be stored.
_LOST: list[str] = []


class Kernel:
    """A function that is compiled at its first call, or loaded from disk."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        # numba's dispatcher: for calls from Python, which is stored, and for calls from kernels,
        # whose machine code contains it
        self.compiled: Any = None
        self.inner: Any = None
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        if self.compiled is None:
            if getattr(_THREAD, "plain", False):
                return self.function(*arguments)
            self.compile()
        try:
            return self.compiled(*arguments)
        except TypeError:
            if self.compiled is self.function:
                raise
            return self.call_with_copies(arguments)

    def compile(self) -> None:
        """Compile the kernel and its callees, or load them from disk."""
        if self.compiled is None:
            _run_in_thread(self)

    def call_with_copies(self, arguments: tuple[Any, ...]) -> Any:
        """Call with copies of the arrays that have another type than stated, and copy results back.

        Callers should pass the stated types: copies take time. Raises TypeError for a wrong number
        of dimensions, a type that would lose numbers, and arrays that share memory.
        """
        hints = get_type_hints(self.function, include_extras=True).values()
        copies: list[tuple[Any, Any]] = []
        fitted = [_fit(value, hint, copies) for value, hint in zip(arguments, hints, strict=False)]
        for n, (original, _) in enumerate(copies):
            if any(np.shares_memory(original, other) for other, _ in copies[:n]):
                raise TypeError("two arrays that a kernel may write to share memory")
        result = self.compiled(*fitted)
        for original, copy in copies:
            if original.flags.writeable:
                original[...] = copy
        return result

    @property
    def callees(self) -> dict[str, "Kernel"]:
        """Kernels that it calls, by their names in its module."""
        names = self.function.__globals__
        called = ((name, names.get(name)) for name in self.function.__code__.co_names)
        return {name: value for name, value in called if isinstance(value, Kernel)}


kernel = Kernel
"""Decorator: `@kernel` before a function that loops over numbers."""


def _fit(value: Any, hint: Any, copies: list[tuple[Any, Any]]) -> Any:
    """Return a value with arrays of the stated types; append pairs (array, copy) to `copies`."""
    if _is_record(hint):
        fields = get_type_hints(hint, include_extras=True).values()
        return hint(*(_fit(each, field, copies) for each, field in zip(value, fields, strict=True)))
    if get_origin(hint) is tuple:
        parts = zip(value, get_args(hint), strict=True)
        return tuple(_fit(each, part, copies) for each, part in parts)
    if get_origin(hint) is not Annotated:
        return value
    dtype, dimensions, layout, is_written = hint.__metadata__
    if np.ndim(value) != dimensions:
        raise TypeError(f"a kernel takes an array of {dimensions} dimensions, not {np.ndim(value)}")
    target = np.dtype(np.bool_ if dtype == "boolean" else dtype)
    if not isinstance(value, np.ndarray) or not np.can_cast(value.dtype, target, "same_kind"):
        raise TypeError(
            f"a kernel takes an array of {target}, not {getattr(value, 'dtype', type(value))}"
        )
    array = np.asarray(value, target)
    is_contiguous = layout == "A" or array.flags.c_contiguous
    if not is_contiguous or (is_written and not array.flags.writeable):
        array = np.array(array, order="C")
    if array is not value and is_written:
        copies.append((value, array))
    return array


def _is_record(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, tuple)


def find_type(hint: Any) -> Any:
    """Return the numba type of an annotation."""
    import numba

    types: Any = numba.types
    if _is_record(hint):
        fields = [find_type(each) for each in get_type_hints(hint, include_extras=True).values()]
        if len(set(fields)) == 1:
            return types.NamedUniTuple(fields[0], len(fields), hint)
        return types.NamedTuple(fields, hint)
    if get_origin(hint) is tuple:
        return types.Tuple([find_type(each) for each in get_args(hint)])
    if get_origin(hint) is Annotated:
        dtype, dimensions, layout, is_written = hint.__metadata__
        return types.Array(getattr(types, dtype), dimensions, layout, readonly=not is_written)
    return {bool: types.boolean, int: types.int64, float: types.float64}[hint]


def _compile(kernel: Kernel, dispatchers: list[Any]) -> None:
    """Compile or load a kernel; append numba's dispatchers to a list."""
    import numba

    config: Any = numba.config
    with _LOCK:
        if config.DISABLE_JIT:
            kernel.compiled = kernel.function
        elif kernel.compiled is None:
            with _without_garbage_collection():
                kernel.compiled = _make_dispatcher(kernel, dispatchers)


def _make_dispatcher(kernel: Kernel, dispatchers: list[Any]) -> Any:
    types = _list_types(kernel)
    folder = find_kernel_folder(kernel)
    if folder is None or not _has_code(folder):
        _compile_callees(kernel, dispatchers)
        if folder is not None:
            _remove_old_folders(folder.parent, f"{folder.name.rpartition('-')[0]}-*")
    # a damaged file is removed and replaced; if that fails, the kernel is compiled without a file
    for place in (folder, folder, None):
        dispatcher = _decorate(kernel, place)
        dispatchers.append(dispatcher)
        try:
            dispatcher.compile(types)
            break
        except (
            Exception
        ) as error:  # of numba, LLVM, pickle or the disk: whatever a damaged file leads to
            if dispatcher.signatures:  # compiled, but not stored
                _LOST.append(str(error))
                _report_lost()
                break
            if place is None:
                raise
            _discard(dispatcher, kernel)
    dispatcher.disable_compile()
    return dispatcher


def _list_types(kernel: Kernel) -> tuple[Any, ...]:
    hints = get_type_hints(kernel.function, include_extras=True)
    hints.pop("return", None)
    return tuple(find_type(hint) for hint in hints.values())


def _compile_callees(kernel: Kernel, dispatchers: list[Any]) -> None:
    """Compile the callees for the types that they state, which numba would infer otherwise."""
    for callee in kernel.callees.values():
        _compile_callees(callee, dispatchers)
        if callee.inner is None:
            callee.inner = _decorate(callee, None)
            dispatchers.append(callee.inner)
            callee.inner.compile(_list_types(callee))
            callee.inner.disable_compile()


def _decorate(kernel: Kernel, folder: Path | None) -> Any:
    """Return numba's dispatcher of a copy whose globals are dispatchers; stored in `folder`.

    The callees are compiled before (`_compile_callees`), or not at all if the kernel is on disk.
    """
    import numba

    function: Any = kernel.function
    names = function.__globals__.copy()
    for name, callee in kernel.callees.items():
        names[name] = callee.inner or _decorate(callee, None)
    copy = FunctionType(function.__code__, names, function.__name__, function.__defaults__)
    copy.__qualname__ = function.__qualname__
    if folder is None:
        return numba.njit(error_model="numpy")(copy)
    config: Any = numba.config
    before = config.CACHE_DIR
    config.CACHE_DIR = str(folder)
    try:
        dispatcher = numba.njit(error_model="numpy", cache=True)(copy)
    finally:
        config.CACHE_DIR = before
    if Path(str(dispatcher.stats.cache_path)).is_relative_to(folder):
        return dispatcher
    return _decorate(kernel, None)  # any other place does not depend on what machine code contains


def _discard(dispatcher: Any, kernel: Kernel) -> None:
    """Remove the files of a kernel."""
    place = dispatcher.stats.cache_path
    if place is not None:
        for path in Path(place).glob(f"*.{kernel.function.__name__}-*"):
            with suppress(OSError):
                path.unlink()


@contextmanager
def _without_garbage_collection() -> Iterator[None]:
    """Collect no garbage until the block ends: compiling makes many objects that live."""
    is_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if is_enabled:
            gc.enable()


@cache
def find_folder() -> Path | None:
    """Return the folder of compiled kernels; None if it cannot be written.

    Its name is a hash of this file, of the versions of Python, numba, llvmlite, numpy and casadi,
    of numba's settings and of the processor.
    """
    from tempfile import TemporaryFile

    try:
        name = _hash(list_dependencies())
        root = Path(os.environ.get("NUMBA_CACHE_DIR") or find_user_cache())
        folder = root / f"pulsepath-kernels-{name}"
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        TemporaryFile(dir=folder).close()
    except (OSError, RuntimeError) as error:  # RuntimeError: the user has no home directory
        _LOST.append(str(error))
        return None
    _remove_old_folders(root, "pulsepath-kernels-*")
    return folder


def find_kernel_folder(kernel: Kernel) -> Path | None:
    """Return the folder of a kernel's machine code; None if nothing can be stored.

    Its name is a hash of all that enters the machine code, and of the state of the kernel's file,
    at which numba looks too. So it holds one version: processes that write at once write the same.
    """
    root = find_folder()
    if root is None:
        return None
    file = Path(kernel.function.__code__.co_filename)
    try:
        state = file.stat()
    except OSError:  # no file of its own, as in an archive: numba stores nothing then
        return None
    content = [str(file), state.st_mtime_ns, state.st_size, describe_kernel(kernel)]
    # without packages: some systems allow 260 letters in a path
    module = kernel.function.__module__.rpartition(".")[2]
    return root / f"{module}.{kernel.function.__name__}-{_hash(content)}"


def _hash(content: Any) -> str:
    return sha256(repr(content).encode()).hexdigest()[:16]


def _has_code(folder: Path) -> bool:
    return any(folder.glob("*/*.nbc"))


def describe_kernel(kernel: Kernel) -> list[Any]:
    """Return all that enters the machine code of a kernel: its code, types, constants and callees.

    Raises TypeError for a kernel that reads a module other than numpy and math: a constant of it
    would enter machine code unnoticed.
    """
    function: Any = kernel.function
    code = function.__code__
    names = function.__globals__
    read = [names[name] for name in code.co_names if name in names]
    hints = get_type_hints(function, include_extras=True)
    return [
        [code.co_code, code.co_consts, code.co_names, code.co_varnames, function.__defaults__],
        [_describe_value(value) for value in (*hints.values(), *read)],
    ]


def _describe_value(value: Any) -> Any:
    """Return all that enters machine code of a type, or of a global value that a kernel reads."""
    if isinstance(value, Kernel):
        return describe_kernel(value)
    if _is_record(value):
        fields = get_type_hints(value, include_extras=True)
        return [repr(value), [(name, _describe_value(hint)) for name, hint in fields.items()]]
    if get_origin(value) is tuple:
        return [_describe_value(each) for each in get_args(value)]
    if isinstance(value, np.ndarray):
        return [value.dtype.str, value.shape, value.tobytes()]
    if isinstance(value, ModuleType) and value not in (np, math):
        raise TypeError(
            f"a kernel reads {value.__name__} as a module: import what it needs by name"
        )
    return repr(value)


def list_dependencies() -> list[Any]:
    """List all on which the machine code of every kernel depends."""
    from importlib.metadata import version

    from llvmlite import binding

    settings = {name: value for name, value in os.environ.items() if name.startswith("NUMBA_")}
    settings.pop("NUMBA_CACHE_DIR", None)
    libraries = [version(name) for name in ("numba", "llvmlite", "numpy", "casadi")]
    processor = [binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()]
    return [
        Path(__file__).read_bytes(),
        sys.version,
        libraries,
        processor,
        sorted(settings.items()),
    ]


def find_user_cache() -> Path:
    """Return the user's folder for files that can be made again."""
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "pulsepath"


def _remove_old_folders(root: Path, pattern: str) -> None:
    """Remove the folders used least recently; a process that misses one compiles again."""
    from shutil import rmtree

    folders = []
    for path in root.glob(pattern):
        with suppress(OSError):
            folders.append((path.stat().st_mtime, path))
    for _, path in sorted(folders)[:-MOST_FOLDERS]:
        rmtree(path, ignore_errors=True)


def _run_in_thread(kernel: Kernel) -> None:
    """Compile a kernel in a thread, which no signal can interrupt: that is raised here
    meanwhile.
    """
    dispatchers: list[Any] = []
    failures: list[BaseException] = []

    def run() -> None:
        try:
            _compile(kernel, dispatchers)
        except BaseException as error:
            failures.append(error)

    begin = monotonic()
    thread = Thread(target=run, daemon=True)
    thread.start()
    thread.join(LOOK)
    while thread.is_alive():
        # on a busy computer, loading may take longer than PATIENCE too
        is_late = monotonic() - begin > PATIENCE
        if is_late and any(each.stats.cache_misses for each in list(dispatchers)):
            _announce()
        thread.join(LOOK)
    if failures:
        raise failures[0]


def are_stored(names: Sequence[str]) -> bool:
    """Return whether kernels "MODULE:NAME" are on disk; True if nothing can be stored."""
    folders = [find_kernel_folder(_find_kernel(name)) for name in names]
    return all(folder is None or _has_code(folder) for folder in folders)


def compile_kernels(names: Sequence[str]) -> None:
    """Compile kernels "MODULE:NAME" in this order, or load them from disk."""
    for name in names:
        _find_kernel(name).compile()


def _find_kernel(name: str) -> Kernel:
    module, _, function = name.partition(":")
    kernel: Kernel = getattr(import_module(module), function)
    return kernel


@cache
def _announce() -> None:
    """Report once that kernels are compiled: of several processes, the first reports it."""
    if parent_process() is not None:
        return
    text = (
        f"every run, some 25 s, {_advise()}"
        if _LOST
        else "once for each kind of work, up to 25 s; later runs find them on disk"
    )
    logging.getLogger("pulsepath").warning("compiling numerical kernels: %s", text)


@cache
def _report_lost() -> None:
    logging.getLogger("pulsepath").warning(
        "compiled kernels are lost with this process, %s", _advise()
    )


def _advise() -> str:
    return f"as they cannot be stored ({_LOST[0]}): set NUMBA_CACHE_DIR to a folder that can be written"


def compiler_is_loaded() -> bool:
    """Return whether numba is imported already, which takes a third of a second."""
    return "numba" in sys.modules


def call_light(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a kernel and its callees as Python if the compiler is not loaded.

    Little work does not pay for loading it.
    """
    if compiler_is_loaded() or not isinstance(function, Kernel):
        return function(*arguments)
    _THREAD.plain = True
    try:
        return function.function(*arguments)
    finally:
        _THREAD.plain = False


# A fork waits until no thread compiles: the child would never get the compiler's lock.
if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(
        before=_LOCK.acquire,
        after_in_parent=_LOCK.release,
        after_in_child=_LOCK.release,
    )
