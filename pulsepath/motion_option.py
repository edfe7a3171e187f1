"""The option --motion: run a program as it says, or from pose to pose by synchronised moves."""

from dataclasses import replace
from typing import TYPE_CHECKING

import click

from pulsepath.talk import note

if TYPE_CHECKING:
    from pulsepath.inputs import Inputs

PROGRAMMED, SYNCHRONISED = "programmed", "synchronised"

motion_option = click.option(
    "--motion",
    type=click.Choice([PROGRAMMED, SYNCHRONISED]),
    default=PROGRAMMED,
    show_default=True,
    help="synchronised: from pose to pose with a stop at each, every axis straight to its place, all together; "
    "how far that leaves a straight line is told.",
)


def run_as(motion: str, inputs: "Inputs") -> "Inputs":
    """The inputs, their program one of synchronised moves where that is asked for: what is left out is told."""
    if motion == PROGRAMMED:
        return inputs
    from planner import synchronise
    from planner.program_writer import program_toml

    program, left_out = synchronise(inputs.program, inputs.machine)
    if left_out:
        for number in left_out:
            note(f"note: segment {number} ends where it starts: left out, since a synchronised move would do nothing")
    about = f"The program {program.name} as synchronised moves, by --motion {SYNCHRONISED}."
    return replace(inputs, program=program, program_toml=program_toml(program, about).encode())
