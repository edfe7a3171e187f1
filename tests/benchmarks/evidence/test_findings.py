"""The page of findings is what its command prints, and its judgements can go either way."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.evidence.cases.findings import COMMAND, describe_need, judge, summarise
from benchmarks.evidence.thesis.assumptions import READINGS, assumptions
from benchmarks.evidence.thesis.findings import FINDINGS, UNCOVERED
from benchmarks.evidence.thesis.outcome import LAWS, LawSetting, Outcome, run_laws
from controllers.simulate import sample

PAGE = Path(__file__).parents[3] / "docs" / "findings.md"


@pytest.fixture(scope="module")
def stated():
    """The rig as stated; all assumptions take minutes."""
    return run_laws(assumptions()[0])


def test_the_committed_page_says_of_the_rig_as_stated_what_the_command_finds(stated):
    table = str(summarise(judge([stated])))
    assert table in PAGE.read_text(encoding="utf-8"), f"stale: {COMMAND}"


def test_the_page_covers_every_assumption_under_every_finding():
    text = PAGE.read_text(encoding="utf-8")
    for assumption in assumptions():
        # once in the overview, once under each finding
        assert text.count(f"\n| {assumption.name} |") == len(FINDINGS) + 1


def test_the_rig_as_stated_reads_and_ends_as_the_printed_program_and_each_reading_is_run():
    """[Sahbaz 2007, Appendix E]: GetCurrentSpeed and SDStop(axis, 0.001); SetContinuousMove has two
    readings.
    """
    stated, *others = assumptions()
    assert (stated.rig.host.speed_from, stated.rig.host.closing_stop) == ("card", 0.001)
    known = {assumption.name: assumption.rig.card for assumption in (stated, *others)}
    read = [(known[reading].while_moving, known[reading].current_speed) for reading in READINGS]
    assert read == [
        ("replace", "signed"),
        ("queue", "signed"),
        ("replace", "magnitude"),
        ("queue", "magnitude"),
    ]


def test_what_a_finding_needs_is_said_of_the_readings_under_which_it_holds():
    none = dict.fromkeys((*READINGS, "drives 5 ms late"), False)
    assert describe_need(none) == "none: no reading or assumption makes it hold"
    assert (
        describe_need(none | {"drives 5 ms late": True}) == "another assumption: drives 5 ms late"
    )
    assert (
        describe_need(none | {READINGS[1]: True, READINGS[3]: True})
        == f"{READINGS[1]}; {READINGS[3]}"
    )
    assert describe_need(none | dict.fromkeys(READINGS, True)) == "none: it holds with each"


def test_each_assumption_changes_the_rig_or_what_it_is_asked():
    stated, *others = assumptions()
    for other in others:
        assert other.rig != stated.rig or other.task is not stated.task, other.name


def test_the_ramps_between_samples_cover_as_much_less_than_the_motion_as_the_page_says():
    stated = assumptions()[0]
    reference = sample(stated.task.motion, stated.rig.machine, stated.task.dt)
    covered = np.trapezoid(reference.speed, dx=reference.dt, axis=0)
    short = np.abs(reference.position[-1] - reference.position[0] - covered)
    assert short.max() == pytest.approx(UNCOVERED, abs=0.5)


def judged(**errors):
    """Verdicts of made-up outcomes: one setting for each law, of an error in m, that arrives."""
    figures = {"vibration_power": 1.0, "jerk_rms": 1.0}
    settings = {
        law: tuple(
            LawSetting({"gain": gain, "speed_gain": 1.0}, {**figures, "tracking_rms": error}, 0.0)
            for gain, error in errors.get(f"law{law}", {0.7: 1e-3}).items()
        )
        for law in LAWS
    }
    return Outcome(assumptions()[0], settings)


def holds(made):
    return [finding.judge(made).holds for finding in FINDINGS]


def test_judgements_of_laws_that_are_all_alike():
    """Nothing is better, nothing unstable, no k is best; all end on time, and where they should."""
    assert holds(judged()) == [False, False, False, False, False, False, True, True]


def test_judgements_of_laws_as_the_thesis_has_them():
    curve = {0.1: 3e-3, 0.5: 1.05e-3, 0.7: 1e-3, 0.9: 1.09e-3, 1.0: 4e-3}
    lost = {0.7: 1.0}
    made = judged(
        law4=lost, law5=lost, law6=curve, law7=curve, law6r=curve, law7r=curve, law2={0.7: 2e-3}
    )
    full = made.settings["3t"][0]
    shaken = {
        **made.settings,
        "3t": (replace(full, figures={**full.figures, "vibration_power": 4.0}),),
    }
    assert holds(replace(made, settings=shaken)) == [True] * len(FINDINGS)


def test_a_law_that_arrives_at_no_gain_does_not_end_where_the_reference_does():
    made = judged(law5={0.5: 1e-3, 0.7: 1e-3})
    far, near = (replace(made.settings["5"][0], distance=pulses) for pulses in (11.0, 9.0))
    for settings, holds in (((far, near), True), ((far, far), False)):
        verdict = FINDINGS[-1].judge(replace(made, settings={**made.settings, "5": settings}))
        assert verdict.holds == holds
    assert "5 11" in verdict.figure


def test_a_law_whose_host_is_a_sample_late_is_not_on_time():
    made = judged()
    for delay, holds in ((0.124, True), (0.126, False)):
        late = tuple(replace(setting, delay=delay) for setting in made.settings["2"])
        verdict = FINDINGS[-2].judge(replace(made, settings={**made.settings, "2": late}))
        assert (verdict.holds, f"2 {1e3 * delay:.0f}," in verdict.figure) == (holds, True)
