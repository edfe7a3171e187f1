"""The pulse CSV: decoded by a few independent lines, exact to the tick, and read back as it was."""

import csv
from dataclasses import replace
from decimal import Decimal
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import Axis, FileError, MotionError
from kinematics.machine.axis import StepTiming
from planner import PulseSchedule, open_pulses
from planner.export.formats import binary, pulse_csv
from planner.pulses import AxisPulses
from planner.pulses.checking import edge_reader
from tests import read_lines
from tests.pace import cpu_limit

CLOCK = 10_000_000
PULSE = 0.75e-6


def schedule_of(*pulses, clock=CLOCK, names=None, starts=None):
    """Each axis as signed ticks: +tick steps up at tick, -tick down."""
    axes = []
    for k, signed in enumerate(pulses):
        signed = np.asarray(signed, np.int64)
        name = names[k] if names else f"leg{k + 1}"
        direction = np.where(signed < 0, -1, 1).astype(np.int8)
        axes.append(
            AxisPulses(name, abs(signed), direction, starts[k] if starts else 0, PULSE, 0.2 + k)
        )
    return PulseSchedule(clock, tuple(axes), 1.0)


def machine_axes(schedule, wiring=None):
    wiring = wiring or [1] * len(schedule.axes)
    return [
        Axis(axis.name, pulse=axis.pulse, direction=sign)
        for axis, sign in zip(schedule.axes, wiring, strict=True)
    ]


def read_back(path, schedule, wiring=None):
    home, start = [axis.home for axis in schedule.axes], [axis.start for axis in schedule.axes]
    axes = machine_axes(schedule, wiring)
    return read_lines.read(
        path, schedule.clock_hz, axes, home, start=start, duration=schedule.duration
    ).schedule


def assert_same(one, other):
    assert (one.clock_hz, one.duration) == (other.clock_hz, other.duration)
    for a, b in zip(one.axes, other.axes, strict=True):
        assert (a.name, a.start, a.pulse, a.home) == (b.name, b.start, b.pulse, b.home)
        assert (a.ticks == b.ticks).all()
        assert (a.direction == b.direction).all()


def decode(path, clock=CLOCK):
    """The rows as (tick, levels), by the standard library and exact decimals."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file, skipinitialspace=True))
    return rows[0], [(Decimal(row[0]) * clock, [int(cell) for cell in row[1:]]) for row in rows[1:]]


def test_the_file_reads_as_a_logic_analyser_would_write_it(tmp_path):
    path = tmp_path / "pulses.csv"
    pulse_csv.write(schedule_of([100, 200, -350], [-200]), path, [1, 1])
    assert path.read_bytes().decode() == (
        "Time[s], leg1 STEP, leg1 DIR, leg2 STEP, leg2 DIR\n"
        "0.000000000, 0, 1, 0, 0\n"
        "0.000010000, 1, 1, 0, 0\n"
        "0.000012000, 0, 1, 0, 0\n"
        "0.000020000, 1, 1, 1, 0\n"
        "0.000022000, 0, 0, 0, 0\n"
        "0.000035000, 1, 0, 0, 0\n"
        "0.000037000, 0, 0, 0, 0\n"
    )


@st.composite
def schedules(draw):
    """One to three axes of up to 60 pulses, from 2 ticks apart to seconds, from tick 0 on."""
    pulses = []
    for _ in range(draw(st.integers(1, 3))):
        gaps = draw(st.lists(st.one_of(st.integers(2, 9), st.integers(2, 10**8)), max_size=60))
        first = draw(st.integers(0, 30))
        signs = draw(st.lists(st.sampled_from([-1, 1]), min_size=len(gaps), max_size=len(gaps)))
        pulses.append((first + np.cumsum(gaps, dtype=np.int64) - (gaps[0] if gaps else 0), signs))
    axes = tuple(
        AxisPulses(f"a{k}", t, np.array(d, np.int8), k, PULSE, 0.0)
        for k, (t, d) in enumerate(pulses)
    )
    return PulseSchedule(CLOCK, axes, 1.0)


@settings(deadline=None, max_examples=60)
@given(schedules(), st.lists(st.sampled_from([-1, 1]), min_size=3, max_size=3))
def test_any_schedule_survives_the_file_and_an_independent_decoder_agrees(
    tmp_path_factory, schedule, wiring
):
    wiring = wiring[: len(schedule.axes)]
    path = tmp_path_factory.mktemp("csv") / "pulses.csv"
    pulse_csv.write(schedule, path, wiring)
    assert_same(read_back(path, schedule, wiring), schedule)
    _, rows = decode(path)
    instants = [tick for tick, _ in rows]
    assert instants == sorted(set(instants))
    for k, axis in enumerate(schedule.axes):
        step, direction = ([levels[2 * k + i] for _, levels in rows] for i in (0, 1))
        rising = [i for i in range(len(rows)) if step[i] and (i == 0 or not step[i - 1])]
        assert [instants[i] for i in rising] == axis.ticks.tolist()
        # DIR 1 counts up in the wiring, which is +1 in q times the wiring's sign.
        assert [(1 if direction[i] else -1) * wiring[k] for i in rising] == axis.direction.tolist()
        falling = [i for i in range(1, len(rows)) if step[i - 1] and not step[i]]
        assert len({instants[j] - instants[i] for i, j in zip(rising, falling, strict=True)}) <= 1
        # DIR only changes where STEP falls: the set-up time is as long as can be.
        assert {i for i in range(1, len(rows)) if direction[i] != direction[i - 1]} <= set(falling)
    assert all(
        before != after for (_, before), (_, after) in pairwise(rows[1:])
    )  # no row without an edge


@settings(deadline=None, max_examples=60)
@given(schedules(), st.integers(1, 20))
def test_a_schedule_in_a_file_gives_the_same_edges_part_by_part(tmp_path_factory, schedule, part):
    """A pulse whose STEP falls in the next part, and the way of one that comes parts later, are
    known in time.
    """
    folder, wiring = tmp_path_factory.mktemp("csv"), [1, -1, 1][: len(schedule.axes)]
    binary.write(schedule, folder / "pulses.bin", part=part)
    pulse_csv.write(schedule, folder / "whole.csv", wiring)
    pulse_csv.write(open_pulses(folder / "pulses.bin"), folder / "parts.csv", wiring)
    assert (folder / "parts.csv").read_bytes() == (folder / "whole.csv").read_bytes()


def test_wiring_turns_dir_and_nothing_else(tmp_path):
    schedule = schedule_of([100, 300, -500], [150])
    pulse_csv.write(schedule, tmp_path / "plus.csv", [1, 1])
    pulse_csv.write(schedule, tmp_path / "minus.csv", [-1, 1])
    (_, plus), (_, minus) = decode(tmp_path / "plus.csv"), decode(tmp_path / "minus.csv")
    for (t, p), (u, m) in zip(plus, minus, strict=True):
        assert t == u
        assert m == [p[0], 1 - p[1], p[2], p[3]]
    assert_same(read_back(tmp_path / "minus.csv", schedule, [-1, 1]), schedule)


@pytest.mark.parametrize(
    "clock", [1_000_000, 10_000_000, 19_660_000, 9_830_400, 1_000_000_000, 16_000_000, 3]
)
def test_every_clock_reads_back_to_the_tick_exactly_where_decimals_can(tmp_path, clock):
    rng = np.random.default_rng(clock)
    ticks = (
        np.unique(rng.integers(0, 100 * clock, 400) // 2) * 2
    )  # up to 100 s: the seconds grow from one digit to two
    schedule = schedule_of(ticks, clock=clock)
    pulse_csv.write(schedule, tmp_path / "p.csv", [1])
    assert_same(read_back(tmp_path / "p.csv", schedule), schedule)
    _, rows = decode(tmp_path / "p.csv", clock)
    error = max(abs(tick - round(tick)) for tick, _ in rows)
    assert error == 0 if 10**15 % clock == 0 else error <= Decimal("0.05")
    decimals = {
        len(line.split(",")[0].split(".")[1])
        for line in (tmp_path / "p.csv").read_text().split("\n")[1:-1]
    }
    assert len(decimals) == 1
    assert min(decimals) >= 9


def test_the_width_is_two_microseconds_or_half_the_smallest_interval_or_as_asked(tmp_path):
    def width(schedule, **options):
        pulse_csv.write(schedule, tmp_path / "w.csv", [1] * len(schedule.axes), **options)
        _, rows = decode(tmp_path / "w.csv")
        return rows[2][0] - rows[1][0]

    assert width(schedule_of([100, 200])) == 20
    assert width(schedule_of([100, 131])) == 15
    assert width(schedule_of([100])) == 20
    assert width(schedule_of([100, 200]), width=5e-6) == 50
    for far in (0.0, 1e-5):
        with pytest.raises(MotionError, match="pulse width"):
            width(schedule_of([100, 200]), width=far)
    with pytest.raises(
        MotionError,
        match=r"at least 0.1 us .* and at most 0 us \(the closest pulses are 0.1 us apart",
    ):
        width(schedule_of([100, 101]))


@pytest.mark.parametrize(
    ("timing", "width", "told"),
    [
        (
            (1.9e-6, 1e-6, 0, 0),
            1e-6,
            r"1 us: must be at least 1.9 us \(the drive of a0 needs STEP high so long\)",
        ),
        (
            (1e-6, 4e-6, 0, 0),
            7e-6,
            r"7 us: must be at most 6 us \(the closest .* a0 needs STEP low for 4 us\)",
        ),
        (
            (1e-6, 1e-6, 5e-6, 0),
            20e-6,
            r"must be at most 15 us \(a0 reverses within 20 us, .* 5 us before STEP rises\)",
        ),
    ],
)
def test_a_width_that_a_drive_does_not_take_is_told_in_microseconds_with_the_drive(
    tmp_path, timing, width, told
):
    schedule = schedule_of([100, -300] if timing[2] else [100, 200], names=["a0"])
    with pytest.raises(MotionError, match=told):
        pulse_csv.write(
            schedule, tmp_path / "w.csv", [1], width=width, timing=[StepTiming(*timing)]
        )


@pytest.mark.parametrize("part", [None, 3])
def test_the_hold_of_dir_counts_at_reversals_only(tmp_path, part):
    """A drive with a hold of 25 us, and pulses 10 us apart: the hold is longer than the gaps of one
    direction.
    """
    hold, setup = 25e-6, 3e-6
    signed = [100, 200, 300, -600, -700, -800, 1100, 1200]
    schedule = schedule_of(signed, [150, 250, 350, 450], names=["a0", "a1"])
    timing = [StepTiming(1e-6, 1e-6, setup, hold), None]
    if part is None:
        pulse_csv.write(schedule, tmp_path / "p.csv", [1, 1], timing=timing)
    else:
        binary.write(schedule, tmp_path / "p.bin", part=part)
        pulse_csv.write(open_pulses(tmp_path / "p.bin"), tmp_path / "p.csv", [1, 1], timing=timing)
    _, rows = decode(tmp_path / "p.csv")
    ticks, levels = [int(tick) for tick, _ in rows], np.array([levels for _, levels in rows])
    changes = [ticks[k] for k in np.flatnonzero(np.diff(levels[:, 1])) + 1]
    assert changes == [300 + 250, 800 + 250]
    falls = [ticks[k] for k in np.flatnonzero(np.diff(levels[:, 0]) == -1) + 1]
    assert falls == [abs(tick) + 20 for tick in signed]
    assert_same(read_back(tmp_path / "p.csv", schedule), schedule)
    least = read_lines.read(tmp_path / "p.csv", CLOCK, machine_axes(schedule), [0.2, 1.2]).times[0]
    assert least.hold == pytest.approx(hold)
    assert least.setup == pytest.approx(5e-6)


def test_a_reversal_too_short_for_hold_and_setup_is_refused(tmp_path):
    schedule = schedule_of([100, -300], names=["a0"])
    with pytest.raises(
        MotionError, match=r"a0 reverses within 20 us, .* 18 us after STEP rises and 3 us before"
    ):
        pulse_csv.write(
            schedule, tmp_path / "w.csv", [1], timing=[StepTiming(1e-6, 1e-6, 3e-6, 18e-6)]
        )


def test_axes_that_never_fire_and_pulses_at_tick_zero(tmp_path):
    schedule = schedule_of([0, 100], [], starts=[-3, 7])
    pulse_csv.write(schedule, tmp_path / "p.csv", [1, -1])
    assert_same(read_back(tmp_path / "p.csv", schedule, [1, -1]), schedule)
    silent = schedule_of([], [])
    pulse_csv.write(silent, tmp_path / "s.csv", [1, 1])
    assert (tmp_path / "s.csv").read_text().split("\n")[1:] == ["0.000000000, 0, 0, 0, 0", ""]
    assert_same(read_back(tmp_path / "s.csv", silent), silent)


def test_names_with_commas_and_quotes_survive(tmp_path):
    schedule = schedule_of([100], [200], names=['left, "upper"', "θ₁"])
    pulse_csv.write(schedule, tmp_path / "p.csv", [1, 1])
    assert decode(tmp_path / "p.csv")[0][1:4] == [
        'left, "upper" STEP',
        'left, "upper" DIR',
        "θ₁ STEP",
    ]
    assert_same(read_back(tmp_path / "p.csv", schedule), schedule)


def test_a_header_longer_than_a_csv_reader_takes_is_a_fault(tmp_path):
    schedule = schedule_of([100])
    (tmp_path / "p.csv").write_text(f"Time[s], {'l' * 140_000} STEP, leg1 DIR\n0.000000000, 0, 0\n")
    with pytest.raises(FileError, match=r"p\.csv:1: header: not CSV"):
        read_back(tmp_path / "p.csv", schedule)


def test_many_pulses_are_written_and_read_in_pieces(tmp_path, monkeypatch):
    """Six axes in 400 000 rows, through windows that cut pulses in two and parts that cut rows in
    two.
    """
    rng, count = np.random.default_rng(0), 34_000
    axes = tuple(
        AxisPulses(
            f"leg{k}",
            np.cumsum(rng.integers(300, 800, count)),
            rng.choice([-1, 1], count),
            0,
            PULSE,
            0.0,
        )
        for k in range(6)
    )
    schedule = PulseSchedule(CLOCK, axes, 1.0)
    with cpu_limit(
        2.0
    ):  # 0.3 s where this was written; the bound only catches a loop over rows (some 4 s)
        pulse_csv.write(schedule, tmp_path / "p.csv", [1] * 6)
        again = read_back(tmp_path / "p.csv", schedule)
    assert_same(again, schedule)
    largest = 0

    def watched(ticks, levels, clock):
        nonlocal largest
        largest = max(largest, len(ticks))
        return text(ticks, levels, clock)

    text = pulse_csv._text
    monkeypatch.setattr(pulse_csv, "_text", watched)
    monkeypatch.setattr(pulse_csv, "WINDOW", 500)
    monkeypatch.setattr(edge_reader, "PART_BYTES", 1000)
    few = replace(
        schedule,
        axes=tuple(replace(a, ticks=a.ticks[:3000], direction=a.direction[:3000]) for a in axes),
    )
    pulse_csv.write(few, tmp_path / "pieces.csv", [1] * 6)
    monkeypatch.undo()
    pulse_csv.write(few, tmp_path / "whole.csv", [1] * 6)
    assert (tmp_path / "pieces.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()
    assert largest <= 2 * 6 * 500
    monkeypatch.setattr(edge_reader, "PART_BYTES", 1000)
    assert_same(read_back(tmp_path / "pieces.csv", few), few)


SMALL = "Time[s], leg1 STEP, leg1 DIR\n0.000000000, 0, 1\n0.000010000, 1, 1\n0.000012000, 0, 1\n"


@pytest.mark.parametrize(
    ("old", "new", "line", "says"),
    [
        ("leg1 STEP", "leg2 STEP", 1, "should be"),
        (SMALL, "", 1, "should be"),
        ("0.000010000, 1, 1", "0.000010000, 1", 3, "not a time and 2 levels"),
        ("0.000010000, 1, 1", "0.000010000, 1, 1, 0", 3, "not a time and 2 levels"),
        ("0.000010000, 1, 1", "0.000010000, 2, 1", 3, "not a time and 2 levels"),
        ("0.000010000, 1, 1", "0.000010000, x, 1", 3, "not a time and 2 levels"),
        ("0.000010000, 1, 1", "", 3, "not a time and 2 levels"),
        ("0.000010000", "now", 3, "not a time and 2 levels"),
        ("0.000010000", "nan", 3, "not a tick"),
        ("0.000010000", "0.00001003", 3, "not a tick of 10000000 Hz"),
        ("0.000012000", "0.000010000", 4, "does not come after"),
        ("0.000012000", "0.000005000", 4, "does not come after"),
        ("0.000000000", "-0.000000100", 2, "after 0"),
    ],
)
def test_a_spoilt_file_is_refused_with_the_line(tmp_path, old, new, line, says):
    path = tmp_path / "p.csv"
    path.write_text(SMALL.replace(old, new), encoding="utf-8")
    with pytest.raises(FileError, match=rf"p\.csv:{line}: .*{says}") as refused:
        read_lines.read(path, CLOCK, [Axis("leg1", pulse=PULSE)], [0.0])
    assert refused.value.faults[0].line == line


def test_a_file_of_another_clock_is_refused(tmp_path):
    schedule = schedule_of([101, 203])
    pulse_csv.write(schedule, tmp_path / "p.csv", [1])
    with pytest.raises(FileError, match="not a tick of 1000000 Hz"):
        read_lines.read(tmp_path / "p.csv", 1_000_000, machine_axes(schedule), [0.0])


def test_without_counts_and_duration_the_file_starts_at_zero_and_ends_with_its_last_row(tmp_path):
    (tmp_path / "p.csv").write_text(
        SMALL.removesuffix("\n")
    )  # a last row without line end counts too
    read = read_lines.read(tmp_path / "p.csv", CLOCK, [Axis("leg1", pulse=PULSE)], [0.1]).schedule
    assert (read.axes[0].start, read.axes[0].final, read.duration) == (0, 1, 1.2e-5)


@pytest.mark.parametrize("wiring", [[1], [1, 0], [1, 1, 1]])
def test_wiring_must_match(tmp_path, wiring):
    with pytest.raises(MotionError, match=r"give \+1 or -1 for each of the 2 axes"):
        pulse_csv.write(schedule_of([1], [2]), tmp_path / "p.csv", wiring)
    assert not (tmp_path / "p.csv").exists()


def test_a_name_with_a_line_feed_and_quotes_is_read_back(tmp_path):
    (axis,) = schedule_of([100, 200]).axes
    schedule = PulseSchedule(CLOCK, (replace(axis, name='leg "1"\nand, more'),), 1e-4)
    pulse_csv.write(schedule, tmp_path / "p.csv", [1])
    assert_same(read_back(tmp_path / "p.csv", schedule), schedule)
    (tmp_path / "q.csv").write_text((tmp_path / "p.csv").read_text() + "what\n")
    rows = (tmp_path / "q.csv").read_text().count("\n")
    with pytest.raises(FileError, match=rf"q\.csv:{rows}: "):
        read_back(tmp_path / "q.csv", schedule)
