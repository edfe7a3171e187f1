"""The page of findings is what its command prints, and its judgements can go either way."""

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.compared import markdown
from benchmarks.thesis.assumptions import assumptions
from benchmarks.thesis.findings import FINDINGS
from benchmarks.thesis.outcome import LAWS, Outcome, Setting, outcome
from benchmarks.thesis.page import COMMAND, summary

PAGE = Path(__file__).parents[2] / "docs" / "findings.md"


@pytest.fixture(scope="module")
def stated():
    """The rig as stated; all assumptions take minutes."""
    return outcome(assumptions()[0])


def test_the_committed_page_says_of_the_rig_as_stated_what_the_command_finds(stated):
    table = markdown(("finding", "verdict", "figure"), [summary(finding, stated) for finding in FINDINGS])
    assert table in PAGE.read_text(encoding="utf-8"), f"stale: {COMMAND}"


def test_the_page_covers_every_assumption_under_every_finding():
    text = PAGE.read_text(encoding="utf-8")
    for assumption in assumptions():
        # once in the overview, once under each finding
        assert text.count(f"\n| {assumption.name} |") == len(FINDINGS) + 1


def test_each_assumption_changes_the_rig_or_what_it_is_asked():
    stated, *others = assumptions()
    for other in others:
        assert other.rig != stated.rig or other.task is not stated.task, other.name


def judged(**errors):
    """Verdicts of made-up outcomes: one setting for each law, of an error in m, that arrives."""
    figures = {"vibration_power": 1.0, "jerk_rms": 1.0}
    settings = {
        law: tuple(
            Setting({"gain": gain, "speed_gain": 1.0}, {**figures, "tracking_rms": error}, 0.0)
            for gain, error in errors.get(f"law{law}", {0.7: 1e-3}).items()
        )
        for law in LAWS
    }
    return Outcome(assumptions()[0], settings)


def holds(made):
    return [finding.judge(made).holds for finding in FINDINGS]


def test_judgements_of_laws_that_are_all_alike():
    """Nothing is better, nothing unstable, no k is best, and all end on time."""
    assert holds(judged()) == [False, False, False, False, False, False, True]


def test_judgements_of_laws_as_the_thesis_has_them():
    curve = {0.1: 3e-3, 0.5: 1.05e-3, 0.7: 1e-3, 0.9: 1.09e-3, 1.0: 4e-3}
    lost = {0.7: 1.0}
    made = judged(law4=lost, law5=lost, law6=curve, law7=curve, law6r=curve, law7r=curve, law2={0.7: 2e-3})
    full = made.settings["3t"][0]
    shaken = {**made.settings, "3t": (replace(full, figures={**full.figures, "vibration_power": 4.0}),)}
    assert holds(replace(made, settings=shaken)) == [True] * len(FINDINGS)


def test_a_law_that_arrives_at_no_gain_is_not_on_time():
    made = judged(law5={0.5: 1e-3, 0.7: 1e-3})
    far, near = (replace(made.settings["5"][0], short=pulses) for pulses in (11.0, 9.0))
    for settings, holds in (((far, near), True), ((far, far), False)):
        verdict = FINDINGS[-1].judge(replace(made, settings={**made.settings, "5": settings}))
        assert verdict.holds == holds
    assert "5 11" in verdict.figure
