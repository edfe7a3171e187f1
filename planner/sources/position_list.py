"""Position lists: the poses that an operator records one by one, to be run all, or from one to another."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from kinematics.array import Array, finite, frozen
from kinematics.errors import MotionError
from kinematics.result import Result
from kinematics.table import Column, Table
from planner.program import Frame

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Order = Literal["xyz", "yzx"]
"""How three angles combine: Rx · Ry · Rz, or Ry · Rz · Rx as [KMITL 2005] has it."""
FARTHEST = 1e5
"""m and rad; nothing that means something is listed beyond."""
LONGEST = 1e5
"""s of a rest, likewise."""


@dataclass(frozen=True, slots=True, eq=False)
class PositionList(Result):
    """Poses, numbered from 1. Every method returns a new list.

    poses  (N, 6) x, y, z in m, θx, θy, θz in rad
    order   how the angles combine;  frame  "home": coordinates are relative to the machine's home pose, or "base"
    dwells  (N,) s of rest at each pose; None: none
    Raises MotionError for what is no pose, and for a number that the list does not have.
    """

    poses: Array
    order: Order = "xyz"
    frame: Frame = "home"
    dwells: Array | None = None

    def __post_init__(self) -> None:
        if self.order not in ("xyz", "yzx") or self.frame not in ("home", "base"):
            raise MotionError(
                f'position list: order "{self.order}" is neither "xyz" nor "yzx", or frame "{self.frame}" neither '
                '"home" nor "base"'
            )
        poses = finite(self.poses, "position list: poses", (None, 6), least=-FARTHEST, most=FARTHEST)
        object.__setattr__(self, "poses", frozen(poses))
        given = np.zeros(len(poses)) if self.dwells is None else self.dwells
        dwells = finite(given, "position list: dwells", (len(poses),), least=0.0, most=LONGEST, unit="s")
        object.__setattr__(self, "dwells", frozen(dwells))

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def rotations(self) -> Rotation:
        """The N orientations."""
        axes = ["XYZ".index(letter) for letter in self.order.upper()]
        return Rotation.from_euler(self.order.upper(), self.poses[:, 3:][:, axes])

    @property
    def rests(self) -> Array:
        """(N,) s of rest at each pose."""
        assert self.dwells is not None  # filled in when it was made
        return self.dwells

    def tables(self) -> tuple[Table, ...]:
        """Each pose by its number; how long it rests there, if it does anywhere."""
        meaning = "·".join(f"R{axis}" for axis in self.order)
        columns = (
            Column("pose", range(1, len(self) + 1)),
            *(Column(name, self.poses[:, k], "m", "human") for k, name in enumerate("xyz")),
            *(Column(f"θ{name}", self.poses[:, 3 + k], "rad", "human") for k, name in enumerate("xyz")),
            *([Column("dwell", self.rests, "s", form="g")] if self.rests.any() else []),
        )
        return (Table(f"{len(self)} poses from {self.frame}, {meaning}", columns),)

    def files(self) -> Mapping[str, Callable[[Path], None]]:
        """.csv: a list that `load_positions` reads, in mm and degrees; .json: the table."""
        from planner.sources.positions_csv import positions_csv

        return {".csv": lambda path: path.write_bytes(positions_csv(self).encode()), ".json": self._json}

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """The positions in their order, joined by straight lines."""
        from planner.sources.plots import positions

        return positions(self.poses[:, :3], ax, f"{len(self)} poses from {self.frame}")

    def record(self, pose: ArrayLike, dwell: float = 0.0) -> "PositionList":
        """With one more pose at the end, and s of rest there."""
        return self._with(len(self), pose, dwell)

    def insert(self, number: int, pose: ArrayLike, dwell: float = 0.0) -> "PositionList":
        """With a pose that gets a number, and s of rest there; what had it, and all after that, move up by one."""
        if number != len(self) + 1:
            self._known(number)
        return self._with(number - 1, pose, dwell)

    def remove(self, first: int, last: int | None = None) -> "PositionList":
        """Without one pose, or those from one to another; what comes after moves down."""
        self._between(first, first if last is None else last)
        gone = slice(first - 1, last or first)
        return replace(self, poses=np.delete(self.poses, gone, axis=0), dwells=np.delete(self.rests, gone))

    def part(self, first: int | None = None, last: int | None = None) -> "PositionList":
        """Those from one number to another, both included; None: from the first, to the last."""
        first, last = 1 if first is None else first, len(self) if last is None else last
        self._between(first, last)
        return replace(self, poses=self.poses[first - 1 : last], dwells=self.rests[first - 1 : last])

    def _with(self, place: int, pose: ArrayLike, dwell: float) -> "PositionList":
        one = finite(pose, "position list: a pose (x, y, z, θx, θy, θz)", (6,), least=-FARTHEST, most=FARTHEST)
        return replace(
            self, poses=np.insert(self.poses, place, one, axis=0), dwells=np.insert(self.rests, place, dwell)
        )

    def _known(self, number: int) -> None:
        if not 1 <= number <= len(self):
            held = f"poses 1 to {len(self)}" if len(self) else "no pose yet"
            raise MotionError(f"position list: no pose {number}; it has {held}")

    def _between(self, first: int, last: int) -> None:
        self._known(first)
        self._known(last)
        if first > last:
            raise MotionError(f"position list: from {first} to {last} is no part of it; give the lower number first")
