"""The remote line protocol of [Sasidhar 1981]: one line for each move from stop to stop of the program.

    P X + 100 Y - 40 Z + 80

P stands for position, + for clockwise: a positive count of the wiring. Distances are whole steps from where the axis
stands; an axis that does not move is left out. ASCII, every line ends in a carriage return alone. The controller
answers DONE when the move is over, and only then takes the next line: it runs independent trapezoids, so the path
between two stops is not followed, and rests have no line.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from string import ascii_uppercase
from typing import ClassVar

import numpy as np

from kinematics.errors import MotionError
from planner.actuation import MachinePath
from planner.baselines.between import deviation, independent, moves
from planner.export.format import Exported, Source, refuse_compensated
from planner.pulses.schedule import Ticks

STILL = 1e-9
"""Share of the highest speed along the path under which the motion is at rest."""
PART = re.compile(r" ([A-Z]) ([+-]) (\d+)")


@dataclass(frozen=True, slots=True)
class Sasidhar:
    """Remote line protocol of the four-axis traverser: a line of steps per move between stops."""

    suffix: ClassVar[str] = ".txt"

    def write(self, source: Source, path: Path) -> Exported:
        machine, pulses = source.machine, source.pulses
        refuse_compensated(source, "sasidhar")
        names = [axis.name for axis in machine.axes]
        odd = [name for name in names if len(name) != 1 or name not in ascii_uppercase]
        if odd:
            raise MotionError(
                f"sasidhar: axis {odd[0]!r} of machine {machine.name} is no capital letter; the protocol names its "
                "axes by one, as in X, Y, Z and R: rename it in a machine file of your own"
            )
        ends, instants = _stops(source)
        wiring = np.array([axis.direction for axis in machine.axes])
        counts = pulses.counts(instants) * wiring
        counts[-1] = [axis.final for axis in pulses.axes] * wiring
        lines = []
        for step in np.diff(counts, axis=0).tolist():
            parts = [f" {name} {'-' if n < 0 else '+'} {abs(n)}" for name, n in zip(names, step, strict=True) if n]
            lines += [f"P{''.join(parts)}\r"] if parts else []
        path.write_bytes("".join(lines).encode("ascii"))
        held = _read(path.read_bytes().decode("ascii"), names)
        reached = counts[np.append(True, np.diff(counts, axis=0).any(1))] - counts[0]
        error = float(abs(held - reached).max()) if held.shape == reached.shape else np.inf
        rests = float(np.sum(np.asarray(source.trajectory.path.dwells)))
        notes = [
            f"{len(lines)} moves; wait for DONE after each",
            _told(source, ends),
            f"counters stand at {', '.join(map(str, counts[0].tolist()))} before it",
        ]
        return Exported(
            error,
            "the pulses, at every stop",
            (*notes, f"{rests:g} s of rests have no line") if rests else tuple(notes),
        )


def _stops(source: Source) -> tuple[np.ndarray, np.ndarray]:
    """Breaks of the path at which the motion is at rest, and the last instant (s) of each rest there."""
    trajectory = source.trajectory
    state, breaks = trajectory.at(trajectory.knots), trajectory.path.breaks
    still = np.flatnonzero(state.sd <= STILL * max(float(state.sd.max()), np.finfo(float).tiny))
    near = np.abs(state.s[still, None] - breaks).argmin(1)
    ends, last = np.unique(near[::-1], return_index=True)
    return ends, trajectory.knots[still[::-1][last]]


def _told(source: Source, ends: np.ndarray) -> str:
    """How far the controller's own way is from the programmed one."""
    curve, machine = source.trajectory.path, source.machine
    if not isinstance(curve, MachinePath):
        return "the path between stops is not followed"
    try:
        moved, begins = moves(curve, machine.axes, independent, ends)
        off = deviation(machine, curve, moved, begins, ends)
    except MotionError as error:
        return f"the path between stops is not followed; by how much is not known: {error}"
    return (
        f"the path between stops is not followed: independent trapezoids at the machine's limits leave it by "
        f"{1e3 * off.distance:.4g} mm at {off.place}"
    )


def _read(text: str, names: list[str]) -> Ticks:
    """(N+1, axes) counts from 0: before the first line, and after each."""
    counts = [np.zeros(len(names), np.int64)]
    for line in text.split("\r")[:-1]:
        now = counts[-1].copy()
        for name, sign, steps in PART.findall(line):
            now[names.index(name)] += int(sign + steps)
        counts.append(now)
    return np.array(counts)
