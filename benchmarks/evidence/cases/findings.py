"""Findings of a thesis about its tracking laws, on the emulated rig: the page docs/findings.md.

Every law over its gains under every assumption: two to four minutes on one core.
"""

from collections.abc import Iterator, Mapping, Sequence

from benchmarks.evidence.table import Table
from benchmarks.evidence.thesis.assumptions import READINGS, STATED, assumptions
from benchmarks.evidence.thesis.findings import FINDINGS, Verdict
from benchmarks.evidence.thesis.outcome import Outcome, run_laws

COMMAND = "python -m benchmarks.evidence findings --out docs/findings.md"
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
sign, as Table 7.5 is written."""
NUMBERED = "Findings are numbered as in the table above; yes: the finding holds."

Verdicts = Mapping[str, Mapping[str, Verdict]]
"""Verdicts by finding and by assumption."""


def measure() -> Iterator[Table | str]:
    """Yield the page."""
    verdicts = judge([run_laws(assumption) for assumption in assumptions()])
    yield INTRODUCTION
    yield summarise(verdicts)
    yield Table(
        "Which reading of the printed program each finding needs",
        ("finding", *READINGS, "reading that it needs"),
        list_readings(verdicts),
        f"{NUMBERED} The figures are in the last part.",
    )
    yield "## Why"
    for finding in FINDINGS:
        yield f"### {finding.name}\n\nJudged: {finding.judged}.\n\n{finding.because}"
    numbers = map(str, range(1, len(FINDINGS) + 1))
    rows = [
        [name, *(answer(verdict[name]) for verdict in verdicts.values())]
        for name in verdicts[FINDINGS[0].name]
    ]
    yield Table("What each assumption decides", ("assumption", *numbers), rows, NUMBERED)
    for name, by_assumption in verdicts.items():
        yield f"### {name}, by assumption"
        figures = [(other, one.word, one.figure) for other, one in by_assumption.items()]
        yield Table("", ("assumption", "verdict", "figure"), figures)


def judge(outcomes: Sequence[Outcome]) -> Verdicts:
    """Return the verdicts on all findings."""
    return {
        finding.name: {one.assumption.name: finding.judge(one) for one in outcomes}
        for finding in FINDINGS
    }


def summarise(verdicts: Verdicts) -> Table:
    """Return the verdicts on the rig as stated."""
    stated = {name: by_assumption[STATED] for name, by_assumption in verdicts.items()}
    rows = [(name, f"**{one.word}**", one.figure) for name, one in stated.items()]
    return Table("On the rig as stated", ("finding", "verdict", "figure"), rows)


def list_readings(verdicts: Verdicts) -> Iterator[list[str]]:
    """Yield a row for each finding: verdicts with each reading, and the reading that it needs."""
    for number, by_assumption in enumerate(verdicts.values(), 1):
        answers = [answer(by_assumption[reading]) for reading in READINGS]
        holds = {name: verdict.holds for name, verdict in by_assumption.items()}
        yield [str(number), *answers, describe_need(holds)]


def answer(verdict: Verdict) -> str:
    """Return yes or no."""
    return "yes" if verdict.holds else "no"


def describe_need(holds: Mapping[str, bool]) -> str:
    """Return what a finding needs, from whether it holds under each assumption."""
    names = [name for name in holds if holds[name]]
    readings = [name for name in names if name in READINGS]
    if len(readings) == len(READINGS):
        return "none: it holds with each"
    if readings:
        return "; ".join(readings)
    if names:
        return f"another assumption: {'; '.join(names)}"
    return "none: no reading or assumption makes it hold"
