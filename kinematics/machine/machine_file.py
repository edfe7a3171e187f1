"""Machine files: the schema of each kind's TOML, and the machine that one describes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib.resources.abc import Traversable
from os import PathLike
from pathlib import Path
from typing import Any, cast

from kinematics.files.schema import Rule, build, read_declared_units, refuse_wrong_kind
from kinematics.files.toml_document import Document, Key, read
from kinematics.foundation.errors import BadValue, FileError, MotionError, NotInstalled
from kinematics.foundation.names import closest, find, nearest, presets, source_folder
from kinematics.foundation.units import describe_value
from kinematics.kinds.arm import ArmFile, build_arm, find_stray_axis_tables, joints_of
from kinematics.kinds.axis_faults import (
    find_pulse_faults,
    find_repeated_names,
    find_travel_faults,
    find_wiring_faults,
)
from kinematics.kinds.axis_keys import MachineFile
from kinematics.kinds.equations import EquationsFile, build_equations
from kinematics.kinds.hexapod import LEGS, HexapodFile, build_hexapod
from kinematics.kinds.linkage import NAMES, LinkageFile, build_linkage
from kinematics.kinds.shaper_keys import find_repeated
from kinematics.kinds.traverser import ROTARY, SLIDES, TraverserFile, build_traverser
from kinematics.kinds.tripod import (
    ARMS,
    TEMPLATE_MACHINE,
    TripodFile,
    build_tripod,
    is_basic_lengths,
    read_basic_lengths,
)
from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine

Construct = Callable[[Any, str, Path | Traversable], Machine]
"""Function that makes a machine of a valid file, its name and its folder."""


def read_machine(source: Path | Traversable) -> Machine:
    """Return the machine that a file describes, named after the file.

    The geometry file of [KMITL 2005], which is no TOML, is read as well.

    Raises FileError with every fault of the file.
    """
    return validate_machine_file(source)()


def validate_machine_file(source: Path | Traversable) -> Callable[[], Machine]:
    """Return a function that makes the machine of a file: that takes longer than the validation.

    Raises FileError with every fault of the keys. The function raises faults of the machine, such
    as a home pose out of reach, and all faults of the geometry file of [KMITL 2005].
    """
    if is_basic_lengths(source):
        return lambda: read_basic_lengths(
            source, read_machine(find("kinematics", "machine", TEMPLATE_MACHINE))
        )
    return partial(_make_machine, source, *_read_model(source))


@dataclass(frozen=True, slots=True)
class MachineSummary:
    """Axes of a machine, before [[vibration]] shapes them, and the pose components they control."""

    name: str
    kind: str
    freedom: tuple[str, ...]
    axes: tuple[Axis, ...]


def read_summary(source: Path | Traversable) -> MachineSummary:
    """Return the summary of a machine. Most files state it, so that no machine is made.

    Raises FileError as `validate_machine_file`.
    """
    if is_basic_lengths(source):
        source = find("kinematics", "machine", TEMPLATE_MACHINE)
    document, model, construct = _read_model(source)
    kind = str(document.data["kind"])
    try:
        axes = model.list_axes()
    except MotionError as error:
        raise FileError(
            document.file, [document.fault(_locate_fault(document.data, error), str(error))]
        ) from error
    if axes is None:
        machine = _make_machine(source, document, model, construct)
        return MachineSummary(machine.name, kind, machine.freedom, machine.axes)
    name = model.name or Path(source.name).stem
    return MachineSummary(name, kind, model.list_freedom(), tuple(axes))


def _read_model(source: Path | Traversable) -> tuple[Document, MachineFile, Construct]:
    """Return a file's document, its model by the schema of its kind, and what constructs it."""
    document = read(source)
    refuse_wrong_kind(document, MachineFile.what)
    kind = document.data.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise FileError(document.file, [document.fault(("kind",), _refuse_kind(kind))])
    schema, construct, names = KINDS[kind]
    names = names or joints_of(document.data)
    wired = partial(find_wiring_faults, names)
    driven = partial(find_pulse_faults, names, _find_turning(document.data))
    rules: list[Rule] = [find_repeated_names, driven, find_stray_axis_tables, wired]
    if any("leg_length" in table.model_fields for table in schema.tables_of("axes")):
        rules.append(partial(find_travel_faults, names))
    model = build(
        document, schema, *rules, plain=read_declared_units(document.data, {"length": "m"})
    )
    if (repeated := find_repeated(model.vibration)) is not None:
        first, again = repeated
        place = f"vibration[{first + 1}] in line {document.line(('vibration', first))}"
        message = (
            f"the same vibration as {place}, against which axes would be shaped twice: remove one "
            'of the two; where the frequency is uncertain, write kind = "zvd" or "ei" in the one '
            "that stays"
        )
        raise FileError(document.file, [document.fault(("vibration", again), message)])
    return document, model, construct


def _find_turning(data: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the axes that may have a table of their own, [rotary]."""
    geometry = data.get("geometry")
    stated = geometry.get("rotary") if isinstance(geometry, dict) else None
    return tuple(map(str, stated)) if isinstance(stated, tuple) else (ROTARY,)


def _refuse_kind(kind: Any) -> BadValue:
    """Return the refusal of a kind. For a bundled machine's name, the message names its kind."""
    known = ", ".join(map(describe_value, KINDS))
    bundled = presets("kinematics")
    message = f"{describe_value(kind)} is not a kind of machine"
    if kind is None:
        message = "missing"
    elif isinstance(kind, str) and kind in bundled:
        own = str(read(bundled[kind]).data["kind"])
        message += f", but a machine of kind {describe_value(own)}"
        message += f": pulsepath init --machine {kind} writes its file"
        return BadValue(f"{message}; kinds: {known}", allowed=known, nearest=own)
    return BadValue(
        f"{message}{nearest(str(kind), KINDS)}; kinds: {known}",
        allowed=known,
        nearest=closest(str(kind), KINDS),
    )


def _make_machine(
    source: Path | Traversable, document: Document, model: MachineFile, construct: Construct
) -> Machine:
    try:
        name = model.name or Path(source.name).stem
        machine = construct(model, name, source_folder("kinematics", source))
    except FileError as error:  # of a file that this one names
        geometry = document.data["geometry"]
        faults = [
            document.fault(
                ("geometry", fault.key if fault.key in geometry else "urdf"), error.describe(fault)
            )
            for fault in error.faults
        ]
        raise FileError(document.file, faults) from error
    except NotInstalled:  # which is no fault of the file
        raise
    except (
        MotionError
    ) as error:  # what only the whole machine shows, such as a home pose out of reach
        raise FileError(
            document.file, [document.fault(_locate_fault(document.data, error), str(error))]
        ) from error
    for n, stated in enumerate(model.vibration):
        try:
            machine = machine.shape_along(stated.direction, stated.shaper)
        except MotionError as error:
            fault = document.fault(("vibration", n), str(error))
            raise FileError(document.file, [fault]) from error
    return machine


def _locate_fault(data: Mapping[str, Any], error: MotionError) -> Key:
    """Return the place of the key that an error names: in the table of its axis, or in another."""
    *axes, name = getattr(error, "key", ()) or ("geometry",)
    tables: list[tuple[Key, Any]] = [
        (("axis", n), table)
        for n, table in enumerate(data.get("axis", ()))
        if table.get("name") in axes
    ]
    tables += [((key,), data.get(key)) for key in ("axes", "rotary", "geometry", "wiring")]
    places = (
        (*place, name) for place, table in tables if isinstance(table, dict) and name in table
    )
    return next(places, ("geometry",))


KINDS: dict[str, tuple[type[MachineFile], Construct, Sequence[str]]] = {
    "hexapod": (HexapodFile, build_hexapod, LEGS),
    "tripod": (TripodFile, build_tripod, ARMS),
    "linkage": (LinkageFile, build_linkage, NAMES),
    "traverser": (TraverserFile, build_traverser, (*SLIDES, ROTARY)),
    "arm": (ArmFile, build_arm, ()),
    "equations": (EquationsFile, build_equations, ()),
}
"""Every kind of machine: schema of its file, function that makes the machine, and the names of its
axes where the kind defines them.
"""


MachineSource = Machine | str | PathLike[str]
"""A machine, or the name or file from which `load_machine` loads one."""


def load_machine(name_or_path: MachineSource) -> Machine:
    """Load a machine.

    Parameters
    ----------
    name_or_path
        Name of a bundled machine, or path of a TOML file. A machine stays as it is.

    Returns
    -------
    Machine
        Named after its file.

    Raises
    ------
    FileError
        The file has faults: the message lists all of them, with their lines.
    MotionError
        The name is unknown: the message names the nearest and all known ones.
    """
    if isinstance(name_or_path, Machine) or hasattr(
        name_or_path, "home_q"
    ):  # what has its parts is as good
        return cast(Machine, name_or_path)
    source = find("kinematics", "machine", name_or_path)
    if isinstance(name_or_path, str) and name_or_path in presets("kinematics"):
        bundled = _read_bundled(name_or_path)
        return bundled.driven_by(bundled.axes)  # a copy, whose axes may be replaced
    return read_machine(source)


@cache
def _read_bundled(name: str) -> Machine:
    """Read a bundled machine once: copies share its inverse map and all that `derive` makes."""
    return read_machine(presets("kinematics")[name])


def machine_names() -> tuple[str, ...]:
    """Return the names of the bundled machines."""
    return tuple(presets("kinematics"))
