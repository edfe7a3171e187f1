"""A servo axis: position loop around a speed loop around an inertia with friction, behind a gear
with play.

As data, and at work: the loops, sample by sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np

from controllers.drives.axes import (
    AxesResponse,
    Rotor,
    advance,
    apply_play,
    read_encoder,
    rotor,
    stack_values,
)
from kinematics.foundation.arrays import Array, freeze_array, freeze_fields
from kinematics.foundation.errors import MotionError
from kinematics.foundation.kernels import (
    FixedFlags2,
    FixedFloats3,
    FixedInts2,
    Floats2,
    Floats3,
    Floats4,
    Ints1,
    kernel,
)
from kinematics.machine.axis import Axis


@dataclass(frozen=True, slots=True)
class Servo:
    """One servo axis in the coordinate of its output: metres and newtons, or radians and newton
    metres.

    Per sample of the drive, with x the motor's position, v its speed, x̂ the encoder's reading and
    r the position command of `command_delay` samples ago:

        speed error    ε = K (r − x̂) − v
        torque         τ = sat(J ω ε + I),  ω = 2π · speed loop; set `loop_delay` samples later
        integral       I ← I + (J ω / T) ε · sample, while τ does not saturate
        motor          J′ v̇ = τ − b v − c sign(v), τ held over the sample; at rest it sticks while
                       |τ| ≤ c
        output         y ∈ [x − play/2, x + play/2]: it stays where it is until an end of the play
                       pushes it

    Assumed of a drive whose documents print only its gains: the speed loop's gain is normalised by
    the inertia J that the drive is set to (the inertia ratio), whatever the true J′ = J ·
    inertia_factor is; the speed is measured without quantization (an observer), at the motor; the
    integral stops while the torque saturates. Assumed of the play: it is kinematic. The output is
    held by friction, the motor feels the whole inertia all the time, and the gear does not twist.
    At the start the output stands in the middle of the play.

    position_gain  K, 1/s
    speed_loop     Hz;  integral_time  T, s
    torque_limit   N or N·m;  inertia  J, kg or kg·m², load included;  friction  b, viscous, N·s/m
                   or N·m·s/rad
    encoder        counts per m or rad
    sample         s, period of the drive's loops
    coulomb        c, N or N·m
    play           m or rad between motor and output
    feedback       where the encoder sits: x̂ is the reading of x ("motor") or of y ("output")
    command_delay, loop_delay  samples
    """

    position_gain: float
    speed_loop: float
    integral_time: float
    torque_limit: float
    inertia: float
    friction: float
    encoder: float
    sample: float = 0.25e-3
    coulomb: float = 0.0
    play: float = 0.0
    feedback: Literal["motor", "output"] = "motor"
    command_delay: int = 0
    loop_delay: int = 0
    inertia_factor: float = 1.0

    def __post_init__(self) -> None:
        if self.feedback not in ("motor", "output"):
            raise MotionError(f'servo: feedback "{self.feedback}" is neither "motor" nor "output"')
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "feedback":
                continue
            if field.name.endswith("_delay") and value != int(value):
                raise MotionError(f"servo: {field.name} {value} must be a whole number of samples")
            lowest = 0.0 if field.name in _MAY_BE_ZERO else np.finfo(float).tiny
            if not lowest <= value < float("inf"):
                zero = ", ".join(_MAY_BE_ZERO)
                raise MotionError(
                    f"servo: {field.name} {value} must be a positive finite number ({zero} may be zero)"
                )

    def disturb(self, inertia: float, friction: float) -> Servo:
        """The same axis with other true inertia and friction (factors), of which its drive knows
        nothing.
        """
        return replace(
            self,
            inertia_factor=self.inertia_factor * inertia,
            friction=self.friction * friction,
            coulomb=self.coulomb * friction,
        )


_MAY_BE_ZERO = ("friction", "coulomb", "play", "command_delay", "loop_delay")


def leg_servo(axis: Axis) -> Servo:
    """A servo to put behind an axis where one is wanted and none is known, normalised in the axis'
    coordinate.

    An assumption, which whoever makes a rig of it states by its name: no command and no function
    puts it anywhere.

    From [Sahbaz 2007, Table 7.4]: position loop 30 1/s (Pn102), speed loop 30 Hz (Pn100), integral
    30 ms (Pn101, printed as 3000 in units of 0.01 ms), four encoder counts per command pulse
    (Pn202/Pn203, 2048 × 4 counts per revolution). Assumed: unit inertia (the loops are normalised
    by it, so it matters for saturation and friction alone), viscous friction of 5 1/s of it, and as
    torque limit the 220 N of the hexapod's actuator [Sahbaz 2007, Table 3.1]. The hexapod itself
    has stepper legs: this servo answers what it would do behind the drives of the thesis' other
    rig.
    """
    return Servo(
        position_gain=30.0,
        speed_loop=30.0,
        integral_time=30e-3,
        torque_limit=220.0,
        inertia=1.0,
        friction=5.0,
        encoder=4 / axis.pulse,
    )


@dataclass(frozen=True, slots=True)
class ServoState:
    """Motor x, output y, speed v and integral torque (B, n); commands and torques under way (delay,
    B, n).
    """

    x: Array
    y: Array
    v: Array
    integral: Array
    commands: Array
    torques: Array

    def __post_init__(self) -> None:
        freeze_fields(self, *ServoState.__slots__)


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
        return read_encoder(self.encoder, np.where(self.at_output, state.y, state.x))

    def run(
        self, state: ServoState, command: Array, kept: np.ndarray
    ) -> tuple[AxesResponse, ServoState]:
        x, y, v, integral = (getattr(state, name).copy() for name in ("x", "y", "v", "integral"))
        late, commands = _delay_commands(command, state.commands, self.command_delay)
        told = np.empty((4, len(kept), *x.shape))
        given = np.concatenate([state.torques, np.empty((len(command), *x.shape))])
        gains = (
            self.position_gain,
            self.speed_gain,
            self.integral_gain,
            self.torque_limit,
            self.encoder,
        )
        _close_loops(
            np.stack([*gains, self.half_play]),
            self.at_output,
            self.loop_delay,
            (self.rotor.h, self.rotor.lanes),
            np.ascontiguousarray(late),
            (x, y, v, integral),
            given,
            (kept, told),
        )
        return AxesResponse(*told), ServoState(
            x, y, v, integral, commands, given[len(command) :].copy()
        )

    def count_lost_steps(self, state: ServoState) -> np.ndarray:
        return np.zeros(state.x.shape, np.int64)


@kernel
def _close_loops(
    gains: Floats3,
    at_output: FixedFlags2,
    loop_delay: FixedInts2,
    rotor: tuple[float, FixedFloats3],
    commands: Floats3,
    state: tuple[Floats2, Floats2, Floats2, Floats2],
    given: Floats3,
    record: tuple[Ints1, Floats4],
) -> None:
    """`Servo`'s loops over N commands (N, B, n), lane by lane; `state` is x, y, v and the integral,
    written anew.

    gains   (6, B, n): K, J ω, J ω sample/T, limit of the torque, encoder, half the play
    given   (longest delay + N, B, n): the torques under way, and those that are set
    record  the samples to tell of (K,), and of these y, x̂, v and τ (4, K, B, n)
    """
    h, rotors = rotor
    kept, told = record
    longest = len(given) - len(commands)
    for b in range(commands.shape[1]):
        for n in range(commands.shape[2]):
            position_gain, speed_gain, integral_gain, limit, encoder, half_play = gains[:, b, n]
            lane, delay = rotors[:, b, n], longest - loop_delay[b, n]
            x, y, v, integral = state[0][b, n], state[1][b, n], state[2][b, n], state[3][b, n]
            row = 0
            for i in range(len(commands)):
                read = np.rint((y if at_output[b, n] else x) * encoder) / encoder
                error = ((commands[i, b, n] - read) * position_gain) - v
                asked = error * speed_gain + integral
                given[longest + i, b, n] = min(max(asked, -limit), limit)
                if given[longest + i, b, n] == asked:
                    integral += error * integral_gain
                torque = given[delay + i, b, n]
                if row < len(kept) and kept[row] == i:
                    told[0, row, b, n], told[1, row, b, n] = y, read
                    told[2, row, b, n], told[3, row, b, n] = v, torque
                    row += 1
                x, v = advance(h, lane, x, v, torque)
                y = apply_play(y, x, half_play)
            state[0][b, n], state[1][b, n], state[2][b, n], state[3][b, n] = x, y, v, integral


def servo_axes(drives: Sequence[Sequence[Servo]], sample: float) -> ServoAxes:
    """B rows of one servo per axis, as lanes."""
    lanes = {
        name: stack_values(name, drives)
        for name in (
            "position_gain",
            "torque_limit",
            "encoder",
            "inertia",
            "inertia_factor",
            "friction",
            "coulomb",
        )
    }
    speed_gain = lanes["inertia"] * 2 * np.pi * stack_values("speed_loop", drives)
    return ServoAxes(
        sample=sample,
        rotor=rotor(
            lanes["inertia"] * lanes["inertia_factor"], lanes["friction"], lanes["coulomb"], sample
        ),
        position_gain=lanes["position_gain"],
        speed_gain=freeze_array(speed_gain),
        integral_gain=freeze_array(speed_gain / stack_values("integral_time", drives) * sample),
        torque_limit=lanes["torque_limit"],
        encoder=lanes["encoder"],
        half_play=freeze_array(stack_values("play", drives) / 2),
        at_output=freeze_array(stack_values("feedback", drives) == "output"),
        command_delay=stack_values("command_delay", drives),
        loop_delay=stack_values("loop_delay", drives),
    )


def _delay_commands(command: Array, before: Array, delay: np.ndarray) -> tuple[Array, Array]:
    """The commands (N, B, n) as many samples late as each lane says, and those that are still under
    way after them.
    """
    longest = len(before)
    if not longest:
        return command, before
    every = np.concatenate([before, command])
    if (delay == longest).all():
        late = every[: len(command)]
    else:
        late = np.take_along_axis(
            every, np.arange(len(command))[:, None, None] + longest - delay, 0
        )
    return late, every[len(command) :].copy()
