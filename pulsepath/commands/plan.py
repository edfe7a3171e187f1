"""`pulsepath plan`: write the time-optimal motion, its certificate, its pulses and a report to a directory."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pulsepath import known_names
from pulsepath.command_group import ProgramCommand
from pulsepath.known_names import make_completer
from pulsepath.options import (
    MOST_BOUNDED,
    MOST_WHOLE,
    Frequency,
    apply_motion,
    dump_option,
    fit_option,
    json_option,
    machine_option,
    motion_option,
    program_argument,
    read_percent,
    read_quantity,
    refuse_unknown,
)
from pulsepath.process.intent import writes

if TYPE_CHECKING:
    from pulsepath.inputs import Inputs


WORK_MODULES = ("pulsepath.job",)
FIGURE_MODULES = ("benchmarks.reports.plan_report", "controllers.figures", "planner.figures")
"""What the second process loads."""
MOST_EFFORT = 6
"""Rounds of --gap: each has twice as many intervals as the one before."""
LONG_FILE = 1 << 16
"""Bytes of a program that has more segments than that."""
SHORT_FILE = 1 << 12
"""Bytes of a program up to which it is short."""


@click.command(cls=ProgramCommand)
@program_argument
@machine_option
@fit_option
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Output directory.")
@click.option(
    "--order",
    type=click.Choice(["2", "3"]),
    help="2: limit speed and acceleration; 3: jerk too. Default: 3 if the machine limits jerk.",
)
@click.option(
    "--clock-hz",
    type=Frequency(),
    default=10_000_000,
    show_default=True,
    metavar="FREQUENCY",
    help='Clock frequency of the pulse times, in ticks/s, or as "16 MHz".',
)
@click.option(
    "--duration", metavar="TIME", help='Plan the smoothest motion of this duration, as "12 s", not the fastest motion.'
)
@click.option(
    "--objective",
    metavar="SUM",
    help='What to minimize: "time" (default), or a sum with the heat of the motors, both in units of the fastest '
    'motion\'s, as "time + 0.2 heat".',
)
@click.option(
    "--gap",
    metavar="PERCENT",
    help='Refine motion and lower bound until the motion is proved this close to the fastest, as "0.1 %".',
)
@click.option(
    "--effort",
    type=click.IntRange(0, MOST_EFFORT),
    metavar="ROUNDS",
    help="Refinement rounds for --gap at most; each takes several times as long as the previous. Default: 3.",
)
@click.option(
    "--rule",
    default="nearest",
    shell_complete=make_completer(known_names.rules),
    show_default=True,
    metavar="RULE",
    help='Firing rule, with options as sampled:period=50us; "pulsepath rules" lists them.',
)
@click.option(
    "--figures/--no-figures",
    default=True,
    show_default=True,
    help="Draw figures in the report. Without them it keeps all text and tables and is faster.",
)
@click.option(
    "--baselines/--no-baselines",
    default=None,
    help="Compare with every baseline timing, as a trapezoid from stop to stop, or with none, so that no time saved is "
    "printed. Default: compare with the one within the same limits.",
)
@click.option(
    "--bound",
    type=click.Choice(["auto", "full", "none"]),
    help="Effort on the lower bound, which proves how near the motion is to the fastest. auto: no longer than "
    "planning; full: until it is near; none: no bound. Default: auto; with --worth, full.",
)
@click.option(
    "--worth/--no-worth",
    default=None,
    help="Also find what each limit is worth, and plan with more of the best. Default: by the quick lower bound, up to "
    f"{MOST_BOUNDED} time pieces, without planning again. --no-worth: no lower bound either, unless --bound asks.",
)
@click.option(
    "--pulses",
    type=click.Choice(["csv", "binary", "none"]),
    default="binary",
    show_default=True,
    help="Format of the pulse file: pulses.csv, one row per edge; pulses.bin, compressed; or no file.",
)
@click.option(
    "--stops",
    type=click.IntRange(min=1),
    metavar="COUNT",
    help="Also prove the earliest stop along the path from COUNT instants: stops.csv, and a figure in the report.",
)
@motion_option
@click.option(
    "--rig",
    metavar="RIG",
    help='Also track the plan on this rig, preset or file; "pulsepath rigs" lists them. Default: no tracking.',
    shell_complete=make_completer(known_names.rigs, files=True),
)
@click.option(
    "--cross-check",
    "crossed",
    is_flag=True,
    help="Also solve order 2 with toppra, and report its motion and certificate.",
)
@click.option(
    "--stream/--whole",
    default=None,
    help="Plan part by part while PROGRAM is read, in constant memory, or as a whole, with a more detailed report. "
    f"Default: --stream above {MOST_WHOLE} segments.",
)
@click.option(
    "--keep-certified",
    "keep",
    is_flag=True,
    help="With --stream: if a segment cannot be planned, keep the certified motion before it, which ends at rest. "
    "Default: all or nothing.",
)
@click.option(
    "--cluster",
    metavar="ADDRESS",
    help="With --stream: plan the parts between stops on the workers of this Dask scheduler (its address or its "
    "--scheduler-file); the result is identical, byte for byte.",
)
@dump_option
@click.option("--force", is_flag=True, help="Replace DIR if it holds an earlier plan.")
@json_option
def plan(
    program: str,
    machine: str | None,
    fit: str | None,
    out: Path | None,
    order: str | None,
    clock_hz: int,
    duration: str | None,
    objective: str | None,
    gap: str | None,
    effort: int | None,
    rule: str,
    figures: bool,
    baselines: bool | None,
    bound: str | None,
    worth: bool | None,
    pulses: str,
    stops: int | None,
    motion: str,
    rig: str | None,
    crossed: bool,
    stream: bool | None,
    keep: bool,
    cluster: str | None,
    dumped: Path | None,
    force: bool,
    as_json: bool,
    given: Mapping[str, Any],
) -> None:
    """Plan PROGRAM; write motion, pulses and report to DIR.

    The motion is the fastest that the machine's limits allow, and is proved to respect every limit. PROGRAM is a
    preset, a TOML file, or a file that pulsepath import reads.

    Example: pulsepath plan circle --out out/circle
    """
    refuse_unknown(program, machine, rig, rule=rule)
    if dumped is not None:
        inputs = _read(program, machine, fit, given, motion)
        flags = {"cross-check": crossed, "stream": stream is True, "whole": stream is False, "keep-certified": keep}
        flags |= {"baselines": baselines is True, "no-baselines": baselines is False}
        flags |= {"worth": worth is True, "no-worth": worth is False}
        chosen = {"rig": rig, "cluster": cluster, "bound": bound}
        chosen |= {"gap": gap, "effort": None if effort is None else str(effort)}
        chosen |= {"stops": None if stops is None else str(stops)}
        _dump(dumped, inputs, order, clock_hz, duration, objective, rule, pulses, chosen, flags, force, as_json)
        return
    if out is None:
        raise click.UsageError("Missing option '--out'.", click.get_current_context())
    writes(out)
    from kinematics.foundation.names import find
    from pulsepath.output.directory import list_replaceable, replace_directory

    before = list_replaceable(out, force)
    seconds = None if duration is None else read_quantity("--duration", duration, "s", above=0.0)
    if effort is not None and gap is None:
        raise click.UsageError("--effort is of --gap.", click.get_current_context())
    within = None if gap is None else read_percent("--gap", gap)
    if bound == "none" and (gap is not None or worth):
        option = "--worth" if gap is None else "--gap"
        raise click.UsageError(f"{option} needs a lower bound: omit --bound none.", click.get_current_context())
    effort_of_bound = bound or ("full" if worth else "none" if worth is False else "auto")
    parts = {"--keep-certified": keep, "--cluster": cluster is not None}
    if stream is False:
        _refuse_without_parts(parts)
    if ":" in rule:  # the name is known to be right
        from planner.pulses import find_rule

        find_rule(rule)
    if objective is not None:
        from planner.tradeoffs.objective import read_objective

        read_objective(objective)
    if rig is not None and rig not in known_names.rigs():  # a bundled one has no faults
        from controllers.rig_file import validate_rig_file

        validate_rig_file(find("controllers", "rig", rig))

    from planner.parallel import NO_PROCESS, side_process

    other = NO_PROCESS
    with ExitStack() as stack:

        def start_other() -> None:
            nonlocal other
            helps = figures or rig is not None or (baselines is not False and not _is_short(program))
            if helps and not _is_long(program, stream):
                modules = [*WORK_MODULES, *(FIGURE_MODULES if figures else ())]
                other = stack.enter_context(side_process(modules))

        # what files say wrong is told before the rest loads, which both processes then do at once
        inputs = _read(program, machine, fit, given, motion, start_other)
        from planner.timing.certified_solve import EFFORT
        from planner.timing.solvers.toppra_ import require
        from planner.tradeoffs.objective import read_objective
        from pulsepath.inputs import read_rig
        from pulsepath.job import run
        from pulsepath.output import plan_directory, tables
        from pulsepath.output.parts_directory import PartsRequest
        from pulsepath.parts_job import choose_parts, open_helpers, run_parts

        heated = objective is not None and read_objective(objective).heat > 0
        kind = None if order is None else int(order)
        if crossed:  # said before the work
            require("--cross-check")
        behind = read_rig(rig, inputs.machine)
        whole = {
            "--duration": seconds is not None,
            "--objective": heated,
            "--gap": gap is not None,
            "--rig": rig is not None,
            "--stops": stops is not None,
            "--cross-check": crossed,
            "--worth": worth is True,
            "--bound full": bound == "full",
        }
        whole["--pulses csv"] = pulses == "csv"
        if choose_parts(stream, inputs, rule, [option for option, asked in whole.items() if asked]):
            request = PartsRequest(kind, clock_hz, rule, pulses=pulses != "none", figures=figures, keep=keep)
            with open_helpers(cluster) as helpers, replace_directory(out, force, before=before) as folder:
                standing, refusal = run_parts(inputs, request, folder, helpers)
            tables.show_plan(out, as_json, standing.tables, lambda: tables.sum_up_parts(standing))
            if refusal is not None:
                raise refusal
            return
        _refuse_without_parts(parts)
        # Where nothing can be written, that is said before the work.
        with replace_directory(out, force, before=before) as folder:
            with inputs.tell_lines():
                job = run(
                    inputs.program,
                    inputs.machine,
                    kind,
                    clock_hz,
                    seconds,
                    rule,
                    other,
                    figures,
                    behind,
                    crossed,
                    objective or "time",
                    within,
                    EFFORT if effort is None else effort,
                    stops,
                    baselines,
                    worth,
                    effort_of_bound,
                )
            plan_directory.write(folder, job, inputs, pulses)
    tables.show_plan(out, as_json, lambda: tables.of_plan(job), lambda: tables.sum_up(job))


def _refuse_without_parts(asked: Mapping[str, bool]) -> None:
    for option in (option for option, given in asked.items() if given):
        raise click.UsageError(f"{option} is for --stream.", click.get_current_context())


def _is_long(program: str, stream: bool | None) -> bool:
    """Whether it is all but certain that it is planned in parts: then no other process helps."""
    file = Path(program)
    return stream is True or (stream is None and file.is_file() and file.stat().st_size > LONG_FILE)


def _is_short(program: str) -> bool:
    """Whether its baseline timings take less than another process does to start: some 1.7 s of processor time."""
    file = Path(program)
    return not file.is_file() or file.stat().st_size <= SHORT_FILE


def _read(
    program: str,
    machine: str | None,
    fit: str | None,
    given: Mapping[str, Any],
    motion: str,
    ready: Callable[[], object] = lambda: None,
) -> "Inputs":
    from pulsepath.inputs import read_inputs

    tolerance, origin = None if fit is None else read_quantity("--fit", fit, "m", above=0.0, like="0.02 mm"), None
    if given:  # only then are the formats worth their loading
        from pulsepath.format_options import find_origin

        origin = find_origin(program, given, tolerance)
    return apply_motion(motion, read_inputs(program, machine, tolerance, origin, ready))


def _dump(
    folder: Path,
    inputs: "Inputs",
    order: str | None,
    clock_hz: int,
    duration: str | None,
    objective: str | None,
    rule: str,
    pulses: str,
    chosen: Mapping[str, str | None],
    flags: Mapping[str, bool],
    force: bool,
    as_json: bool,
) -> None:
    from planner.limits import usual_order
    from planner.pulses import find_rule
    from planner.tradeoffs.objective import read_objective
    from pulsepath.inputs import read_rig
    from pulsepath.output.dump import dump

    read_rig(chosen["rig"], inputs.machine)  # refuses one that does not fit
    find_rule(rule)  # refuses what is none
    kind = usual_order(inputs.machine.axes, inputs.program) if order is None else int(order)
    options: dict[str, int | str] = {"order": kind, "clock-hz": clock_hz, "rule": rule, "pulses": pulses}
    if duration is not None:
        read_quantity("--duration", duration, "s", above=0.0)
        options["duration"] = duration
    if chosen["gap"] is not None:
        read_percent("--gap", chosen["gap"])
    if objective is not None:
        options["objective"] = str(read_objective(objective))
    options |= {name: value for name, value in chosen.items() if value is not None}
    options |= {name: True for name, given in flags.items() if given}
    dump(folder, inputs, "plan", options, force, as_json)
