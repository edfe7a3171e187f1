"""The comparison with peers as a page: `python -m benchmarks.evidence.peers.page [--out docs/peers.md]`.

What was measured is read from docs/peers.csv, as `python -m benchmarks.evidence.peers` wrote it; what is said of the
peers stands beside this file, in peers.md.j2.
"""

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.evidence.peers.case import PeerAnswer
from benchmarks.evidence.published.compared import markdown, run

ANSWER_HEADER = (
    "case", "order", "method", "intervals", "first call (s)", "again (s)", "duration (s)",
    "speed", "acceleration", "jerk", "duration slowed to hold (s)", "remark",
)  # fmt: skip
# How near to the best certified duration counts as close.
CLOSE_SHARE = 1e-3


def cells(a: PeerAnswer) -> list[str]:
    intervals = "" if a.intervals is None else str(a.intervals)
    numbers = [f"{a.first:.4f}", f"{a.again:.4f}", f"{a.duration:.6f}", *(f"{use:.6f}" for use in a.worst)]
    return [a.case, str(a.order), a.method, intervals, *numbers, f"{a.feasible:.6f}", a.note]


def read_answers(path: Path) -> list[PeerAnswer]:
    """The answers of a file of such rows; what follows from the others is worked out anew."""
    with path.open(newline="", encoding="utf-8") as file:
        _, *rows = csv.reader(file)
    return [
        PeerAnswer(
            case,
            int(order),
            method,
            int(intervals) if intervals else None,
            float(first),
            float(again),
            float(duration),
            (float(speed), float(acceleration), float(jerk)),
            note,
        )
        for case, order, method, intervals, first, again, duration, speed, acceleration, jerk, _, note in rows
    ]


def verdicts(found: Sequence[PeerAnswer]) -> Iterator[str]:
    """Per curved case, how fast the peers come within a thousandth of the best order-3 motion that holds."""
    for name in dict.fromkeys(a.case for a in found):
        third = [a for a in found if a.case == name and a.order == 3]
        ours, peers = third[0], [a for a in third if a.method.startswith("copp")]
        durations = [a.feasible for a in third if a.feasible == a.feasible]
        if not peers or not durations:
            continue
        best = min(durations)
        yield (
            f"{name}, order 3: best known {best:.6f} s; ours {100 * (ours.feasible / best - 1):.3f} % above it; "
            f"building the problem, once per process: {max(0.0, ours.first - ours.again):.3f} s"
        )
        near = [a for a in peers if a.feasible <= best * (1 + CLOSE_SHARE)]
        if near:
            fastest = min(near, key=lambda a: a.again)
            yield (
                f"  copp-py's fastest within {CLOSE_SHARE:.1%}: {fastest.again:.3f} s ({fastest.method}, "
                f"{fastest.intervals} intervals); ours with certificate {ours.again:.3f} s, "
                f"{ours.again / fastest.again:.2f} of it"
            )
        else:
            closest = min((a for a in peers if a.feasible == a.feasible), key=lambda a: a.feasible, default=None)
            if closest is not None:
                yield (
                    f"  no copp-py run within {CLOSE_SHARE:.1%}; the closest {100 * (closest.feasible / best - 1):.3f} "
                    f"% above, in {closest.again:.3f} s; ours with certificate {ours.again:.3f} s"
                )


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
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    found = read_answers(MEASURED_FILE)
    loader = FileSystemLoader(Path(__file__).parent)
    engine = Environment(loader=loader, undefined=StrictUndefined, keep_trailing_newline=True)
    said = [f"- {line.strip()}." for line in verdicts(found)]
    text = engine.get_template("peers.md.j2").render(measured="\n\n".join(tables(found)), verdicts="\n".join(said))
    return str(text)


def main() -> None:
    run(str(__doc__), page)


if __name__ == "__main__":
    main()
