"""One CasADi expression, evaluated in compiled code on batches, or walked through in guaranteed
arithmetic.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cached_property
from threading import Lock
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import compiler_is_loaded
from kinematics.foundation.operations import refuse_unknown, rewrite
from kinematics.foundation.tape import Tape, make_tape, run_tape
from kinematics.foundation.taylor_model import Series
from kinematics.foundation.taylor_tape import enclose_tape, is_enclosable, lower_degrees

# Greedy block sizes: one call of the virtual machine evaluates a whole block without leaving
# compiled code.
_BLOCKS = (256, 16, 1)

# Points from which the compiled tape runs them in less time than CasADi, operations times points
# from which that pays for making the tape, and for loading the compiler where nobody has yet.
TAPE_POINTS, TAPE_WORK, LOADING_WORK = 12, 1e5, 2e8
# Fewer cells are enclosed by numpy if nobody has loaded the compiler. Both give the same bits,
# since a tape runs that many cells in one block.
FEW_CELLS = 8
# Operations times cells of a single call from which `enclose_without_compiler` uses the compiler
# after all: numpy would need as long as loading it takes.
MUCH_WORK = 5e6
_WITHOUT_COMPILER = ContextVar("without_compiler", default=False)

T = TypeVar("T")


@contextmanager
def enclose_without_compiler() -> Iterator[None]:
    """Enclose in numpy until the block ends, unless a call has much work.

    For short work: loading the compiler and its first kernel takes 0.3 s. The radii may differ from
    compiled ones in their last digits, so the choice must depend on the work alone, never on what
    the process has loaded.
    """
    token = _WITHOUT_COMPILER.set(True)
    try:
        yield
    finally:
        _WITHOUT_COMPILER.reset(token)


class Expression:
    """A function of one column of inputs, x (k,) -> values (m,); called on (N, k) it returns (N,
    m).

    The input is handed to CasADi as it lies in memory: time first is column-major for CasADi, so
    nothing is copied twice. Operations are those of `kinematics.foundation.operations`; others have
    values alone.
    """

    def __init__(self, name: str, inputs: ca.SX, outputs: ca.SX) -> None:
        self._set_function(
            rewrite(
                ca.Function(name, [ca.vec(inputs)], [ca.densify(ca.vec(outputs))], {"cse": True})
            )
        )

    def _set_function(self, function: ca.Function) -> None:
        self.function = function
        self.size = int(self.function.size1_in(0)), int(self.function.size1_out(0))
        self._operations, self._work = int(self.function.n_instructions()), 0
        self._lock = Lock()
        self._alive: list[object] = []  # `run` holds raw pointers into these
        self._blocks: dict[int, tuple[Array, Array, Callable[[], None]]] = {}

    def select_rows(self, rows: Sequence[int]) -> "Expression":
        """The same of some of its values, without the work for the others."""
        x = ca.SX.sym("x", self.size[0])
        return Expression(self.function.name(), x, self.function(x)[list(rows)])

    def __getstate__(self) -> ca.Function:
        return self.function  # the rest is made from it, or cannot leave the process

    def __setstate__(self, function: ca.Function) -> None:
        self._set_function(function)

    def __call__(self, x: Array) -> Array:
        rows, out = len(x), np.empty((len(x), self.size[1]))
        if self._pays_for_tape(rows) and self._tape is not None:
            run_tape(self._tape, np.ascontiguousarray(x, dtype=float), out)
            return out
        done = 0
        with self._lock:  # the blocks' memory is shared by all callers
            for size in _BLOCKS:
                while rows - done >= size:
                    arguments, results, run = self._block(size)
                    arguments[:] = x[done : done + size]
                    run()
                    out[done : done + size] = results
                    done += size
        return out

    def _pays_for_tape(self, rows: int) -> bool:
        """Whether so many points more are worth a tape, after all that there were before."""
        work = rows * self._operations
        if not compiler_is_loaded():
            return work >= LOADING_WORK
        self._work += work  # of several threads' only one may count
        return rows >= TAPE_POINTS and self._work >= TAPE_WORK

    def _block(self, size: int) -> tuple[Array, Array, Callable[[], None]]:
        if size not in self._blocks:
            mapped = self.function.map(size)
            buffer, run = mapped.buffer()
            arguments, results = np.zeros((size, self.size[0])), np.zeros((size, self.size[1]))
            buffer.set_arg(0, memoryview(arguments))  # type: ignore[call-arg, arg-type]  # CasADi's stubs miss this overload
            buffer.set_res(0, memoryview(results))  # type: ignore[call-arg, arg-type]  # and this one
            self._alive += [mapped, buffer]
            self._blocks[size] = (arguments, results, run)
        return self._blocks[size]

    @cached_property
    def _tape(self) -> Tape | None:
        return make_tape(self.function)

    @cached_property
    def _program(self) -> list[tuple[int, tuple[int, ...], tuple[int, ...], float]]:
        f = self.function
        steps = []
        for k in range(f.n_instructions()):
            operation = f.instruction_id(k)
            constant = f.instruction_constant(k) if operation == ca.OP_CONST else 0.0
            steps.append(
                (operation, tuple(f.instruction_input(k)), tuple(f.instruction_output(k)), constant)
            )
        return steps

    def enclose(self, x: Sequence[Series]) -> list[Series]:
        """The same expression in Taylor series with guaranteed error: k series in, m series out."""
        order = x[0].order
        if self._pays_to_compile(_cells(x)) and all(one.order == order for one in x):
            return self._enclose_compiled(x, order)
        return self._enclose_by_walking(x, order)

    def enclose_columns(self, *x: Series) -> Series:
        """The same of series (d+1, N, j) that hold the k inputs side by side: as one (order+1, N,
        m).
        """
        order, cells = min(one.order for one in x), max(one.mid.shape[1] for one in x)
        if not self._pays_to_compile(cells):
            columns = [_lower(one.cut(order)[:, k]) for one in x for k in range(one.mid.shape[2])]
            stacked = Series.stack(self._enclose_by_walking(columns, order))
            shape = (
                stacked.degree + 1,
                cells,
                self.size[1],
            )  # what is constant is so on every cell
            return Series(
                np.broadcast_to(stacked.mid, shape), np.broadcast_to(stacked.rad, shape), order
            )
        assert self._tape is not None  # enclosable
        mid, rad = (np.zeros((self.size[0], order + 1, cells)) for _ in range(2))
        last = 0
        for one in x:
            first, last, powers = last, last + one.mid.shape[2], min(one.degree, order) + 1
            mid[first:last, :powers] = one.mid[:powers].transpose(2, 0, 1)
            rad[first:last, :powers] = one.rad[:powers].transpose(2, 0, 1)
        degrees = np.full(self.size[0], order)
        lower_degrees(mid, rad, degrees)
        found, error = (np.zeros((self.size[1], order + 1, cells)) for _ in range(2))
        enclose_tape(self._tape, order, degrees, mid, rad, found, error)
        return Series(found.transpose(1, 2, 0), error.transpose(1, 2, 0), order)

    def _pays_to_compile(self, cells: int) -> bool:
        if _WITHOUT_COMPILER.get():
            pays = self._operations * cells >= MUCH_WORK
        else:
            pays = cells >= FEW_CELLS or compiler_is_loaded()
        return pays and self._is_enclosable

    @cached_property
    def _is_enclosable(self) -> bool:
        return self._tape is not None and is_enclosable(self.function)

    def _enclose_compiled(self, x: Sequence[Series], order: int) -> list[Series]:
        assert self._tape is not None  # enclosable
        mid, rad = (np.zeros((len(x), order + 1, _cells(x))) for _ in range(2))
        degrees = np.array([min(one.degree, order) for one in x])
        for k, one in enumerate(x):
            mid[k, : degrees[k] + 1], rad[k, : degrees[k] + 1] = (
                one.mid[: order + 1],
                one.rad[: order + 1],
            )
        found, error = (np.zeros((self.size[1], order + 1, mid.shape[2])) for _ in range(2))
        enclose_tape(self._tape, order, degrees, mid, rad, found, error)
        return [Series(*both, order) for both in zip(found, error, strict=True)]

    def _enclose_by_walking(self, x: Sequence[Series], order: int) -> list[Series]:
        # an unbounded ball may turn into nan: both read as "no bound"
        with np.errstate(invalid="ignore", over="ignore"):
            return self.walk(x, lambda value: Series.constant(np.array([value]), order))

    def walk(self, x: Sequence[T], constant: Callable[[float], T]) -> list[T]:
        """The same expression, operation by operation, in another arithmetic: k values in, m
        out.
        """
        work: dict[int, T] = {}
        out = [constant(0.0)] * self.size[1]
        for operation, read, write, value in self._program:
            if operation == ca.OP_INPUT:
                work[write[0]] = x[read[1]]
            elif operation == ca.OP_OUTPUT:
                out[write[1]] = work[read[0]]
            elif operation == ca.OP_CONST:
                work[write[0]] = constant(value)
            elif operation in _RULES:
                work[write[0]] = _RULES[operation](*(work[k] for k in read))
            else:
                refuse_unknown(self.function)
        return out


def _lower(x: Series) -> Series:
    """Return a series without its highest powers that are zero, as `lower_degrees` counts them."""
    present = np.flatnonzero((x.mid != 0).any(1) | (x.rad != 0).any(1))
    top = int(present[-1]) if len(present) else 0
    return Series(x.mid[: top + 1], x.rad[: top + 1], x.order)


def _cells(x: Sequence[Series]) -> int:
    """How many cells series (d + 1, N) span: of constants one."""
    return max(int(one.mid.shape[1]) for one in x)


# What an arithmetic of enclosures has to know.
_RULES: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_NEG: lambda a: -a,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: lambda a, b: a / b,
    ca.OP_INV: lambda a: 1.0 / a,
    ca.OP_TWICE: lambda a: a * 2.0,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_SQRT: lambda a: a.sqrt(),
    ca.OP_SIN: lambda a: a.sincos()[0],
    ca.OP_COS: lambda a: a.sincos()[1],
    ca.OP_EXP: lambda a: a.exp(),
    ca.OP_LOG: lambda a: a.log(),
    ca.OP_FABS: lambda a: a * a.sign(),
    ca.OP_SIGN: lambda a: a.sign(),
    ca.OP_ATAN2: lambda y, x: y.atan2(x),
}
