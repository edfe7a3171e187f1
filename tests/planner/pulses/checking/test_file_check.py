"""The check of a written file: honest ones hold with true figures, and each of 250 corrupted ones
is caught.
"""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from kinematics import Axis, FileError
from kinematics.machine.axis import StepTiming, find_drive
from planner.export.formats import pulse_csv
from planner.export.line_times import time_lines
from planner.pulses import check, check_file, generate
from planner.pulses.checking import check_parts
from tests.planner.motions import PULSE, example

CORRUPTED = 250


@pytest.fixture(scope="module")
def plan():
    """Some 400 pulses of three axes with a rest, on drives that ask for little less than they
    get.
    """
    motion = example(5, size=0.25)
    home = motion.at(np.zeros(1)).q[0]
    axes = [Axis(f"leg{k}", pulse=PULSE, timing=find_drive("DRV8825")) for k in range(3)]
    schedule = generate(motion, axes, home)
    return SimpleNamespace(
        machine=SimpleNamespace(axes=axes, home_q=home), counted=motion, pulses=schedule
    )


@pytest.fixture(scope="module")
def text(plan, tmp_path_factory):
    path = tmp_path_factory.mktemp("pulses") / "pulses.csv"
    axes = plan.machine.axes
    pulse_csv.write(plan.pulses, path, [1, 1, 1], timing=[axis.timing for axis in axes])
    return path.read_text()


def test_an_honest_file_holds(plan, text, tmp_path):
    (tmp_path / "p.csv").write_text(text)
    found = check_file(tmp_path / "p.csv", plan)
    assert found.holds, found.faults
    for axis in found.axes:
        assert axis.lines.high >= 1.9e-6
        assert axis.lines.low >= 1.9e-6
        assert axis.lines.setup >= 0.65e-6
        assert axis.lines.interval == pytest.approx(axis.smallest_interval)


@pytest.mark.parametrize(
    "timing",
    [None, find_drive("DRV8825"), find_drive("TMC2209"), StepTiming(5e-6, 1e-6, 1e-6, 8e-6)],
)
def test_times_worked_out_from_pulses_are_those_on_the_lines(plan, tmp_path, timing):
    """The figures of the check of pulses alone, against the edges of the file that were timed one
    by one.
    """
    axes = [replace(axis, timing=timing) for axis in plan.machine.axes]
    pulse_csv.write(plan.pulses, tmp_path / "p.csv", [1, 1, 1], timing=[timing] * 3)
    other = SimpleNamespace(
        **{**vars(plan), "machine": SimpleNamespace(axes=axes, home_q=plan.machine.home_q)}
    )
    on_lines = [axis.lines for axis in check_file(tmp_path / "p.csv", other).axes]
    alone = check(plan.pulses, plan.counted, axes, plan.machine.home_q)
    assert time_lines(alone, plan.pulses.clock_hz, axes) == tuple(on_lines)
    # in parts they are the same, wherever they are cut
    cuts = [0, 7, 40, 41, 10**9]
    pieces = [
        replace(
            plan.pulses,
            axes=tuple(
                replace(a, ticks=a.ticks[b:e], direction=a.direction[b:e]) for a in plan.pulses.axes
            ),
        )
        for b, e in pairwise(cuts)
    ]
    parted = check_parts(plan.pulses, pieces, plan.counted, axes, plan.machine.home_q)
    assert time_lines(parted, plan.pulses.clock_hz, axes) == tuple(on_lines)


def test_where_no_width_fits_nothing_is_said_of_lines(plan):
    axes = [replace(axis, timing=StepTiming(1e-2, 1e-2, 0, 0)) for axis in plan.machine.axes]
    found = check(plan.pulses, plan.counted, plan.machine.axes, plan.machine.home_q)
    assert time_lines(found, plan.pulses.clock_hz, axes) == (None,) * 3


@pytest.mark.parametrize(
    ("timing", "told"),
    [
        (StepTiming(3e-6, 1e-6, 0, 0), "high: 2 us, and its drive needs 3"),
        (StepTiming(1e-6, 1e-3, 0, 0), "low:"),
        (StepTiming(1e-6, 1e-6, 0.1, 0), "setup:"),
        (StepTiming(1e-6, 1e-6, 0, 0.1), "hold:"),
        (StepTiming(1e-6, 1e-6, 0, 0, 100.0), "spacing:"),
    ],
)
def test_what_another_drive_would_not_see_is_a_fault(plan, text, tmp_path, timing, told):
    (tmp_path / "p.csv").write_text(text)
    axes = [replace(axis, timing=timing) for axis in plan.machine.axes]
    slower = SimpleNamespace(
        **{**vars(plan), "machine": SimpleNamespace(axes=axes, home_q=plan.machine.home_q)}
    )
    found = check_file(tmp_path / "p.csv", slower)
    assert not found.holds
    assert any(fault.what.startswith(told) for fault in found.faults)


def rows_of(text):
    """Header, and rows of whole ticks and levels."""
    header, *rest = text.splitlines()
    cells = [line.split(",") for line in rest]
    return header, [[round(float(row[0]) * 1e7), *map(int, row[1:])] for row in cells]


def text_of(header, rows):
    """As a file may be written: times as decimals, levels after them."""
    return (
        "\n".join(
            [header, *(", ".join([f"{row[0] / 1e7:.9f}", *map(str, row[1:])]) for row in rows)]
        )
        + "\n"
    )


def pulses_of(rows, k):
    """Rows at which STEP of axis k rises, and those at which it falls, pulse by pulse."""
    step = [0, *(row[1 + 2 * k] for row in rows)]
    rise = [i for i in range(len(rows)) if step[i + 1] > step[i]]
    fall = [i for i in range(len(rows)) if step[i + 1] < step[i]]
    return list(zip(rise, fall, strict=True))


def drop_pulse(rows, k, rng):
    rise, fall = pulses_of(rows, k)[rng.integers(len(pulses_of(rows, k)))]
    for i in range(rise, fall):
        rows[i][1 + 2 * k] = 0


def add_pulse(rows, k, rng):
    pulses = pulses_of(rows, k)
    first = rng.integers(len(pulses) - 1)
    i = pulses[first][1]
    at = (rows[i][0] + rows[pulses[first + 1][0]][0]) // 2
    before = [row for row in rows if row[0] <= at - 10]
    level = list(before[-1])
    level[1 + 2 * k] = 1
    low = list(level)
    low[1 + 2 * k] = 0
    rows.append([at - 10, *level[1:]])
    rows.append([at + 10, *low[1:]])
    rows.sort(key=lambda row: row[0])


def turn_pulse(rows, k, rng):
    rise, fall = pulses_of(rows, k)[rng.integers(len(pulses_of(rows, k)))]
    for i in range(max(rise - 1, 0), fall + 1):
        rows[i][2 + 2 * k] ^= 1


def late_pulse(rows, k, rng):
    """A pulse is late by 2 ticks to 3 µs: rows of this axis only."""
    rise, _ = pulses_of(rows, k)[rng.integers(len(pulses_of(rows, k)))]
    late = int(rng.integers(2, 30)) * int(rng.choice([-1, 1]))
    row = rows[rise]
    row[0] += late
    rows.sort(key=lambda row: row[0])


def shift_all(rows, k, rng):
    late = int(rng.integers(2, 500))
    for row in rows[1:]:
        row[0] += late


def other_axis(rows, k, rng):
    other = (k + 1) % 3
    for row in rows:
        row[1 + 2 * k : 3 + 2 * k], row[1 + 2 * other : 3 + 2 * other] = (
            row[1 + 2 * other : 3 + 2 * other],
            row[1 + 2 * k : 3 + 2 * k],
        )


def wrong_way(rows, k, rng):
    for row in rows:
        row[2 + 2 * k] ^= 1


def cut_short(rows, k, rng):
    del rows[len(rows) - int(rng.integers(3, 400)) :]


def slower_clock(rows, k, rng):
    scale = 1 + float(rng.uniform(1e-4, 1e-2)) * float(rng.choice([-1, 1]))
    for row in rows:
        row[0] = round(row[0] * scale)


def narrow(rows, k, rng):
    """One pulse stays high for a tenth of what its drive needs."""
    rise, fall = pulses_of(rows, k)[rng.integers(len(pulses_of(rows, k)))]
    if any(rows[i][0] <= rows[rise][0] + 2 for i in range(rise + 1, fall)):
        fall = rise + 1
    rows[fall][0] = rows[rise][0] + 2


def bad_level(rows, k, rng):
    rows[rng.integers(len(rows))][1 + 2 * k] = 7


def same_time(rows, k, rng):
    i = int(rng.integers(1, len(rows)))
    rows[i][0] = rows[i - 1][0]


KINDS = [
    drop_pulse,
    add_pulse,
    turn_pulse,
    late_pulse,
    shift_all,
    other_axis,
    wrong_way,
    cut_short,
    slower_clock,
]
KINDS += [narrow, bad_level, same_time]


def test_a_file_cut_between_two_lines_is_refused(plan, text, tmp_path):
    """The last falling edge is missing: STEP would stay high."""
    lines = text.splitlines(keepends=True)
    (tmp_path / "p.csv").write_text("".join(lines[:-1]))
    with pytest.raises(
        FileError,
        match=rf":{len(lines) - 1}: row: leaves STEP of leg\d high: the file has been cut",
    ):
        check_file(tmp_path / "p.csv", plan)


@pytest.mark.parametrize("changed", [b"\xef\xbb\xbf%b", b"crlf"])
def test_a_byte_order_mark_and_other_line_ends_are_read(plan, text, tmp_path, changed):
    content = text.encode()
    content = content.replace(b"\n", b"\r\n") if changed == b"crlf" else changed % content
    (tmp_path / "p.csv").write_bytes(content)
    assert check_file(tmp_path / "p.csv", plan).holds


def test_every_corrupted_file_is_caught(plan, text, tmp_path):
    """Seeded: a pulse dropped, added, turned round, moved by 2 ticks or more; axes swapped, a clock
    off by 1e-4, …
    """
    header, honest = rows_of(text)
    assert check_text(plan, text_of(header, honest), tmp_path)
    missed, caught = [], dict.fromkeys((kind.__name__ for kind in KINDS), 0)
    for seed in range(CORRUPTED):
        rng = np.random.default_rng(seed)
        kind = KINDS[seed % len(KINDS)]
        rows = [list(row) for row in honest]
        kind(rows, int(rng.integers(3)), rng)
        assert rows != honest, (kind.__name__, seed)
        if check_text(plan, text_of(header, rows), tmp_path):
            missed.append((kind.__name__, seed))
        else:
            caught[kind.__name__] += 1
    assert not missed
    assert sum(caught.values()) == CORRUPTED


def check_text(plan, text, folder):
    path = folder / "p.csv"
    path.write_text(text)
    try:
        return check_file(path, plan).holds
    except FileError:
        return False
