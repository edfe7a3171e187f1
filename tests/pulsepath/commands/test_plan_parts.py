"""`plan --stream`: a program planned part by part, its folder taken up by the other commands, ended
or whole.
"""

import csv
import errno
import json
import re
from dataclasses import replace
from fractions import Fraction
from shutil import copytree
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.evidence.workpieces import spiral
from kinematics import load_machine
from planner.certificate import certify
from planner.export.motion_file import (
    MotionWriter,
    follow_motion,
    join_parts,
    motion_parts,
    read_motion,
)
from planner.export.plan_files import tabulate_trigger_csv
from planner.path.actuation import actuate
from planner.path.chain import walk_path
from planner.sources.source import import_program
from pulsepath import load_plan, progress
from pulsepath.store.verify import seal_record
from tests.windows import small_windows

LINES, PIECES = 48, 2
"""In four windows."""
FAR = "G1 X500 Y0"


def code(*more, lines=LINES):
    """A spiral that is soon reached from home."""
    return "\n".join([*spiral(lines), *more, ""]).replace("Z25", "Z8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("parts")


@pytest.fixture(scope="module")
def planned(call, folder):
    file = folder / "spiral.nc"
    file.write_text(code())
    with small_windows(PIECES):
        done = call(
            "plan",
            file,
            "--machine",
            "hexapod",
            "--stream",
            "--order",
            "2",
            "--out",
            folder / "plan",
            "--json",
        )
    assert done.exit_code == 0, done.stderr
    return json.loads(done.stdout)


def test_the_record_says_what_was_proved(planned):
    assert planned["windows"] > 3
    assert planned["ends_before"] is None
    assert planned["certificate"]["holds"]
    assert all(limit["worst_ratio"] <= 1 for limit in planned["certificate"]["limits"].values())
    assert planned["fit"]["deviation_m"] <= 2e-5
    assert planned["pulses"]["check"]["holds"]


def test_results_about_the_whole_motion_are_those_of_later_commands(call, tmp_path):
    """Bound, worth, stops, cross-check and tracking, on request, as from the plan when it is
    loaded.
    """
    file, plain, out = (tmp_path / name for name in ("short.nc", "plain", "examined"))
    file.write_text(code(lines=12))
    asked = ("plan", file, "--machine", "hexapod", "--stream", "--order", "2", "--no-figures")
    more = ("--worth", "--stops", "2", "--cross-check", "--rig", "hexapod-steppers")
    with small_windows(1):
        done = [
            call(*asked, "--json", "--out", plain),
            call(*asked, "--json", "--out", out, *more),
        ]
    assert [each.exit_code for each in done] == [0, 0], done[1].stderr
    planned, record = (json.loads(each.stdout) for each in done)
    assert record["windows"] == planned["windows"] > 1
    assert record["pulses"]["sha256"] == planned["pulses"]["sha256"]

    loaded = load_plan(plain)
    assert record["lower_bound"]["duration_s"] == pytest.approx(loaded.lower_bound, rel=1e-9)
    saved = {(one["limit"], one["axis"]): one["saved_s"] for one in record["worth"]["limits"]}
    worth = loaded.worth
    assert saved == pytest.approx(
        dict(zip(zip(worth.limits, worth.axes, strict=True), worth.saved, strict=True)),
        rel=1e-6,
        abs=1e-9,
    )
    stops = loaded.stops(2)
    assert record["stops"]["longest_time_to_rest_s"] == pytest.approx(stops.time.max())
    assert record["cross_check"]["pulsepath"]["duration_s"] == pytest.approx(
        loaded.duration, rel=1e-3
    )
    tracked = call("track", plain, "--rig", "hexapod-steppers", "--json")
    assert json.loads(tracked.stdout)["laws"] == record["tracking"]["laws"]
    page = (out / "report.html").read_text(encoding="utf-8")
    for section in ("worth", "stops", "cross-check", "tracking", "realised"):
        assert f'id="{section}"' in page


def test_other_commands_take_it_up(call, folder, planned):
    for name in ("steps", "binary", "ros"):
        done = call(
            "export", folder / "plan", "--format", name, "--out", folder / f"f.{name}", "--json"
        )
        assert done.exit_code == 0, done.stderr
        assert json.loads(done.stdout)["error_pulses"] < 1
    checked = call("check", folder / "plan", "--json")
    assert checked.exit_code == 0, checked.stderr
    told = json.loads(checked.stdout)
    assert (told["duration_s"], told["pulses"]) == (
        planned["duration_s"],
        planned["pulses"]["total"],
    )
    taken = load_plan(folder / "plan")
    assert taken.trajectory.duration == planned["duration_s"]
    assert taken.pulses.total == planned["pulses"]["total"]


def test_the_page_shows_it_and_loads_nothing(folder, planned):
    text = (folder / "plan" / "report.html").read_text()
    own = re.sub(
        r'base64,[\w+/=]+|"[\w+/=]{40,}"|/\*! .*? \*/', "", text
    )  # but images, data and uPlot's licence
    assert not re.search(r"https?:|//\w|@import|url\(|fetch\(|XMLHttp|import\(", own)
    assert text.count("data:image/png;base64,") == 3
    assert f"{planned['duration_s']:.6f} s" in text


def test_each_part_is_proved_by_itself_on_its_own_path(folder, planned):
    hexapod = load_machine("hexapod")
    taken, file = load_plan(folder / "plan"), folder / "plan" / "motion.bin"
    program = import_program(folder / "spiral.nc").program
    parts = list(follow_motion(file, walk_path(program, hexapod), hexapod, None))
    assert len(parts) == planned["windows"]
    for part in parts:
        assert certify(part, taken.source.find_limits(part)).holds
    whole = read_motion(file, actuate(program, hexapod))
    begin = Fraction(0)  # sums of floats would round
    for part, held in zip(parts, join_parts(motion_parts(file)), strict=True):
        assert held.head.begin == float(begin)
        t = np.linspace(0, part.duration, 50)[1:-1]
        np.testing.assert_allclose(part.at(t).q, whole.at(float(begin) + t).q, atol=1e-10)
        begin += Fraction(part.duration)


STOPS = "\n".join(
    ["G21 G90 G61", "G1 X1 Z8 F600", *(f"G1 X{k % 2} Y{k % 3}" for k in range(12)), "M2", ""]
)


@pytest.fixture(scope="module")
def stopping(call, folder):
    """A plan in parts that all end with a stop of the program, without a file of pulses."""
    file = folder / "stops.nc"
    file.write_text(STOPS)
    with small_windows(3), pytest.MonkeyPatch.context() as patch:
        patch.setattr(progress, "REPORT_PERIOD", 0.0)
        more = ("--stream", "--order", "2", "--no-figures", "--pulses", "none")
        done = call(
            "plan", file, "--machine", "hexapod", *more, "--out", folder / "stops", "--json"
        )
    assert done.exit_code == 0, done.stderr
    at = [
        int(line)
        for line in re.findall(r"part by part: line (\d+) of 15, [\d.]+ s of motion, ", done.stderr)
    ]
    assert at == sorted(set(at))
    assert len(at) > 3
    assert at[-1] == 14  # the last that moves, before M2
    assert json.loads(done.stdout)["windows"] > 3
    assert call("check", folder / "stops").exit_code == 0
    return folder / "stops"


def read_triggers(directory):
    with (directory / "triggers.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def events(call, folder):
    """A spiral with an event after every seventh line, planned in parts and as a whole."""
    lines = code().splitlines()
    for k in range(len(lines) - 1, 6, -7):
        lines.insert(k, f"M{3 + 2 * (k % 2)} S{k}")
    file = folder / "events.nc"
    file.write_text("\n".join([*lines, ""]))
    more = ("--machine", "hexapod", "--order", "2", "--no-figures", "--json")
    with small_windows(PIECES):
        streamed = call("plan", file, *more, "--stream", "--out", folder / "streamed")
    assert streamed.exit_code == 0, streamed.stderr
    assert "trigger" not in streamed.stderr.replace("marked by triggers", "")
    whole = call(
        "plan", file, *more, "--whole", "--no-worth", "--no-baselines", "--out", folder / "whole"
    )
    assert whole.exit_code == 0, whole.stderr
    return json.loads(streamed.stdout), json.loads(whole.stdout)


def test_triggers_are_written_where_the_whole_has_them(call, folder, events):
    streamed, whole = events
    own, others = read_triggers(folder / "streamed"), read_triggers(folder / "whole")
    assert streamed["windows"] > 4
    assert (
        streamed["trigger_count"] == len(own) == len(others) == len(whole["triggers"]) > LINES // 8
    )
    taken = load_plan(folder / "streamed")
    times = np.array([float(row["t [s]"]) for row in own])
    places = taken.trajectory.at(times).s  # by the motion as it was written
    counts = taken.pulses.counts(times)
    for n, (row, other) in enumerate(zip(own, others, strict=True)):
        for name in ("name", "segment", "repetition"):
            assert row[name] == other[name]
        for name in ("s [m]", "x [m]", "y [m]", "z [m]"):
            assert float(row[name]) == pytest.approx(float(other[name]), abs=1e-12)
        assert places[n] == pytest.approx(float(row["s [m]"]), abs=1e-12)
        # windows of six pieces look ahead a little
        assert times[n] == pytest.approx(float(other["t [s]"]), rel=2e-2)
        assert [int(value) for name, value in row.items() if "[counts]" in name] == counts[
            n
        ].tolist()


def list_cells(page, section):
    """Of the table below a heading, row by row."""
    table = page.split(f'<h2 id="{section}">')[1].split("</table>")[0]
    rows = [re.findall(r"<t[hd][^>]*>([^<]*)</t[hd]>", row) for row in table.split("<tr>")[1:]]
    return rows[0], rows[1:]


def test_both_pages_have_the_drive_timing_and_the_triggers(folder, events):
    """A plan in parts as a plan of the whole: the times on the lines of each axis, and each trigger
    with its time.
    """
    for name, record in zip(("streamed", "whole"), events, strict=True):
        page = (folder / name / "report.html").read_text(encoding="utf-8")
        heads, rows = list_cells(page, "drives")
        assert heads[:2] == ["axis", "STEP high (µs)"]
        for row, (axis, told) in zip(rows, record["pulses"]["axes"].items(), strict=True):
            kept = [row[0], *(float(cell.split(" / ")[0]) for cell in row[1:])]
            lines = [1e6 * told["lines_s"][key] for key in ("high", "low", "setup", "hold")]
            assert kept[0] == axis
            assert kept[1:] == pytest.approx(
                [*lines, told["highest_rate_hz"] / 1e3], rel=1e-5
            )  # six digits are shown
        heads, rows = list_cells(page, "triggers")
        known = read_triggers(folder / name)
        assert heads[:4] == ["trigger", "segment", "at (mm)", "time (s)"]
        assert len(rows) == len(known)
        for row, event in zip(rows, known, strict=True):
            assert row[:2] == [event["name"], event["segment"]]
            assert float(row[3]) == pytest.approx(float(event["t [s]"]), abs=5e-8)


def test_a_page_has_the_first_of_many_triggers(folder, events):
    table = tabulate_trigger_csv(folder / "streamed" / "triggers.csv", 1000)
    assert table.notes == (f"the other {1000 - len(table)} are in triggers.csv",)


def test_triggers_that_were_changed_are_found(call, folder, events):
    changed = folder / "changed"
    copytree(folder / "streamed", changed)
    assert call("check", changed).exit_code == 0
    file = changed / "triggers.csv"
    file.write_text(file.read_text().replace("M3", "M4", 1))
    assert "triggers.csv was changed after it was written" in call("check", changed).stderr


def rewrite(path, parts):
    """The parts of a motion, one after the other: each begins when the one before ends, as a writer
    asks for it.
    """
    begin = Fraction(0)
    with path.open("wb") as file:
        writer = MotionWriter(file)
        for part in parts:
            s, v, a, j, piece = part.columns
            motion = SimpleNamespace(knots=part.knots, s=s, v=v, a=a, j=j, piece=piece)
            writer.add(motion, replace(part.head, begin=float(begin)))
            begin += Fraction(float(part.knots[-1]))
        writer.finish()
    return float(begin)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda parts: parts[:-1], "ends before the path"),
        (lambda parts: parts[1:], "does not continue the path"),
        (lambda parts: [parts[0], *parts], "does not continue the path"),
        (lambda parts: [*parts, parts[-1]], "does not continue the path"),
        (lambda parts: [parts[0], *parts[2:]], "does not continue the path"),
        (lambda parts: [parts[1], parts[0], *parts[2:]], "does not continue the path"),
        (lambda parts: [replace(parts[0], head=replace(parts[0].head, steps=2)), *parts[1:]], ""),
    ],
    ids=["cut", "headless", "first twice", "last twice", "left out", "swapped", "fewer steps"],
)
def test_a_motion_whose_parts_are_not_the_program_is_no_plan(
    call, stopping, tmp_path, change, told
):
    forged = tmp_path / "forged"
    copytree(stopping, forged)
    duration = rewrite(
        forged / "motion.bin", change(list(join_parts(motion_parts(stopping / "motion.bin"))))
    )
    record = json.loads((forged / "plan.json").read_text())
    for name in ("files", "record"):
        record["provenance"].pop(name)
    (forged / "plan.json").unlink()
    sealed = seal_record({**record, "duration_s": duration}, forged)
    (forged / "plan.json").write_text(json.dumps(sealed))
    checked = call("check", forged)
    assert checked.exit_code == 2
    assert told in checked.stderr


@pytest.mark.parametrize(
    ("error", "exit_code", "message"),
    [
        (KeyboardInterrupt(), 130, "interrupted: nothing was written to"),
        (
            OSError(errno.ENOSPC, "No space left on device"),
            2,
            "error: .*motion.bin: No space left on device",
        ),
    ],
    ids=["Ctrl-C", "full disk"],
)
@pytest.mark.parametrize("earlier", [False, True], ids=["new", "replacing"])
def test_a_plan_that_is_broken_off_leaves_nothing(
    call, tmp_path, monkeypatch, planned, folder, error, exit_code, message, earlier
):
    """In the midst of its third part; a plan that stood there before stays."""
    file, out = tmp_path / "spiral.nc", tmp_path / "out"
    file.write_text(code())
    if earlier:
        copytree(folder / "plan", out)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    added = []

    def add(*given):
        added.append(None)
        if len(added) == 3:
            raise error
        return write(*given)

    write = MotionWriter.add
    monkeypatch.setattr(MotionWriter, "add", add)
    more = ("--stream", "--order", "2", "--no-figures", "--force")
    with small_windows(PIECES):
        done = call("plan", file, "--machine", "hexapod", *more, "--out", out)
    assert done.exit_code == exit_code
    assert re.search(message, done.stderr)
    assert len(added) == 3
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    assert {path.name for path in tmp_path.iterdir()} == {file.name, *(["out"] if earlier else [])}


def test_every_file_states_the_same_duration(call, folder):
    """The sum of the parts' durations is one number, wherever it is stated: a sum that rounds
    differs.
    """
    file, out = folder / "rounding.nc", folder / "rounding"
    lines = ["G21 G90 G61", "G1 X1 Z2 F600", *(f"G1 X{k % 2} Y{k % 3}" for k in range(24))]
    file.write_text("\n".join(lines))
    with small_windows(4):
        more = ("--stream", "--order", "2", "--no-figures")
        assert call("plan", file, "--machine", "cartesian", *more, "--out", out).exit_code == 0
    durations = [float(part.knots[-1]) for part in join_parts(motion_parts(out / "motion.bin"))]
    assert sum(durations) != float(sum(map(Fraction, durations)))
    checked = call("check", out)
    assert checked.exit_code == 0, checked.stderr
    assert load_plan(out).source.open_pulses() is not None


def test_turns_go_on_behind_a_stop(call, folder):
    """An axis that has turned more than half a turn is gone on with from there, not from home's
    side.
    """
    turns = "".join("[[segment]]\nturn = { about = [0, 0, 1], angle = 50 }\n" for _ in range(12))
    file = folder / "turns.toml"
    file.write_text(f'schema = 1\nmachine = "traverser"\nlength = "mm"\nangle = "deg"\n{turns}')
    whole = call(
        "plan",
        file,
        "--whole",
        "--order",
        "2",
        "--no-figures",
        "--out",
        folder / "turned",
        "--json",
    )
    assert whole.exit_code == 0, whole.stderr
    with small_windows(3):
        more = ("--stream", "--order", "2", "--no-figures", "--json")
        done = call("plan", file, *more, "--out", folder / "turns")
    assert done.exit_code == 0, done.stderr
    one, other = (json.loads(each.stdout)["pulses"]["axes"] for each in (whole, done))
    assert {name: axis["final_count"] for name, axis in one.items()} == {
        name: axis["final_count"] for name, axis in other.items()
    }
    assert call("check", folder / "turns").exit_code == 0


def test_a_program_that_goes_out_of_reach_gives_nothing(call, folder, limit_search):
    limit_search(0.0)
    file = folder / "far.nc"
    file.write_text(code(FAR))
    done = call(
        "plan", file, "--machine", "hexapod", "--stream", "--order", "2", "--out", folder / "far"
    )
    assert done.exit_code == 1
    assert f"segment {LINES + 2};" in done.stderr
    assert f"segment {LINES + 2} is in line {LINES + 3} of far.nc" in done.stderr
    assert not (folder / "far").exists()


def test_or_what_was_certified_before_it(call, folder, limit_search):
    limit_search(0.0)
    file = folder / "long.nc"
    file.write_text(code(FAR))
    more = ("--stream", "--keep-certified", "--order", "2", "--no-figures")
    with small_windows(PIECES):
        done = call("plan", file, "--machine", "hexapod", *more, "--out", folder / "kept")
    assert done.exit_code == 1
    record = json.loads((folder / "kept" / "plan.json").read_text())
    assert "mm is beyond" in record["ends_before"]
    assert "It ends before the program does" in (folder / "kept" / "report.html").read_text()
    checked = call("check", folder / "kept", "--json")
    assert checked.exit_code == 0, checked.stderr
    assert json.loads(checked.stdout)["duration_s"] == record["duration_s"] > 2
    loaded = load_plan(folder / "kept")
    assert loaded.path.fit is not None
    assert (loaded.path.fit.before, loaded.path.fit.after) == (
        record["fit"]["pieces_before"],
        record["fit"]["pieces_after"],
    )
    motion = loaded.trajectory
    assert np.abs(motion.at(motion.duration).qd).max() < 1e-9
    # the stop at its end is that of the refusal
    assert loaded.avoidable_stops.count == record["avoidable_stops"]["count"]


def test_what_needs_the_whole_is_refused_with_the_remedy(call, folder):
    for more, told in (
        (
            ("--duration", "20 s"),
            "because a duration is a goal for the whole motion: omit it, or give --whole\n",
        ),
        (("--baselines",), "with --baselines: omit that, or give --whole\n"),
        (
            ("--pulses", "csv"),
            "with --pulses csv: omit that, and run pulsepath export --format pulses",
        ),
    ):
        done = call("plan", "circle", "--stream", *more, "--out", folder / "none")
        assert done.exit_code == 2, done.stderr
        assert told in done.stderr
    done = call("plan", "free-yaw", "--machine", "tripod", "--stream", "--out", folder / "none")
    told = " ".join(done.stderr.split())
    assert (
        "because segment 2 leaves orientation free: plan that segment by itself, or give --whole"
        in told
    )
    assert call("plan", "circle", "--keep-certified", "--out", folder / "none").exit_code == 2
