"""What pulses are made from and checked against: a motion that can be sampled, and what an axis'
mechanics make of it.

Mechanics are play, then a screw: where an axis rests when its motor rests somewhere. Compensation
is compared with them, and so are the poses that the counts of a schedule reach.
"""

from typing import Protocol, runtime_checkable

import numpy as np

from kinematics.analysis.forward import iterate_newton
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine
from kinematics.machine.motion import AxesState
from planner.pulses.schedule import AxisPulses, PulseSchedule


class MotionState(AxesState, Protocol):
    """The motion at instants t (N,): path length s (N,) and q⃛ (N, axes) as well."""

    @property
    def s(self) -> Array: ...
    @property
    def qddd(self) -> Array: ...


class AxesMotion(Protocol):
    """Axis positions over time; `planner.trajectory.Trajectory` is one.

    knots     (M+1,) s, never decreasing, from 0 to the duration: q(t) is smooth inside an interval,
              q and q̇ are continuous across a knot, and a state asked at a knot belongs to the
              interval on its right
    duration  s
    """

    @property
    def knots(self) -> Array: ...
    @property
    def duration(self) -> float: ...
    def at(self, t: Array, /) -> MotionState: ...


@runtime_checkable
class SingleAxisMotion(AxesMotion, Protocol):
    """A motion that tells of one axis in a fraction of the time: a state whose q, q̇, q̈, q⃛ are
    (N, 1).
    """

    def axis_at(self, t: Array, axis: int, /) -> MotionState: ...


@runtime_checkable
class PositionMotion(AxesMotion, Protocol):
    """A motion that tells where its axes are, (N, axes), in a fraction of the time that a state
    takes.
    """

    def positions_at(self, t: Array, /) -> Array: ...


@runtime_checkable
class MotorMotion(AxesMotion, Protocol):
    """What motors do so that behind play and screws their axes do what is planned; planned: of the
    axes.
    """

    @property
    def planned(self) -> AxesMotion: ...


class Impulses(Protocol):
    """Copies of a motion: delays (K,) s and the weights (K, n) that each axis has of them."""

    @property
    def delays(self) -> Array: ...
    @property
    def weights(self) -> Array: ...


@runtime_checkable
class ShapedAxesMotion(AxesMotion, Protocol):
    """What axes do behind input shapers: the copies of a motion, summed."""

    @property
    def base(self) -> AxesMotion: ...
    @property
    def copies(self) -> Impulses: ...


def play_operator(motor: Array, width: float, before: float) -> Array:
    """(N,) where play of a width leaves what a motor at (N,) pushes: yᵢ = min(max(yᵢ₋₁, mᵢ), mᵢ +
    width).

    Towards greater q it is pushed at y = m, towards smaller q at y = m + width, and between them it
    stays where it is: the play operator of [Krasnosel'skii and Pokrovskii 1989]. before: y before
    the first place; a machine that has been homed towards greater q starts at y = m, one towards
    smaller q at the far side (`apply_play`). Only the turns are gone through one by one: along a
    run that has one sense y depends on where the run began alone.
    """
    if not len(motor):
        return motor
    rises = np.diff(motor) >= 0
    turns = np.flatnonzero(rises[1:] != rises[:-1]) + 1
    held = [min(max(before, float(motor[0])), float(motor[0]) + width)]
    for m in motor[turns].tolist():
        held.append(min(max(held[-1], m), m + width))
    lengths = np.diff(
        turns, prepend=-1, append=len(motor) - 1
    )  # a turn is the last place of its run
    return np.asarray(np.minimum(np.maximum(np.repeat(held, lengths), motor), motor + width))


def apply_play(motor: Array, axis: Axis, before: float) -> Array:
    """(N,) where an axis' play leaves what its motor pushes, which was homed on the side that
    `pushed` says.
    """
    return play_operator(
        motor - axis.backlash if axis.pushed == "-" else motor, axis.backlash, before
    )


def apply_screw(place: Array, axis: Axis) -> Array:
    """(N,) where the axis is, from home, with its screw at (N,): y + error(y), past either end the
    error as there.
    """
    return (
        place if axis.lead_error is None else place + np.interp(place, *np.array(axis.lead_error).T)
    )


def invert_screw(wanted: Array, axis: Axis) -> Array:
    """(N,) the inverse of `apply_screw`: between two points the error is linear over where the axis
    is, too.
    """
    if axis.lead_error is None:
        return wanted
    counted, error = np.array(axis.lead_error).T
    return np.asarray(wanted - np.interp(wanted, counted + error, error))


def describe_mechanics(axis: Axis, off: float) -> str:
    """The axis' mechanics in words, for those who read what was simulated; empty where it states
    none.

    off: m or rad by which it is behind at most while play that is made up for is crossed.
    """
    parts = []
    if axis.backlash > 0:
        made = (
            f"made up for, off by up to {1e6 * off:.3g} while crossed"
            if "backlash" in axis.compensate
            else "not"
        )
        parts.append(f"play {1e6 * axis.backlash:.4g} ({made})")
    if axis.lead_error is not None:
        most = 1e6 * max(abs(error) for _, error in axis.lead_error)
        parts.append(
            f"lead error up to {most:.4g} ({'made up for' if 'lead' in axis.compensate else 'not'})"
        )
    return f"{', '.join(parts)} µ{axis.unit}" if parts else ""


POSE_RESIDUAL = 1e-9
"""m or rad: residual of a pose that has been found."""


def find_reached_poses(machine: Machine, schedule: PulseSchedule, t: Array, near: Array) -> Array:
    """(N, 12) pose numbers at instants t (N,) s, looked for from those planned there, near (N, 12).

    The motors are where they are counted, the axes where the play and the lead error that they
    state leave them, as in `realised`. Raises MotionError where the counts stand for no pose.
    """
    # a pulse counts from its own instant on; one step up, since T / clock · clock may fall just
    # short of the tick T
    ticks = np.floor(np.nextafter(t * schedule.clock_hz, np.inf))
    q = np.empty((len(t), len(schedule.axes)))
    for k, (pulses, axis) in enumerate(zip(schedule.axes, machine.axes, strict=True)):
        places = pulses.home + apply_screw(
            apply_play(_counted_positions(pulses), axis, pulses.start * pulses.pulse), axis
        )
        q[:, k] = places[np.searchsorted(pulses.ticks, ticks, side="right")]
    return freeze_array(solve_poses(machine, q, t, near))


def solve_poses(machine: Machine, q: Array, t: Array, near: Array) -> Array:
    """Return the pose numbers (N, 12) of coordinates (N, n) to which counts led at t (N,) s, from
    near (N, 12) on.
    """
    x, residual = iterate_newton(machine, q, near)
    lost = ~(residual <= POSE_RESIDUAL * max(1.0, float(abs(q).max())))
    if lost.any():
        raise MotionError(
            f"machine {machine.name}: the counts at t = {t[int(np.argmax(lost))]:.6g} s stand for no pose; the pulses "
            "are not of this motion, or it comes too near to the end of its reach"
        )
    return x


def _counted_positions(pulses: AxisPulses) -> Array:
    """(M + 1,) m or rad from home where the motor is counted before the first pulse and after
    each.
    """
    running = np.concatenate(
        ([pulses.start], pulses.start + np.cumsum(pulses.direction, dtype=np.int64))
    )
    return np.asarray(running * pulses.pulse, float)
