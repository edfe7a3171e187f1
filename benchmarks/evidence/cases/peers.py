"""Two paths and a straight line by us and by toppra, copp-py, ruckig and IPOPT.

Peers come with `pip install '.[peers]'`; the row of one that is not installed says so. The table
that `--csv docs/peers.csv` writes is read by `peers_page`. Times are s of wall time: of the first
call, and the median of those after it. Uses are the largest value/limit of speed, acceleration and
jerk at 41 instants of every interval.
"""

import csv as csv_module
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter

from benchmarks.evidence.measuring import time_calls
from benchmarks.evidence.peers import copp_, ruckig_
from benchmarks.evidence.peers.copp_ import Grid
from benchmarks.evidence.peers.ours import (
    pose_reference,
    solve_certified,
    solve_general,
    solve_passes,
)
from benchmarks.evidence.peers.problems import (
    PathProblem,
    Solve,
    circle,
    slow_to_hold,
    spline,
    straight,
)
from benchmarks.evidence.table import Row, Table, store_rows
from kinematics.foundation.errors import MotionError

COLUMNS = (
    "case",
    "order",
    "method",
    "intervals",
    "first call (s)",
    "again (s)",
    "duration (s)",
    "speed",
    "acceleration",
    "jerk",
    "duration slowed to hold (s)",
    "remark",
)
# A solve is timed so often, or twice once the calls have taken so long (s).
REPEATS, MOST_TIME = 6, 10.0
INTERVALS, REFERENCE_2, REFERENCE_3 = 1000, 10_000, 2000
EVEN_GRIDS = [Grid(intervals) for intervals in (100, 200, 400, 1000)]
GRADED_GRIDS = [
    Grid(100, 0.9, 1),
    *(Grid(intervals, 0.9, 3) for intervals in (200, 400, 700, 1000)),
]

Method = tuple[int, str, int | None, Solve]
"""Order, name, intervals and what to call."""


def measure(csv: Path | None = None) -> Iterator[Table]:
    """Yield the table of all answers; csv: a file that it is written to as well."""
    rows: list[Row] = []
    yield Table("", COLUMNS, store_rows(measure_rows(), rows))
    if csv is not None:
        with csv.open("w", newline="", encoding="utf-8") as file:
            csv_module.writer(file).writerows([COLUMNS, *rows])


def measure_rows() -> Iterator[Row]:
    """Yield the answer of every method for every problem."""
    for problem in (circle(), spline()):
        for method in (*order2_methods(problem), *order3_methods(problem)):
            yield measure_row(problem, method)
    line = straight()
    for name, solve in (
        ("ours, certified", partial(solve_certified, line, 3)),
        ("ours, general solver, uncertified", partial(solve_general, line)),
        ("ruckig", partial(ruckig_.solve, line)),
    ):
        yield measure_row(line, (3, name, None, solve))


def order2_methods(problem: PathProblem) -> Iterator[Method]:
    """Yield what solves a problem without jerk limits."""
    yield 2, "ours, certified", None, partial(solve_certified, problem, 2)
    yield 2, "ours, uncertified", INTERVALS, partial(solve_passes, problem, INTERVALS)
    yield (
        2,
        "ours, uncertified (reference)",
        REFERENCE_2,
        partial(solve_passes, problem, REFERENCE_2),
    )
    yield 2, "toppra", INTERVALS, partial(solve_passes, problem, INTERVALS, "toppra")
    yield 2, "copp-py TOPP2-RA", INTERVALS, partial(copp_.solve, problem, 2, Grid(INTERVALS))


def order3_methods(problem: PathProblem) -> Iterator[Method]:
    """Yield what solves a problem with jerk limits."""
    yield 3, "ours, certified", None, partial(solve_certified, problem, 3)
    intervals, solve = pose_reference(problem, REFERENCE_3)
    yield 3, "IPOPT (reference)", intervals, solve
    for grid in EVEN_GRIDS + GRADED_GRIDS:
        kind = f"graded grid, {grid.resting} at rest" if grid.graded else "even grid"
        yield (
            3,
            f"copp-py TOPP3-SOCP, {kind}",
            grid.intervals,
            partial(copp_.solve, problem, 3, grid),
        )


def measure_row(problem: PathProblem, method: Method) -> list[str]:
    """Solve a few times, and sample the last motion."""
    order, name, intervals, solve = method
    cells = [problem.name, str(order), name, str(intervals or "")]
    try:
        sample, (first, *others) = time_calls(solve, REPEATS, perf_counter, MOST_TIME)
    except MotionError as error:
        return [*cells, *["nan"] * 7, str(error).splitlines()[0]]
    motion = sample()
    uses = motion.uses(problem.bounds)
    slowed = slow_to_hold(motion.duration, uses[:order])
    numbers = [f"{value:.6f}" for value in (motion.duration, *uses, slowed)]
    return [*cells, f"{first:.6f}", f"{median(others):.6f}", *numbers, ""]
