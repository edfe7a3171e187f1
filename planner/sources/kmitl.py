"""The files of [KMITL 2005], read: its position list, and its list of arm lengths.

Independent of what writes them (planner.export.kmitl_positions, kmitl_arms): by the keys that the source prints, in any
order, with underscores or blanks before them as its own two writers differ in that.
"""

import re
from pathlib import Path

import numpy as np

from kinematics.errors import MotionError
from kinematics.tripod import Tripod
from kinematics.units import shown
from planner.sources.faults import Faults
from planner.sources.position_list import PositionList

FIRST = 10_001
"""Number of the first point of arm lengths."""
MET = 1e-9
"""m by which arms may miss their lengths."""
ASKED = ("cex", "cey", "cez", "rx", "ry", "rz")
"""What makes a pose: the end point, and the angles; the plate's centre and joints follow from them."""
_VALUE = r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:E[+-]?\d{1,2})?)\s*"
_POLAR = re.compile(rf"Polar(\d{{1,4}})[\s_]*(ce?[xyz]|r[xyz]|move?\([123]\)[xyz])\s{_VALUE}", re.ASCII)
_ARM = re.compile(rf"PointL([123])_(\d{{5}}){_VALUE}", re.ASCII)


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
    """Positions in the machine's base frame, R = Ry · Rz · Rx; the file counts z from the end point's at home (ZOS)."""
    poses: dict[int, dict[str, float]] = {}
    begins: dict[int, int] = {}
    for number, line in enumerate(text.split("\n"), 1):
        found = _POLAR.fullmatch(line.strip()) if line.strip() else None
        if found is None:
            if line.strip():
                faults.add(f'{shown(line)}: not a line of a position list, as "Polar1____cex 15.0000"', number)
            continue
        begins.setdefault(int(found[1]), number)
        pose = poses.setdefault(int(found[1]), {})
        if found[2] in pose:
            faults.add(f"{found[2]} of position {found[1]} stands twice", number)
        pose[found[2]] = float(found[3])
    for n, nth in enumerate(sorted(poses), 1):
        if n != nth:
            faults.add(f"position {n} is missing: {nth} follows {n - 1}", begins[nth])
            break
    for nth, pose in sorted(poses.items()):
        if left := [key for key in ASKED if key not in pose]:
            faults.add(f"position {nth} has no {', '.join(left)}", begins[nth])
    faults.refuse()
    values = np.array([[pose[key] for key in ASKED] for _, pose in sorted(poses.items())])
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
        nth = FIRST + len(lengths) - bool(arm)
        if found is None or (int(found[1]), int(found[2])) != (arm + 1, nth):
            faults.add(f'{shown(line)}: what should stand here is "PointL{arm + 1}_{nth}" and a length', number)
            break  # what follows has lost count
        if arm == 0:
            lengths.append([])
        lengths[-1].append(float(found[3]) * unit)
        arm = (arm + 1) % 3
    if arm and not faults:
        faults.add(f"point {FIRST + len(lengths) - 1} has {arm} lengths of 3: the file ends too early")
    faults.refuse()
    found_poses = three.forward(np.array(lengths))
    for k in np.flatnonzero((found_poses.residual > MET) | ~found_poses.certified):
        faults.add(
            f"point {FIRST + k}: {three.name} has no pose, that it can come to from home, with arms of these lengths"
        )
    faults.refuse()
    angles = np.zeros((len(lengths), 3))  # the plate keeps its orientation
    return PositionList(np.column_stack([found_poses.pose.translation, angles]), "yzx", "base")
