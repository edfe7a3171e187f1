"""A motion under way: what the registers have counted by any instant, and what a stop makes of it.

It runs on what the console makes of a machine: steps, rates and ends of every axis, on the virtual
card.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from controllers.card import PCI_8164, Card, CardState, DStop, TAMove, Together, at_rest, send
from controllers.card.trapezoid import ramp
from kinematics.foundation.arrays import Array, freeze_fields
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import directional_bounds
from kinematics.machine.machine import Machine
from planner.pulses import PulseSchedule
from planner.pulses.schedule import COUNTER
from planner.trajectory import Trajectory

JOG_SPEED_SHARE = 0.1
"""Share of its speed at which an axis jogs: "slowly traversed", says the source, and no number
(assumed).
"""
WHOLE_TOLERANCE = 1e-6
"""Pulses by which a travel may miss a whole number of them and still be it: rounding of units."""


@dataclass(frozen=True, slots=True)
class Drives:
    """The axes of a machine in pulses of the card, which count where the axis' own coordinate
    grows, from home on.

    The speed v is the least of max_speed, the pulse rate, and where there are any, the first
    resonance band's foot; the acceleration a is max_acceleration, so that the ramp takes X_a =
    v²/(2 a). Speeds are whole steps of the card's speed register, rounded down. Where an axis
    states two magnitudes, the smaller is used both ways.

    names         (n,) in capitals, as commands name the axes
    signs         (n,) +1/-1: the coordinate's direction in which the motor turns clockwise, the
                  wiring's positive count
    speed, acceleration  (n,) pulses/s, pulses/s²
    low, high     (n,) int64, the ends of travel; of an endless axis those of the card's counter
    """

    card: Card
    names: tuple[str, ...]
    signs: np.ndarray
    speed: Array
    acceleration: Array
    low: np.ndarray
    high: np.ndarray

    def __post_init__(self) -> None:
        freeze_fields(self, "signs", "speed", "acceleration", "low", "high")

    @property
    def ramp(self) -> Array:
        """X_a (n,), pulses of the way in which an axis comes to its speed: v²/(2 a)."""
        return np.asarray(self.speed**2 / (2 * self.acceleration))

    def reach(self) -> tuple[np.ndarray, np.ndarray]:
        """Ends of where a slide can stand: travel, and its zero, where the switch is, which may lie
        outside.
        """
        return np.minimum(self.low, 0), np.maximum(self.high, 0)

    def clip_to_counter(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ends, no farther than the counter's."""
        return np.maximum(low, COUNTER[0]), np.minimum(high, COUNTER[1])


def machine_drives(machine: Machine) -> Drives:
    """The drives of a machine.

    Raises MotionError for an axis without speed or acceleration, or that compensates.
    """
    speed, acceleration = [], []
    for axis in machine.axes:
        for name in ("max_speed", "max_acceleration"):
            if getattr(axis, name) is None:
                raise MotionError(
                    f"console: axis {axis.name} states no {name}; give one in the machine's file"
                )
        if axis.compensate:
            raise MotionError(
                f"console: axis {axis.name} compensates {' and '.join(axis.compensate)}, so its pulses count the motor "
                "and a register would not tell where the axis is; take compensate out of the machine's file"
            )
        band = axis.resonance[0][0] if axis.resonance else np.inf
        speed.append(
            min(min(*directional_bounds(axis.max_speed), band) / axis.pulse, axis.pulse_rate)
        )
        acceleration.append(min(directional_bounds(axis.max_acceleration)) / axis.pulse)
    card = replace(
        PCI_8164, channels=len(machine.axes), speed_range=min(max(speed), PCI_8164.max_speed)
    )
    steps = np.floor(np.minimum(speed, card.top_speed) / card.least_speed + WHOLE_TOLERANCE)
    ends = np.array([np.divide(axis.travel, axis.pulse) for axis in machine.axes])
    low, high = np.clip(
        [np.ceil(ends[:, 0] - WHOLE_TOLERANCE), np.floor(ends[:, 1] + WHOLE_TOLERANCE)], *COUNTER
    )
    return Drives(
        card,
        tuple(axis.name.upper() for axis in machine.axes),
        np.array([axis.direction for axis in machine.axes], np.int64),
        np.maximum(steps, 1.0) * card.least_speed,
        np.array(acceleration),
        low.astype(np.int64),
        high.astype(np.int64),
    )


# Pulses to which a position is kept within its count when the card takes over: less than half, or
# it would fire.
MAX_COUNT_OFFSET = 0.4999


class SessionMotion(ABC):
    """Pulses in time: `counts` at instants (s, of the session's clock), from `begun` to `end`."""

    __slots__ = ()
    begun: float

    @property
    @abstractmethod
    def end(self) -> float:
        """s, when all axes stand."""

    @property
    @abstractmethod
    def moving_axes(self) -> np.ndarray:
        """(n,) bool, the axes that fire at all."""

    @abstractmethod
    def counts(self, t: float) -> np.ndarray:
        """The counters (n,), int64, at t: home's count and all pulses fired since, signed."""

    @abstractmethod
    def directions_between(self, since: float, until: float) -> tuple[np.ndarray, ...]:
        """Of each axis the directions (pulses,) of the pulses fired from `since` to before `until`,
        one by one.
        """

    @abstractmethod
    def on_card(self, drives: Drives, t: float) -> CardState:
        """The card as it is at t, its clock the session's less `begun`: what a stop is sent to."""


@dataclass(frozen=True, slots=True)
class CardMotion(SessionMotion):
    """Moves of the card."""

    begun: float
    state: CardState

    @property
    def end(self) -> float:
        return self.begun + max(
            float(move.end[np.isfinite(move.end)].max(initial=0.0)) for move in self.state.moves
        )

    @property
    def moving_axes(self) -> np.ndarray:
        move = self.state.moves[-1]
        return np.asarray(np.rint(move.start) != np.rint(move.target))

    def counts(self, t: float) -> np.ndarray:
        return np.asarray(self.state.counter(max(t - self.begun, 0.0))[0])

    def directions_between(self, since: float, until: float) -> tuple[np.ndarray, ...]:
        lanes, a, b = range(len(self.state.fired)), since - self.begun, until - self.begun
        edges = [[move.edges(i, a, b).direction for move in self.state.moves] for i in lanes]
        return tuple(np.concatenate(of) for of in edges)

    def on_card(self, drives: Drives, t: float) -> CardState:
        return self.state


@dataclass(frozen=True, slots=True)
class PlannedMotion(SessionMotion):
    """A planned motion: the planner's pulses."""

    begun: float
    pulses: PulseSchedule
    trajectory: Trajectory

    @property
    def end(self) -> float:
        return self.begun + self.pulses.duration

    @property
    def moving_axes(self) -> np.ndarray:
        return np.array([len(axis) > 0 for axis in self.pulses.axes])

    def counts(self, t: float) -> np.ndarray:
        if t >= self.end:  # the last pulses may be moved a tick past it
            return np.array([axis.final for axis in self.pulses.axes])
        return np.asarray(self.pulses.counts(t - self.begun)[0])

    def directions_between(self, since: float, until: float) -> tuple[np.ndarray, ...]:
        ticks = (since - self.begun, np.inf if until >= self.end else until - self.begun)
        a, b = (np.ceil(t * self.pulses.clock_hz) for t in ticks)
        return tuple(
            axis.direction[(axis.ticks >= a) & (axis.ticks < b)] for axis in self.pulses.axes
        )

    def on_card(self, drives: Drives, t: float) -> CardState:
        state, since = (
            self.trajectory.at(t - self.begun),
            np.full(len(drives.names), t - self.begun),
        )
        scale = np.array([axis.pulse for axis in self.pulses.axes])
        home = np.array([axis.home for axis in self.pulses.axes])
        counts = self.counts(t)
        position = np.clip(
            (state.q[0] - home) / scale, counts - MAX_COUNT_OFFSET, counts + MAX_COUNT_OFFSET
        )
        speed = state.qd[0] / scale
        return CardState(
            (ramp(since, position, speed, speed, 0.0),), np.zeros(len(counts), np.int64)
        )


def trapezoid_motion(
    drives: Drives, counts: np.ndarray, target: np.ndarray, speed: Array, t: float
) -> CardMotion:
    """Axes from counts (n,) to a target (n,) at speeds (n,), all starting at t, each by a trapezoid
    of its own.

    The speed v is reached over X_a = v²/(2a); where a way is 2 X_a or less it is a triangle of two
    equal halves.
    """
    card, least = drives.card, drives.card.least_speed
    axes = np.flatnonzero(np.asarray(target) != counts)
    seconds = np.maximum(speed - least, 0.0) / drives.acceleration
    members = tuple(
        (
            (int(i),),
            TAMove(
                target, np.full(len(counts), least), speed, float(seconds[i]), float(seconds[i])
            ),
        )
        for i in axes
    )
    state = at_rest(counts)
    return CardMotion(t, send(card, state, Together(members), 0.0) if members else state)


def halt_motion(drives: Drives, motion: SessionMotion, t: float) -> CardMotion:
    """The motion with a decelerated stop sent at t (s), each axis as fast as its own acceleration
    lets it.

    So no axis leaves its travel where the motion would not have; the tool of a planned one leaves
    its line.
    """
    state, since = motion.on_card(drives, t), t - motion.begun
    speed = np.abs(state.current_move(since).speed(since))
    members = tuple(
        ((i,), DStop(float(v / a)))
        for i, (v, a) in enumerate(zip(speed, drives.acceleration, strict=True))
    )
    return CardMotion(motion.begun, send(drives.card, state, Together(members), since))
