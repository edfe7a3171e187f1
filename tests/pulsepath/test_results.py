"""Every result prints itself, draws itself, becomes a data frame and is saved: one walk over all
their classes.
"""

import json
import subprocess
import sys
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicSpline

import pulsepath as pp
from benchmarks.reports.gain.comparison import (
    BaselineRatio,
    Comparison,
    ComparisonRow,
    SettingEntry,
)
from benchmarks.reports.gain.verdict import Margin, Verdict
from benchmarks.sweep.result import Cell, RunResult, SavedRuns, Setting
from controllers.metrics import Circle, circular_test
from controllers.metrics.iso_style import PathAccuracy, PoseAccuracy
from kinematics.foundation.result import Result
from kinematics.machine.shaper import Shaper
from planner.cross_check import CrossCheck
from planner.interruption import hold as _hold  # noqa: F401  # so that the walk meets what it makes
from planner.sources.source import Imported

NAME = "<b>"
"""Of the machine: nothing of it may reach a page as markup."""


@cache
def machine():
    return pp.load_machine("hexapod").rename(NAME)


@cache
def plan():
    return pp.plan(pp.load_program("bare-circle"), machine())


def shaped():
    axes = [replace(axis, shaper=Shaper("zv", 35.0)) for axis in machine().axes]
    return pp.plan(pp.load_program("bare-circle"), machine().driven_by(axes)).shaped


@cache
def straight():
    """Plan two lines of a machine of three axes, whose stops are soon made."""
    return pp.plan(pp.Program([pp.Line([0.02, 0, 0]), pp.Line([0.02, 0.02, 0])]), "corexy", order=2)


@cache
def folder():
    """Where a stored plan lies as long as the tests run."""
    return TemporaryDirectory()


@cache
def tracking():
    return pp.track(plan(), machine(), pp.find_law("6"), period=1e-2)


@cache
def solution():
    path = CubicSpline([0, 0.5, 1], [[0, 0], [0.3, -0.2], [0.1, 0.4]])
    return pp.time_optimal(path, max_speed=1.0, max_acceleration=[5.0, 4.0])


def crossed():
    """Of one motion beside itself: toppra may not be there."""
    return CrossCheck(solution(), solution())


def forces():
    motion = pp.motion_of_axes(machine(), plan().trajectory.at(np.linspace(0, 1, 5)))
    return pp.forces(machine(), motion, platform=pp.Body(1.0))


def round_trip():
    circle = Circle((0, 0, 0), (0, 0, 1), 15e-3, 0.02)
    angle = np.linspace(0, 2 * np.pi, 2000)
    way = np.column_stack([15.001e-3 * np.cos(angle), 15e-3 * np.sin(angle), 0 * angle])
    return circular_test(way, way[::-1], circle)


def sizing():
    return pp.size_stepper(
        pp.Slide(mass=1.0),
        pp.Leadscrew(lead=2e-3, diameter=8e-3, length=0.3, efficiency=0.4),
        pp.StepMotor(step=np.deg2rad(1.8), inertia=1e-6),
        pp.Traverse(travel=0.2, time=10.0, accuracy=1e-4, ramp=0.5),
    )


def comparison():
    entry = SettingEntry(0, Setting("6", (("gain", 0.7),)))
    row = ComparisonRow(
        entry,
        "<i>",
        2,
        {"contour_rms": 1.5e-6},
        (1e-6, 2e-6),
        (),
        0,
        0,
        BaselineRatio(0.5, 0.4, 0.6),
    )
    return Comparison((), entry, (row,), ("<i>",), ("<i>",))


def runs():
    cells = [Cell(Setting("6", (("gain", gain),)), "line") for gain in (0.5, 0.7)]
    record = {"axes": {"a": "m"}, "tasks": {"line": {"unit": "m"}}}
    done = {"contour_rms": 1.5e-6, "following_max.a": 3e-6, "end_time": np.inf}
    return SavedRuns(
        Path("<i>"),
        record,
        {"0": RunResult(cells[0], done), "1": RunResult(cells[1], failure="<b>")},
    )


PATH = PathAccuracy(3, np.array([1e-6, 2e-6]), np.array([3e-6, 4e-6]))
POSE = PoseAccuracy(3, 1e-6, 2e-6)
MAKERS = {
    "Plan": plan,
    "Trajectory": lambda: plan().trajectory,
    "Certificate": lambda: plan().certificate,
    "DurationBound": lambda: plan().bound,
    "Worth": lambda: plan().worth,
    "LimitChange": lambda: plan().worth.replan("speed", "leg1", 0.01),
    "Section": lambda: plan().hold(0.5),
    "Stops": lambda: straight().stops(4),
    "PulseSchedule": lambda: plan().pulses,
    "RealisedPath": lambda: plan().realised(stride=200),
    "Solution": solution,
    "CrossCheck": crossed,
    "PlanStanding": lambda: [part.standing for part in pp.plan_parts(plan().program, machine())][-1],
    "Standing": lambda: pp.check(plan().program, machine()),
    "Classical": lambda: pp.classical(plan()),
    "Program": lambda: plan().program,
    "PositionList": lambda: pp.PositionList([[0, 0, 0.01, 0, 0, 0], [0, 0.01, 0.01, 0, 0, 0.1]]),
    "ArmSimulation": lambda: pp.simulate_arms(pp.PositionList([[0, 0, 0.01, 0, 0, 0.1]]), pp.load_machine("tripod")),
    "Imported": lambda: Imported(plan().program, {"G1": 3}, ("<i>",)),
    "Hexapod": machine,
    "Tripod": lambda: pp.load_machine("tripod"),
    "Linkage": lambda: pp.load_machine("linkage"),
    "Traverser": lambda: pp.load_machine("traverser"),
    "Equations": lambda: pp.load_machine("delta"),
    "Arm": lambda: pp.load_machine("arm"),
    "Margins": lambda: machine().check(machine().home),
    "Forward": lambda: machine().forward(machine().home_q),
    "Posture": lambda: pp.posture_of_pose(machine(), machine().home),
    "Workspace": lambda: pp.workspace(machine(), x=(-0.02, 0.02), y=(-0.02, 0.02), z=0.26, cells=6),
    "Forces": forces,
    "Budget": lambda: pp.error_budget(machine(), machine().home, [pp.Quantization()]),
    "Selection": lambda: pp.select_parts(pp.load_actuators(), pp.ActuatorNeed(stroke=0.04)),
    "ActuatorNeed": lambda: pp.ActuatorNeed(stroke=0.04, precision=1e-6),
    "JointNeed": lambda: pp.JointNeed(tilt=0.1),
    "StepperSizing": sizing,
    "Measurements": lambda: pp.load_measurements("cmm"),
    "Calibration": lambda: pp.calibrate(pp.load_machine("hexapod"), pp.load_measurements("cmm")),
    "Tracking": tracking,
    "Metrics": lambda: pp.evaluate(tracking(), plan(), machine()),
    "PathAccuracy": lambda: PATH,
    "PoseAccuracy": lambda: POSE,
    "CircularTest": round_trip,
    "Comparison": comparison,
    "Verdict": lambda: Verdict(comparison().baseline, 0.5, (Margin("gain", 0.7, None, 1.4),), "<i>"),
    "SavedRuns": runs,
    "ShapedProof": shaped,
    "Observability": lambda: made("Calibration").observability,
}  # fmt: skip


def concrete(kind):
    """What is made of it; `Legged` is what two machines share."""
    for one in kind.__subclasses__():
        if (
            not one.__abstractmethods__
            and not one.__name__.startswith("_")
            and one.__name__ != "Legged"
        ):
            yield one
        yield from concrete(one)


def test_the_walk_meets_every_class():
    for name in pp.__all__:  # which loads it
        getattr(pp, name)
    ours = {one.__name__ for one in concrete(Result) if one.__module__.split(".")[0] in FLOORS}
    assert ours == set(MAKERS)


FLOORS = {"kinematics", "planner", "controllers", "benchmarks", "pulsepath"}


@pytest.fixture(params=MAKERS)
def result(request):
    return made(request.param)


@cache
def made(name):
    return MAKERS[name]()


class Page(HTMLParser):
    """The cells of a page, its tags closed in the order in which they were opened."""

    def __init__(self, text):
        super().__init__()
        self.open, self.cells, self.tags = [], [], set()
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.open.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th"):
            self.cells[-1] += data


def test_text_page_and_tables_tell_the_same(result):
    text, page = str(result), Page(result._repr_html_())
    cells = iter(page.cells)
    for table in result.tables():
        assert [next(cells) for _ in table.read] == [column.title for column in table.read]
        for row in table.cells()[:30]:  # of longer ones what is in the middle is left out
            for cell in row:
                assert cell in text
                assert next(cells) == cell
        if len(table) > 30:
            cells = iter(page.cells[len(page.cells) :])
    assert page.tags <= {
        "table",
        "caption",
        "thead",
        "tbody",
        "tr",
        "th",
        "td",
        "div",
    }  # neither <b> nor <i>


def test_a_frame_of_runs_has_every_figure_of_every_run():
    frame = runs().to_pandas()
    figures = ["contour_rms [m]", "following_max.a [m]", "end_time [s]"]
    assert [*frame.columns] == ["law", "gain", "path", "rig", "seed", *figures, "failure"]
    assert [*frame["gain"]] == [0.5, 0.7]
    assert frame["contour_rms [m]"][0] == 1.5e-6
    assert np.isnan(frame["contour_rms [m]"][1])
    assert frame["failure"][1] == "<b>"


def test_what_is_called_a_bound_is_one_as_it_is_read(result):
    for table in result.tables():
        for column in table.columns:
            if "≤" in column.name or column.name in ("bound", "worst"):
                assert column.up, (table.title, column.name)


def test_where_there_is_no_page_the_tables_are_shown_and_a_repr_is_short(result):
    formatters = pytest.importorskip("IPython.core.formatters")
    formats, _ = formatters.DisplayFormatter().format(result)
    assert formats["text/plain"] == str(result)
    assert formats["text/html"] == result._repr_html_()
    assert repr(result).count("\n") < 3
    assert max(map(len, repr(result).splitlines())) <= 130


VALUES = {
    "Line": lambda: pp.Line([0, 0, 0.1], rotate=[0, 0, 1]),
    "Arc": lambda: pp.Arc([0, 0, 0], [0, 0, 1], 1.0),
    "Spline": lambda: pp.Spline(np.arange(300.0).reshape(-1, 3)),
    "Curve": lambda: pp.Curve(("t", "sin(t)", "0"), 0.0, 1.0),
    "Turn": lambda: pp.Turn([0, 0.1, 0]),
    "Dwell": lambda: pp.Dwell(0.5),
    "Axis": lambda: machine().axes[0],
    "Body": lambda: pp.cylinder(1.0, 0.1, 0.0, 0.2),
    "Load": lambda: pp.Load(pp.cylinder(1.0, 0.1, 0.0, 0.2)),
    "Motion": lambda: pp.motion_of_axes(machine(), plan().trajectory.at(np.linspace(0, 1, 50))),
    "State": lambda: plan().trajectory.at(np.linspace(0, 1, 50)),
    "AxisPulses": lambda: plan().pulses.axes[0],
    "Rig": lambda: pp.load_rig("servo-rig"),
}  # fmt: skip


@pytest.mark.parametrize("name", VALUES)
def test_reprs_of_other_values_are_short_and_say_what_they_are(name):
    value = VALUES[name]()
    assert name in repr(value)
    assert repr(value).count("\n") < 3
    assert len(repr(value)) < 400
    assert "array([" not in repr(value)


def test_reprs_tell_the_main_thing_with_its_unit():
    axis, turning = machine().axes[0], pp.load_machine("traverser").axes[-1]
    assert "leg1: linear, travel 0 to 50.8 mm" in repr(axis)
    assert "R: rotary" in repr(turning)
    assert "deg/s²" in repr(turning)
    assert not axis.rotary
    assert turning.rotary
    assert f"{plan().trajectory.duration:.6g} s" in repr(plan())
    assert "order 3, proved, nearest pulses at 10000000 Hz" in repr(plan())
    assert repr(pp.Line([0, 0, 0.1], speed=0.02)) == "Line(to=[0.0, 0.0, 0.1], speed=0.02)"


def test_frames_hold_the_raw_values_under_their_units(result):
    frame, table = result.to_pandas(), result.data()
    assert list(frame.columns) == [column.heading for column in table.full]
    assert len(frame) == len(table)
    for column in table.full:
        assert all(map(same, frame[column.heading].tolist(), column.raw))


def same(one, other):
    """Exactly; what is not there is NaN in a column of numbers."""
    missing = one is None or one != one
    return (other is None or other != other) if missing else one == other


def test_what_is_saved_reads_back_equal_and_is_not_overwritten(result, tmp_path):
    for suffix in result.files():
        place = tmp_path / f"a{suffix}"
        if type(result).__name__ in ("Arm", "Equations", "Traverser") and suffix == ".toml":
            continue  # machine files cannot say these: `machine_toml` tells why, tested with it
        result.save(place)
        before = place.read_bytes()
        with pytest.raises(pp.MotionError, match="force"):
            result.save(place)
        result.save(place, force=True)
        assert place.read_bytes() == before
    assert not list(tmp_path.glob(".*"))  # nothing is left of what was staged
    if type(result).__name__ != "PositionList":  # whose CSV is a list for operators
        read = pd.read_csv(tmp_path / "a.csv", dtype=str, keep_default_na=False)
        exact = 1e-11 if type(result).__name__ == "Trajectory" else 0  # twelve digits
        for column in result.data().full:
            for text, value in zip(read[column.heading], column.raw, strict=True):
                if isinstance(value, float):
                    assert same(float(text), value) or abs(float(text) - value) <= exact * abs(
                        value
                    )
                else:
                    assert text == ("" if value is None else str(value))
    if ".json" in result.files() and type(result).__name__ != "Trajectory":
        told = json.loads((tmp_path / "a.json").read_text())
        assert told["result"] == {"SavedRuns": "Runs"}.get(
            type(result).__name__, type(result).__name__
        )
        rows = [row for table in told["tables"] for row in table["rows"]]
        assert len(rows) == sum(map(len, result.tables()))


def test_unknown_suffixes_are_refused_with_the_known_ones(result, tmp_path):
    with pytest.raises(pp.MotionError, match=r"no suffix.*\.json"):
        result.save(tmp_path / "a.xlsx")
    assert not list(tmp_path.iterdir())


def test_figures_show_themselves_once_and_without_pyplot(result):
    from matplotlib.figure import Figure

    ax = result.plot()
    assert len(ax.lines) < 2 or ax.get_legend() is not None or ax.name == "3d"
    assert ax.get_figure(root=True)._repr_png_().startswith(b"\x89PNG")
    assert hasattr(ax, "_repr_png_")
    given = Figure().add_subplot(projection="3d" if ax.name == "3d" else None)
    assert result.plot(given) is given
    assert not hasattr(given, "_repr_png_")  # who made it shows it
    other = Figure().add_subplot(projection=None if ax.name == "3d" else "3d")
    with pytest.raises(pp.MotionError, match="flat"):
        result.plot(other)


def test_names_are_drawn_as_they_stand():
    """Between dollars matplotlib sets maths, and raises where it is none."""
    name = r"5$ \x $6"
    program = pp.Program((pp.Line(to=np.array([0, 0, 0.01])),), name=name)
    assert program.plot()._repr_png_()
    odd = machine().rename(name)
    assert odd.plot()._repr_png_()
    assert pp.error_budget(odd, odd.home, [pp.Quantization(name=name)]).plot()._repr_png_()


def test_bars_of_one_name_lie_beside_each_other_and_twice_the_same_way_up():
    budget = pp.error_budget(
        machine(), machine().home, [pp.Quantization(), pp.Quantization(pulses=1.0)]
    )
    ax = budget.plot()
    assert len({patch.get_y() for patch in ax.patches if patch.get_height() < 0.5}) == 3
    ax = budget.plot(ax)
    low, high = ax.get_ylim()
    assert low > high  # the first on top


def test_pandas_missing_says_what_brings_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(pp.MotionError, match=r"pip install 'pulsepath\[notebooks\]'"):
        POSE.to_pandas()


def test_nothing_of_it_imports_pyplot_or_pandas():
    code = (
        "import sys, pulsepath as pp; m = pp.load_machine('hexapod'); str(m); m._repr_html_(); m.plot()._repr_png_();"
        "assert not {'matplotlib.pyplot', 'pandas'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_notebook_shows_tables_and_each_figure_once(tmp_path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    cells = [
        "import pulsepath as pp\nm = pp.load_machine('hexapod')\nm",
        "m.plot()",
        "ax = m.plot()\nax.figure",
    ]
    cells += [
        "import matplotlib.pyplot as plt\nfig, ax = plt.subplots()\nm.check(m.home).plot(ax);",
        "m.plot()",
    ]
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    nbclient.NotebookClient(book, timeout=120, kernel_name="python3").execute()
    kinds = [[sorted(output["data"]) for output in cell["outputs"]] for cell in book.cells]
    assert kinds[0] == [["text/html", "text/plain"]]
    assert kinds[1] == kinds[2] == kinds[3] == kinds[4] == [["image/png", "text/plain"]]


def test_a_position_list_is_read_back(tmp_path):
    listed = MAKERS["PositionList"]()
    listed.save(tmp_path / "a.csv")
    np.testing.assert_allclose(
        pp.load_positions(tmp_path / "a.csv").poses, listed.poses, rtol=1e-15
    )


def test_a_schedule_a_program_and_a_machine_are_read_back(tmp_path):
    from planner.export.formats import npz

    plan().pulses.save(tmp_path / "a.npz")
    held = npz.read(tmp_path / "a.npz")
    for one, other in zip(held.axes, plan().pulses.axes, strict=True):
        np.testing.assert_array_equal(one.ticks, other.ticks)
        np.testing.assert_array_equal(one.direction, other.direction)
    plan().program.save(tmp_path / "a.toml")
    again = pp.load_program(tmp_path / "a.toml")
    assert [type(one) for one in again.segments] == [type(one) for one in plan().program.segments]
    machine().save(tmp_path / "m.toml")
    np.testing.assert_allclose(
        pp.load_machine(tmp_path / "m.toml").home_q, machine().home_q, rtol=1e-14
    )
