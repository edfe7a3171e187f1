"""The deflection of a beam that carries the platform, with its Abbe lever: a source of the accuracy budget."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kinematics.array import Array, finite
from kinematics.beam import Beam
from kinematics.effect import UNIFORM, Effect, not_negative
from kinematics.errors import MotionError
from kinematics.pose import Pose

if TYPE_CHECKING:
    from kinematics.machine import Machine

# Share of a beam by which a pose may be past its end: rounding.
_OFF = 1e-9


@dataclass(frozen=True, slots=True)
class Deflection:
    """The platform rides on a beam, which sinks and tilts under it.

    load, load_error  N of all that rides on the beam, and what it may differ by, ±
    start, along      (3,) m the beam's first support, and its direction; base frame
    down              (3,) the direction of the load
    spans             equal spans one after the other, each on its own two supports

    At c along a span: shift = δ(c) down, turn ω = δ′(c) along × down; the platform, at h from the beam, shifts by
    ω × h more, which is the Abbe error. Source: [Sasidhar 1981, Appendix D].
    """

    beam: Beam
    load: float
    start: tuple[float, float, float]
    along: tuple[float, float, float]
    down: tuple[float, float, float] = (0.0, 0.0, -1.0)
    load_error: float = 0.0
    spans: int = 1
    name: str = "deflection"

    def __post_init__(self) -> None:
        if not isinstance(self.beam, Beam):
            raise MotionError(f"{self.name}: beam must be a Beam, not {self.beam!r}")
        not_negative(self, skip=("beam", "start", "along", "down"))
        if self.spans < 1 or self.spans != int(self.spans):
            raise MotionError(f"{self.name}: {self.spans} spans; a beam has 1, 2 or another whole number")
        _, along, down = (
            finite(getattr(self, what), f"{self.name}: {what}", (3,)) for what in ("start", "along", "down")
        )
        if not along.any() or not down.any():
            raise MotionError(f"{self.name}: along and down are directions, which must not be zero")
        along, down = along / np.linalg.norm(along), down / np.linalg.norm(down)
        if abs(along @ down) > 1e-9:
            raise MotionError(f"{self.name}: the load acts along `down`, which must be square to `along`")

    def effect(self, machine: Machine, pose: Pose, q: Array) -> Effect:
        spread = self.twist(pose.translation, self.load_error)
        return Effect(np.full(1, UNIFORM), pose=spread[:, :, None], bias=self.twist(pose.translation, self.load))

    def twist(self, position: Array, load: float) -> Array:
        """(N, 6) [shift, turn] of a platform with its origin at position (N, 3). Raises MotionError off the beam."""
        along, down = (np.array(v, float) / np.linalg.norm(v) for v in (self.along, self.down))
        offset = position - np.array(self.start)
        place = offset @ along
        length = self.spans * self.beam.span
        off = ~((place >= -_OFF * length) & (place <= length * (1 + _OFF)))
        if off.any():
            k = int(np.argmax(off))
            raise MotionError(
                f"{self.name}: pose {k} is {place[k] * 1e3:.6g} mm along a beam of {length * 1e3:.6g} mm; "
                "check start, along and spans"
            )
        place = np.clip(place, 0.0, length)
        within = np.clip(
            place - self.beam.span * np.minimum(place // self.beam.span, self.spans - 1), 0, self.beam.span
        )
        turn = np.outer(self.beam.slope(load, within), np.cross(along, down))
        lever = offset - np.outer(place, along)
        shift = np.outer(self.beam.deflection(load, within), down) + np.cross(turn, lever)
        return np.concatenate([shift, turn], 1)
