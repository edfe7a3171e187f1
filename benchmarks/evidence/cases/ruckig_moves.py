"""Random moves of one axis by us and by ruckig.

Moves are drawn as ruckig's tests draw them: positions normal with 4, limits even from 0.08 to 16;
from rest to rest, and between speeds up to the limit without acceleration. What ours refuses
between speeds must be what ruckig can only do by moving backwards. Ours are certified and stay
1e-9 below the limits. Those of the general order-3 solver, on a grid, are slowed until they hold.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.evidence.peers.ours import solve_certified, solve_general
from benchmarks.evidence.peers.problems import PathProblem, slow_to_hold
from benchmarks.evidence.peers.ruckig_ import find_trajectory
from benchmarks.evidence.table import Row, Table
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis
from planner.path.polynomial import PolynomialPath

# Instants at which ruckig's speed is sampled.
INSTANTS = 201
COLUMNS = (
    "moves",
    "count",
    "refused by ours",
    "of these ruckig turns back",
    "largest ours/theirs − 1",
    "where",
)


@dataclass(frozen=True, slots=True)
class Move:
    """Length, limits on speed, acceleration and jerk, and ṡ at both ends."""

    length: float
    limits: tuple[float, float, float]
    speeds: tuple[float, float] = (0.0, 0.0)

    @property
    def problem(self) -> PathProblem:
        """The straight line."""
        speed, acceleration, jerk = self.limits
        axis = Axis("x", max_speed=speed, max_acceleration=acceleration, max_jerk=jerk)
        breaks = np.array([0.0, self.length])
        path = PolynomialPath(breaks, np.array([[[1.0]], [[0.0]]]), ["x"], self.speeds)
        return PathProblem("straight", path, (axis,))

    def solve(self) -> float:
        """Return our duration, certified. Raises MotionError if no motion exists."""
        return solve_certified(self.problem, 3)().duration

    def solve_generally(self) -> float:
        """Return the duration by the order-3 solver on a grid, slowed to hold."""
        motion = solve_general(self.problem)()
        return slow_to_hold(motion.duration, motion.uses(self.problem.bounds))

    def solve_by_ruckig(self) -> tuple[float, bool]:
        """Return ruckig's duration, and whether it ever moves backwards."""
        trajectory = find_trajectory(self.length, self.limits, self.speeds)
        duration = float(trajectory.duration)
        speeds = [trajectory.at_time(t)[1][0] for t in np.linspace(0, duration, INSTANTS)]
        return duration, min(speeds) < -1e-9 * self.limits[0]


def measure(count: int = 1000, general: int = 100) -> Iterator[Table]:
    """Yield the table; general: number of moves by the general solver."""
    yield Table("", COLUMNS, compare(count, general))


def compare(count: int, general: int) -> Iterator[Row]:
    """Yield a row for each kind of moves."""
    yield compare_moves(count, between_speeds=False)
    yield compare_moves(count, between_speeds=True)
    moves = [draw_move(seed, between_speeds=False) for seed in range(general)]
    differences = [move.solve_generally() / move.solve_by_ruckig()[0] - 1 for move in moves]
    yield [
        "from rest to rest, general solver",
        general,
        0,
        None,
        *find_largest(dict(enumerate(differences))),
    ]


def compare_moves(count: int, *, between_speeds: bool) -> Row:
    """Return the row of random moves. Raises MotionError where only one of us has a motion."""
    differences: dict[int, float] = {}
    for seed in range(count):
        move = draw_move(seed, between_speeds=between_speeds)
        duration, turns = move.solve_by_ruckig()
        try:
            ours = move.solve()
        except MotionError:
            if not turns:
                raise
            continue
        if turns:
            times = f"ours takes {ours:.9f} s; ruckig turns back and takes {duration:.9f} s"
            raise MotionError(f"seed {seed}: {times}")
        differences[seed] = ours / duration - 1
    refused = count - len(differences)
    kind = "between speeds" if between_speeds else "from rest to rest"
    return [kind, count, refused, refused, *find_largest(differences)]


def find_largest(differences: dict[int, float]) -> tuple[str, str]:
    """Return the largest difference, and its seed."""
    seed = max(differences, key=lambda seed: abs(differences[seed]))
    return f"{differences[seed]:+.1e}", f"seed {seed}"


def draw_move(seed: int, *, between_speeds: bool) -> Move:
    """Draw a move of one axis."""
    rng = np.random.default_rng([seed, between_speeds])
    start, end = rng.normal(0.0, 4.0, 2)
    speed, acceleration, jerk = rng.uniform(0.08, 16.0, 3).tolist()
    speeds = (0.0, 0.0)
    if between_speeds:
        first, last = rng.uniform(0.0, 1.0, 2) * speed * (rng.random(2) < 0.7)
        speeds = float(first), float(last)
    return Move(float(abs(end - start)), (speed, acceleration, jerk), speeds)
