"""Compiled kernels: loops over numbers that numba compiles at their first call and keeps on disk for the next process.

A kernel is a plain function of numbers and arrays. numba is not imported, and nothing compiled, before one is called:
then all kernels of its module are. What is compiled is kept beside the source, in the user's cache directory where that
cannot be written, and nowhere where neither can; where that takes long, the logger "pulsepath" says so, once. With
NUMBA_DISABLE_JIT=1 the same source runs as Python: for debuggers and for coverage.
"""

import logging
import sys
from collections.abc import Callable
from functools import cache, update_wrapper
from threading import RLock, Thread, local
from threading import enumerate as enumerate_threads
from typing import Any

PATIENCE = 1.0
"""s after which the first call of a kernel is said to be compiling: what is on disk takes less."""
COMPILATION = "compilation of kernels"
"""Name of threads in which kernels are called for the first time."""
_LOCK, _HERE = RLock(), local()


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

    def run() -> None:
        try:
            outcome.append(work(*arguments))
        except BaseException as error:
            failure.append(error)

    thread = Thread(target=run, name=COMPILATION, daemon=True)
    thread.start()
    thread.join(PATIENCE)
    if thread.is_alive():
        _announce()
        thread.join()
    if failure:
        raise failure[0]
    return outcome[0]


@cache
def _announce() -> None:
    logging.getLogger("pulsepath").warning("compiling numerical kernels: once, some 30 s; later runs find them on disk")


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


def is_compiling() -> bool:
    """Whether a kernel's first call goes on in a thread, though who called it may have been interrupted."""
    return any(thread.name == COMPILATION for thread in enumerate_threads())


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
            try:
                value.compiled = numba.njit(cache=True, error_model="numpy")(value.function)
            except RuntimeError:  # no place to keep it
                value.compiled = numba.njit(error_model="numpy")(value.function)
        setattr(module, name, value.compiled)
