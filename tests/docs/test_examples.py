"""The programs of docs/examples that read our files without us, against files of their own."""

import re
import subprocess
import sys
from runpy import run_path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import Axis
from planner import PulseSchedule
from planner.export.format import find_format
from planner.export.formats import binary, pulse_csv
from planner.pulses import AxisPulses
from tests.docs.pages import DOCS

CLOCK = 10_000_000
HIGH = 20
GAPS = st.one_of(st.integers(HIGH + 1, 300), st.integers(HIGH + 1, 1 << 40))
AXES = st.lists(
    st.lists(st.tuples(GAPS, st.sampled_from([-1, 1])), max_size=40), min_size=1, max_size=4
)


def schedule_of(axes):
    made = []
    for k, pulses in enumerate(axes):
        ticks = np.cumsum([gap for gap, _ in pulses], dtype=np.int64)
        made.append(
            AxisPulses(
                f"leg{k}", ticks, np.array([sign for _, sign in pulses], np.int8), 0, 1e-6, 0.0
            )
        )
    return PulseSchedule(CLOCK, tuple(made), 1.0)


def run(name, *arguments):
    command = [sys.executable, DOCS / "examples" / name, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def edges():
    return run_path(str(DOCS / "examples" / "pulse_edges.py"))


@settings(max_examples=40, derandomize=True, deadline=None)
@given(AXES, st.integers(1, 50), st.data())
def test_edges_of_a_file_of_pulses_are_those_of_the_pulse_csv(
    edges, tmp_path_factory, axes, part, data
):
    schedule, path = schedule_of(axes), tmp_path_factory.mktemp("edges") / "pulses.bin"
    wiring = [data.draw(st.sampled_from([-1, 1])) for _ in axes]
    binary.write(schedule, path, part=part)
    head, held = edges["read_pulses"](path)
    assert head["clock_hz"] == CLOCK
    for (ticks, directions), axis in zip(held, schedule.axes, strict=True):
        assert np.array_equal(ticks, axis.ticks)
        assert np.array_equal(directions, axis.direction)
    if not schedule.total or max(len(axis) for axis in schedule.axes) < 2:
        return
    instants, words = edges["find_edges"](held, wiring, HIGH)
    rows = list(pulse_csv.edge_rows(schedule, wiring, HIGH))
    assert np.array_equal(instants, np.concatenate([ticks for ticks, _ in rows]))
    levels = np.concatenate([levels for _, levels in rows]).astype(np.uint64)
    assert np.array_equal(words, (levels << np.arange(levels.shape[1], dtype=np.uint64)).sum(1))


def test_a_damaged_or_unfinished_file_of_pulses_is_refused(tmp_path):
    path = tmp_path / "pulses.bin"
    binary.write(schedule_of([[(100, 1)] * 2000]), path, part=100)
    content = path.read_bytes()
    asked = (path, tmp_path / "edges.bin", "--wiring=1")
    assert run("pulse_edges.py", *asked).returncode == 0
    middle = len(content) // 2
    path.write_bytes(content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :])
    assert "is damaged at byte" in run("pulse_edges.py", *asked).stderr
    path.write_bytes(content[: content.rindex(b"MARK")])
    assert "its end is missing" in run("pulse_edges.py", *asked).stderr
    path.write_bytes(b"PK" + content)
    assert "is no file of pulses" in run("pulse_edges.py", *asked).stderr
    path.write_bytes(content)
    assert "STEP high for 100 ticks" in run("pulse_edges.py", *asked, "--high", "1e-5").stderr
    assert not run("pulse_edges.py", *asked, "--high", "1e-6").returncode


@pytest.fixture
def planned(tmp_path):
    """A dump of two axes, the second wired the other way."""
    schedule = schedule_of([[(100, 1)] * 50 + [(500, -1)] * 20, [(130, -1)] * 40])
    axes = tuple(
        Axis(axis.name, pulse=1e-6, direction=sign)
        for axis, sign in zip(schedule.axes, (1, -1), strict=True)
    )
    source = SimpleNamespace(
        pulses=schedule,
        name="made up",
        machine=SimpleNamespace(axes=axes),
        goes_on=False,
        sent=(),
        triggers=(),
    )
    find_format("vcd")().write(source, tmp_path / "planned.vcd")
    return tmp_path / "planned.vcd"


def record(planned, path, *, lost=None, turned=False, delay=0):
    """As an analyser saves it: in units of 10 ns, from another time on; a pulse lost, or DIR the
    other way round.
    """
    text, seen = planned.read_text(), 0
    head, _, body = text.partition("$enddefinitions")
    rows = []
    for row in body.split("\n")[1:]:
        if row.startswith("#"):
            row = f"#{round(int(row[1:]) / 10) + delay}"
        elif row == "1!":
            seen += 1
            if seen == lost:
                continue
        elif row[1:] == '"' and turned:
            row = f"{1 - int(row[0])}{row[1:]}"
        rows.append(row)
    path.write_text(head.replace("1 ns", "10ns") + "$enddefinitions $end\n" + "\n".join(rows))
    return path


def test_a_recording_is_compared_with_the_plan(planned, tmp_path):
    done = run("compare_vcd.py", planned, record(planned, tmp_path / "good.vcd", delay=12345))
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == [
        "leg0: 70 pulses, 70 recorded, 0 of the other direction, at most 0 ns off",
        "leg1: 40 pulses, 40 recorded, 0 of the other direction, at most 0 ns off",
    ]
    done = run("compare_vcd.py", planned, record(planned, tmp_path / "turned.vcd", turned=True))
    assert done.returncode == 1
    assert "leg0: 70 pulses, 70 recorded, 70 of the other direction" in done.stdout
    done = run("compare_vcd.py", planned, record(planned, tmp_path / "lost.vcd", lost=31))
    assert done.returncode == 1
    told = re.search(
        r"leg0: 70 pulses, 69 recorded; pulse (\d+) is the first that differs, (\S+) s", done.stdout
    )
    assert int(told[1]) == 31
    assert float(told[2]) == pytest.approx(30 * 100 / CLOCK)
    planned.with_name("unnamed.vcd").write_text(planned.read_text().replace("leg1", "D1"))
    done = run("compare_vcd.py", planned, planned.with_name("unnamed.vcd"))
    assert "has no lines leg1_STEP and leg1_DIR" in done.stderr
