"""The page docs/peers.md, from the table that `peers --csv` wrote: use `--out docs/peers.md`.

`--figure docs/images/peers.png` draws durations over times as well; `--readme` prints the rows of
the README instead.
"""

import csv as csv_module
from collections.abc import Iterator, Sequence
from math import ceil, floor, log10
from pathlib import Path

from jinja2 import Environment, StrictUndefined

from benchmarks.evidence.peers.problems import QUANTITIES
from benchmarks.evidence.table import Table

MEASURED_FILE = Path(__file__).parents[3] / "docs" / "peers.csv"
TEMPLATE = Path(__file__).with_name("peers.md.j2")
CIRCLE, SPLINE, LINE = "hexapod, circle", "spline, 50 waypoints", "straight, one axis"
OURS = "ours, certified"
TIME, DURATION, SLOWED = "again (s)", "duration (s)", "duration slowed to hold (s)"
COLUMNS = (
    "method",
    "intervals",
    "time (ms)",
    "duration (s)",
    "most of a limit",
    "slowed to hold (s)",
    "above the best",
)
LIMITS = {"2": "speed and acceleration", "3": "speed, acceleration and jerk"}
README_ROWS = (
    ("circle on a hexapod, acceleration", CIRCLE, "2"),
    ("circle on a hexapod, jerk", CIRCLE, "3"),
    ("spline of 50 waypoints, acceleration", SPLINE, "2"),
    ("spline of 50 waypoints, jerk", SPLINE, "3"),
    ("straight, one axis, jerk", LINE, "3"),
)
MARKS = {"ours": "o", "toppra": "s", "copp-py": "^", "ruckig": "D", "IPOPT": "x"}

Answer = dict[str, str]
"""A row of the table, by the names of its columns."""


def measure(
    csv: Path = MEASURED_FILE,
    figure: Path | None = None,
    readme: bool = False,
) -> Iterator[str]:
    """Yield the page, or the README's rows."""
    answers = read_answers(csv)
    if figure is not None:
        draw(answers, figure)
    if readme:
        yield "\n".join(readme_row(answers, *row) for row in README_ROWS)
        return
    engine = Environment(undefined=StrictUndefined)
    template = engine.from_string(TEMPLATE.read_text(encoding="utf-8"))
    yield template.render(measured="\n\n".join(tables(answers)), **find_figures(answers))


def read_answers(path: Path = MEASURED_FILE) -> list[Answer]:
    """Read the table."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv_module.DictReader(file))


def list_problems(answers: Sequence[Answer]) -> list[tuple[str, str]]:
    """Return cases and orders."""
    return list(dict.fromkeys((one["case"], one["order"]) for one in answers))


def select(answers: Sequence[Answer], case: str, order: str, method: str = "") -> list[Answer]:
    """Return a method's answers to one problem, the shortest motion that holds first."""
    solved = [one for one in answers if one[DURATION] != "nan" and one["method"].startswith(method)]
    chosen = [one for one in solved if (one["case"], one["order"]) == (case, order)]
    return sorted(chosen, key=lambda one: float(one[SLOWED]))


def above(answer: Answer, best: Answer) -> float:
    """Return by how many % a motion that is slowed to hold is longer than the best."""
    return 100 * (float(answer[SLOWED]) / float(best[SLOWED]) - 1)


def tables(answers: Sequence[Answer]) -> Iterator[str]:
    """Yield a table for each path and order."""
    for case, order in list_problems(answers):
        best, *_ = select(answers, case, order)
        chosen = [one for one in answers if (one["case"], one["order"]) == (case, order)]
        rows = [table_row(one, best) for one in chosen]
        yield f"### {case[0].upper()}{case[1:]}: {LIMITS[order]}\n\n{Table('', COLUMNS, rows)}"


def table_row(answer: Answer, best: Answer) -> list[str]:
    """Return the cells of an answer, or of a failure."""
    head = [answer["method"], answer["intervals"]]
    if answer[DURATION] == "nan":
        return [*head, "", f"no answer: {answer['remark']}", "", "", ""]
    time = float(answer[TIME])
    milliseconds = f"{1e3 * time:.0f}" if time >= 0.1 else f"{1e3 * time:.3g}"
    use = max((answer[name] for name in QUANTITIES[: int(answer["order"])]), key=float)
    return [
        *head,
        milliseconds,
        answer[DURATION],
        use,
        answer[SLOWED],
        f"{above(answer, best):.3f}\N{NO-BREAK SPACE}%",
    ]


def find_figures(answers: Sequence[Answer]) -> dict[str, float]:
    """Return the figures of the page's sentences, by their names in the template."""
    best, *_ = select(answers, CIRCLE, "3")
    time = float(select(answers, CIRCLE, "3", OURS)[0][TIME])
    near = [one for one in select(answers, CIRCLE, "3", "copp-py") if above(one, best) <= 0.1]
    line = float(select(answers, LINE, "3", OURS)[0][TIME])
    ruckig = float(select(answers, LINE, "3", "ruckig")[0][TIME])
    solved = [one for order in "23" for one in select(answers, SPLINE, order)]
    coarse = [one for one in solved if 0 < int(one["intervals"] or 0) <= 1000]
    losses = [100 * (float(one[SLOWED]) / float(one[DURATION]) - 1) for one in coarse]
    return {
        "reference_ratio": float(select(answers, CIRCLE, "3", "IPOPT")[0][TIME]) / time,
        "straight_ratio": line / ruckig,
        "copp_share": time / min(float(one[TIME]) for one in near),
        "least_loss": min(losses),
        "most_loss": max(losses),
    }


def readme_row(answers: Sequence[Answer], name: str, case: str, order: str) -> str:
    """Return a row of the README: each peer's shortest answer, and its fastest within 5 %."""
    cells = [name, describe(select(answers, case, order, OURS)[0])]
    for peer in ("toppra", "copp-py", "ruckig"):
        chosen = select(answers, case, order, peer)
        near = [one for one in chosen if above(one, chosen[0]) < 5]
        fastest = sorted(near, key=lambda one: float(one[TIME]))
        cells.append("; ".join(dict.fromkeys(map(describe, chosen[:1] + fastest[:1]))))
    return "|" + "|".join(f" {cell} " if cell else " " for cell in cells) + "|"


def describe(answer: Answer) -> str:
    """Return duration and time of an answer in words."""
    time = float(answer[TIME])
    unit = f"{time:#.2g} s" if time >= 0.1 else f"{1e3 * time:.2g} ms"
    return f"{float(answer[SLOWED]):.5g} s in {unit}"


def draw(answers: Sequence[Answer], path: Path) -> None:
    """Draw how far each answer is above the best of its problem, over its time."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    problems = list_problems(answers)
    figure = Figure(figsize=(3.4 * len(problems), 3.6), layout="constrained")
    for ax, problem in zip(figure.subplots(1, len(problems)), problems, strict=True):
        best, *_ = select(answers, *problem)
        for number, (method, marker) in enumerate(MARKS.items()):
            if chosen := select(answers, *problem, method):
                heights = [above(one, best) + 1e-4 for one in chosen]
                times = [float(one[TIME]) for one in chosen]
                ax.plot(times, heights, marker, color=f"C{number}", label=method, alpha=0.8)
        ax.set(xscale="log", yscale="log", xlabel="wall time (s)")
        # from one decade to the next, so that no times in between need labels
        shortest, longest = map(log10, ax.get_xlim())
        ax.set_xlim(10.0 ** floor(shortest), 10.0 ** ceil(longest))
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.set_title(", order ".join(problem), fontsize=9)
        ax.legend(fontsize=7)
    figure.supylabel("slowed to hold: above the best (%, +1e-4)", fontsize=10)
    figure.savefig(path, dpi=110)
