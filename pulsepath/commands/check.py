"""`pulsepath check`: limits that slowing down cannot fix: reach, travel, tilt, clearance."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pulsepath.command_group import ProgramCommand
from pulsepath.commands.common import print_json
from pulsepath.options import (
    dump_option,
    json_option,
    program_argument,
    refuse_unknown,
)
from pulsepath.process.exits import INFEASIBLE
from pulsepath.progress import VERBOSE, level, say
from pulsepath.request_options import with_request
from pulsepath.requests import InputRequest

if TYPE_CHECKING:
    from kinematics.foundation.errors import MotionError


@click.command(cls=ProgramCommand)
@program_argument
@with_request(InputRequest)
@dump_option
@click.option("--force", is_flag=True, help="Overwrite the files of --dump-config.")
@json_option
def check(source: InputRequest, dumped: Path | None, force: bool, as_json: bool) -> None:
    """Check limits that slowing down cannot fix, or a plan.

    These are reach, travel, tilt and clearance. Shows the worst violation of each limit along the
    path of PROGRAM (-v lists all) or, without any, how close the path comes to each limit. If
    PROGRAM is the directory of a plan, verifies the digests of its files, proves its motion again
    and checks its file of pulses against it.

    Example: pulsepath check circle --machine hexapod
    """
    folder = Path(source.program)
    if folder.is_dir():
        if source.machine is not None or dumped is not None or source.fit is not None:
            message = "A plan has its own machine and program."
            raise click.UsageError(message, click.get_current_context())
        _check_plan(folder, as_json)
        return
    refuse_unknown(source.program, source.machine)
    inputs = source.read()
    # Faults of files are reported before these load.
    import planner
    from pulsepath.output import record, tables
    from pulsepath.output.dump import dump

    if dumped is not None:
        dump(dumped, inputs, {}, force, as_json)
        return
    with inputs.tell_lines():
        result = planner.check(inputs.program, inputs.machine)
    violations = result.violations
    lines: Sequence[MotionError | str] = violations
    if level() < VERBOSE and not as_json:
        lines = tables.sum_up_violations(violations)
    inputs.tell_line(*(line for line in lines if not isinstance(line, str)))
    if as_json:
        print_json(record.record_check(result))
    elif violations:
        say("\n".join(map(str, lines)))
    elif level() == VERBOSE:
        tables.show(tables.list_tables(result))
    else:
        tables.show(tables.sum_up_check(result))
    if violations:
        click.get_current_context().exit(INFEASIBLE)


def _check_plan(folder: Path, as_json: bool) -> None:
    """Verify a plan's files, prove its motion again, and check its file of pulses."""
    from kinematics.foundation.names import count_noun
    from pulsepath.output.directory import refuse_no_plan

    refuse_no_plan(folder)
    from pulsepath.progress import step
    from pulsepath.store.read import read
    from pulsepath.store.verify import check_pulses, refuse

    plan = read(folder)
    duration = plan.duration
    path = plan.source.pulse_file
    pulses = 0
    if path is not None:
        with step("checking the pulses") as progress:
            verdict = check_pulses(path, plan.machine, plan.source, progress)
        refuse([f"{path}: {fault}" for fault in verdict.faults[:1]])
        pulses = sum(axis.pulses for axis in verdict.axes)
    if as_json:
        result: dict[str, Any] = {
            "holds": True,
            "duration_s": duration,
            "pulse_file": None,
            "pulses": None,
        }
        if path is not None:
            result |= {"pulse_file": path.name, "pulses": pulses}
        print_json(result)
        return
    say(f"{folder}: its files are unchanged, and its motion of {duration:.6f} s is proved again")
    if path is None:
        say("it has no file of pulses: only the motion was checked")
    else:
        say(f"{path.name}: {count_noun(pulses, 'pulse')}, checked against the motion")
