"""Limits' worth beside planning again with each 1 % higher: `python -m benchmarks.evidence.trials.limit_worths`.

Over the preset programs on their machines and random splines of three axes, at both orders where jerk is limited. Of
every limit, of each axis and of all together, whose worth or saving is above `--share` of the duration (less drowns in
what two motions differ by through their grids).
"""

from argparse import ArgumentParser
from collections.abc import Iterator

import numpy as np
from scipy.interpolate import CubicSpline

from kinematics import load_machine
from kinematics.foundation.arrays import Array
from planner import load_program, program_names, time_optimal
from planner.limits import limits_of, usual_order
from planner.path.actuation import actuate
from planner.timing.certified_solve import Solution, certified_solve
from planner.tradeoffs.limit_worth import ALL, Worth, find_worth

STEP, CLOSE = 0.01, 0.1
SPLINES = 3


def solve_cases() -> Iterator[tuple[str, Solution]]:
    """Motions of the presets that leave no orientation open, and of random splines."""
    for name in program_names():
        program = load_program(name)
        if program.machine is None or name == "free-yaw":
            continue
        machine = load_machine(program.machine)
        path = actuate(program, machine)
        for order in range(2, usual_order(machine.axes) + 1):
            yield f"{name}, order {order}", certified_solve(path, limits_of(path, machine.axes, order), order)
    rng = np.random.default_rng(7)
    for n in range(SPLINES):
        curve = CubicSpline(np.arange(8.0), rng.uniform(-1, 1, (8, 3)))
        for jerk in (None, 20.0):
            found = time_optimal(curve, max_speed=1.0, max_acceleration=2.0, max_jerk=jerk)
            yield f"spline {n}, order {found.order}", found


def compare(found: Solution, share: float) -> Iterator[tuple[str, str, float, float, float]]:
    """limit, axis, s by the multipliers, s by planning again, and what is counted with others that bind beside it."""
    worth = find_worth(found.trajectory, found.limits, found.order, found.certificate, found.bound)
    for limit, axis, saved, beside in zip(worth.limits, worth.axes, worth.saved, worth.together, strict=True):
        again = replan(worth, limit, axis)
        if max(saved, again) > share * found.trajectory.duration:
            yield limit, axis, float(saved), again, float(beside)


def replan(worth: Worth, limit: str, axis: str) -> float:
    """s that STEP of a limit saves."""
    return worth.replan(limit, axis, STEP).saved


def describe(what: str, errors: Array) -> str:
    """One line of |prediction / saving − 1|."""
    if not len(errors):
        return f"{what}: none"
    within = f"{100 * (errors <= CLOSE).mean():.0f} % within 10 %"
    return f"{what}: {len(errors)}, {within}, median {np.median(errors):.3f}, largest {errors.max():.3f}"


def main() -> None:
    """Print every limit of every case, and how near the predictions are."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, default=3e-4)
    share = parser.parse_args().share
    every: list[tuple[bool, float]] = []
    worst: dict[str, float] = {}
    for what, found in solve_cases():
        print(f"{what}: {found.trajectory.duration:.6f} s, gap {100 * found.gap:.3f} %", flush=True)
        for limit, axis, saved, again, beside in compare(found, share):
            error = abs(saved / again - 1) if again > 0 else np.inf
            every.append((axis == ALL or axis == "tool", error))
            if every[-1][0]:
                worst[what] = max(worst.get(what, 0.0), error)
            told = f"{1e3 * saved:.4f} ms predicted, {1e3 * again:.4f} ms saved ({100 * error:.1f} % off)"
            print(f"  {limit} of {axis}: {told}, {1e3 * beside:.4f} ms with others", flush=True)
    of_all, errors = np.array([whole for whole, _ in every]), np.array([error for _, error in every])
    print(describe("limits of all axes together", errors[of_all]))
    print(describe("limits of one axis", errors[~of_all]))
    close = sum(error <= CLOSE for error in worst.values())
    print(f"plans with every limit of all axes within 10 %: {close} of {len(worst)}")


if __name__ == "__main__":
    main()
