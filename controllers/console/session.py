"""The session as a value: mode, registers, what is known of home, and the motion under way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from controllers.console.grammar import Mode
from controllers.console.motion import Drives, SessionMotion, machine_drives
from kinematics.foundation.arrays import Array, freeze_array, freeze_fields
from kinematics.foundation.errors import MotionError
from kinematics.machine.machine import Machine
from kinematics.machine.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class OfferedRegisters:
    """The last known counters (n,) int64, those at which the registers were 0, and of which axes
    they are known.
    """

    counts: np.ndarray
    zero: np.ndarray
    known: np.ndarray

    def __post_init__(self) -> None:
        for name, kind in (("counts", np.int64), ("zero", np.int64), ("known", bool)):
            object.__setattr__(self, name, freeze_array(getattr(self, name), kind))


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """What the controller knows between two lines.

    Two things are kept apart. The counter says where the slide is in its travel, in pulses from
    travel's zero, the home switch. The register is the operator's: steps of the motor, clockwise
    positive, from where HOME was last said, or else from where the session began; that may be any
    place of the travel.

    counts   (n,) int64, the card's counters where no motion is under way
    homed    (n,) bool, whether counters are known to count from travel's zero: only then do its
             ends hold
    zero     (n,) int64, the counters at which the registers are 0
    least, most  (n,) int64, between which the counters have been since the session began: of an
                 axis whose place is
             not known, all that was within one travel
    offered  what a restart offers to ACCEPT; None: nothing (any more)
    motion   the one under way; jogging: whether it is a jog, which any line ends
    """

    machine: Machine
    drives: Drives
    mode: Mode
    counts: np.ndarray
    homed: np.ndarray
    zero: np.ndarray
    least: np.ndarray
    most: np.ndarray
    offered: OfferedRegisters | None = None
    motion: SessionMotion | None = None
    jogging: bool = False

    def __post_init__(self) -> None:
        freeze_fields(self, "counts", "zero", "least", "most", dtype=np.int64)
        object.__setattr__(self, "homed", freeze_array(self.homed, bool))

    def counters(self, t: float) -> np.ndarray:
        """The card's counters (n,), int64, at t."""
        return self.counts if self.motion is None else self.motion.counts(t)

    def registers(self, t: float) -> np.ndarray:
        """The registers (n,), int64, at t: they follow every pulse."""
        return self.read_registers(self.counters(t))

    def read_registers(self, counts: np.ndarray) -> np.ndarray:
        """What the registers (n,) read where the counters do so."""
        return np.asarray(self.drives.signs * (counts - self.zero))

    def window(self) -> tuple[np.ndarray, np.ndarray]:
        """Counters (n,) between which each axis may go: its travel's ends, where they are known.

        Where they are not, as far as one travel reaches around all places at which the axis has
        been.
        """
        low, high = self.drives.reach()
        length = high - low
        return self.drives.clip_to_counter(
            np.where(self.homed, self.drives.low, self.most - length),
            np.where(self.homed, self.drives.high, self.least + length),
        )

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
        return tuple(
            name for name, homed in zip(self.drives.names, self.homed, strict=True) if not homed
        )

    def begin_motion(self, motion: SessionMotion, jogging: bool = False) -> Session:
        """With a motion begun, or another in its place; what was offered no longer is."""
        return replace(self, motion=motion, jogging=jogging, offered=None)

    def finish_motion(self) -> Session:
        """With its motion done: the registers stay where it brought them."""
        if self.motion is None:
            return self
        counts = self.motion.counts(np.inf)  # axes whose place is not known move one way at a time
        least, most = np.minimum(self.least, counts), np.maximum(self.most, counts)
        return replace(self, counts=counts, least=least, most=most, motion=None, jogging=False)

    def place_axes(self, axes: Sequence[int], counts: np.ndarray) -> Session:
        """With axes known to stand at counters (n,) of their travel, where their registers are
        0.
        """
        chosen = np.isin(np.arange(len(self.counts)), axes)
        moved = np.where(chosen, counts - self.counts, 0)
        return replace(
            self,
            counts=self.counts + moved,
            homed=self.homed | chosen,
            zero=np.where(chosen, counts, self.zero),
            least=self.least + moved,
            most=self.most + moved,
        )

    def describe(self, t: float) -> str:
        """The registers, as "X 100 Y ?-40": a ? before what does not count from home."""
        values = zip(self.drives.names, self.homed, self.registers(t), strict=True)
        return " ".join(
            f"{name} {'' if homed else '?'}{register}" for name, homed, register in values
        )


@dataclass(frozen=True, slots=True)
class SavedSession:
    """What outlives a session, by axis.

    pulses     m or rad per step, by which a file for another machine is known
    registers  steps, clockwise positive, from where HOME was said
    counters   pulses from travel's zero
    homed      whether that was known;  moving: whether the axis was moving when this was saved
    """

    machine: str
    pulses: dict[str, float]
    registers: dict[str, int]
    counters: dict[str, int]
    homed: dict[str, bool]
    moving: dict[str, bool]


def snapshot_session(session: Session, t: float) -> SavedSession:
    """What to save of a session at t: axes that a motion moves are moving until it has ended."""
    names, registers, known = session.drives.names, session.registers(t), session.homed
    counters = session.counters(t)
    moves = np.zeros(len(names), bool) if session.motion is None else session.motion.moving_axes
    if session.offered is not None:  # what has not been accepted yet can be the next time
        last = session.offered
        registers = np.where(known, registers, session.drives.signs * (last.counts - last.zero))
        counters, known = np.where(known, counters, last.counts), known | last.known
    return SavedSession(
        session.machine.name,
        {
            name: axis.pulse * axis.direction
            for name, axis in zip(names, session.machine.axes, strict=True)
        },
        dict(zip(names, registers.tolist(), strict=True)),
        dict(zip(names, counters.tolist(), strict=True)),
        dict(zip(names, known.tolist(), strict=True)),
        dict(zip(names, moves.tolist(), strict=True)),
    )


def open_session(machine: Machine, last: SavedSession | None = None) -> Session:
    """A session at power-up: manual, no axis homed, the last known registers offered where they
    were known.

    Raises MotionError for a machine that cannot be driven so, and for what was saved of another.
    """
    drives = machine_drives(machine)
    none = np.zeros(len(drives.names), np.int64)
    session = Session(machine, drives, "MAN", none, none, none, none, none)
    if last is None:
        return session
    if last.pulses != snapshot_session(session, 0.0).pulses or last.machine != machine.name:
        raise MotionError(
            f"the registers saved are those of a machine {last.machine} with axes {', '.join(last.pulses)}, not of "
            f"{machine.name} as it is now; give another state file, or remove it"
        )
    known = np.array([last.homed[name] and not last.moving[name] for name in drives.names])
    counts, registers = (
        np.array([of[name] for name in drives.names], np.int64)
        for of in (last.counters, last.registers)
    )
    low, high = drives.reach()
    known &= (counts >= low) & (counts <= high)
    return replace(
        session,
        offered=OfferedRegisters(counts, counts - drives.signs * registers, known)
        if known.any()
        else None,
    )
