"""The command `hold`: a stop, the way on, a table of stops; whole files or none."""

import json
import re
from itertools import pairwise

import numpy as np
import pytest

import pulsepath as pp
from kinematics import MotionError
from planner.export.format import FORMATS, find_format, takes_stop
from pulsepath import load_plan, read_pulses
from tests import read_lines


def test_a_stop_and_the_way_on_in_files(call, plan, job):
    made, rest = plan / "stop.csv", plan / "rest.csv"
    at = 0.725  # no STEP is high there, which a file of levels could not begin with
    at_tick = round(at * job.plan.pulses.clock_hz)
    done = call(
        "hold",
        plan,
        "--at",
        f"{at} s",
        "--format",
        "pulses",
        "--out",
        made,
        "--resume",
        rest,
        "--json",
    )
    assert done.exit_code == 0, done.stderr
    told, pulses = json.loads(done.stdout), job.plan.pulses
    assert told["certified"]
    assert told["verified"]
    assert told["held_at_s"] == pytest.approx(at)
    machine = job.plan.machine
    stop, onward = (
        read_lines.read(str(f), pulses.clock_hz, machine.axes, machine.home_q).schedule
        for f in (made, rest)
    )
    for before, own, after in zip(pulses.axes, stop.axes, onward.axes, strict=True):
        assert (
            before.counts([at_tick - 1])[0] + own.direction.sum() + after.direction.sum()
            == before.final
        )


def test_an_instant_is_a_time_or_a_share_and_0_is_both(call, corner):
    """Of the motion's beginning either says the same; of a plain number both are proposed."""
    plan, loaded = corner, load_plan(corner)
    said = [call("hold", plan, "--at", text) for text in ("0 s", "0 %")]
    assert [done.exit_code for done in said] == [0, 0]
    assert said[0].stdout == said[1].stdout
    assert "from 0.000000 s on" in said[1].stdout
    at = json.loads(call("hold", plan, "--at", "40 %", "--json").stdout)["held_at_s"]
    assert at == pytest.approx(0.4 * loaded.duration, abs=1 / loaded.pulses.clock_hz)
    late = call("hold", plan, "--at", "101 %")
    assert late.exit_code == 2
    assert "is not within the motion" in late.stderr
    done = call("hold", plan, "--at", "40")
    assert done.exit_code == 2
    assert 'write "40 s", or "40 %" of the motion' in done.stderr
    assert "write a share in per cent" in call("hold", plan, "--at", "-1 %").stderr


def test_files_of_a_stop_say_what_exports_say(call, corner, tmp_path):
    """For a board: how many commands each axis has, and how far a pulse may be off."""
    done = call(
        *("hold", corner, "--at", "0.1 s", "--within", "1 us"),
        *("--format", "steps", "--out", tmp_path / "stop.bin"),
    )
    assert done.exit_code == 0, done.stderr
    said = done.stdout.splitlines()
    exported = call(
        *("export", corner, "--format", "steps", "--within", "1 us"),
        *("--out", tmp_path / "all.bin"),
    )
    whole = exported.stdout.splitlines()
    own = said[next(n for n, line in enumerate(said) if "stop.bin: error" in line) + 1 :]
    assert len(own) == len(whole) - 1 >= 2
    for mine, theirs in zip(own, whole[1:], strict=True):
        assert mine.startswith("  ")
        assert re.sub(r"[\d.]+", "#", mine) == re.sub(r"[\d.]+", "#", theirs)
    assert any("a pulse is off by up to 1 us" in line for line in own)


def test_a_loaded_plan_is_held_and_exported_as_a_fresh_one(corner, tmp_path):
    taken = load_plan(corner)
    fresh = pp.plan(pp.import_program(corner.parent / "corner.nc").program, "corexy", order=2)
    named = f"<Plan {fresh.program.name} on {fresh.machine.name}: {fresh.duration:.6g} s, order {fresh.order}, proved, "
    assert repr(taken) == f"{named}nearest pulses at {fresh.pulses.clock_hz} Hz>"
    stop, other = taken.hold(0.1), fresh.hold(0.1)
    assert stop.certificate.holds
    assert stop.duration == pytest.approx(other.duration, rel=1e-9)
    assert taken.resume(stop).since == stop.until
    assert taken.resume(stop, 0.5).duration == pytest.approx(
        fresh.resume(other, 0.5).duration, rel=1e-9
    )
    files = [tmp_path / "taken.bin", tmp_path / "fresh.bin"]
    for each, file in zip((taken, fresh), files, strict=True):
        each.export("steps", file)
    assert files[0].read_bytes() == files[1].read_bytes()
    with pytest.raises(MotionError, match="expected a number in s"):
        taken.hold("0.1 s")


@pytest.mark.parametrize("parts", [False, True])
def test_at_every_rest_of_a_plan_on_disk_the_stop_is_empty(call, tmp_path, parts):
    """Of one that was planned as a whole, and of one in parts: at both ends, at a corner and in a
    dwell.
    """
    program, out = tmp_path / "corners.nc", tmp_path / "out"
    program.write_text("G21 G90 F1200\nG1 X5 Y5\nX10 Y0\nG4 P0.1\nX20 Y3\n", encoding="utf-8")
    way = "--stream" if parts else "--whole"
    asked = (
        "plan",
        program,
        "--machine",
        "corexy",
        "--order",
        "2",
        "--no-figures",
        way,
        "--out",
        out,
    )
    assert call(*asked).exit_code == 0
    taken = load_plan(out)
    motion = taken.trajectory
    still = np.flatnonzero(motion.v <= 1e-12 * motion.v.max())
    rests = sorted({0.0, motion.duration, *motion.knots[still].tolist()})
    inside = [
        (low + high) / 2 for low, high in pairwise(rests) if motion.at((low + high) / 2).sd[0] == 0
    ]
    assert len(rests) >= 5
    assert len(inside) == 1
    for at in (*rests, *inside):
        stop = taken.hold(at)
        assert stop.certificate.holds
        assert (stop.duration, stop.distance, stop.pulses.total) == (0, 0, 0)
    for at in ("0 s", "100 %", f"{inside[0]} s"):
        stop, rest = tmp_path / "stop.bin", tmp_path / "rest.bin"
        onward = ("--resume", rest) if at != "100 %" else ()
        asked = (
            "hold",
            out,
            "--at",
            at,
            "--format",
            "binary",
            "--out",
            stop,
            *onward,
            "--force",
            "--json",
        )
        done = call(*asked)
        assert done.exit_code == 0, done.stderr
        told = json.loads(done.stdout)
        assert (told["duration_s"], told["distance_m"], told["certified"]) == (0, 0, True)
        assert read_pulses(stop).total == 0
        if onward:
            ends = [
                [axis.final for axis in pulses.axes] for pulses in (read_pulses(rest), taken.pulses)
            ]
            assert ends[0] == ends[1]


def test_the_way_on_at_a_share_of_the_speed(call, corner, tmp_path):
    made, rest = tmp_path / "stop.bin", tmp_path / "rest.bin"
    given = (
        "hold",
        corner,
        "--at",
        "0.1 s",
        "--format",
        "steps",
        "--out",
        made,
        "--resume",
        rest,
        "--json",
    )
    fast = json.loads(call(*given).stdout)["resumed_s"]
    slow = json.loads(call(*given, "--speed", "50 %", "--force").stdout)["resumed_s"]
    assert slow == pytest.approx(2 * fast, rel=0.1)
    assert 'up to "100 %"' in call(*given, "--speed", "120 %", "--force").stderr
    assert "per cent" in call(*given, "--speed", "0.5", "--force").stderr
    assert "give --resume FILE" in call("hold", corner, "--at", "0.1 s", "--speed", "50 %").stderr


def test_triggers_fire_in_the_stop_or_behind_it(call, tmp_path):
    program, out = tmp_path / "marked.nc", tmp_path / "out"
    program.write_text("G21 G90\nG1 X10 Y5 F1200\nM5\nG1 X20 Y20\nM30\n")
    assert (
        call(
            "plan", program, "--machine", "corexy", "--out", out, "--no-figures", "--order", "2"
        ).exit_code
        == 0
    )
    given = (
        "hold",
        out,
        "--at",
        "0.2 s",
        "--format",
        "steps",
        "--out",
        out / "stop.bin",
        "--resume",
        out / "rest.bin",
    )
    told = json.loads(call(*given, "--json").stdout)
    assert [event["name"] for event in told["resumed_triggers"]] == ["M5"]
    assert told["triggers"] == []
    planned = json.loads((out / "plan.json").read_text())["triggers"][0]
    assert told["resumed_triggers"][0]["where"]["distance_m"] == planned["where"]["distance_m"]
    again = call(*given)
    assert "stop.bin exists; give --force to replace it" in again.stderr
    assert "certifying" not in again.stderr


def test_a_table_of_stops(call, corner, tmp_path):
    done = call("hold", corner, "--stops", "2", "--out", tmp_path / "stops.csv")
    assert done.exit_code == 0, done.stderr
    assert "distance to rest" in done.stdout
    assert 3 <= len((tmp_path / "stops.csv").read_text().splitlines()) <= 5


def test_help_lists_the_formats_that_can_hold_a_stop(call, corner, tmp_path):
    """Every format refuses a motion that starts at speed, or is offered: as its own declaration
    says.
    """
    told = call("hold", "--help").stdout
    whole = load_plan(corner)
    held = whole.hold(0.3 * whole.duration)
    for name in FORMATS:
        try:
            held.export(name, tmp_path / name)
            refused = ""
        except MotionError as no:
            refused = str(no)
        offered = any(
            line.split()[:1] == [name] for line in told.partition("Formats:")[2].splitlines()
        )
        assert offered is takes_stop(find_format(name))
        if offered:
            assert "at rest" not in refused
        else:
            assert (
                "starts and ends at rest" in refused
                or "has no card" in refused
                or "capital letter" in refused
            )
    assert "g93" not in told
    assert "g93" in call("export", "--help").stdout


def test_a_plan_with_its_stops(call, tmp_path):
    out = tmp_path / "out"
    program = tmp_path / "corner.nc"
    program.write_text("G21 G90 F1200\nG1 X5 Y5\nX10 Y0\n", encoding="utf-8")
    asked = ("plan", program, "--machine", "corexy", "--order", "2", "--no-figures", "--whole")
    done = call(*asked, "--stops", "3", "--out", out)
    assert done.exit_code == 0, done.stderr
    assert "where they are likely to be longest" in done.stdout
    told = json.loads((out / "plan.json").read_text())["stops"]
    rows = [line.split(",") for line in (out / "stops.csv").read_text().splitlines()[1:]]
    assert 3 <= told["instants"] == len(rows) <= 6
    assert told["longest_time_to_rest_s"] == max(float(row[2]) for row in rows)
    assert "How soon it can be stopped" in (out / "report.html").read_text()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([], "--at TIME, or --stops"),
        (["--at", "99 s"], "give an instant of it"),
        (
            ["--at", "100 %", "--format", "steps", "--out", "x", "--resume", "y"],
            "nothing to resume",
        ),
        (
            ["--at", "99 %", "--format", "steps", "--out", "x", "--resume", "y"],
            "nothing to resume",
        ),
        (["--at", "1 s", "--out", "x.bin"], "give --format"),
        (["--at", "1 s", "--format", "steps"], "--out FILE"),
        (["--at", "1 s", "--format", "steps", "--out", "x", "--resume", "x"], "the same file"),
        (["--at", "1 s", "--stops", "3"], "--at TIME, or --stops"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(call, corner, tmp_path, monkeypatch, given, words):
    monkeypatch.chdir(tmp_path)
    done = call("hold", corner, *given)
    assert done.exit_code == 2
    assert words in done.stderr
    assert not list(tmp_path.iterdir())
