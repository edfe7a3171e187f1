"""The thesis' findings beside the emulated rig's, as a page: `python -m benchmarks.evidence.thesis.page
[--out docs/findings.md]`.

Every law over its gains under every assumption: two to four minutes on one core. A finding is a judgement of an
outcome: it says whether it holds there, and by which figure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from benchmarks.evidence.published.compared import markdown, run
from benchmarks.evidence.thesis.outcome import LATE_TIME, READINGS, LawSetting, Outcome, assumptions, run_laws
from controllers.metrics.metrics import END_BAND

GOOD_GAINS, BEST_GAINS = (0.5, 0.9), (0.6, 0.8)
"""Gains k that the thesis calls good, and what counts as near its best, 0.7."""
EQUAL_ERROR_RATIO = 1.01
"""Errors within one part in a hundred are no difference: repeated runs of a real rig would not tell them apart."""
LOST_ERROR_RATIO = 10.0
"""Times the error of the open loop (law 3) from which a law has lost the motion, which is called unstable here."""

UNCOVERED = 19
"""Pulses by which the way of the worst axis is more than the trapezoidal rule over its 41 sampled speeds."""


@dataclass(frozen=True, slots=True)
class FindingVerdict:
    """Whether a finding holds, and the figure that decides, in words."""

    holds: bool
    figure: str

    @property
    def word(self) -> str:
        return "holds" if self.holds else "does not hold"


@dataclass(frozen=True, slots=True)
class Finding:
    """What the thesis found; how it is judged here; and why it is so on the rig as stated."""

    name: str
    judged: str
    judge: Callable[[Outcome], FindingVerdict]
    because: str


def judge_error_loops(outcome: Outcome) -> FindingVerdict:
    ours, theirs = outcome.best("6", "7"), outcome.best("4", "5")
    return FindingVerdict(ours.error * EQUAL_ERROR_RATIO < theirs.error, f"{_um(ours)} against {_um(theirs)}")


def judge_instability(outcome: Outcome) -> FindingVerdict:
    plain = outcome.best("3").error
    four = next(setting for setting in outcome.settings["4"] if setting.gains["gain"] == 0.7)
    five = outcome.settings["5"]
    lost = [setting.error > LOST_ERROR_RATIO * plain for setting in (four, *five)]
    return FindingVerdict(
        all(lost),
        f"4 at 0.7: {_um(four)}; 5: {_um(min(five, key=_error))} at best; law 3: {1e6 * plain:.0f} µm",
    )


def judge_gains(outcome: Outcome) -> FindingVerdict:
    return _judge_gain_range(outcome, ("6", "7"))


def judge_repaired_gains(outcome: Outcome) -> FindingVerdict:
    return _judge_gain_range(outcome, ("6r", "7r"))


def judge_counter(outcome: Outcome) -> FindingVerdict:
    counter, sleep = outcome.best("1"), outcome.best("2")
    return FindingVerdict(counter.error * EQUAL_ERROR_RATIO < sleep.error, f"{_um(counter)} against {_um(sleep)}")


def judge_ramps(outcome: Outcome) -> FindingVerdict:
    ramp, full = (outcome.best(law).figures for law in ("3", "3t"))
    power = [1e6 * figures["vibration_power"] ** 0.5 for figures in (ramp, full)]
    jerk = [figures["jerk_rms"] for figures in (ramp, full)]
    return FindingVerdict(
        power[0] * EQUAL_ERROR_RATIO < power[1],
        f"{power[0]:.1f} against {power[1]:.1f} µrad; RMS jerk {jerk[0]:.0f} against {jerk[1]:.0f} rad/s³",
    )


def judge_end_times(outcome: Outcome) -> FindingVerdict:
    over = {law: min(setting.over for setting in outcome.settings[law]) for law in "1234567"}
    told = ", ".join(f"{law} {1e3 * abs(late):.0f}" for law, late in over.items())
    return FindingVerdict(max(over.values()) < outcome.assumption.task.dt, f"ms after the planned end: {told}")


def judge_arrival(outcome: Outcome) -> FindingVerdict:
    short = {law: min(setting.short for setting in outcome.settings[law]) for law in "1234567"}
    told = ", ".join(f"{law} {pulses:.0f}" for law, pulses in short.items())
    return FindingVerdict(max(short.values()) <= END_BAND, f"pulses from the goal: {told}")


def _judge_gain_range(outcome: Outcome, laws: tuple[str, ...]) -> FindingVerdict:
    """Best k near 0.7, good ones within 10 % of it, and the worst of the grid beyond them."""
    words, holds = [], True
    for law in laws:
        settings = outcome.settings[law]
        best, worst = min(settings, key=_error), max(settings, key=_error)
        good = [setting.error for setting in settings if GOOD_GAINS[0] <= setting.gains["gain"] <= GOOD_GAINS[1]]
        if worst.error < EQUAL_ERROR_RATIO * best.error:
            words.append(f"{law}: all k within {100 * (worst.error / best.error - 1):.2f} %")
            holds = False
            continue
        near = BEST_GAINS[0] <= best.gains["gain"] <= BEST_GAINS[1]
        holds = holds and near and max(good) <= 1.1 * best.error
        words.append(
            f"{law}: best k {best.gains['gain']:g} ({_um(best)}), worst of 0.5 to 0.9 {1e6 * max(good):.0f} µm, "
            f"worst of all {_um(worst)}"
        )
    return FindingVerdict(holds, "; ".join(words))


def _error(setting: LawSetting) -> float:
    return setting.error


def _um(setting: LawSetting) -> str:
    return f"{1e6 * setting.error:.0f} µm"


FINDINGS = (
    Finding(
        "Laws 6 and 7 are better than 4 and 5",
        "the least RMS tracking error over the gains of each pair; better by more than 1 %",
        judge_error_loops,
        "Laws 4 and 5 send the error itself as an absolute target. Once the axis follows well, the error is near "
        "zero, so they drive the axis back to zero.",
    ),
    Finding(
        "Law 4 (kp = 0.7) and law 5 are unstable",
        "their RMS tracking error is over ten times that of the open loop (law 3), with every gain of 5",
        judge_instability,
        "They lose the motion for the reason above. The loop does not oscillate with growing amplitude: the speeds are "
        "those of the reference, so the card never runs away.",
    ),
    Finding(
        "Laws 6 and 7 behave well for k from 0.5 to 0.9, best near 0.7",
        "the best k is from 0.6 to 0.8, and the error with k from 0.5 to 0.9 is within 10 % of the best",
        judge_gains,
        "The top speed npuls(k+1) in the thesis' table prevents catching up: a target further ahead is reached no "
        "sooner within the step. So k makes hardly any difference where the axis does not reverse, and makes things"
        " worse where it does.",
    ),
    Finding(
        "The same for 6r and 7r, our repaired versions, whose top speed includes the correction",
        "as above",
        judge_repaired_gains,
        "These are not the thesis' laws, but what they may have been meant to be. With the correction in the speed, k "
        "matters, and the error falls up to k = 1, the largest value tried. None of the assumptions below explains why "
        "the thesis found the best k at 0.7.",
    ),
    Finding(
        "The card's counter is better than the operating system's sleep",
        "the RMS tracking error of law 1 is more than 1 % less than that of law 2",
        judge_counter,
        "Every sleep ends late by up to one tick of the system's timer, and the delays add up over the steps.",
    ),
    Finding(
        "Ramps as long as the sample shake the shaft less than full trapezoids",
        "the worst axis' RMS following error at frequencies from the host's sample rate up, law 3 against law 3t",
        judge_ramps,
        "A full trapezoid stops the axis at every sample. The jerk is listed too, but does not decide: with "
        "backlash in the gear, it comes from the teeth meeting, which takes no time in this model; without backlash"
        " it leads to the same verdict.",
    ),
    Finding(
        "Every algorithm ends on time",
        "the closing stop, at which the thesis' program prints the time counted by its card, is sent less than one "
        "sample after the planned end. The thesis states no tolerance; one sample is our choice",
        judge_end_times,
        "The stop comes after the last sample, whatever a law does and wherever its axes are. So if the host "
        "watches the card's counter, every law is on time by definition. Law 2 is late by the sum of its delays: "
        "with a 1 ms timer, by less than a sample.",
    ),
    Finding(
        "The motors end where the reference ends",
        f"all axes are within {END_BAND:g} pulses (0.024°) of their goal {LATE_TIME} s after the planned end, "
        "with the law's best gain. The criterion is ours: the thesis states none",
        judge_arrival,
        "Laws 4 and 5 have lost the position, and law 2 is late. The speed is curved, and straight ramps from "
        f"sample to sample cover {UNCOVERED} pulses less than the motion. In the other laws no later command is fast"
        " enough to make up for that: the last has no speed, and would run at one step of the registers, 1.5 "
        "pulses/s, if the closing stop allowed it. Half of the gear's backlash, 7 pulses, adds to this: an encoder "
        "on the motor does not see it.",
    ),
)
"""What the thesis found, in its chapter 7 [Sahbaz 2007]."""


COMMAND = "python -m benchmarks.evidence.thesis.page --out docs/findings.md"
INTRODUCTION = f"""\
# Do the thesis' findings hold?

[Sahbaz 2007] compares seven tracking algorithms on a rig of three AC servos. Its curves are not legible, so its
findings only rank the algorithms. This page tests each finding on the emulated rig `servo-rig`: does it hold, by
which figure, and if not, why? `{COMMAND}` writes this page.

The rig's parameters come from the thesis' Table 7.4 and, from memory, the motors' data sheets. What neither states is
assumed; `controllers/presets/servo-rig.toml` lists every assumption. All were fixed before any law was run on the
rig, with one correction since: the range of the card's speed registers, 100 000 pulses/s, which the thesis states,
was missing. *Speeds that are not rounded to registers* is the rig as it was before. The second part shows what each
assumption decides, above all the behaviour of the motion card: one assumption is changed at a time. A law is judged
with the best gain of its grid on the thesis' straight line (5 s, 41 samples), by its RMS tracking error in space
unless stated otherwise. See [tracking laws](theory/laws.md) for the equations, and [drives and
cards](theory/drives.md) for the drives.

The program that ran the laws is printed in the thesis' Appendix E, and we follow it where it is clear: v(k − 1) is
`GetCurrentSpeed`, the card's own output rate, not a speed from the encoders; after the last sample every axis is
stopped within 1 ms (`SDStop`), and nothing more is sent. The behaviour of two calls is not stated.
`SetContinuousMove(axis, 1)`, called for every axis before the first command, may make a command wait for the current
move to end or replace it. (Here the queue has any length: how many commands the card holds is not stated either.) And
`GetCurrentSpeed` may return the rate with or without the sign of its direction. One line supports the latter: the
program adds v(k − 1) where npuls(k + 1) < 0. *As stated* means that a command replaces the move, and the rate has a
sign, as Table 7.5 is written.
"""


def page(outcomes: Sequence[Outcome]) -> str:
    """Markdown; the first outcome is that of the rig as stated."""
    rows = [summary(finding, outcomes[0]) for finding in FINDINGS]
    parts = [INTRODUCTION, "## On the rig as stated", markdown(("finding", "verdict", "figure"), rows)]
    parts += ["## Which reading of the printed program each finding needs", _readings(outcomes)]
    parts.append("## Why")
    parts += [f"### {finding.name}\n\nJudged: {finding.judged}.\n\n{finding.because}" for finding in FINDINGS]
    parts.append("## What each assumption decides")
    parts.append(_overview(outcomes))
    parts += [f"### {finding.name}, by assumption\n\n{_by_assumption(finding, outcomes)}" for finding in FINDINGS]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def summary(finding: Finding, outcome: Outcome) -> tuple[str, str, str]:
    """A finding's line of the first table."""
    verdict = finding.judge(outcome)
    return finding.name, f"**{verdict.word}**", verdict.figure


def describe_need(verdicts: Mapping[str, bool]) -> str:
    """What a finding needs, from whether it holds under each assumption, the readings among them."""
    holds = [reading for reading in READINGS if verdicts[reading]]
    if len(holds) == len(READINGS):
        return "none: it holds with each"
    if holds:
        return "; ".join(holds)
    others = [name for name, held in verdicts.items() if held]
    return f"another assumption: {'; '.join(others)}" if others else "none: no reading or assumption makes it hold"


def _readings(outcomes: Sequence[Outcome]) -> str:
    known = {outcome.assumption.name: outcome for outcome in outcomes}
    rows = []
    for n, finding in enumerate(FINDINGS, 1):
        verdicts = {name: finding.judge(outcome).holds for name, outcome in known.items()}
        rows.append((str(n), *("yes" if verdicts[reading] else "no" for reading in READINGS), describe_need(verdicts)))
    text = "Findings are numbered as in the table above; yes: the finding holds. The figures are in the last part."
    return f"{text}\n\n{markdown(('finding', *READINGS, 'reading that it needs'), rows)}"


def _overview(outcomes: Sequence[Outcome]) -> str:
    header = ("assumption", *(str(n + 1) for n in range(len(FINDINGS))))
    rows = [
        (outcome.assumption.name, *("yes" if finding.judge(outcome).holds else "no" for finding in FINDINGS))
        for outcome in outcomes
    ]
    return f"Findings are numbered as in the table above; yes: the finding holds.\n\n{markdown(header, rows)}"


def _by_assumption(finding: Finding, outcomes: Sequence[Outcome]) -> str:
    verdicts = ((outcome.assumption.name, finding.judge(outcome)) for outcome in outcomes)
    return markdown(
        ("assumption", "verdict", "figure"), [(name, verdict.word, verdict.figure) for name, verdict in verdicts]
    )


def main() -> None:
    run(str(__doc__), lambda: page([run_laws(assumption) for assumption in assumptions()]))


if __name__ == "__main__":
    main()
