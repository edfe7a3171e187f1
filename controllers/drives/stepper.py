"""A stepper axis: a rotor that hangs on to a field, which the pulses turn; as data, and at work,
sample by sample.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

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
from kinematics.foundation.arrays import Array, finite_array, freeze_array, freeze_fields
from kinematics.foundation.errors import MotionError
from kinematics.foundation.kernels import (
    FixedFloats3,
    FixedFloats4,
    FixedStrided2,
    Floats2,
    Floats3,
    Floats4,
    Ints1,
    kernel,
)


@dataclass(frozen=True, slots=True)
class Stepper:
    """One open-loop stepper axis in the coordinate of its output: metres and newtons, or radians
    and newton metres.

    With x the position, v the speed and r the field's position, which runs straight from the count
    of one sample of the drive to that of the next:

        torque   τ = −T(|ṙ|) sin(π/2 · (x − r)/full step) − d (v − ṙ)
        rotor    J v̇ = τ − b v − c sign(v); at rest it sticks while |τ| ≤ c

    So the rotor has a stable place every four full steps: when the torque is exceeded it falls
    behind by four, or a multiple of it, and what it lost stays lost. Assumed: the torque curve is
    that of the rate of steps, not of the rotor's speed; the drive's microsteps make the field turn
    evenly; the play is kinematic, as a servo's.

    torque_speed   ((speed, torque), …) speeds rising from 0: the peak torque at a rate of steps;
                   none beyond the last
    full_step      m or rad
    inertia        J, kg or kg·m², load included
    damping        d, against slip between rotor and field; friction  b, viscous; both N·s/m or
                   N·m·s/rad
    coulomb        c, N or N·m
    play           m or rad between motor and output
    encoder        counts per m or rad, which the host may read; 0: there is none, and it reads the
                   pulses sent
    sample         s, period at which the field's course is set
    """

    torque_speed: tuple[tuple[float, float], ...]
    full_step: float
    inertia: float
    damping: float = 0.0
    friction: float = 0.0
    coulomb: float = 0.0
    play: float = 0.0
    encoder: float = 0.0
    sample: float = 0.25e-3

    def __post_init__(self) -> None:
        curve = finite_array(self.torque_speed, "stepper: torque_speed", (None, 2), least=0.0)
        if (
            len(curve) < 2
            or curve[0, 0] != 0
            or (np.diff(curve[:, 0]) <= 0).any()
            or curve[0, 1] == 0
        ):
            raise MotionError(
                f"stepper: torque_speed {self.torque_speed} must be two or more points, speeds rising from 0, "
                "with a torque at rest"
            )
        object.__setattr__(self, "torque_speed", tuple(map(tuple, curve.tolist())))
        for name in (
            "full_step",
            "inertia",
            "damping",
            "friction",
            "coulomb",
            "play",
            "encoder",
            "sample",
        ):
            value = getattr(self, name)
            lowest = np.finfo(float).tiny if name in ("full_step", "inertia", "sample") else 0.0
            if not lowest <= value < float("inf"):
                raise MotionError(
                    f"stepper: {name} {value} must be finite, and {'above' if lowest else 'not below'} 0"
                )
        if self.swing * self.sample > 1.0:
            raise MotionError(
                f"stepper: sample {self.sample} s is too long for a rotor that swings at {self.swing:.4g} rad/s; "
                f"take {1 / self.swing:.2g} s or less"
            )

    @property
    def torque_limit(self) -> float:
        """N or N·m: the most it gives at any rate of steps."""
        return max(torque for _, torque in self.torque_speed)

    def disturb(self, inertia: float, friction: float) -> Stepper:
        """The same axis with other true inertia and friction (factors)."""
        return replace(
            self,
            inertia=self.inertia * inertia,
            friction=self.friction * friction,
            coulomb=self.coulomb * friction,
        )

    @property
    def swing(self) -> float:
        """rad/s of small oscillations about a step at rest: ω² = π T(0)/(2 · full step · J)."""
        return float(np.sqrt(np.pi / 2 * self.torque_speed[0][1] / self.full_step / self.inertia))


SUBSTEPS = 4
"""Parts of a sample within which the torque is held, at its value in the middle: a rotor swings at
its own frequency to (ω h)²/24, which is 3e-4 where `Stepper` allows the least.
"""
SLIP_TURNS = 0.75
"""Turns of the field against the rotor at which a slip is counted: half-way to the next stable
place lies the unstable one, and swinging beyond it for a moment is none.
"""


@dataclass(frozen=True, slots=True)
class StepperState:
    """Rotor x, output y, speed v, field r, the field's turn that the rotor is in, and how many it
    lost, all (B, n).
    """

    x: Array
    y: Array
    v: Array
    r: Array
    turn: Array
    slips: Array

    def __post_init__(self) -> None:
        freeze_fields(self, *StepperState.__slots__)


@dataclass(frozen=True, slots=True)
class StepperAxes:
    """Steppers as lanes (B, n); bends (P, 2, B, n): speed, and by how much the torque curve's slope
    changes there.
    """

    sample: float
    rotor: Rotor
    full_step: Array
    damping: Array
    encoder: Array
    half_play: Array
    peak: Array
    bends: Array
    fastest: Array

    def standing(self, x: Array) -> StepperState:
        x = np.array(x, float)
        none = np.zeros_like(x)
        return StepperState(x, x.copy(), none, x.copy(), none.copy(), none.copy())

    def reading(self, state: StepperState) -> Array:
        there = self.encoder > 0
        return np.where(there, read_encoder(np.where(there, self.encoder, 1.0), state.x), state.r)

    def run(
        self, state: StepperState, command: Array, kept: np.ndarray
    ) -> tuple[AxesResponse, StepperState]:
        x, y, v, r, turn, slips = (getattr(state, name).copy() for name in StepperState.__slots__)
        told = np.empty((4, len(kept), *x.shape))
        _follow_field(
            np.stack(
                [
                    self.full_step,
                    self.damping,
                    self.encoder,
                    self.half_play,
                    self.peak,
                    self.fastest,
                ]
            ),
            self.bends,
            self.sample,
            (self.rotor.h, self.rotor.lanes),
            np.ascontiguousarray(command),
            (x, y, v, r, turn, slips),
            (kept, told),
        )
        return AxesResponse(*told), StepperState(x, y, v, r, turn, slips)

    def count_lost_steps(self, state: StepperState) -> np.ndarray:
        return np.asarray(4 * state.slips, np.int64)


@kernel
def peak_torque(rest: float, bends: FixedStrided2, fastest: float, rate: float) -> float:
    """N or N·m at a rate of steps, of one drive, whose bends are (P, 2)."""
    peak = rest
    for speed, bend in bends:
        peak += bend * max(rate - speed, 0.0)
    return 0.0 if rate > fastest else max(peak, 0.0)


@kernel
def _follow_field(
    drives: Floats3,
    bends: FixedFloats4,
    sample: float,
    rotor: tuple[float, FixedFloats3],
    commands: Floats3,
    state: tuple[Floats2, Floats2, Floats2, Floats2, Floats2, Floats2],
    record: tuple[Ints1, Floats4],
) -> None:
    """`Stepper`'s rotor over N commands (N, B, n), lane by lane; `state` as of `StepperState`,
    written anew.

    drives  (6, B, n): full step, damping, encoder, half the play, torque at rest, the rate without
            torque
    record  the samples to tell of (K,), and of these y, what is read, v and the field's torque (4,
            K, B, n)
    """
    h, rotors = rotor
    kept, told = record
    for b in range(commands.shape[1]):
        for n in range(commands.shape[2]):
            full_step, damping, encoder, half_play, rest, fastest = drives[:, b, n]
            lane, wave = rotors[:, b, n], math.pi / 2 / full_step
            x, y, v = state[0][b, n], state[1][b, n], state[2][b, n]
            r, turn, slips = state[3][b, n], state[4][b, n], state[5][b, n]
            row = 0
            for i in range(len(commands)):
                rate = (commands[i, b, n] - r) / sample
                peak = peak_torque(rest, bends[:, :, b, n], fastest, abs(rate))
                for part in range(SUBSTEPS):
                    lag = r + rate * ((part + 0.5) * h) - x - v * (h / 2)
                    torque = peak * math.sin(wave * lag) + damping * rate
                    if part == 0 and row < len(kept) and kept[row] == i:
                        told[0, row, b, n] = y
                        told[1, row, b, n] = np.rint(x * encoder) / encoder if encoder > 0 else r
                        told[2, row, b, n], told[3, row, b, n] = v, torque - damping * v
                        row += 1
                    x, v = advance(h, lane, x, v, torque)
                r = commands[i, b, n]
                y = apply_play(y, x, half_play)
                turns = (r - x) / (4 * full_step)
                if abs(turns - turn) > SLIP_TURNS:
                    slips += abs(np.rint(turns) - turn)
                    turn = np.rint(turns)
            state[0][b, n], state[1][b, n], state[2][b, n] = x, y, v
            state[3][b, n], state[4][b, n], state[5][b, n] = r, turn, slips


def stepper_axes(drives: Sequence[Sequence[Stepper]], sample: float) -> StepperAxes:
    """B rows of one stepper per axis, as lanes.

    The damping acts as friction against a field that stands.
    """
    damping = stack_values("damping", drives)
    curves = [[np.array(stepper.torque_speed) for stepper in row] for row in drives]
    longest = max(len(curve) for row in curves for curve in row)
    bends = np.zeros((longest, 2, *damping.shape))
    for b, row in enumerate(curves):
        for n, curve in enumerate(row):
            slope = np.diff(curve[:, 1]) / np.diff(curve[:, 0])
            bends[: len(slope), 0, b, n] = curve[:-1, 0]
            bends[: len(slope), 1, b, n] = np.diff(slope, prepend=0.0)
    return StepperAxes(
        sample=sample,
        rotor=rotor(
            stack_values("inertia", drives),
            stack_values("friction", drives) + damping,
            stack_values("coulomb", drives),
            sample / SUBSTEPS,
        ),
        full_step=stack_values("full_step", drives),
        damping=damping,
        encoder=stack_values("encoder", drives),
        half_play=freeze_array(stack_values("play", drives) / 2),
        peak=freeze_array([[curve[0, 1] for curve in row] for row in curves]),
        bends=freeze_array(bends),
        fastest=freeze_array([[curve[-1, 0] for curve in row] for row in curves]),
    )
