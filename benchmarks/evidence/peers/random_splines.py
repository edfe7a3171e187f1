"""COPP's test of random splines, ours certified beside copp-py: `python -m benchmarks.evidence.peers.random_splines`.

A hundred quintics through 50 waypoints of 7 axes, drawn from ±½, whose first two derivatives are nothing at both ends;
speed 1, acceleration 5 and jerk 50, each ±10 %, another bound towards each side. The numbers are those of COPP's
`tests/test_random_spline.rs` to the bit: its generator (ChaCha of 12 rounds) is written anew here, and the mean that it
prints of its order-2 durations shows that they are. `--suite` names that file: its seed, sizes and limits are read from
it, and what it says it found is printed beside what is found here. Times are processor time, from the path on.
"""

import re
from argparse import ArgumentParser
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from benchmarks.evidence.peers.case import Case, PeerAnswer, is_installed, largest_uses, solve_grid, worst
from benchmarks.evidence.published.compared import markdown
from kinematics.foundation.arrays import Array
from kinematics.machine.axis import Axis
from planner import time_optimal
from planner.path.polynomial import PolynomialPath
from planner.time_optimal import polynomials

# Instants of a motion of ours at which its use of the limits is looked at.
INSTANTS = 20_001
INTERVALS = 1000


@dataclass(frozen=True, slots=True)
class Suite:
    """What the test is made of; the largest speed, acceleration and jerk before they are drawn about it."""

    axes: int = 7
    waypoints: int = 50
    limits: tuple[float, float, float] = (1.0, 5.0, 50.0)
    seed: int = 20260414
    count: int = 100

    @staticmethod
    def read(path: Path) -> "Suite":
        """Of the first `TestConfig` that COPP's test makes."""
        text = path.read_text(encoding="utf-8")
        values = dict(re.findall(r"(\w+): ([\d.]+),", text[text.index("let config = TestConfig {") :].split("}")[0]))
        speed, acceleration, jerk = (float(values[f"{what}_max"]) for what in ("velocity", "acceleration", "jerk"))
        axes, waypoints, seed, count = (int(values[name]) for name in ("dim", "num_waypoints", "seed", "n_exp"))
        return Suite(axes, waypoints, (speed, acceleration, jerk), seed, count)

    def problems(self) -> Iterator[tuple[BSpline, Array]]:
        """Each path over [0, 1] and its bounds (3, 2, n): towards smaller and towards greater values."""
        points, sides = self.axes * self.waypoints, 6 * self.axes
        drawn = chacha_numbers(self.seed, self.count * (points + sides)).reshape(self.count, -1)
        still = [(1, np.zeros(self.axes)), (2, np.zeros(self.axes))]
        ends: Any = (still, still)  # which the stubs of SciPy do not know
        for one in drawn:
            through = (-0.5 + one[:points].reshape(self.axes, self.waypoints)).T
            path = make_interp_spline(np.linspace(0, 1, self.waypoints), through, k=5, bc_type=ends)
            upper, lower = (0.9 + (1.1 - 0.9) * one[points:]).reshape(3, 2, self.axes).transpose(1, 0, 2)
            yield path, np.array(self.limits)[:, None, None] * np.stack([lower, upper], 1)


def chacha_numbers(seed: int, count: int) -> Array:
    """So many numbers in [0, 1) of ChaCha with 12 rounds, 52 bits each, as Rust's `StdRng` gives them for a seed.

    The key is drawn from the seed by PCG32 [O'Neill 2014]; ChaCha: Bernstein 2008.
    """
    state, key = seed, []
    for _ in range(8):
        state = (state * 6364136223846793005 + 11634580027462260723) % 2**64
        word, turn = (((state >> 18) ^ state) >> 27) % 2**32, state >> 59
        key.append((word >> turn | word << (32 - turn)) % 2**32)
    blocks = -(-count // 8)
    first = np.zeros((16, blocks), np.uint32)
    first[:4] = np.frombuffer(b"expand 32-byte k", "<u4")[:, None]
    first[4:12], first[12] = np.array(key, np.uint32)[:, None], np.arange(blocks)
    x = first.copy()

    def mix(a: int, b: int, c: int, d: int) -> None:
        for to, by, other, turn in ((a, b, d, 16), (c, d, b, 12), (a, b, d, 8), (c, d, b, 7)):
            x[to] += x[by]
            x[other] ^= x[to]
            x[other] = x[other] << np.uint32(turn) | x[other] >> np.uint32(32 - turn)

    for _ in range(6):
        for k in range(4):
            mix(k, 4 + k, 8 + k, 12 + k)
        for k in range(4):
            mix(k, 4 + (k + 1) % 4, 8 + (k + 2) % 4, 12 + (k + 3) % 4)
    words = (x + first).T.astype(np.uint64).ravel()
    numbers: Array = ((words[::2] | words[1::2] << np.uint64(32)) >> np.uint64(12))[:count] / 2.0**52
    return numbers


def make_case(path: BSpline, bounds: Array) -> Case:
    drawn = polynomials(path)
    real = np.diff(drawn.x) > 0
    names = [f"axis{k + 1}" for k in range(bounds.shape[2])]
    sides = [[(below, above) for below, above in one.T.tolist()] for one in bounds]
    axes = tuple(
        Axis(name, max_speed=v, max_acceleration=a, max_jerk=j) for name, v, a, j in zip(names, *sides, strict=True)
    )
    breaks = np.append(drawn.x[:-1][real], drawn.x[-1])
    return Case("random spline", PolynomialPath(breaks, drawn.c[:, real], names), axes)


def solve_ours(path: BSpline, bounds: Array, order: int) -> tuple[PeerAnswer, tuple[str, ...]]:
    """Solved and certified, and the methods of its runs. Raises MotionError where it is not."""
    speed, acceleration, jerk = (one.T for one in bounds)
    begin = process_time()
    found = time_optimal(path, max_speed=speed, max_acceleration=acceleration, max_jerk=jerk if order == 3 else None)
    took = process_time() - begin
    state = found.trajectory.at(np.linspace(0, found.trajectory.duration, INSTANTS))
    use = largest_uses((state.qd, state.qdd, np.where(order == 3, state.qddd, np.inf)), bounds)
    name = f"ours, order {order}, certified" if found.certificate.holds else "not certified"
    return PeerAnswer("random spline", order, name, None, took, took, found.trajectory.duration, use), found.methods


def solve_theirs(case: Case, order: int, linearisations: int) -> PeerAnswer:
    from copp_py import CoppError

    name = "TOPP2-RA" if order == 2 else f"TOPP3-SOCP, {linearisations} linearisation{'s'[: linearisations > 1]}"
    nan, begin = float("nan"), process_time()
    try:
        duration, samples = solve_grid(case, order, INTERVALS, 0.0, 1, linearisations)
    except CoppError as no:
        took = process_time() - begin
        return PeerAnswer(case.name, order, f"copp-py {name}", INTERVALS, took, took, nan, (nan, nan, nan), str(no))
    took = process_time() - begin
    return PeerAnswer(case.name, order, f"copp-py {name}", INTERVALS, took, took, duration, worst(case, samples))


HEADER = (
    "method", "answers", "time (ms): mean", "longest", "duration (s): mean", "std", "largest use of a limit",
    "slowed to hold (s): mean",
)  # fmt: skip


def summarize(answers: list[PeerAnswer]) -> list[str]:
    """A row of all answers of one method."""
    found = [a for a in answers if a.duration == a.duration]
    times = [1e3 * a.again for a in answers]
    durations, held = np.array([a.duration for a in found]), np.array([a.feasible for a in found])
    use = max(max(a.worst[: a.order]) for a in found)
    return [
        answers[0].method, f"{len(found)} of {len(answers)}", f"{np.mean(times):.0f}", f"{max(times):.0f}",
        f"{durations.mean():.6f}", f"{durations.std(ddof=min(1, len(found) - 1)):.6f}",
        f"{use:.6f}", f"{held.mean():.6f}",
    ]  # fmt: skip


def compare(suite: Suite, tell: Callable[[str], Any] = print) -> dict[str, list[PeerAnswer]]:
    """Every problem by every method, of which copp-py's are there where it is installed."""
    found = dict[str, list[PeerAnswer]]()
    for number, (path, bounds) in enumerate(suite.problems()):
        if number == 0:  # what is loaded and compiled once is no part of a solve
            solve_ours(path, bounds, 3)
        answers = []
        for order in (2, 3):
            answer, methods = solve_ours(path, bounds, order)
            answers.append(answer)
            if any("slowed" in method.split(", ") for method in methods):
                tell(f"problem {number}, order {order}: {'; '.join(methods)}")
        if is_installed("copp_py"):
            case = make_case(path, bounds)
            answers += [solve_theirs(case, order, times) for order, times in ((2, 1), (3, 1), (3, 6))]
        for answer in answers:
            found.setdefault(answer.method, []).append(answer)
    return found


def main() -> None:
    parser = ArgumentParser(prog="python -m benchmarks.evidence.peers.random_splines", description=__doc__)
    parser.add_argument("--suite", type=Path, help="tests/test_random_spline.rs of COPP's sources")
    parser.add_argument("--count", type=int, help="the first so many problems; else all")
    asked = parser.parse_args()
    suite = Suite.read(asked.suite) if asked.suite else Suite()
    found = compare(suite if asked.count is None else replace(suite, count=asked.count))
    print(markdown(HEADER, [summarize(answers) for answers in found.values()]))
    if asked.suite:
        text = asked.suite.read_text(encoding="utf-8").partition("Tf(s) mean/std:")[2].partition("#[test]")[0]
        printed = re.findall(r"(\S+)\s*: mean = ([\d.]+), std = ([\d.]+)", text)
        print(
            "COPP prints of its durations: " + "; ".join(f"{name} {mean} s, std {std} s" for name, mean, std in printed)
        )


if __name__ == "__main__":
    main()
