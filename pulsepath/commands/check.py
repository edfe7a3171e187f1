"""`pulsepath check`: limits that slowing down cannot fix: reach, travel, tilt, clearance."""

from pathlib import Path

import click

from pulsepath.options import apply_motion, dump_option, json_option, machine_option, motion_option, program_argument
from pulsepath.process.exits import INFEASIBLE
from pulsepath.progress import say


@click.command()
@program_argument
@machine_option
@motion_option
@dump_option
@click.option("--force", is_flag=True, help="Overwrite the files of --dump-config.")
@json_option
def check(program: str, machine: str | None, motion: str, dumped: Path | None, force: bool, as_json: bool) -> None:
    """Check limits that slowing down cannot fix.

    These are reach, travel, tilt and clearance. Lists every violation along the path of PROGRAM or, if there is none,
    how close the path comes to each limit.

    Example: pulsepath check circle --machine hexapod
    """
    import planner
    from pulsepath.inputs import read_inputs
    from pulsepath.output import record, tables
    from pulsepath.output.dump import dump

    inputs = apply_motion(motion, read_inputs(program, machine))
    if dumped is not None:
        dump(dumped, inputs, "check", {}, force, as_json)
        return
    found = planner.check(inputs.program, inputs.machine)
    if as_json:
        click.echo(record.as_json(record.of_check(found)), nl=False)
    elif found.violations:
        say("\n".join(map(str, found.violations)))
    else:
        tables.show(tables.of_results(found))
    if found.violations:
        click.get_current_context().exit(INFEASIBLE)
