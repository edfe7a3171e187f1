"""Moves from stop to stop as the program of [Sahbaz 2007, Appendix D] sends them: one trapezoid for
every leg, at once.

    a = B_8132.StartTMove(0, -3333, 0, 3000.5, 0.01, 0.01)    ' leg1
    a = B_8164.StartTRMove(0, -2120, 0, 1905.25, 0.01, 0.01)  ' leg3

Visual Basic of that program's controls B_8132 and B_8164: a Sub that calls `wait_until` (the
caller's: it returns when so many seconds have passed since the start) and then, for every move,
each axis' call (axis, distance, starting speed 0, highest speed, times of acceleration and of
deceleration). Distances are pulses from where the axis stands, in the wiring's signs; speeds
pulses/s in steps of a 16-bit register. With T the time of the move and v an axis' highest speed in
the plan, its ramps last T − D/v, so that all axes start and stop together, as in the thesis. Speeds
there are whole pulses/s, which lets slow legs end at other times; and a leg with fewer pulses than
3000 · 0.01 s runs a triangle of two ramps of half the move's time td. Neither is followed: such a
leg has ramps as all others. ASCII, line ends \\r\\n.

Exact for synchronised moves at order 2 that no limit of the tool slows: axes run such trapezoids
then. A motion of another shape between two rests is replaced by these, and by how much they differ
is measured; one in which an axis turns back is refused.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import ClassVar

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from planner.export.card_calls import (
    KINDS,
    MICROSECONDS,
    REGISTER,
    SPEED_HEADROOM,
    Call,
    find_card_kinds,
    replay_error,
    wired_counts,
)
from planner.export.format import Exported, ExportSource, refuse_compensated
from planner.export.formats.adlink import quote_comment
from planner.export.knots import refuse_moving_ends
from planner.pulses.schedule import refuse_counter
from planner.trajectory import Trajectory

FUNCTIONS = {"8132": "B_8132.StartTMove", "8164": "B_8164.StartTRMove"}
"""By the card: as its program calls them, both relative."""
REST_SHARE = 1e-9
"""Share of the highest speed along the path under which the motion is at rest."""
MIN_TURN_PULSES = 0.5
"""Pulses by which an axis that turns back inside a move has to go back to be one."""
MOVE_INSTANTS = 257
"""Instants of a move at which an axis' highest speed and its turning back are looked for, beside
all knots.
"""
STOP_SPEED = 1e-12
"""Pulses/s that stand for a stop, in a form that divides by speeds."""
WAIT_LINE = re.compile(r"    wait_until ([0-9.]+)")
CALL_LINE = re.compile(r"    a = (B_\w+\.\w+)\((\d+), (-?\d+), 0, ([^,]+), ([^,]+), [^)]+\)")


@dataclass(frozen=True, slots=True)
class LegMove:
    """One axis' call of a move that begins at `time` (s): distance in pulses of the wiring, speed
    1/s, ramp s.
    """

    time: float
    function: str
    axis: int
    distance: int
    speed: float
    ramp: float


@dataclass(frozen=True, slots=True)
class Sahbaz:
    """One trapezoidal move per axis from stop to stop, as the hexapod's own program calls the
    ADLINK cards.
    """

    suffix: ClassVar[str] = ".bas"
    from_rest: ClassVar[str] = "a list of trapezoidal moves"

    def write(self, source: ExportSource, path: Path) -> Exported:
        refuse_compensated(source, "sahbaz")
        refuse_moving_ends(source.counted, source.machine.axes, self.from_rest)
        wired = find_card_kinds(source, "sahbaz")
        kinds = [next(number for number in KINDS if KINDS[number] == kind) for kind in wired]
        for pulses, axis in zip(source.pulses.axes, source.machine.axes, strict=True):
            refuse_counter(pulses, axis)
        moves = _moves(source, kinds)
        path.write_bytes("".join(f"{line}\r\n" for line in _lines(source, moves)).encode("ascii"))
        read = read_moves(path)
        off = replay_error(source, [*_calls(source, read, kinds)])
        starts = [
            axis.direction * pulses.start
            for axis, pulses in zip(source.machine.axes, source.pulses.axes, strict=True)
        ]
        times = sorted({move.time for move in moves})
        return Exported(
            off,
            "the motion, the trapezoids replayed in closed form",
            (
                f"{count_noun(len(moves), 'call')} for {count_noun(len(times), 'move')}; the pulses "
                "fired are within ½ more",
                f"counters must stand at {', '.join(map(str, starts))} at time 0",
                "between two rests each axis runs a trapezoid of its own; the tool's way is no straight line",
            ),
            sum(move.distance != 0 for move in read),
        )


def read_moves(path: Path) -> list[LegMove]:
    """The moves of a file written so."""
    moves, now = [], 0.0
    for line in path.read_text("ascii").split("\n"):
        if wait := WAIT_LINE.match(line):
            now = float(wait[1])
        elif call := CALL_LINE.match(line):
            moves.append(
                LegMove(now, call[1], int(call[2]), int(call[3]), float(call[4]), float(call[5]))
            )
    return moves


def _lines(source: ExportSource, moves: Sequence[LegMove]) -> Iterator[str]:
    names = {(card_function(axis.card), axis.channel): axis.name for axis in source.machine.axes}
    yield f"' {quote_comment(source.name)} on {quote_comment(source.machine.name)}, by pulsepath"
    yield "' wait_until returns when so many seconds have passed since the start; a is not looked at, as in the source"
    yield "Sub pulsepath_run()"
    now = None
    for move in moves:
        if move.time != now:
            now = move.time
            yield f"    wait_until {now:.6f}"
        numbers = f"{move.axis}, {move.distance}, 0, {move.speed!r}, {move.ramp!r}, {move.ramp!r}"
        yield f"    a = {move.function}({numbers}) ' {quote_comment(names[move.function, move.axis])}"
    yield "End Sub"


def card_function(card: str | None) -> str:
    return next(function for number, function in FUNCTIONS.items() if number in str(card))


def _moves(source: ExportSource, kinds: Sequence[str]) -> list[LegMove]:
    trajectory = source.trajectory
    rests = _find_move_times(trajectory)
    found = []
    fastest = np.zeros(len(kinds))
    for begin, end in rests:
        t = np.unique(
            np.concatenate(
                [np.linspace(begin, end, MOVE_INSTANTS), _inner_instants(trajectory, begin, end)]
            )
        )
        for k in range(len(kinds)):
            x, v = wired_counts(source, k, t)
            distance = _counts(source, k, end) - _counts(source, k, begin)
            sign = np.sign(distance) or 1
            back = float((np.maximum.accumulate(sign * x) - sign * x).max())
            if back > MIN_TURN_PULSES:
                raise MotionError(
                    f"sahbaz: axis {source.machine.axes[k].name} turns back by {back:.4g} pulses between the rests at "
                    f"t = {begin:.6g} and {end:.6g} s, which a trapezoidal move cannot do; use --motion synchronised, "
                    "or export with format adlink"
                )
            if distance:
                speed = max(float(np.abs(v).max()), abs(distance) / (end - begin))
                fastest[k] = max(fastest[k], speed)
                found.append((begin, end, k, distance, speed))
    if not found:
        raise MotionError(
            "sahbaz: no axis moves by a pulse between two rests, so there is no move to write"
        )
    steps = [
        min(max(top * SPEED_HEADROOM, 1.0), KINDS[number].max_speed) / REGISTER
        for top, number in zip(fastest, kinds, strict=True)
    ]
    return [
        LegMove(
            begin,
            FUNCTIONS[kinds[k]],
            int(source.machine.axes[k].channel or 0),
            distance,
            *_fit_ramp(abs(distance), end - begin, speed, steps[k]),
        )
        for begin, end, k, distance, speed in found
    ]


def _fit_ramp(way: int, whole: float, speed: float, step: float) -> tuple[float, float]:
    """Speed in whole steps, and the ramps with which the way takes as long: no more than half of it
    each.
    """
    least = way / whole
    low = np.floor(speed / step + 1e-9) * step
    chosen = float(low if low > least else (np.floor(least / step) + 1) * step)
    return chosen, float(min(whole - way / chosen, whole / 2))


def _find_move_times(trajectory: Trajectory) -> list[tuple[float, float]]:
    """When each move begins and ends (s, whole microseconds): from rest to rest."""
    sd, knots = trajectory.at(trajectory.knots).sd, trajectory.knots
    still = sd <= REST_SHARE * max(float(sd.max()), np.finfo(float).tiny)
    moves = [
        (a, b)
        for a, b in pairwise(np.flatnonzero(still))
        if b > a + 1 or _moves_between(trajectory, int(a))
    ]
    # no move begins before the one before it has ended
    return [
        (
            float(np.ceil(knots[a] * MICROSECONDS) / MICROSECONDS),
            float(np.floor(knots[b] * MICROSECONDS) / MICROSECONDS),
        )
        for a, b in moves
    ]


def _moves_between(trajectory: Trajectory, k: int) -> bool:
    """Whether one time piece from rest to rest goes anywhere: a dwell does not."""
    return bool(trajectory.a[k] != 0 or trajectory.j[k] != 0)


def _inner_instants(trajectory: Trajectory, begin: float, end: float) -> Array:
    return np.asarray(trajectory.knots[(trajectory.knots > begin) & (trajectory.knots < end)])


def _counts(source: ExportSource, k: int, t: float) -> int:
    """What the wiring has counted by t, or of the motion's end in all."""
    pulses, axis = source.pulses.axes[k], source.machine.axes[k]
    if t >= np.floor(source.trajectory.duration * MICROSECONDS) / MICROSECONDS:
        return int(pulses.final * axis.direction)
    if t <= 0:
        return int(pulses.start * axis.direction)
    return int(np.rint(wired_counts(source, k, np.array([t]))[0][0]))


def _calls(source: ExportSource, moves: Sequence[LegMove], kinds: Sequence[str]) -> Iterator[Call]:
    """Each trapezoid as two calls of the kind that `replay_error` knows: up and on, then down to a
    stop.
    """
    axes = source.machine.axes
    at = {
        (FUNCTIONS[kind], axis.channel): k
        for k, (kind, axis) in enumerate(zip(kinds, axes, strict=True))
    }
    stands = [
        axis.direction * pulses.start for axis, pulses in zip(axes, source.pulses.axes, strict=True)
    ]
    for move in moves:
        k = at[move.function, move.axis]
        begin, way, sign = stands[k], abs(move.distance), np.sign(move.distance)
        stands[k] += move.distance
        on = way / move.speed  # from the start to where braking begins
        until = begin + sign * (way - move.speed * move.ramp / 2)
        name, function, ramp = axes[k].name, move.function, move.ramp
        yield Call(move.time, name, function, move.axis, until, 0.0, move.speed, ramp)
        yield Call(
            move.time + on, name, function, move.axis, stands[k], move.speed, STOP_SPEED, ramp
        )
