"""Position lists, from CSV files with units and from both files of [KMITL 2005].

The default is the time-optimal program through the same poses: straight from each to the next, and the orientation by
the shortest way. The option `rule` takes the stepping of [KMITL 2005] instead (planner.sources.position_ways): unit
steps, rotation dropped where there is translation, 1° steps where there is none. `tool` is the source's offset of the
tool's centre, for machines that do not have it in their own file: coordinates and rotations are those of the tool then.
It rests at a pose where the file's column `dwell` says so, or at all of them by the option of that name. A list in the
frame "home" is run from the home pose, one in "base" from its own first pose, as the source has it.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from kinematics.errors import Fault, FileError
from planner.program import Blend, Program, Stop, Through
from planner.sources.kmitl import is_kmitl, read_kmitl
from planner.sources.placed import placed
from planner.sources.position_list import PositionList
from planner.sources.position_ways import stepped, through
from planner.sources.positions_csv import read_csv
from planner.sources.source import Imported, option
from planner.sources.texts import text_of
from planner.wanted import positive

UNIT = 1e-3
"""m. ASSUMPTION: [KMITL 2005] does not say what its unit is (planner.export.kmitl)."""


@dataclass(frozen=True, slots=True)
class Positions:
    """Position lists: CSV with units, and the position and arm-length files of the three-armed machine."""

    suffixes: ClassVar[tuple[str, ...]] = (".csv", ".txt")
    length: str | None = option(None, 'unit of columns x, y, z that state none, as "mm"')
    angle: str | None = option(None, 'unit of columns of angles that state none, as "deg"')
    rotation: Literal["xyz", "yzx"] | None = option(
        None, "what angles mean: xyz is Rx·Ry·Rz, yzx Ry·Rz·Rx. Default: what the file says, else xyz"
    )
    frame: Literal["home", "base"] | None = option(
        None, "what coordinates are relative to. Default: what the file says, else home"
    )
    first: int | None = option(None, "number of the first pose to run. Default 1")
    last: int | None = option(None, "number of the last pose to run. Default: the last there is")
    rule: Literal["optimal", "kmitl"] = option(
        "optimal", "optimal: straight through the poses; kmitl: in unit steps, resting after each. Default optimal"
    )
    unit_length: float = option(UNIT, "the length of one unit of the three-armed machine. Default 1 mm", "m")
    join: Literal["through", "stop"] = option(
        "through", "of rule optimal: through passes where smooth, stop rests. Default through"
    )
    blend: float | None = option(None, 'instead: round joins within so much, as "0.05 mm"', "m")
    speed: float | None = option(None, "cap of the tool's speed. Default: none", "m/s")
    dwell: float | None = option(
        None, 'rest at every pose, as "0.2 s". Default: what the file\'s column dwell says', "s"
    )
    tool: str | None = option(None, "the tool's frame in the platform's, as \"0 mm, 0 mm, -50 mm\". Default: none")
    arms: str = option("tripod", "machine that a file of the three-armed machine is of. Default tripod")

    def __post_init__(self) -> None:
        for name, unit in (("blend", "m"), ("speed", "m/s"), ("unit_length", "m"), ("dwell", "s")):
            positive("positions", name, getattr(self, name), unit)

    def load(self, path: Path) -> tuple[PositionList, list[str]]:
        """The list in a file, all of it, and what to know of it. Raises FileError with the faults of the file."""
        text = text_of(path)
        if is_kmitl(text):
            return self._meant(read_kmitl(path, text, self.unit_length, self.arms)), []
        listed, told = read_csv(path, text, self.length, self.angle)
        return self._meant(listed), told

    def _meant(self, listed: PositionList) -> PositionList:
        rests = listed.rests if self.dwell is None else np.full(len(listed), self.dwell)
        return replace(listed, order=self.rotation or listed.order, frame=self.frame or listed.frame, dwells=rests)

    def read(self, path: Path) -> Imported:
        """The program through the poses of a list. Raises FileError with the faults of the file."""
        listed, told = self.load(path)
        run = listed.part(self.first, self.last)
        tool = None if self.tool is None else placed(self.tool)
        first = None
        if run.frame == "base":
            first = RigidTransform.from_components(run.poses[0, :3], run.rotations[0])
        start = next((pose for pose in (first, tool) if pose is not None), RigidTransform.identity())
        if self.rule == "kmitl":
            segments, more = stepped(run, start, self.unit_length, self.speed)
        else:
            join = Blend(self.blend) if self.blend is not None else Stop() if self.join == "stop" else Through()
            segments, more = through(run, start, join, self.speed)
        if not segments:
            raise FileError(str(path), [Fault("", "nothing moves: its poses are all where the motion begins", 1)])
        program = Program(segments, run.frame, first, name=path.stem, tool=tool)
        return Imported(program, {"poses": len(run)}, (*told, *more))
