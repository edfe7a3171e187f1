"""What axes do behind their input shapers: q_s(t) = Σ Aᵢ q(t − tᵢ), copies of one motion, shifted
and weighed.

The axes are delayed so that the centroids Σ Aᵢ tᵢ of all their shapers agree: whatever they are
shaped by, they stay together along the path to first order.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.foundation.arrays import Array, freeze_array, freeze_fields
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis
from kinematics.machine.pose import Pose
from planner.path.actuation import MachinePath
from planner.trajectory import RowState, Trajectory, put_in_rows

POSE_RESIDUAL = 1e-9
"""m or rad: residual of a pose that has been found."""


class ShapedBase(Protocol):
    """The motion that is shaped: as `planner.pulses.motion.AxesMotion`, with states of path length
    and q⃛.
    """

    @property
    def knots(self) -> Array: ...
    @property
    def duration(self) -> float: ...
    def at(self, t: Array, /) -> RowState: ...


@dataclass(frozen=True, slots=True)
class Copies:
    """Of which copies of a motion each axis is the sum.

    delays   (K,) s, rising, from 0 or more
    weights  (K, n) of each axis: 0 or more, and 1 in all
    centre   s: Σ Aᵢ tᵢ, the same for all axes
    """

    delays: Array
    weights: Array
    centre: float

    def __post_init__(self) -> None:
        freeze_fields(self, "delays", "weights")

    @property
    def length(self) -> float:
        """s, by which the shaped motion is longer."""
        return float(self.delays[-1])


def find_delays(axes: Sequence[Axis]) -> tuple[float, float]:
    """s, by which pulses are behind the motion before shapers: while it moves, and when it has come
    to rest.
    """
    copies = find_copies(axes)
    return (0.0, 0.0) if copies is None else (copies.centre, copies.length)


def find_copies(axes: Sequence[Axis]) -> Copies | None:
    """Those of the axes' shapers; None where no axis has one."""
    if not any(axis.shaper for axis in axes):
        return None
    impulses = [
        (np.ones(1), np.zeros(1)) if axis.shaper is None else axis.shaper.impulses for axis in axes
    ]
    centre = max(float(amplitudes @ times) for amplitudes, times in impulses)
    shifted = [times + (centre - float(amplitudes @ times)) for amplitudes, times in impulses]
    delays = np.unique(np.concatenate(shifted))
    weights = np.zeros((len(delays), len(axes)))
    for k, ((amplitudes, _), times) in enumerate(zip(impulses, shifted, strict=True)):
        weights[np.searchsorted(delays, times), k] = amplitudes
    return Copies(delays, weights, centre)


@dataclass(frozen=True, slots=True)
class ShapedState:
    """q, q̇, q̈, q⃛ (N, n) of the shaped motion; s (N,) m along the path of the motion that is
    shaped, `centre` before.
    """

    s: Array
    q: Array
    qd: Array
    qdd: Array
    qddd: Array


@dataclass(frozen=True, slots=True)
class ShapedMotion:
    """A motion behind its axes' shapers: an `AxesMotion` whose smooth intervals are those of all
    its copies.

    knots  (M+1,) s; interval m of it runs inside interval whose[k, m] of copy k: −1 before it
           begins, the number of its
    intervals once it has ended
    """

    base: ShapedBase
    copies: Copies
    knots: Array
    whose: NDArray[np.intp]

    @classmethod
    def of(cls, base: ShapedBase, copies: Copies) -> "ShapedMotion":
        own = np.asarray(base.knots, float)
        delays = np.append(copies.delays, copies.centre)
        knots = np.unique(
            np.concatenate(
                [[0.0], *(own + delay for delay in delays), [base.duration + copies.length]]
            )
        )
        # the knots of a copy are themselves among them, to the last bit
        whose = [np.searchsorted(own + delay, knots[:-1], side="right") - 1 for delay in delays]
        return cls(base, copies, freeze_array(knots), freeze_array(np.array(whose), np.intp))

    @property
    def duration(self) -> float:
        """s: that of the motion, and the length of the shaper."""
        return float(self.knots[-1])

    def locate(self, t: Array) -> NDArray[np.intp]:
        """(N,) the interval of each instant; a knot belongs to the one that it starts."""
        return np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(self.knots) - 2)

    def at(self, t: ArrayLike, /) -> ShapedState:
        """The state at t (N,) s; at rest before 0 and after the end."""
        t = np.atleast_1d(np.asarray(t, float))
        interval = self.locate(t)
        found = np.zeros((4, len(t), self.copies.weights.shape[1]))
        for k, (delay, weight) in enumerate(
            zip(self.copies.delays, self.copies.weights, strict=True)
        ):
            own, moves = self._own_time(k, float(delay), t, interval)
            state = self.base.at(own)
            found[0] += weight * state.q
            for row, rate in enumerate((state.qd, state.qdd, state.qddd), 1):
                found[row] += weight * rate * moves
        return ShapedState(np.asarray(self.reference(t).s), *found)

    def positions_at(self, t: Array, /) -> Array:
        """(N, n) where the axes are."""
        interval = self.locate(t)
        parts = (
            weight * self._positions(self._own_time(k, float(delay), t, interval)[0])
            for k, (delay, weight) in enumerate(
                zip(self.copies.delays, self.copies.weights, strict=True)
            )
        )
        return np.asarray(sum(parts))

    def _positions(self, own: Array) -> Array:
        positions = getattr(self.base, "positions_at", None)
        return np.asarray(self.base.at(own).q if positions is None else positions(own))

    def reference(self, t: Array) -> RowState:
        """The state (N,) of the motion that is shaped, `centre` before t: the shaped one is about
        it.
        """
        return self.base.at(np.clip(t - self.copies.centre, 0.0, self.base.duration))

    def _own_time(
        self, k: int, delay: float, t: Array, interval: NDArray[np.intp]
    ) -> tuple[Array, Array]:
        """(N,) instants of copy k, each on the side of the knots on which its interval is; (N, 1)
        whether it moves.
        """
        own, last = np.asarray(self.base.knots, float), len(self.base.knots) - 1
        whose = self.whose[k, interval]
        moves = (whose >= 0) & (whose < last) & (t >= 0) & (t <= self.duration)
        inside = np.clip(whose, 0, last - 1)
        low, high = own[inside], np.nextafter(own[inside + 1], own[inside])
        at = np.where(
            whose < 0,
            0.0,
            np.where(whose >= last, self.base.duration, np.clip(t - delay, low, high)),
        )
        return at, moves[:, None].astype(float)


def shape_motion(motion: ShapedBase, axes: Sequence[Axis]) -> ShapedMotion | None:
    """The motion behind the axes' shapers; None where no axis has one."""
    copies = find_copies(axes)
    return None if copies is None else ShapedMotion.of(motion, copies)


def reached_poses(trajectory: Trajectory, shaped: ShapedMotion, t: Array, q: Array) -> Pose:
    """The poses (N,) that the axes reach at t (N,) with q (N, n), found from those on the path,
    `centre` before.

    Raises MotionError where none is found.
    """
    path = trajectory.path
    assert isinstance(path, MachinePath)
    near = trajectory.at(np.clip(t - shaped.copies.centre, 0.0, trajectory.duration)).pose
    found = path.machine.forward(q, near, certify=False)
    lost = ~(found.residual <= POSE_RESIDUAL * max(1.0, float(np.abs(q).max())))
    if lost.any():
        raise MotionError(
            f"machine {path.machine.name}: the axes reach no pose behind their input shapers at t = {t[lost][0]:.6g} s"
        )
    return found.pose


def rows_of_shaped(trajectory: Trajectory, shaped: ShapedMotion, t: Array) -> Array:
    """As `planner.trajectory.rows`: (N, columns) at t (N,) of what the axes do, and of the pose
    that they reach.
    """
    state = shaped.at(t)
    return put_in_rows(t, state, reached_poses(trajectory, shaped, t, state.q))


def shaper_length(axes: Sequence[Axis]) -> float:
    """s, by which a motion lasts longer behind the axes' shapers."""
    copies = find_copies(axes)
    return 0.0 if copies is None else copies.length


def shorten_duration(duration: float, axes: Sequence[Axis]) -> float:
    """s that a motion may take before the axes' shapers, so that it takes so long behind them.

    Raises MotionError.
    """
    length = shaper_length(axes)
    if duration <= length:
        raise MotionError(
            f"duration {duration:g} s: the input shapers alone take {length:.6g} s; state a longer one"
        )
    return duration - length
