"""Balls |x − mid| ≤ rad of symbols: a guaranteed enclosure of an expression that is itself compiled.

The operations of `Expression.run` on balls instead of numbers give two expressions, midpoint and radius, for CasADi to
evaluate. The error of the arguments and the rounding of every operation are carried along; underflow is not. What has
no bound has an infinite or undefined radius, and no operation makes a finite one of that.
Source: Rump, Acta Numerica 19 (2010), section 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import casadi as ca

# Twice the unit roundoff: covers the rounding of the operation itself and of the radius that bounds it.
EPS = 2.0**-52
_EPS, _ONE_ROUNDING, _FOUR_ROUNDINGS = ca.SX(EPS), ca.SX(1 + EPS), ca.SX(1 + 4 * EPS)


def _plus(a: ca.SX, b: ca.SX) -> ca.SX:
    """a + b, without the search for its meaning, which takes six times as long."""
    return ca.SX.binary(ca.OP_ADD, a, b)


def _times(a: ca.SX, b: ca.SX) -> ca.SX:
    return ca.SX.binary(ca.OP_MUL, a, b)


def _size(a: ca.SX) -> ca.SX:
    return ca.SX.unary(ca.OP_FABS, a)


@dataclass(frozen=True, slots=True)
class Ball:
    """Scalar symbols: midpoint and radius."""

    mid: ca.SX
    rad: ca.SX

    @staticmethod
    def constant(value: float) -> Ball:
        return Ball(ca.SX(value), ca.SX(0))

    def __neg__(self) -> Ball:
        return Ball(-self.mid, self.rad)

    def __add__(self, other: Ball) -> Ball:
        mid = _plus(self.mid, other.mid)
        return Ball(mid, _plus(_times(_plus(self.rad, other.rad), _ONE_ROUNDING), _times(_EPS, _size(mid))))

    def __sub__(self, other: Ball) -> Ball:
        return self + -other

    def __mul__(self, other: Ball | float) -> Ball:
        if not isinstance(other, Ball):
            other = Ball.constant(other)
        mid = _times(self.mid, other.mid)
        rad = _plus(_times(_size(self.mid), other.rad), _times(self.rad, _plus(_size(other.mid), other.rad)))
        return Ball(mid, _plus(_times(rad, _FOUR_ROUNDINGS), _times(_EPS, _size(mid))))

    def __truediv__(self, other: Ball) -> Ball:
        return self * other._inverse()

    def __rtruediv__(self, other: float) -> Ball:
        return self._inverse() * other

    def _inverse(self) -> Ball:
        """|1/x − 1/m| = |x − m|/(|x| |m|) ≤ rad/((|m| − rad) |m|)."""
        size = ca.fabs(self.mid)
        safe = size > self.rad
        rad = self.rad / ((size - self.rad) * size) * (1 + 8 * EPS) + EPS / size
        return Ball(ca.if_else(safe, 1 / self.mid, 0), ca.if_else(safe, rad, inf))

    def sqrt(self) -> Ball:
        """|√x − √m| = |x − m|/(√x + √m) ≤ rad/(√(m − rad) + √m); no bound where x may be ≤ 0."""
        safe = self.mid > self.rad
        root = ca.sqrt(self.mid)
        rad = self.rad / (ca.sqrt(self.mid - self.rad) + root) * (1 + 8 * EPS) + 2 * EPS * root
        return Ball(ca.if_else(safe, root, 0), ca.if_else(safe, rad, inf))

    def sincos(self) -> tuple[Ball, Ball]:
        """|sin x − sin m| ≤ |cos m| rad + rad²/2, never above 2; libm is trusted to two units in the last place."""
        sine, cosine = ca.sin(self.mid), ca.cos(self.mid)
        rads = (ca.fabs(slope) * self.rad + self.rad**2 / 2 for slope in (cosine, sine))
        bound = [ca.fmin(rad, 2) * (1 + 4 * EPS) + 4 * EPS for rad in rads]
        return Ball(sine, bound[0]), Ball(cosine, bound[1])

    def sign(self) -> Ball:
        """±1; no bound where x may be zero."""
        return Ball(ca.sign(self.mid), ca.if_else(ca.fabs(self.mid) > self.rad, 0, inf))

    def atan2(self, x: Ball) -> Ball:
        """The angle of the point (x, self): off by asin(t) ≤ t/√(1 − t²), t = error/distance.

        No bound where the point may be the origin or on the cut.
        """
        away = ca.sqrt(self.mid**2 + x.mid**2) * (1 - 4 * EPS)
        error = ca.sqrt(self.rad**2 + x.rad**2) * (1 + 4 * EPS)
        clear = ca.logic_or(x.mid > x.rad, ca.fabs(self.mid) > self.rad)
        rad = error / ca.sqrt((away - error) * (away + error)) * (1 + 8 * EPS) + 8 * EPS
        return Ball(ca.atan2(self.mid, x.mid), ca.if_else(ca.logic_and(away > error, clear), rad, inf))
