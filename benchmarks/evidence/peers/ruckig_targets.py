"""ruckig's known durations and random moves by its rule, ours beside them: `python -m
benchmarks.evidence.peers.ruckig_targets`.

`--suite` names `test/test_target.cpp` of ruckig's sources: each duration that it expects of a move from rest to rest is
held against ours along the straight line between. Random moves are those of one axis, drawn as its tests draw them
(positions normal with 4, limits even from 0.08 to 16) from another generator: from rest to rest, and between speeds up
to the limit with no acceleration. What ours refuses between speeds must be what ruckig can only do by moving backwards.
Shown is the largest relative difference of durations: of the closed form, certified, which stays 1e-9 below the limits,
and of the general order-3 solver without a certificate, which has a grid.
"""

import re
from argparse import ArgumentParser
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.interpolate import PPoly

from benchmarks.evidence.peers.case import Case, is_installed, solve_general
from benchmarks.evidence.published.compared import markdown
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis
from planner import time_optimal
from planner.path.polynomial import PolynomialPath

# Instants at which ruckig's speed is looked at.
INSTANTS = 201


@dataclass(frozen=True, slots=True)
class StraightMove:
    """From one position to another, (n,) each, under limits (n,) on speed, acceleration and jerk; ṡ at both ends."""

    start: Array
    end: Array
    limits: tuple[Array, Array, Array]
    speeds: tuple[float, float] = (0.0, 0.0)

    def solve(self) -> float:
        """Our duration, certified. Raises MotionError where there is none."""
        way = self.end - self.start
        length = float(np.abs(way).max())
        path = PPoly(np.stack([way / length, self.start])[:, None], [0.0, length])
        speed, acceleration, jerk = self.limits
        start_speed, end_speed = self.speeds
        found = time_optimal(
            path, max_speed=speed, max_acceleration=acceleration, max_jerk=jerk,
            start_speed=start_speed, end_speed=end_speed,
        )  # fmt: skip
        if not found.certificate.holds:
            raise MotionError("not certified")
        return found.trajectory.duration

    def solve_generally(self) -> float:
        """By the order-3 solver, where the closed form would serve."""
        (length,), limits = np.abs(self.end - self.start), [bound.item() for bound in self.limits]
        path = PolynomialPath(np.array([0.0, length]), np.array([[[1.0]], [[0.0]]]), ["x"])
        speed, acceleration, jerk = limits
        axis = Axis("x", max_speed=speed, max_acceleration=acceleration, max_jerk=jerk)
        return solve_general(Case("straight", path, (axis,))).feasible


def read_targets(path: Path) -> Iterator[tuple[str, StraightMove, float]]:
    """The test's name, the move and the duration that is expected of it: of moves from rest to rest alone.

    The test sets fields of its input one after the other and then checks durations; a field keeps its value until the
    next test, or the next input.
    """
    fields, name = dict[str, Array](), ""
    sets = re.compile(r"input\.(\w+) = \{([-\d., e]*)\}")
    checks = re.compile(r"get_duration\(\) == doctest::Approx\(([\d.]+)\)")
    for line in path.read_text(encoding="utf-8").splitlines():
        if (case := re.search(r'TEST_CASE\("(.*)"\)', line)) is not None:
            name = case.group(1)
        if "InputParameter<" in line and ";" in line:
            fields = {}
        if (stated := sets.search(line)) is not None:
            fields[stated.group(1)] = np.array([float(one) for one in stated.group(2).split(",") if one.strip()])
        if (check := checks.search(line)) is not None and (move := _rest_to_rest(fields)) is not None:
            yield name, move, float(check.group(1))


def _rest_to_rest(fields: dict[str, Array]) -> StraightMove | None:
    moving = [fields.get(f"{when}_{what}") for when in ("current", "target") for what in ("velocity", "acceleration")]
    limits = [fields.get(f"max_{what}") for what in ("velocity", "acceleration", "jerk")]
    if any(one is not None and one.any() for one in moving) or any(one is None or not one.all() for one in limits):
        return None
    end = fields["target_position"]
    start = fields.get("current_position", np.zeros_like(end))
    speed, acceleration, jerk = (one for one in limits if one is not None)
    return StraightMove(start, end, (speed, acceleration, jerk)) if (start != end).any() else None


def random_move(seed: int, *, between_speeds: bool) -> StraightMove:
    """Of one axis."""
    rng = np.random.default_rng([seed, between_speeds])
    start, end = rng.normal(0.0, 4.0, (2, 1))
    speed, acceleration, jerk = rng.uniform(0.08, 16.0, (3, 1))
    ends = rng.uniform(0.0, 1.0, 2) * speed * (rng.random(2) < 0.7) if between_speeds else np.zeros(2)
    return StraightMove(start, end, (speed, acceleration, jerk), (float(ends[0]), float(ends[1])))


def solve_by_ruckig(move: StraightMove) -> tuple[float, bool]:
    """The duration, and whether the axis ever moves backwards."""
    from ruckig import InputParameter, Ruckig, Trajectory

    asked = InputParameter(1)
    asked.current_position, asked.target_position = [0.0], np.abs(move.end - move.start).tolist()
    asked.current_velocity, asked.target_velocity = [move.speeds[0]], [move.speeds[1]]
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = (bound.tolist() for bound in move.limits)
    trajectory = Trajectory(1)
    Ruckig(1).calculate(asked, trajectory)
    duration = float(trajectory.duration)
    speeds = [trajectory.at_time(t)[1][0] for t in np.linspace(0, duration, INSTANTS)]
    return duration, min(speeds) < -1e-9 * move.limits[0].item()


@dataclass(slots=True)
class Tally:
    """What became of moves of one kind: how many, how many ours refuses and how many of these turn back by ruckig."""

    what: str
    count: int = 0
    refused: int = 0
    turning: int = 0
    largest: float = 0.0
    where: str = ""
    faults: list[str] = field(default_factory=list)

    def add(self, ours: float, theirs: float, where: str) -> None:
        difference = ours / theirs - 1
        if abs(difference) > abs(self.largest):
            self.largest, self.where = difference, where

    @property
    def cells(self) -> list[str]:
        return [
            self.what, str(self.count), str(self.refused), str(self.turning), f"{self.largest:+.1e}", self.where
        ]  # fmt: skip


HEADER = ("moves", "count", "refused by ours", "of these ruckig turns back", "largest ours/theirs − 1", "where")


def compare_moves(count: int, *, between_speeds: bool) -> Tally:
    """The closed form, certified, beside ruckig."""
    tally = Tally("between speeds" if between_speeds else "from rest to rest")
    for seed in range(count):
        move = random_move(seed, between_speeds=between_speeds)
        theirs, turns = solve_by_ruckig(move)
        tally.count += 1
        try:
            ours = move.solve()
        except MotionError as no:
            tally.refused += 1
            tally.turning += turns
            if not turns:
                tally.faults.append(f"seed {seed}: {no}")
            continue
        if turns:  # the fastest motion leaves the path: nothing to hold ours against
            tally.faults.append(f"seed {seed}: ours takes {ours:.9f} s, ruckig turns back and takes {theirs:.9f} s")
        else:
            tally.add(ours, theirs, f"seed {seed}")
    return tally


def compare_general(count: int) -> Tally:
    """The order-3 solver on the same moves, uncertified, slowed until the samples keep every limit."""
    tally = Tally("from rest to rest, general solver")
    for seed in range(count):
        move = random_move(seed, between_speeds=False)
        tally.count += 1
        tally.add(move.solve_generally(), solve_by_ruckig(move)[0], f"seed {seed}")
    return tally


def compare_targets(suite: Path) -> Tally:
    tally = Tally("ruckig's own targets")
    for name, move, expected in read_targets(suite):
        tally.count += 1
        ours = move.solve()
        print(f"{name}: {len(move.start)} axes, {expected:.10g} s expected, ours {ours:.10f} s")
        tally.add(ours, expected, name)
    return tally


def main() -> None:
    parser = ArgumentParser(prog="python -m benchmarks.evidence.peers.ruckig_targets", description=__doc__)
    parser.add_argument("--suite", type=Path, help="test/test_target.cpp of ruckig's sources")
    parser.add_argument("--count", type=int, default=1000, help="how many random moves of each kind")
    parser.add_argument("--general", type=int, default=100, help="how many of them by the general solver too")
    asked = parser.parse_args()
    tallies = [compare_targets(asked.suite)] if asked.suite else []
    if is_installed("ruckig"):
        tallies += [compare_moves(asked.count, between_speeds=between_speeds) for between_speeds in (False, True)]
        tallies.append(compare_general(asked.general))
    print(markdown(HEADER, [tally.cells for tally in tallies]))
    print(*(fault for tally in tallies for fault in tally.faults), sep="\n")


if __name__ == "__main__":
    main()
