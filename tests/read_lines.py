"""A pulse CSV read back as a whole, as the check reads it in parts."""

from dataclasses import replace

from planner.pulses.checking.edge_reader import Lines, parts
from planner.pulses.schedule import join_schedules


def read(path, clock_hz, axes, home_q, *, start=None, duration=None):
    """start: counts before the first pulse, None: 0; duration (s), None: up to the last row."""
    held = list(parts(path, clock_hz, axes, home_q, start=start))
    schedule = join_schedules(part.schedule for part in held)
    return Lines(
        schedule if duration is None else replace(schedule, duration=duration), held[-1].times
    )
