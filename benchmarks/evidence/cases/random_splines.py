"""COPP's hundred random splines of seven axes by us and by copp-py.

Times are s of processor time from the path on, ours with the certificate. copp-py's conic programme
has 1000 intervals and linearises jerk once, as COPP's test does, or until the duration settles.
`--suite` is `tests/test_random_spline.rs` of COPP's sources: its seed, sizes and limits are read
from it, and the durations that it states are printed.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.evidence.measuring import time_calls
from benchmarks.evidence.peers import copp_
from benchmarks.evidence.peers.copp_ import Grid
from benchmarks.evidence.peers.ours import solve_certified
from benchmarks.evidence.peers.problems import slow_to_hold, spline_problem
from benchmarks.evidence.peers.random_splines import Suite
from benchmarks.evidence.table import Row, Table
from kinematics.foundation.errors import MotionError, NotInstalled

METHODS = (
    ("ours, certified", 2, partial(solve_certified, order=2)),
    ("ours, certified", 3, partial(solve_certified, order=3)),
    ("copp-py TOPP2-RA", 2, partial(copp_.solve, order=2, grid=Grid())),
    (
        "copp-py TOPP3-SOCP, 1 linearisation",
        3,
        partial(copp_.solve, order=3, grid=Grid(), linearisations=1),
    ),
    ("copp-py TOPP3-SOCP, 6 linearisations", 3, partial(copp_.solve, order=3, grid=Grid())),
)
COLUMNS = (
    "method",
    "order",
    "answers",
    "time (ms): mean",
    "longest",
    "duration (s): mean",
    "std",
    "largest use of a limit",
    "slowed to hold (s): mean",
)


def measure(suite: Path | None = None, count: int | None = None) -> Iterator[Table | str]:
    """Yield the table; count: number of problems to solve."""
    tests = Suite() if suite is None else Suite.read(suite)
    yield Table("", COLUMNS, solve_suite(tests if count is None else replace(tests, count=count)))
    if suite is not None:
        text = suite.read_text(encoding="utf-8")
        text = text.partition("Tf(s) mean/std:")[2].partition("#[test]")[0]
        stated = re.findall(r"(\S+)\s*: mean = ([\d.]+), std = ([\d.]+)", text)
        durations = [f"{name} {mean} s, std {std} s" for name, mean, std in stated]
        yield f"COPP's test states: {'; '.join(durations)}"


def solve_suite(suite: Suite) -> Iterator[Row]:
    """Yield a row for each method that is installed."""
    problems = [spline_problem("random spline", *drawn) for drawn in suite.problems()]
    for method, order, solve in METHODS:
        try:
            solve(problems[0])  # loads and compiles, which the times leave out
        except NotInstalled:
            return
        times, motions = [], []
        for problem in problems:
            try:
                sample, took = time_calls(partial(solve, problem))
            except MotionError:
                continue
            times += took
            motion = sample()
            motions.append((motion.duration, motion.uses(problem.bounds)[:order]))
        answers = f"{len(motions)} of {len(problems)}"
        if not motions:
            yield [method, str(order), answers, *[""] * 6]
            continue
        durations = [duration for duration, _ in motions]
        uses = max(max(uses) for _, uses in motions)
        slowed = np.mean([slow_to_hold(*motion) for motion in motions])
        milliseconds = [f"{1e3 * time:.0f}" for time in (np.mean(times), max(times))]
        spread = np.std(durations, ddof=min(1, len(durations) - 1))
        figures = [f"{value:.6f}" for value in (np.mean(durations), spread, uses, slowed)]
        yield [method, str(order), answers, *milliseconds, *figures]
