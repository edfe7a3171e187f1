"""Formats of the three-armed machine [KMITL 2005]: lists of arm lengths and of positions, and bytes
for a port.

Lengths are in units; 500 counts make one, and a digital differential analyser (DDA) runs from
listed point to listed point. The source's reader takes seven characters for a number, and counts
lines in 16 bits.

Arm-length list: the three arm lengths at steps along the path, for the DDA to run through.

    PointL1_10001266.774
    PointL2_10001266.774
    PointL3_10001266.774

    PointL1_10002266.771
    …

The key is followed by the length at once, in seven characters: the source's reader takes columns 14
to 20. The number runs up from 10001; an empty line ends a point. Lengths are distances between
joint centres, in units. The file holds no times: the source's reader runs as fast as its loop of
output commands. ASCII, line ends \\r\\n, decimal points.

One byte per step, for a parallel port: bit 2i is the step of axis i, bit 2i + 1 its direction.

X+ 1, X- 3, Y+ 4, Y- 12, Z+ 16, Z- 48; axes that step in the same tick share a byte. Direction 0 is
a positive count of the wiring. The reader puts each byte out, and 0 after it: so STEP falls, and
direction has no set-up time of its own. The file is nothing but these bytes: it holds no times, no
start counts, and at most four axes.

Position list: the poses that the source's program runs through in straight lines.

    Polar1_____cex 15.0000
    …
    Polar1______rz 0.00000
    Polar1_mov(1)x 49.6410
    …
    Polar1move(3)z -325.00

Per pose n, in the source's order: `ce` the end point, `c` the plate's centre, r the angles in
degrees (0: the plate keeps its orientation), `mov` the arms' joints on the plate, `move` the same
at the height of the plate's centre. Then an empty line. Positions are in units, in the machine's
base frame; but z of `ce` and `c` counts from the end point's height at home, which is the offset
ZOS that the source sets as it starts, takes off here and adds again. The source's reader compares
the first 14 columns with Polar, n and the key, which has eight characters, and takes columns 15 to
21: a blank and six characters of the number, whose seventh is cut off. So it reads poses 1 to 9.
ASCII, line ends \\r\\n.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from kinematics.foundation.arrays import Array, merge_rising
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import add_article, count_noun
from kinematics.foundation.options import option
from kinematics.kinds.tripod import Tripod
from kinematics.machine.machine import Machine
from kinematics.machine.pose import from_numbers, to_numbers
from planner.export.format import Exported, ExportSource, refuse_compensated
from planner.path.actuation import ActuatorPath
from planner.pulses.schedule import Ticks
from planner.sources.position_list import PositionList
from planner.sources.positions import FIRST_NUMBER

UNIT_LENGTH = 1e-3
"""m. ASSUMPTION: the source does not say what its unit is; this machine's 25 000 pulses per mm fit
500 · 50.
"""
MAX_DIGITS = 7
LAST_NUMBER = 32_767
"""The largest number of a line: Visual Basic's Integer."""


def tripod_of(source: ExportSource, format_: str) -> Tripod:
    """The machine. Raises MotionError for another kind, by name."""
    if not isinstance(source.machine, Tripod):
        kind = type(source.machine).__name__.lower()
        raise MotionError(
            f"{format_}: machine {source.machine.name} is {add_article(kind)}; the format is a tripod's, three arms"
        )
    refuse_compensated(source, format_)
    return source.machine


def read_length(value: float, what: str) -> float:
    """A positive length that was given as an option. Raises MotionError for another."""
    if not 0 < value < float("inf"):
        raise MotionError(f"kmitl: {what} {value} m must be positive and finite")
    return value


def spread_over_piece(path: ActuatorPath, piece: int, count: int) -> tuple[Array, np.ndarray]:
    """Path length s and piece, each (count + 1,), of equal steps from end to end of a piece."""
    begin, end = path.breaks[piece], path.breaks[piece + 1]
    return begin + (end - begin) * np.arange(count + 1) / count, np.full(count + 1, piece)


def steps(path: ActuatorPath, piece: int, step: float) -> int:
    """How many equal steps of a piece are no longer than `step`."""
    whole = float(path.breaks[piece + 1] - path.breaks[piece]) / step
    return max(1, ceil(whole - 1e-9))


def number(value: float, what: str) -> str:
    """A number in seven characters, as many decimals as fit.

    Raises MotionError for one that does not.
    """
    for decimals in range(MAX_DIGITS - 2, -1, -1):
        text = f"{value:.{decimals}f}"
        if len(text) <= MAX_DIGITS:
            return "0" + text[2:] if text.startswith("-0") and float(text) == 0 else text
    raise MotionError(
        f"kmitl: {what} {value:.6g} units needs more than {MAX_DIGITS} characters; choose a longer unit"
    )


CUT_DIGITS = 6
"""Characters of a number that the source's reader of positions takes."""


def cut_number(value: float, what: str) -> str:
    """Return a number whose first six characters are the same number, cut off.

    Raise MotionError if it has none.
    """
    text = number(value, what)
    if len(text) > CUT_DIGITS and "." not in text[:CUT_DIGITS]:
        raise MotionError(
            f"kmitl: {what} {value:.7g} units needs more than {CUT_DIGITS} characters, which the source's "
            "reader takes; choose a longer unit"
        )
    return text


def check_numbers(count: int, first: int, what: str) -> None:
    """Raises MotionError for more points than the source's numbers reach."""
    if first + count - 1 > LAST_NUMBER:
        raise MotionError(
            f"kmitl: {count} {what}, numbered from {first}; the source counts to {LAST_NUMBER}: list fewer points"
        )


COUNTS_PER_UNIT = 500
"""Counts of one unit of length [KMITL 2005]."""


@dataclass(frozen=True, slots=True)
class KmitlArms:
    """Arm-length list of the three-armed machine, step by step along the path."""

    suffix: ClassVar[str] = ".txt"
    point_step: float = option(
        1e-3, "distance between listed points along the path. Default 1 mm", "m", like="1 mm"
    )
    unit_length: float = option(UNIT_LENGTH, "length of one unit. Default 1 mm", "m", like="1 mm")

    def write(self, source: ExportSource, path: Path) -> Exported:
        tripod_of(source, "kmitl-arms")
        step, unit = (
            read_length(self.point_step, "point step"),
            read_length(self.unit_length, "unit length"),
        )
        curve = source.trajectory.path
        pieces = range(len(curve.breaks) - 1)
        each = [spread_over_piece(curve, k, steps(curve, k, step)) for k in pieces]
        # a piece begins where the one before it ends
        s, piece = (
            np.concatenate([part[n][min(k, 1) :] for k, part in enumerate(each)]) for n in (0, 1)
        )
        check_numbers(len(s), FIRST_NUMBER, "points")
        lengths = curve.derivatives(s, piece)[0] / unit
        texts = [[number(value, "arm length") for value in row] for row in lengths.tolist()]
        lines = []
        for n, row in enumerate(texts, FIRST_NUMBER):
            lines += [*(f"PointL{arm}_{n}{text}" for arm, text in enumerate(row, 1)), ""]
        path.write_text("".join(f"{line}\r\n" for line in lines), encoding="ascii", newline="")
        held = _read(path)
        return Exported(
            max(_errors(source, held, s, piece, unit)),
            "the path, the DDA run from point to point",
            (
                f"{count_noun(len(s), 'point')}, {1e3 * step:g} mm apart at most; the file holds no times",
                f"its reader counts {COUNTS_PER_UNIT} to a unit of {1e3 * unit:g} mm: one count is "
                f"{unit / COUNTS_PER_UNIT / source.machine.axes[0].pulse:.6g} pulses",
            ),
            int(np.diff(held, axis=0).any(1).sum()),
        )


def _read(path: Path) -> Array:
    """Lengths (N, 3) in units, by the columns that the source's reader takes."""
    lines = path.read_text("ascii").splitlines()
    return np.array([float(line[13:20]) for line in lines if line.startswith("PointL")]).reshape(
        -1, 3
    )


def _errors(
    source: ExportSource, lengths: Array, s: Array, piece: np.ndarray, unit: float
) -> Iterator[float]:
    """Pulses, the largest error of each step: counts after every turn of the DDA against the path
    there.

    A step of less than a count has no turn: there the path is looked at in both ends.
    """
    pulse = np.array([axis.pulse for axis in source.machine.axes])
    home_q = source.trajectory.path.derivatives(s[:1], piece[:1])[0]
    at = np.zeros(3)
    yield 0.0
    for n, target in enumerate((lengths[1:] - lengths[0]) * COUNTS_PER_UNIT, 1):
        counts = at + dda_counts(target - at)
        counts = counts if len(counts) > 1 else np.repeat(counts, 2, axis=0)
        share = np.arange(len(counts)) / (len(counts) - 1)
        q = source.trajectory.path.derivatives(
            s[n - 1] + (s[n] - s[n - 1]) * share, np.full(len(counts), piece[n])
        )[0]
        yield float((abs(counts * unit / COUNTS_PER_UNIT - (q - home_q)) / pulse).max())
        at = counts[-1]


def dda_counts(way: Array) -> Array:
    """(M+1, 3) counts from 0 at every turn on a way (3,) of counts [KMITL 2005, `going`].

    Of M = ⌊k⌋ turns, k the largest |way|, turn m has each axis fire where its sum passes k - 1: ⌊(m
    |way| + 1)/k⌋.
    """
    most = float(abs(way).max())
    turns = np.arange(int(most) + 1)
    return (
        np.sign(way) * np.floor((turns[:, None] * abs(way) + 1) / most)
        if most >= 1
        else np.zeros((1, 3))
    )


MAX_AXES = 4


@dataclass(frozen=True, slots=True)
class KmitlByte:
    """One byte per step for a parallel port, at most four axes."""

    suffix: ClassVar[str] = ".bin"

    def write(self, source: ExportSource, path: Path) -> Exported:
        axes, pulses = source.machine.axes, source.pulses.axes
        if len(axes) > MAX_AXES:
            raise MotionError(
                f"byte: machine {source.machine.name} has {count_noun(len(axes), 'axis')}; a byte "
                f"holds {MAX_AXES} at most"
            )
        ticks = merge_rising(*(axis.ticks for axis in pulses))
        steps = np.zeros(len(ticks), np.uint8)
        for k, (axis, driven) in enumerate(zip(pulses, axes, strict=True)):
            back = axis.direction != driven.direction
            steps[np.searchsorted(ticks, axis.ticks)] |= np.where(
                back, 3 << 2 * k, 1 << 2 * k
            ).astype(np.uint8)
        path.write_bytes(steps.tobytes())
        held = _counts(np.frombuffer(path.read_bytes(), np.uint8), len(axes))
        error = 0.0
        for k, (axis, driven) in enumerate(zip(pulses, axes, strict=True)):
            error = max(
                error,
                float(
                    abs(held[:, k] * driven.direction + axis.start - axis.counts(ticks)).max(
                        initial=0
                    )
                ),
            )
        starts = ", ".join(
            str(axis.start * driven.direction) for axis, driven in zip(pulses, axes, strict=True)
        )
        return Exported(
            error,
            "the counts after every step",
            (
                f"{count_noun(len(steps), 'byte')}, {count_noun(len(axes), 'axis')}; it holds no times",
                f"counters must stand at {starts} before it",
            ),
            len(held),
        )


def _counts(steps: NDArray[np.uint8], axes: int) -> Ticks:
    """(N, axes) counts of the wiring from 0, after every byte."""
    bits = steps[:, None].astype(np.int64) >> 2 * np.arange(axes)
    return np.cumsum((bits & 1) * (1 - (bits & 2)), axis=0)


KEYS = [
    *(f"_____ce{name}" for name in "xyz"), *(f"______c{name}" for name in "xyz"),
    *(f"______r{name}" for name in "xyz"),
    *(f"_mov({joint}){name}" for joint in (1, 2, 3) for name in "xyz"),
    *(f"move({joint}){name}" for joint in (1, 2, 3) for name in "xyz"),
]  # fmt: skip
CHORD_SHARES = np.arange(1, 8) / 8


@dataclass(frozen=True, slots=True)
class KmitlPositions:
    """Position list of the three-armed machine: poses joined by straight lines."""

    suffix: ClassVar[str] = ".txt"
    chord: float = option(
        1e-5,
        "largest deviation from the path of the straight lines between poses. Default 0.01 mm",
        "m",
        like="0.01 mm",
    )
    unit_length: float = option(UNIT_LENGTH, "length of one unit. Default 1 mm", "m", like="1 mm")

    def write(self, source: ExportSource, path: Path) -> Exported:
        machine = tripod_of(source, "kmitl-positions")
        chord, unit = read_length(self.chord, "chord"), read_length(self.unit_length, "unit length")
        curve = source.trajectory.path
        each = [_chords(curve, k, chord) for k in range(len(curve.breaks) - 1)]
        s, piece = (
            np.concatenate([part[n][min(k, 1) :] for k, part in enumerate(each)]) for n in (0, 1)
        )
        x = _numbers(curve, s, piece)
        text = positions_text(x, np.zeros((len(s), 3)), machine, unit)
        path.write_text(text, encoding="ascii", newline="")
        notes = [
            f"{count_noun(len(s), 'pose')}, joined by straight lines within {1e3 * chord:g} mm; the "
            "file holds no times",
            f"units of {1e3 * unit:g} mm in the machine's base frame; z of ends and centres from home's",
        ]
        if len(s) > 9:
            notes.append(
                "the source's own reader takes numbers of one digit only: its columns are fixed"
            )
        against = "the path, the poses joined by straight lines"
        ends = _read_list(path) + np.array([0.0, 0.0, height_offset(machine) / unit])
        moves = int(np.diff(ends, axis=0).any(1).sum())
        return Exported(_error(source, ends * unit, s, piece), against, tuple(notes), moves)


def positions_text(x: Array, angles: Array, machine: Tripod, unit: float) -> str:
    """The list of poses x (N, 12) in the machine's base frame; angles (N, 3) that it states, rad;
    unit: m.

    Raises MotionError for more poses, or larger numbers, than the format has room for.
    """
    check_numbers(len(x), 1, "poses")
    turn = x[:, None, 3:].reshape(-1, 1, 3, 3)
    plate = x[:, None, :3] - (turn @ machine.tool)
    joints = x[:, None, :3] + (turn @ machine.platform[:, :, None])[..., 0]
    level = machine.platform * [1, 1, 0] - machine.tool * [0, 0, 1]  # from the end point
    ends = x[:, None, :3] + (turn @ level[:, :, None])[..., 0]
    zero = np.array([0.0, 0.0, height_offset(machine)])
    stated = np.degrees(angles)[:, None] * unit  # the only numbers that are no lengths
    values = (
        np.concatenate([x[:, None, :3] - zero, plate - zero, stated, joints, ends], 1).reshape(
            len(x), -1
        )
        / unit
    )
    lines = []
    for n, row in enumerate(values.tolist(), 1):
        lines += [
            *(f"Polar{n}{key} {cut_number(v, key)}" for key, v in zip(KEYS, row, strict=True)),
            "",
        ]
    return "".join(f"{line}\r\n" for line in lines)


def height_offset(machine: Tripod) -> float:
    """m, in the base frame: the height from which the source counts, that of the end point as it
    starts (its ZOS).
    """
    return float(machine.home.translation[2])


def list_text(listed: PositionList, machine: Machine) -> str:
    """The list of recorded poses: those from home are put into the base frame.

    Raises MotionError for no tripod, and for rests, which have no place in it.
    """
    if not isinstance(machine, Tripod):
        raise MotionError(
            f"kmitl-positions: machine {machine.name} is not a tripod; the format is for three arms"
        )
    if listed.rests.any():
        raise MotionError(
            f"kmitl-positions: pose {int(np.argmax(listed.rests > 0)) + 1} has a dwell, which the format cannot "
            "hold; save the list as CSV, or remove its column dwell"
        )
    x = RigidTransform.from_components(listed.poses[:, :3], listed.rotations)
    if listed.frame == "home":
        x = machine.home * x
    angles = x.rotation.as_euler("YZX")[:, [2, 0, 1]]
    return positions_text(to_numbers(x), angles, machine, UNIT_LENGTH)


def _chords(curve: ActuatorPath, piece: int, chord: float) -> tuple[Array, np.ndarray]:
    """Ends of equal parts of a piece, none of which leaves its chord by more than `chord` (m)."""
    count = 1
    while count <= LAST_NUMBER:
        s, index = spread_over_piece(curve, piece, count)
        inside = (s[:-1, None] + np.diff(s)[:, None] * CHORD_SHARES).ravel()
        here = _numbers(curve, inside, np.full(len(inside), piece))[:, :3].reshape(count, -1, 3)
        ends = _numbers(curve, s, index)[:, :3]
        if float(np.linalg.norm(here - _nearest(here, ends), axis=2).max()) <= chord:
            return s, index
        count *= 2
    raise MotionError(
        f"kmitl-positions: chord {chord:g} m asks for more than {LAST_NUMBER} poses; widen it"
    )


def _nearest(points: Array, ends: Array) -> Array:
    """The points (N, k, 3) brought to the chords between ends (N+1, 3)."""
    way = np.diff(ends, axis=0)[:, None]
    share = (way * (points - ends[:-1, None])).sum(2) / np.maximum(
        (way**2).sum(2), np.finfo(float).tiny
    )
    return np.asarray(ends[:-1, None] + np.clip(share, 0.0, 1.0)[..., None] * way)


def _numbers(curve: ActuatorPath, s: Array, piece: np.ndarray) -> Array:
    x = curve.pose_numbers(s, piece)
    if x is None:
        raise MotionError("kmitl-positions: this motion has no machine, so it has no poses to list")
    return x


KEY = re.compile(r"Polar\d+_____ce[xyz] (?P<number>.{1,6}).?")
"""A line of an end point: what the source's reader takes of its number."""


def _read_list(path: Path) -> Array:
    """Return end points (N, 3) in units, as the source's reader takes them."""
    lines = path.read_text("ascii").splitlines()
    matches = [KEY.fullmatch(line) for line in lines]
    return np.array([float(one["number"]) for one in matches if one is not None]).reshape(-1, 3)


def _error(source: ExportSource, ends: Array, s: Array, piece: np.ndarray) -> float:
    """Pulses, the largest between the arms' lengths on the path and at the nearest point of the
    chord there.
    """
    curve, machine = source.trajectory.path, source.machine
    share = np.concatenate([[0.0], CHORD_SHARES, [1.0]])
    here = (s[:-1, None] + np.diff(s)[:, None] * share).ravel()
    x = _numbers(curve, here, np.repeat(piece[1:], len(share)))
    near = x.copy()
    near[:, :3] = _nearest(x[:, :3].reshape(len(s) - 1, -1, 3), ends).reshape(-1, 3)
    pulse = np.array([axis.pulse for axis in machine.axes])
    off = machine.inverse(from_numbers(near)) - machine.inverse(from_numbers(x))
    return float((abs(off) / pulse).max(initial=0.0))
