"""The page: each finding on the rig as stated, then under every assumption."""

from collections.abc import Sequence

from benchmarks.compared import markdown
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
"""


def page(outcomes: Sequence[Outcome]) -> str:
    """Markdown; the first outcome is that of the rig as stated."""
    rows = [summary(finding, outcomes[0]) for finding in FINDINGS]
    parts = [INTRODUCTION, "## On the rig as stated", markdown(("finding", "verdict", "figure"), rows)]
    parts += [f"### {finding.name}\n\nJudged: {finding.judged}.\n\n{finding.because}" for finding in FINDINGS]
    parts.append("## What each assumption decides")
    parts.append(_overview(outcomes))
    parts += [f"### {finding.name}, by assumption\n\n{_by_assumption(finding, outcomes)}" for finding in FINDINGS]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def summary(finding: Finding, outcome: Outcome) -> tuple[str, str, str]:
    """A finding's line of the first table."""
    verdict = finding.judge(outcome)
    return finding.name, f"**{verdict.word}**", verdict.figure


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
