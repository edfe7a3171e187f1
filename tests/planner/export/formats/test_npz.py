"""The schedule in parts: opened by numpy alone, joined tick for tick, counts continued from part to
part.
"""

import json
from itertools import pairwise
from types import SimpleNamespace
from zipfile import ZipFile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import FileError, MotionError
from planner import PulseSchedule
from planner.export.formats import npz
from planner.pulses import AxisPulses

AXES = st.lists(
    st.lists(st.tuples(st.integers(1, 1 << 40), st.sampled_from([-1, 1])), max_size=40),
    min_size=1,
    max_size=4,
)


def schedule_of(axes):
    made = []
    for k, pulses in enumerate(axes):
        ticks = np.cumsum([gap for gap, _ in pulses], dtype=np.int64)
        signs = np.array([sign for _, sign in pulses], np.int8)
        made.append(AxisPulses(f"leg/{k} ä", ticks, signs, 3 - k, 0.75e-6, 0.2 + k, 0.5 + k / 8))
    return PulseSchedule(10_000_000, tuple(made), 1.5, "floor")


def assert_same(one, other):
    assert (one.clock_hz, one.duration, one.rule) == (other.clock_hz, other.duration, other.rule)
    for a, b in zip(one.axes, other.axes, strict=True):
        assert (a.name, a.start, a.pulse, a.home, a.bound) == (
            b.name,
            b.start,
            b.pulse,
            b.home,
            b.bound,
        )
        assert np.array_equal(a.ticks, b.ticks)
        assert np.array_equal(a.direction, b.direction)


@settings(max_examples=60, derandomize=True, deadline=None)
@given(AXES, st.integers(1, 50))
def test_any_schedule_comes_back_from_parts_of_any_size(tmp_path_factory, axes, part):
    schedule, path = schedule_of(axes), tmp_path_factory.mktemp("npz") / "pulses.npz"
    npz.write(schedule, path, part)
    assert_same(npz.read(path), schedule)
    parts = list(npz.parts(path))
    assert max(len(axis) for each in parts for axis in each.axes) <= part
    assert [axis.start for axis in parts[0].axes] == [axis.start for axis in schedule.axes]
    for before, after in pairwise(parts):
        assert [axis.final for axis in before.axes] == [axis.start for axis in after.axes]
        latest = max(int(axis.ticks[-1]) for axis in before.axes if len(axis))
        assert all(
            axis.ticks[0] > latest for axis in after.axes if len(axis)
        )  # parts do not overlap in time


def test_numpy_alone_reads_it(tmp_path):
    schedule = schedule_of([[(5, 1), (7, -1), (1, 1)], [(100, 1)]])
    npz.write(schedule, tmp_path / "pulses.npz", 2)
    with np.load(tmp_path / "pulses.npz", allow_pickle=False) as held:
        index = json.loads(held["schedule.json"])
        ticks = [held[f"{n:06d}/axis1.ticks"] for n in range(index["parts"])]
        ways = [held[f"{n:06d}/axis1.direction"] for n in range(index["parts"])]
        assert (held["000000/axis2.ticks"].tolist(), held["000001/axis2.ticks"].tolist()) == (
            [],
            [100],
        )
    assert np.concatenate(ticks).tolist() == [5, 12, 13]
    assert np.concatenate(ways).tolist() == [1, -1, 1]
    assert (index["clock_hz"], index["pulses"], index["axes"][1]["pulses"]) == (10_000_000, 4, 1)


def test_the_same_schedule_gives_the_same_bytes(tmp_path):
    for name in "ab":
        npz.write(schedule_of([[(5, 1), (7, -1)]]), tmp_path / name, 1)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_the_format_tells_how_far_it_is_and_finds_its_own_error(tmp_path, monkeypatch):
    schedule, told = schedule_of([[(5, 1), (7, -1), (1, 1)], []]), []
    source = SimpleNamespace(pulses=schedule, tell=lambda done, of: told.append((done, of)))
    assert npz.Npz(part=2).write(source, tmp_path / "pulses.npz").error == 0
    assert told == [(1, 2), (2, 2)]
    late = schedule_of([[(5, 1), (7, -1), (2, 1)], []])
    for other in (
        late,
        schedule_of([[(5, 1), (7, -1)], []]),
        schedule_of([[(5, 1), (7, 1), (1, 1)], []]),
    ):
        monkeypatch.setattr(npz, "parts", lambda _, other=other: [other])
        assert npz.Npz().write(source, tmp_path / "pulses.npz").error == np.inf


def test_a_file_that_is_not_whole_is_refused(tmp_path):
    path = tmp_path / "pulses.npz"
    npz.write(schedule_of([[(5, 1), (7, -1), (1, 1)]]), path, 2)
    content = path.read_bytes()
    path.write_bytes(content[:-30])
    with pytest.raises(FileError, match="not all of it"):
        npz.read(path)
    with ZipFile(path, "w") as archive:
        archive.writestr("schedule.json", '{"schema": 1}')
    with pytest.raises(FileError, match="not all of it"):
        npz.read(path)
    np.savez(path, ticks=np.arange(3))
    with pytest.raises(FileError, match=r"schedule\.json"):
        npz.read(path)
    middle = content.index(b"000001/axis1.ticks")
    path.write_bytes(content[:middle] + content[middle:].replace(b"<i8", b"<f8"))
    with pytest.raises(FileError):
        npz.read(path)


def test_parts_without_pulses_are_refused(tmp_path):
    with pytest.raises(MotionError, match="parts of 0 pulses"):
        npz.write(schedule_of([[]]), tmp_path / "pulses.npz", 0)
