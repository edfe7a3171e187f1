"""The page: each finding on the rig as stated, then under every assumption."""

from collections.abc import Mapping, Sequence

from benchmarks.compared import markdown
from benchmarks.thesis.assumptions import READINGS
from benchmarks.thesis.findings import FINDINGS, Finding
from benchmarks.thesis.outcome import Outcome

COMMAND = "python -m benchmarks.thesis --out docs/findings.md"
INTRODUCTION = f"""\
# What the thesis found about its laws

[Sahbaz 2007] compares seven tracking algorithms on a rig of three AC servos. No curve of it is legible, so its findings
are orderings. Here each is put to the emulated rig `servo-rig`: does it hold, by what figure, and if not, why.
`{COMMAND}` makes this page.

The rig's parameters are the thesis' Table 7.4 and the motors' data sheets as they are remembered. What neither prints
is assumed; every assumption stands in `controllers/presets/servo-rig.toml` and was fixed before any law was run on the
rig. One thing has changed since: the range of the card's speed registers, 100 000 pulses/s, which the thesis prints,
was missing; *speeds that are not rounded to registers* is the rig as it was before. The second part shows what each
assumption decides, the semantics of the motion card above all: one is changed at a time. A law is judged at the best
gain of its grid on the thesis' straight line (5 s, 41 samples), by its RMS tracking error in space unless something
else is said. The laws' equations: [tracking laws](theory/laws.md); the drives': [drives and cards](theory/drives.md).

The program that ran the laws is printed in the thesis' Appendix E, and is followed where it says what it does: v(k − 1)
is `GetCurrentSpeed`, the card's own output rate and not a speed of the encoders; after the last sample every axis is
stopped within 1 ms (`SDStop`), and nothing is sent any more. Two things it calls without saying what they do:
`SetContinuousMove(axis, 1)`, for every axis before the first command, may make a command wait behind the running move
(in a queue of any length here: how many commands the card holds is not printed either) or let it replace that; and the
rate may be read with the sign of its direction or without. For the latter speaks that the program adds v(k − 1) where
npuls(k + 1) < 0. As stated: it replaces, and has a sign, as Table 7.5 is written.
"""


def page(outcomes: Sequence[Outcome]) -> str:
    """Markdown; the first outcome is that of the rig as stated."""
    rows = [summary(finding, outcomes[0]) for finding in FINDINGS]
    parts = [INTRODUCTION, "## On the rig as stated", markdown(("finding", "verdict", "figure"), rows)]
    parts += ["## Which reading of the printed program a finding needs", _readings(outcomes)]
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


def needed(verdicts: Mapping[str, bool]) -> str:
    """What a finding needs, from whether it holds under each assumption, the readings among them."""
    holds = [reading for reading in READINGS if verdicts[reading]]
    if len(holds) == len(READINGS):
        return "none: it holds under each"
    if holds:
        return "; ".join(holds)
    others = [name for name, held in verdicts.items() if held]
    return f"another assumption: {'; '.join(others)}" if others else "neither a reading nor another assumption helps"


def _readings(outcomes: Sequence[Outcome]) -> str:
    known = {outcome.assumption.name: outcome for outcome in outcomes}
    rows = []
    for n, finding in enumerate(FINDINGS, 1):
        verdicts = {name: finding.judge(outcome).holds for name, outcome in known.items()}
        rows.append((str(n), *("yes" if verdicts[reading] else "no" for reading in READINGS), needed(verdicts)))
    text = "Findings by their number in the table above; yes: it holds. Figures are in the last part."
    return f"{text}\n\n{markdown(('finding', *READINGS, 'reading that it needs'), rows)}"


def _overview(outcomes: Sequence[Outcome]) -> str:
    header = ("assumption", *(str(n + 1) for n in range(len(FINDINGS))))
    rows = [
        (outcome.assumption.name, *("yes" if finding.judge(outcome).holds else "no" for finding in FINDINGS))
        for outcome in outcomes
    ]
    return f"Findings by their number in the table above; yes: it holds.\n\n{markdown(header, rows)}"


def _by_assumption(finding: Finding, outcomes: Sequence[Outcome]) -> str:
    verdicts = ((outcome.assumption.name, finding.judge(outcome)) for outcome in outcomes)
    return markdown(
        ("assumption", "verdict", "figure"), [(name, verdict.word, verdict.figure) for name, verdict in verdicts]
    )
