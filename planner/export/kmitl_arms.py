"""Arm-length list of [KMITL 2005]: the three arm lengths at steps along the path, for its DDA to run through.

    PointL1_10001266.774
    PointL2_10001266.774
    PointL3_10001266.774

    PointL1_10002266.771
    …

The key is followed by the length at once, in seven characters: the source's reader takes columns 14 to 20. The number
runs up from 10001; an empty line ends a point. Lengths are distances between joint centres, in units. The file holds
no times: the source's reader runs as fast as its loop of output commands. ASCII, line ends \\r\\n, decimal points.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from kinematics.array import Array
from planner.export import kmitl
from planner.export.format import Exported, Source, option

FIRST = 10_001
COUNTS = 500
"""Counts of one unit of length [KMITL 2005]."""


@dataclass(frozen=True, slots=True)
class KmitlArms:
    """Arm-length list of the three-armed machine, step by step along the path."""

    suffix: ClassVar[str] = ".txt"
    point_step: float = option(1e-3, "between listed points along the path; default 1 mm", "m")
    unit_length: float = option(kmitl.UNIT, "the length of one unit; default 1 mm", "m")

    def write(self, source: Source, path: Path) -> Exported:
        kmitl.tripod_of(source, "kmitl-arms")
        step, unit = kmitl.length(self.point_step, "point step"), kmitl.length(self.unit_length, "unit length")
        curve = source.trajectory.path
        pieces = range(len(curve.breaks) - 1)
        each = [kmitl.along(curve, k, kmitl.steps(curve, k, step)) for k in pieces]
        # a piece begins where the one before it ends
        s, piece = (np.concatenate([part[n][min(k, 1) :] for k, part in enumerate(each)]) for n in (0, 1))
        kmitl.numbered(len(s), FIRST, "points")
        lengths = curve.derivatives(s, piece)[0] / unit
        texts = [[kmitl.number(value, "arm length") for value in row] for row in lengths.tolist()]
        lines = []
        for n, row in enumerate(texts, FIRST):
            lines += [*(f"PointL{arm}_{n}{text}" for arm, text in enumerate(row, 1)), ""]
        path.write_text("".join(f"{line}\r\n" for line in lines), encoding="ascii", newline="")
        held = _read(path)
        return Exported(
            max(_errors(source, held, s, piece, unit)),
            "the path, the DDA run from point to point",
            (
                f"{len(s)} points, {1e3 * step:g} mm apart at most; the file holds no times",
                f"its reader counts {COUNTS} to a unit of {1e3 * unit:g} mm: one count is "
                f"{unit / COUNTS / source.machine.axes[0].pulse:.6g} pulses",
            ),
            int(np.diff(held, axis=0).any(1).sum()),
        )


def _read(path: Path) -> Array:
    """Lengths (N, 3) in units, by the columns that the source's reader takes."""
    lines = path.read_text("ascii").splitlines()
    return np.array([float(line[13:20]) for line in lines if line.startswith("PointL")]).reshape(-1, 3)


def _errors(source: Source, lengths: Array, s: Array, piece: np.ndarray, unit: float) -> Iterator[float]:
    """Pulses, the largest error of each step: counts after every turn of the DDA against the path there.

    A step of less than a count has no turn: there the path is looked at in both ends.
    """
    pulse = np.array([axis.pulse for axis in source.machine.axes])
    home_q = source.trajectory.path.derivatives(s[:1], piece[:1])[0]
    at = np.zeros(3)
    yield 0.0
    for n, target in enumerate((lengths[1:] - lengths[0]) * COUNTS, 1):
        counts = at + dda(target - at)
        counts = counts if len(counts) > 1 else np.repeat(counts, 2, axis=0)
        share = np.arange(len(counts)) / (len(counts) - 1)
        q = source.trajectory.path.derivatives(s[n - 1] + (s[n] - s[n - 1]) * share, np.full(len(counts), piece[n]))[0]
        yield float((abs(counts * unit / COUNTS - (q - home_q)) / pulse).max())
        at = counts[-1]


def dda(way: Array) -> Array:
    """(M+1, 3) counts from 0 at every turn on a way (3,) of counts [KMITL 2005, `going`].

    Of M = ⌊k⌋ turns, k the largest |way|, turn m has each axis fire where its sum passes k - 1: ⌊(m |way| + 1)/k⌋.
    """
    most = float(abs(way).max())
    turns = np.arange(int(most) + 1)
    return np.sign(way) * np.floor((turns[:, None] * abs(way) + 1) / most) if most >= 1 else np.zeros((1, 3))
