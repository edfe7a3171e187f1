"""The comparison with peers as a page: `python -m benchmarks.evidence.peers.page [--out docs/peers.md]`.

What was measured is read from docs/peers.csv, as `python -m benchmarks.evidence.peers` wrote it; what is said of the
peers stands beside this file, in peers.md.j2, with every figure from there. `--out` writes the rows that tell of peers
in the README and in the index of evidence as well.
"""

import csv
from argparse import ArgumentParser
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.evidence.peers.case import PeerAnswer
from benchmarks.evidence.published.compared import markdown

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
ROOT = Path(__file__).parents[3]
MEASURED_FILE = ROOT / "docs" / "peers.csv"
INDEX_FILE = ROOT / "docs" / "evidence" / "index.md"
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


CIRCLE, SPLINE, LINE = "hexapod, circle", "spline, 50 waypoints", "straight, one axis"
OURS = "ours, certified"


@dataclass(frozen=True)
class PeerFigures:
    """What the page says of the measurements, worked out of them. Shares and ratios are of ours, times in s."""

    found: Sequence[PeerAnswer]

    def one(self, case: str, order: int, method: str, intervals: int | None = None) -> PeerAnswer:
        return next(
            a for a in self.found if (a.case, a.order, a.method, a.intervals) == (case, order, method, intervals)
        )

    def peers(self, case: str, order: int, kind: str) -> list[PeerAnswer]:
        """The answers of a peer, the shortest motion that holds first."""
        of = [a for a in self.found if (a.case, a.order) == (case, order) and a.method.startswith(kind)]
        return sorted((a for a in of if a.feasible == a.feasible), key=lambda a: a.feasible)

    @property
    def reference(self) -> PeerAnswer:
        return next(iter(self.peers(CIRCLE, 3, "IPOPT")))

    @property
    def reference_ratio(self) -> float:
        """Of IPOPT's time on the circle."""
        return self.reference.again / self.one(CIRCLE, 3, OURS).again

    @property
    def reference_gain(self) -> float:
        """%, by which its motion is shorter."""
        return 100 * (1 - self.reference.feasible / self.one(CIRCLE, 3, OURS).feasible)

    @property
    def coarse(self) -> list[PeerAnswer]:
        """copp-py's answers on the circle at order 3 that took less time than ours."""
        ours = self.one(CIRCLE, 3, OURS)
        return [a for a in self.peers(CIRCLE, 3, "copp-py") if a.again < ours.again]

    @property
    def coarse_ratio(self) -> float:
        """How many times faster the fastest of these is."""
        return max(self.one(CIRCLE, 3, OURS).again / a.again for a in self.coarse)

    @property
    def coarse_loss(self) -> tuple[float, float]:
        """%, by which their motions are longer when they hold: from, to; there must be some."""
        ours = self.one(CIRCLE, 3, OURS).feasible
        longer = [100 * (a.feasible / ours - 1) for a in self.coarse]
        return min(longer), max(longer)

    @property
    def passes_share(self) -> float:
        """Of our time for the passes alone, that copp-py's take on the spline."""
        copp, *_ = self.peers(SPLINE, 2, "copp-py")
        return copp.again / self.one(SPLINE, 2, "ours, uncertified", copp.intervals).again

    @property
    def straight_ratio(self) -> float:
        """Of our time for one straight axis and ruckig's."""
        ruckig, *_ = self.peers(LINE, 3, "ruckig")
        return self.one(LINE, 3, OURS).again / ruckig.again

    @property
    def certificate_times(self) -> tuple[float, float]:
        """ms of the order-2 circle: solving alone, and in all."""
        alone = min(a.again for a in self.peers(CIRCLE, 2, "ours, uncertified"))
        return 1e3 * alone, 1e3 * self.one(CIRCLE, 2, OURS).again

    @property
    def finer_gain(self) -> tuple[float, float]:
        """%, by which our own finest grids at order 2 are shorter than the certified motions."""
        gains = []
        for case in (CIRCLE, SPLINE):
            finest = max(self.peers(case, 2, "ours, uncertified"), key=lambda a: a.intervals or 0)
            gains.append(100 * (1 - finest.feasible / self.one(case, 2, OURS).feasible))
        return min(gains), max(gains)

    @property
    def grid_loss(self) -> tuple[float, float]:
        """%, that motions of 1000 intervals or fewer lose on the spline when they are slowed until they hold."""
        grids = [a for a in self.found if a.case == SPLINE and a.intervals and a.intervals <= 1000]
        losses = [100 * (a.feasible / a.duration - 1) for a in grids if a.duration == a.duration]
        return min(losses), max(losses)

    @property
    def lead(self) -> float:
        """Of the time of copp-py's fastest answer within a thousandth of the best, that ours takes on the circle."""
        best = min(self.reference.feasible, self.one(CIRCLE, 3, OURS).feasible)
        near = [a.again for a in self.peers(CIRCLE, 3, "copp-py") if a.feasible <= best * (1 + CLOSE_SHARE)]
        return self.one(CIRCLE, 3, OURS).again / min(near)

    def readme_rows(self) -> Iterator[str]:
        """Ours beside the peers: of a peer's answers the shortest, and the fastest if it is within 5 % of that."""
        names = (
            ("circle on a hexapod, acceleration", CIRCLE, 2), ("circle on a hexapod, jerk", CIRCLE, 3),
            ("spline of 50 waypoints, acceleration", SPLINE, 2), ("spline of 50 waypoints, jerk", SPLINE, 3),
            ("straight, one axis, jerk", LINE, 3),
        )  # fmt: skip
        for name, case, order in names:
            cells = [name, tell_answer(self.one(case, order, OURS))]
            for kind in ("toppra", "copp-py", "ruckig"):
                of = self.peers(case, order, kind)
                quick = min((a for a in of if a.feasible < 1.05 * of[0].feasible), key=lambda a: a.again, default=None)
                chosen = [*of[:1], *([quick] if quick and quick is not of[0] else [])]
                cells.append("; ".join(map(tell_answer, chosen)))
            yield f"| {' | '.join(cells)} |".replace("|  |", "| |").replace("|  |", "| |")

    def index_row(self) -> str:
        return (
            "| the circle at order 3 within 0.1 % of the best known, with its certificate | "
            f"{self.lead:.2g} of copp-py's time | `python -m benchmarks.evidence.peers`; [the table](../peers.md) |"
        )


def tell_answer(a: PeerAnswer) -> str:
    """How long the motion takes when it holds, and how long it took to find."""
    took = f"{a.again:#.2g} s" if a.again >= 0.1 else f"{1e3 * a.again:.2g} ms"
    return f"{a.feasible:.5g} s in {took}"


def put_rows(text: str, rows: Iterable[str]) -> str:
    """A page with rows of its tables replaced by those of the same first cell. Raises ValueError for a new one."""
    lines = text.splitlines()
    for row in rows:
        first = row.split(" | ")[0] + " | "
        (at,) = (k for k, line in enumerate(lines) if line.startswith(first))
        lines[at] = row
    return "\n".join([*lines, ""])


def page() -> str:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    found = read_answers(MEASURED_FILE)
    loader = FileSystemLoader(Path(__file__).parent)
    engine = Environment(
        loader=loader, undefined=StrictUndefined, keep_trailing_newline=True, trim_blocks=True, lstrip_blocks=True
    )
    said = [f"- {line.strip()}." for line in verdicts(found)]
    text = engine.get_template("peers.md.j2").render(
        measured="\n\n".join(tables(found)), verdicts="\n".join(said), figures=PeerFigures(found)
    )
    return str(text)


def main() -> None:
    parser = ArgumentParser(prog=COMMAND, description=__doc__)
    parser.add_argument("--out", type=Path, help="the page's file; else it is printed")
    asked = parser.parse_args()
    if asked.out is None:
        print(page(), end="")
        return
    asked.out.write_text(page(), encoding="utf-8")
    figures = PeerFigures(read_answers(MEASURED_FILE))
    for file, rows in ((ROOT / "README.md", figures.readme_rows()), (INDEX_FILE, [figures.index_row()])):
        file.write_text(put_rows(file.read_text(encoding="utf-8"), rows), encoding="utf-8")


if __name__ == "__main__":
    main()
