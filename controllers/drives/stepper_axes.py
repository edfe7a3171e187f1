"""Stepper axes at work: rotors that hang on to a field, sample by sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controllers.drives.axes import Response, follow, measured, values
from controllers.drives.rotor import Rotor, advance, rotor
from controllers.stepper import Stepper
from kinematics.array import Array, frozen

SUBSTEPS = 4
"""Parts of a sample within which the torque is held, at its value in the middle: a rotor swings at its own frequency to
(ω h)²/24, which is 3e-4 where `Stepper` allows the least."""
SLIPPED = 0.75
"""Turns of the field against the rotor at which a slip is counted: half-way to the next stable place lies the unstable
one, and swinging beyond it for a moment is none."""


@dataclass(frozen=True, slots=True)
class StepperState:
    """Rotor x, output y, speed v, field r, the field's turn that the rotor is in, and how many it lost, all (B, n)."""

    x: Array
    y: Array
    v: Array
    r: Array
    turn: Array
    slips: Array

    def __post_init__(self) -> None:
        for name in StepperState.__slots__:
            object.__setattr__(self, name, frozen(getattr(self, name)))


@dataclass(frozen=True, slots=True)
class StepperAxes:
    """Steppers as lanes (B, n); bends (P, 2, B, n): speed, and by how much the torque curve's slope changes there."""

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
        return self._read(state.x, state.r)

    def run(self, state: StepperState, command: Array, kept: np.ndarray) -> tuple[Response, StepperState]:
        x, y, v, r, turn, slips = (getattr(state, name).copy() for name in StepperState.__slots__)
        told = [np.empty((len(kept), *x.shape)) for _ in range(4)]
        part, work = np.empty_like(x), np.empty((4, *x.shape))
        h = self.rotor.h
        wave = np.pi / 2 / self.full_step
        keep = iter([*kept.tolist(), -1])
        place, row = next(keep), 0
        for i, wanted in enumerate(command):
            rate = (wanted - r) / self.sample
            peak, slip_torque = self._peak(np.abs(rate)), self.damping * rate
            for n in range(SUBSTEPS):
                lag = r + rate * ((n + 0.5) * h) - x - v * (h / 2)
                torque = peak * np.sin(wave * lag) + slip_torque
                if n == 0 and i == place:
                    told[0][row], told[2][row], told[3][row] = y, v, torque - self.damping * v
                    told[1][row] = self._read(x, r)
                    place, row = next(keep), row + 1
                advance(self.rotor, x, v, torque, work)
            r = wanted
            follow(y, x, self.half_play, part)
            turns = (r - x) / (4 * self.full_step)
            slipped = np.where(np.abs(turns - turn) > SLIPPED, np.rint(turns), turn)
            slips += np.abs(slipped - turn)
            turn = slipped
        return Response(*told), StepperState(x, y, v, np.array(r), turn, slips)

    def lost(self, state: StepperState) -> np.ndarray:
        return np.asarray(4 * state.slips, np.int64)

    def _read(self, x: Array, r: Array) -> Array:
        there = self.encoder > 0
        return np.where(there, measured(np.where(there, self.encoder, 1.0), x), r)

    def _peak(self, rate: Array) -> Array:
        peak = self.peak.copy()
        for speed, bend in self.bends:
            peak += bend * np.maximum(rate - speed, 0.0)
        return np.where(rate > self.fastest, 0.0, np.maximum(peak, 0.0))


def stepper_axes(drives: Sequence[Sequence[Stepper]], sample: float) -> StepperAxes:
    """B rows of one stepper per axis, as lanes. The damping acts as friction against a field that stands."""
    damping = values("damping", drives)
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
            values("inertia", drives),
            values("friction", drives) + damping,
            values("coulomb", drives),
            sample / SUBSTEPS,
        ),
        full_step=values("full_step", drives),
        damping=damping,
        encoder=values("encoder", drives),
        half_play=frozen(values("play", drives) / 2),
        peak=frozen([[curve[0, 1] for curve in row] for row in curves]),
        bends=frozen(bends),
        fastest=frozen([[curve[-1, 0] for curve in row] for row in curves]),
    )
