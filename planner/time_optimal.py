"""Time-optimal motion without a machine: any piecewise polynomial of axis values."""

from collections.abc import Sequence
from functools import partial
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError, attempt
from kinematics.machine.axis import Axis, Magnitude
from planner.limits import limits_of
from planner.path.polynomial import (
    VALUE_ROUNDING,
    PathSection,
    PolynomialPath,
    cut_sections,
    join_sections,
)
from planner.timing.certified_solve import Solution, certified_solve

# Share of an axis' range up to which a jump at a break counts as rounding. A larger share accepts
# paths that jump; a smaller one refuses splines that other software wrote.
MAX_JUMP = 1e-9


def time_optimal(
    path: Any,
    *,
    max_speed: ArrayLike,
    max_acceleration: ArrayLike,
    max_jerk: ArrayLike | None = None,
    start_speed: float = 0.0,
    end_speed: float = 0.0,
) -> Solution:
    """Find the fastest certified motion along s -> (n,) axis values, without a machine.

    It stops at corners: breaks where q′ jumps, and under a jerk limit also where q″ jumps. Pieces
    without motion are left out. Where q′ = 0, as where the path turns back, the motion rests or
    passes, by the shorter time. Straight pieces are timed by their length
    (planner.path.polynomial): a break on a straight line is no corner unless the path turns back.

    Parameters
    ----------
    path
        A SciPy piecewise polynomial (PPoly, CubicSpline, Akima, …, BSpline, BPoly) of any
        parameter.
    max_speed, max_acceleration, max_jerk
        Bounds of |q̇|, |q̈| and, optionally, |q⃛|, in units of the values per second: one number;
        (n,); or (n, 2), towards smaller and towards greater values.
    start_speed, end_speed
        ṡ at the ends: change of the parameter per second. Under a jerk limit s̈ is 0 there.

    Returns
    -------
    Solution
        Trajectory and certificate.

    Raises
    ------
    MotionError
        The path is invalid: it jumps, has a value that is not finite, or does not move.
    Infeasible
        A speed at an end is not attainable.
    """
    breaks, coefficients = _pieces(path)
    count = coefficients.shape[2]
    speeds = _per_axis("max_speed", max_speed, count)
    accelerations = _per_axis("max_acceleration", max_acceleration, count)
    jerks = _per_axis("max_jerk", max_jerk, count)
    caps = zip(speeds, accelerations, jerks, strict=True)
    axes = [
        Axis(name=f"axis{k}", max_speed=speed, max_acceleration=acceleration, max_jerk=jerk)
        for k, (speed, acceleration, jerk) in enumerate(caps, start=1)
    ]
    names = [axis.name for axis in axes]
    end_speeds = _check_end_speeds(start_speed, end_speed)
    actuated = PolynomialPath(breaks, coefficients, names, end_speeds)
    _check(actuated)
    order = 2 if max_jerk is None else 3
    sections = cut_sections(actuated, order)
    whole = join_sections([_choose_faster(section, axes, order) for section in sections])
    return certified_solve(whole, limits_of(whole, axes, order), order)


def _choose_faster(section: PathSection, axes: Sequence[Axis], order: int) -> PolynomialPath:
    """Choose the fastest path of a section: with all rests, or with some rests passed."""
    if not section.passing:
        return section.resting

    def find_duration(path: PolynomialPath) -> float:
        limits = limits_of(path, axes, order)
        motion = attempt(partial(certified_solve, path, limits, order))
        return np.inf if isinstance(motion, MotionError) else motion.trajectory.duration

    return min((section.resting, *section.passing), key=find_duration)


def _check_end_speeds(start_speed: float, end_speed: float) -> tuple[float, float]:
    for name, speed in (("start_speed", start_speed), ("end_speed", end_speed)):
        is_number = isinstance(speed, int | float) and not isinstance(speed, bool)
        if not is_number or not 0 <= speed < float("inf"):
            raise MotionError(f"{name} = {speed!r} must be a finite number, not negative")
    return float(start_speed), float(end_speed)


MOST = 1e60
"""Largest bound: larger ones overflow when they are scaled. None states no bound."""


def _per_axis(name: str, values: ArrayLike | None, count: int) -> Sequence[Magnitude | None]:
    if values is None:
        return [None] * count
    try:
        bounds = np.asarray(values, float)
    except (TypeError, ValueError, OverflowError):
        bounds = np.array(np.nan)  # words, complex numbers, ragged lists
    if (
        bounds.shape not in ((), (1,), (count,), (count, 2))
        or not ((bounds > 0) & (bounds <= MOST)).all()
    ):
        raise MotionError(
            f"{name} = {values!r:.80} must be one positive number, or one for each of the {count} axes, or two, "
            f"at most {MOST:g}"
        )
    if bounds.ndim == 2:
        return [(below, above) for below, above in bounds.tolist()]
    return [float(value) for value in np.broadcast_to(bounds, count)]


def _pieces(path: Any) -> tuple[Array, Array]:
    """Return breaks (P+1,) and coefficients (degree+1, P, n) of the pieces with length and
    motion.
    """
    from scipy.interpolate import BPoly, BSpline, PPoly

    low = -np.inf
    high = np.inf
    if isinstance(path, BSpline):
        low = path.t[path.k]
        high = path.t[len(path.t) - path.k - 1]
        path = polynomials(path)
    elif isinstance(path, BPoly):
        path = PPoly.from_bernstein_basis(path)
    elif not isinstance(path, PPoly):
        raise MotionError(
            f"a path is a SciPy piecewise polynomial (PPoly, CubicSpline, BSpline, BPoly, …), not {type(path).__name__}"
        )
    values = path.c
    lengths = np.diff(path.x)
    if values.dtype.kind != "f" or not (np.isfinite(values).all() and np.isfinite(path.x).all()):
        raise MotionError("the path holds coefficients or breaks that are not finite real numbers")
    if values.ndim > 3:
        raise MotionError(
            f"the path's values have shape {values.shape[2:]}; they must be one value, or (n,) axis values"
        )
    if (lengths < 0).any():
        raise MotionError("the path's breaks decrease; reverse it so that they increase")
    inside = (path.x[:-1] >= low) & (path.x[1:] <= high) & (lengths > 0)
    if not inside.any():
        raise MotionError("the path has no length: all its breaks are the same")
    coefficients = values.reshape(*values.shape[:2], -1)
    # pieces that repeat a point are left out: the path continues from it
    moving = inside & ~_find_still(lengths, coefficients)
    if not moving.any():
        moving = inside
    left_out = np.append(0.0, np.cumsum(np.where(inside & ~moving, lengths, 0.0)))
    s = path.x - left_out
    return np.append(s[:-1][moving], s[1:][moving][-1]), coefficients[:, moving]


STILL_SHARE = 1e-10
"""Share of an axis' range up to which successive pieces count as still: a tenth of MAX_JUMP."""


def _find_still(lengths: Array, coefficients: Array) -> np.ndarray:
    """Return whether no axis moves on each piece (P,), nor over its neighbours of that kind.

    Splines through equal points move a little: they swing about them, less and less, down to
    rounding.
    """
    powers = np.arange(len(coefficients) - 1, 0, -1)[:, None, None]
    way = np.abs(coefficients[:-1] * lengths[:, None] ** powers).sum(0)
    values = coefficients[-1]
    most = STILL_SHARE * np.maximum(np.ptp(values, axis=0), way.max(0))
    least = (way <= most / 8).all(
        1
    )  # each swing is about a quarter of the one before, on both sides
    still = np.asarray(~coefficients[:-1].any((0, 2)), bool)
    # successive pieces that hardly move are still if all of them together hardly move
    begins = np.flatnonzero(np.diff(least.astype(int), prepend=0) == 1)
    stops = np.flatnonzero(np.diff(least.astype(int), append=0) == -1) + 1
    for first, last in zip(begins.tolist(), stops.tolist(), strict=True):
        if (way[first:last].sum(0) <= most).all():
            still[first:last] = True
    return still


def polynomials(spline: Any) -> Any:
    """Convert a B-spline of any degree to a PPoly.

    SciPy's own conversion reads beyond its memory above degree 5. Derivatives are differences of
    coefficients, whose rounding grows with their size: so a common offset is subtracted first.
    """
    from scipy.interpolate import BSpline, PPoly

    offset = spline.c.mean(0)
    near = BSpline(spline.t, spline.c - offset, spline.k)
    starts = spline.t[:-1]
    powers = range(spline.k, -1, -1)
    coefficients = np.stack([near(starts, nu=power) / factorial(power) for power in powers])
    coefficients[-1] += offset
    return PPoly(coefficients, spline.t)


def _check(path: PolynomialPath) -> None:
    pieces = np.arange(len(path.breaks) - 1)
    left = path.derivatives(path.breaks[:-1], pieces)[0]
    right = path.derivatives(path.breaks[1:], pieces)[0]
    if not np.abs(path.coefficients[:-1]).max(initial=0.0) > 0:
        raise MotionError("nothing moves along the path: no axis changes")
    gap = np.abs(left[1:] - right[:-1])
    both = np.concatenate([left, right])
    extent = np.ptp(both, axis=0) + 1e-3 * np.abs(both).max(0)
    beyond = gap - MAX_JUMP * extent - VALUE_ROUNDING * extent.max()
    if beyond.max(initial=0.0) > 0:
        at, axis = np.unravel_index(int(np.argmax(beyond)), gap.shape)
        raise MotionError(
            f"the path jumps by {gap[at, axis]:.6g} in {path.names[axis]} "
            f"at s = {path.breaks[at + 1]:.6g}; a motion cannot"
        )
