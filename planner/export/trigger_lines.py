"""Triggers of a motion as formats write them: an output line for each name, or a note of the
triggers left out.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.names import count_noun
from kinematics.foundation.units import describe_value
from planner.pulses.schedule import PulseSchedule, Ticks
from planner.pulses.triggers import Triggered

MAX_LINES = 16
"""Largest number of output lines for triggers. Programs with more names share one line."""
MAX_NAMES = 8
"""Largest number of names in a note."""
ALL = "all"
"""Name of the line that all triggers share."""

Rows = Iterator[tuple[Ticks, NDArray[np.uint8]]]


def describe_lost(triggers: Sequence[Triggered]) -> tuple[str, ...]:
    """Return a warning that names the triggers missing in a file; nothing without triggers."""
    if not triggers:
        return ()
    names: dict[str, list[float]] = {}
    for event in triggers:
        names.setdefault(event.name, []).append(event.time)
    listed = [
        f"{describe_value(name)} at {times[0]:.6f} s"
        + (f" and {len(times) - 1} more times" if times[1:] else "")
        for name, times in list(names.items())[:MAX_NAMES]
    ]
    more = (
        f", and {count_noun(len(names) - MAX_NAMES, 'more name')}" if len(names) > MAX_NAMES else ""
    )
    return (f"WARNING: the file does not hold the program's triggers: {', '.join(listed)}{more}",)


@dataclass(frozen=True, slots=True)
class TriggerLine:
    """An output line: its name, and the clock ticks (N,) of its rising edges, the triggers."""

    name: str
    ticks: Ticks

    def edges(self, high: int) -> Ticks:
        """Return the ticks (2 N,) at which the line rises and falls in turn.

        It falls `high` ticks after it rises, or half-way to its next edge if that comes sooner.
        """
        rising = self.ticks
        gaps = np.diff(rising, append=np.iinfo(np.int64).max)
        return np.stack([rising, rising + np.clip(gaps // 2, 1, high)], 1).ravel()


def list_lines(
    triggers: Sequence[Triggered], pulses: PulseSchedule, most: int = MAX_LINES
) -> tuple[TriggerLine, ...]:
    """Return a line for each name, in the order of time; one for all if there are more than `most`.

    Triggers of one line in one tick are one edge.
    """
    if not triggers:
        return ()
    ticks = pulses.find_ticks(np.array([event.time for event in triggers], float)).astype(np.int64)
    names: dict[str, list[int]] = {}
    for event, tick in sorted(zip(triggers, ticks.tolist(), strict=True), key=lambda pair: pair[1]):
        names.setdefault(event.name, []).append(tick)
    if len(names) > most:
        return (TriggerLine(ALL, np.unique(ticks)),)
    return tuple(TriggerLine(name, np.unique(rises)) for name, rises in names.items())


def describe_lines(triggers: Sequence[Triggered], lines: Sequence[TriggerLine]) -> tuple[str, ...]:
    """Return a note with the number of triggers, and of triggers that share an edge."""
    if not triggers:
        return ()
    edges = sum(len(line.ticks) for line in lines)
    lost = len(triggers) - edges
    shared = f"; {lost} share the edge of another" if lost else ""
    return (
        f"triggers: {count_noun(edges, 'rising edge')} on {count_noun(len(lines), 'line')}{shared}",
    )


def join_lines(rows: Rows, lines: Sequence[TriggerLine], high: int) -> Rows:
    """Add trigger lines, as columns of levels, to rows of instants (N,) and levels (N, lines)."""
    if not lines:
        yield from rows
        return
    edges = [line.edges(high) for line in lines]
    waiting = np.unique(np.concatenate(edges))
    level: NDArray[np.uint8] | None = None
    for instants, levels in rows:
        if not len(instants):
            continue
        level = levels[:1] if level is None else level
        here, waiting = np.split(waiting, [np.searchsorted(waiting, instants[-1], side="right")])
        yield _join(instants, np.concatenate([level, levels]), here, edges)
        level = levels[-1:]
    if level is not None and len(waiting):  # triggers after the last edge of a pulse
        yield _join(waiting[:0], level, waiting, edges)


def _join(
    instants: Ticks, levels: NDArray[np.uint8], extra: Ticks, edges: Sequence[Ticks]
) -> tuple[Ticks, NDArray[np.uint8]]:
    """Join instants (N,) and further ones; levels (N + 1, lines): the first row is before all."""
    whole = np.union1d(instants, extra)
    given = levels[np.searchsorted(instants, whole, side="right")]
    # a line is high after an odd number of its edges
    levels_of_lines = [np.searchsorted(line, whole, side="right") % 2 for line in edges]
    return whole, np.column_stack([given, *levels_of_lines]).astype(np.uint8)
