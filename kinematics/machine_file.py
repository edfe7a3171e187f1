"""Machine files: the schema of each kind's TOML, and the machine that one describes."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from kinematics import kmitl_geometry
from kinematics.document import Key, read
from kinematics.errors import BadValue, FileError, MotionError, NotInstalled
from kinematics.kinds.arm import ArmFile, arm, joints_of, of_a_joint
from kinematics.kinds.axes import MachineFile, named_once, one_pulse, wired_axes
from kinematics.kinds.hexapod import LEGS, HexapodFile, hexapod
from kinematics.kinds.linkage import NAMES, LinkageFile, linkage
from kinematics.kinds.traverser import ROTARY, SLIDES, TraverserFile, traverser
from kinematics.kinds.tripod import ARMS, TripodFile, tripod
from kinematics.kmitl_geometry import is_basic_lengths, read_basic_lengths
from kinematics.machine import Machine
from kinematics.registry import beside, closest, nearest
from kinematics.schema import File, build, refuse_mistaken
from kinematics.units import shown


def read_machine(source: Path | Traversable) -> Machine:
    """The machine that a file describes, named after the file. Raises FileError with every fault of the file.

    Also that of the geometry file of [KMITL 2005] (`kmitl_geometry`), which is no TOML.
    """
    if is_basic_lengths(source):
        return read_basic_lengths(source)
    document = read(source)
    refuse_mistaken(document, MachineFile.what)
    kind = document.data.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        told = "missing" if kind is None else f"{shown(kind)} is no kind of machine{nearest(str(kind), KINDS)}"
        known = ", ".join(map(shown, KINDS))
        no = BadValue(f"{told}; kinds: {known}", allowed=known, nearest=closest(str(kind), KINDS))
        raise FileError(document.file, [document.fault(("kind",), no)])
    schema, construct, names = KINDS[kind]
    wired = partial(wired_axes, names or joints_of(document.data))
    model = build(document, schema, named_once, one_pulse, of_a_joint, wired)
    try:
        return construct(model, Path(source.name).stem, beside("kinematics", source))
    except FileError as error:  # of a file that this one names
        geometry = document.data["geometry"]
        faults = [
            document.fault(("geometry", fault.key if fault.key in geometry else "urdf"), told)
            for fault, told in zip(error.faults, str(error).split("\n"), strict=True)
        ]
        raise FileError(document.file, faults) from error
    except NotInstalled:  # which is no fault of the file
        raise
    except MotionError as error:  # what only the whole machine shows, such as a home pose out of reach
        raise FileError(document.file, [document.fault(_place(document.data, error), str(error))]) from error


def toml_of(source: Path | Traversable) -> bytes:
    """The TOML of a machine's file as it stands; of one that is no TOML, one that says the same."""
    if not is_basic_lengths(source):
        return source.read_bytes()
    from kinematics.machine_writer import machine_toml

    return machine_toml(read_basic_lengths(source), f"from {source.name}; {kmitl_geometry.ASSUMED}").encode()


def _place(data: Mapping[str, Any], error: MotionError) -> Key:
    """Where the file says what its machine refuses: the table that has the error's key, an axis' own one first."""
    *of, name = getattr(error, "key", ()) or ("geometry",)
    own = [("axis", n) for n, table in enumerate(data.get("axis", ())) if table.get("name") in of]
    tables: list[tuple[Key, Any]] = [(place, data["axis"][place[1]]) for place in own]
    tables += [((key,), data.get(key)) for key in ("axes", "rotary", "geometry", "wiring")]
    places = ((*place, name) for place, table in tables if isinstance(table, dict) and name in table)
    return next(places, ("geometry",))


KINDS: dict[str, tuple[type[File], Callable[[Any, str, Path | Traversable], Machine], Sequence[str]]] = {
    "hexapod": (HexapodFile, hexapod, LEGS),
    "tripod": (TripodFile, tripod, ARMS),
    "linkage": (LinkageFile, linkage, NAMES),
    "traverser": (TraverserFile, traverser, (*SLIDES, ROTARY)),
    "arm": (ArmFile, arm, ()),
}
"""Every kind of machine: the schema of its file, what makes the machine of a valid one, its name and folder, and the
names of its axes where the kind says them."""
