"""`pulsepath check`: what no timing can help along a program's path."""

import click

from pulsepath.exits import INFEASIBLE
from pulsepath.options import json_option, machine_option, program_argument


@click.command()
@program_argument
@machine_option
@json_option
def check(program: str, machine: str | None, as_json: bool) -> None:
    """Check what no timing can help: reach, travel and tilt.

    Lists every violation along the path of PROGRAM, or else how near it comes to each limit.
    """
    from planner import check as look
    from pulsepath import record, tables
    from pulsepath.inputs import read_inputs

    inputs = read_inputs(program, machine)
    found = look(inputs.program, inputs.machine)
    if as_json:
        click.echo(record.as_json(record.of_check(found.violations, found.largest, found.blends)), nl=False)
    elif found.violations:
        click.echo("\n".join(map(str, found.violations)))
    else:
        tables.show(tables.of_check(found))
    if found.violations:
        click.get_current_context().exit(INFEASIBLE)
