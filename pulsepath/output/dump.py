"""The inputs of a command with all defaults filled in, as files that reproduce it."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from shlex import join

import click

from kinematics.files.toml_document import format_toml
from kinematics.machine.machine_writer import machine_toml
from planner.program.program_writer import program_toml
from pulsepath.inputs import Inputs
from pulsepath.options import MACHINE_FILE, PROGRAM_FILE
from pulsepath.output import record
from pulsepath.output.directory import write_files
from pulsepath.progress import say

STDOUT = Path("-")


def dump(
    folder: Path,
    inputs: Inputs,
    options: Mapping[str, int | str],
    force: bool,
    as_json: bool,
) -> None:
    """Write machine and program with all defaults, and print the options as TOML and the command.

    folder   - : print machine and program too, and write no file
    options  by their names on the command line, without dashes; True: one without a value

    A machine that names other files, as an arm does, keeps the text of its file.
    """
    command = str(click.get_current_context().command.name)
    purpose = f'"pulsepath {command}" uses it'
    if inputs.companions:
        machine = inputs.machine_toml
    else:
        machine = machine_toml(
            inputs.machine,
            f"The machine {inputs.machine.name}, as {purpose}.",
            complete=True,
        ).encode()
    program_here = replace(inputs.program, machine=MACHINE_FILE)
    program = program_toml(
        program_here,
        f"The program {inputs.program.name}, as {purpose}.",
        complete=True,
    ).encode()
    files = {MACHINE_FILE: machine, PROGRAM_FILE: program, **inputs.companions}
    if folder == STDOUT:
        _print(files, options, as_json)
        return
    write_files(folder, files, force)
    flags = []
    for name, value in options.items():
        flags += [f"--{name}"] if value is True else [f"--{name}", str(value)]
    out = ["--out", str(folder / "plan")] if command == "plan" else []
    again = join(["pulsepath", command, str(folder / PROGRAM_FILE), *flags, *out])
    if as_json:
        paths = {"machine": str(folder / MACHINE_FILE), "program": str(folder / PROGRAM_FILE)}
        click.echo(record.as_json({"options": dict(options), **paths, "command": again}), nl=False)
    else:
        say(_text(options))
        say(f"# {folder / MACHINE_FILE} and {folder / PROGRAM_FILE}; run them with\n# {again}")


def _print(files: Mapping[str, bytes], options: Mapping[str, int | str], as_json: bool) -> None:
    """Files one after the other, each under a line of its name, and the options."""
    texts = {name: content.decode() for name, content in files.items()}
    if as_json:
        click.echo(record.as_json({"options": dict(options), "files": texts}), nl=False)
        return
    for name, text in texts.items():
        say(f"# ----- {name}\n{text}")
    say(f"# ----- options\n{_text(options)}")


def _text(options: Mapping[str, int | str]) -> str:
    return "\n".join(
        ["[options]", *(f"{name} = {format_toml(value)}" for name, value in options.items())],
    )
