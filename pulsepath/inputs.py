"""The program and machine that a command line names, with the text of their files."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from kinematics import Fault, FileError, Machine, MotionError, NotInstalled, load_machine
from kinematics.files.toml_document import read
from kinematics.foundation.names import find, source_folder
from kinematics.machine.machine_writer import toml_of
from planner import Program, load_program

if TYPE_CHECKING:
    from controllers.rig import Rig


@dataclass(frozen=True, slots=True)
class Inputs:
    """A program and a machine, with the content of their files.

    companions: what the machine's file names beside it, such as an arm's URDF
    """

    program: Program
    machine: Machine
    program_toml: bytes
    machine_toml: bytes
    companions: Mapping[str, bytes] = field(default_factory=dict)

    @property
    def digests(self) -> dict[str, str]:
        """SHA-256 of each file's content."""
        files = {"program": self.program_toml, "machine": self.machine_toml}
        return {what: sha256(content).hexdigest() for what, content in files.items()}


def read_inputs(program: str, machine: str | None) -> Inputs:
    """A program by preset name or path, and a machine likewise; None: the one that the program names.

    A path in the program counts from the program's own folder. Raises FileError or MotionError, also where neither says
    which machine.
    """
    try:
        loaded = load_program(program)
    except FileError as error:
        raise error if machine is not None else _add_machine_fault(error, program) from None
    try:
        name = _machine_name(loaded.machine, program) if machine is None else machine
        driven, file = load_machine(name), find("kinematics", "machine", name)
    except NotInstalled:  # which is no fault of the file
        raise
    except MotionError as error:
        if machine is not None or (isinstance(error, FileError) and Path(error.file).is_file()):
            raise
        document = read(find("planner", "program", program))
        raise FileError(document.file, [document.fault(("machine",), error)]) from error
    content = toml_of(file)
    urdf = tomllib.loads(content.decode()).get("geometry", {}).get("urdf")
    companions = {} if urdf is None else {urdf: (source_folder("kinematics", file) / urdf).read_bytes()}
    return Inputs(loaded, driven, find("planner", "program", program).read_bytes(), content, companions)


def read_rig(name_or_path: str | None, machine: Machine) -> "Rig | None":
    """The rig of a name or of a file, behind this machine; None for none. Raises MotionError if it does not fit."""
    from controllers.rig_choice import choose_rig

    return None if name_or_path is None else choose_rig(machine, name_or_path)


def _add_machine_fault(error: FileError, source: str) -> FileError:
    """The faults of a program, and that the machine which it names is not to be found: all in one pass."""
    try:
        document = read(find("planner", "program", source))
    except FileError:  # of no text, or no TOML: it names nothing
        return error
    try:
        named = document.data.get("machine")
        if isinstance(named, str):
            load_machine(_machine_name(named, source))
    except FileError as no:
        if Path(no.file).is_file():  # which has faults of its own
            return error
        reason: MotionError = no
    except NotInstalled:
        return error
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
