"""Programs from position lists: CSV files with units, and both files of [KMITL 2005].

The default is the time-optimal program through the same poses: straight from each to the next, and
the orientation by the shortest way. The option `rule` takes the stepping of [KMITL 2005] instead:
unit steps, rotation dropped where there is translation, 1° steps where there is none. `tool` is the
source's offset of the tool's centre, for machines that do not have it in their own file:
coordinates and rotations are those of the tool then. It rests at a pose where the file's column
`dwell` says so, or at all of them by the option of that name. A list in the frame "home" is run
from the home pose, one in "base" from its own first pose, as the source has it. Options and
commands say a pose by three lengths, and three angles after that where it is turned.

The position list and the list of arm lengths of [KMITL 2005] are read independently of what writes
them (planner.export.formats.kmitl): by the keys that the source prints, in any order, with
underscores or blanks before them as its own two writers differ in that.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, pi
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from kinematics.foundation.errors import Fault, FileError, MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.options import check_arguments, option
from kinematics.foundation.units import describe_value, quantity
from kinematics.kinds.tripod import Tripod
from kinematics.machine.pose import IDENTITY, from_numbers, join_pose, make_pose
from planner.program.model import MIN_MOVE, Dwell, Line, Program, Segment, Turn
from planner.program.modifiers import Join, Stop, choose_join
from planner.program.validation import check_positive
from planner.sources.position_list import PositionList, read_csv
from planner.sources.source import Faults, Imported, decode_text

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose

FIRST_NUMBER = 10_001
"""Number of the first point in a list of arm lengths [KMITL 2005]."""
"""Number of the first point of arm lengths."""
LENGTH_TOLERANCE = 1e-9
"""m by which arms may miss their lengths."""
POSE_KEYS = ("cex", "cey", "cez", "rx", "ry", "rz")
"""What makes a pose: the end point, and the angles; the plate's centre and joints follow from
them.
"""
_VALUE = r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:E[+-]?\d{1,2})?)\s*"
_POLAR = re.compile(
    rf"Polar(\d{{1,4}})[\s_]*(ce?[xyz]|r[xyz]|move?\([123]\)[xyz])\s{_VALUE}", re.ASCII
)
_ARM = re.compile(rf"PointL([123])_(\d{{5}}){_VALUE}", re.ASCII)


@check_arguments()
def load_positions(path: str | PathLike[str], **options: Any) -> PositionList:
    """Load poses from a CSV file or a file of the three-armed machine.

    Parameters
    ----------
    path
        Of the file.
    options
        The fields of `Positions`.

    Returns
    -------
    PositionList
        Poses and dwells.

    Raises
    ------
    FileError
        The file has faults; all of them are told.
    """
    return Positions(**options).load(Path(path))[0]


def is_kmitl(text: str) -> bool:
    return text.lstrip().startswith(("Polar", "PointL"))


def read_kmitl(path: Path, text: str, unit: float, machine: str) -> PositionList:
    """Either of the two files; unit: m. Raises FileError with all faults, each with its line."""
    faults = Faults(str(path))
    from kinematics import load_machine

    three = load_machine(machine)
    if not isinstance(three, Tripod):
        raise MotionError(f"machine {machine}: files of three arms need a tripod")
    if text.lstrip().startswith("Polar"):
        return _positions(text, unit, three, faults)
    return _arms(text, unit, three, faults)


def _positions(text: str, unit: float, three: Tripod, faults: Faults) -> PositionList:
    """Positions in the machine's base frame, R = Ry · Rz · Rx; the file counts z from the end
    point's at home (ZOS).
    """
    poses: dict[int, dict[str, float]] = {}
    begins: dict[int, int] = {}
    for number, line in enumerate(text.split("\n"), 1):
        found = _POLAR.fullmatch(line.strip()) if line.strip() else None
        if found is None:
            if line.strip():
                example = '"Polar1_____cex 15.0000"'
                faults.add(
                    f"{describe_value(line)}: not a line of a position list, as {example}", number
                )
            continue
        begins.setdefault(int(found[1]), number)
        pose = poses.setdefault(int(found[1]), {})
        if found[2] in pose:
            faults.add(f"{found[2]} of position {found[1]} appears twice", number)
        pose[found[2]] = float(found[3])
    for n, nth in enumerate(sorted(poses), 1):
        if n != nth:
            faults.add(f"position {n} is missing: {nth} follows {n - 1}", begins[nth])
            break
    for nth, pose in sorted(poses.items()):
        if left := [key for key in POSE_KEYS if key not in pose]:
            faults.add(f"position {nth} has no {', '.join(left)}", begins[nth])
    faults.refuse()
    values = np.array([[pose[key] for key in POSE_KEYS] for _, pose in sorted(poses.items())])
    values = values * ([unit] * 3 + [np.pi / 180] * 3)
    values[:, 2] += three.home.translation[2]
    return PositionList(values, "yzx", "base")


def _arms(text: str, unit: float, three: Tripod, faults: Faults) -> PositionList:
    """Poses of the machine that has these arms: of the point that its own poses are those of."""
    lengths: list[list[float]] = []
    arm = 0
    for number, line in enumerate(text.split("\n"), 1):
        if not line.strip():
            continue
        found = _ARM.fullmatch(line.strip())
        nth = FIRST_NUMBER + len(lengths) - bool(arm)
        if found is None or (int(found[1]), int(found[2])) != (arm + 1, nth):
            faults.add(
                f'{describe_value(line)}: expected "PointL{arm + 1}_{nth}" and a length', number
            )
            break  # what follows has lost count
        if arm == 0:
            lengths.append([])
        lengths[-1].append(float(found[3]) * unit)
        arm = (arm + 1) % 3
    if arm and not faults:
        faults.add(
            f"point {FIRST_NUMBER + len(lengths) - 1} has {arm} lengths of 3: the file ends too early"
        )
    faults.refuse()
    found_poses = three.forward(np.array(lengths))
    for k in np.flatnonzero((found_poses.residual > LENGTH_TOLERANCE) | ~found_poses.certified):
        faults.add(
            f"point {FIRST_NUMBER + k}: {three.name} has no pose connected to home with arms of these lengths"
        )
    faults.refuse()
    angles = np.zeros((len(lengths), 3))  # the plate keeps its orientation
    return PositionList(np.column_stack([found_poses.pose.translation, angles]), "yzx", "base")


UNITS = ("m", "m", "m", "rad", "rad", "rad")


def read_six(text: str, what: str = "origin") -> list[float]:
    """x, y, z (m), θx, θy, θz (rad, 0 where they are left out).

    Raises MotionError for anything else.
    """
    parts = text.split(",")
    if len(parts) not in (3, 6):
        raise MotionError(
            f'{what} "{text[:80]}": {len(parts)} entries; write x, y, z with units as "0 mm, 0 mm, 25 mm", and '
            "θx, θy, θz after them where it is turned"
        )
    return [quantity(part, unit) for part, unit in zip(parts, UNITS, strict=False)] + [0.0] * (
        6 - len(parts)
    )


def read_frame(text: str) -> "Pose":
    """The frame moved by x, y, z, then turned by θx, θy, θz about its moving axes in turn, Rx · Ry
    · Rz.
    """
    values = read_six(text)
    return make_pose(values[:3], values[3:])


ANGLE_STEP = pi / 180
"""rad of a step where only angles change [KMITL 2005]."""
MAX_STEPS = 100_000
"""Steps of a program."""
STEP_ROUNDING = 1e-9
"""Share of a step by which a way may be longer than a whole number of them."""


def join_poses(
    listed: PositionList, start: "Pose", join: Join, speed: float | None = None
) -> tuple[tuple[Segment, ...], list[str]]:
    """From a start straight to each pose, turning the shortest way; and what to know of it.

    It rests where only angles change.
    """
    segments: list[Segment] = []
    still, far = 0, 0
    place, turned = start.translation, start.rotation
    for nth, (pose, rotation) in enumerate(zip(listed.poses, listed.rotations, strict=True)):
        moves = float(np.linalg.norm(pose[:3] - place)) > MIN_MOVE
        turns = float((turned.inv() * rotation).magnitude()) > MIN_MOVE
        if moves:
            segments.append(Line(pose[:3], rotation if turns else None, speed, join))
        elif turns:
            segments.append(Turn(rotation, Stop()))
        rest = float(listed.rests[nth])
        if rest > 0:
            segments = _add_rest(segments, rest)
        still += nth > 0 and not moves and not turns and rest == 0
        far += nth > 0 and float(abs(pose[3:] - listed.poses[nth - 1, 3:]).max()) > pi
        place, turned = pose[:3], rotation
    told = [f"skipped {count_noun(still, 'pose')} equal to the pose before"] if still else []
    if far:
        some = f"{count_noun(far, 'pose')} with an angle more than half a turn from the pose before"
        told.append(f"{some}: the tool rotates the shorter way")
    return tuple(segments), told


def _add_rest(segments: list[Segment], seconds: float) -> list[Segment]:
    """With a rest at the end, at which the last motion stops."""
    if segments and not isinstance(segments[-1], Dwell):
        segments = [*segments[:-1], replace(segments[-1], join=Stop())]
    return [*segments, Dwell(seconds)]


def step_through(
    listed: PositionList, start: "Pose", unit: float, speed: float | None = None
) -> tuple[tuple[Segment, ...], list[str]]:
    """As [KMITL 2005] steps: between two poses in equal steps of a unit (m) of the coordinate that
    changes most.

    Where there is any translation, the rotation is dropped: the tool keeps the angles that it has.
    Where there is none, the three angles go in equal steps, 1° of the one that changes most, from
    those that the tool has; so a step turns by R = Ry · Rz · Rx of its angles, if the list's order
    is that. It rests after each step.

    Differences to the source: where no whole number of steps leads to a pose a shorter one ends
    there (the source goes on from the listed pose all the same, as it begins every move at the
    listed one, which no machine can jump to); the largest change is one of magnitudes (the source
    takes that of x with its sign, so that moves along −x run astray).
    """
    steps, told = step_poses(listed, unit)
    segments = list(join_poses(steps.part(1, 1), start, Stop(), speed)[0])
    moves = np.any(np.diff(steps.poses[:, :3], axis=0) != 0, axis=1)
    for pose, rotation, moved, rest in zip(
        steps.poses[1:], steps.rotations[1:], moves, steps.rests[1:], strict=True
    ):
        segments.append(Line(pose[:3], None, speed, Stop()) if moved else Turn(rotation, Stop()))
        segments += [Dwell(float(rest))] if rest > 0 else []
    return tuple(segments), told


def step_poses(listed: PositionList, unit: float) -> tuple[PositionList, list[str]]:
    """The poses that `step_through` goes through one after another, the first one of the list among
    them; what to know.
    """
    if not (np.isfinite(unit) and unit > 0):
        raise MotionError(f"unit length {unit} m must be positive and finite")
    count = sum(
        _count_steps(b[:3] - a[:3], unit) or _count_steps(b[3:] - a[3:], ANGLE_STEP)
        for a, b in pairwise(listed.poses)
    )
    if count > MAX_STEPS:
        raise MotionError(
            f"{count} steps of {unit * 1e3:g} mm, more than {MAX_STEPS}: use a longer unit, or fewer poses"
        )
    angles, dropped = listed.poses[0, 3:], 0
    steps, rests = [listed.poses[0]], [float(listed.rests[0])]
    for (before, after), rest in zip(
        pairwise(listed.poses), listed.rests[1:].tolist(), strict=True
    ):
        way = after[:3] - before[:3]
        if abs(way).max() > MIN_MOVE:
            dropped += float(abs(after[3:] - angles).max()) > MIN_MOVE
            some = [
                np.concatenate((before[:3] + share * way, angles))
                for share in _step_shares(way, unit)
            ]
        else:
            turn = after[3:] - angles
            some = [
                np.concatenate((after[:3], angles + share * turn))
                for share in _step_shares(turn, ANGLE_STEP)
            ]
            angles = after[3:] if some else angles
        steps += some
        rests += [0.0] * len(some)
        rests[-1] += rest
    told = (
        [
            f"{dropped} rotations combined with a translation were dropped, as the stepping rule requires"
        ]
        if dropped
        else []
    )
    return replace(listed, poses=np.array(steps), dwells=np.array(rests)), told


def _count_steps(way: np.ndarray, step: float) -> int:
    largest = float(abs(way).max())
    return ceil(largest / step - STEP_ROUNDING) if largest > MIN_MOVE else 0


def _step_shares(way: np.ndarray, step: float) -> Iterator[float]:
    """Shares of a way at which its steps end, the last of them 1."""
    for nth in range(1, _count_steps(way, step)):
        yield nth * step / float(abs(way).max())
    if abs(way).max() > MIN_MOVE:
        yield 1.0


SOURCE_UNIT = 1e-3
"""m. ASSUMPTION: [KMITL 2005] does not say what its unit is (planner.export.formats.kmitl)."""


@dataclass(frozen=True, slots=True)
class Positions:
    """Position lists: CSV with units, and the position and arm-length files of the three-armed
    machine.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".csv", ".txt")
    length: str | None = option(None, 'unit of columns x, y, z without a unit, as "mm"')
    angle: str | None = option(None, 'unit of angle columns without a unit, as "deg"')
    rotation: Literal["xyz", "yzx"] | None = option(
        None, "rotation order: xyz is Rx·Ry·Rz, yzx Ry·Rz·Rx. Default: as the file states, else xyz"
    )
    frame: Literal["home", "base"] | None = option(
        None, "frame of the coordinates. Default: as the file states, else home"
    )
    first: int | None = option(None, "number of the first pose to run. Default 1")
    last: int | None = option(None, "number of the last pose to run. Default: the last in the list")
    rule: Literal["optimal", "kmitl"] = option(
        "optimal",
        "optimal: straight lines between poses; kmitl: unit steps with a rest after each. Default optimal",
    )
    unit_length: float = option(
        SOURCE_UNIT, "length of one unit of the three-armed machine. Default 1 mm", "m", like="1 mm"
    )
    join: Literal["through", "stop"] = option(
        "through", "joins of rule optimal: through passes smooth joins, stop rests. Default through"
    )
    blend: float | None = option(
        None, 'round joins within this tolerance instead, as "0.05 mm"', "m", like="0.05 mm"
    )
    fit: float | None = option(
        None, 'fit smooth curves within this tolerance instead, as "0.02 mm"', "m", like="0.02 mm"
    )
    speed: float | None = option(None, "cap of the tool's speed. Default: none", "m/s")
    dwell: float | None = option(
        None,
        'dwell at every pose, as "0.2 s". Default: the file\'s column dwell',
        "s",
        like="0.2 s",
    )
    tool: str | None = option(
        None, "the tool's frame in the platform's, as \"0 mm, 0 mm, -50 mm\". Default: none"
    )
    arms: str = option("tripod", "machine of a file of the three-armed machine. Default tripod")

    def __post_init__(self) -> None:
        for name, unit in (
            ("blend", "m"),
            ("fit", "m"),
            ("speed", "m/s"),
            ("unit_length", "m"),
            ("dwell", "s"),
        ):
            check_positive("positions", name, getattr(self, name), unit)

    def load(self, path: Path) -> tuple[PositionList, list[str]]:
        """The list in a file, all of it, and what to know of it.

        Raises FileError with the faults of the file.
        """
        text = decode_text(path)
        if is_kmitl(text):
            return self._apply_options(read_kmitl(path, text, self.unit_length, self.arms)), []
        listed, told = read_csv(path, text, self.length, self.angle)
        return self._apply_options(listed), told

    def _apply_options(self, listed: PositionList) -> PositionList:
        rests = listed.rests if self.dwell is None else np.full(len(listed), self.dwell)
        return replace(
            listed,
            order=self.rotation or listed.order,
            frame=self.frame or listed.frame,
            dwells=rests,
        )

    def read(self, path: Path) -> Imported:
        """The program through the poses of a list. Raises FileError with the faults of the file."""
        listed, told = self.load(path)
        run = listed.part(self.first, self.last)
        tool = None if self.tool is None else read_frame(self.tool)
        first = None
        if run.frame == "base":
            first = join_pose(run.poses[0, :3], run.rotations[0])
        start = next((pose for pose in (first, tool) if pose is not None), from_numbers(IDENTITY))
        if self.rule == "kmitl":
            segments, more = step_through(run, start, self.unit_length, self.speed)
        else:
            join = choose_join(self.join, self.blend, self.fit)
            segments, more = join_poses(run, start, join, self.speed)
        if not segments:
            raise FileError(
                str(path), [Fault("", "nothing moves: all its poses equal the start", 1)]
            )
        program = Program(segments, run.frame, first, name=path.stem, tool=tool)
        return Imported(program, {"poses": len(run)}, (*told, *more))
