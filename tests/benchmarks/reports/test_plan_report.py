"""The report: it shows the plan's own numbers, draws all of it, and needs nothing from outside."""

import json
import re
from base64 import b64encode
from dataclasses import replace
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from benchmarks.animation.animate import POLICY as PLAYER_POLICY
from benchmarks.reports.page import round_up
from benchmarks.reports.plan_content import PlanReport
from benchmarks.reports.plan_figures import draw_axes
from benchmarks.reports.plan_report import POLICY, write_report
from benchmarks.reports.plan_summary import summarise
from benchmarks.reports.timeline import list_segments, make_band
from controllers import evaluate, find_law, track
from controllers.figures import contour_error, following_error
from controllers.rig import assumed_rig
from kinematics import load_machine
from planner import Dwell, Line, Program, classical, import_program, plan
from planner.active_limits import active_limits, tabulate_segments
from planner.figures import axis_motion, limit_use, path_in_space, pulse_rate
from planner.pulses import check

FIGURES = {"path", "axes", "limits", "pulses", "realised", "tracking", "classical", "worth"}


class Page(HTMLParser):
    """Tags, and the cells of each table by the heading above it."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.tables, self.inside, self.section = [], {}, [], ""
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self.inside.append(tag)
        if tag == "h2":
            self.section = dict(attributes)["id"]
        if tag == "tr":
            self.tables.setdefault(self.section, []).append([])
        if tag in ("td", "th"):
            self.tables[self.section][-1].append("")

    def handle_endtag(self, tag):
        while self.inside and self.inside.pop() != tag:
            pass

    def handle_data(self, data):
        if {"td", "th"} & set(self.inside):
            self.tables[self.section][-1][-1] += data


@pytest.fixture(scope="module")
def planned(plan_bundled):
    return plan_bundled("bare-circle", "hexapod", 3)


@pytest.fixture(scope="module")
def baseline(planned):
    return classical(planned)


@pytest.fixture(scope="module")
def verdict(planned):
    return check(planned.pulses, planned.trajectory)


@pytest.fixture(scope="module")
def metrics(planned):
    machine = planned.machine
    rig = assumed_rig(machine)
    return [
        evaluate(track(planned, machine, find_law(law), rig=rig), planned, machine)
        for law in ("3", "6")
    ]


@pytest.fixture(scope="module")
def realised(planned):
    return replace(
        planned.realised(stride=20),
        mechanics=("leg1, leg2: play 2 (not) µm", "leg3: play <3> (not) µm"),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory, planned, baseline, metrics, verdict, realised):
    folder = tmp_path_factory.mktemp("report")
    worth = planned.worth
    change = worth.replan(*worth.best, 0.2)
    write_report(
        PlanReport(
            planned,
            verdict,
            classical=baseline,
            metrics=metrics,
            realised=realised,
            worth=worth,
            change=change,
        ),
        folder / "report.html",
    )
    return folder


@pytest.fixture(scope="module")
def text(folder):
    return (folder / "report.html").read_text()


@pytest.fixture(scope="module")
def page(text):
    return Page(text)


def number(text):
    """The number that a cell begins with."""
    return float(
        re.match(r"-?[\d\N{NARROW NO-BREAK SPACE}.]+", text)[0].replace(
            "\N{NARROW NO-BREAK SPACE}", ""
        )
    )


def test_nothing_is_loaded_from_outside(text, page):
    library = (
        files("benchmarks")
        .joinpath("templates", "uplot", "uPlot.iife.min.js")
        .read_text(encoding="utf-8")
    )
    assert library in text
    data = r'base64,[\w+/=]+|<script type="application/json".*?</script>'
    own = re.sub(data, "", text.replace(library, ""), flags=re.DOTALL)
    assert not re.search(r"https?:|//\w|@import|url\(|fetch\(|XMLHttp|import\(", own)
    assert {tag for tag, _ in page.tags}.isdisjoint({"link", "iframe", "object", "base"})
    for tag, attributes in page.tags:
        for name in ("src", "href", "srcset", "data", "action"):
            assert attributes.get(name, "data:").startswith(("data:", "#")), tag  # within the page
    policy = [
        attributes["content"] for tag, attributes in page.tags if attributes.get("http-equiv")
    ]
    assert policy == [POLICY]
    assert not re.search("https?:|[*]|self", POLICY)


def test_every_figure_is_there_and_in_the_page(folder, page):
    files = {path.stem: path.read_bytes() for path in (folder / "figures").iterdir()}
    assert set(files) == FIGURES
    shown = [attributes for tag, attributes in page.tags if tag == "img"]
    assert {attributes["src"].partition(",")[2] for attributes in shown} == {
        b64encode(png).decode() for png in files.values()
    }
    assert all(attributes["alt"] for attributes in shown)
    for png in files.values():
        assert png.startswith(b"\x89PNG\r\n\x1a\n")


def test_the_segments_have_their_times(page, planned):
    table = tabulate_segments(planned)
    assert page.tables["segments"] == [[column.title for column in table.read], *table.cells()]
    (time,) = (column.raw for column in table.columns if column.name == "time")
    assert sum(time) == pytest.approx(planned.trajectory.duration)


def test_it_says_what_limits_are_worth(text, page, planned):
    worth = planned.worth
    assert worth.describe() in text
    assert "20 % higher saves" in text
    rows = page.tables["worth"]
    told = [[limit, axis] for limit, axes, *_ in rows[1:] for axis in axes.split(", ")]
    assert sorted(told) == sorted([worth.limits[k], worth.axes[k]] for k in worth.rank())
    own = [number(row[2]) for row in rows[1:] if row[2][:1].isdigit()]
    assert own == sorted(own, reverse=True)
    assert min(own) > 0
    assert number(rows[1][2]) == pytest.approx(1e3 * worth.saved.max(), abs=5e-5)


def test_the_summary_shows_the_plans_numbers(page, planned, baseline, verdict):
    rows = dict(page.tables["summary"])
    stated = summarise(PlanReport(planned, verdict, classical=baseline))
    known = {row.label: row.text for row in stated} | {
        "limits 1 % higher": planned.worth.describe()
    }
    assert rows == {label[0].upper() + label[1:]: text for label, text in known.items()}
    assert ("above the proved least of" in rows["Duration"]) == bool(planned.known)
    lost = planned.trajectory.duration - baseline.duration
    assert lost > 0  # the baseline has no limit on jerk
    assert number(rows["Duration"]) == pytest.approx(planned.trajectory.duration, abs=5e-7)
    line = r"(\S+) %: (\S+) s more than trapezoid \((.*)\)"
    share, seconds, timing = re.fullmatch(line, rows["Saved"]).groups()
    assert float(share) == pytest.approx(100 * lost / baseline.duration, abs=5e-3)
    assert float(seconds) == pytest.approx(lost, abs=5e-7)
    # a trapezoid beside a plan of order 3: the line says what it leaves out
    assert timing == f"{baseline.duration:.6f} s, without jerk"
    assert number(rows["Segments"]) == len(planned.program.segments) == 1
    assert number(rows["Length of the path"]) == pytest.approx(2 * np.pi * 15, abs=5e-4)
    assert number(rows["Order"]) == planned.order == 3
    assert number(rows["Pulses"]) == sum(len(axis) for axis in planned.pulses.axes)
    assert number(rows["Highest pulse rate"]) == pytest.approx(verdict.highest_rate, abs=0.05)
    assert number(rows["Pulse check"]) == 0


def test_the_certificate_is_shown_with_bounds_that_are_bounds(page, planned):
    head, *rows = page.tables["certificate"]
    assert [row[0] for row in rows] == list(planned.certificate.worst)
    allowed = {row[0]: row[1] for row in rows}
    expected = {
        "speed": "20 mm/s",
        "acceleration": "225 mm/s²",
        "jerk": "4000 mm/s³",
        "tilt": "35 deg",
    }
    assert {name: allowed[name] for name in expected} == expected
    for row in rows:
        cells = dict(zip(head, row, strict=True))
        worst, where = planned.certificate.worst[row[0]], planned.certificate.where[row[0]]
        attained = planned.certificate.attained[row[0]].max()
        assert worst <= number(cells["proven ≤"]) <= worst + 1.01e-7
        assert attained - 1.01e-7 <= number(cells["attained ≥"]) <= attained
        assert (cells["at"], cells["segment"]) == (where.axis, str(where.segment))
        assert number(cells["s (mm)"]) == pytest.approx(1e3 * where.s, abs=5e-4)
        assert number(cells["t (s)"]) == pytest.approx(where.t, abs=5e-5)


def test_the_other_tables_show_the_plans_numbers(page, planned, baseline, metrics):
    _, *rows = page.tables["pulses"]
    for row, axis in zip(rows, planned.pulses.axes, strict=True):
        assert row[0] == axis.name
        assert [number(cell) for cell in row[1:5]] == [len(axis), 0.75, axis.start, axis.final]
    _, *rows = page.tables["limits"]
    # one limit or none is active at any time
    assert sum(number(row[1]) for row in rows) == pytest.approx(
        planned.trajectory.duration, abs=5e-4 * len(rows)
    )
    _, *rows = page.tables["tracking"]
    for row, series in zip(rows, [series for law in metrics for series in law.series], strict=True):
        assert row[1] == series.name
        expected = [1e6 * value for value in (series.rms, series.p95, series.max)]
        assert [number(cell) for cell in row[2:5]] == pytest.approx(expected, abs=0.05)
    durations = page.tables["classical"][1]
    assert [number(cell) for cell in durations[1:]] == pytest.approx(
        [planned.trajectory.duration, baseline.duration], abs=5e-5
    )
    jerk = {row[0]: row[2] for row in page.tables["classical"]}["jerk, proven ≤"]
    assert jerk == "not limited"


def test_names_are_escaped(tmp_path, planned, baseline, verdict):
    name = "</title><script>alert('x')</script> & \"quoted\""
    renamed = replace(planned, program=replace(planned.program, name=name))
    write_report(PlanReport(renamed, verdict, classical=baseline), tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    assert "<script>alert" not in text
    assert (
        text.count("<script") == 4
    )  # the data, uPlot, what draws with it, and what says how far it is read
    assert text.count("&lt;script&gt;alert(&#39;x&#39;)&lt;/script&gt; &amp; &#34;quoted&#34;") == 2
    # and without the pulses' path there is no part about it; without laws no table, but how to come
    # by one
    assert {"tracking", "realised"}.isdisjoint(Page(text).tables)
    assert {path.stem for path in (tmp_path / "figures").iterdir()} == FIGURES - {
        "tracking",
        "realised",
        "worth",
    }
    assert "pulsepath track DIR --rig RIG" in text


def test_the_machine_in_space_is_data_until_it_is_opened(tmp_path, planned, baseline, verdict):
    scene = "</script><script>alert('x')</script><p id='machine'>"
    write_report(
        PlanReport(planned, verdict, classical=baseline, figures={}, scene=scene),
        tmp_path / "report.html",
    )
    assert (
        "3-D" not in (tmp_path / "report.html").read_text()
    )  # without figures there is nothing to follow
    drawn = draw_axes(planned)
    write_report(
        PlanReport(planned, verdict, classical=baseline, figures=drawn, scene=scene),
        tmp_path / "report.html",
    )
    text = (tmp_path / "report.html").read_text()
    assert "<script>alert" not in text
    (held,) = re.findall(
        r'<script type="application/json" id="machine">(.*?)</script>', text, re.DOTALL
    )
    assert json.loads(held) == scene
    assert [a["content"] for t, a in Page(text).tags if a.get("http-equiv")] == [PLAYER_POLICY]
    assert not re.search("https?:|[*]|self", PLAYER_POLICY)


def test_what_was_simulated_behind_the_counts_is_told(text):
    assert "in the bound: leg1, leg2: play 2 (not) µm; leg3: play &lt;3&gt; (not) µm.</p>" in text


def test_the_path_of_the_pulses_is_told_with_its_bound(page, realised):
    _, *rows = page.tables["realised"]
    assert [row[0] for row in rows] == ["x", "y", "z", "rx", "ry", "rz", "position", "orientation"]
    for row, error in zip(rows, realised.errors, strict=True):
        assert [number(cell) for cell in row[1:4]] == pytest.approx(
            [1e6 * e for e in (error.rms, error.max, error.bound)], abs=5e-4
        )
        assert number(row[2]) <= number(row[3])
        assert row[5] == str(error.where)


def test_a_bound_is_rounded_up():
    assert round_up(1.00000001, 7) == "1.0000001"
    assert round_up(0.69, 2) == "0.69"
    assert round_up(float("inf"), 7) == "∞"


@pytest.mark.parametrize(
    ("quantity", "limits"),
    [
        ("position", [0, 50.8]),
        ("speed", [-20, 20]),
        ("acceleration", [-225, 225]),
        ("jerk", [-4e3, 4e3]),
    ],
)
def test_axes_are_drawn_between_their_limits(planned, quantity, limits):
    lines = axis_motion(planned, quantity).get_lines()
    drawn = [line.get_ydata() for line in lines if len(line.get_ydata()) > 2]
    bounds = sorted(line.get_ydata()[0] for line in lines if len(line.get_ydata()) == 2)
    assert len(drawn) == 6
    assert bounds == pytest.approx(limits)
    # within the certificate's tolerance of the limit
    slack = 1e-6 * max(np.abs(limits))
    assert min(map(np.min, drawn)) >= limits[0] - slack
    assert max(map(np.max, drawn)) <= limits[1] + slack
    if quantity != "position":
        assert max(np.abs(values).max() for values in drawn) >= 0.99 * limits[1]


def test_the_path_is_the_circle(planned):
    ax = path_in_space(planned)
    (line,) = [
        artist
        for artist in ax.collections
        if hasattr(artist, "get_array") and artist.get_array() is not None
    ][:1]
    points = np.array(line._segments3d).reshape(-1, 3)
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), 15, atol=1e-9)
    np.testing.assert_allclose(points[:, 2], 25, atol=1e-9)
    speed = np.asarray(line.get_array())
    state = planned.trajectory.at(np.linspace(0, planned.trajectory.duration, 1001))
    assert speed.max() == pytest.approx(1e3 * state.sd.max(), rel=1e-3)


def test_rates_add_up_to_the_pulses(planned):
    for line, axis in zip(pulse_rate(planned).get_lines(), planned.pulses.axes, strict=True):
        window = planned.pulses.duration / len(line.get_xdata())
        assert 1e3 * line.get_ydata().sum() * window == pytest.approx(len(axis), abs=1e-6)


def test_the_active_limit_is_at_its_bound(planned):
    active = active_limits(planned)
    names = [limit.name for limit in planned.limits]
    assert {names[n] for n in set(active) if n >= 0} <= {"speed", "acceleration", "jerk"}
    for n in set(active):
        chosen = active == n
        timed = [
            planned.certificate.use[limit.name][chosen]
            for limit in planned.limits
            if not limit.geometric
        ]
        if n < 0:
            assert np.max(timed) < 0.99
        else:
            assert planned.certificate.use[names[n]][chosen].min() >= 0.99


def test_a_ramp_to_the_largest_speed_is_held_by_acceleration():
    """20 mm along a slide: two ramps of v/a, and the rest of the way at v."""
    machine, speed, acceleration = load_machine("traverser"), 0.2, 3.0
    bounds = {"max_speed": speed, "max_acceleration": acceleration, "max_pulse_rate": None}
    found = plan(
        Program([Line([0.02, 0, 0])]),
        machine.driven_by([replace(axis, **bounds) for axis in machine.axes]),
        order=2,
    )
    active, lengths = active_limits(found), np.diff(found.trajectory.knots)
    held = {limit.name: lengths[active == n].sum() for n, limit in enumerate(found.limits)}
    assert held["acceleration"] == pytest.approx(2 * speed / acceleration, rel=0.01)
    assert held["speed"] == pytest.approx(0.02 / speed - speed / acceleration, rel=0.01)


def test_the_scrubber_shows_the_active_limit_of_every_instant(planned, monkeypatch):
    active, knots = active_limits(planned), planned.trajectory.knots
    names = [planned.limits[n].name if n >= 0 else "" for n in active]

    def shown(t):
        band = make_band(planned)
        begins, owners = zip(*band["runs"], strict=True)
        at = np.searchsorted(begins, t, side="right") - 1
        return [band["limits"][owners[k]]["name"] if owners[k] >= 0 else "" for k in at]

    assert shown((knots[1:] + knots[:-1]) / 2) == names
    line = planned.program.segments[0].line_number
    assert list_segments(planned) == [(0.0, f"segment 1 (arc), file line {line}")]
    # of a long motion, at so many instants
    monkeypatch.setattr("benchmarks.reports.timeline.MOST_RUNS", 50)
    middle = planned.trajectory.duration * (np.arange(50) + 0.5) / 50
    assert len(make_band(planned)["runs"]) <= 50
    assert shown(middle) == [names[k] for k in np.searchsorted(knots, middle, side="right") - 1]


def test_what_is_drawn_on_given_axes_stays_there(planned, metrics):
    ax = Figure().add_subplot()
    for law in metrics:
        assert contour_error(law, ax) is ax
    drawn = [line.get_ydata().max() for line in ax.get_lines()]
    assert drawn == pytest.approx([1e6 * law.contour.max for law in metrics])
    assert len(following_error(metrics[0]).get_lines()) == 6
    for over, end in (("path", 2 * np.pi * 15), ("time", planned.trajectory.duration)):
        ax = limit_use(planned, over=over)
        assert ax.get_xlim() == pytest.approx((0, end))
        legend = {text.get_text() for text in ax.get_legend().get_texts()}
        assert legend >= {limit.name for limit in planned.limits}


def test_a_segment_of_gcode_is_named_with_the_line_of_its_file(tmp_path):
    """ "line 1" would be the first segment, and a straight one, on line 4."""
    file = tmp_path / "part.nc"
    file.write_text("G21\nG90\n; a corner\nG1 X5 F600\nG1 Z5\n", encoding="utf-8")
    planned = plan(import_program(file).program, load_machine("cartesian"), order=2)
    assert [name for _, name in list_segments(planned)] == [
        "segment 1 (line), file line 4",
        "segment 2 (line), file line 5",
    ]
    columns = {column.title: list(column.raw) for column in tabulate_segments(planned).columns}
    assert columns["file line"] == [4, 5]


def test_a_dwell_is_a_segment_of_its_own_in_time():
    """Before, between and after what moves, and again in each repetition."""
    moves = [Dwell(0.25), Line(np.array([0, 0, 5e-3])), Dwell(0.5), Line(np.zeros(3))]
    planned = plan(
        Program(tuple(moves), name="rests", frame="home", repeat=2),
        load_machine("hexapod"),
        order=2,
    )
    motion, found = planned.trajectory, list_segments(planned)
    assert [name for _, name in found] == [
        "segment 1 (dwell)",
        "segment 2 (line)",
        "segment 3 (dwell)",
        "segment 4 (line)",
    ] * 2
    ends = [*(t for t, _ in found[1:]), motion.duration]
    for (begin, name), end in zip(found, ends, strict=True):
        resting = "dwell" in name
        assert (np.abs(motion.at(np.linspace(begin, end, 9)[1:-1]).sd).max() == 0) == resting
    assert [
        end - begin for (begin, name), end in zip(found, ends, strict=True) if "dwell" in name
    ] == pytest.approx([0.25, 0.5, 0.25, 0.5])


def test_a_limit_is_shown_as_it_is_where_it_is_used_most(tmp_path):
    """Of a room the ends of the axis that is there; of the tool's speed the cap of the segment that
    is there.
    """
    room = {"x": ["-60 mm", "60 mm"], "y": ["-60 mm", "60 mm"], "z": ["-10 mm", "12 mm"]}
    text = Path("kinematics/presets/corexy.toml").read_text()
    machine = tmp_path / "machine.toml"
    machine.write_text(
        re.sub(
            r"(?m)^room = .*", f"room = {str(room).replace(': [', ' = [')}".replace("'", '"'), text
        )
    )
    moves = [
        Line(np.array([0.0, 0, 11e-3]), speed=2e-3),
        Line(np.array([10e-3, 0, 11e-3]), speed=20e-3),
    ]
    planned = plan(Program(tuple(moves), name="lift"), load_machine(machine), order=2)
    write_report(
        PlanReport(
            planned,
            check(planned.pulses, planned.trajectory),
            classical=classical(planned),
            figures={},
        ),
        tmp_path / "report.html",
    )
    head, *rows = Page((tmp_path / "report.html").read_text()).tables["certificate"]
    shown = {row[0]: dict(zip(head, row, strict=True)) for row in rows}
    assert (shown["room"]["at"], shown["room"]["allowed"]) == ("z", "-10 … 12 mm")
    speeds = {"1": "2 mm/s", "2": "20 mm/s"}
    assert shown["tool speed"]["allowed"] == speeds[shown["tool speed"]["segment"]]


def test_without_figures_no_heading_is_empty_and_no_figure_is_told_of(
    tmp_path, planned, baseline, verdict
):
    write_report(
        PlanReport(planned, verdict, classical=baseline, figures={}), tmp_path / "report.html"
    )
    text = (tmp_path / "report.html").read_text()
    assert "The figure" not in text
    # between two headings, or a heading and the end of its section, something is said
    assert not re.search(r"</h[23]>\s*(?:</?section[^>]*>\s*)*<h[23]", text)
    for heading in ("The path", "The motion of the axes"):
        assert f">{heading}<" not in text
