"""A tape run in Taylor models: what `kinematics.foundation.taylor_model.Series` does, in one
compiled loop over cells.

Every operation is that of `Series`, with the same balls in the same order, so that both give the
same numbers to the last bit but for sines, of which either library is trusted to two units in the
last place. A value is kept as coefficients (order + 1, BLOCK) with the degree up to which they are
not zero.
"""

import casadi as ca
import numpy as np

from kinematics.foundation.kernels import Floats2, Floats3, Ints1, kernel
from kinematics.foundation.tape import (
    ADD,
    ASSIGN,
    ATAN2,
    CONST,
    COS,
    DIV,
    EXP,
    FABS,
    INPUT,
    INV,
    LOG,
    MUL,
    NEG,
    OUTPUT,
    SIGN,
    SIN,
    SQ,
    SQRT,
    SUB,
    TWICE,
    Tape,
)
from kinematics.foundation.taylor_model import EPS

BLOCK, MOST_BLOCKS = 32, 8
"""Cells that are run together, and how many times as many where they have one coefficient only."""
LEFT_TO_SERIES = {EXP, LOG}


def is_enclosable(function: ca.Function) -> bool:
    """Whether every operation of a tape is known here."""
    return not LEFT_TO_SERIES & {
        function.instruction_id(k) for k in range(function.n_instructions())
    }


@kernel
def lower_degrees(mid: Floats3, rad: Floats3, degrees: Ints1) -> None:
    """Lower degrees (k,) to the highest power of mid and rad (k, order + 1, N) that is there, each
    at least 0.
    """
    for k in range(len(degrees)):
        top, there = degrees[k] + 1, False
        while top > 1 and not there:
            top -= 1
            for n in range(mid.shape[2]):
                if not (mid[k, top, n] == 0 and rad[k, top, n] == 0):
                    there = True
                    break
        degrees[k] = top if there else 0


@kernel
def enclose_tape(
    tape: Tape,
    order: int,
    degrees: Ints1,
    mid: Floats3,
    rad: Floats3,
    out_mid: Floats3,
    out_rad: Floats3,
) -> None:
    """Fill out_mid and out_rad (m, order + 1, N) for inputs mid and rad (k, order + 1, N) of
    degrees (k,).
    """
    count, size = mid.shape[2], len(tape.operation)
    spare, block = 6, BLOCK * max(MOST_BLOCKS // (order + 1), 1)
    m = np.zeros((tape.slots + spare, order + 1, block))
    r = np.zeros((tape.slots + spare, order + 1, block))
    far, error = np.zeros((order + 1, block)), np.zeros((order + 1, block))
    degree = np.zeros(tape.slots + spare, np.int64)
    s0 = tape.slots
    for start in range(0, count, block):
        width = min(block, count - start)
        for k in range(size):
            code, a, b, c = tape.operation[k], tape.first[k], tape.second[k], tape.write[k]
            if code == INPUT:
                degree[c] = degrees[a]
                for i in range(degree[c] + 1):
                    for n in range(width):
                        m[c, i, n], r[c, i, n] = mid[a, i, start + n], rad[a, i, start + n]
            elif code == OUTPUT:
                for i in range(order + 1):
                    inside = i <= degree[a]
                    for n in range(width):
                        out_mid[c, i, start + n] = m[a, i, n] if inside else 0.0
                        out_rad[c, i, start + n] = r[a, i, n] if inside else 0.0
            elif code == CONST:
                _fill(m[c], r[c], tape.constant[k], width)
                degree[c] = 0
            elif code in (ADD, SUB):
                _add(m, r, degree, a, b, c, 1.0 if code == ADD else -1.0, width)
            elif code in (MUL, SQ, TWICE, FABS):
                if code == TWICE:
                    b = s0 + 1
                    _fill(m[b], r[b], 2.0, width)
                    degree[b] = 0
                elif code == FABS:
                    b = s0 + 1
                    _sign(m, r, degree, a, b, width)
                _multiply(m, r, degree, a, b, c, s0, order, far, error, width)
            elif code in (DIV, INV):
                top = a
                if code == INV:
                    top = s0 + 1
                    _fill(m[top], r[top], 1.0, width)
                    degree[top] = 0
                _divide(m, r, degree, top, a if code == INV else b, c, s0, order, far, error, width)
            elif code in (NEG, ASSIGN):
                degree[c] = degree[a]
                for i in range(degree[a] + 1):
                    for n in range(width):
                        m[c, i, n], r[c, i, n] = (
                            -m[a, i, n] if code == NEG else m[a, i, n],
                            r[a, i, n],
                        )
            elif code == SQRT:
                _root(m, r, degree, a, c, s0, order, width)
            elif code in (SIN, COS):
                _sincos(m, r, degree, a, c, s0, order, code == SIN, width)
            elif code == SIGN:
                _sign(m, r, degree, a, c, width)
            elif code == ATAN2:
                _atan2(m, r, degree, a, b, c, s0, order, far, error, width)


@kernel
def _fill(mid: Floats2, rad: Floats2, value: float, width: int) -> None:
    for n in range(width):
        mid[0, n], rad[0, n] = value, 0.0


@kernel
def _add(
    m: Floats3, r: Floats3, degree: Ints1, a: int, b: int, c: int, sign: float, width: int
) -> None:
    top = max(degree[a], degree[b])
    for i in range(top + 1):
        for n in range(width):
            x = m[a, i, n] if i <= degree[a] else 0.0
            y = m[b, i, n] if i <= degree[b] else 0.0
            own = r[a, i, n] if i <= degree[a] else 0.0
            own += r[b, i, n] if i <= degree[b] else 0.0
            value = x + sign * y
            m[c, i, n] = value
            r[c, i, n] = own * (1 + EPS) + EPS * abs(value)
    degree[c] = top


@kernel
def _multiply(
    m: Floats3,
    r: Floats3,
    degree: Ints1,
    a: int,
    b: int,
    c: int,
    spare: int,
    order: int,
    far: Floats2,
    error: Floats2,
    width: int,
) -> None:
    """c = a b, through the spare slot: c may be a or b."""
    few, many = (a, b) if degree[a] <= degree[b] else (b, a)
    if degree[few] == 0:
        nothing = True
        for n in range(width):
            nothing = nothing and m[few, 0, n] == 0 and r[few, 0, n] == 0
        for i in range(degree[many] + 1):
            for n in range(width):
                nothing = nothing and np.isfinite(r[many, i, n])
        if nothing:
            _fill(m[c], r[c], 0.0, width)
            degree[c] = 0
            return
    top = min(degree[few] + degree[many], order)
    terms = degree[few] + 1
    mid, rad = m[spare], r[spare]
    for i in range(top + 1):
        for n in range(width):
            mid[i, n] = rad[i, n] = 0.0
    for i in range(degree[many] + 1):
        for n in range(width):
            size = abs(m[many, i, n])
            error[i, n] = r[many, i, n] + terms * EPS * size
            far[i, n] = size + r[many, i, n]
    for j in range(degree[few] + 1):
        for i in range(min(degree[many], order - j) + 1):
            for n in range(width):
                mid[i + j, n] += m[few, j, n] * m[many, i, n]
                rad[i + j, n] += abs(m[few, j, n]) * error[i, n]
                rad[i + j, n] += r[few, j, n] * far[i, n]
    for i in range(top + 1):
        for n in range(width):
            m[c, i, n], r[c, i, n] = mid[i, n], rad[i, n] * (1 + (terms + 4) * EPS)
    degree[c] = top


@kernel
def _invert(mid: float, rad: float) -> tuple[float, float]:
    """1/ball; radius ∞ where the ball contains zero."""
    near, reach = abs(mid) - rad, abs(mid) + rad
    if not near > 0:
        return 0.0, np.inf
    high, low = 1 / near, 1 / reach
    return np.sign(mid) * (high + low) / 2, (high - low) / 2 * (1 + 4 * EPS) + 4 * EPS * high


@kernel
def _scale_ball(mid: float, rad: float, by: float, by_rad: float) -> tuple[float, float]:
    value = mid * by
    error = abs(mid) * by_rad + rad * (abs(by) + by_rad)
    if np.isnan(error):  # 0 · ∞: the ball of an undefined quotient stays unbounded
        error = np.inf
    return value, error * (1 + 4 * EPS) + EPS * abs(value)


@kernel
def _convolve(
    am: Floats2, ar: Floats2, a_degree: int, bm: Floats2, br: Floats2, b_degree: int, k: int, n: int
) -> tuple[float, float]:
    """Coefficient k of a·b at cell n from the coefficients that both have."""
    first, last = max(0, k - b_degree), min(k, a_degree)
    if first > last:
        return 0.0, 0.0
    total = size = error = 0.0
    for j in range(first, last + 1):
        x, y = am[j, n], bm[k - j, n]
        product = x * y
        total += product
        size += abs(product)
        error += abs(x) * br[k - j, n] + ar[j, n] * (abs(y) + br[k - j, n])
    terms = last - first + 1
    return total, (error + terms * EPS * size) * (1 + (terms + 2) * EPS)


@kernel
def _divide(
    m: Floats3,
    r: Floats3,
    degree: Ints1,
    a: int,
    b: int,
    c: int,
    spare: int,
    order: int,
    far: Floats2,
    error: Floats2,
    width: int,
) -> None:
    """c = a / b: q_k = (a_k − Σ_{j<k} q_j b_{k−j}) / b_0."""
    over = spare + 2
    for n in range(width):
        m[over, 0, n], r[over, 0, n] = _invert(m[b, 0, n], r[b, 0, n])
    degree[over] = 0
    if degree[b] == 0:
        _multiply(m, r, degree, a, over, c, spare, order, far, error, width)
        return
    mid, rad = m[spare], r[spare]
    for k in range(order + 1):
        for n in range(width):
            value = m[a, k, n] if k <= degree[a] else 0.0
            own = r[a, k, n] if k <= degree[a] else 0.0
            if k > 0:
                part, part_rad = _convolve(mid, rad, k - 1, m[b], r[b], degree[b], k, n)
                value -= part
                own = (own + part_rad) * (1 + EPS) + EPS * abs(value)
            mid[k, n], rad[k, n] = _scale_ball(value, own, m[over, 0, n], r[over, 0, n])
    for k in range(order + 1):
        for n in range(width):
            m[c, k, n], r[c, k, n] = mid[k, n], rad[k, n]
    degree[c] = order


@kernel
def _root(
    m: Floats3, r: Floats3, degree: Ints1, a: int, c: int, spare: int, order: int, width: int
) -> None:
    """r_k = (a_k − Σ_{0<j<k} r_j r_{k−j}) / (2 r_0)."""
    mid, rad = m[spare], r[spare]
    for n in range(width):
        low = np.sqrt(np.maximum(m[a, 0, n] - r[a, 0, n], 0.0))
        high = np.sqrt(np.maximum(m[a, 0, n] + r[a, 0, n], 0.0))
        mid[0, n] = (low + high) / 2
        rad[0, n] = (high - low) / 2 * (1 + EPS) + 2 * EPS * high
        if m[a, 0, n] + r[a, 0, n] < 0:
            rad[0, n] = np.inf  # the root of nothing real
        half, half_rad = _invert(2 * mid[0, n], 2 * rad[0, n])
        for k in range(1, order + 1):
            value = m[a, k, n] if k <= degree[a] else 0.0
            own = r[a, k, n] if k <= degree[a] else 0.0
            if k > 1:
                part, part_rad = _convolve(
                    mid[1:], rad[1:], k - 2, mid[1:], rad[1:], k - 2, k - 2, n
                )
                value -= part
                own = (own + part_rad) * (1 + EPS) + EPS * abs(value)
            mid[k, n], rad[k, n] = _scale_ball(value, own, half, half_rad)
    for k in range(order + 1):
        for n in range(width):
            m[c, k, n], r[c, k, n] = mid[k, n], rad[k, n]
    degree[c] = order


@kernel
def _derive(m: Floats3, r: Floats3, degree: Ints1, a: int, c: int, width: int) -> None:
    """c = da/dτ."""
    if degree[a] == 0:
        _fill(m[c], r[c], 0.0, width)
        degree[c] = 0
        return
    for k in range(1, degree[a] + 1):
        for n in range(width):
            value = k * m[a, k, n]
            m[c, k - 1, n] = value
            r[c, k - 1, n] = k * r[a, k, n] * (1 + EPS) + EPS * abs(value)
    degree[c] = degree[a] - 1


@kernel
def _sincos(
    m: Floats3,
    r: Floats3,
    degree: Ints1,
    a: int,
    c: int,
    spare: int,
    order: int,
    sine: bool,
    width: int,
) -> None:
    """k s_k = Σ j θ_j c_{k−j},  k c_k = −Σ j θ_j s_{k−j}, with j from 1 to k."""
    rate, s, t = spare + 1, spare + 2, spare + 3
    top = order if degree[a] > 0 else 0
    for n in range(width):
        angle, own = m[a, 0, n], r[a, 0, n]
        up, over = np.sin(angle), np.cos(angle)
        # second-order bound, and never more than the whole range; libm is trusted to two units in
        # the last place
        m[s, 0, n], m[t, 0, n] = up, over
        r[s, 0, n] = np.minimum(abs(over) * own + own**2 / 2, 2.0) * (1 + 4 * EPS) + 4 * EPS
        r[t, 0, n] = np.minimum(abs(up) * own + own**2 / 2, 2.0) * (1 + 4 * EPS) + 4 * EPS
    if top > 0:
        _derive(m, r, degree, a, rate, width)
    for k in range(1, top + 1):
        for n in range(width):
            up, up_rad = _convolve(m[rate], r[rate], degree[rate], m[t], r[t], k - 1, k - 1, n)
            down, down_rad = _convolve(m[rate], r[rate], degree[rate], m[s], r[s], k - 1, k - 1, n)
            m[s, k, n], r[s, k, n] = up / k, (up_rad / k + EPS * abs(up)) * (1 + EPS)
            m[t, k, n], r[t, k, n] = -down / k, (down_rad / k + EPS * abs(down)) * (1 + EPS)
    found = s if sine else t
    for k in range(top + 1):
        for n in range(width):
            m[c, k, n], r[c, k, n] = m[found, k, n], r[found, k, n]
    degree[c] = top


@kernel
def _sign(m: Floats3, r: Floats3, degree: Ints1, a: int, c: int, width: int) -> None:
    """±1, locally constant; unbounded where a_0 may be zero."""
    for n in range(width):
        value, own = m[a, 0, n], r[a, 0, n]
        m[c, 0, n], r[c, 0, n] = np.sign(value), 0.0 if abs(value) > own else np.inf
    degree[c] = 0


@kernel
def _atan2(
    m: Floats3,
    r: Floats3,
    degree: Ints1,
    y: int,
    x: int,
    c: int,
    spare: int,
    order: int,
    far: Floats2,
    error: Floats2,
    width: int,
) -> None:
    """θ̇ = (x ẏ − y ẋ)/(x² + y²); unbounded where zero or the cut may be met."""
    first, second, third, start = spare + 1, spare + 3, spare + 4, spare + 5
    for n in range(width):
        up, over, up_rad, over_rad = m[y, 0, n], m[x, 0, n], r[y, 0, n], r[x, 0, n]
        away, own = np.hypot(up, over) * (1 - 2 * EPS), np.hypot(up_rad, over_rad) * (1 + 2 * EPS)
        met = own >= away or (over <= over_rad and abs(up) <= up_rad and over < 0)
        m[start, 0, n] = np.arctan2(up, over)
        # asin(t) ≤ t/√(1 − t²); libm is trusted to two units in the last place
        r[start, 0, n] = (
            np.inf if met else own / np.sqrt((away - own) * (away + own)) * (1 + 8 * EPS) + 8 * EPS
        )
    if order > 0:
        low = order - 1  # of what is derived
        _derive(m, r, degree, y, first, width)
        _multiply(m, r, degree, x, first, first, spare, low, far, error, width)
        _derive(m, r, degree, x, second, width)
        _multiply(m, r, degree, y, second, second, spare, low, far, error, width)
        _add(m, r, degree, first, second, first, -1.0, width)
        _multiply(m, r, degree, x, x, second, spare, order, far, error, width)
        _multiply(m, r, degree, y, y, third, spare, order, far, error, width)
        _add(m, r, degree, second, third, second, 1.0, width)
        _divide(m, r, degree, first, second, third, spare, low, far, error, width)
        for k in range(degree[third] + 1):
            for n in range(width):
                value = m[third, k, n] / (k + 1)
                m[c, k + 1, n] = value
                r[c, k + 1, n] = r[third, k, n] / (k + 1) * (1 + EPS) + EPS * abs(value)
        degree[c] = degree[third] + 1
    else:
        degree[c] = 0
    for n in range(width):
        m[c, 0, n], r[c, 0, n] = m[start, 0, n], r[start, 0, n]
