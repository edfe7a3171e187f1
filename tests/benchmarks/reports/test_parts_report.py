"""The report of a plan in parts: its extremes are those of the motion, its band is what they use, and it lives."""

import re
from base64 import b64decode

import numpy as np
import pytest

from benchmarks.reports.parts_report import USED_SHARE, draw, list_segments, make_band, write_report
from benchmarks.reports.time_series import pack_panels
from kinematics import load_machine
from planner import load_program
from planner.overview import ROW_PERIOD, Overview
from planner.plan_parts import plan_parts
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


@pytest.fixture(scope="module")
def made():
    seen, motions = Overview(), []
    for part in plan_parts(load_program("bare-circle"), load_machine("hexapod")):
        seen.add(part.motion, part.start.begin, part.start.length)
        motions.append((part.start.begin, part.motion))
    return part.standing, seen, motions


@pytest.fixture(scope="module")
def page(made, tmp_path_factory):
    standing, seen, _ = made
    file = tmp_path_factory.mktemp("page") / "report.html"
    write_report(standing, seen, None, file, figures=True)
    return file


def sample(motions):
    """q, qd of all parts at the instants that an overview looks at."""
    for begin, motion in motions:
        n = np.arange(np.ceil(begin / ROW_PERIOD), np.floor((begin + motion.duration) / ROW_PERIOD) + 1)
        t = np.clip(n * ROW_PERIOD - begin, 0, motion.duration)
        state = motion.at(t)
        yield from zip(t + begin, state.q, state.qd, state.qdd, state.qddd, strict=True)


def test_the_page_holds_the_extremes_of_every_window(made):
    standing, seen, motions = made
    packed = pack_panels({"axes": draw(standing, seen)["axes"].panels})
    times = [np.frombuffer(b64decode(text), "<f4") for text in packed["times"]]
    machine = standing.machine
    rows = [*sample(motions)]
    for label, column, zero in (("position (mm)", 1, machine.home_q), ("jerk (mm/s³)", 4, np.zeros(6))):
        (panel,) = [one for one in packed["figures"]["axes"] if one["label"] == label]
        for k, series in enumerate(panel["series"]):
            t, y = times[series["t"]], np.frombuffer(b64decode(series["y"]), "<f4")
            assert series["thinned"]
            assert t[-1] == pytest.approx(standing.duration, rel=1e-6)
            assert np.all(np.diff(t) >= 0)
            pairs = y[1:-1].reshape(-1, 2)
            for begin, both in zip(t[1:-1:2], pairs, strict=True):
                inside = [row[column][k] for row in rows if begin - 1e-5 <= row[0] < begin + seen.window - 1e-5]
                found = 1e3 * (np.array([min(inside), max(inside)]) - zero[k])
                np.testing.assert_allclose(np.sort(both), found, rtol=1e-5, atol=1e-4)


def test_segments_begin_where_the_motion_comes_to_them(made):
    _, seen, motions = made
    begins = {}
    for begin, motion in motions:
        for knot, piece in zip(motion.knots[:-1], motion.piece, strict=True):
            begins.setdefault(f"segment {motion.path.segment(int(piece))}", begin + knot)
    found = {name: t for t, name in list_segments(seen)}
    assert list(found) == list(begins)
    for name, t in found.items():
        assert 0 <= t - begins[name] <= seen.window + 1e-9


def test_the_band_has_the_colour_of_the_axis_limit_that_is_used_most(made):
    standing, seen, motions = made
    band, axes = make_band(standing, seen), standing.machine.axes
    begins = [begin for begin, _ in band["runs"]]
    used = {owner for _, owner in band["runs"]}
    assert {band["limits"][owner]["name"] for owner in used if owner >= 0} >= {"speed", "acceleration", "jerk"}
    bounds = [[getattr(axis, f"max_{one['name']}") for axis in axes] for one in band["limits"]]
    for t, _, *derivatives in sample(motions):
        shares = [np.max(np.abs(value) / bound) for value, bound in zip(derivatives, bounds, strict=True)]
        owner = band["runs"][np.searchsorted(begins, t + 1e-6, side="right") - 1][1]
        if owner < 0:
            assert max(shares) < USED_SHARE


@needs_browser
def test_it_lives_in_a_browser_without_a_complaint(made, page, tmp_path):
    standing, _, motions = made
    open_page = tmp_path / "report.html"
    text = page.read_text(encoding="utf-8")
    open_page.write_text(text.replace("; script-src", "; connect-src data:; script-src"), encoding="utf-8")
    said, log = act_in(tmp_path, open_page, ACT)
    assert not re.search("CONSOLE|Uncaught|Refused|violates|Resize", log)
    ((_, motion),) = motions  # one part
    for share, (told, values) in zip((0.1, 0.5, 0.9), said, strict=True):
        t = float(told.split()[0])
        assert t == pytest.approx(share * standing.duration, abs=1e-3 * standing.duration)
        assert re.search("most used limit of the axes: \\w|no limit of the axes", told)
        q = 1e3 * (motion.at(t).q[0] - standing.machine.home_q)
        for axis, place in zip(standing.machine.axes, q, strict=True):
            ends = [float(end) for end in values[axis.name].split(" … ")]
            # of the window of 20 ms, as seen every 10 ms
            assert min(ends) - 20 * ROW_PERIOD <= place <= max(ends) + 20 * ROW_PERIOD
    assert len(text.encode()) < 3e6
