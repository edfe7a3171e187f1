"""Rig files: the rig that one describes. The schema is in controllers.rig_tables."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from importlib.resources.abc import Traversable
from os import PathLike
from pathlib import Path
from typing import Any, get_args

from pydantic import TypeAdapter, ValidationError

from controllers.drives.drive_tables import KINDS, TRANSMISSION, drive_of
from controllers.rig import Drive, Host, Rig, Task
from controllers.rig_tables import (
    CARDS,
    CardTable,
    FileTask,
    PathTask,
    RigFile,
    SineTask,
    TaskTable,
    resolve_path,
)
from kinematics.files.schema import build, refuse_wrong_kind
from kinematics.files.toml_document import Document, Key, read
from kinematics.foundation.errors import BadValue, Fault, FileError, MotionError, NotInstalled
from kinematics.foundation.names import closest, find, nearest, presets
from kinematics.foundation.units import Unit, describe_value
from kinematics.kinds.axis_faults import find_repeated_names
from kinematics.machine.axis import Axis
from kinematics.machine.machine_file import load_machine, read_summary

_TASK: TypeAdapter[PathTask | SineTask | FileTask] = TypeAdapter(TaskTable)
_Stated = list[tuple[int, PathTask | SineTask | FileTask]]
"""Tasks by their places in the file."""


def read_rig(source: Path | Traversable) -> Rig:
    """The rig that a file describes, named after the file.

    Raises FileError with every fault of the file.
    """
    return validate_rig_file(source)()


def validate_rig_file(source: Path | Traversable) -> Callable[[], Rig]:
    """What makes the rig that a file describes; making it, with its machine and tasks, takes many
    times as long.

    Raises FileError with every fault that the file shows, and those that it names: of a machine its
    axes. What only the machine shows, such as a task that it cannot run, is raised as the rig is
    made.
    """
    document = read(source)
    folder = source.parent if isinstance(source, Path) else None
    refuse_wrong_kind(document, RigFile.what)
    stated = document.data.get("machine")
    axes, unread = _read_axes(stated, folder)
    tasks, faults = _read_tasks(document, axes, folder)
    try:
        model = build(
            document,
            RigFile,
            find_repeated_names,
            partial(find_repeated_names, array="task"),
            partial(_find_drive_faults, Path(str(stated)).stem, axes, unread),
        )
    except FileError as error:
        raise FileError(
            document.file, sorted((*error.faults, *faults), key=lambda fault: fault.line or 0)
        ) from None
    try:
        host = Host(**model.host.model_dump())
        card = model.card.card if isinstance(model.card, CardTable) else CARDS[model.card]
        drives = tuple(_make_drive(model, axis) for axis in axes)
    except MotionError as error:  # what no single value shows
        faults.append(document.fault((), str(error)))
    if faults:
        raise FileError(document.file, faults)

    def make() -> Rig:
        try:
            machine = load_machine(resolve_path(folder, model.machine))
        except NotInstalled:  # which is no fault of the file
            raise
        except MotionError as error:
            raise FileError(document.file, [document.fault(("machine",), error)]) from error
        made, unfit = list[Task](), list[Fault]()
        for n, task in tasks:
            try:
                made.append(task.make_task(machine, folder))
            except MotionError as error:
                unfit.append(_locate_in_task(document, n, error))
        if unfit:
            raise FileError(document.file, unfit)
        return Rig(machine, drives, card, host, Path(source.name).stem, tuple(made))

    return make


def _read_axes(stated: object, folder: Path | None) -> tuple[tuple[Axis, ...], MotionError | None]:
    """The axes of the machine that a file names; or none, and why, unless the schema says that."""
    if not isinstance(stated, str):
        return (), None
    try:
        source = find("kinematics", "machine", resolve_path(folder, stated))
        return read_summary(source).axes, None
    except MotionError as error:
        return (), error


def _read_tasks(
    document: Document, axes: Sequence[Axis], folder: Path | None
) -> tuple[_Stated, list[Fault]]:
    """The tasks, and what they name that is not there; a table that fits no schema is left to
    that.
    """
    tasks, faults = _Stated(), list[Fault]()
    tables = document.data.get("task", ())
    for n, table in enumerate(tables if axes and isinstance(tables, tuple) else ()):
        try:
            task = _TASK.validate_python(table, strict=True)
            task.refuse_unknown(axes, folder)
        except ValidationError:
            continue
        except MotionError as error:
            faults.append(_locate_in_task(document, n, error))
        else:
            tasks.append((n, task))
    return tasks, faults


def _locate_in_task(document: Document, n: int, error: MotionError) -> Fault:
    return document.fault(("task", n, *(error.key if isinstance(error, BadValue) else ())), error)


def _make_drive(model: RigFile, axis: Axis) -> Drive:
    own = next((table for table in model.axis if table.name == axis.name), None)
    kind = _kind(model.model_fields_set, own.model_fields_set if own else ())
    values: dict[str, Any] = {}
    for table in (getattr(model, kind), own and getattr(own, kind)):
        if table is not None:
            values |= {name: getattr(table, name) for name in table.model_fields_set}
    return drive_of(kind, axis, values)


def _kind(stated: Any, own: Any) -> str:
    """The kind of an axis' drive, from the keys of the file and of its own table; empty where they
    do not say.
    """
    kinds = [kind for kind in KINDS if kind in own] or [kind for kind in KINDS if kind in stated]
    return kinds[0] if len(kinds) == 1 else ""


def _find_drive_faults(
    machine: str, axes: Sequence[Axis], unread: MotionError | None, data: Mapping[str, Any]
) -> Iterator[tuple[Key, str | MotionError]]:
    """Axes that the machine does not have, and whatever is missing for a drive behind each that it
    has.

    unread  why its axes are not known
    """
    if unread is not None:
        yield ("machine",), unread
    if not axes:
        return
    tables = data.get("axis", ())
    entries: dict[str, tuple[Key, dict[str, Any]]] = {
        table["name"]: (("axis", n), table)
        for n, table in enumerate(tables if isinstance(tables, tuple) else ())
        if isinstance(table, dict) and isinstance(table.get("name"), str)
    }
    names = [axis.name for axis in axes]
    for name, (at, _) in entries.items():
        if name not in names:
            told = f"{describe_value(name)} is no axis of {machine}{nearest(name, names)}; axes: {', '.join(names)}"
            yield (
                (*at, "name"),
                BadValue(told, allowed=", ".join(names), nearest=closest(name, names)),
            )
    missing = set()
    undriven: dict[Key, list[str]] = {}
    other_way: dict[tuple[Key, str], list[str]] = {}
    for axis in axes:
        at, own = entries.get(axis.name, ((), {}))
        kind = _kind(data, own)
        if not kind:
            both = [
                key for key in KINDS if key in (own if any(key in own for key in KINDS) else data)
            ]
            undriven.setdefault((*at, *both[1:2]), []).append(axis.name)
            continue
        given = {
            key
            for table in (data.get(kind), own.get(kind))
            if isinstance(table, dict)
            for key in table
        }
        place: Key = (*at, kind) if kind in own else (kind,)
        wanted, other = (
            TRANSMISSION[axis.kind],
            next(v for k, v in TRANSMISSION.items() if k != axis.kind),
        )
        for name in (*KINDS[kind].needed, wanted):
            if name not in given and (place, name) not in missing:
                missing.add((place, name))
                yield (*place, name), f"missing: {_example(kind, name)}"
        if other in given:
            other_way.setdefault(
                ((*place, other), f"{axis.kind}: give a {wanted} instead"), []
            ).append(axis.name)
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
