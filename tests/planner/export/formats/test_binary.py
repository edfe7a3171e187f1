"""The binary form: back tick for tick, read by a decoder made from its description alone, and never
a wrong pulse.
"""

import json
import os
import struct
import tracemalloc
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from zlib import compress, crc32, decompress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import FileError, MotionError
from planner import PulseSchedule, open_pulses, read_pulses
from planner.export.formats import binary
from planner.pulses import AxisPulses, MovedPulses, check_file
from planner.pulses.schedule import Compensation
from tests.planner.motions import PULSE

GAPS = st.one_of(st.integers(1, 300), st.integers(1, 1 << 40), st.integers(250, 260))
AXES = st.lists(
    st.lists(st.tuples(GAPS, st.sampled_from([-1, 1])), max_size=40), min_size=1, max_size=4
)


def schedule_of(axes):
    made = []
    for k, pulses in enumerate(axes):
        ticks = np.cumsum([gap for gap, _ in pulses], dtype=np.int64)
        signs = np.array([sign for _, sign in pulses], np.int8)
        made.append(AxisPulses(f"leg/{k} ä", ticks, signs, 3 - k, 0.75e-6, 0.2 + k, 0.5 + k / 8))
    moved = (MovedPulses(made[0].name, 3, 1e-6, 0.125, 0.3, 1e-7),)
    cost = (
        Compensation(
            made[0].name, ("backlash", "lead"), 2, 1e-6, windows=((0.1, 0.2), (0.3, 1 / 3))
        ),
    )
    return PulseSchedule(10_000_000, tuple(made), 1.5 + 1e-17, "floor", moved, cost)


def is_same(one, other):
    """Everything that a schedule holds."""
    rest = ("clock_hz", "duration", "rule", "moves", "compensations")
    return all(getattr(one, name) == getattr(other, name) for name in rest) and all(
        (a.name, a.start, a.pulse, a.home, a.bound) == (b.name, b.start, b.pulse, b.home, b.bound)
        and np.array_equal(a.ticks, b.ticks)
        and np.array_equal(a.direction, b.direction)
        for a, b in zip(one.axes, other.axes, strict=True)
    )


@settings(max_examples=60, derandomize=True, deadline=None)
@given(AXES, st.integers(1, 50))
def test_any_schedule_comes_back_from_parts_of_any_size(tmp_path_factory, axes, part):
    schedule, path = schedule_of(axes), tmp_path_factory.mktemp("binary") / "pulses.bin"
    binary.write(schedule, path, part=part)
    assert is_same(read_pulses(path), schedule)
    assert decode(path) == [
        (axis.ticks.tolist(), axis.direction.tolist()) for axis in schedule.axes
    ]
    parts = list(open_pulses(path).parts())
    assert max(len(axis) for each in parts for axis in each.axes) <= part
    assert [axis.start for axis in parts[0].axes] == [axis.start for axis in schedule.axes]
    for before, after in pairwise(parts):
        assert [axis.final for axis in before.axes] == [axis.start for axis in after.axes]
        latest = max(int(axis.ticks[-1]) for axis in before.axes if len(axis))
        assert all(
            axis.ticks[0] > latest for axis in after.axes if len(axis)
        )  # parts do not overlap in time


def chunks_of(content):
    """(kind, contents) of each chunk, and where it begins and ends, as the description has it."""
    signature, version = struct.unpack_from("<8sI", content)
    assert (signature, version) == (b"\x89PPB\r\n\x1a\n", 1)
    at, found = 12, []
    while at < len(content):
        kind, number, length, checksum, own = struct.unpack_from("<4sIQII", content, at)
        assert (number, own) == (len(found), crc32(content[at : at + 20]))
        held = content[at + 24 : at + 24 + length]
        assert checksum == crc32(held)
        found.append((kind.decode(), held, at, at + 24 + length))
        at += 24 + length
    return found


def decode(path):
    """(ticks, directions) of each axis, pulse by pulse, in whole numbers of Python's."""
    head, *rest = chunks_of(path.read_bytes())
    axes = [([], []) for _ in json.loads(head[1])["axes"]]
    assert [kind for kind, *_ in rest] == ["PULS"] * (len(rest) - 1) + ["MARK"]
    for _, held, *_ in rest[:-1]:
        begin, _, size = struct.unpack_from("<qqQ", held)
        content, at = decompress(held[24:]), 0
        assert len(content) == size
        for ticks, ways in axes:
            n, width, escapes = struct.unpack_from("<IBI", content, at)
            codes, apart, at = at + 9, at + 9 + n * width, at + 9 + n * width + 8 * escapes
            tick, interval = begin, 0
            for k in range(n):
                code = int.from_bytes(
                    content[codes + k * width : codes + (k + 1) * width], "little"
                )
                if code == 256**width - 1:
                    code = int.from_bytes(content[apart : apart + 8], "little")
                    apart += 8
                interval += code // 2 if code % 2 == 0 else -(code + 1) // 2
                tick += interval
                ticks.append(tick)
                ways.append(-1 if content[at + k // 8] & (128 >> k % 8) else 1)
            at += -(-n // 8)
    return axes


def write_parts(path, schedule, ends, part=3):
    """Write a schedule part by part, each up to a tick."""
    with path.open("wb") as file:
        writer = binary.PulseWriter(file, schedule, part=part)
        last = max([binary.find_end(schedule), *ends])
        for since, until in pairwise([0, *ends, last]):
            writer.add(within(schedule, since, until), until)
        writer.finish(schedule)


def within(schedule, since, until):
    axes = []
    for axis in schedule.axes:
        inside = (axis.ticks >= since) & (axis.ticks < until)
        axes.append(replace(axis, ticks=axis.ticks[inside], direction=axis.direction[inside]))
    return replace(schedule, axes=tuple(axes))


@pytest.fixture(scope="module")
def parted(tmp_path_factory):
    """A file of several parts of several chunks, and its schedule."""
    rng = np.random.default_rng(1)
    axes = [
        list(zip(rng.integers(1, 300, 16), rng.choice([-1, 1], 16), strict=True)) for _ in range(2)
    ]
    path, schedule = tmp_path_factory.mktemp("parted") / "pulses.bin", schedule_of(axes)
    write_parts(path, schedule, [500, 1100, 2000])
    assert len(chunks_of(path.read_bytes())) > 8
    assert is_same(read_pulses(path), schedule)
    return path, schedule


@settings(max_examples=40, derandomize=True, deadline=None)
@given(AXES, st.lists(st.integers(0, 20_000), max_size=4).map(sorted), st.integers(1, 9))
def test_any_schedule_comes_back_however_its_parts_are_added(tmp_path_factory, axes, ends, part):
    schedule, path = schedule_of(axes), tmp_path_factory.mktemp("parts") / "pulses.bin"
    write_parts(path, schedule, ends, part)
    assert is_same(read_pulses(path), schedule)
    assert decode(path) == [
        (axis.ticks.tolist(), axis.direction.tolist()) for axis in schedule.axes
    ]


def test_cut_at_any_byte_it_is_refused(parted, tmp_path):
    content, cut = parted[0].read_bytes(), tmp_path / "cut"
    cut.write_bytes(content)
    for size in reversed(range(len(content))):
        os.truncate(cut, size)
        with pytest.raises(FileError, match="write it again"):
            read_pulses(cut)


def test_with_any_byte_changed_it_is_refused(parted, tmp_path):
    content, damaged = parted[0].read_bytes(), tmp_path / "damaged"
    damaged.write_bytes(content)
    for at, byte in enumerate(content):
        with damaged.open("r+b", buffering=0) as file:
            for place, value in (
                (at - 1, content[at - 1]),
                (at, byte ^ 1 << at % 8),
            ):  # the one before is right again
                file.seek(max(place, 0))
                file.write(bytes([value]))
        with pytest.raises(FileError):
            read_pulses(damaged)


def changed(content, number, change):
    """A file whose chunk of a number has other contents, with a checksum that is right."""
    _, held, begin, end = chunks_of(content)[number]
    new = change(held)
    header = content[begin : begin + 8] + struct.pack("<QI", len(new), crc32(new))
    return content[:begin] + header + struct.pack("<I", crc32(header)) + new + content[end:]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            lambda c: c[:8] + b"\x02" + c[9:],
            "version 2, and this pulsepath reads version 1: read it with the pulsepath",
        ),
        (
            lambda c: changed(c, 0, lambda h: h.replace(b'"schema":1', b'"schema":7')),
            "of schema 7, and this pulsepath",
        ),
        (
            lambda c: changed(c, 0, lambda h: h.replace(b"pulses", b"motion")),
            "'pulsepath motion', not 'pulsepath pulses'",
        ),
        (lambda c: changed(c, 0, lambda _: b"{"), r"chunk 0 \(HEAD\) is no JSON"),
        (
            lambda c: changed(c, 0, lambda h: h.replace(b'"clock_hz"', b'"clock_mhz"')),
            "states no pulse schedule",
        ),
        (
            lambda c: changed(c, 1, lambda h: h[:30] + b"?" + h[31:]),
            r"chunk 1, from byte \d+ and 0 s, holds no pulses",
        ),
        (lambda c: changed(c, 1, lambda h: b"\1" + h[1:]), "its span 1 to"),
        (
            lambda c: changed(c, 2, lambda h: h[:8] + struct.pack("<q", 30) + h[16:]),
            "holds pulses up to tick 30, and says 15000001",
        ),
        (
            lambda c: changed(c, -1, lambda h: h.replace(b'"pulses":[4', b'"pulses":[5')),
            "holds .* pulses",
        ),
        (lambda c: c + b"\0", "cut at byte"),
        (
            lambda c: c[: chunks_of(c)[-1][2]],
            r"is not finished: it ends at byte \d+ without a MARK",
        ),
        (lambda c: said(c, -1, complete=False), "its MARK does not say that it is complete"),
        (
            lambda c: renamed(c, 2, b"puls"),
            "has chunk 2 of kind 'puls', and this pulsepath reads PULS",
        ),
        (lambda c: renamed(c, 1, b"MARK"), "has chunk 1 of kind 'MARK'"),
        (lambda _: b"Time[s], X STEP", "is not a binary file of pulsepath: it begins with b'Time"),
        (lambda _: b"", "is cut at byte 0"),
    ],
)
def test_what_it_cannot_read_is_refused_with_the_place_and_a_remedy(tmp_path, change, told):
    path = tmp_path / "pulses.bin"
    binary.write(schedule_of([[(5, 1), (7, -1), (6, 1), (9, 1)]]), path, part=2)
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(FileError, match=told):
        read_pulses(path)


def renamed(content, number, kind):
    """A file whose chunk of a number is of another kind, with a checksum that is right."""
    begin = chunks_of(content)[number][2]
    header = kind + content[begin + 4 : begin + 20]
    return content[:begin] + header + struct.pack("<I", crc32(header)) + content[begin + 24 :]


def said(content, number, **change):
    """A file whose HEAD or MARK says something else, with a checksum that is right."""
    return changed(content, number, lambda held: json.dumps(json.loads(held) | change).encode())


def sized(content, size, inflated=None):
    """A file whose first chunk of pulses states a size, and inflates to so many zeros."""
    zeros = None if inflated is None else compress(bytes(inflated), 1)
    return changed(
        content,
        1,
        lambda held: held[:16] + struct.pack("<Q", size) + (held[24:] if zeros is None else zeros),
    )


def codes(content, count, width, escapes, room):
    """A file whose first chunk states so many pulses of its axis, in so many bytes."""
    held = struct.pack("<IBI", count, width, escapes) + bytes(room)
    new = struct.pack("<Q", len(held)) + compress(held)
    return changed(said(content, -1, pulses=[1 << 40]), 1, lambda old: old[:16] + new)


def long_chunk(content, length):
    """A file whose first chunk of pulses states a length, with a header that is right."""
    _, _, begin, _ = chunks_of(content)[1]
    header = (
        content[begin : begin + 8] + struct.pack("<Q", length) + content[begin + 16 : begin + 20]
    )
    return content[:begin] + header + struct.pack("<I", crc32(header)) + content[begin + 24 :]


HUGE = 10**400
CRAFTED = {
    "a chunk longer than files are": lambda c: long_chunk(c, (1 << 64) - 1),
    "a chunk of 2^63 bytes": lambda c: long_chunk(c, 1 << 63),
    "a chunk longer than the file": lambda c: long_chunk(c, 1000),
    "a stated size of 2^64 - 1": lambda c: sized(c, (1 << 64) - 1),
    "a stated size of 2^63": lambda c: sized(c, 1 << 63),
    "a stated size of 10^11": lambda c: sized(c, 10**11),
    "a bomb of stated size 0": lambda c: sized(c, 0, 1 << 27),
    "a bomb of its stated size": lambda c: sized(c, 1 << 27, 1 << 27),
    "a bomb that the mark allows": lambda c: said(sized(c, 1 << 27, 1 << 27), -1, pulses=[10**11]),
    "more pulses than bytes": lambda c: codes(c, (1 << 32) - 1, 1, 0, 100),
    "more pulses apart than pulses": lambda c: codes(c, 4, 1, (1 << 32) - 1, 100),
    "more pulses than a chunk may have": lambda c: codes(
        c, (1 << 20) + 1, 1, 0, (1 << 20) + 1 + (1 << 17) + 1
    ),
    "10^11 pulses of a thousand axes": lambda c: said(
        said(c, -1, pulses=[10**11] * 1000, final=[0] * 1000, bound=[0.5] * 1000),
        0,
        axes=[
            {"name": f"x{k}", "start": 0, "pulse": 1e-6, "home": 0.0, "unit": "m"}
            for k in range(1000)
        ],
    ),
    "10^11 pulses": lambda c: said(c, -1, pulses=[10**11]),
    "2^64 pulses": lambda c: said(c, -1, pulses=[1 << 64]),
    "fewer pulses than there are": lambda c: said(c, -1, pulses=[1]),
    "no number of pulses": lambda c: said(c, -1, pulses=[-4]),
    "infinitely many pulses": lambda c: said(c, -1, pulses=[float("inf")]),
    "pulses in words": lambda c: said(c, -1, pulses=["4"]),
    "pulses of another number of axes": lambda c: said(c, -1, pulses=[4, 4]),
    "an infinite final count": lambda c: said(c, -1, final=[float("-inf")]),
    "a final count of 10^400": lambda c: said(c, -1, final=[HUGE]),
    "a duration of infinity": lambda c: said(c, -1, duration=float("inf")),
    "a duration of 10^400": lambda c: said(c, -1, duration=HUGE),
    "a duration of 10^300 s": lambda c: said(c, -1, duration=1e300),
    "a duration before the start": lambda c: said(c, -1, duration=-1.0),
    "a duration in words": lambda c: said(c, -1, duration="1.5"),
    "an end that is no tick": lambda c: said(c, -1, until="15000001"),
    "an end beyond 64 bits": lambda c: said(c, -1, until=HUGE),
    "a bound that is no number": lambda c: said(c, -1, bound=[float("nan")]),
    "a bound in words": lambda c: said(c, -1, bound=[[0.5]]),
    "moves of an infinite number": lambda c: said(
        c,
        -1,
        moves=[{"axis": "x", "pulses": float("inf"), "time": 0, "error": 0, "t": 0, "length": 0}],
    ),
    "a move of text": lambda c: said(c, -1, moves=["x"]),
    "a compensation of 10^400": lambda c: said(
        c, -1, compensations=[{"axis": "x", "kinds": [], "windows": [[0, HUGE]]}]
    ),
    "a compensation without an end": lambda c: said(
        c, -1, compensations=[{"axis": "x", "kinds": [], "windows": [], "off": float("inf")}]
    ),
    "a clock of infinity": lambda c: said(c, 0, clock_hz=float("inf")),
    "a clock of 10^400": lambda c: said(c, 0, clock_hz=HUGE),
    "a clock of half a tick": lambda c: said(c, 0, clock_hz=0.5),
    "a clock that stands": lambda c: said(c, 0, clock_hz=0),
    "a start beyond 64 bits": lambda c: said(
        c, 0, axes=[{"name": "x", "start": 1 << 64, "pulse": 1e-6, "home": 0.0, "unit": "m"}]
    ),
    "a pulse that is no number": lambda c: said(
        c, 0, axes=[{"name": "x", "start": 0, "pulse": float("nan"), "home": 0.0, "unit": "m"}]
    ),
    "a deep head": lambda c: changed(c, 0, lambda _: b"[" * 100_000),
    "a deep mark": lambda c: changed(c, -1, lambda _: b'{"a":' * 100_000),
    "a number of many digits": lambda c: changed(
        c, -1, lambda _: b'{"until":' + b"9" * 10_000 + b"}"
    ),
}


@pytest.mark.parametrize("make", CRAFTED.values(), ids=CRAFTED)
def test_a_crafted_file_is_refused_in_little_memory(tmp_path, make):
    """Whoever passes a file on may have written anything into it, with checksums that are right."""
    path = tmp_path / "pulses.bin"
    binary.write(schedule_of([[(5, 1), (7, -1), (6, 1), (9, 1)]]), path)
    path.write_bytes(make(path.read_bytes()))
    tracemalloc.start()
    try:
        with pytest.raises(FileError) as refused:
            read_pulses(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(str(refused.value)) < 1000
    assert peak < 64e6


def test_parts_have_at_most_a_million_pulses_of_an_axis(tmp_path):
    schedule = schedule_of([[(5, 1)]])
    with pytest.raises(MotionError, match="parts of 1048577 pulses: give 1 to 1048576"):
        binary.write(schedule, tmp_path / "p", part=(1 << 20) + 1)


def test_a_file_of_more_pulses_than_there_is_room_for_at_first_is_read_whole(tmp_path):
    ticks = 250 * np.arange(1, 2_500_001)  # at one rate they take next to no room in the file
    axis = AxisPulses("x", ticks, np.ones(len(ticks), np.int8), 0, PULSE, 0.0)
    schedule = PulseSchedule(10_000_000, (axis,), float(ticks[-1] / 1e7))
    binary.write(schedule, tmp_path / "p", part=1 << 20)
    assert 8 * (tmp_path / "p").stat().st_size < len(ticks)
    assert is_same(read_pulses(tmp_path / "p"), schedule)


@pytest.mark.parametrize(
    ("axes", "until", "told"),
    [
        ([([5, 5], [1, 1])], 100, "its ticks do not rise"),
        ([([5, 6], [1, 0])], 100, r"neither \+1 nor -1"),
        ([([5, 60], [1, 1])], 60, "not from 0 to before 60"),
        ([([-5, 60], [1, 1])], 100, "not from 0 to before 100"),
        ([([], [])], -1, "are said to end at -1"),
    ],
)
def test_pulses_that_are_no_schedules_are_not_written(tmp_path, axes, until, told):
    made = tuple(
        AxisPulses("x", np.array(t, np.int64), np.array(d, np.int8), 0, 1.0, 0.0) for t, d in axes
    )
    schedule = PulseSchedule(10, made, 10.0)
    with (tmp_path / "p").open("wb") as file, pytest.raises(MotionError, match=told):
        binary.PulseWriter(file, schedule).add(schedule, until)
    with (tmp_path / "p").open("wb") as file, pytest.raises(MotionError, match="parts of 0 pulses"):
        binary.PulseWriter(file, schedule, part=0)


def test_the_check_of_a_file_proves_what_is_in_it(three_legs, tmp_path):
    path, told = tmp_path / "pulses.bin", []
    binary.write(three_legs.pulses, path, {"leg0": "m"}, part=200)
    found = check_file(path, three_legs, lambda done, of: told.append((done, of)))
    assert found.holds
    assert told[-1][0] == told[-1][1] == len(told) > 3
    # bytes, headers and all; ticks and directions have nine a pulse
    assert path.stat().st_size < 2 * three_legs.pulses.total
    exported = binary.Binary().write(
        SimpleNamespace(machine=three_legs.machine, pulses=three_legs.pulses, tell=lambda *_: None),
        path,
    )
    assert (exported.error, exported.moves) == (0.0, three_legs.pulses.total)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"ticks": lambda axis: axis.ticks + (np.arange(len(axis)) == 500)}, "off its crossing"),
        ({"direction": lambda axis: -axis.direction}, "against the motion"),
        ({"bound": lambda _: 0.7}, "bound: the file states 0.7, and the plan 0.5"),
        ({"start": lambda axis: axis.start + 1}, "start: the file states"),
        ({"pulse": lambda axis: axis.pulse * 2}, "pulse: the file states"),
    ],
)
def test_the_check_of_a_file_finds_what_is_wrong_in_it(three_legs, tmp_path, change, told):
    (name, make), path = *change.items(), tmp_path / "pulses.bin"
    axes = list(three_legs.pulses.axes)
    axes[1] = replace(axes[1], **{name: make(axes[1])})
    binary.write(replace(three_legs.pulses, axes=tuple(axes)), path)
    found = check_file(path, three_legs)
    assert not found.holds
    assert any(fault.axis == "leg1" and told in fault.what for fault in found.faults)


def test_neither_is_a_file_of_other_axes_another_rule_or_clock_taken(three_legs, tmp_path):
    path = tmp_path / "pulses.bin"
    binary.write(replace(three_legs.pulses, axes=three_legs.pulses.axes[:2]), path)
    with pytest.raises(FileError, match=r"axes: .* should be"):
        check_file(path, three_legs)
    for change in (
        {"rule": "floor"},
        {"clock_hz": 5_000_000},
        {"duration": three_legs.pulses.duration + 1e-9},
    ):
        binary.write(replace(three_legs.pulses, **change), path)
        assert any(
            next(iter(change)) in fault.what for fault in check_file(path, three_legs).faults
        )


def test_writing_and_reading_parts_takes_no_memory_for_the_pulses_before(tmp_path):
    """Four times the pulses take the same: the growth allowed is a tenth of what their ticks alone
    would take.
    """
    peaks, path, part = [], tmp_path / "p.bin", 1 << 12
    for parts in (10, 40):
        none = AxisPulses("x", np.empty(0, np.int64), np.empty(0, np.int8), 0, PULSE, 0.0)
        stated = PulseSchedule(10_000_000, (none,), parts * part * 1e-5)
        tracemalloc.start()
        with path.open("wb") as file:
            writer = binary.PulseWriter(file, stated)
            for k in range(parts):
                made = replace(
                    none,
                    ticks=100 * np.arange(k * part, (k + 1) * part),
                    direction=np.ones(part, np.int8),
                )
                writer.add(replace(stated, axes=(made,)), 100 * (k + 1) * part)
            writer.finish(stated)
        assert sum(each.total for each in open_pulses(path).parts()) == parts * part
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] - peaks[0] < 0.1 * 8 * 30 * part
