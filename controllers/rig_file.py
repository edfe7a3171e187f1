"""Rig files: the schema of a rig's TOML with its tasks, the rig that one describes, and the motions of its tasks."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib.resources.abc import Traversable
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, cast, get_args

from pydantic import AfterValidator, Field, TypeAdapter, ValidationError, model_validator

from controllers.card import PCI_8132, PCI_8164, Card
from controllers.drives.drive_tables import KINDS, TRANSMISSION, ServoTable, StepperTable, drive_of
from controllers.rig import Drive, Host, Rig, Sine, Task, time_path
from kinematics.files.keys import Chosen, key
from kinematics.files.schema import File, TableSchema, build, one_of_tables, refuse_wrong_kind
from kinematics.files.toml_document import Document, Key, read
from kinematics.foundation.arrays import freeze_array
from kinematics.foundation.errors import BadValue, Fault, FileError, MotionError, NotInstalled, validation_error
from kinematics.foundation.names import closest, find, nearest, presets
from kinematics.foundation.units import Unit, describe_value
from kinematics.kinds.axis_keys import find_repeated_names
from kinematics.machine.machine import Machine
from kinematics.machine.machine_file import load_machine
from planner.program.program_file import load_program


def _require_name(name: str) -> str:
    if not name:
        raise validation_error("empty: give the task a name")
    return name


class TaskTiming(TableSchema):
    """How long a task lasts, and how often the host commands: every `step`, or so that there are `samples`."""

    name: Annotated[str, AfterValidator(_require_name)] = key("of the task")
    duration: Annotated[float, Unit("s", above=0, like="5 s")] = key("of the motion")
    step: Annotated[float, Unit("s", above=0, like="125 ms")] | None = key("of the host", default=None)
    samples: Annotated[int, Field(ge=2)] | None = key("of the host, both ends included", default=None)

    @model_validator(mode="after")
    def _one_rate(self) -> Self:
        if (self.step is None) == (self.samples is None):
            raise validation_error('give either step, e.g. "125 ms", or samples, e.g. 41')
        return self

    @property
    def dt(self) -> float:
        return self.step if self.step is not None else self.duration / ((self.samples or 2) - 1)


class PathTask(TaskTiming):
    """A program's path, run by one profile from end to end."""

    program: str = key("a program's name, or the path of its file")
    profile: Literal["quarter-sine", "trapezoid"] = key("of the speed along it", default="quarter-sine")
    ramp: Annotated[float, Unit("s", above=0, like="1 s")] = key("time of speeding up, and of slowing down")

    def make_task(self, machine: Machine, folder: Path | None) -> Task:
        from planner.path.actuation import actuate

        try:
            path = actuate(load_program(resolve_path(folder, self.program)), machine)
        except MotionError as error:
            raise BadValue(str(error), nearest=getattr(error, "nearest", ""), key=("program",)) from error
        return Task(self.name, time_path(path, self.profile, self.ramp / self.duration, self.duration), self.dt)


class SineTable(TableSchema):
    """Of the axes named: amplitude · sin(2π t/period)."""

    axes: tuple[str, ...] = key("names of rotary axes")
    amplitude: Annotated[float, Unit("rad", above=0, like="90 deg")] = key("of the sine")
    period: Annotated[float, Unit("s", above=0)] = key("of the sine")


class SineTask(TaskTiming):
    """Axes on their own, beyond any travel of the machine; the others rest."""

    sine: SineTable

    def make_task(self, machine: Machine, folder: Path | None) -> Task:
        kinds = {axis.name: axis.kind for axis in machine.axes}
        for n, name in enumerate(self.sine.axes):
            if kinds.get(name) != "rotary":
                told = "is a linear axis" if name in kinds else f"is no axis{nearest(name, kinds)}"
                rotary = [axis for axis, kind in kinds.items() if kind == "rotary"]
                known = ", ".join(rotary) or "none"
                raise BadValue(
                    f"{describe_value(name)} {told}; rotary axes: {known}",
                    allowed=known,
                    nearest=closest(name, rotary),
                    key=("sine", "axes", n),
                )
        amplitude = freeze_array([self.sine.amplitude * (axis.name in self.sine.axes) for axis in machine.axes], float)
        omega = 6.283185307179586 / self.sine.period
        return Task(self.name, Sine(machine.home_q, amplitude, omega, self.duration), self.dt)


TaskTable = Annotated[PathTask | SineTask, one_of_tables(PathTask, SineTask)]


def resolve_path(folder: Path | None, name_or_path: str) -> str | Path:
    """A name as it is; a path from the folder of the file that gives it."""
    path = Path(name_or_path)
    named = not path.suffix and path.name == name_or_path
    return name_or_path if named or folder is None else folder / path


CARDS = {card.name: card for card in (PCI_8132, PCI_8164)}


def _card(name: str) -> str:
    if name not in CARDS:
        told = f"{describe_value(name)} is not a known card{nearest(name, CARDS)}; cards: {', '.join(CARDS)}"
        raise validation_error(BadValue(told, allowed=", ".join(CARDS), nearest=closest(name, CARDS)))
    return name


CardName = Annotated[str, AfterValidator(_card)]


class CardTable(TableSchema):
    """A model of card, and how it is set: see `Card`."""

    model: CardName = key("of the motion card")
    while_moving: Literal["replace", "queue"] = "replace"
    start_from: Literal["commanded", "current"] = "commanded"
    short_moves: Literal["keep rate", "keep time"] = "keep rate"
    current_speed: Literal["signed", "magnitude"] = "signed"
    speed_range: Annotated[float, Unit("1/s", above=0, like="100000 1/s")] | None = None

    @property
    def card(self) -> Card:
        return replace(CARDS[self.model], **self.model_dump(exclude={"model"}))


CardEntry = Annotated[CardName | CardTable, Chosen(lambda value: CardTable if isinstance(value, dict) else CardName)]


class HostTable(TableSchema):
    """See `Host`."""

    timer: Literal["counter", "sleep"] = "counter"
    granularity: Annotated[float, Unit("s", least=0, like="10 ms")] = 0.0
    jitter: Annotated[float, Unit("s", least=0, like="2 ms")] = 0.0
    seed: Annotated[int, Field(ge=0)] = 0
    speed_from: Literal["encoder", "card"] = "encoder"
    closing_stop: Annotated[float, Unit("s", least=0, like="1 ms")] | None = None


class RigAxisTable(TableSchema):
    """What one axis has of its own: its kind of drive, and how that differs from all of its kind."""

    name: str
    servo: ServoTable | None = None
    stepper: StepperTable | None = None


class RigFile(File):
    """A rig, key by key. [servo] and [stepper] are what all drives of the kind have."""

    what: ClassVar[str] = "rig"
    machine: str = key(
        "a machine's name, or the path of its file",
        remedy='write the name of a machine, e.g. "arm", or the path of its file',
    )
    card: CardEntry = key("model of motion card, and how it is set", default=PCI_8132.name)
    host: HostTable = key("how the host keeps time", default=HostTable())
    servo: ServoTable | None = key("what all servo drives have", default=None)
    stepper: StepperTable | None = key("what all stepper drives have", default=None)
    axis: tuple[RigAxisTable, ...] = key(
        "`[[axis]]` tables by `name`: the `servo` or `stepper` of one axis", default=()
    )
    task: tuple[TaskTable, ...] = key("motions to try laws on", default=())


_TASK: TypeAdapter[PathTask | SineTask] = TypeAdapter(TaskTable)


def validate_rig_file(name_or_path: str | PathLike[str]) -> None:
    """Raise FileError for a rig's file that shows a fault by itself, with every fault that its machine shows as well.

    A file without any takes a small part of the time of `load_rig`, which makes the machine and the tasks.
    """
    source = find("controllers", "rig", name_or_path)
    document = read(source)
    refuse_wrong_kind(document, RigFile.what)
    try:
        build(document, RigFile, find_repeated_names, partial(find_repeated_names, array="task"))
    except FileError:
        read_rig(source)
        raise


def read_rig(source: Path | Traversable) -> Rig:
    """The rig that a file describes, named after the file. Raises FileError with every fault of the file."""
    document = read(source)
    folder = source.parent if isinstance(source, Path) else None
    refuse_wrong_kind(document, RigFile.what)
    machine, told = _machine(document.data.get("machine"), folder)
    tasks, faults = _tasks(document, machine, folder)
    try:
        model = build(
            document,
            RigFile,
            find_repeated_names,
            partial(find_repeated_names, array="task"),
            partial(_find_drive_faults, machine, told),
        )
    except FileError as error:
        raise FileError(document.file, sorted((*error.faults, *faults), key=lambda fault: fault.line or 0)) from None
    machine = cast(Machine, machine)  # what has none has a fault
    try:
        host = Host(**model.host.model_dump())
        card = model.card.card if isinstance(model.card, CardTable) else CARDS[model.card]
        drives = tuple(_drive(model, machine, n) for n in range(len(machine.axes)))
    except MotionError as error:  # what no single value shows
        faults.append(document.fault((), str(error)))
    if faults:
        raise FileError(document.file, faults)
    return Rig(machine, drives, card, host, Path(source.name).stem, tuple(tasks))


def _machine(stated: object, folder: Path | None) -> tuple[Machine | None, MotionError | None]:
    """The machine that a file names; or none, and why, unless the schema says that."""
    if not isinstance(stated, str):
        return None, None
    try:
        return load_machine(resolve_path(folder, stated)), None
    except NotInstalled:  # which is no fault of the file
        raise
    except MotionError as error:
        return None, error


def _tasks(document: Document, machine: Machine | None, folder: Path | None) -> tuple[list[Task], list[Fault]]:
    """The tasks that the machine can run, and faults of others; a table that fits no schema is left to that."""
    tasks, faults = [], []
    tables = document.data.get("task", ())
    for n, table in enumerate(tables if machine is not None and isinstance(tables, tuple) else ()):
        try:
            tasks.append(_TASK.validate_python(table, strict=True).make_task(cast(Machine, machine), folder))
        except ValidationError:
            continue
        except MotionError as error:
            faults.append(document.fault(("task", n, *(error.key if isinstance(error, BadValue) else ())), error))
    return tasks, faults


def _drive(model: RigFile, machine: Machine, n: int) -> Drive:
    axis = machine.axes[n]
    own = next((table for table in model.axis if table.name == axis.name), None)
    kind = _kind(model.model_fields_set, own.model_fields_set if own else ())
    values: dict[str, Any] = {}
    for table in (getattr(model, kind), own and getattr(own, kind)):
        if table is not None:
            values |= {name: getattr(table, name) for name in table.model_fields_set}
    return drive_of(kind, axis, values)


def _kind(stated: Any, own: Any) -> str:
    """The kind of an axis' drive, from the keys of the file and of its own table; empty where they do not say."""
    kinds = [kind for kind in KINDS if kind in own] or [kind for kind in KINDS if kind in stated]
    return kinds[0] if len(kinds) == 1 else ""


def _find_drive_faults(
    machine: Machine | None, unread: MotionError | None, data: Mapping[str, Any]
) -> Iterator[tuple[Key, str | MotionError]]:
    """Axes that the machine does not have, and whatever is missing for a drive behind each that it has.

    unread  why there is no machine
    """
    if machine is None:
        if unread is not None:
            yield ("machine",), unread
        return
    tables = data.get("axis", ())
    entries: dict[str, tuple[Key, dict[str, Any]]] = {
        table["name"]: (("axis", n), table)
        for n, table in enumerate(tables if isinstance(tables, tuple) else ())
        if isinstance(table, dict) and isinstance(table.get("name"), str)
    }
    names = [axis.name for axis in machine.axes]
    for name, (at, _) in entries.items():
        if name not in names:
            told = (
                f"{describe_value(name)} is no axis of {machine.name}{nearest(name, names)}; axes: {', '.join(names)}"
            )
            yield (*at, "name"), BadValue(told, allowed=", ".join(names), nearest=closest(name, names))
    missing = set()
    undriven: dict[Key, list[str]] = {}
    other_way: dict[tuple[Key, str], list[str]] = {}
    for axis in machine.axes:
        at, own = entries.get(axis.name, ((), {}))
        kind = _kind(data, own)
        if not kind:
            both = [key for key in KINDS if key in (own if any(key in own for key in KINDS) else data)]
            undriven.setdefault((*at, *both[1:2]), []).append(axis.name)
            continue
        given = {key for table in (data.get(kind), own.get(kind)) if isinstance(table, dict) for key in table}
        place: Key = (*at, kind) if kind in own else (kind,)
        wanted, other = TRANSMISSION[axis.kind], next(v for k, v in TRANSMISSION.items() if k != axis.kind)
        for name in (*KINDS[kind].needed, wanted):
            if name not in given and (place, name) not in missing:
                missing.add((place, name))
                yield (*place, name), f"missing: {_example(kind, name)}"
        if other in given:
            other_way.setdefault(((*place, other), f"{axis.kind}: give a {wanted} instead"), []).append(axis.name)
    for at, of in undriven.items():
        many = f"{_describe_axes(of)} need{'s' if len(of) == 1 else ''} one drive, [{'] or ['.join(KINDS)}]"
        yield at, f"{many}: {'both are stated' if at and at[-1] in KINDS else 'neither is stated'}"
    for (at, instead), of in other_way.items():
        yield at, f"{_describe_axes(of)} {'is' if len(of) == 1 else 'are'} {instead}"


def _describe_axes(axes: Sequence[str]) -> str:
    return f"ax{'i' if len(axes) == 1 else 'e'}s {', '.join(axes)}"


def _example(kind: str, name: str) -> str:
    """The example that a key declares, or that of its unit."""
    field = KINDS[kind].model_fields[name]
    if field.examples:
        return f"write e.g. {field.examples[0]}"
    stated = (part for choice in get_args(field.annotation) for part in get_args(choice))
    return next(part.example for part in stated if isinstance(part, Unit))


RigSource = Rig | str | PathLike[str]
"""A rig, or what `load_rig` loads one from."""


def load_rig(name_or_path: RigSource) -> Rig:
    """Load a rig, with its machine and the motions of its tasks.

    Parameters
    ----------
    name_or_path
        Name of a bundled rig, or path of a TOML file. A rig stays as it is.

    Returns
    -------
    Rig
        Machine, drives, card, host and tasks.

    Raises
    ------
    FileError
        The file has faults; all of them are told, with their lines.
    MotionError
        The name is unknown; the nearest and all known ones are told.
    """
    if isinstance(name_or_path, Rig):
        return name_or_path
    return read_rig(find("controllers", "rig", name_or_path))


def rig_names() -> tuple[str, ...]:
    """Names of the bundled rigs."""
    return tuple(presets("controllers"))
