"""Bare paths of every kind and scale, solved and certified: `python -m benchmarks.evidence.trials.random_splines
[--count N]`.

Piecewise polynomials and splines of degree 1 to 9 with jumps of q′ from 1e-14 on, over twelve orders of magnitude of
axes and of limits. Every problem follows from its seed; those that are not solved and certified are printed.
"""

from argparse import ArgumentParser

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, PPoly

from benchmarks.evidence.trials.robustness import RandomProblem, try_problem
from kinematics.foundation.arrays import Array
from planner.time_optimal import polynomials

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


def main() -> None:
    parser = ArgumentParser(prog="python -m benchmarks.evidence.trials.random_splines", description=__doc__)
    parser.add_argument("--count", type=int, default=300, help="how many")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    asked = parser.parse_args()
    failures = 0
    for seed in range(asked.first, asked.first + asked.count):
        found, why = try_problem(random_spline(seed))
        if found is None or max(found.certificate.worst.values()) > 1:
            failures += 1
            print(why or f"seed {seed}: above 1", flush=True)
    print(f"{failures} of {asked.count} not solved and certified")


if __name__ == "__main__":
    main()
