"""Servo axes at work: the loops of `Servo`, sample by sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controllers.drives.axes import Response, follow, measured, values
from controllers.drives.rotor import Rotor, advance, rotor
from controllers.servo import Servo
from kinematics.array import Array, frozen


@dataclass(frozen=True, slots=True)
class ServoState:
    """Motor x, output y, speed v and integral torque (B, n); commands and torques under way (delay, B, n)."""

    x: Array
    y: Array
    v: Array
    integral: Array
    commands: Array
    torques: Array

    def __post_init__(self) -> None:
        for name in ServoState.__slots__:
            object.__setattr__(self, name, frozen(getattr(self, name)))


@dataclass(frozen=True, slots=True)
class ServoAxes:
    """Servos as lanes (B, n); delays in samples."""

    sample: float
    rotor: Rotor
    position_gain: Array
    speed_gain: Array
    integral_gain: Array
    torque_limit: Array
    encoder: Array
    half_play: Array
    at_output: np.ndarray
    command_delay: np.ndarray
    loop_delay: np.ndarray

    def standing(self, x: Array) -> ServoState:
        x = np.array(x, float)
        before = np.broadcast_to(x, (int(self.command_delay.max()), *x.shape)).copy()
        none = np.zeros((int(self.loop_delay.max()), *x.shape))
        return ServoState(x, x.copy(), np.zeros_like(x), np.zeros_like(x), before, none)

    def reading(self, state: ServoState) -> Array:
        return measured(self.encoder, np.where(self.at_output, state.y, state.x))

    def run(self, state: ServoState, command: Array, kept: np.ndarray) -> tuple[Response, ServoState]:
        x, y, v, integral = (getattr(state, name).copy() for name in ("x", "y", "v", "integral"))
        late, commands = _delayed(command, state.commands, self.command_delay)
        told = [np.empty((len(kept), *x.shape)) for _ in range(4)]
        error, part, given = np.empty((3, *x.shape))
        work = np.empty((4, *x.shape))
        free, lowest = np.empty(x.shape, bool), -self.torque_limit
        some_output, some_play = self.at_output.any(), self.half_play.any()
        longest = len(state.torques)
        ring = np.concatenate([given[None], state.torques]) if longest else state.torques
        keep = iter([*kept.tolist(), -1])
        place, row = next(keep), 0
        for i, wanted in enumerate(late):
            seen = np.where(self.at_output, y, x) if some_output else x
            np.multiply(seen, self.encoder, out=part)
            np.rint(part, out=part)
            np.divide(part, self.encoder, out=part)
            if i == place:
                told[1][row] = part
            np.subtract(wanted, part, out=error)
            np.multiply(error, self.position_gain, out=error)
            np.subtract(error, v, out=error)
            np.multiply(error, self.speed_gain, out=part)
            np.add(part, integral, out=part)
            np.maximum(part, lowest, out=given)
            np.minimum(given, self.torque_limit, out=given)
            np.equal(part, given, out=free)
            np.multiply(error, self.integral_gain, out=error)
            np.multiply(error, free, out=error)
            np.add(integral, error, out=integral)
            torque = given
            if longest:
                ring[i % (longest + 1)] = given
                torque = np.take_along_axis(ring, ((i - self.loop_delay) % (longest + 1))[None], 0)[0]
            if i == place:
                told[0][row], told[2][row], told[3][row] = y if some_play else x, v, torque
                place, row = next(keep), row + 1
            advance(self.rotor, x, v, torque, work)
            if some_play:
                follow(y, x, self.half_play, part)
        if not some_play:
            y = x
        if longest:  # the oldest first, for the next run to begin with
            ring = np.roll(ring, -(len(late) % (longest + 1)), 0)[1:]
        return Response(*told), ServoState(x, y, v, integral, commands, ring)

    def lost(self, state: ServoState) -> np.ndarray:
        return np.zeros(state.x.shape, np.int64)


def servo_axes(drives: Sequence[Sequence[Servo]], sample: float) -> ServoAxes:
    """B rows of one servo per axis, as lanes."""
    lanes = {
        name: values(name, drives)
        for name in ("position_gain", "torque_limit", "encoder", "inertia", "inertia_factor", "friction", "coulomb")
    }
    speed_gain = lanes["inertia"] * 2 * np.pi * values("speed_loop", drives)
    return ServoAxes(
        sample=sample,
        rotor=rotor(lanes["inertia"] * lanes["inertia_factor"], lanes["friction"], lanes["coulomb"], sample),
        position_gain=lanes["position_gain"],
        speed_gain=frozen(speed_gain),
        integral_gain=frozen(speed_gain / values("integral_time", drives) * sample),
        torque_limit=lanes["torque_limit"],
        encoder=lanes["encoder"],
        half_play=frozen(values("play", drives) / 2),
        at_output=frozen(values("feedback", drives) == "output"),
        command_delay=values("command_delay", drives),
        loop_delay=values("loop_delay", drives),
    )


def _delayed(command: Array, before: Array, delay: np.ndarray) -> tuple[Array, Array]:
    """The commands (N, B, n) as many samples late as each lane says, and those that are still under way after them."""
    longest = len(before)
    if not longest:
        return command, before
    every = np.concatenate([before, command])
    if (delay == longest).all():
        late = every[: len(command)]
    else:
        late = np.take_along_axis(every, np.arange(len(command))[:, None, None] + longest - delay, 0)
    return late, every[len(command) :].copy()
