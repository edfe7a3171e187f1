"""The animation of a plan as a file: one HTML document that holds all it shows."""

from pathlib import Path

from benchmarks.animation.frames import Animated, even, frames_of
from kinematics.destination import Destination
from kinematics.errors import MotionError

FRAMES, MOST = 240, 5000
"""Frames by default, and so many at most: more would make pages that no one can open."""


def animate(
    plan: Animated, path: str | Path, *, frames: int = FRAMES, magnify: float | None = None, force: bool = False
) -> Path:
    """Write the machine moving along a plan as a page for a browser, in 3-D, at real time.

    frames   how many, evenly from start to end; magnify: how many times the error of the pulses' path is drawn; 1 is
             true scale, None as large as can be seen. Raises MotionError for a file that exists, unless `force`.
    """
    target = Destination(Path(path), force=force, remedy="give force=True to replace it")
    target.write(document(plan, frames, magnify))
    return target.path


def document(plan: Animated, frames: int = FRAMES, magnify: float | None = None) -> str:
    """The page as text."""
    from benchmarks.animation.page import page

    if not 2 <= frames <= MOST:
        raise MotionError(f"frames {frames}: an animation has from 2 to {MOST}")
    if magnify is not None and not magnify > 0:
        raise MotionError(f"magnify {magnify}: how many times an error is drawn must be above 0; 1 is true scale")
    return page(frames_of(plan, even(plan.trajectory, frames), magnify))
