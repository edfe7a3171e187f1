"""The remote line protocol of [Sasidhar 1981]: one line for each move from stop to stop of the
program.

    P X + 100 Y - 40 Z + 80

P stands for position, + for clockwise: a positive count of the wiring. Distances are whole steps
from where the axis stands; an axis that does not move is left out. ASCII, every line ends in a
carriage return alone. The controller answers DONE when the move is over, and only then takes the
next line: it runs independent trapezoids, so the path between two stops is not followed, and rests
have no line. By how much it is not is measured from what the lines say, over all of the way; a
motion that stops nowhere but where it starts is refused.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from string import ascii_uppercase
from typing import ClassVar

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from planner.baselines.moves import (
    deviation,
    distance_to_curve,
    independent_ramps,
    move_places,
    time_moves,
)
from planner.export.format import Exported, ExportSource, refuse_compensated
from planner.export.knots import refuse_moving_ends
from planner.path.actuation import MachinePath
from planner.pulses.schedule import AxisPulses, Ticks

REST_SHARE = 1e-9
"""Share of the highest speed along the path under which the motion is at rest."""
PIECE_PLACES, MOVE_PLACES = 33, 257
"""Places of a piece of the path, and of a move, that are held against each other."""
BLOCK_POINTS = 1 << 20
"""Distances found together."""
PART = re.compile(r" ([A-Z]) ([+-]) (\d+)")


@dataclass(frozen=True, slots=True)
class Sasidhar:
    """Remote line protocol of the four-axis traverser: one line of steps per move between stops."""

    suffix: ClassVar[str] = ".txt"
    from_rest: ClassVar[str] = "the line protocol"

    def write(self, source: ExportSource, path: Path) -> Exported:
        machine, pulses = source.machine, source.pulses
        refuse_compensated(source, "sasidhar")
        names = [axis.name for axis in machine.axes]
        odd = [name for name in names if len(name) != 1 or name not in ascii_uppercase]
        if odd:
            raise MotionError(
                f"sasidhar: axis {odd[0]!r} of machine {machine.name} is not a capital letter; the protocol names "
                "axes by one letter, as X, Y, Z and R: rename it in your own machine file"
            )
        refuse_moving_ends(source.counted, machine.axes, self.from_rest)
        ends, instants = _find_stops(source)
        wiring = np.array([axis.direction for axis in machine.axes])
        counts = pulses.counts(instants) * wiring
        counts[-1] = [axis.final for axis in pulses.axes] * wiring
        steps = np.diff(counts, axis=0)
        if not steps.any() and pulses.total:
            raise MotionError(
                "sasidhar: the motion stops only where it starts, so there is no move between stops to write: "
                'let segments end with join = "stop", or choose another format'
            )
        lines = []
        for step in steps.tolist():
            parts = [
                f" {name} {'-' if n < 0 else '+'} {abs(n)}"
                for name, n in zip(names, step, strict=True)
                if n
            ]
            lines += [f"P{''.join(parts)}\r"] if parts else []
        path.write_bytes("".join(lines).encode("ascii"))
        held = _read(path.read_bytes().decode("ascii"), names)
        at = np.cumsum(steps.any(axis=1))  # lines that were sent by each stop
        if len(held) != len(lines) + 1 or not np.array_equal(held[at], counts[1:] - counts[0]):
            return Exported(np.inf, "the pulses at every stop")
        q = machine.home_q + (counts[0] + held[np.append(0, at)]) * wiring * [
            axis.pulse for axis in machine.axes
        ]
        rests = float(np.sum(np.asarray(source.trajectory.path.dwells)))
        notes = [
            f"{count_noun(len(lines), 'move')}; wait for DONE after each; the counts at every stop are exact",
            *_describe_deviation(source, ends),
            f"counters stand at {', '.join(map(str, counts[0].tolist()))} before it",
        ]
        error = max(
            (_deviation(source, q[n : n + 2], ends[n : n + 2]) for n in range(len(ends) - 1)),
            default=0.0,
        )
        return Exported(
            error,
            "the path, each move by independent trapezoids at the machine's limits",
            (*notes, f"{rests:g} s of rests have no line") if rests else tuple(notes),
            len(held) - 1,
            # path and moves stay within the counts of an axis, which may be far fewer than the
            # error of all
            tuple(min(error, _count_range(axis)) for axis in pulses.axes),
        )


def _count_range(axis: AxisPulses) -> float:
    """Return the number of pulses between the smallest and the largest count of an axis, and one
    for rounding.
    """
    counts = np.cumsum(axis.direction, dtype=np.int64)
    return float(max(counts.max(), 0) - min(counts.min(), 0) + 1) if len(counts) else 0.0


def _find_stops(source: ExportSource) -> tuple[np.ndarray, np.ndarray]:
    """Breaks of the path at which the motion is at rest, and the last instant (s) of each rest
    there.
    """
    trajectory = source.trajectory
    state, breaks = trajectory.at(trajectory.knots), trajectory.path.breaks
    still = np.flatnonzero(
        state.sd <= REST_SHARE * max(float(state.sd.max()), np.finfo(float).tiny)
    )
    near = np.abs(state.s[still, None] - breaks).argmin(1)
    ends, last = np.unique(near[::-1], return_index=True)
    return ends, trajectory.knots[still[::-1][last]]


def _deviation(source: ExportSource, q: Array, ends: np.ndarray) -> float:
    """Pulses by which a move from q[0] to q[1] (2, n) and the path from break to break part at
    most.

    In the space of the axes' pulses, the larger of how far any place of either is from all of the
    other, as looked at in 33 places of each piece and 257 of the move; so no axis is farther from
    the path at any time.
    """
    curve, axes = source.trajectory.path, source.machine.axes
    pulse = np.array([axis.pulse for axis in axes])
    run = (
        move_places(q[0], q[1], axes, independent_ramps, np.linspace(0.0, 1.0, MOVE_PLACES)) / pulse
    )
    pieces = np.arange(ends[0], ends[1])
    begin, end = curve.breaks[pieces], curve.breaks[pieces + 1]
    s = begin[:, None] + (end - begin)[:, None] * np.linspace(0.0, 1.0, PIECE_PLACES)
    drawn = curve.derivatives(s.ravel(), np.repeat(pieces, PIECE_PLACES))[0] / pulse
    return max(_max_curve_distance(run, drawn), _max_curve_distance(drawn, run))


def _max_curve_distance(points: Array, curve: Array) -> float:
    """The largest distance of points (N, n) from a curve drawn as a polyline (M, n), some points at
    a time.
    """
    size = max(1, BLOCK_POINTS // len(curve))
    return max(
        float(distance_to_curve(points[lo : lo + size], curve).max())
        for lo in range(0, len(points), size)
    )


def _describe_deviation(source: ExportSource, ends: np.ndarray) -> Iterator[str]:
    """How far in space the controller's own way is from the programmed one, where the machine has
    poses for it.
    """
    curve, machine = source.trajectory.path, source.machine
    if isinstance(curve, MachinePath):
        try:
            moved, begins = time_moves(curve, machine.axes, independent_ramps, ends)
            off = deviation(machine, curve, moved, begins, ends)
        except MotionError:
            return  # no pose on the way, or no move at all: what is said in pulses stands
        far = f"{1e3 * off.distance:.4g} mm at {off.place}"
        yield f"the path between stops is not followed: independent trapezoids leave it by {far}"


def _read(text: str, names: list[str]) -> Ticks:
    """(N+1, axes) counts from 0: before the first line, and after each."""
    counts = [np.zeros(len(names), np.int64)]
    for line in text.split("\r")[:-1]:
        now = counts[-1].copy()
        for name, sign, steps in PART.findall(line):
            now[names.index(name)] += int(sign + steps)
        counts.append(now)
    return np.array(counts)
