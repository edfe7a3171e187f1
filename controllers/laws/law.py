"""What a tracking law is: at each step of the host, the next command from the reference and the
feedback.

One that remembers gets its memory of the step before as well.

Its gains are a number each, or one for each run of a batch. A stretch of command whose speed is a
straight line goes to the card as one command.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from controllers.card import Command, TAMove
from controllers.rig import Timer
from kinematics.foundation.arrays import Array, finite_array, freeze_array, numeric_array
from kinematics.foundation.errors import MotionError

Gain = float | Array
"""A number, or an array (B, 1) with one value for each run of a batch."""

Grid = Mapping[str, tuple[float, ...]]
"""The values of each gain that reports sweep."""


def check_gain(law: str, name: str, value: Gain, advice: str) -> Gain:
    """The gain as a float or a read-only array.

    Raises MotionError unless finite, and a number or (B, 1).
    """
    values = numeric_array(value)
    if values is None:
        raise MotionError(
            f"law {law}: {name} is {value!r:.60}; expected a number, or an array (B, 1) of them; {advice}"
        )
    if values.ndim not in (0, 2) or (values.ndim == 2 and values.shape[1] != 1):
        raise MotionError(
            f"law {law}: {name} has shape {values.shape}; give a number, or an array (B, 1) of one value for each run"
        )
    wrong = values[~np.isfinite(values)]
    if wrong.size:
        raise MotionError(f"law {law}: {name} {wrong[0]} must be a finite number; {advice}")
    return freeze_array(values) if values.ndim else float(values)


def format_gain(value: Gain) -> str:
    """The gain in a name: "0.7", or "0.5…0.9" where runs differ."""
    low, high = np.min(value), np.max(value)
    return f"{low:g}" if low == high else f"{low:g}…{high:g}"


@dataclass(frozen=True, slots=True)
class Reference:
    """The planned motion as the host holds it, whole and beforehand: samples at k·dt of every axis,
    then rest.

    dt        s
    position  (N + 1, n) pulses from home, unrounded
    speed     as position, pulses/s, signed
    """

    dt: float
    position: Array
    speed: Array
    _heading: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not finite_array(self.dt, "reference: dt", (), unit="s") > 0:
            raise MotionError(f"reference: dt {self.dt} s must be above 0")
        for name, unit in (("position", "pulses"), ("speed", "pulses/s")):
            samples = finite_array(
                getattr(self, name), f"reference: {name}", (None, None), unit=unit
            )
            object.__setattr__(self, name, freeze_array(samples))
        if not self.position.size or self.position.shape != self.speed.shape:
            shapes = f"{self.position.shape} and {self.speed.shape}"
            raise MotionError(
                f"reference: position and speed are {shapes}; give one speed for each position"
            )
        sign = np.where(np.abs(self.speed) > _REST_SPEED, np.sign(self.speed), 0.0)
        last = np.maximum.accumulate(np.where(sign != 0, np.arange(len(sign))[:, None], 0))
        object.__setattr__(self, "_heading", freeze_array(np.take_along_axis(sign, last, 0)))

    @property
    def steps(self) -> int:
        """N: the last sample is at N·dt."""
        return len(self.position) - 1

    def ang(self, k: int | np.ndarray) -> Array:
        """Reference position (n,), whole pulses, at k·dt; the last one afterwards. k (B,), a step
        of each run: (B, n).

        Whole, since a feedback law that chased a share of a pulse would never come to rest at the
        end.
        """
        return np.rint(self.position[np.minimum(k, self.steps)])

    def npuls(self, k: int | np.ndarray) -> Array:
        """Reference speed, pulses/s, at k·dt, shaped as `ang`; zero after the end."""
        speed = self.speed[np.minimum(k, self.steps)]
        return np.where(np.asarray(k)[..., None] <= self.steps, speed, 0.0)

    def heading(self, t: Array) -> Array:
        """±1 by the way that each axis runs at t, or ran before it came to rest; 0 before it moves.
        t as `between`.
        """
        speed = self.between(t, before=True)[1]
        k = np.clip(np.floor(t / self.dt + 1e-9), 0, self.steps).astype(int)
        return np.where(
            np.abs(speed) > _REST_SPEED,
            np.sign(speed),
            self._heading[k, np.arange(speed.shape[-1])],
        )

    def between(self, t: Array, *, before: bool = False) -> tuple[Array, Array, Array]:
        """Return position, speed and acceleration at any instants t (…, n), s, which may differ by
        axis.

        The cubic through the positions and speeds of the samples on both sides: within dt⁴/384 ·
        |r⁗| of the motion where that is smooth between them. Rest before the first and after the
        last sample.

        before  at a sample itself the acceleration jumps: the one before it instead of the one
                after
        """
        at = t / self.dt
        # an instant that rounding has put beside a sample is at it
        step = np.ceil(at - 1e-9) - 1 if before else np.floor(at + 1e-9)
        k = np.clip(step, 0, self.steps - 1).astype(int)
        moving = (step >= 0) & (step < self.steps)
        axis = np.arange(self.position.shape[1])
        p0, p1 = self.position[k, axis], self.position[k + 1, axis]
        v0, v1 = self.speed[k, axis] * self.dt, self.speed[k + 1, axis] * self.dt
        u = np.clip(at - k, 0.0, 1.0)
        bend, twist = 3 * (p1 - p0) - 2 * v0 - v1, v0 + v1 - 2 * (p1 - p0)
        position = p0 + u * (v0 + u * (bend + u * twist))
        speed = np.where(moving, v0 + u * (2 * bend + u * 3 * twist), 0.0) / self.dt
        return position, speed, np.where(moving, 2 * bend + u * 6 * twist, 0.0) / self.dt**2


_REST_SPEED = 1e-3
"""Pulses/s: below it an axis rests, but for rounding."""


@dataclass(frozen=True, slots=True)
class Feedback:
    """What the host reads as step k begins, which is the end of step k − 1; arrays (…) as the
    card's lanes.

    position  pos(k − 1), pulses: the encoders, latched
    speed     v(k − 1), pulses/s: the change of `position` over the step that ends here, divided by
              its time; or the card's output rate now, as the host is set
              (`controllers.rig.Host.speed_from`)
    counter   the card's own position counter, pulses
    Raises MotionError for what is no numbers, and arrays of different shapes.
    """

    position: Array
    speed: Array
    counter: Array

    def __post_init__(self) -> None:
        for name, unit in (("position", "pulses"), ("speed", "pulses/s"), ("counter", "pulses")):
            given = getattr(self, name)
            if (
                type(given) is not np.ndarray or given.dtype.kind != "f"
            ):  # one is made for every step
                object.__setattr__(self, name, finite_array(given, f"feedback: {name}", unit=unit))
        if not self.position.shape == self.speed.shape == self.counter.shape:
            shapes = f"{self.position.shape}, {self.speed.shape} and {self.counter.shape}"
            raise MotionError(
                f"feedback: position, speed and counter are {shapes}; give one of each for every lane"
            )


class Law(Protocol):
    """A tracking law.

    All axes, and all runs of a batch, are commanded at once; a law object never changes.

    One that has to remember something from step to step is a `StatefulLaw`.

    Gains are numbers, or arrays (B, 1) with one value for each run of a batch. `grid` says which of
    the law's fields are gains, and the values of each that reports sweep.
    """

    @property
    def host(self) -> Timer:
        """The timing that the law is meant for."""

    @property
    def grid(self) -> Grid:
        """Gain -> values to sweep."""

    @property
    def name(self) -> str:
        """The law and its gains, for tables."""

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> Command:
        """What to send at step k, in force until step k + 1 begins; k (B,) where runs are at steps
        of their own.
        """


Memory = tuple[Array, ...]
"""What a law remembers from step to step: arrays (B, n, …), first the B runs and n axes."""


@runtime_checkable
class StatefulLaw(Protocol):
    """A tracking law that remembers, as an integral does.

    Its memory is handed in and out and never kept in the law.

    So every run begins afresh, runs of a batch do not mix, and the same run twice gives the same
    result. `host`, `grid` and `name` are as of `Law`.
    """

    @property
    def host(self) -> Timer: ...
    @property
    def grid(self) -> Grid: ...
    @property
    def name(self) -> str: ...

    def begin(self, lanes: tuple[int, int]) -> Memory:
        """The memory before the first step of B runs of n axes; lanes: (B, n)."""

    def step(
        self, k: int | np.ndarray, reference: Reference, feedback: Feedback, memory: Memory
    ) -> tuple[Command, Memory]:
        """What to send, as `Law.command`, and the memory after it: as many arrays, of the same
        shapes, as before it.
        """


AnyLaw = Law | StatefulLaw


def begin_law(law: AnyLaw, lanes: tuple[int, int]) -> Memory:
    """The memory that a law begins with.

    Raises MotionError for one that does not fit runs and axes (B, n).
    """
    return (
        _check_memory(law, "begin", law.begin(lanes), lanes) if isinstance(law, StatefulLaw) else ()
    )


def step_law(
    law: AnyLaw, k: int | np.ndarray, reference: Reference, feedback: Feedback, memory: Memory
) -> tuple[Command, Memory]:
    """The law's command and its memory afterwards.

    Raises MotionError for memory of another shape than before.
    """
    if not isinstance(law, StatefulLaw):
        return law.command(k, reference, feedback), ()
    # of its own: what a law writes into it must not reach the runs that keep theirs as it was
    made: Any = law.step(k, reference, feedback, tuple(each.copy() for each in memory))
    if not isinstance(made, tuple) or len(made) != 2:
        raise MotionError(
            f"law {law.name}: step must return the command and the memory, not {made!r:.80}"
        )
    after = _check_memory(law, "step", made[1], np.shape(feedback.position))
    before = [np.shape(each) for each in memory]
    if [each.shape for each in after] != before:
        raise MotionError(
            f"law {law.name}: step returned memory of shapes {[each.shape for each in after]}; it got {before}"
        )
    return made[0], after


def _check_memory(law: StatefulLaw, method: str, memory: object, lanes: tuple[int, ...]) -> Memory:
    arrays = [numeric_array(each) for each in memory] if isinstance(memory, tuple) else [None]
    if any(each is None or each.shape[: len(lanes)] != tuple(lanes) for each in arrays):
        raise MotionError(
            f"law {law.name}: {method} must return a tuple of arrays {tuple(lanes)}, runs and axes first, "
            f"not {memory!r:.80}"
        )
    return tuple(each for each in arrays if each is not None)


def check_ramp(law: str, ramp: float) -> None:
    """Raise MotionError for a ramp whose share of a step is not above 0 and at most ½."""
    if not 0 < ramp <= 0.5:
        raise MotionError(f"law {law}: ramp {ramp} must be above 0 and at most 0.5 of the step")


def trapezoid(target: Array, counter: Array, dt: float, share: float) -> TAMove:
    """Return the move to `target` in exactly dt, from rest to rest, with ramps of a share of dt
    each.

    target, counter  (…) pulses
    """
    tacc = share * dt
    top = np.abs(target - counter) / (dt - tacc)
    return TAMove(np.broadcast_to(target, top.shape), np.zeros_like(top), top, tacc, tacc)


def ramp(target: Array, start: Array, end: Array, counter: Array, dt: float) -> TAMove:
    """TAMove to `target` in exactly dt, the speed going from about `start` to about `end` (signed,
    pulses/s).

    The speeds are both moved by what makes their mean (target − counter)/dt: so what rounding left
    undone before is made up for here, and nothing adds up. A speed that then points the other way
    becomes zero and the other twice the mean: one command of the card does not turn round.

    target, counter  (…) pulses, the target rounded to whole ones
    """
    way = np.rint(target) - counter
    mean, side = np.abs(way) / dt, np.where(way < 0, -1.0, 1.0)
    half = np.clip(side * (end - start) / 2, -mean, mean)
    return TAMove(counter + way, mean - half, mean + half, dt, 0.0)
