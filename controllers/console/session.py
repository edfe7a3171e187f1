"""The session as a value: mode, registers, what is known of home, and the motion under way."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controllers.console.drives import Drives, driven
from controllers.console.motion import Motion
from controllers.console.words import Mode
from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from kinematics.machine import Machine
from kinematics.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """What the controller knows between two lines.

    An axis' register counts in steps of its motor, clockwise positive, from where HOME was last said, or else from
    where the session began. It is the wiring's count, so `signs` times the card's counter.

    counts   (n,) int64, the card's counters where no motion is under way
    homed    (n,) bool, whether zero is known to be home: only then does travel hold, else its length alone
    offered  (n,) int64 and bool: the last known counters, and of which axes; None: nothing is offered (any more)
    motion   the one under way; jogging: whether it is a jog, which any line ends
    """

    machine: Machine
    drives: Drives
    mode: Mode
    counts: np.ndarray
    homed: np.ndarray
    offered: tuple[np.ndarray, np.ndarray] | None = None
    motion: Motion | None = None
    jogging: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "counts", frozen(self.counts, np.int64))
        object.__setattr__(self, "homed", frozen(self.homed, bool))

    def counters(self, t: float) -> np.ndarray:
        """The card's counters (n,), int64, at t."""
        return self.counts if self.motion is None else self.motion.counts(t)

    def registers(self, t: float) -> np.ndarray:
        """The registers (n,), int64, at t: they follow every pulse."""
        return np.asarray(self.drives.signs * self.counters(t))

    def q(self) -> Array:
        """The axes' coordinates (n,) where they stand; m or rad. They hold where all are homed."""
        pulse = np.array([axis.pulse for axis in self.machine.axes])
        return np.asarray(self.machine.home_q + pulse * self.counts)

    def pose(self) -> Pose:
        """Where the tool stands, relative to home, once all axes are homed. Raises OutOfReach."""
        found = self.machine.forward(self.q(), near=self.machine.home, certify=False).pose
        return self.machine.home.inv() * found

    def unknown(self) -> tuple[str, ...]:
        """The axes that are not homed."""
        return tuple(name for name, homed in zip(self.drives.names, self.homed, strict=True) if not homed)

    def moving(self, motion: Motion, jogging: bool = False) -> Session:
        """With a motion begun, or another in its place; what was offered no longer is."""
        return replace(self, motion=motion, jogging=jogging, offered=None)

    def ended(self) -> Session:
        """With its motion done: the registers stay where it brought them."""
        if self.motion is None:
            return self
        return replace(self, counts=self.motion.counts(np.inf), motion=None, jogging=False)

    def told(self, t: float) -> str:
        """The registers, as "X 100 Y ?-40": a ? before what does not count from home."""
        values = zip(self.drives.names, self.homed, self.registers(t), strict=True)
        return " ".join(f"{name} {'' if homed else '?'}{register}" for name, homed, register in values)


@dataclass(frozen=True, slots=True)
class Saved:
    """What outlives a session: registers by axis, and whether each counts from home and stood still when it was saved.

    pulses  m or rad per step by axis, by which a file for another machine is known
    """

    machine: str
    pulses: dict[str, float]
    registers: dict[str, int]
    homed: dict[str, bool]
    moving: dict[str, bool]


def saved(session: Session, t: float) -> Saved:
    """What to save of a session at t: axes that a motion moves are moving until it has ended."""
    names, registers, known = session.drives.names, session.registers(t), session.homed
    moves = np.zeros(len(names), bool) if session.motion is None else session.motion.moving
    if session.offered is not None:  # what has not been accepted yet can be the next time
        last, listed = session.offered
        registers, known = np.where(known, registers, session.drives.signs * last), known | listed
    return Saved(
        session.machine.name,
        {name: axis.pulse * axis.direction for name, axis in zip(names, session.machine.axes, strict=True)},
        dict(zip(names, registers.tolist(), strict=True)),
        dict(zip(names, known.tolist(), strict=True)),
        dict(zip(names, moves.tolist(), strict=True)),
    )


def opened(machine: Machine, last: Saved | None = None) -> Session:
    """A session at power-up: manual, no axis homed, the last known registers offered where they were known.

    Raises MotionError for a machine that cannot be driven so, and for what was saved of another.
    """
    drives = driven(machine)
    none = np.zeros(len(drives.names), np.int64)
    session = Session(machine, drives, "MAN", none, none)
    if last is None:
        return session
    if last.pulses != saved(session, 0.0).pulses or last.machine != machine.name:
        raise MotionError(
            f"the registers saved are those of a machine {last.machine} with axes {', '.join(last.pulses)}, not of "
            f"{machine.name} as it is now; give another state file, or remove it"
        )
    known = np.array([last.homed[name] and not last.moving[name] for name in drives.names])
    counts = drives.signs * np.array([last.registers[name] for name in drives.names], np.int64)
    known &= (counts >= drives.low) & (counts <= drives.high)
    return replace(session, offered=(frozen(counts), frozen(known)) if known.any() else None)
