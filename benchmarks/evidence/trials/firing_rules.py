"""The firing rules beside each other on the hexapod's circle: `python -m benchmarks.evidence.trials.firing_rules
[FIGURE.png]`.

A table of what each rule states and keeps, proved by the independent check, and a figure of their errors over time.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kinematics import load_machine
from kinematics.foundation.arrays import Array
from kinematics.foundation.figure import PALETTE, new_axes
from kinematics.machine.machine import Machine
from planner import Plan, load_program, plan
from planner.pulses import RULES, check, generate
from planner.pulses.motion import AxesMotion, axis_errors, space_errors
from planner.pulses.schedule import PulseSchedule
from planner.trajectory import Trajectory

HYSTERESIS = "nearest:hysteresis=0.2"
FIGURE = Path("firing-rules.png")
CLOSE_UP_SPAN = 4e-4  # s of the close-up, some ten pulses


def fire_by_rules(planned: Plan) -> list[PulseSchedule]:
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

    figure = Figure(figsize=(10, 10), layout="constrained")
    over_time, near, space = figure.subplots(3)
    axis_error(schedules, planned.counted, 0, over_time)
    middle = planned.trajectory.duration / 2
    draw_close_up(schedules, planned.counted, middle, middle + CLOSE_UP_SPAN, 0, near)
    near.set_ylim(-1.3, 1.3)
    space_error(schedules, planned.trajectory, planned.machine, space)
    figure.legend(*over_time.get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    return figure


def main() -> None:
    planned = plan(load_program("circle"), load_machine("hexapod"))
    schedules = fire_by_rules(planned)
    print("\n".join(table(planned, schedules)))
    figure = Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE
    draw(planned, schedules).savefig(figure, dpi=110)
    print(f"figure: {figure}")


if __name__ == "__main__":
    main()


WINDOWS = 300
"""Of time, in each of which the largest error is drawn."""
WIDTHS = (3.0, 1.4, 1.4, 1.4, 1.4, 1.2)
"""The first line shows where others lie upon it."""
STYLES = ("-", (0, (4, 2)), "-", "-", (0, (1, 1)), "-.")


def axis_error(schedules: Sequence[PulseSchedule], motion: AxesMotion, axis: int = 0, ax: Axes | None = None) -> Axes:
    """The largest |count·pulse - (q - home)| of an axis in each window of time, in pulses, for every schedule."""
    ax = new_axes(ax)
    for n, schedule in enumerate(schedules):
        _draw_windows(ax, n, *axis_errors(schedule, motion, axis), schedule.rule, motion.duration)
    ax.set(ylabel=f"largest error of {schedules[0].axes[axis].name} (pulses)")
    return ax


def space_error(
    schedules: Sequence[PulseSchedule], motion: Trajectory, machine: Machine, ax: Axes | None = None
) -> Axes:
    """The largest error of the platform's origin in each window of time, in µm, for every schedule."""
    ax = new_axes(ax)
    for n, schedule in enumerate(schedules):
        t, error = space_errors(schedule, motion, machine)
        _draw_windows(ax, n, t, 1e6 * error, schedule.rule, motion.duration)
    ax.set(ylabel="largest error in space (µm)")
    return ax


def draw_close_up(
    schedules: Sequence[PulseSchedule],
    motion: AxesMotion,
    since: float,
    until: float,
    axis: int = 0,
    ax: Axes | None = None,
) -> Axes:
    """Count - (q - home)/pulse of an axis between two instants (s), pulse by pulse, for every schedule."""
    ax = new_axes(ax)
    for n, schedule in enumerate(schedules):
        t, error = axis_errors(schedule, motion, axis)
        part = slice(*np.searchsorted(t, (since, until)))
        color, style = PALETTE[n % len(PALETTE)], STYLES[n % len(STYLES)]
        ax.plot(
            1e3 * t[part],
            error[part],
            color=color,
            linestyle=style,
            linewidth=WIDTHS[n % len(WIDTHS)],
            label=schedule.rule,
        )
    ax.set(xlabel="time (ms)", ylabel=f"count - x of {schedules[0].axes[axis].name} (pulses)")
    ax.set(xlim=(1e3 * since, 1e3 * until))
    return ax


def _draw_windows(ax: Axes, n: int, t: Array, error: Array, label: str, duration: float) -> None:
    edges = np.linspace(0.0, duration, WINDOWS + 1)
    starts = np.minimum(np.searchsorted(t, edges[:-1]), len(t) - 1)
    largest = np.maximum.reduceat(abs(error), starts)
    color, style = PALETTE[n % len(PALETTE)], STYLES[n % len(STYLES)]
    ax.plot(
        (edges[1:] + edges[:-1]) / 2,
        largest,
        color=color,
        linestyle=style,
        linewidth=WIDTHS[n % len(WIDTHS)],
        label=label,
    )
    ax.set(xlabel="time (s)", yscale="log", xlim=(0.0, duration))
