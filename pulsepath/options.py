"""Arguments and options that several commands share, and readers of the quantities in options."""

import re
from collections.abc import Iterable
from math import inf
from pathlib import Path
from typing import Any

import click

from pulsepath import known_names, registries
from pulsepath.known_names import make_completer

LAWS = ("3", "6")
"""Tracking laws by default: open and closed loop."""
MACHINE_FILE, PROGRAM_FILE = "machine.toml", "program.toml"
"""Files that a command writes for the user to start from."""
FIRST_LOOK = 1 << 16
"""Size (bytes) of a file that is read twice without a noticeable delay."""
PERCENT = re.compile(r"\s*(\d*\.?\d+(?:[eE][+-]?\d+)?)\s*%\s*")
FREQUENCY = re.compile(r"\s*(\d+(?:\.\d*)?(?:[eE]\+?\d{1,2})?)\s*(|Hz|kHz|MHz|GHz)\s*", re.ASCII)
MULTIPLES = {"": 1, "Hz": 1, "kHz": 10**3, "MHz": 10**6, "GHz": 10**9}
MAX_PORT = 65535
ALLOW_MINUS = {"ignore_unknown_options": True}
"""Settings of a command whose arguments may begin with a minus, as the poses "-5,5,35" and "-10 mm, 0 mm, 25 mm" do."""
program_argument = click.argument("program", shell_complete=make_completer(known_names.programs, files=True))
dump_option = click.option(
    "--dump-config",
    "dumped",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Only write machine and program with all defaults to DIR (-: print them) and print the options.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
unverified_option = click.option(
    "--unverified",
    is_flag=True,
    help="Continue with a plan that was changed or is not proved; the output says so.",
)
machine_option = click.option(
    "--machine",
    metavar="MACHINE",
    help="Preset or file. Default: the machine that the program names.",
    shell_complete=make_completer(known_names.machines, files=True),
)


def refuse_unknown(
    program: str | None = None,
    machine: str | None = None,
    rig: str | None = None,
    laws: Iterable[str] = (),
    rule: str | None = None,
    format: str | None = None,
) -> None:
    """Raise MotionError for an unknown name, before the modules load that would report it seconds later.

    Files must exist and be TOML. Their keys are checked later.

    laws: with or without gains; rule: with or without options; format: of exports
    """
    from kinematics.foundation.errors import BadValue
    from kinematics.foundation.names import find, unknown_name

    for package, what, name in (
        ("planner", "program", program),
        ("kinematics", "machine", machine),
        ("controllers", "rig", rig),
    ):
        if name is not None and find(package, what, name) == Path(name):  # no preset
            _refuse_unreadable(Path(name))
    written = [("law", law, "laws") for law in laws]
    written += [] if rule is None else [("firing rule", rule, "rules")]
    written += [] if format is None else [("format", format, "exports")]
    for what, text, table in written:
        name = text.partition(":")[0].strip()
        known = known_names.list_names(table)
        if name in known:
            continue
        taken = registries.CONTROLLERS.get(name.lower()) if table == "exports" else None
        if taken is not None:
            raise BadValue(f'no format is called "{name}"; for that, give --format {taken}', nearest=taken)
        raise unknown_name(what, name, known)


def refuse_missing(file: Path) -> None:
    """Raise FileError for a file that is not there, with the nearest that is."""
    from kinematics.files.toml_document import read

    if not file.exists():
        read(file)


def _refuse_unreadable(file: Path) -> None:
    """Raise FileError for a missing file, and for a short one that is not TOML. Long files are read once, later."""
    from kinematics.files.toml_document import read

    is_short = file.suffix == ".toml" and file.is_file() and file.stat().st_size <= FIRST_LOOK
    if is_short or not file.exists():
        read(file)


def read_quantity(flag: str, text: str, unit: str, like: str | None = None, **bounds: Any) -> float:
    """Return the SI value of a quantity. Raises BadValue, which names the option.

    like    a usual value, for messages
    bounds  `above` and `least`, SI
    """
    from kinematics.foundation.errors import locate_errors
    from kinematics.foundation.units import Unit

    with locate_errors(f"option {flag}"):
        return Unit(unit, like=like, **bounds).read(text, {})


class Frequency(click.ParamType[int]):
    """A whole number of Hz, plain or with a unit, as 16000000 or "16 MHz"."""

    name = "frequency"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return a frequency in Hz. A wrong text fails the parameter."""
        from fractions import Fraction

        matches = FREQUENCY.fullmatch(str(value))
        ticks = Fraction(matches[1]) * MULTIPLES[matches[2]] if matches else Fraction(0)
        if ticks < 1 or ticks.denominator != 1:
            self.fail(
                f'"{value}": write a whole number of Hz from 1 on, as 16000000 or "16 MHz"',
                param,
                ctx,
            )
        return int(ticks)


def read_percent(flag: str, text: str, from_zero: bool = False) -> float:
    """The share that an option gives in per cent, above 0, or from 0 on. Raises BadValue, which names the option."""
    from kinematics.foundation.errors import BadValue

    matches = PERCENT.fullmatch(text)
    share = float(matches[1]) / 100 if matches else -1.0
    if not (0 < share < inf or (from_zero and share == 0)):
        kind = "share" if from_zero else "positive share"
        raise BadValue(f'option {flag}: "{text}": write a {kind} in per cent, as "0.1 %"')
    return share


def read_speed_share(text: str) -> float:
    """Return the share of --speed, at most that of the plan. Raises BadValue."""
    from kinematics.foundation.errors import BadValue

    share = read_percent("--speed", text)
    if share > 1:
        raise BadValue(f'option --speed: "{text}": write up to "100 %", which is the plan\'s own speed')
    return share
