"""The command `plan` on a machine with input shapers: what it writes is of the shaped motion."""

import json
from dataclasses import replace

import numpy as np
import pytest

import pulsepath as pp
from kinematics.machine.machine_writer import machine_toml
from kinematics.machine.shaper import Shaper
from pulsepath.store.verify import prove_motion


@pytest.fixture(scope="module")
def machine_file(tmp_path_factory):
    machine = pp.load_machine("hexapod").carrying(
        pp.Load()
    )  # no force is proved, which takes longest
    file = tmp_path_factory.mktemp("shaped") / "shaped.toml"
    shaped = machine.driven_by(
        [replace(axis, shaper=Shaper("zv", 35.0, 0.05)) for axis in machine.axes]
    )
    file.write_text(machine_toml(shaped), encoding="utf-8")
    return file


@pytest.fixture
def proved_again(monkeypatch):
    monkeypatch.setattr("pulsepath.store.read.prove_motion", prove_motion)


def test_record_motion_and_pulses_are_of_the_shaped_motion(
    call, machine_file, tmp_path, proved_again
):
    out = tmp_path / "out"
    done = call(
        "plan",
        "bare-circle",
        "--machine",
        machine_file,
        "--out",
        out,
        "--order",
        "2",
        "--no-figures",
        "--no-baselines",
    )
    assert done.exit_code == 0, done.stderr
    assert "input shapers" in done.stdout
    told = json.loads((out / "plan.json").read_text())
    shaping, card = (
        told["shaping"],
        (out / "report.html").read_text().split("<dt>Duration</dt><dd>")[1],
    )
    for page, form in (
        (done.stdout.split(" duration ")[1], ".6f"),
        (card, ".4f"),
    ):  # the machine's first
        assert page.lstrip().startswith(f"{told['duration_s']:{form}} s")
        assert f"{shaping['duration_before_s']:{form}} s" in page
    amplitudes, times = Shaper("zv", 35.0, 0.05).impulses
    assert told["duration_s"] == pytest.approx(shaping["duration_before_s"] + times[-1])
    assert shaping["delay_s"] == pytest.approx(amplitudes @ times)
    assert shaping["holds"]
    assert max(each["worst_ratio"] for each in shaping["limits"].values()) <= 1
    assert told["pulses"]["check"]["holds"]
    # the table's poses leave the path by no more than is stated
    table = np.genfromtxt(out / "trajectory.csv", delimiter=",", names=True)
    assert table["t_s"][-1] == pytest.approx(told["duration_s"])
    place = np.stack([table[f"{name}_m"] for name in "xyz"], 1)
    home = pp.load_machine("hexapod").home.translation
    away = np.abs(np.linalg.norm((place - place[0])[:, :2] - [-0.015, 0.0], axis=1) - 0.015)
    assert np.allclose(place[0], home + np.array([0.015, 0, 0.025]), atol=1e-9)
    assert 0.95e-6 * shaping["tool_contour_um"] < away.max() <= 1e-6 * shaping["tool_contour_um"]
    assert shaping["tool_contour_um"] <= shaping["tool_deviation_um"]
    assert shaping["warning"] is None  # it has no tolerance to keep
    taken = pp.load_plan(out)  # proved again, behind the shapers as well
    assert taken.duration == told["duration_s"]
    no = call("export", out, "--format", "adlink")
    assert no.exit_code == 2
    assert "has an input shaper" in no.stderr


ROUND = """
schema = 1
length = "mm"
speed = "8 mm/s"
[[segment]]
line = { to = [6, 0, 0] }
join = { blend = 0.5 }
[[segment]]
line = { to = [6, 6, 0] }
"""


def test_the_cost_of_the_shapers_is_told(call, tmp_path):
    """Against a plan of the same machine without them; the limit that was lowered, its share and
    its place.
    """
    program, took = tmp_path / "round.toml", []
    program.write_text(ROUND, encoding="utf-8")
    bare = pp.load_machine("traverser").driven_by(
        [replace(axis, max_acceleration=1.0) for axis in pp.load_machine("traverser").axes]
    )
    shaped = bare.driven_by([replace(bare.axes[0], shaper=Shaper("zv", 5.0)), *bare.axes[1:]])
    for name, machine in (("bare", bare), ("shaped", shaped)):
        file, out = tmp_path / f"{name}.toml", tmp_path / f"{name}-out"
        file.write_text(machine_toml(machine), encoding="utf-8")
        few = ("--no-figures", "--no-baselines", "--no-worth")
        done = call("plan", program, "--machine", file, "--out", out, *few)
        assert done.exit_code == 0, done.stderr
        record = json.loads((out / "plan.json").read_text())
        took.append(record["duration_s"])
    shaping, text = record["shaping"], " ".join(done.stdout.split())
    cost = shaping["cost"]
    # behind shapers motions are solved on a grid, which loses less than a ten-thousandth
    assert cost["total_s"] == pytest.approx(took[1] - took[0], abs=1e-4 * took[0])
    assert cost["total_s"] == cost["length_s"] + cost["lowering_s"]
    assert cost["length_s"] == pytest.approx(0.1)
    assert f"cost of the shapers {1e3 * cost['total_s']:.2f} ms more than without them" in text
    assert cost["lowering_s"] < 0.01 * took[0]
    # where the tool just keeps its cap, a trace of it is left too: only at the corner it is more
    (lowered,) = (stretch for stretch in cost["lowered"] if stretch["share"] < 0.995)
    assert lowered["limit"] == "tool speed"
    assert lowered["share"] > 0.9
    assert lowered["from"]["distance_m"] < 0.006 < lowered["to"]["distance_m"]
    assert "lowered for them tool speed to 9" in text
    assert (
        record["certificate"]["limits"]["tool speed"]["worst_ratio"] > 0.999
    )  # elsewhere all of it is used
    (left,) = shaping["residual_vibration"]
    assert left["axes"] == ["X"]
    assert left["at_110_percent"] == pytest.approx(np.sin(0.1 * np.pi / 2))
    assert "vibration left zv 5 Hz: 0.0 % at 5 Hz, 15.6 % at ±10 %" in text


CORNER = """
schema = 1
length = "mm"
[[segment]]
line = { to = [6, 0, 0] }
join = { blend = BLEND }
[[segment]]
line = { to = [6, 4, 0] }
"""


@pytest.mark.parametrize("blend", [0.02, 0.5])
def test_a_tolerance_that_is_not_proved_behind_the_shapers_is_warned_of(call, tmp_path, blend):
    """Against the corner itself: how far the table's poses leave it, or would at most."""
    program, out = tmp_path / "corner.toml", tmp_path / "out"
    program.write_text(CORNER.replace("BLEND", str(blend)), encoding="utf-8")
    axes = [
        replace(axis, shaper=Shaper("zv", 28.0, 0.05)) for axis in pp.load_machine("traverser").axes
    ]
    machine = tmp_path / "machine.toml"
    machine.write_text(machine_toml(pp.load_machine("traverser").driven_by(axes)), encoding="utf-8")
    few = ("--no-figures", "--no-baselines", "--no-worth")
    done = call("plan", program, "--machine", machine, "--out", out, *few)
    assert done.exit_code == 0, done.stderr
    told = json.loads((out / "plan.json").read_text())
    table = np.genfromtxt(out / "trajectory.csv", delimiter=",", names=True)
    x, y = 1e3 * (table["x_m"] - table["x_m"][0]), 1e3 * (table["y_m"] - table["y_m"][0])
    off = np.minimum(np.hypot(y, np.maximum(x - 6, 0)), np.hypot(x - 6, np.maximum(-y, 0))).max()
    (left,) = told["blends"]
    used = 1e3 * left["deviation_m"] + 1e-3 * told["shaping"]["tool_contour_um"]
    assert off <= used
    warned = used > blend
    assert (told["shaping"]["warning"] is not None) == warned
    assert ("not proved behind the input shapers" in done.stderr) == warned
    helps = warned and 1e-3 * told["shaping"]["tool_contour_um"] < blend
    assert ("a smaller tolerance" in " ".join(done.stderr.split())) == helps
    assert ("zv is the shortest kind" in " ".join(done.stderr.split())) == warned
    assert ("not proved behind the input shapers" in (out / "report.html").read_text()) == warned


def test_planning_in_parts_is_refused(call, machine_file, tmp_path):
    done = call(
        "plan", "bare-circle", "--machine", machine_file, "--out", tmp_path / "o", "--stream"
    )
    assert done.exit_code == 2
    told = " ".join(done.stderr.split())
    assert (
        "program bare-circle on shaped cannot be planned in parts, because the machine has input shapers"
        in told
    )
    assert ": take them out of its file, or give --whole" in told
    assert not (tmp_path / "o").exists()
