"""Programs from position lists: through the poses as fast as it goes, or by the steps of [KMITL 2005]."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from math import ceil, pi

import numpy as np

from kinematics.errors import MotionError
from kinematics.pose import Pose
from planner.program import SAME, Dwell, Join, Line, Segment, Stop, Turn
from planner.sources.position_list import PositionList

STEP = pi / 180
"""rad of a step where only angles change [KMITL 2005]."""
MOST = 100_000
"""Steps of a program."""
HAIR = 1e-9
"""Share of a step by which a way may be longer than a whole number of them."""


def through(
    listed: PositionList, start: Pose, join: Join, speed: float | None = None
) -> tuple[tuple[Segment, ...], list[str]]:
    """From a start straight to each pose, turning the shortest way; and what to know of it.

    It rests where only angles change.
    """
    segments: list[Segment] = []
    still, far = 0, 0
    place, turned = start.translation, start.rotation
    for nth, (pose, rotation) in enumerate(zip(listed.poses, listed.rotations, strict=True)):
        moves = float(np.linalg.norm(pose[:3] - place)) > SAME
        turns = float((turned.inv() * rotation).magnitude()) > SAME
        if moves:
            segments.append(Line(pose[:3], rotation if turns else None, speed, join))
        elif turns:
            segments.append(Turn(rotation))
        rest = float(listed.rests[nth])
        if rest > 0:
            segments = _resting(segments, rest)
        still += nth > 0 and not moves and not turns and rest == 0
        far += nth > 0 and float(abs(pose[3:] - listed.poses[nth - 1, 3:]).max()) > pi
        place, turned = pose[:3], rotation
    told = [f"{still} poses are those before them, and were left out"] if still else []
    if far:
        told.append(f"{far} poses change an angle by more than half a turn: the tool turns the shorter way")
    return tuple(segments), told


def _resting(segments: list[Segment], seconds: float) -> list[Segment]:
    """With a rest at the end, at which the last motion stops."""
    if segments and not isinstance(segments[-1], Dwell):
        segments = [*segments[:-1], replace(segments[-1], join=Stop())]
    return [*segments, Dwell(seconds)]


def stepped(
    listed: PositionList, start: Pose, unit: float, speed: float | None = None
) -> tuple[tuple[Segment, ...], list[str]]:
    """As [KMITL 2005] steps: between two poses in equal steps of a unit (m) of the coordinate that changes most.

    Where there is any translation, the rotation is dropped: the tool keeps the angles that it has. Where there is none,
    the three angles go in equal steps, 1° of the one that changes most, from those that the tool has; so a step turns
    by R = Ry · Rz · Rx of its angles, if the list's order is that. It rests after each step.

    Differences to the source: where no whole number of steps leads to a pose a shorter one ends there (the source goes
    on from the listed pose all the same, as it begins every move at the listed one, which no machine can jump to); the
    largest change is one of magnitudes (the source takes that of x with its sign, so that moves along −x run astray).
    """
    steps, told = step_poses(listed, unit)
    segments = list(through(steps.part(1, 1), start, Stop(), speed)[0])
    moves = np.any(np.diff(steps.poses[:, :3], axis=0) != 0, axis=1)
    for pose, rotation, moved, rest in zip(steps.poses[1:], steps.rotations[1:], moves, steps.rests[1:], strict=True):
        segments.append(Line(pose[:3], None, speed) if moved else Turn(rotation, Stop()))
        segments += [Dwell(float(rest))] if rest > 0 else []
    return tuple(segments), told


def step_poses(listed: PositionList, unit: float) -> tuple[PositionList, list[str]]:
    """The poses that `stepped` goes through one after another, the first one of the list among them; what to know."""
    if not (np.isfinite(unit) and unit > 0):
        raise MotionError(f"unit length {unit} m must be positive and finite")
    count = sum(_steps(b[:3] - a[:3], unit) or _steps(b[3:] - a[3:], STEP) for a, b in pairwise(listed.poses))
    if count > MOST:
        raise MotionError(f"{count} steps of {unit * 1e3:g} mm, more than {MOST}: take a longer unit, or fewer poses")
    angles, dropped = listed.poses[0, 3:], 0
    steps, rests = [listed.poses[0]], [float(listed.rests[0])]
    for (before, after), rest in zip(pairwise(listed.poses), listed.rests[1:].tolist(), strict=True):
        way = after[:3] - before[:3]
        if abs(way).max() > SAME:
            dropped += float(abs(after[3:] - angles).max()) > SAME
            some = [np.concatenate((before[:3] + share * way, angles)) for share in _shares(way, unit)]
        else:
            turn = after[3:] - angles
            some = [np.concatenate((after[:3], angles + share * turn)) for share in _shares(turn, STEP)]
            angles = after[3:] if some else angles
        steps += some
        rests += [0.0] * len(some)
        rests[-1] += rest
    told = [f"{dropped} rotations beside a translation were dropped, as the stepping rule has it"] if dropped else []
    return replace(listed, poses=np.array(steps), dwells=np.array(rests)), told


def _steps(way: np.ndarray, step: float) -> int:
    largest = float(abs(way).max())
    return ceil(largest / step - HAIR) if largest > SAME else 0


def _shares(way: np.ndarray, step: float) -> Iterator[float]:
    """Shares of a way at which its steps end, the last of them 1."""
    for nth in range(1, _steps(way, step)):
        yield nth * step / float(abs(way).max())
    if abs(way).max() > SAME:
        yield 1.0
