"""What a batch does, kept as it happens: every so many samples of the drives, in pulses."""

from __future__ import annotations

import numpy as np

from controllers.drives.axes import Response
from kinematics.array import Array


class Recorder:
    """Records (K, B, n) of samples 0, every, 2 every, …; they are filled from the first to the last, block by block."""

    def __init__(self, samples: int, every: int, pulse: Array, lanes: tuple[int, int]) -> None:
        self.every, self.pulse = every, pulse
        shape = (-(-samples // every), *lanes)
        self.command, self.actual, self.measured, self.speed, self.torque = (np.empty(shape) for _ in range(5))

    def kept(self, first: int, count: int) -> np.ndarray:
        """Which of the `count` samples from `first` on are kept, from 0."""
        return np.arange(-first % self.every, count, self.every)

    def put(self, first: int, counter: np.ndarray, told: Response) -> None:
        """The card's counter (N, B, n) at the samples from `first` on, and what the axes told of those kept."""
        at = self.kept(first, len(counter))
        row = -(-first // self.every)
        rows = slice(row, row + len(at))
        self.command[rows] = counter[at]
        np.divide(told.position, self.pulse, out=self.actual[rows])
        np.divide(told.reading, self.pulse, out=self.measured[rows])
        np.divide(told.speed, self.pulse, out=self.speed[rows])
        self.torque[rows] = told.torque

    def done(self) -> dict[str, Array]:
        """The records by name, read-only from now on."""
        records = {name: getattr(self, name) for name in ("command", "actual", "measured", "speed", "torque")}
        for record in records.values():
            record.setflags(write=False)
        return records
