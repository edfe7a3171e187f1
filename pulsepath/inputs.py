"""The program and machine that a command line names, with the text of their files."""

import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics.files.toml_document import read
from kinematics.foundation.errors import Fault, FileError, MotionError
from kinematics.foundation.names import find, presets, source_folder
from planner.program.joins import fit_joins
from planner.program.model import Program
from pulsepath.progress import note

if TYPE_CHECKING:
    from controllers.rig import Rig
    from kinematics import Machine
    from planner.sources.source import Imported


@dataclass(frozen=True, slots=True)
class Origin:
    """The way to read a file of another format: name of the format, and its options in SI units.

    suffix: of the file
    """

    format: str
    options: Mapping[str, Any]
    suffix: str

    def read(self, file: Path, machine: str) -> Program:
        """Return the program of a file; machine: the one of a file of joint axes."""
        return self.read_import(file, machine).program

    def read_import(self, file: Path, machine: str) -> "Imported":
        """Read the program of a file, and show its warnings."""
        from planner.sources.source import find_source, stream_program

        source = find_source(self.format)(**{**self.options, **_joint_machine(self.format, file, machine)})
        result = stream_program(file, source)
        for warning in result.warnings:
            note(f"note: {file.name}: {warning}")
        return result


@dataclass(frozen=True, slots=True)
class Inputs:
    """A program and a machine, with the content of their files.

    companions  files that the machine's file names, such as an arm's URDF
    origin      format and options of a program of another format
    fit         tolerance (m) of the requested fit of a TOML program's path
    """

    program: Program
    machine: "Machine"
    program_toml: bytes
    machine_toml: bytes
    companions: Mapping[str, bytes] = field(default_factory=dict)
    origin: "Origin | None" = None
    fit: float | None = None

    @property
    def program_file(self) -> str:
        """Name of the program's file in the folder of a plan."""
        return "program.toml" if self.origin is None else f"program{self.origin.suffix}"

    @contextmanager
    def tell_lines(self) -> Iterator[None]:
        """Note the line of a segment that an error inside is about, before the error is shown."""
        try:
            yield
        except FileError:
            raise
        except MotionError as error:
            self.tell_line(error)
            raise

    def tell_line(self, *errors: MotionError) -> None:
        """Note the line of the program's file of each segment that errors are about, once each."""
        numbers = [error.segment for error in errors if error.segment is not None]
        for number in dict.fromkeys(numbers):
            segments = self.program.segments
            line = segments[number - 1].line_number if number <= len(segments) else None
            if line:
                suffix = ".toml" if self.origin is None else self.origin.suffix
                note(f"segment {number} is in line {line} of {self.program.name}{suffix}")

    @property
    def digests(self) -> dict[str, str]:
        """SHA-256 of each file's content."""
        files = {"program": self.program_toml, "machine": self.machine_toml}
        return {what: sha256(content).hexdigest() for what, content in files.items()}


def read_inputs(
    program: str,
    machine: str | None,
    fit: float | None = None,
    origin: Origin | None = None,
    ready: Callable[[], object] = lambda: None,
) -> Inputs:
    """A program by preset name or path, and a machine likewise; None: the one that the program names.

    A path in the program counts from the program's own folder. Raises FileError or MotionError, also where neither says
    which machine.
    fit     m, within which a TOML program's path is to be fitted; None: as it says
    origin  how a file of another format is read
    ready   called once what is told soon is known to be right: the program's file, and that there is the machine
    """
    if origin is None:
        result = _read_native(program, machine, ready)
        return result if fit is None else replace(result, program=fit_joins(result.program, fit), fit=fit)
    file = Path(program)
    if machine is None:
        raise MotionError(f"{file.name} names no machine: give --machine")
    load_machine = _find_machine(machine)
    imported = origin.read_import(file, machine)
    loaded = imported.program
    ready()
    driven, content, companions = load_machine()
    _note_lost_angles(imported.turned, driven, file.name)
    return Inputs(loaded, driven, file.read_bytes(), content, companions, origin)


def _note_lost_angles(turned: frozenset[str], machine: "Machine", name: str) -> None:
    """Show a warning of rotations that the machine cannot make, because the angle follows from its other axes."""
    if not turned or not machine.follows:
        return
    from planner.path.followed_angles import describe_lost_angles

    if warning := describe_lost_angles(turned, machine):
        note(f"note: {name}: {warning}")


def _joint_machine(name: str, file: Path, machine: str) -> dict[str, str]:
    """Return the machine for a file of joint axes."""
    from planner.sources.rs274.joints import find_header
    from planner.sources.source import decode_text

    return {"machine": machine} if name == "gcode" and find_header(decode_text(file)) is not None else {}


def _find_machine(machine: str) -> Callable[[], tuple["Machine", bytes, Mapping[str, bytes]]]:
    """Return a function that loads a machine, the content of its file, and the files that it names.

    Faults of the file are reported at once. A bundled one has none, and is read when it is loaded.
    """
    file = find("kinematics", "machine", machine)
    if isinstance(file, Path) and not file.exists():  # said before what is slow to load
        read(file)
    make: Callable[[], Machine] | None = None
    if machine not in presets("kinematics"):
        from kinematics.machine.machine_file import validate_machine_file

        make = validate_machine_file(file)

    def load() -> tuple["Machine", bytes, Mapping[str, bytes]]:
        from kinematics.machine.machine_file import read_machine
        from kinematics.machine.machine_writer import toml_of

        driven, content = read_machine(file) if make is None else make(), toml_of(file)
        urdf = tomllib.loads(content.decode()).get("geometry", {}).get("urdf")
        companions = {} if urdf is None else {urdf: (source_folder("kinematics", file) / urdf).read_bytes()}
        return driven, content, companions

    return load


def _read_native(program: str, machine: str | None, ready: Callable[[], object]) -> Inputs:
    from planner.program.program_file import make_program, read_program_file

    try:
        document, model = read_program_file(program)
    except FileError as error:
        raise error if machine is not None else _add_machine_fault(error, program) from None
    try:
        load_machine = _find_machine(_machine_name(model.machine, program) if machine is None else machine)
    except MotionError as error:
        if machine is not None or (isinstance(error, FileError) and Path(error.file).is_file()):
            raise
        raise FileError(document.file, [document.fault(("machine",), error)]) from error
    ready()
    loaded = make_program(document, model)  # which may take SciPy, as the machine does
    driven, content, companions = load_machine()
    if driven.follows:
        from planner.path.followed_angles import list_turned_angles

        _note_lost_angles(list_turned_angles(loaded), driven, Path(program).name)
    return Inputs(loaded, driven, find("planner", "program", program).read_bytes(), content, companions)


def read_rig(name_or_path: str | None, machine: "Machine") -> "Rig | None":
    """Return the rig of a name or of a file for a machine. Raises MotionError if it does not fit."""
    from controllers.rig_choice import choose_rig

    return None if name_or_path is None else choose_rig(machine, name_or_path)


def refuse_faulty_rig(rig: str | None) -> None:
    """Raise MotionError for a faulty file of a rig. A bundled one has no faults."""
    if rig is None or rig in presets("controllers"):
        return
    from controllers.rig_file import validate_rig_file

    validate_rig_file(find("controllers", "rig", rig))


def _add_machine_fault(error: FileError, source: str) -> FileError:
    """The faults of a program, and that the machine which it names is not to be found: all in one pass."""
    try:
        document = read(find("planner", "program", source))
    except FileError:  # of no text, or no TOML: it names nothing
        return error
    try:
        named = document.data.get("machine")
        if isinstance(named, str):
            read(find("kinematics", "machine", _machine_name(named, source)))  # its own faults are told with it
    except FileError as no:
        if Path(no.file).is_file():  # which has faults of its own
            return error
        reason: MotionError = no
    except MotionError as no:
        reason = no
    else:
        return error
    return FileError(error.file, sorted((*error.faults, document.fault(("machine",), reason)), key=_line))


def _line(fault: Fault) -> int:
    return fault.line or 0


def _machine_name(machine: str | None, source: str) -> str:
    if machine is None:
        name = Path(source).stem
        raise MotionError(f'program {name} names no machine; give --machine, or write machine = "…" in it')
    is_path = find("kinematics", "machine", machine) == Path(machine)
    return str(Path(source).parent / machine) if is_path else machine
