"""`pulsepath init`: a commented machine and a commented program to start from."""

import shlex
import tomllib
from pathlib import Path

import click

from pulsepath import known_names
from pulsepath.known_names import make_completer
from pulsepath.options import MACHINE_FILE, PROGRAM_FILE, json_option, refuse_unknown
from pulsepath.process.intent import writes
from pulsepath.progress import say


@click.command()
@click.argument(
    "directory",
    metavar="[DIR]",
    default=".",
    type=click.Path(file_okay=False, path_type=Path),
)
@click.option(
    "--machine",
    metavar="MACHINE",
    help="Bundled machine or machine kind to start from, as equations. Default: the program's machine, else hexapod.",
    shell_complete=make_completer(known_names.machines, known_names.kinds),
)
@click.option(
    "--program",
    metavar="PROGRAM",
    help="Bundled program to start from. Default: a line, a circle and a line back.",
    shell_complete=make_completer(known_names.programs),
)
@click.option(
    "--all",
    "every_key",
    is_flag=True,
    help="Write every key: those that are not set as comments.",
)
@click.option("--force", is_flag=True, help="Replace files that exist.")
@json_option
def init(
    directory: Path,
    every_key: bool,
    force: bool,
    as_json: bool,
    **source: str | None,
) -> None:
    """Write a machine and a program to start from.

    DIR defaults to the current directory. The files machine.toml and program.toml hold the keys
    that matter for a first plan, with a line of comment each, and can be planned at once. Machine
    and program are named after the directory.

    Example: pulsepath init mine --machine tripod
    """
    machine, program = source["machine"], source["program"]
    if machine is not None:
        machine = _find_machine(machine)
    refuse_unknown(program, machine)
    from kinematics import load_machine
    from kinematics.files.schema import is_name
    from kinematics.machine.first_machine import short_machine_starter
    from kinematics.machine.machine_writer import companions, machine_starter
    from planner.program.program_writer import machine_of, program_starter
    from pulsepath.output import record
    from pulsepath.output.directory import write_files

    machine = machine or (None if program is None else machine_of(program)) or "hexapod"
    kind = type(load_machine(machine)).__name__.lower()
    stem = directory.resolve().name
    name = stem if is_name(stem) else None
    machine_text = (machine_starter if every_key else short_machine_starter)(machine, name)
    program_text = program_starter(MACHINE_FILE, kind, program, name=name, short=not every_key)
    files = {
        MACHINE_FILE: machine_text.encode(),
        PROGRAM_FILE: program_text.encode(),
        **companions(machine),
    }
    targets = [directory / name for name in files]
    writes(*targets)
    write_files(directory, files, force)
    path, out = (_write_argument(directory / name) for name in (PROGRAM_FILE, "plan"))
    following = [f"pulsepath check {path}", f"pulsepath plan {path} --out {out}"]
    if as_json:
        click.echo(
            record.as_json({"files": [str(target) for target in targets], "next": following}),
            nl=False,
        )
        return
    for target in targets:
        say(f"written: {target}")
    say("next:")
    for command in following:
        say(f"  {command}")


def _write_argument(path: Path) -> str:
    """Return a path as a shell takes it, and no command for an option."""
    text = str(path)
    return shlex.quote(f"./{text}" if text.startswith("-") else text)


def _find_machine(name: str) -> str:
    """Return the name of a machine; for a kind, the name of its first machine."""
    from kinematics.foundation.names import presets

    known = presets("kinematics")
    if name in known or name not in known_names.kinds():
        return name
    kinds = {each: tomllib.loads(file.read_text("utf-8"))["kind"] for each, file in known.items()}
    return next(each for each, kind in kinds.items() if kind == name)
