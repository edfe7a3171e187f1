"""Machine files: the schema of each kind's TOML, and the machine that one describes."""

from collections.abc import Callable
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from kinematics.document import read
from kinematics.errors import FileError, MotionError
from kinematics.kinds.arm import ArmFile, arm, of_a_joint
from kinematics.kinds.axes import named_once, one_pulse
from kinematics.kinds.hexapod import HexapodFile, hexapod
from kinematics.kinds.linkage import LinkageFile, linkage
from kinematics.kinds.traverser import TraverserFile, traverser
from kinematics.kinds.tripod import TripodFile, tripod
from kinematics.machine import Machine
from kinematics.registry import beside, nearest
from kinematics.schema import File, build
from kinematics.units import shown


def read_machine(source: Path | Traversable) -> Machine:
    """The machine that a file describes, named after the file. Raises FileError with every fault of the file."""
    document = read(source)
    kind = document.data.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        told = "missing" if kind is None else f"{shown(kind)} is no kind of machine{nearest(str(kind), KINDS)}"
        known = ", ".join(map(shown, KINDS))
        raise FileError(document.file, [document.fault(("kind",), f"{told}; kinds: {known}")])
    schema, construct = KINDS[kind]
    model = build(document, schema, named_once, one_pulse, of_a_joint)
    try:
        return construct(model, Path(source.name).stem, beside("kinematics", source))
    except MotionError as error:  # what only the whole machine shows, such as a home pose out of reach
        raise FileError(document.file, [document.fault(("geometry",), str(error))]) from error


KINDS: dict[str, tuple[type[File], Callable[[Any, str, Path | Traversable], Machine]]] = {
    "hexapod": (HexapodFile, hexapod),
    "tripod": (TripodFile, tripod),
    "linkage": (LinkageFile, linkage),
    "traverser": (TraverserFile, traverser),
    "arm": (ArmFile, arm),
}
"""Every kind of machine: the schema of its file, and what makes the machine of a valid one, its name and folder."""
