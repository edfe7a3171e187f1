"""`pulsepath check`: limits that slowing down cannot fix: reach, travel, tilt, clearance."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from pulsepath.command_group import ProgramCommand
from pulsepath.options import (
    apply_motion,
    dump_option,
    fit_option,
    json_option,
    machine_option,
    motion_option,
    program_argument,
    read_quantity,
    refuse_unknown,
)
from pulsepath.process.exits import INFEASIBLE
from pulsepath.progress import VERBOSE, level, say


@click.command(cls=ProgramCommand)
@program_argument
@machine_option
@fit_option
@motion_option
@dump_option
@click.option("--force", is_flag=True, help="Overwrite the files of --dump-config.")
@json_option
def check(
    program: str,
    machine: str | None,
    fit: str | None,
    motion: str,
    dumped: Path | None,
    force: bool,
    as_json: bool,
    given: Mapping[str, Any],
) -> None:
    """Check limits that slowing down cannot fix, or a plan.

    These are reach, travel, tilt and clearance. Lists every violation along the path of PROGRAM or, if there is none,
    how close the path comes to each limit. If PROGRAM is the directory of a plan, verifies the digests of its files,
    proves its motion again and checks its file of pulses against it.

    Example: pulsepath check circle --machine hexapod
    """
    if Path(program).is_dir():
        if machine is not None or dumped is not None or fit is not None:
            raise click.UsageError("A plan has its own machine and program.", click.get_current_context())
        _check_plan(Path(program), as_json)
        return
    refuse_unknown(program, machine)
    from pulsepath.inputs import read_inputs

    tolerance = None if fit is None else read_quantity("--fit", fit, "m", above=0.0, like="0.02 mm")
    origin = None
    if given:  # only then are the formats worth their loading
        from pulsepath.format_options import find_origin

        origin = find_origin(program, given, tolerance)
    inputs = apply_motion(motion, read_inputs(program, machine, tolerance, origin))
    # after what files say wrong, which is told sooner so
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
    from pulsepath.output import plan_directory, record
    from pulsepath.output.stored_plan import check_pulses
    from pulsepath.progress import step

    taken = plan_directory.read(folder)
    duration, file, pulses = taken.duration, None, None
    if taken.pulse_file is not None:
        with step("checking the pulses") as tell:
            found = check_pulses(taken.pulse_file, taken, tell)
        file, pulses = taken.pulse_file.name, sum(axis.pulses for axis in found.axes)
    if as_json:
        told = {"holds": True, "duration_s": duration, "pulse_file": file, "pulses": pulses}
        click.echo(record.as_json(told), nl=False)
        return
    say(f"{folder}: its files are unchanged, and its motion of {duration:.6f} s is proved again")
    say(
        "it has no file of pulses: only the motion was checked"
        if file is None
        else f"{file}: {count_noun(pulses or 0, 'pulse')}, checked against the motion"
    )
