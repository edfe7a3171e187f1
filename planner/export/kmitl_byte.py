"""One byte per step, for a parallel port [KMITL 2005]: bit 2i is the step of axis i, bit 2i + 1 its direction.

X+ 1, X- 3, Y+ 4, Y- 12, Z+ 16, Z- 48; axes that step in the same tick share a byte. Direction 0 is a positive count of
the wiring. The reader puts each byte out, and 0 after it: so STEP falls, and direction has no set-up time of its own.
The file is nothing but these bytes: it holds no times, no start counts, and at most four axes.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from kinematics.errors import MotionError
from planner.export.format import Exported, Source
from planner.pulses.schedule import Ticks

MOST = 4


@dataclass(frozen=True, slots=True)
class KmitlByte:
    """One byte per step for a parallel port, at most four axes."""

    suffix: ClassVar[str] = ".bin"

    def write(self, source: Source, path: Path) -> Exported:
        axes, pulses = source.machine.axes, source.pulses.axes
        if len(axes) > MOST:
            raise MotionError(f"byte: machine {source.machine.name} has {len(axes)} axes; a byte holds {MOST} at most")
        ticks = np.unique(np.concatenate([axis.ticks for axis in pulses]))
        steps = np.zeros(len(ticks), np.uint8)
        for k, (axis, driven) in enumerate(zip(pulses, axes, strict=True)):
            back = axis.direction != driven.direction
            steps[np.searchsorted(ticks, axis.ticks)] |= np.where(back, 3 << 2 * k, 1 << 2 * k).astype(np.uint8)
        path.write_bytes(steps.tobytes())
        held = _counts(np.frombuffer(path.read_bytes(), np.uint8), len(axes))
        error = 0.0
        for k, (axis, driven) in enumerate(zip(pulses, axes, strict=True)):
            error = max(
                error, float(abs(held[:, k] * driven.direction + axis.start - axis.counts(ticks)).max(initial=0))
            )
        starts = ", ".join(str(axis.start * driven.direction) for axis, driven in zip(pulses, axes, strict=True))
        return Exported(
            error,
            "the counts after every step",
            (f"{len(steps)} bytes, {len(axes)} axes; it holds no times", f"counters must stand at {starts} before it"),
            len(held),
        )


def _counts(steps: NDArray[np.uint8], axes: int) -> Ticks:
    """(N, axes) counts of the wiring from 0, after every byte."""
    bits = steps[:, None].astype(np.int64) >> 2 * np.arange(axes)
    return np.cumsum((bits & 1) * (1 - (bits & 2)), axis=0)
