"""The channels as a command finds them, and how its values go into the card's registers or are
refused.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from controllers.card.model import Card, Refused
from controllers.card.profile import MoveProfile
from kinematics.foundation.arrays import Array, freeze_array
from planner.pulses.schedule import COUNTER


@dataclass(frozen=True, slots=True)
class Channels:
    """The card's channels at the instant a command begins, lanes (…) being (n,) or (B, n).

    due       (…) bool, the lanes the command is for: only these are checked
    begin     (…) s
    position  (…) pulses, command position, with its share of a pulse
    speed     (…) pulses/s, signed
    running   the move under way there, or behind which the command waits
    """

    card: Card
    due: np.ndarray
    begin: Array
    position: Array
    speed: Array
    running: MoveProfile

    def magnitude(self, what: str, speed: Array) -> Array:
        """Speeds (…) as the speed register holds them, direction left out: one step of it at
        least.
        """
        return np.broadcast_to(
            self.card.round_speed(self._check_speed(what, speed)), self.due.shape
        )

    def register_speed(self, what: str, speed: Array) -> Array:
        """Speeds (…) as the speed register and the direction bit hold them; zero is none."""
        held = self.card.round_speed(self._check_speed(what, speed))
        return np.asarray(np.broadcast_to(np.sign(speed) * held, self.due.shape))

    def target(self, position: Array) -> Array:
        """Whole positions (…) that the counters can come to."""
        low, high = COUNTER
        position = np.broadcast_to(position, self.due.shape)
        fine = (position >= low) & (position <= high)
        self.refuse("position", position, fine, f"{low} … {high} pulses", "28-bit position counter")
        return position

    def add_distance(self, distance: Array) -> Array:
        """Whole positions (…) that many whole pulses on from the counters, which may wrap round
        where the card says.
        """
        goal = np.rint(self.position) + np.rint(distance)
        if self.card.beyond_counter == "refuse":
            return self.target(goal)
        low, high = COUNTER
        fine = (distance >= low) & (distance <= high)
        self.refuse(
            "distance", distance, fine, f"{low} … {high} pulses", "28-bit position register"
        )
        return goal

    def ramp(self, what: str, seconds: float) -> float:
        """Time of a ramp, s: none where it is within one tick of the clock."""
        if not 0 <= seconds < float("inf"):
            raise Refused(f"{self.card.name}: {what} time {seconds} s must be zero or more")
        return 0.0 if seconds * self.card.clock_hz < 1 else seconds

    def goes_on(self, way: Array) -> np.ndarray:
        """(…) whether a move of that sign begins at the speed of the instant, on a card that is set
        so.
        """
        return np.asarray((self.card.start_from == "current") & (self.speed * way > 0))

    def refuse(self, what: str, values: Array, fine: np.ndarray, limit: str, owner: str) -> None:
        """Raise Refused for the first of the due lanes whose value is not fine."""
        wrong = self.due & ~fine
        if wrong.any():
            lane = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
            raise Refused(
                f"{self.card.name}, channel {int(lane[-1]) + 1}: {what} "
                f"{np.broadcast_to(values, wrong.shape)[lane]:.10g} is outside {limit} of the {owner}; slow the motion "
                "down, or choose a card or a pulse that covers it"
            )

    def forbid(self, wrong: np.ndarray, reason: str) -> None:
        """Raise Refused with a reason for the first of the due lanes where `wrong` is true."""
        wrong = self.due & wrong
        if wrong.any():
            lane = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
            raise Refused(f"{self.card.name}, channel {int(lane[-1]) + 1}: {reason}")

    def _check_speed(self, what: str, speed: Array) -> Array:
        if speed.shape[-1] != self.due.shape[-1]:
            raise Refused(
                f"{self.card.name}: a command for {speed.shape[-1]} channels cannot start {self.due.shape[-1]} channels"
            )
        top = self.card.top_speed
        self.refuse(what, speed, np.abs(speed) <= top, f"±{top:.10g} pulses/s", "speed register")
        return speed


class Command(ABC):
    """A command of the card, addressed to all channels at once, one value per lane, where it does
    not name channels.

    The host writes the channels one after another and starts them together. Positions are pulses of
    the step output, positive where the axis' own coordinate grows. All commands take effect at the
    instant they are sent (assumed).
    """

    __slots__ = ()

    @property
    def waits(self) -> bool:
        """Whether a card that queues puts it behind the move under way; the others act at once on
        any card.
        """
        return True

    @property
    def joint(self) -> bool:
        """Whether its channels run as one: none starts, or is stopped by a limit, without the
        others.
        """
        return False

    @property
    def has_soft_limits(self) -> bool:
        """Whether soft limits hold for it."""
        return True

    def select_lanes(self, card: Card, lanes: tuple[int, ...]) -> np.ndarray:
        """The lanes that it is for, bool, of the shape `lanes` or one that numpy stretches to
        it.
        """
        return np.ones(lanes, bool)

    @abstractmethod
    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        """What the channels do from then on, one after another. Raises Refused, with the reason."""


def broadcast_lanes(command: object, *names: str) -> None:
    """Make fields of a frozen command arrays of one shape, that of their lanes."""
    fields = [np.atleast_1d(np.asarray(getattr(command, name), np.float64)) for name in names]
    if any(field.shape != fields[0].shape for field in fields):
        fields = [np.array(field) for field in np.broadcast_arrays(*fields)]
    for name, field in zip(names, fields, strict=True):
        object.__setattr__(command, name, freeze_array(field))
