"""A master for the emulated drives: it reads a file of the export `csp` by its words, and sends it row by row."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.evidence.peers.csp_drive.drive import LIMITED, MODE, NO_WINDOW, TICK, Drive, DriveState
from kinematics.foundation.arrays import Array

HELD = 0.2
"""s that the master holds the first row before the motion, and the last one after it."""

Whole = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Sheet:
    """A file: s of a cycle, (n,) where it starts and largest second differences, (K, n) rows of the three objects."""

    cycle: float
    starts: Whole
    most: Whole
    columns: dict[str, Whole]

    @property
    def rows(self) -> Whole:
        return self.columns["0x607A"]


def read_sheet(path: Path) -> Sheet:
    """What the words and columns of a file say. The last row is repeated for as long as the master holds it."""
    told, (names, *lines) = [], path.read_text("ascii").splitlines()
    while names.startswith("#"):
        told.append(names)
        names, *lines = lines
    cycle = 1e-3 * float(re.findall(r"a row every (\S+) ms", told[0])[0])
    table = np.array([line.split(",") for line in lines], np.int64)
    table = np.concatenate([table, np.repeat(table[-1:], round(HELD / cycle), 0)])
    codes = np.array([name.partition(":")[0] for name in names.split(",")])
    words = [re.findall(r"starts at (\S+), second difference at most (\d+) ", line)[0] for line in told[1:]]
    starts, most = np.array(words, np.int64).T
    return Sheet(cycle, starts, most, {code: table[:, codes == code] for code in dict.fromkeys(codes[1:].tolist())})


@dataclass(frozen=True, slots=True)
class MasterSetting:
    """What the master sends, and how the drives are set.

    order    (K,) which row of the file is sent in each cycle
    words    controlwords one after another, from row `late` on
    away     increments between where the motors stand and where the file starts
    window   increments, 0x6065;  limits  (n, 2) 0x607D;  speed  (n,) increments/s, 0x6080
    rated    (n,) increments/s² by the rated torque;  loads  (K, n) increments/s²
    slower   how many times the cycle 0x60C2 is
    """

    order: Whole
    limits: Whole
    speed: Array
    rated: Array
    loads: Array
    words: tuple[int, ...] = (0x06, 0x07, 0x0F)
    offsets: tuple[str, ...] = ("0x60B1", "0x60B2")
    parabola: bool = False
    mode: int = MODE
    window: int = NO_WINDOW
    away: int = 0
    late: int = 0
    slower: int = 1


@dataclass(frozen=True, slots=True)
class Played:
    """What the master saw, and what went on between.

    demanded  (K, n) 0x6062 at the end of each cycle;  actual  (n,) 0x6064 at last
    ways      (K, N, n) the demand at each cycle of the drive;  following  (n,) largest following error
    limited   whether bit 11 was set;  errors  the error codes;  enabled  whether operation was enabled at last
    """

    demanded: Whole
    actual: Whole
    ways: Array
    following: Array
    limited: bool
    errors: frozenset[int]
    enabled: bool


def make_drive(sheet: Sheet, setting: MasterSetting, k: int) -> Drive:
    """The drive of an axis, with its objects set."""
    drive = Drive(float(sheet.starts[k] + setting.away), rated=float(setting.rated[k]), parabola=setting.parabola)
    value, power = f"{setting.slower * sheet.cycle:e}".split("e")
    digits = value.rstrip("0").replace(".", "")
    drive.write(0x60C2, int(digits), 1)
    drive.write(0x60C2, int(power) - len(digits) + 1, 2)
    drive.write(0x6060, setting.mode)
    drive.write(0x6065, setting.window)
    drive.write(0x607D, int(setting.limits[k, 0]), 1)
    drive.write(0x607D, int(setting.limits[k, 1]), 2)
    drive.write(0x6080, int(np.ceil(setting.speed[k] + 1 / sheet.cycle)))  # a row is rounded by half an increment
    drive.write(0x60C5, int(np.ceil(sheet.most[k] / sheet.cycle**2)))
    return drive


def play(sheet: Sheet, setting: MasterSetting) -> Played:
    """It enables, holds the first row, sends a row a cycle, and stops all axes where one leaves operation."""
    count, ticks = len(sheet.starts), round(sheet.cycle / TICK)
    drives = [make_drive(sheet, setting, k) for k in range(count)]
    held = round(HELD / sheet.cycle)
    order = np.concatenate([np.zeros(held, np.int64), setting.order])
    words = [0] * (setting.late + held if setting.late else 0)
    words += [*setting.words, *[setting.words[-1]] * len(order)]
    demanded, ways = np.empty((len(order), count), np.int64), np.empty((len(order), ticks, count))
    mapped = [code for code in ("0x607A", *setting.offsets) if code in sheet.columns]
    columns = {int(code, 16): sheet.columns[code].tolist() for code in mapped}
    loads, limited, ran = setting.loads.tolist(), False, False
    for n, row in enumerate(order.tolist()):
        ran = ran or all(drive.state == DriveState.ENABLED for drive in drives)
        stops = ran and any(drive.state != DriveState.ENABLED for drive in drives)
        before, now = max(n - held - 1, 0), max(n - held, 0)
        for k, drive in enumerate(drives):
            if n == held:
                drive.motion[5] = 0.0  # what the load did when the brake opened
            drive.write(0x6040, 0x02 if stops else words[n])
            for code, rows in columns.items():
                drive.write(code, rows[row][k])
            load = loads[min(before, len(loads) - 1)][k], loads[min(now, len(loads) - 1)][k]
            ways[n, :, k] = drive.run(ticks, load)
            demanded[n, k] = drive.read(0x6062)
            limited = limited or bool(drive.read(0x6041) & LIMITED)
    return Played(
        demanded[held:],
        np.array([drive.read(0x6064) for drive in drives]),
        ways[held:],
        np.array([drive.motion[5] for drive in drives]),
        limited,
        frozenset(drive.read(0x603F) for drive in drives) - {0},
        all(drive.state == DriveState.ENABLED for drive in drives),
    )
