"""Classical moves between poses: every axis runs its own trapezoid from one pose to the next, and
the path is lost.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis, directional_bounds
from kinematics.machine.machine import Machine
from kinematics.machine.pose import from_numbers
from planner.path.actuation import MachinePath
from planner.path.polynomial import PolynomialPath
from planner.place import Place
from planner.timing.problem import EXACT_AIM
from planner.trajectory import Trajectory

# Instants of a move at which its pose is found, and points of the programmed curve that it is held
# against.
MOVE_INSTANTS, CURVE_POINTS = 65, 129
# Share of the largest coordinate up to which a difference between two ends is rounding.
END_ROUNDING = 1e-12
# m or rad: residual of a pose that has been found.
POSE_RESIDUAL = 1e-6

Flags = NDArray[np.bool_]
Ramps = tuple[Array, Array]
"""Of every axis (n,): how long it speeds up, and how long it moves in all, s."""


@dataclass(frozen=True, slots=True)
class Deviation:
    """How far (m) the platform's way and the programmed curve part at most, and where along it."""

    distance: float
    place: Place


def synchronised_ramps(distance: Array, speed: Array, acceleration: Array) -> Ramps:
    """All axes start and end together, in max |Δq|/V + t₁, with ramps of t₁ = max V/A.

    An axis that would not reach its speed V in a ramp has a triangle over the whole time. [Sahbaz
    2007]: one V and one t₁ for all legs, 3000 pulse/s and 10 ms; here each axis has its own V, and
    t₁ is the longest that any needs.
    """
    ramp = float((speed / acceleration).max())
    whole = float((distance / speed).max()) + ramp
    short = (distance < speed * ramp) | (whole < 2 * ramp)
    return np.where(short, whole / 2, ramp), np.full(len(distance), whole)


def independent_ramps(distance: Array, speed: Array, acceleration: Array) -> Ramps:
    """All axes start together, run at their own limits, and end when they end [Sasidhar 1981].

    A move too short to reach its speed is a triangle of two equal halves.
    """
    ramp = np.minimum(speed / acceleration, np.sqrt(distance / acceleration))
    whole = np.where(ramp < speed / acceleration, 2 * ramp, distance / speed + ramp)
    return ramp, whole


def time_moves(
    path: MachinePath,
    axes: Sequence[Axis],
    ramps: Callable[[Array, Array, Array], Ramps],
    ends: np.ndarray | None = None,
) -> tuple[Trajectory, Array]:
    """From end to end of every segment, with the path's dwells; and when each segment begins, and
    all ends (K+1,).

    ends (K+1,): breaks to move between instead, from the first to the last.

    The motion runs along time itself: a path q(t) of parabolas, at ṡ = 1. Raises MotionError where
    an axis has no limit of speed or acceleration, or nothing moves.
    """
    ends = _ends(path) if ends is None else ends
    speeds, acceleration = (
        _ramp_limits(axes, "max_speed"),
        _ramp_limits(axes, "max_acceleration").min(0),
    )
    q = _corners(path, ends)
    knots, pieces, begins = [np.zeros(1)], [], []
    now = 0.0
    for n, end in enumerate(ends):
        if path.dwells[end] > 0:
            pieces.append(np.stack([0 * q[n], 0 * q[n], q[n]])[:, None])
            now += float(path.dwells[end])
            knots.append(np.array([now]))
        begins.append(now)
        if n + 1 == len(ends):
            break
        way = q[n + 1] - q[n]
        way = np.where(np.abs(way) > END_ROUNDING * np.abs(q).max(0), way, 0.0)
        if way.any():
            ramp, whole = ramps(np.abs(way), np.where(way > 0, speeds[1], speeds[0]), acceleration)
            times = np.unique(np.concatenate([[0.0], ramp, whole - ramp, whole]))
            times = times[np.append(True, np.diff(times) > END_ROUNDING * times[-1])]
            pieces.append(_parabolas(times, q[n], way, ramp, whole))
            knots.append(now + times[1:])
            now += float(times[-1])
    if not pieces:
        raise MotionError(
            "every segment ends where it starts, so a point-to-point move does not move at all"
        )
    breaks = np.concatenate(knots)
    along = PolynomialPath(breaks, np.concatenate(pieces, 1), path.names)
    count = len(breaks) - 1
    nothing = np.zeros(count)
    return Trajectory(
        along, breaks, breaks[:-1], nothing + 1, nothing, nothing, np.arange(count)
    ), np.array(begins)


def move_places(
    begin: Array, end: Array, axes: Sequence[Axis], ramps: Callable[..., Ramps], share: Array
) -> Array:
    """(K, n) where a move from `begin` to `end` (n,) has its axes at shares (K,) of its time;
    raises as `moves`.
    """
    speeds, acceleration = (
        _ramp_limits(axes, "max_speed"),
        _ramp_limits(axes, "max_acceleration").min(0),
    )
    way = end - begin
    if not way.any():
        return np.tile(begin, (len(share), 1))
    ramp, whole = ramps(np.abs(way), np.where(way > 0, speeds[1], speeds[0]), acceleration)
    t = share[:, None] * whole.max()
    with np.errstate(divide="ignore", invalid="ignore"):
        top = np.where(way != 0, way / (whole - ramp), 0.0)
        rate = np.where(way != 0, top / ramp, 0.0)
    return np.asarray(
        begin
        + _moved_distance(t, t < ramp, t > whole - ramp, t > whole, way, ramp, whole, top, rate)
    )


def _moved_distance(
    t: Array,
    up: Flags,
    down: Flags,
    rest: Flags,
    way: Array,
    ramp: Array,
    whole: Array,
    top: Array,
    rate: Array,
) -> Array:
    left = np.maximum(whole - t, 0.0)
    moved = np.where(
        up, rate * t**2 / 2, np.where(down, way - rate * left**2 / 2, top * (t - ramp / 2))
    )
    return np.asarray(np.where(rest, way, moved))


def _parabolas(times: Array, q: Array, way: Array, ramp: Array, whole: Array) -> Array:
    """(3, K, n) coefficients of each piece between the times, the highest power first: a trapezoid
    on every axis.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        top = np.where(way != 0, way / (whole - ramp), 0.0)
        rate = np.where(way != 0, top / ramp, 0.0)
    t, middle = times[:-1, None], (times[:-1, None] + times[1:, None]) / 2
    left = np.maximum(whole - t, 0.0)
    up, down, rest = middle < ramp, middle > whole - ramp, middle > whole
    position = _moved_distance(t, up, down, rest, way, ramp, whole, top, rate)
    speed = np.where(rest, 0.0, np.where(up, rate * t, np.where(down, rate * left, top)))
    half = np.where(rest, 0.0, np.where(up, rate / 2, np.where(down, -rate / 2, 0.0)))
    return np.stack([half, speed, q + position])


def _ends(path: MachinePath) -> np.ndarray:
    """Breaks at which a segment of the program begins or ends, in every repetition anew."""
    places = [path.place(0.0, k) for k in range(len(path.breaks) - 1)]
    said = np.array([(place.segment or 0, place.repetition or 0) for place in places])
    return np.concatenate([[0], np.flatnonzero(np.diff(said, axis=0).any(1)) + 1, [len(said)]])


def _corners(path: MachinePath, ends: np.ndarray) -> Array:
    return path.derivatives(path.breaks[ends], np.maximum(ends - 1, 0))[0]


def _ramp_limits(axes: Sequence[Axis], name: str) -> Array:
    """(2, n) aimed at, towards smaller and greater q. A move speeds up by the one as it slows down
    by the other.
    """
    missing = [axis.name for axis in axes if getattr(axis, name) is None]
    if missing:
        raise MotionError(
            f"a point-to-point move needs {name} of every axis: state it for {', '.join(missing)}"
        )
    return EXACT_AIM * np.array([directional_bounds(getattr(axis, name)) for axis in axes]).T


def deviation(
    machine: Machine,
    path: MachinePath,
    moved: Trajectory,
    begins: Array,
    ends: np.ndarray | None = None,
) -> Deviation:
    """How far a move from pose to pose and the programmed curve part, by forward kinematics.

    It is the largest distance of any point of one from the other, segment by segment: 0 for a line
    that is kept, the height over its chord for an arc that is cut short, the diameter of a circle
    that is not run at all. `ends` as `moves` had them. Raises MotionError where the axes lead to no
    pose on the way.
    """
    ends = _ends(path) if ends is None else ends
    worst = Deviation(0.0, Place(float(path.breaks[0]), path.segment(0)))
    for n, (first, last) in enumerate(pairwise(ends)):
        t = np.linspace(begins[n], begins[n + 1] - path.dwells[last], MOVE_INSTANTS)
        s = np.linspace(path.breaks[first], path.breaks[last], CURVE_POINTS)
        piece = np.clip(np.searchsorted(path.breaks, s, side="right") - 1, first, last - 1)
        drawn = from_numbers(path.pose_numbers(s, piece))
        segment = path.segment(int(first))
        found = machine.forward(
            moved.at(t).q, drawn[:: (CURVE_POINTS - 1) // (MOVE_INSTANTS - 1)], certify=False
        )
        if not found.residual.max() <= POSE_RESIDUAL:
            raise MotionError(f"a point-to-point move has no pose in segment {segment}").in_segment(
                segment
            )
        run, curve = found.pose.translation, drawn.translation
        for off, places in (
            (distance_to_curve(run, curve), np.linspace(s[0], s[-1], MOVE_INSTANTS)),
            (distance_to_curve(curve, run), s),
        ):
            k = int(np.argmax(off))
            if off[k] > worst.distance:
                worst = Deviation(float(off[k]), Place(float(places[k]), segment))
    return worst


def distance_to_curve(points: Array, curve: Array) -> Array:
    """(N,) distance of points (N, d) from a curve drawn as a polyline (M, d)."""
    start, way = curve[:-1], np.diff(curve, axis=0)
    square = np.maximum((way**2).sum(1), np.finfo(float).tiny)
    along = np.clip(((points[:, None] - start) * way).sum(2) / square, 0.0, 1.0)
    return np.asarray(
        np.linalg.norm(points[:, None] - (start + along[:, :, None] * way), axis=2).min(1)
    )
