"""Truncated Taylor series with guaranteed error: ball arithmetic on the coefficients.

A series holds, for every entry of an array, the coefficients c_0 … c_d of c_k τ^k, each as a ball
|c_k − mid_k| ≤ rad_k. The balls enclose the exact coefficients: the error of the arguments and the
rounding of every operation are carried along. Underflow is not: no length or angle that matters
comes near 1e-290. Recurrences of automatic differentiation: Moore, Kearfott, Cloud, Introduction to
Interval Analysis (2009), chapter 9. Balls (midpoint and radius): Rump, Acta Numerica 19 (2010),
section 5.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import atan2, cos, sin

import numpy as np

from kinematics.foundation.arrays import Array

# Twice the unit roundoff: covers the rounding of the operation itself and of the radius that bounds
# it.
EPS = 2.0**-52

Ball = tuple[Array, Array]


def times(a: Ball, b: Ball) -> Ball:
    mid = a[0] * b[0]
    rad = np.abs(a[0]) * b[1] + a[1] * (np.abs(b[0]) + b[1])
    with np.errstate(invalid="ignore"):
        rad = np.where(
            np.isnan(rad), np.inf, rad
        )  # 0 · ∞: the ball of an undefined quotient stays unbounded
    return mid, rad * (1 + 4 * EPS) + EPS * np.abs(mid)


def minus(a: Ball, b: Ball) -> Ball:
    mid = a[0] - b[0]
    return mid, (a[1] + b[1]) * (1 + EPS) + EPS * np.abs(mid)


def inverse(mid: Array, rad: Array) -> Ball:
    """1/ball; radius ∞ where the ball contains zero."""
    near, far = np.abs(mid) - rad, np.abs(mid) + rad
    safe = near > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        high, low = 1 / np.where(safe, near, 1.0), 1 / np.where(safe, far, 1.0)
    middle = np.sign(mid) * (high + low) / 2
    return np.where(safe, middle, 0.0), np.where(
        safe, (high - low) / 2 * (1 + 4 * EPS) + 4 * EPS * high, np.inf
    )


@dataclass(frozen=True, slots=True)
class Series:
    """Coefficients `mid` ± `rad`, both (degree+1, …), known up to τ^order.

    What is made of several series is known as far as the one that is known least.
    """

    mid: Array
    rad: Array
    order: int

    __array_ufunc__ = None  # so that ndarray * Series comes here

    @staticmethod
    def constant(values: Array | float, order: int) -> Series:
        mid = np.asarray(values, float)[None]
        return Series(mid, np.zeros_like(mid), order)

    @staticmethod
    def stack(parts: Sequence[Series]) -> Series:
        """Series (d+1, N) side by side: (d+1, N, len(parts)), known as far as all of them are."""
        order = min(part.order for part in parts)
        parts = [part if part.degree <= order else part.cut(order) for part in parts]
        degree = max(part.degree for part in parts)
        padded = [part.pad(degree) for part in parts]
        shape = np.broadcast_shapes(*(part.mid.shape for part in padded))
        return Series(
            np.stack([np.broadcast_to(part.mid, shape) for part in padded], -1),
            np.stack([np.broadcast_to(part.rad, shape) for part in padded], -1),
            order,
        )

    def cut(self, order: int) -> Series:
        """The same, known up to τ^order at most."""
        return Series(self.mid[: order + 1], self.rad[: order + 1], min(self.order, order))

    @staticmethod
    def zeros(order: int, shape: tuple[int, ...]) -> Series:
        """All coefficients zero, up to τ^order: to be filled by `put`."""
        return Series(np.zeros((order + 1, *shape)), np.zeros((order + 1, *shape)), order)

    def put(self, rows: np.ndarray, values: Series) -> None:
        """Write entries while a series is being put together."""
        full = values.pad(self.degree)
        self.mid[:, rows], self.rad[:, rows] = full.mid, full.rad

    @property
    def degree(self) -> int:
        return len(self.mid) - 1

    def pad(self, degree: int) -> Series:
        missing = degree - self.degree
        if missing <= 0:
            return self
        zeros = np.zeros((missing, *self.mid.shape[1:]))
        return Series(
            np.concatenate([self.mid, zeros]), np.concatenate([self.rad, zeros]), self.order
        )

    def __getitem__(self, key: object) -> Series:
        """Entries of the array, every coefficient kept."""
        index = (slice(None), *(key if isinstance(key, tuple) else (key,)))
        return Series(self.mid[index], self.rad[index], self.order)

    def _other(self, other: Series | Array | float) -> Series:
        if isinstance(other, Series):
            return other
        values = np.asarray(other, float)
        missing = self.mid.ndim - 1 - values.ndim
        return Series.constant(values.reshape((1,) * missing + values.shape), self.order)

    def __neg__(self) -> Series:
        return Series(-self.mid, self.rad, self.order)

    def __add__(self, other: Series | Array | float) -> Series:
        other = self._other(other)
        order = min(self.order, other.order)
        degree = min(max(self.degree, other.degree), order)
        a, b = self.pad(degree), other.pad(degree)
        mid = a.mid[: degree + 1] + b.mid[: degree + 1]
        rad = a.rad[: degree + 1] + b.rad[: degree + 1]
        rad *= 1 + EPS
        size = np.abs(mid)
        size *= EPS
        rad += size
        return Series(mid, rad, order)

    __radd__ = __add__

    def __sub__(self, other: Series | Array | float) -> Series:
        return self + -self._other(other)

    def __rsub__(self, other: Array | float) -> Series:
        return self._other(other) + -self

    def __mul__(self, other: Series | Array | float) -> Series:
        """Cauchy product: c_k = Σ a_j b_{k−j}."""
        few, many = sorted((self, self._other(other)), key=lambda series: series.degree)
        order = min(few.order, many.order)
        entries = np.broadcast_shapes(few.mid.shape[1:], many.mid.shape[1:])
        if few.degree == 0 and not (few.mid.any() or few.rad.any()) and np.isfinite(many.rad).all():
            return Series(
                np.zeros((1, *entries)), np.zeros((1, *entries)), order
            )  # what follows stays short
        degree = min(few.degree + many.degree, order)
        shape = (degree + 1, *entries)
        terms = few.degree + 1
        mid, rad, part = np.zeros(shape), np.zeros(shape), np.empty(shape)
        size, far = np.abs(few.mid), np.abs(many.mid)
        error = (
            many.rad + terms * EPS * far
        )  # of a factor, and of rounding the sum that its products stand in
        far += many.rad
        for j in range(min(few.degree, order) + 1):
            n = min(many.degree, order - j) + 1
            here = slice(j, j + n)
            mid[here] += np.multiply(few.mid[j], many.mid[:n], out=part[:n])
            rad[here] += np.multiply(size[j], error[:n], out=part[:n])
            rad[here] += np.multiply(few.rad[j], far[:n], out=part[:n])
        rad *= 1 + (terms + 4) * EPS
        return Series(mid, rad, order)

    __rmul__ = __mul__

    def __truediv__(self, other: Series | Array | float) -> Series:
        """q_k = (a_k − Σ_{j<k} q_j b_{k−j}) / b_0; unbounded where b_0 may vanish."""
        other = self._other(other)
        order = min(self.order, other.order)
        one_over = inverse(other.mid[0], other.rad[0])
        if other.degree == 0:
            return self * Series(one_over[0][None], one_over[1][None], order)
        top = self.pad(order)
        out = Series.zeros(order, np.broadcast_shapes(self.mid.shape[1:], other.mid.shape[1:]))
        for k in range(order + 1):
            known = (top.mid[k], top.rad[k])
            if k:
                known = minus(known, _convolve(_head(out, k), other, k))
            out.mid[k], out.rad[k] = times(known, one_over)
        return out

    def __rtruediv__(self, other: Array | float) -> Series:
        return self._other(other) / self

    def sqrt(self) -> Series:
        """r_k = (a_k − Σ_{0<j<k} r_j r_{k−j}) / (2 r_0); unbounded where a_0 may be ≤ 0."""
        out = Series.zeros(self.order, self.mid.shape[1:])
        top = self.pad(self.order)
        low, high = (
            np.sqrt(np.maximum(top.mid[0] - top.rad[0], 0.0)),
            np.sqrt(np.maximum(top.mid[0] + top.rad[0], 0.0)),
        )
        out.mid[0] = (low + high) / 2
        out.rad[0] = (high - low) / 2 * (1 + EPS) + 2 * EPS * high
        out.rad[0] = np.where(
            top.mid[0] + top.rad[0] < 0, np.inf, out.rad[0]
        )  # the root of nothing real
        half = inverse(2 * out.mid[0], 2 * out.rad[0])
        inside = Series(out.mid[1:], out.rad[1:], self.order)
        for k in range(1, self.order + 1):
            known = (top.mid[k], top.rad[k])
            if k > 1:
                head = _head(inside, k - 1)
                known = minus(known, _convolve(head, head, k - 2))
            out.mid[k], out.rad[k] = times(known, half)
        return out

    def sincos(self) -> tuple[Series, Series]:
        """k s_k = Σ j θ_j c_{k−j},  k c_k = −Σ j θ_j s_{k−j}, with j from 1 to k."""
        order = self.order if self.degree else 0
        shape = self.mid.shape[1:]
        sine, cosine = (
            Series(np.zeros((order + 1, *shape)), np.zeros((order + 1, *shape)), self.order)
            for _ in range(2)
        )
        angle = np.where(np.isfinite(self.mid[0]), self.mid[0], np.nan)
        sines = _call_libm(sin, angle)
        cosines = _call_libm(cos, angle)
        for out, value, slope in ((sine, sines, cosines), (cosine, cosines, sines)):
            out.mid[0] = value
            # second-order bound, and never more than the whole range; libm is trusted to two units
            # in the last place
            out.rad[0] = (
                np.minimum(np.abs(slope) * self.rad[0] + self.rad[0] ** 2 / 2, 2.0) * (1 + 4 * EPS)
                + 4 * EPS
            )
        rate = self.derivative()
        for k in range(1, order + 1):
            up, down = (
                _convolve(rate, _head(cosine, k), k - 1),
                _convolve(rate, _head(sine, k), k - 1),
            )
            sine.mid[k], sine.rad[k] = up[0] / k, (up[1] / k + EPS * np.abs(up[0])) * (1 + EPS)
            cosine.mid[k], cosine.rad[k] = (
                -down[0] / k,
                (down[1] / k + EPS * np.abs(down[0])) * (1 + EPS),
            )
        return sine, cosine

    def sign(self) -> Series:
        """±1, locally constant; unbounded where a_0 may be zero."""
        side = np.sign(self.mid[:1])
        return Series(side, np.where(np.abs(self.mid[:1]) > self.rad[:1], 0.0, np.inf), self.order)

    def atan2(self, x: Series) -> Series:
        """θ of self = r sin θ, x = r cos θ: θ̇ = (x ẏ − y ẋ)/(x² + y²); unbounded where zero or the
        cut may be met.
        """
        order = min(self.order, x.order)
        up, over = self.mid[0], x.mid[0]
        away, error = (
            np.hypot(up, over) * (1 - 2 * EPS),
            np.hypot(self.rad[0], x.rad[0]) * (1 + 2 * EPS),
        )
        met = (error >= away) | ((over <= x.rad[0]) & (np.abs(up) <= self.rad[0]) & (over < 0))
        with np.errstate(divide="ignore", invalid="ignore"):
            # asin(t) ≤ t/√(1 − t²); libm is trusted to two units in the last place
            rad = error / np.sqrt((away - error) * (away + error)) * (1 + 8 * EPS) + 8 * EPS
        start = Series(_call_libm(atan2, up, over)[None], np.where(met, np.inf, rad)[None], order)
        return start._integrate_rate(
            ((x * self.derivative()) - (self * x.derivative())) / (x * x + self * self)
        )

    def exp(self) -> Series:
        """k e_k = Σ j a_j e_{k−j}, with j from 1 to k."""
        out = Series.zeros(self.order, self.mid.shape[1:])
        out.mid[0] = np.exp(self.mid[0])
        # libm is trusted to two units in the last place
        out.rad[0] = out.mid[0] * (np.expm1(self.rad[0]) * (1 + 8 * EPS) + 8 * EPS)
        for k in range(1, self.order + 1):
            mid, rad = _convolve(self.derivative(), _head(out, k), k - 1)
            out.mid[k], out.rad[k] = mid / k, (rad / k + EPS * np.abs(mid)) * (1 + EPS)
        return out

    def log(self) -> Series:
        """l̇ = ȧ/a; unbounded where a_0 may be ≤ 0."""
        low = self.mid[:1] - self.rad[:1] * (1 + EPS)
        with np.errstate(divide="ignore", invalid="ignore"):
            mid = np.log(np.where(low > 0, self.mid[:1], 1.0))
            # log(a) − log(a − r) ≤ r/(a − r); libm is trusted to two units in the last place
            rad = np.where(
                low > 0, self.rad[:1] / low * (1 + 4 * EPS) + 4 * EPS * np.abs(mid), np.inf
            )
        return Series(mid, rad, self.order)._integrate_rate(self.derivative() / self)

    def _integrate_rate(self, rate: Series) -> Series:
        """What begins with this constant and has the derivative `rate`."""
        if self.order == 0:
            return self
        k = np.arange(1, len(rate.mid) + 1).reshape(-1, *[1] * (rate.mid.ndim - 1))
        mid = rate.mid / k
        rads = rate.rad / k * (1 + EPS) + EPS * np.abs(mid)
        first = [np.broadcast_to(part[:1], (1, *mid.shape[1:])) for part in (self.mid, self.rad)]
        return Series(np.concatenate([first[0], mid]), np.concatenate([first[1], rads]), self.order)

    def differentiate(self, times: int, rate: Array) -> Series:
        """d/dt, so many times, where τ runs by `rate`."""
        if times == 0:
            return self
        if self.degree < times:
            return Series(
                np.zeros_like(self.mid[:1]), np.zeros_like(self.rad[:1]), max(self.order - times, 0)
            )
        k = np.arange(times, self.degree + 1)
        factors = np.prod([k - n for n in range(times)], axis=0).reshape(
            -1, *[1] * (self.mid.ndim - 1)
        )
        scale = factors * rate**times
        mid = self.mid[times:] * scale
        rad = self.rad[times:] * scale
        return Series(mid, rad * (1 + 8 * EPS) + 8 * EPS * np.abs(mid), self.order - times)

    def derivative(self) -> Series:
        """d/dτ; the order falls by one."""
        if self.degree == 0:
            return Series(np.zeros_like(self.mid), np.zeros_like(self.rad), max(self.order - 1, 0))
        k = np.arange(1, self.degree + 1).reshape(-1, *[1] * (self.mid.ndim - 1))
        mid = k * self.mid[1:]
        return Series(mid, k * self.rad[1:] * (1 + EPS) + EPS * np.abs(mid), self.order - 1)


def _sum_terms(terms: Array) -> Array:
    """Return the sum over the first axis in order: numpy sums many numbers of a single cell in
    another one.
    """
    total: Array = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def _call_libm(function: Callable[..., float], *arguments: Array) -> Array:
    """Return the values of a function of the C library, of which compiled code has the same bits.

    numpy's sines of several numbers are its own, and may differ in the last digit.
    """
    values = np.broadcast_arrays(*arguments)
    columns = (each.ravel().tolist() for each in values)
    return np.array(list(map(function, *columns))).reshape(values[0].shape)


def _head(series: Series, count: int) -> Series:
    return Series(series.mid[:count], series.rad[:count], series.order)


def _convolve(a: Series, b: Series, k: int) -> Ball:
    """Coefficient k of a·b from the coefficients that both have (zero where neither reaches)."""
    first, last = max(0, k - b.degree), min(k, a.degree)
    if first > last:
        zero = np.zeros(np.broadcast_shapes(a.mid.shape[1:], b.mid.shape[1:]))
        return zero, zero
    back = slice(k - last, k - first + 1)
    ma, ra = a.mid[first : last + 1], a.rad[first : last + 1]
    mb, rb = b.mid[back][::-1], b.rad[back][::-1]
    products = ma * mb
    size = _sum_terms(np.abs(products))
    error = _sum_terms(np.abs(ma) * rb + ra * (np.abs(mb) + rb))
    terms = last - first + 1
    return _sum_terms(products), (error + terms * EPS * size) * (1 + (terms + 2) * EPS)
