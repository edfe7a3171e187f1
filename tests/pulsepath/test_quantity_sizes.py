"""Quantities that no machine has are refused, with line, key, value and limit, before anything is
computed of them.
"""

import pytest
from click.testing import CliRunner

from kinematics import FileError, MotionError, load_machine
from planner import Arc, Dwell, Line, Program, Turn, load_program, plan
from planner.path.actuation import actuate
from planner.timing import grid
from planner.trajectory import MOST_ROWS, period
from pulsepath.cli import main
from pulsepath.options import Frequency

HEAD = 'schema = 1\nmachine = "hexapod"\nlength = "mm"\nangle = "deg"\n'
UP = "[[segment]]\nline = { to = [0, 0, 25] }\n"
OUT = "[[segment]]\nline = { to = [15, 0, 25] }\n"
ARC = "[[segment]]\narc = { centre = [0, 0, 25], normal = [0, 0, 1], angle = %s }\n"
PROGRAMS = {
    "arc": (
        UP
        + OUT
        + "[[segment]]\narc = { centre = [0, 0, 25], normal = [0, 0, 1], angle = 3.6e11 }\n",
        "10: ",
        "deg",
    ),
    "turn": ("[[segment]]\nturn = { about = [0, 0, 1], angle = 1e12 }\n", "6: ", "deg"),
    "repeat": ("repeat = 1000000000000\n" + UP, "5: repeat", "1e+06"),
    "product": ("repeat = 900000\n" + UP + OUT, "6: repeat", "more than 1000000 in all"),
    "far": ("[[segment]]\nline = { to = [1e300, 0, 0] }\n", "6: ", "1e+08 mm"),
    "blend": (
        '[[segment]]\nline = { to = [0, 0, 25] }\njoin = { blend = "1e300 mm" }\n' + OUT,
        "7: ",
        "1e+08 mm",
    ),
    "dwell": (UP + '[[segment]]\ndwell = "1e30 s"\n', "8: ", "1e+09 s"),
    "duration": ('duration = "1e30 s"\n' + UP, "5: ", "1e+09 s"),
    "slow": ('[[segment]]\nline = { to = [0, 0, 5] }\nspeed = "1e-30 mm/s"\n', "7: ", "1e-12 mm/s"),
    "fast": ('[[segment]]\nline = { to = [0, 0, 5] }\nspeed = "1e300 mm/s"\n', "7: ", "1e+18 mm/s"),
    "work": ('work = { to = ["1e9 mm", "0 mm", "0 mm"] }\n' + UP, "5: ", "1e+08 mm"),
    "curve": (
        '[[segment]]\ncurve = { x = "1e300*t", y = "0", z = "0", from = 0, to = 1 }\n',
        "5: ",
        "100000 m",
    ),
}
AXES = """schema = 1
kind = "traverser"
[geometry]
home = { to = ["0 in", "0 in", "0 in"] }
[axes]
travel = ["0 in", "48 in"]
pulse = "0.01 mm"
max_speed = "20 mm/s"
max_acceleration = "50 mm/s^2"
[rotary]
drive = { steps = 400 }
max_speed = "90 deg/s"
max_acceleration = "180 deg/s^2"
"""
MACHINES = {
    "pulse": ('"0.01 mm"', '"1e-300 m"', "7: axes.pulse"),
    "speed": ('"20 mm/s"', '"1e300 mm/s"', "8: axes.max_speed"),
    "slow": ('"20 mm/s"', '"1e-300 mm/s"', "8: axes.max_speed"),
    "travel": ('"48 in"', '"1e300 in"', "6: axes.travel[2]"),
    "gear": (
        "{ steps = 400 }",
        f"{{ steps = 400 }}\nelectronic_gear = [{10**400}, 1]",
        "12: rotary.electronic_gear[1]",
    ),
    "factor": (
        "{ steps = 400 }",
        "{ steps = 400 }\npulse_factor = 1e300",
        "12: rotary.pulse_factor",
    ),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_beyond_any_size_is_refused_with_its_line(tmp_path, name):
    body, line, limit = PROGRAMS[name]
    (tmp_path / "program.toml").write_text(HEAD + body)
    done = CliRunner().invoke(main, ["check", str(tmp_path / "program.toml")])
    assert done.exit_code == 2, done.output
    assert f"program.toml:{line}" in done.stderr
    assert limit in done.stderr


@pytest.mark.parametrize("name", MACHINES)
def test_so_is_a_machine(tmp_path, name):
    old, new, told = MACHINES[name]
    (tmp_path / "machine.toml").write_text(AXES.replace(old, new, 1))
    with pytest.raises(FileError) as refused:
        load_machine(tmp_path / "machine.toml")
    assert f"machine.toml:{told}" in str(refused.value)


def test_what_is_made_in_python_is_refused_too():
    for make in (
        lambda: Line([1e300, 0, 0]),
        lambda: Arc([0, 0, 0], [0, 0, 1], 1e9),
        lambda: Turn(about=[0, 0, 1], angle=1e9),
        lambda: Dwell(1e30),
        lambda: Line([0, 0, 0], speed=1e-30),
        lambda: Program((Line([0, 0, 1]),), repeat=10**12),
    ):
        with pytest.raises(MotionError, match=r"at (most|least)|in all"):
            make()


def test_a_path_that_turns_on_and_on_names_the_segment(turning):
    program = load_program(turning)
    with pytest.raises(FileError, match=r"program\.toml:11: segment\[4\].*10800 turns"):
        actuate(program, load_machine("hexapod"))


@pytest.fixture
def turning(tmp_path):
    file = tmp_path / "program.toml"
    file.write_text(HEAD + UP + OUT + ARC % 3.6e6 + ARC % 288000)
    return file


def test_a_run_of_too_many_intervals_is_refused_with_the_remedy(monkeypatch):
    monkeypatch.setattr(grid, "MAX_INTERVALS", {2: 100, 3: 100})

    with pytest.raises(
        MotionError,
        match=r'intervals to time, at most 100: write join = "stop" .* or plan at order 2',
    ):
        plan(load_program("bare-circle"), load_machine("hexapod"), order=3)


def test_tables_of_long_motions_stay_bounded():
    """One row per millisecond up to a thousand seconds."""
    assert period(1.0) == period(999.0) == 1e-3
    for duration in (1001.0, 1e4, 1e6, 1e9):
        assert MOST_ROWS / 11 < duration / period(duration) <= MOST_ROWS


@pytest.mark.parametrize(
    ("text", "ticks"),
    [
        ("16 MHz", 16_000_000),
        ("16000000", 16_000_000),
        ("12.5MHz", 12_500_000),
        ("2e7", 20_000_000),
        ("1 Hz", 1),
    ],
)
def test_a_clock_is_a_whole_number_of_hertz(text, ticks):
    assert Frequency().convert(text, None, None) == ticks


@pytest.mark.parametrize("text", ["0", "1.5 Hz", "16 mhz", "-1", "nan", "1e-3 kHz x", "0.1"])
def test_no_other_clock_is_taken(text):
    done = CliRunner().invoke(main, ["plan", "circle", "--out", "any", "--clock-hz", text])
    assert done.exit_code == 2
    assert 'write a whole number of Hz from 1 on, as 16000000 or "16 MHz"' in done.output


def test_an_example_has_the_size_of_what_is_asked_for():
    done = CliRunner().invoke(main, ["plan", "circle", "--out", "any", "--fit", "0.02"])
    assert 'write e.g. "0.02 mm"' in f"{done.output}{done.exception}"
