"""The run-length step queue: pulses as short polynomials, as firmware that makes the steps itself takes them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import freeze_array, freeze_fields
from planner.pulses.schedule import Signs, Ticks

MAX_COUNT = 65535
"""Most pulses of a command, an unsigned 16-bit number."""
MAX_ADD = 32767
"""Largest magnitude of a command's add, a signed 16-bit number."""
MAX_INTERVAL = 2**32 - 1
"""Most ticks of a command's interval, an unsigned 32-bit number."""


@dataclass(frozen=True, slots=True)
class StepQueue:
    """The commands of one axis, in ticks of the schedule's clock: pulse k (from 0) of a command falls at

        first + k·interval + add·k(k+1)/2     with first = last + interval

    where last is the last pulse of the command before, or the tick that the clock is reset to.

    interval   (M,) int64, 0 to 2³²-1: from the pulse before to the first
    count      (M,) int64, 1 to 65535 pulses
    add        (M,) int64, ±32767: what the interval grows by after every pulse
    direction  (M,) int8, +1/-1 in q
    reset      (M,) int64, the tick that the clock is set to before the command; -1: it goes on
    """

    name: str
    interval: Ticks
    count: Ticks
    add: Ticks
    direction: Signs
    reset: Ticks

    def __post_init__(self) -> None:
        freeze_fields(self, "interval", "count", "add", "reset", dtype=np.int64)
        object.__setattr__(self, "direction", freeze_array(self.direction, np.int8))

    def __len__(self) -> int:
        return len(self.interval)

    @property
    def last(self) -> Ticks:
        """(M,) the tick from which each command counts: of the pulse before, or of the reset."""
        end = np.cumsum(self.count * self.interval + self.add * (self.count * (self.count - 1) // 2))
        before = np.concatenate([[0], end[:-1]])
        resets = np.flatnonzero(self.reset >= 0)
        shift = np.zeros(len(self), np.int64)
        if len(resets):
            offset = self.reset[resets] - before[resets]
            shift[resets] = np.diff(offset, prepend=0)
        result: Ticks = before + np.cumsum(shift)
        return result


def decompress(queue: StepQueue) -> tuple[Ticks, Signs]:
    """Ticks (N,) and directions (N,) of the pulses that the commands stand for."""
    first = np.cumsum(queue.count) - queue.count
    command: NDArray[np.intp] = np.repeat(np.arange(len(queue)), queue.count)
    nth = np.arange(len(command)) - first[command]
    ticks = queue.last[command] + (nth + 1) * queue.interval[command] + queue.add[command] * (nth * (nth + 1) // 2)
    return ticks, queue.direction[command]
