"""The firing rules beside each other on the hexapod's circle: `python -m benchmarks.firing_rules [FIGURE.png]`.

A table of what each rule states and keeps, proved by the independent check, and a figure of their errors over time.
"""

import sys
from pathlib import Path

from matplotlib.figure import Figure

from kinematics import load_machine
from planner import Plan, load_program, plan
from planner.pulses import RULES, PulseSchedule, check, generate
from planner.pulses.errors import axis_errors, space_errors

HYSTERESIS = "nearest:hysteresis=0.2"
FIGURE = Path("firing-rules.png")
SHOWN = 4e-4  # s of the close-up, some ten pulses


def compared(planned: Plan) -> list[PulseSchedule]:
    """The pulses of a plan's motion by every rule as it is by default, and by `nearest` with hysteresis."""
    machine = planned.machine
    rules = [*RULES, HYSTERESIS]
    return [generate(planned.trajectory, machine.axes, machine.home_q, rule=rule) for rule in rules]


def table(planned: Plan, schedules: list[PulseSchedule]) -> list[str]:
    """A row for each schedule: its rule, the widest bound, the worst error over all axes, pulses, smallest interval."""
    motion, machine = planned.trajectory, planned.machine
    head = f"{'rule':<24}{'bound':>9}{'worst':>9}{'pulses':>10}{'interval':>11}{'in space':>10}{'faults':>8}"
    rows = [head, f"{'':<24}{'pulses':>9}{'pulses':>9}{'':>10}{'µs':>11}{'µm':>10}{'':>8}"]
    for schedule in schedules:
        bound = max(axis.bound for axis in schedule.axes)
        worst = max(abs(axis_errors(schedule, planned.counted, k)[1]).max() for k in range(len(schedule.axes)))
        interval = 1e6 * (schedule.smallest_interval or 0) / schedule.clock_hz
        space = 1e6 * space_errors(schedule, motion, machine)[1].max()
        faults = check(schedule, planned.counted, machine.axes, machine.home_q).fault_count
        rows.append(
            f"{schedule.rule:<24}{bound:>9.3f}{worst:>9.3f}{schedule.total:>10}{interval:>11.1f}{space:>10.3f}{faults:>8}"
        )
    return rows


def draw(planned: Plan, schedules: list[PulseSchedule]) -> Figure:
    """The errors of one axis over time and close up, and in space."""
    from planner.pulses.plots import axis_error, close_up, space_error

    figure = Figure(figsize=(10, 10), layout="constrained")
    over_time, near, space = figure.subplots(3)
    axis_error(schedules, planned.counted, 0, over_time)
    middle = planned.trajectory.duration / 2
    close_up(schedules, planned.counted, middle, middle + SHOWN, 0, near)
    near.set_ylim(-1.3, 1.3)
    space_error(schedules, planned.trajectory, planned.machine, space)
    figure.legend(*over_time.get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    return figure


def main() -> None:
    planned = plan(load_program("circle"), load_machine("hexapod"))
    schedules = compared(planned)
    print("\n".join(table(planned, schedules)))
    figure = Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE
    draw(planned, schedules).savefig(figure, dpi=110)
    print(f"figure: {figure}")


if __name__ == "__main__":
    main()
