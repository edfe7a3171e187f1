"""How far a file is from the motion: what was written is decoded, interpolated as its consumer does, and compared."""

from collections.abc import Iterable

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.units import apart
from kinematics.machine.axis import Axis
from planner.export.format import Exported
from planner.export.knots import MAX_BACKWARD_PULSES, Knots, Segments
from planner.pulses.motion import AxesMotion

SEGMENT_PROBES = 16  # parts of a segment, and
PROBES_PER_PIECE = 4  # of every piece of the motion inside it
INSTANT_BATCH = 1 << 16  # compared together
READ = {1: "straight", 2: "cubic", 3: "quintic"}


def compare(
    motion: AxesMotion,
    axes: tuple[Axis, ...],
    knots: Knots,
    points: Iterable[tuple[Array, Array]],
    notes: tuple[str, ...],
) -> Exported:
    """What the points of a decoded file are from a motion.

    points  in blocks, in order: t (K,) s from the start, and what is stated there (rows, K, axes), m or rad
    Raises MotionError where that is more than the tolerance for which the knots were chosen.
    """
    pulse = np.array([axis.pulse for axis in axes])
    worst, back, backs, rows, moves = 0.0, 0.0, 0, 0, 0
    t, stated = np.empty(0), np.empty((0, 0, 0))
    for after, further in points:
        rows = len(further)
        t = np.concatenate([t[-1:], after])
        stated = np.concatenate([stated[:, -1:], further], 1) if stated.size else further
        moves += int(np.diff(stated[0], axis=0).any(1).sum())
        for part in _parts(motion, t):
            ends = slice(part.start + 1, part.stop + 1)
            segments = Segments(t[part], t[ends], stated[:, part], stated[:, ends])
            probes = _probes(motion, segments.start, segments.end)
            worst = max(worst, float((segments.deviation(motion, probes) / pulse).max()))
            runs = (segments.backward(motion, probes) / pulse).max(1)
            back, backs = max(back, float(runs.max())), backs + int((runs > 2 * MAX_BACKWARD_PULSES).sum())
    if knots.tolerance is not None and not worst <= knots.tolerance:
        off, most = apart(worst, knots.tolerance, digits=4)
        raise MotionError(
            f"decoded file: {off} pulses from the motion, more than the tolerance {most}; "
            "give a greater tolerance, or a spacing"
        )
    if backs:
        notes += (
            f"segments that run back where the motion does not, their speeds too high for their way: {backs}, by up to "
            f"{back:.3g} pulses; a smaller spacing mends that",
        )
    return Exported(worst, f"the motion, {READ[rows]} between the points", (knots.stated(), *notes), moves)


def _probes(motion: AxesMotion, start: Array, end: Array) -> int:
    pieces = np.searchsorted(motion.knots, end) - np.searchsorted(motion.knots, start)
    return max(SEGMENT_PROBES, PROBES_PER_PIECE * int(pieces.max()))


def _parts(motion: AxesMotion, t: Array) -> Iterable[slice]:
    """Runs of segments of which all instants are compared together."""
    first, last = 0, len(t) - 1
    size = max(1, INSTANT_BATCH // max(SEGMENT_PROBES, _probes(motion, t[:-1], t[1:]))) if last > 0 else 1
    for lo in range(first, last, size):
        yield slice(lo, min(lo + size, last))
