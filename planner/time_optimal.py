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
from planner.path.polynomial import VALUE_ROUNDING, PathSection, PolynomialPath, cut_sections, join_sections
from planner.timing.certified_solve import Solution, certified_solve

# A jump of an axis' values at a break, as a share of their range, up to which it is rounding.
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

    It stops at corners: breaks where q′ jumps, and under a jerk limit also where q″ jumps. A stretch on which nothing
    moves is left out; where the path stands, q′ = 0, as where it turns back, the motion rests or passes, whichever is
    the faster; straight stretches are timed by their way (planner.path.polynomial), so that a corner on one straight
    line is none unless it turns back.

    Parameters
    ----------
    path
        A SciPy piecewise polynomial (PPoly, CubicSpline, Akima, …, BSpline, BPoly) of any parameter.
    max_speed, max_acceleration, max_jerk
        Bounds of |q̇|, |q̈| and, where given, |q⃛|, in units of the values per second: one number; (n,); or (n, 2),
        towards smaller and towards greater values.
    start_speed, end_speed
        ṡ at the ends: how much of the parameter passes per second; under a jerk limit s̈ is 0 there.

    Returns
    -------
    Solution
        Trajectory and certificate.

    Raises
    ------
    MotionError
        It is no path: it jumps, has a value that is not finite, or nothing moves.
    Infeasible
        A speed at an end cannot be.
    """
    breaks, coefficients = _pieces(path)
    count = coefficients.shape[2]
    bounds = [
        _per_axis(name, values, count)
        for name, values in (("max_speed", max_speed), ("max_acceleration", max_acceleration), ("max_jerk", max_jerk))
    ]
    axes = [
        Axis(name=f"axis{k + 1}", max_speed=speed, max_acceleration=acceleration, max_jerk=jerk)
        for k, (speed, acceleration, jerk) in enumerate(zip(*bounds, strict=True))
    ]
    order = 2 if max_jerk is None else 3
    actuated = PolynomialPath(
        breaks, coefficients, [axis.name for axis in axes], _check_end_speeds(start_speed, end_speed)
    )
    _check(actuated)
    parts = cut_sections(actuated, order)
    chosen = [_choose_faster(part, axes, order) for part in parts]
    whole = join_sections(chosen)
    return certified_solve(whole, limits_of(whole, axes, order), order)


def _choose_faster(part: PathSection, axes: Sequence[Axis], order: int) -> PolynomialPath:
    """Choose the fastest of a section's ways: all rests, or some of them passed."""
    if not part.passing:
        return part.resting
    ways = (part.resting, *part.passing)
    times = []
    for way in ways:
        motion = attempt(partial(certified_solve, way, limits_of(way, axes, order), order))
        times.append(np.inf if isinstance(motion, MotionError) else motion.trajectory.duration)
    return ways[int(np.argmin(times))]


def _check_end_speeds(start_speed: float, end_speed: float) -> tuple[float, float]:
    for name, speed in (("start_speed", start_speed), ("end_speed", end_speed)):
        if isinstance(speed, bool) or not isinstance(speed, (int, float)) or not 0 <= speed < float("inf"):
            raise MotionError(f"{name} = {speed!r} must be a finite number, not negative")
    return float(start_speed), float(end_speed)


MOST = 1e60
"""Of a bound: what is beyond overflows when it is scaled. Give None where there is none."""


def _per_axis(name: str, values: ArrayLike | None, count: int) -> Sequence[Magnitude | None]:
    if values is None:
        return [None] * count
    try:
        bounds = np.asarray(values, float)
    except (TypeError, ValueError, OverflowError):
        bounds = np.array(np.nan)  # words, complex numbers, ragged lists
    if bounds.shape not in ((), (1,), (count,), (count, 2)) or not ((bounds > 0) & (bounds <= MOST)).all():
        raise MotionError(
            f"{name} = {values!r:.80} must be one positive number, or one for each of the {count} axes, or two, "
            f"at most {MOST:g}"
        )
    if bounds.ndim == 2:
        return [(below, above) for below, above in bounds.tolist()]
    return [float(value) for value in np.broadcast_to(bounds, count)]


def _pieces(path: Any) -> tuple[Array, Array]:
    """Breaks (P+1,) and coefficients (degree+1, P, n), pieces of no length and those where nothing moves left out."""
    from scipy.interpolate import BPoly, BSpline, PPoly

    if isinstance(path, BSpline):
        low, high = path.t[path.k], path.t[len(path.t) - path.k - 1]
        path = polynomials(path)
        inside = (path.x[:-1] >= low) & (path.x[1:] <= high)
    elif isinstance(path, BPoly):
        path = PPoly.from_bernstein_basis(path)
        inside = np.ones(len(path.x) - 1, bool)
    elif isinstance(path, PPoly):
        inside = np.ones(len(path.x) - 1, bool)
    else:
        raise MotionError(
            f"a path is a SciPy piecewise polynomial (PPoly, CubicSpline, BSpline, BPoly, …), not {type(path).__name__}"
        )
    if not (np.isfinite(path.c).all() and np.isfinite(path.x).all()) or path.c.dtype.kind != "f":
        raise MotionError("the path holds coefficients or breaks that are not finite real numbers")
    if path.c.ndim > 3:
        raise MotionError(
            f"the path's values have shape {path.c.shape[2:]}; they must be one value, or (n,) axis values"
        )
    if (np.diff(path.x) < 0).any():
        raise MotionError("the path's breaks decrease; reverse it so that they increase")
    inside &= np.diff(path.x) > 0
    if not inside.any():
        raise MotionError("the path has no length: all its breaks are the same")
    coefficients = path.c.reshape(*path.c.shape[:2], -1)
    still = inside & _find_still(np.diff(path.x), coefficients)
    if still.any() and not (still == inside).all():  # a repeated point: the path goes on from there
        inside &= ~still
    else:
        still[:] = False
    left_out = np.append(0.0, np.cumsum(np.where(still, np.diff(path.x), 0.0)))
    s = path.x - left_out
    return np.append(s[:-1][inside], s[1:][inside][-1]), coefficients[:, inside]


STILL_SHARE = 1e-10
"""Of an axis' range, the way of pieces one after the other that is nothing: a tenth of a jump that is rounding."""


def _find_still(lengths: Array, coefficients: Array) -> np.ndarray:
    """Return whether nothing moves on each piece (P,), nor on all such pieces in a row together.

    Splines through equal points do not stand quite still: they swing about them, less and less, down
    to rounding.
    """
    powers = np.arange(len(coefficients) - 1, 0, -1)[:, None, None]
    way = np.abs(coefficients[:-1] * lengths[:, None] ** powers).sum(0)
    values = coefficients[-1]
    most = STILL_SHARE * np.maximum(np.ptp(values, axis=0), way.max(0))
    least = (way <= most / 8).all(1)  # each swing is about a quarter of the one before, on both sides
    still = np.asarray(~coefficients[:-1].any((0, 2)), bool)
    # of pieces one after the other that hardly move: none where together they come to more
    begins = np.flatnonzero(np.diff(least.astype(int), prepend=0) == 1)
    stops = np.flatnonzero(np.diff(least.astype(int), append=0) == -1) + 1
    for first, last in zip(begins.tolist(), stops.tolist(), strict=True):
        if (way[first:last].sum(0) <= most).all():
            still[first:last] = True
    return still


def polynomials(spline: Any) -> Any:
    """Convert a B-spline of any degree to a PPoly: SciPy's own conversion reads beyond its memory above degree 5.

    Its derivatives come from differences of coefficients, which round by their size: so a common offset is left out.
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
    left, right = path.derivatives(path.breaks[:-1], pieces)[0], path.derivatives(path.breaks[1:], pieces)[0]
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
