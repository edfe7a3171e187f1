"""The comparison with peers as a page: `python -m benchmarks.evidence.peers.page [--out docs/peers.md]`.

What was measured is read from docs/peers.csv, as `python -m benchmarks.evidence.peers` wrote it; what is said of the
peers stands in benchmarks/templates/peers.md.j2.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.evidence.peers.case import PeerAnswer
from benchmarks.evidence.peers.table import read_answers, verdicts
from benchmarks.evidence.published import compared as markdown_page
from benchmarks.evidence.published.compared import markdown

COMMAND = "python -m benchmarks.evidence.peers.page"
MEASURED_FILE = Path(__file__).parents[3] / "docs" / "peers.csv"
HEADER = ("method", "intervals", "time (ms)", "duration (s)", "most of a limit", "slowed to hold (s)", "above the best")


def tables(found: Sequence[PeerAnswer]) -> Iterator[str]:
    """One for each path and order."""
    for case, order in dict.fromkeys((a.case, a.order) for a in found):
        rows = [a for a in found if (a.case, a.order) == (case, order)]
        best = min(a.feasible for a in rows if a.feasible == a.feasible)
        limits = "speed and acceleration" if order == 2 else "speed, acceleration and jerk"
        yield f"### {case[0].upper()}{case[1:]}: {limits}"
        yield markdown(HEADER, [_cells(a, best) for a in rows])
        yield from (f"*No answer*: {note}." for note in dict.fromkeys(a.note for a in rows if a.duration != a.duration))


def _cells(a: PeerAnswer, best: float) -> list[str]:
    intervals = "" if a.intervals is None else str(a.intervals)
    if a.duration != a.duration:
        return [a.method, intervals, "", "no answer", "", "", ""]
    most, above = max(a.worst[: a.order]), 100 * (a.feasible / best - 1)
    time = f"{1e3 * a.again:.0f}" if a.again >= 0.1 else f"{1e3 * a.again:.3g}"
    numbers = time, f"{a.duration:.6f}", f"{most:.6f}", f"{a.feasible:.6f}", f"{above:.3f}\N{NO-BREAK SPACE}%"
    return [a.method, intervals, *numbers]


def page() -> str:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    found = read_answers(MEASURED_FILE)
    engine = Environment(loader=PackageLoader("benchmarks"), undefined=StrictUndefined, keep_trailing_newline=True)
    said = [f"- {line.strip()}." for line in verdicts(found)]
    text = engine.get_template("peers.md.j2").render(measured="\n\n".join(tables(found)), verdicts="\n".join(said))
    return str(text)


def main() -> None:
    markdown_page.run(str(__doc__), page)


if __name__ == "__main__":
    main()
