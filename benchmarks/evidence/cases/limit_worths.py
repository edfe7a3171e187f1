"""Savings predicted for 1 % more of each limit, compared with planning again.

Motions of the bundled programs on their machines, and of random splines of three axes, at both
orders where jerk is limited. Listed is each limit, of one axis and of all together, whose saving or
prediction is above `--share` of the duration: smaller ones drown in the difference that two grids
make.
"""

from collections.abc import Iterator

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.evidence.table import Row, Table
from kinematics import load_machine
from planner import load_program, program_names, time_optimal
from planner.bounds.limit_worth import ALL, find_worth
from planner.limits import limits_of, usual_order
from planner.path.actuation import actuate
from planner.timing.certified_solve import Solution, certified_solve

STEP = 0.01
CLOSE = 0.1
SPLINES = 3
COLUMNS = ("limit", "axis", "predicted (ms)", "saved (ms)", "error (%)", "with others (ms)")


def solve_cases() -> Iterator[tuple[str, Solution]]:
    """Yield the motions of the bundled programs without a free orientation, and of random
    splines.
    """
    for name in program_names():
        program = load_program(name)
        if program.machine is None or name == "free-yaw":
            continue
        machine = load_machine(program.machine)
        path = actuate(program, machine)
        for order in range(2, usual_order(machine.axes) + 1):
            limits = limits_of(path, machine.axes, order)
            yield f"{name}, order {order}", certified_solve(path, limits, order)
    rng = np.random.default_rng(7)
    for number in range(SPLINES):
        curve = CubicSpline(np.arange(8.0), rng.uniform(-1, 1, (8, 3)))
        for jerk in (None, 20.0):
            solution = time_optimal(curve, max_speed=1.0, max_acceleration=2.0, max_jerk=jerk)
            yield f"spline {number}, order {solution.order}", solution


def compare(solution: Solution, share: float) -> Iterator[tuple[str, str, float, float, float]]:
    """Yield each limit that counts: limit, axis and three savings (s).

    The savings are the predicted one, that of planning again with `STEP` more of the limit, and the
    predicted one together with the limits that bind in the same places.
    """
    worth = find_worth(
        solution.trajectory,
        solution.limits,
        solution.order,
        solution.certificate,
        solution.bound,
    )
    rows = zip(worth.limits, worth.axes, worth.saved, worth.together, strict=True)
    for limit, axis, predicted, together in rows:
        saved = worth.replan(limit, axis, STEP).saved
        if max(predicted, saved) > share * solution.trajectory.duration:
            yield limit, axis, float(predicted), saved, float(together)


def measure(share: float = 3e-4) -> Iterator[Table]:
    """Yield one table for each motion, and the errors of all predictions."""
    joint: list[float] = []
    single: list[float] = []
    largest: dict[str, float] = {}
    for name, solution in solve_cases():
        rows: list[Row] = []
        for limit, axis, predicted, saved, together in compare(solution, share):
            error = abs(predicted / saved - 1) if saved > 0 else np.inf
            rows.append([limit, axis, 1e3 * predicted, 1e3 * saved, 100 * error, 1e3 * together])
            if axis in (ALL, "tool"):
                joint.append(error)
                largest[name] = max(largest.get(name, 0.0), error)
            else:
                single.append(error)
        gap = f"{solution.trajectory.duration:.6f} s, gap {100 * solution.gap:.3f} %"
        yield Table(name, COLUMNS, rows, gap)
    yield summarise({"all axes together": joint, "one axis": single}, largest)


def summarise(errors: dict[str, list[float]], largest: dict[str, float]) -> Table:
    """Return the table of errors |predicted / saved − 1|; largest: the largest one of each
    motion.
    """
    rows: list[Row] = []
    for name, values in [*errors.items(), ("worst of each motion", list(largest.values()))]:
        near = sum(value <= CLOSE for value in values)
        rows.append([name, len(values), near, 100 * float(np.median(values)), 100 * max(values)])
    columns = ("limits of", "number", "within 10 %", "median error (%)", "largest error (%)")
    return Table("Errors of the predictions", columns, rows)
