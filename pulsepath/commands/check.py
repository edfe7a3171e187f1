"""`pulsepath check`: limits that slowing down cannot fix: reach, travel, tilt, clearance."""

from pathlib import Path
from typing import Any

import click

from pulsepath.command_group import ProgramCommand
from pulsepath.options import (
    dump_option,
    json_option,
    machine_option,
    program_argument,
    refuse_unknown,
)
from pulsepath.process.exits import INFEASIBLE
from pulsepath.progress import VERBOSE, level, say
from pulsepath.request_options import read_request, request_options
from pulsepath.requests import InputRequest


@click.command(cls=ProgramCommand)
@program_argument
@machine_option
@request_options(InputRequest)
@dump_option
@click.option("--force", is_flag=True, help="Overwrite the files of --dump-config.")
@json_option
def check(dumped: Path | None, force: bool, as_json: bool, **options: Any) -> None:
    """Check limits that slowing down cannot fix, or a plan.

    These are reach, travel, tilt and clearance. Lists every violation along the path of PROGRAM or, if there is none,
    how close the path comes to each limit. If PROGRAM is the directory of a plan, verifies the digests of its files,
    proves its motion again and checks its file of pulses against it.

    Example: pulsepath check circle --machine hexapod
    """
    source = read_request(InputRequest, options)
    if Path(source.program).is_dir():
        if source.machine is not None or dumped is not None or source.fit is not None:
            raise click.UsageError("A plan has its own machine and program.", click.get_current_context())
        _check_plan(Path(source.program), as_json)
        return
    refuse_unknown(source.program, source.machine)
    inputs = source.read()
    # Faults of files are reported before these load.
    import planner
    from pulsepath.output import record, tables
    from pulsepath.output.dump import dump

    if dumped is not None:
        dump(dumped, inputs, "check", {}, force, as_json)
        return
    with inputs.tell_lines():
        found = planner.check(inputs.program, inputs.machine)
    inputs.tell_line(*found.violations)
    if as_json:
        click.echo(record.as_json(record.of_check(found)), nl=False)
    elif found.violations:
        say("\n".join(map(str, found.violations)))
    else:
        tables.show(tables.of_results(found) if level() == VERBOSE else tables.sum_up_check(found))
    if found.violations:
        click.get_current_context().exit(INFEASIBLE)


def _check_plan(folder: Path, as_json: bool) -> None:
    from kinematics.foundation.names import count_noun
    from pulsepath.output.directory import refuse_no_plan

    refuse_no_plan(folder)
    from pulsepath.output import record
    from pulsepath.progress import step
    from pulsepath.store.read import read
    from pulsepath.store.verify import check_pulses, refuse

    plan = read(folder)
    duration = plan.duration
    file: str | None = None
    pulses: int | None = None
    if (path := plan.source.pulse_file) is not None:
        with step("checking the pulses") as tell:
            verdict = check_pulses(path, plan.machine, plan.source, tell)
        refuse([f"{path}: {fault}" for fault in verdict.faults[:1]])
        file = path.name
        pulses = sum(axis.pulses for axis in verdict.axes)
    if as_json:
        result = {"holds": True, "duration_s": duration, "pulse_file": file, "pulses": pulses}
        click.echo(record.as_json(result), nl=False)
        return
    say(f"{folder}: its files are unchanged, and its motion of {duration:.6f} s is proved again")
    say(
        "it has no file of pulses: only the motion was checked"
        if file is None
        else f"{file}: {count_noun(pulses or 0, 'pulse')}, checked against the motion"
    )
