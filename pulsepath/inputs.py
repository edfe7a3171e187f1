"""What a command line works on: the program and the machine that it names, and the text that they were read from."""

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from kinematics import Machine, MotionError, load_machine
from kinematics.registry import find
from planner import Program, load_program


@dataclass(frozen=True, slots=True)
class Inputs:
    """A program and a machine, with the content of their files."""

    program: Program
    machine: Machine
    program_toml: bytes
    machine_toml: bytes

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
    loaded = load_program(program)
    name = _named(loaded, program) if machine is None else machine
    return Inputs(
        loaded,
        load_machine(name),
        find("planner", "program", program).read_bytes(),
        find("kinematics", "machine", name).read_bytes(),
    )


def _named(program: Program, source: str) -> str:
    if program.machine is None:
        raise MotionError(f'program {program.name} names no machine; give --machine, or write machine = "…" in it')
    is_path = find("kinematics", "machine", program.machine) == Path(program.machine)
    return str(Path(source).parent / program.machine) if is_path else program.machine
