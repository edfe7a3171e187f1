"""The program and machine that a command line names, with the text of their files."""

import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics.files.toml_document import read
from kinematics.foundation.errors import FileError, MotionError
from kinematics.foundation.names import find, presets, source_folder
from planner.program.joins import fit_joins
from planner.program.model import Program
from pulsepath.options import refuse_missing
from pulsepath.progress import note, note_doubts

if TYPE_CHECKING:
    from controllers.rig import Rig
    from kinematics import Machine
    from planner.sources.source import Imported

LoadMachine = Callable[[], tuple["Machine", bytes, Mapping[str, bytes]]]


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

        options = dict(self.options)
        if self.format == "gcode" and _is_of_joint_axes(file):
            options["machine"] = machine
        result = stream_program(file, find_source(self.format)(**options))
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
                note(f"segment {number} is in line {line} of {self._program_file}")

    @property
    def _program_file(self) -> str:
        """Name of the file that the program was read from."""
        if self.origin is not None:
            return f"{self.program.name}{self.origin.suffix}"
        return Path(self.program.file or f"{self.program.name}.toml").name

    @property
    def digests(self) -> dict[str, str]:
        """SHA-256 of each file's content."""
        files = {"program": self.program_toml, "machine": self.machine_toml}
        return {role: sha256(content).hexdigest() for role, content in files.items()}


def read_inputs(
    program: str,
    machine: str | None,
    fit: float | None = None,
    origin: Origin | None = None,
    ready: Callable[[], object] = lambda: None,
) -> Inputs:
    """Read a program by preset name or path, and a machine likewise.

    A path in the program counts from the program's own folder. Raises FileError or MotionError.

    machine  None: the one that the program names
    fit      m, within which a TOML program's path is to be fitted; None: as it says
    origin   how a file of another format is read
    ready    called once the program's file is read and the machine's file is known to be there
    """
    if origin is None:
        inputs = _read_native(program, machine, ready)
        if fit is None:
            return inputs
        return replace(inputs, program=fit_joins(inputs.program, fit), fit=fit)
    file = Path(program)
    if machine is None:
        raise MotionError(f"{file.name} names no machine: give --machine")
    load_machine = _find_machine(machine)
    imported = origin.read_import(file, machine)
    ready()
    model, content, companions = load_machine()
    _note_lost_angles(imported.turned, model, file.name)
    return Inputs(imported.program, model, file.read_bytes(), content, companions, origin)


def _note_lost_angles(turned: Iterable[str], machine: "Machine", name: str) -> None:
    """Show a warning of rotations that the machine cannot make.

    Its angles follow from its other axes.
    """
    if not machine.follows:
        return
    from planner.path.followed_angles import describe_lost_angles

    if warning := describe_lost_angles(turned, machine):
        note(f"note: {name}: {warning}")


def _is_of_joint_axes(file: Path) -> bool:
    from planner.sources.rs274.joints import find_header
    from planner.sources.source import decode_text

    return find_header(decode_text(file)) is not None


def _find_machine(machine: str) -> LoadMachine:
    """Return a function that loads a machine, the content of its file, and the files that it names.

    Faults of the file are reported at once. A bundled one has none, and is read when it is loaded.
    """
    file = find("kinematics", "machine", machine)
    if isinstance(file, Path):
        refuse_missing(file)  # before slow modules load
    make_machine: Callable[[], Machine] | None = None
    if machine not in presets("kinematics"):
        from kinematics.machine.machine_file import validate_machine_file

        make_machine = validate_machine_file(file)

    def load() -> tuple["Machine", bytes, Mapping[str, bytes]]:
        from kinematics.machine.machine_file import read_machine
        from kinematics.machine.machine_writer import toml_of

        if make_machine is None:
            model = read_machine(file)
        else:
            model = make_machine()
            note_doubts(model, file.name)
        content = toml_of(file)
        urdf = tomllib.loads(content.decode()).get("geometry", {}).get("urdf")
        companions = {}
        if urdf is not None:
            companions[urdf] = (source_folder("kinematics", file) / urdf).read_bytes()
        return model, content, companions

    return load


def _read_native(program: str, machine: str | None, ready: Callable[[], object]) -> Inputs:
    """Read a TOML program and its machine. Raises FileError with the faults of both in one pass."""
    from planner.program.program_file import make_program, read_program_file

    try:
        document, model = read_program_file(program)
    except FileError as error:
        raise error if machine is not None else _add_machine_fault(error, program) from None
    try:
        name = _find_machine_name(model.machine, program) if machine is None else machine
        load_machine = _find_machine(name)
    except MotionError as error:
        has_own_faults = isinstance(error, FileError) and Path(error.file).is_file()
        if machine is not None or has_own_faults:
            raise
        raise FileError(document.file, [document.fault(("machine",), error)]) from error
    ready()
    loaded = make_program(document, model)  # may load SciPy, as the machine does
    driven, content, companions = load_machine()
    if driven.follows:
        from planner.path.followed_angles import list_turned_angles

        _note_lost_angles(list_turned_angles(loaded), driven, Path(program).name)
    program_toml = find("planner", "program", program).read_bytes()
    return Inputs(loaded, driven, program_toml, content, companions)


def read_rig(name_or_path: str | None, machine: "Machine") -> "Rig | None":
    """Return the rig of a name or file for a machine. Raises MotionError if it does not fit."""
    from controllers.rig_choice import choose_rig

    return None if name_or_path is None else choose_rig(machine, name_or_path)


def refuse_faulty_rig(rig: str | None) -> None:
    """Raise MotionError for a faulty file of a rig. A bundled one has no faults."""
    if rig is None or rig in presets("controllers"):
        return
    from controllers.rig_file import validate_rig_file

    validate_rig_file(find("controllers", "rig", rig))


def _add_machine_fault(error: FileError, program: str) -> FileError:
    """Add to the faults of a program that the machine which it names does not exist."""
    try:
        document = read(find("planner", "program", program))
    except FileError:  # no text, or no TOML, names no machine
        return error
    named = document.data.get("machine")
    if not isinstance(named, str):
        return error
    try:
        read(find("kinematics", "machine", _find_machine_name(named, program)))
    except MotionError as reason:
        if isinstance(reason, FileError) and Path(reason.file).is_file():  # its own faults
            return error
        faults = [*error.faults, document.fault(("machine",), reason)]
        return FileError(error.file, sorted(faults, key=lambda fault: fault.line or 0))
    return error


def _find_machine_name(machine: str | None, program: str) -> str:
    """Return the name or path of the machine that a program names."""
    if machine is None:
        name = Path(program).stem
        raise MotionError(
            f'program {name} names no machine; give --machine, or write machine = "…" in it',
        )
    is_path = find("kinematics", "machine", machine) == Path(machine)
    return str(Path(program).parent / machine) if is_path else machine
