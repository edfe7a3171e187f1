"""Order 3: duration against intervals, on our grids and even ones: `python -m benchmarks.evidence.speed.intervals`.

The circle and the blended polyline of 60 lines on the hexapod, and the spline through 50 waypoints. Ours: as every run
is solved, with a part or a multiple of the intervals; even: as many along the path, and the breaks between its pieces.
All are solved until no limit is seen to be exceeded between grid points either, so that each duration can be had.
"""

import csv
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from benchmarks.evidence.peers.problems import PathProblem, circle, spline
from benchmarks.evidence.published.compared import markdown
from benchmarks.evidence.speed.polyline import walk
from kinematics import load_machine
from kinematics.foundation.errors import require
from planner.limits import limits_of
from planner.path.actuation import actuate
from planner.timing.certified_run import tighten_until_kept
from planner.timing.discretization import ROUGH_GRID, THIRD_ORDER, Rule, coarse_jerk_problem, jerk_problem
from planner.timing.jerk_limited import look_along, place_by_loss
from planner.timing.problem import Run, make_grid, pose_problem
from planner.timing.solvers.third_order import solve_jerk_limited

# Multiples of the intervals that a run is solved on; lines of the polyline.
SHARES = (0.25, 0.5, 1.0, 2.0, 4.0)
LINES = 60
OURS, EVEN = "ours", "even"


@dataclass(frozen=True, slots=True)
class GridAnswer:
    """intervals that a motion was solved on at first, and its duration (s); method: whether it was slowed."""

    case: str
    grid: str
    share: float
    intervals: int
    duration: float
    method: str


def polyline(lines: int = LINES) -> PathProblem:
    machine = load_machine("hexapod")
    return PathProblem(f"blended polyline, {lines} lines", actuate(walk(lines), machine), machine.axes)


def compare(case: PathProblem, shares: Sequence[float] = SHARES) -> Iterator[GridAnswer]:
    """Both grids with each share of the intervals. Raises MotionError where one has no answer."""
    path, limits = case.path, limits_of(case.path, case.axes, 3)
    run, look = Run(0, len(path.breaks) - 2), look_along(path, limits)
    coarse = coarse_jerk_problem(path, limits, run)
    _, start = require(jerk_problem(path, limits, run, coarse))
    for share in shares:
        placed = require(place_by_loss(path, limits, run, coarse, _part(ROUGH_GRID, share), _part(THIRD_ORDER, share)))
        assert placed is not None  # where jerk limits bind for less than an interval
        ours, motion = placed
        even = pose_problem(path, limits, *make_grid(path, run, ours.intervals), run.speeds, run.stands)
        for grid, problem, guess in ((OURS, ours, motion.on(ours.s)), (EVEN, even, start.on(even.s))):
            found = solve_jerk_limited(problem, guess, "finer" if grid == OURS else "far", look)
            found = tighten_until_kept(path, limits, found)
            found.require_profile()
            yield GridAnswer(case.name, grid, share, problem.intervals, found.duration, found.method)


def _part(rule: Rule, share: float) -> Rule:
    least, per_piece, per_radian = (max(1, round(share * count)) for count in rule)
    return least, per_piece, per_radian


def draw(answers: Sequence[GridAnswer], path: Path) -> None:
    """What each takes longer than the shortest of its case, over intervals."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    cases = list(dict.fromkeys(one.case for one in answers))
    figure = Figure(figsize=(3.6 * len(cases), 3.4), layout="constrained")
    for ax, case in zip(figure.subplots(1, len(cases), squeeze=False)[0], cases, strict=True):
        own = [one for one in answers if one.case == case]
        best = min(own, key=lambda one: one.duration)
        for grid, marker in ((OURS, "o-"), (EVEN, "s--")):
            drawn = [one for one in own if one.grid == grid and one is not best]
            ax.plot([one.intervals for one in drawn], [_longer(one, best) for one in drawn], marker, label=grid)
        ax.set(xscale="log", yscale="log", xlabel="intervals", ylabel="above the shortest (%)")
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.set_title(case, fontsize=9)
        ax.legend(fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def table(answers: Sequence[GridAnswer]) -> str:
    """As Markdown."""
    rows = []
    for one in answers:
        best = min((each for each in answers if each.case == one.case), key=lambda each: each.duration)
        cells = one.case, one.grid, str(one.intervals), f"{one.duration:.6f}", f"{_longer(one, best):.4f}", one.method
        rows.append(cells)
    return markdown(("path", "grid", "intervals", "duration (s)", "above the shortest (%)", "method"), rows)


def _longer(one: GridAnswer, best: GridAnswer) -> float:
    return 100 * (one.duration / best.duration - 1)


def main() -> None:
    parser = ArgumentParser(prog="python -m benchmarks.evidence.speed.intervals", description=__doc__)
    parser.add_argument("--csv", type=Path, default=Path("docs/intervals.csv"))
    parser.add_argument("--figure", type=Path, default=Path("docs/images/intervals.png"))
    asked = parser.parse_args()
    answers = [answer for case in (circle(), spline(), polyline()) for answer in compare(case)]
    asked.csv.parent.mkdir(parents=True, exist_ok=True)
    with asked.csv.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([field.name for field in fields(GridAnswer)])
        writer.writerows(astuple(answer) for answer in answers)
    draw(answers, asked.figure)
    print(table(answers))


if __name__ == "__main__":
    main()
