"""Random feasible problems, scaled ones, tiny ones and splines, all solved and certified: `python -m
benchmarks.evidence.trials.robustness`.

`--second 10000 --third 1000` are the full counts (hours on two cores). Every problem follows from its seed alone.
Feasible by construction: limits are positive, paths continuous and motions from rest to rest, stopping at corners; the
slower, the less they use of every limit. Of the bare paths of every kind and scale (`--paths`), piecewise polynomials
and splines of degree 1 to 9 with jumps of q′ from 1e-14 on, over twelve orders of magnitude of axes and of limits, not
all are solved.
"""

from argparse import ArgumentParser
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from scipy.interpolate import Akima1DInterpolator, BSpline, CubicSpline, PPoly

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner import Solution, time_optimal
from planner.time_optimal import polynomials
from planner.timing.profile import AVERAGED, WITH_RESTS

# Scales that leave durations as they are, or multiply them, and how exactly: order 2 and order 3.
SCALES, EXACT = (1e-6, 1e-3, 1e3, 1e6), {2: 1e-9, 3: 1e-6}


@dataclass(frozen=True, slots=True)
class RandomProblem:
    """A path and limits (n,) on speed, acceleration and, at order 3, jerk."""

    what: str
    path: PPoly
    speed: Array
    acceleration: Array
    jerk: Array | None

    def solve(self, length: float = 1.0, time: float = 1.0) -> Solution:
        """By `time_optimal`, with all lengths and all times multiplied."""
        return time_optimal(
            PPoly(self.path.c * length, self.path.x),
            max_speed=self.speed * length / time,
            max_acceleration=self.acceleration * length / time**2,
            max_jerk=None if self.jerk is None else self.jerk * length / time**3,
        )


def random_problem(seed: int, order: int) -> RandomProblem:
    """Two to ten waypoints of one to seven axes, over twelve orders of magnitude of length and seven of time.

    Some waypoints are repeated, some axes stand still; the path through them is a spline or a polyline.
    """
    rng = np.random.default_rng([seed, order])
    count, axes = int(rng.integers(2, 11)), int(rng.integers(1, 8))
    size = 10.0 ** rng.uniform(-7, 2)
    points = size * rng.normal(size=(count, axes)) * 10.0 ** rng.uniform(-1, 1, axes)
    if axes > 1 and rng.random() < 0.15:
        points[:, rng.integers(axes)] = size
    if count > 2 and rng.random() < 0.2:
        k = int(rng.integers(1, count))
        points[k] = points[k - 1]
    knots = np.append(0.0, np.cumsum(10.0 ** rng.uniform(-0.5, 0.5, count - 1)))
    kind = str(rng.choice(["natural", "clamped", "not-a-knot", "akima", "polyline"]))
    time = 10.0 ** rng.uniform(-4, 3)
    spread = 10.0 ** rng.uniform(-1, 1, (3, axes))
    speed, acceleration, jerk = (size / time**k * spread[k - 1] ** k for k in (1, 2, 3))
    what = f"seed {seed}: {count} waypoints, {axes} axes, {kind}"
    return RandomProblem(what, _curve(kind, knots, points), speed, acceleration, jerk if order == 3 else None)


def _curve(kind: Any, knots: Array, points: Array) -> Any:
    if kind == "polyline":
        return PPoly(np.stack([np.diff(points, axis=0) / np.diff(knots)[:, None], points[:-1]]), knots)
    if kind == "akima" and len(points) > 2:
        return Akima1DInterpolator(knots, points)
    return CubicSpline(knots, points, bc_type="natural" if kind == "akima" else kind)


def long_spline(seed: int) -> RandomProblem:
    """Fifty random waypoints of six axes under limits of about one."""
    rng = np.random.default_rng([seed, 50])
    curve = CubicSpline(np.arange(50.0), rng.uniform(-1, 1, (50, 6)))
    return RandomProblem(f"long spline {seed}", curve, np.full(6, 1.0), np.full(6, 2.0), np.full(6, 20.0))


def tiny_problems(order: int) -> list[RandomProblem]:
    """Motions of 1e-7 to 1e-4 under limits of 100 to 10 000: what defeats toppra's Seidel solver."""
    found = []
    for length in (1e-7, 1e-6, 1e-5, 1e-4):
        for limit in (100.0, 1000.0, 10_000.0):
            bend = CubicSpline([0.0, 0.5, 1.0], np.array([[0.0, 0.0], [0.6, 0.3], [1.0, 1.0]]) * length)
            bound = np.full(2, limit)
            found.append(
                RandomProblem(f"{length:g} under {limit:g}", bend, bound, bound, 100 * bound if order == 3 else None)
            )
    return found


def try_problem(problem: RandomProblem) -> tuple[Solution | None, str]:
    """The solution, or why there is none."""
    try:
        found = problem.solve()
    except MotionError as no:
        return None, f"{problem.what}: {no}"
    return (found, "") if found.certificate.holds else (None, f"{problem.what}: not certified")


def check_scaling(problem: RandomProblem, order: int) -> list[str]:
    """Where a duration does not scale as it must."""
    own = problem.solve().trajectory.duration
    faults = []
    for scale in SCALES:
        for what, factors in (("lengths", (scale, 1.0)), ("times", (1.0, scale))):
            duration = problem.solve(*factors).trajectory.duration / factors[1]
            if not abs(duration - own) <= EXACT[order] * own:
                faults.append(f"{problem.what}: {what} × {scale:g}: off by {duration / own - 1:.2g}")
    return faults


SIZES = (1, 2, 3, 5, 10, 40)


def random_spline(seed: int) -> RandomProblem:
    """Order 2 in six of ten."""
    rng = np.random.default_rng([seed, 7])
    axes, degree, kind = int(rng.integers(1, 4)), int(rng.integers(1, 10)), str(rng.choice(["jumps", "b", "cubic"]))
    size = 10.0 ** rng.uniform(-6, 6, axes) if rng.random() < 0.4 else np.full(axes, 10.0 ** rng.uniform(-3, 3))
    pieces = int(rng.choice(SIZES))
    knots = np.cumsum(10.0 ** rng.uniform(-2, 2, pieces + 1) if rng.random() < 0.5 else np.ones(pieces + 1))
    path: PPoly
    if kind == "cubic":
        path = CubicSpline(knots, rng.normal(size=(pieces + 1, axes)) * size, bc_type="natural")
    else:
        around = np.concatenate([np.full(degree, knots[0]), knots, np.full(degree, knots[-1])])
        controls = rng.normal(size=(pieces + degree, axes)) * size
        path = _pieces(around, controls, degree, rng, 10.0 ** rng.uniform(-14, -3) if kind == "jumps" else 0.0)
    bounds = 10.0 ** (rng.uniform(-6, 6, 3) if rng.random() < 0.5 else rng.uniform(-2, 2, 3))
    speed, acceleration, jerk = (np.full(axes, bound) for bound in bounds)
    what = f"seed {seed}: {kind}, degree {degree}, {pieces} pieces, {axes} axes"
    return RandomProblem(what, path, speed, acceleration, jerk if rng.random() < 0.4 else None)


def _pieces(knots: Array, controls: Array, degree: int, rng: np.random.Generator, jump: float) -> PPoly:
    """A spline's pieces, each begun with a slope that is off by a share, and moved to where the one before it ends."""
    drawn = polynomials(BSpline(knots, controls, degree))
    real = np.diff(drawn.x) > 0
    c, x = drawn.c[:, real], np.append(drawn.x[:-1][real], drawn.x[-1])
    for p in range(1, c.shape[1] if jump else 0):
        slope = jump * np.abs(c[-2, p]).max() * rng.normal(size=c.shape[2])
        c[-2, p] += slope
        c[-1, p + 1 :] += slope * (x[p + 1] - x[p])
    return PPoly(c, x)


def tell_shares(methods: Counter[str]) -> str:
    """Of runs by method: the share of those that no solver's own answer, all but unslowed and without rests, gave."""
    lesser = {
        "averaged": sum(count for method, count in methods.items() if AVERAGED in method),
        "slowed by more than 0.1 %": sum(count for method, count in methods.items() if is_slow(method)),
        "with extra rests": sum(count for method, count in methods.items() if WITH_RESTS in method),
    }
    whole = max(1, methods.total())
    return f"of {methods.total()} runs " + ", ".join(
        f"{100 * count / whole:.2f} % {what}" for what, count in lesser.items()
    )


def is_slow(method: str) -> bool:
    """Whether a method tells of a motion, or a part of one, that was slowed by more than is told as little."""
    return "slowed" in method.split(", ")


def main() -> None:
    parser = ArgumentParser(prog="python -m benchmarks.evidence.trials.robustness", description=__doc__)
    parser.add_argument("--second", type=int, default=500, help="how many random order-2 problems")
    parser.add_argument("--third", type=int, default=100, help="how many random order-3 problems")
    parser.add_argument("--scaled", type=int, default=10, help="how many of them at every scale")
    parser.add_argument("--splines", type=int, default=20, help="how many splines of 50 waypoints at order 3")
    parser.add_argument("--paths", type=int, default=300, help="how many bare paths of every kind and scale")
    asked = parser.parse_args()
    for order, count in ((2, asked.second), (3, asked.third)):
        tell(f"order {order}, random", [random_problem(seed, order) for seed in range(count)])
        tell(f"order {order}, tiny", tiny_problems(order))
        faults = [fault for seed in range(asked.scaled) for fault in check_scaling(random_problem(seed, order), order)]
        print(*faults, sep="\n")
        print(
            f"order {order}, {asked.scaled} at {2 * len(SCALES)} scales each: {len(faults)} durations are off by more "
            f"than {EXACT[order]:g}",
            flush=True,
        )
    tell("order 3, 50 waypoints", [long_spline(seed) for seed in range(asked.splines)])
    tell("every kind and scale", [random_spline(seed) for seed in range(asked.paths)])


def tell(what: str, problems: Sequence[RandomProblem]) -> None:
    """How many are not solved and certified, which, and by which methods the others' runs are."""
    begin, methods, failures = perf_counter(), Counter[str](), 0
    for problem in problems:
        found, why = try_problem(problem)
        if found is None:
            failures += 1
            print(why, flush=True)
        else:
            methods.update(found.methods)
    print(
        f"{what}: {failures} of {len(problems)} not solved and certified; {tell_shares(methods)}; "
        f"runs by method {dict(methods)}; {perf_counter() - begin:.0f} s",
        flush=True,
    )


if __name__ == "__main__":
    main()
