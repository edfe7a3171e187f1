"""What a command would work on, resolved, as files that can be given to it again."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from shlex import join

import click

from kinematics.machine_writer import machine_toml
from kinematics.toml_text import toml
from planner.program_writer import program_toml
from pulsepath import record
from pulsepath.directory import write_files
from pulsepath.inputs import Inputs

MACHINE, PROGRAM = "machine.toml", "program.toml"


def dump(
    folder: Path, inputs: Inputs, command: str, options: Mapping[str, int | str], force: bool, as_json: bool
) -> None:
    """Write machine and program with every default filled in; print the options as TOML, and the command for it all.

    options  by their names on the command line, without dashes; a machine that names files beside it, as an arm does,
    stays as its file has it
    """
    told = f'"pulsepath {command}" works on this'
    if inputs.companions:
        machine = inputs.machine_toml
    else:
        machine = machine_toml(inputs.machine, f"The machine {inputs.machine.name}, as {told}.", complete=True).encode()
    own = replace(inputs.program, machine=MACHINE)
    program = program_toml(own, f"The program {inputs.program.name}, as {told}.", complete=True).encode()
    write_files(folder, {MACHINE: machine, PROGRAM: program, **inputs.companions}, force)
    flags = [word for name, value in options.items() for word in (f"--{name}", str(value))]
    out = ["--out", str(folder / "plan")] if command == "plan" else []
    again = join(["pulsepath", command, str(folder / PROGRAM), *flags, *out])
    if as_json:
        files = {"machine": str(folder / MACHINE), "program": str(folder / PROGRAM)}
        click.echo(record.as_json({"options": dict(options), **files, "command": again}), nl=False)
    else:
        click.echo("[options]")
        for name, value in options.items():
            click.echo(f"{name} = {toml(value)}")
        click.echo(f"# {folder / MACHINE} and {folder / PROGRAM}: give them back by\n# {again}")
