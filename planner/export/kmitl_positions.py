"""Position list of [KMITL 2005]: the poses that its program runs through in straight lines.

    Polar1____cex 15.0000
    …
    Polar1_____rz 0.00000
    Polar1_mov(1)x 49.6410
    …
    Polar1move(3)z -325.00

Per pose n, in the source's order: `ce` the end point, `c` the plate's centre, r the angles in degrees (0: the plate
keeps its orientation), `mov` the arms' joints on the plate, `move` the same at the height of the plate's centre. Then
an empty line. Positions are in units, in the machine's base frame; but z of `ce` and `c` counts from the end point's
height at home, which is the offset ZOS that the source sets as it starts, takes off here and adds again. The source's
reader takes columns 15 to 21 of a line, which hold the number as long as n has one digit. ASCII, line ends \\r\\n.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import RigidTransform

from kinematics.array import Array
from kinematics.errors import MotionError
from kinematics.machine import Machine
from kinematics.pose import from_numbers, numbers
from kinematics.tripod import Tripod
from planner.actuation import ActuatorPath
from planner.export import kmitl
from planner.export.format import Exported, Source, option
from planner.sources.position_list import PositionList

KEYS = [
    *(f"____ce{name}" for name in "xyz"), *(f"_____c{name}" for name in "xyz"), *(f"_____r{name}" for name in "xyz"),
    *(f"_mov({joint}){name}" for joint in (1, 2, 3) for name in "xyz"),
    *(f"move({joint}){name}" for joint in (1, 2, 3) for name in "xyz"),
]  # fmt: skip
INSIDE = np.arange(1, 8) / 8


@dataclass(frozen=True, slots=True)
class KmitlPositions:
    """Position list of the three-armed machine: poses joined by straight lines."""

    suffix: ClassVar[str] = ".txt"
    chord: float = option(1e-5, "by how much straight lines between poses may leave the path; default 0.01 mm", "m")
    unit_length: float = option(kmitl.UNIT, "the length of one unit; default 1 mm", "m")

    def write(self, source: Source, path: Path) -> Exported:
        machine = kmitl.tripod_of(source, "kmitl-positions")
        chord, unit = kmitl.length(self.chord, "chord"), kmitl.length(self.unit_length, "unit length")
        curve = source.trajectory.path
        each = [_chords(curve, k, chord) for k in range(len(curve.breaks) - 1)]
        s, piece = (np.concatenate([part[n][min(k, 1) :] for k, part in enumerate(each)]) for n in (0, 1))
        x = _numbers(curve, s, piece)
        text = positions_text(x, np.zeros((len(s), 3)), machine, unit)
        path.write_text(text, encoding="ascii", newline="")
        notes = [
            f"{len(s)} poses, joined by straight lines within {1e3 * chord:g} mm; the file holds no times",
            f"units of {1e3 * unit:g} mm in the machine's base frame; z of ends and centres from home's",
        ]
        if len(s) > 9:
            notes.append("the source's own reader takes numbers of one digit only: its columns are fixed")
        against = "the path, the poses joined by straight lines"
        ends = _read(path) + np.array([0.0, 0.0, offset(machine) / unit])
        moves = int(np.diff(ends, axis=0).any(1).sum())
        return Exported(_error(source, ends * unit, s, piece), against, tuple(notes), moves)


def positions_text(x: Array, angles: Array, machine: Tripod, unit: float) -> str:
    """The list of poses x (N, 12) in the machine's base frame; angles (N, 3) that it states, rad; unit: m.

    Raises MotionError for more poses, or larger numbers, than the format has room for.
    """
    kmitl.numbered(len(x), 1, "poses")
    turn = x[:, None, 3:].reshape(-1, 1, 3, 3)
    plate = x[:, None, :3] - (turn @ machine.tool)
    joints = x[:, None, :3] + (turn @ machine.platform[:, :, None])[..., 0]
    level = machine.platform * [1, 1, 0] - machine.tool * [0, 0, 1]  # from the end point
    ends = x[:, None, :3] + (turn @ level[:, :, None])[..., 0]
    zero = np.array([0.0, 0.0, offset(machine)])
    stated = np.degrees(angles)[:, None] * unit  # the only numbers that are no lengths
    values = np.concatenate([x[:, None, :3] - zero, plate - zero, stated, joints, ends], 1).reshape(len(x), -1) / unit
    lines = []
    for n, row in enumerate(values.tolist(), 1):
        lines += [*(f"Polar{n}{key} {kmitl.number(v, key)}" for key, v in zip(KEYS, row, strict=True)), ""]
    return "".join(f"{line}\r\n" for line in lines)


def offset(machine: Tripod) -> float:
    """m, in the base frame: the height from which the source counts, that of the end point as it starts (its ZOS)."""
    return float(machine.home.translation[2])


def list_text(listed: PositionList, machine: Machine, unit: float = kmitl.UNIT) -> str:
    """The list of recorded poses: those from home are put into the base frame.

    Raises MotionError for no tripod, and for rests, which have no place in it.
    """
    if not isinstance(machine, Tripod):
        raise MotionError(
            f"kmitl-positions: machine {machine.name} is no tripod, which has the three arms of the format"
        )
    if listed.rests.any():
        raise MotionError(
            f"kmitl-positions: pose {int(np.argmax(listed.rests > 0)) + 1} has a rest, which the format has no place "
            "for; save the list as CSV, or take its column dwell out"
        )
    x = RigidTransform.from_components(listed.poses[:, :3], listed.rotations)
    if listed.frame == "home":
        x = machine.home * x
    angles = x.rotation.as_euler("YZX")[:, [2, 0, 1]]
    return positions_text(numbers(x), angles, machine, kmitl.length(unit, "unit length"))


def _chords(curve: ActuatorPath, piece: int, chord: float) -> tuple[Array, np.ndarray]:
    """Ends of equal parts of a piece, none of which leaves its chord by more than `chord` (m)."""
    count = 1
    while count <= kmitl.LAST:
        s, index = kmitl.along(curve, piece, count)
        inside = (s[:-1, None] + np.diff(s)[:, None] * INSIDE).ravel()
        here = _numbers(curve, inside, np.full(len(inside), piece))[:, :3].reshape(count, -1, 3)
        ends = _numbers(curve, s, index)[:, :3]
        if float(np.linalg.norm(here - _nearest(here, ends), axis=2).max()) <= chord:
            return s, index
        count *= 2
    raise MotionError(f"kmitl-positions: chord {chord:g} m asks for more than {kmitl.LAST} poses; widen it")


def _nearest(points: Array, ends: Array) -> Array:
    """The points (N, k, 3) brought to the chords between ends (N+1, 3)."""
    way = np.diff(ends, axis=0)[:, None]
    share = (way * (points - ends[:-1, None])).sum(2) / np.maximum((way**2).sum(2), np.finfo(float).tiny)
    return np.asarray(ends[:-1, None] + np.clip(share, 0.0, 1.0)[..., None] * way)


def _numbers(curve: ActuatorPath, s: Array, piece: np.ndarray) -> Array:
    x = curve.pose_numbers(s, piece)
    if x is None:
        raise MotionError("kmitl-positions: this motion has no machine, so it has no poses to list")
    return x


def _read(path: Path) -> Array:
    """End points (N, 3) in units."""
    rows = [line.split() for line in path.read_text("ascii").splitlines()]
    return np.array([float(row[1]) for row in rows if row and "____ce" in row[0]]).reshape(-1, 3)


def _error(source: Source, ends: Array, s: Array, piece: np.ndarray) -> float:
    """Pulses, the largest between the arms' lengths on the path and at the nearest point of the chord there."""
    curve, machine = source.trajectory.path, source.machine
    share = np.concatenate([[0.0], INSIDE, [1.0]])
    here = (s[:-1, None] + np.diff(s)[:, None] * share).ravel()
    x = _numbers(curve, here, np.repeat(piece[1:], len(share)))
    near = x.copy()
    near[:, :3] = _nearest(x[:, :3].reshape(len(s) - 1, -1, 3), ends).reshape(-1, 3)
    pulse = np.array([axis.pulse for axis in machine.axes])
    off = machine.inverse(from_numbers(near)) - machine.inverse(from_numbers(x))
    return float((abs(off) / pulse).max(initial=0.0))
