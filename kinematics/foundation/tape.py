"""An expression as a tape of operations, run over blocks of points in one compiled loop.

CasADi's virtual machine decides for every point anew what each operation is; here each is decided
once for a block, and its inner loop over the block is compiled for what the processor's vectors
hold. Every operation is that of IEEE arithmetic, in the same order: the values are CasADi's to the
last bit, where both take sines from the same library.
"""

from typing import NamedTuple

import casadi as ca
import numpy as np

from kinematics.foundation.kernels import Floats1, Floats2, Ints1, kernel

BLOCK = 128
"""Points that are run together: enough for what deciding takes, few enough for the cache to hold
their values.
"""

CONST, INPUT, OUTPUT, ASSIGN = ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_ASSIGN
ADD, SUB, MUL, DIV, NEG, INV = ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_NEG, ca.OP_INV
TWICE, SQ, SQRT, SIN, COS = ca.OP_TWICE, ca.OP_SQ, ca.OP_SQRT, ca.OP_SIN, ca.OP_COS
EXP, LOG, FABS, SIGN, ATAN2 = ca.OP_EXP, ca.OP_LOG, ca.OP_FABS, ca.OP_SIGN, ca.OP_ATAN2
ONE_OPERAND = {NEG, INV, TWICE, SQ, SQRT, SIN, COS, EXP, LOG, FABS, SIGN, ASSIGN}
KNOWN = {CONST, INPUT, OUTPUT, ADD, SUB, MUL, DIV, ATAN2} | ONE_OPERAND


class Tape(NamedTuple):
    """Operations (n,) by CasADi's numbers, their operands' slots (n, 2), slots written (n,), and
    constants (n,).

    Inputs read column `first` of x, outputs write column `write` of the values. slots: numbers kept
    for a point.
    """

    operation: Ints1
    first: Ints1
    second: Ints1
    write: Ints1
    constant: Floats1
    slots: int


def make_tape(function: ca.Function) -> Tape | None:
    """The tape of a function of scalar operations; None where it has one that is not known here."""
    count = function.n_instructions()
    operation = np.array([function.instruction_id(k) for k in range(count)], dtype=np.int64)
    if not set(operation.tolist()) <= KNOWN:
        return None
    first, second, write = (np.zeros(count, dtype=np.int64) for _ in range(3))
    constant = np.zeros(count)
    for k, code in enumerate(operation.tolist()):
        read, wrote = function.instruction_input(k), function.instruction_output(k)
        if code == ca.OP_CONST:
            constant[k] = function.instruction_constant(k)
        elif code == ca.OP_INPUT:
            first[k] = read[1]
        else:
            first[k], second[k] = read[0], read[-1]
        write[k] = wrote[1] if code == ca.OP_OUTPUT else wrote[0]
    return Tape(operation, first, second, write, constant, int(function.sz_w()))


@kernel
def run_tape(tape: Tape, x: Floats2, out: Floats2) -> None:
    """Fill out (N, m) for x (N, k)."""
    count, work = len(x), np.empty((tape.slots, BLOCK))
    for start in range(0, count, BLOCK):
        size = min(BLOCK, count - start)
        for k in range(len(tape.operation)):
            code = tape.operation[k]
            if code == INPUT:
                c, column = work[tape.write[k]], tape.first[k]
                for n in range(size):
                    c[n] = x[start + n, column]
                continue
            if code == OUTPUT:
                a, column = work[tape.first[k]], tape.write[k]
                for n in range(size):
                    out[start + n, column] = a[n]
                continue
            a, b, c = work[tape.first[k]], work[tape.second[k]], work[tape.write[k]]
            if code == MUL:
                for n in range(size):
                    c[n] = a[n] * b[n]
            elif code == ADD:
                for n in range(size):
                    c[n] = a[n] + b[n]
            elif code == SUB:
                for n in range(size):
                    c[n] = a[n] - b[n]
            elif code == DIV:
                for n in range(size):
                    c[n] = a[n] / b[n]
            elif code == SQ:
                for n in range(size):
                    c[n] = a[n] * a[n]
            elif code == NEG:
                for n in range(size):
                    c[n] = -a[n]
            elif code == TWICE:
                for n in range(size):
                    c[n] = 2 * a[n]
            elif code == CONST:
                value = tape.constant[k]
                for n in range(size):
                    c[n] = value
            elif code == INV:
                for n in range(size):
                    c[n] = 1 / a[n]
            elif code == SQRT:
                for n in range(size):
                    c[n] = np.sqrt(a[n])
            elif code == SIN:
                for n in range(size):
                    c[n] = np.sin(a[n])
            elif code == COS:
                for n in range(size):
                    c[n] = np.cos(a[n])
            elif code == EXP:
                for n in range(size):
                    c[n] = np.exp(a[n])
            elif code == LOG:
                for n in range(size):
                    c[n] = np.log(a[n])
            elif code == FABS:
                for n in range(size):
                    c[n] = abs(a[n])
            elif code == SIGN:
                for n in range(size):
                    c[n] = 1.0 if a[n] > 0 else (-1.0 if a[n] < 0 else a[n])
            elif code == ATAN2:
                for n in range(size):
                    c[n] = np.arctan2(a[n], b[n])
            elif code == ASSIGN:
                for n in range(size):
                    c[n] = a[n]
