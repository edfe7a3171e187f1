"""Orientations that the letters A, B and C lead to: Rx(A) · Ry(B) · Rz(C)."""

from collections.abc import Sequence
from math import degrees, pi

from scipy.spatial.transform import Rotation

from planner.program.model import Turn
from planner.program.modifiers import Join
from planner.sources.rs274.words import WordFault

LETTERS = "ABC"
HALF_TURN = pi * (1 - 1e-12)


def turn_along(begin: Sequence[float], end: Sequence[float]) -> Rotation:
    """The orientation at the end (3,) rad of a path.

    Raises WordFault for half a turn or more, whose way is open.
    """
    for k in range(3):
        if abs(end[k] - begin[k]) >= HALF_TURN:
            turned = degrees(abs(end[k] - begin[k]))
            raise WordFault(
                LETTERS[k], f"{LETTERS[k]} turns by {turned:.6g}° along a path; part it"
            )
    return Rotation.from_euler("XYZ", end)


def turn_on_spot(
    begin: Sequence[float], end: Sequence[float], join: Join, number: int
) -> tuple[Turn, float]:
    """Of one letter by any angle about the axis that it stands for, of several the shortest way;
    and its angle, rad.
    """
    changed = [k for k in range(3) if begin[k] != end[k]]
    if len(changed) == 1:
        k = changed[0]
        ahead = Rotation.from_euler("XYZ", [*begin[:k], *[0.0] * (3 - k)])
        angle = end[k] - begin[k]
        return Turn(
            None, join, about=ahead.as_matrix()[:, k], angle=angle, line_number=number
        ), angle
    before, after = (Rotation.from_euler("XYZ", angles) for angles in (begin, end))
    return Turn(after, join, line_number=number), float((before.inv() * after).magnitude())
