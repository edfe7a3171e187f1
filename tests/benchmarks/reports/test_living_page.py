"""The report in a browser: figures, scrubber and legend follow each other, and show the plan's own
values.
"""

import re

import numpy as np
import pytest

from benchmarks.animation.animate import document
from benchmarks.reports.plan_content import PlanReport
from benchmarks.reports.plan_report import write_report
from kinematics import load_machine
from planner import Line, Program, classical, plan
from planner.pulses import check
from tests.browser import act_in, browse, needs_browser

WHEN, FRAMES = 0.5, 40
"""s at which the page is read; frames of the machine in space."""
ACT = """
const said = {}, slider = document.querySelector("#strip input"), output = document.querySelector("#strip output");
const text = (row, part) => row.querySelector(part).textContent, frame = () => new Promise(requestAnimationFrame);
const pause = async () => { await new Promise(go => setTimeout(go, 60)); await frame(); };
const rows = (of = document) => [...of.querySelectorAll(".u-series")];
const over = document.querySelector(".u-over"), box = over.getBoundingClientRect();
const at = (type, share, on = over) => on.dispatchEvent(new MouseEvent(type, {
  bubbles: true, button: 0, clientX: box.left + share * box.width, clientY: box.top + 20, movementX: 9 }));
(async () => {
  const put = when => {
    slider.value = Math.round(when / DURATION * slider.max);
    slider.dispatchEvent(new Event("input"));
  };
  put(DURATION);
  said.last = output.textContent;
  put(WHEN);
  await pause();
  Object.assign(said, { at: slider.valueAsNumber / slider.max * DURATION,
    text: output.textContent, spoken: slider.ariaValueText });
  said.legends = [...document.querySelectorAll(".uplot")].map(one => [text(one, ".u-title"),
    Object.fromEntries(rows(one).map(row => [text(row, ".u-label"), text(row, ".u-value")]))]);
  rows().find(row => text(row, ".u-label") === "leg2").querySelector("th").click();
  said.off = rows().filter(row => row.classList.contains("u-off")).map(row => text(row, ".u-label"));
  for (const [type, share] of [["mouseenter", 0.25], ["mousemove", 0.25], ["mousedown", 0.25]]) at(type, share);
  at("mousemove", 0.75);
  at("mouseup", 0.75, document);
  await pause();
  const ends = () => [0, slider.max].map(place => {
    slider.value = place;
    slider.dispatchEvent(new Event("input"));
    return parseFloat(output.textContent);
  });
  said.zoomed = ends();
  at("dblclick", 0.5);
  await pause();
  said.whole = ends();
  document.querySelector("#space button").click();
  const inside = document.querySelector("#space iframe"), part = what => inside.contentDocument.querySelector(what);
  for (let tries = 0; tries < 200 && !part("input[inputmode=decimal]"); tries++) await pause();
  for (const [name, when] of [["late", 1.0], ["early", 0.25]]) {
    const far = () => Math.abs(parseFloat(part("#when")?.textContent) - when) > STEP;
    put(when);
    for (let tries = 0; tries < 200 && far(); tries++) await pause();
    said[name] = part("#when")?.textContent;
  }
  fetch("/said", { method: "POST", body: JSON.stringify(said) });
})();
"""
CARDS = """
addEventListener("load", () => setTimeout(() => {
  const tables = [...document.querySelectorAll("table.stack")];
  const cells = tables.flatMap(one => [...one.querySelectorAll("tbody td")]);
  const seen = cells.filter(one => one.offsetHeight).map(one => ({ said: getComputedStyle(one, "::before").content,
    right: one.getBoundingClientRect().right, wide: one.scrollWidth - one.clientWidth }));
  const width = document.documentElement.scrollWidth;
  fetch("/said", { method: "POST", body: JSON.stringify({ seen, width, scrolls: tables.filter(one =>
    one.parentNode.scrollWidth > one.parentNode.clientWidth).map(one => one.textContent.trim().slice(0, 40)) }) });
}, 200));
"""
TICKS = """
setTimeout(() => {
  const said = [], fill = CanvasRenderingContext2D.prototype.fillText;
  CanvasRenderingContext2D.prototype.fillText = function (text, ...at) {
    said.push(text);
    return fill.call(this, text, ...at);
  };
  dispatchEvent(new Event("resize"));
  document.querySelectorAll(".living").forEach(one => one.style.width = "600px");
  setTimeout(() => {
    const values = [...document.querySelectorAll(".u-value")].map(one => one.textContent);
    const now = document.querySelector("#strip output").textContent;
    fetch("/said", { method: "POST", body: JSON.stringify([said, now, values]) });
  }, 500);
}, 500);
"""
MEASURE = """
addEventListener("load", () => setTimeout(() => fetch("/said", {
  method: "POST", body: JSON.stringify(document.documentElement.scrollWidth) }), 200));
"""


@pytest.fixture(scope="module")
def planned(plan_bundled):
    return plan_bundled("bare-circle", "hexapod", 3)


@pytest.fixture(scope="module")
def page(planned, tmp_path_factory):
    file = tmp_path_factory.mktemp("page") / "report.html"
    verdict = check(planned.pulses, planned.trajectory)
    write_report(
        PlanReport(
            planned,
            verdict,
            classical=classical(planned),
            realised=planned.realised(stride=1000),
            worth=planned.worth,
            scene=document(planned, FRAMES),
        ),
        file,
    )
    return file


@needs_browser
def test_cursor_zoom_and_legend_hold_for_all_figures(planned, page, tmp_path):
    duration = planned.trajectory.duration
    act = (
        ACT.replace("WHEN", str(WHEN))
        .replace("STEP", str(2 / FRAMES))
        .replace("DURATION", str(duration))
    )
    said, log = act_in(tmp_path, page, act)
    assert not re.search("CONSOLE(?!.*GL Driver Message)|Uncaught|Refused|violates|Resize", log)
    assert said["last"].startswith(f"{duration:.4f} s")
    assert said["at"] == pytest.approx(WHEN, abs=duration / 2000)
    assert said["text"] == said["spoken"]
    assert re.match(
        r"0\.\d{4} s · segment 1 \(arc\)(, file line \d+)? · (held by \w|no limit)", said["text"]
    )
    figures = dict(said["legends"])
    state = planned.trajectory.at(WHEN)
    # between two instants that are drawn, values move by less than their derivative's limit times
    # the step
    step = duration / 1000
    for label, values, rate in (
        ("position (mm)", state.q[0] - planned.machine.home_q, 20),
        ("speed (mm/s)", state.qd[0], 225),
        ("acceleration (mm/s²)", state.qdd[0], 4000),
    ):
        shown = [float(figures[label][axis.name]) for axis in planned.machine.axes]
        np.testing.assert_allclose(shown, 1e3 * values, rtol=0, atol=rate * step + 1e-4)
    # one click hides the axis in all five figures of axes: four of motion, one of pulses
    assert said["off"] == ["leg2"] * 5
    assert said["zoomed"] == pytest.approx([0.25 * duration, 0.75 * duration], rel=0.02)
    assert said["whole"] == pytest.approx([0, duration], abs=1e-4)
    # the machine in space stands at the frame of that time, onwards and back
    for name, when in (("late", 1.0), ("early", 0.25)):
        assert float(said[name].split()[0]) == pytest.approx(
            when, abs=1.01 * duration / (FRAMES - 1)
        )


@needs_browser
def test_nothing_is_wider_than_the_window(page, tmp_path):
    said, _ = act_in(tmp_path, page, MEASURE, "800,900", "--hide-scrollbars")
    assert said == 800


@needs_browser
def test_on_a_phone_every_number_of_a_wide_table_is_seen_with_what_it_is(page, tmp_path):
    """Rows are cards there: nothing is beyond the edge, and each cell has the title of its
    column.
    """
    said, _ = act_in(tmp_path, page, CARDS, "500,900", "--hide-scrollbars")
    assert said["scrolls"] == []
    assert said["width"] == 500
    told = {cell["said"].strip('"') for cell in said["seen"]}
    assert told >= {
        "saved (ms)",
        "largest at",
        "proven ≤",
        "s (mm)",
        "mean speed (mm/s)",
        "stated error (pulses)",
    }
    assert all(cell["said"] not in ("none", '""') for cell in said["seen"])
    assert max(cell["right"] for cell in said["seen"]) <= 500
    assert max(cell["wide"] for cell in said["seen"]) <= 0


@needs_browser
def test_ticks_and_times_of_a_motion_of_a_millisecond_are_told_apart(tmp_path):
    """Ticks have as many decimals as their steps, and what is 0 throughout is 0."""
    brief = plan(
        Program([Line(np.array([1e-8, 0.0, 0.0]))], name="brief"), load_machine("traverser")
    )
    assert brief.duration < 5e-3
    file = tmp_path / "report.html"
    verdict = check(brief.pulses, brief.trajectory)
    write_report(
        PlanReport(brief, verdict, classical=classical(brief), scene=document(brief, 2)), file
    )
    (drawn, now, values), log = act_in(tmp_path, file, TICKS)
    assert "Uncaught" not in log
    ticks = [text for text in drawn if re.fullmatch(r"0\.00\d+", text)]
    assert len(set(ticks)) > 3
    assert now.startswith("0.000000")
    assert not [value for value in values if value.startswith("0.000e")]


@needs_browser
def test_print_shows_the_still_figures(page, tmp_path):
    """Without scripts, as when printed, nothing of what a script draws is there."""
    text = page.read_text(encoding="utf-8")
    assert text.count("<figure data-figure=") == text.count("data:image/png;base64,") > 3
    pdf = tmp_path / "page.pdf"
    printed = browse(tmp_path, page, f"--print-to-pdf={pdf}", "--no-pdf-header-footer")
    assert "CONSOLE" not in printed.stderr
    content = pdf.read_bytes()
    assert content.startswith(b"%PDF")
    assert len(re.findall(rb"/Subtype\s*/Image", content)) >= text.count("<figure data-figure=")
