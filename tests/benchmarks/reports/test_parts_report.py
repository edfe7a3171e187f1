"""The report of a plan in parts: its extremes are those of the motion, its band is what they use,
and it lives.
"""

import re
from base64 import b64decode
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.reports.plan_content import PlanReport
from benchmarks.reports.plan_figures import draw_axes
from benchmarks.reports.plan_report import write_report
from benchmarks.reports.time_series import pack_panels
from benchmarks.reports.timeline import list_window_segments, make_band, make_window_band
from benchmarks.reports.window_figures import draw
from kinematics import load_machine
from kinematics.foundation.line_styles import PALETTE
from planner import load_program, plan, plan_parts
from planner.active_limits import active_limits, name_segment
from planner.activity import Activity
from planner.figures import list_levels
from planner.limits.registry import AXIS_LIMITS, MACHINE_LIMITS, geometric_limits
from planner.limits.styles import style_limits
from planner.overview import Overview
from tests.browser import act_in, needs_browser

ACT = """
setTimeout(() => {
  const slider = document.querySelector("#strip input"), said = [];
  for (const share of [0.1, 0.5, 0.9]) {
    slider.value = share * slider.max;
    slider.dispatchEvent(new Event("input"));
    const first = document.querySelector(".uplot");
    said.push([document.querySelector("#strip output").textContent,
      Object.fromEntries([...first.querySelectorAll(".u-series")].map(row =>
        [row.querySelector(".u-label").textContent, row.querySelector(".u-value").textContent]))]);
  }
  fetch("/said", { method: "POST", body: JSON.stringify(said) });
}, 800);
"""


def capped():
    """The circle, with a tool so slow that this limit is active too."""
    program = load_program("bare-circle")
    return replace(program, segments=[replace(segment, speed=0.08) for segment in program.segments])


@pytest.fixture(scope="module")
def made():
    seen, held, motions = Overview(), Activity(capped()), []
    for part in plan_parts(capped(), load_machine("hexapod")):
        seen.add(part.motion, part.start.begin, part.start.length)
        held.add(part.motion, part.start.begin, part.limits)
        motions.append((part.start.begin, part.motion))
    return part.standing, seen, held, motions


@pytest.fixture(scope="module")
def page(made, tmp_path_factory):
    standing, seen, held, _ = made
    file = tmp_path_factory.mktemp("page") / "report.html"
    write_report(PlanReport(standing, overview=seen, activity=held), file)
    return file


def sample(motions, period):
    """q, qd of all parts at the instants that an overview looks at."""
    for begin, motion in motions:
        n = np.arange(np.ceil(begin / period), np.floor((begin + motion.duration) / period) + 1)
        t = np.clip(n * period - begin, 0, motion.duration)
        state = motion.at(t)
        yield from zip(t + begin, state.q, state.qd, state.qdd, state.qddd, strict=True)


def test_the_page_holds_the_extremes_of_every_window(made):
    standing, seen, held, motions = made  # one part, which is looked at as closely from end to end
    assert seen.period == seen.window / 2
    packed = pack_panels({"axes": draw(standing, seen, held)["axes"].panels})
    times = [np.frombuffer(b64decode(text), "<f4") for text in packed["times"]]
    machine = standing.machine
    rows = [np.array(each) for each in zip(*sample(motions, seen.period), strict=True)]
    for label, column, zero in (
        ("position (mm)", 1, machine.home_q),
        ("jerk (mm/s³)", 4, np.zeros(6)),
    ):
        (panel,) = [one for one in packed["figures"]["axes"] if one["label"] == label]
        for k, series in enumerate(panel["series"]):
            t, y = times[series["t"]], np.frombuffer(b64decode(series["y"]), "<f4")
            assert series["thinned"]
            assert t[-1] == pytest.approx(standing.duration, rel=1e-6)
            assert np.all(np.diff(t) >= 0)
            pairs = y[1:-1].reshape(-1, 2)
            for begin, both in zip(t[1:-1:2], pairs, strict=True):
                inside = rows[column][
                    (begin - 1e-5 <= rows[0]) & (rows[0] < begin + seen.window - 1e-5), k
                ]
                found = 1e3 * (np.array([inside.min(), inside.max()]) - zero[k])
                np.testing.assert_allclose(np.sort(both), found, rtol=1e-5, atol=1e-4)


def test_segments_begin_where_the_motion_comes_to_them(made):
    _, seen, held, motions = made
    begins = {}
    for begin, motion in motions:
        for knot, piece in zip(motion.knots[:-1], motion.piece, strict=True):
            number = motion.path.segment(int(piece))
            begins.setdefault(name_segment(number, held.program.segments[number - 1]), begin + knot)
    found = {name: t for t, name in list_window_segments(seen, held)}
    assert list(found) == list(begins)
    for name, t in found.items():
        assert 0 <= t - begins[name] <= seen.window + 1e-9


def test_the_band_has_the_colour_of_the_limit_that_is_active_as_in_a_plan_of_the_whole(made):
    standing, _, held, _ = made
    band, whole = make_window_band(held), plan(capped(), load_machine("hexapod"))
    names, begins = [one["name"] for one in band["limits"]], [begin for begin, _ in band["runs"]]
    active, knots = active_limits(whole), whole.trajectory.knots
    agree = total = 0.0
    for t in np.linspace(0, standing.duration, 4001)[:-1]:
        owner = band["runs"][np.searchsorted(begins, t + 1e-9, side="right") - 1][1]
        n = active[np.searchsorted(knots, t, side="right") - 1]
        agree += (names[owner] if owner >= 0 else None) == (
            whole.limits[n].name if n >= 0 else None
        )
        total += 1
    assert {"speed", "acceleration", "jerk", "tool speed"} >= set(names) >= {"jerk", "tool speed"}
    assert agree / total > 0.97  # windows of some ms, of which the longest limit has the colour


def test_axes_and_limits_have_the_colours_of_a_plan_of_the_whole(made):
    """In the figures, in the band, and as lines of limits; a limit of one axis has that of the
    axis.
    """
    standing, seen, held, _ = made
    whole = plan(capped(), load_machine("hexapod"))
    parts, figures = draw(standing, seen, held)["axes"].panels, draw_axes(whole)["axes"].panels
    for of in figures:
        (panel,) = [one for one in parts if one.label == of.label]
        assert [(one.name, one.color.lower()) for one in panel.series] == [
            (one.name, one.color) for one in of.series
        ]
        assert dict(panel.levels) == pytest.approx(dict(of.levels))
    in_parts, in_whole = (
        {one["name"]: one["color"] for one in band["limits"]}
        for band in (make_window_band(held), make_band(whole))
    )
    assert in_parts == in_whole
    assert {"jerk", "tool speed"} <= set(in_parts)
    (panel,) = [one for one in parts if one.label == "largest share of the limit"]
    assert {one.name: one.color for one in panel.series}.items() >= in_parts.items()


def test_no_two_limits_that_depend_on_timing_have_one_colour():
    known = [limit.name for limit in (*AXIS_LIMITS, *MACHINE_LIMITS)]
    styles = style_limits([name for name in known if name not in geometric_limits()])
    assert len({style["color"] for style in styles.values()}) == len(styles)
    assert style_limits(["own", "jerk"])["jerk"] == styles["jerk"]


def test_limits_of_two_directions_are_drawn_on_both_sides():
    axes = [replace(axis, max_speed=(0.01, 0.02)) for axis in load_machine("hexapod").axes]
    assert list_levels(axes, "speed", "linear") == [(-0.01, "#000000"), (0.02, "#000000")]
    axes[1] = replace(axes[1], max_speed=0.02)
    assert [color for _, color in list_levels(axes, "speed", "linear")] == [
        PALETTE[1],
        PALETTE[0],
        "#000000",
    ]


def test_a_limit_that_no_axis_has_is_in_the_figure(made):
    standing, seen, held, _ = made
    (panel,) = [
        one
        for one in draw(standing, seen, held)["axes"].panels
        if one.label == "largest share of the limit"
    ]
    (tool,) = [one for one in panel.series if one.name == "tool speed"]
    assert tool.values.max() == pytest.approx(1.0, abs=1e-3)


def test_one_window_alone_has_no_figure_of_windows(made):
    standing, seen, held, _ = made
    assert standing.windows == 1
    assert "limits" not in draw(standing, seen, held)


def test_the_page_lists_the_segments_with_what_limits_them(made, page):
    _, _, held, _ = made
    text = page.read_text(encoding="utf-8")
    for table in (held.tabulate_longest(), held.tabulate_limits()):
        for row in table.cells():
            for cell in filter(None, row):
                assert f">{cell}</t" in text


@needs_browser
def test_it_lives_in_a_browser_without_a_complaint(made, page, tmp_path):
    standing, seen, _, motions = made
    open_page = tmp_path / "report.html"
    text = page.read_text(encoding="utf-8")
    open_page.write_text(
        text.replace("; script-src", "; connect-src data:; script-src"), encoding="utf-8"
    )
    said, log = act_in(tmp_path, open_page, ACT)
    assert not re.search("CONSOLE|Uncaught|Refused|violates|Resize", log)
    ((_, motion),) = motions  # one part
    for share, (told, values) in zip((0.1, 0.5, 0.9), said, strict=True):
        t = float(told.split()[0])
        assert t == pytest.approx(share * standing.duration, abs=1e-3 * standing.duration)
        assert re.search("held by \\w|no limit is active", told)
        q = 1e3 * (motion.at(t).q[0] - standing.machine.home_q)
        for axis, place in zip(standing.machine.axes, q, strict=True):
            ends = [float(end) for end in values[axis.name].split(" … ")]
            # of the window, at 20 mm/s, as seen every so often
            assert min(ends) - 20 * seen.period <= place <= max(ends) + 20 * seen.period
    assert len(text.encode()) < 3e6
