"""Arguments and options that several commands share, and readers of the quantities in options."""

import re
from collections.abc import Iterable
from math import inf
from pathlib import Path
from typing import Any

import click

from pulsepath import known_names, registries
from pulsepath.known_names import make_completer

# Tracking laws by default: open and closed loop.
LAWS = ("3", "6")
# Word for a name in messages, and the table of `registries` that has the names.
WORDS = {
    "laws": ("law", "laws"),
    "rule": ("firing rule", "rules"),
    "format": ("format", "exports"),
}
# Files that a command writes for the user to start from.
MACHINE_FILE, PROGRAM_FILE = "machine.toml", "program.toml"
# Size (bytes) of a file that is read twice without a noticeable delay.
FIRST_LOOK = 1 << 16
PERCENT = re.compile(r"\s*(\d*\.?\d+(?:[eE][+-]?\d+)?)\s*%\s*")
NUMBER = r"(\d+(?:\.\d*)?(?:[eE]\+?\d{1,2})?)"
FREQUENCY = re.compile(rf"\s*{NUMBER}\s*(|Hz|kHz|MHz|GHz)\s*", re.ASCII)
MULTIPLES = {"": 1, "Hz": 1, "kHz": 10**3, "MHz": 10**6, "GHz": 10**9}
MAX_PORT = 65535
# Settings of a command whose arguments may begin with a minus, as the pose "-5,5,35".
ALLOW_MINUS = {"ignore_unknown_options": True}
program_argument = click.argument(
    "program",
    shell_complete=make_completer(known_names.programs, files=True),
)
plan_argument = click.argument("directory", metavar="DIR", type=click.Path(path_type=Path))
machine_argument = click.argument(
    "machine",
    shell_complete=make_completer(known_names.machines, files=True),
)
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


def refuse_unknown(
    program: str | None = None,
    machine: str | None = None,
    rig: str | None = None,
    **words: str | Iterable[str] | None,
) -> None:
    """Raise MotionError for an unknown name before slow modules load.

    Files must exist and be TOML. Their keys are checked later.

    words: `laws` and `rule`, with or without options, and `format` of exports
    """
    from kinematics.foundation.names import find

    for package, kind, name in (
        ("planner", "program", program),
        ("kinematics", "machine", machine),
        ("controllers", "rig", rig),
    ):
        if name is not None and find(package, kind, name) == Path(name):  # no preset
            _refuse_unreadable(Path(name))
    for key, texts in words.items():
        for text in (texts,) if isinstance(texts, str) else texts or ():
            _refuse_unknown_word(*WORDS[key], text.partition(":")[0].strip())


def _refuse_unknown_word(what: str, table: str, name: str) -> None:
    """Raise BadValue unless a table of `registries` has a name."""
    from kinematics.foundation.errors import BadValue
    from kinematics.foundation.names import unknown_name

    known = known_names.list_names(table)
    if name in known:
        return
    other = registries.CONTROLLERS.get(name.lower()) if table == "exports" else None
    if other is None:
        raise unknown_name(what, name, known)
    raise BadValue(f'no format is called "{name}"; for that, give --format {other}', nearest=other)


def _refuse_unreadable(file: Path) -> None:
    """Raise FileError for a missing file, and for a short one that is not TOML.

    Long files are read once, later.
    """
    from kinematics.files.toml_document import read

    is_toml = file.suffix == ".toml" and file.is_file()
    if not file.exists() or (is_toml and file.stat().st_size <= FIRST_LOOK):
        read(file)


def refuse_missing(file: Path) -> None:
    """Raise FileError for a file that is not there, with the nearest that is."""
    from kinematics.files.toml_document import read

    if not file.exists():
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
    """Return the share that an option gives in per cent. Raises BadValue, which names the option.

    from_zero: 0 is allowed
    """
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
        raise BadValue(
            f'option --speed: "{text}": write up to "100 %", which is the plan\'s own speed',
        )
    return share
