"""A serial arm's joints, read from a URDF by pinocchio."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kinematics.arm import Joints
from kinematics.array import frozen
from kinematics.document import MAX_BYTES
from kinematics.errors import Fault, FileError
from kinematics.pinocchio_adapter import pinocchio
from kinematics.registry import closest, nearest
from kinematics.text_file import bytes_of
from kinematics.units import shown

# m within which every joint and the tool must lie: what is further is a slip of units, and overflows.
FAR = 1e6


def read_urdf(path: Path, joints: Sequence[str], tool: str) -> Joints:
    """The three named joints and the tool frame at q = 0, in the base frame.

    The joints must turn, follow each other in this order from the base, and the last must carry the tool. Raises
    FileError for what the file does not hold, MotionError where pinocchio is not installed.
    """
    pin = pinocchio("an arm's URDF")
    _refuse_other(path)
    try:
        model = pin.buildModelFromUrdf(str(path))
    except (ValueError, RuntimeError) as failure:
        raise FileError(str(path), [Fault("", f"{failure} (the parser says why on stderr)")]) from failure
    faults = list(_faults(model, list(joints), tool))
    if faults:
        raise FileError(str(path), faults)
    numbers = [model.getJointId(name) for name in joints]
    data = model.createData()
    # at q = 0, and with unit speed of one joint after the other: its axis in the base frame
    directions = []
    for name, joint in zip(joints, numbers, strict=True):
        speeds = np.zeros(3)
        speeds[model.joints[joint].idx_v] = 1.0
        pin.forwardKinematics(model, data, pin.neutral(model), speeds)
        spin = pin.getVelocity(model, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED).angular.copy()
        if not abs(np.linalg.norm(spin) - 1) < 1e-9:
            raise FileError(str(path), [Fault("joints", f'{name!r} has no axis: write e.g. <axis xyz="0 0 1"/>')])
        directions.append(spin)
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    frame = data.oMf[model.getFrameId(tool)]
    points = [data.oMi[joint].translation.copy() for joint in numbers]
    if not np.abs([*points, frame.translation]).max() < FAR:
        raise FileError(str(path), [Fault("joints", f"they do not all lie within {FAR:g} m of the base")])
    moved = [data.oMi[joint].act(model.inertias[joint]) for joint in numbers]
    return Joints(
        frozen(points),
        frozen(directions),
        frozen(frame.translation),
        frozen(frame.rotation),
        tuple((float(link.mass), frozen(link.lever), frozen(link.inertia)) for link in moved),
    )


def _refuse_other(path: Path) -> None:
    """Raise FileError, with the line, for what is no XML, and for XML that describes no robot."""
    from xml.etree import ElementTree

    raw = bytes_of(path, MAX_BYTES)
    try:
        root = ElementTree.fromstring(raw)
    except ElementTree.ParseError as error:
        line, column = error.position
        told = f"not XML at column {column + 1}: {error.msg.partition(':')[0]}; what follows is not looked at"
        raise FileError(str(path), [Fault("", told, line)]) from None
    if root.tag != "robot":
        raise FileError(str(path), [Fault("", f"not a URDF: it begins with <{root.tag}> instead of <robot>", 1)])


def _faults(model: Any, joints: list[str], tool: str) -> list[Fault]:
    """What keeps a model from being three joints that turn, one after the other, the last with the tool."""
    names = list(model.names)[1:]
    there = f"there are {', '.join(names)}"
    faults = [
        Fault("joints", f"there is no joint {shown(name)}{nearest(name, names)}; {there}", nearest=closest(name, names))
        for name in joints
        if not model.existJointName(name)
    ]
    if not faults and (len(joints) != 3 or len(set(joints)) < 3 or model.njoints != 4):
        faults = [Fault("joints", f"wanted are three joints that turn, {shown(joints)}; {there}")]
    if not isinstance(tool, str) or not model.existFrame(tool):
        known = [frame.name for frame in model.frames]
        told = f"there is no frame {shown(tool)}{nearest(str(tool), known)}; there are {', '.join(known)}"
        faults.append(Fault("tool", told, nearest=closest(str(tool), known)))
    if faults:
        return faults
    numbers = [model.getJointId(name) for name in joints]
    for name, joint, before in zip(joints, numbers, [0, *numbers], strict=False):
        if not model.joints[joint].shortname().startswith("JointModelR"):  # R…, Revolute…: pinocchio's that turn
            faults.append(Fault("joints", f"{name!r} does not turn; an arm's joints are revolute or continuous"))
        elif model.parents[joint] != before:
            faults.append(Fault("joints", f"{joints} do not follow each other; the order from the base is {names}"))
    carrier = model.frames[model.getFrameId(tool)].parentJoint
    if carrier != numbers[-1]:
        carried = repr(model.names[carrier]) if carrier else "nothing that moves"
        faults.append(Fault("tool", f"frame {tool!r} is carried by {carried}, not by the last joint {joints[-1]!r}"))
    return faults
