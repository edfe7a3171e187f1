"""`pulsepath plan`: write the time-optimal motion, its certificate, pulses and a report."""

from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from planner.request import PlanRequest
from pulsepath.command_group import ProgramCommand
from pulsepath.options import (
    dump_option,
    json_option,
    program_argument,
    refuse_unknown,
)
from pulsepath.process.intent import writes
from pulsepath.request_options import list_options, read_request, request_options
from pulsepath.requests import InputRequest, ReportRequest

if TYPE_CHECKING:
    from planner.parallel import SideProcess
    from pulsepath.inputs import Inputs

# Modules that the second process loads, the latter to draw figures.
WORK_MODULES = ("pulsepath.job",)
FIGURE_MODULES = ("benchmarks.reports.plan_figures", "controllers.figures", "planner.figures")
# Kernels for the second process. The first process needs the first of them last.
ORDER_3_KERNELS = (
    "planner.timing.order3.riccati:solve_newton",
    "planner.timing.order3.kkt:linearize",
)
PROOF_KERNELS = ("planner.certificate.ranges:bound_motion",)
BOUND_KERNELS = (
    "planner.bounds.lower_bound:bound_cells",
    "planner.bounds.inner_minimum:fill_sets",
    "planner.bounds.dual:add_rows",
    "planner.bounds.dual:find_step",
)
# Bytes above which a program almost certainly has more than MOST_WHOLE segments.
LONG_FILE = 1 << 16
# Bytes up to which baseline timings take less than starting a process, 1.7 s of processor time.
SHORT_FILE = 1 << 12


@click.command(cls=ProgramCommand)
@program_argument
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Output directory.")
@request_options(InputRequest, PlanRequest, ReportRequest)
@dump_option
@click.option("--force", is_flag=True, help="Replace DIR if it holds an earlier plan.")
@json_option
def plan(out: Path | None, dumped: Path | None, force: bool, as_json: bool, **options: Any) -> None:
    """Plan PROGRAM; write motion, pulses and report to DIR.

    The motion is the fastest that the machine's limits allow, and is proved to respect every limit.
    PROGRAM is a preset, a TOML file, or a file that pulsepath import reads.

    Example: pulsepath plan circle --out out/circle
    """
    source = read_request(InputRequest, options)
    request = read_request(PlanRequest, options)
    report = read_request(ReportRequest, options)
    refuse_unknown(source.program, source.machine, report.rig, rule=str(request.rule))
    if dumped is not None:
        _dump(dumped, options, force, as_json)
        return
    if out is None:
        raise click.UsageError("Missing option '--out'.", click.get_current_context())
    writes(out)
    from pulsepath.inputs import refuse_faulty_rig
    from pulsepath.output.directory import list_replaceable, replace_directory

    before = list_replaceable(out, force)
    request.check()
    _refuse_conflicts(request, report)
    refuse_faulty_rig(report.rig)

    with ExitStack() as stack:
        # Faults of files are reported before the rest loads, which both processes then do at once.
        inputs, other = _read(source, report, stack)
        from pulsepath.job import run
        from pulsepath.output import tables
        from pulsepath.parts_job import choose_parts, open_helpers, run_parts
        from pulsepath.store.write import write_whole

        _compile_together(request, report, other, stack)
        # A directory that cannot be written is reported before the work.
        directory = replace_directory(out, force, before=before)
        if choose_parts(inputs, request, report):
            with open_helpers(report.cluster) as helpers, directory as folder:
                results, refusal = run_parts(inputs, request, report, folder, helpers)
        else:
            refusal = None
            _refuse_parts_options(report)
            with directory as folder:
                with inputs.tell_lines():
                    job = run(inputs.program, inputs.machine, request, report, other)
                results = write_whole(folder, job, inputs, report.pulses)
    tables.show_plan(
        out, as_json, lambda: tables.tabulate_plan(results), lambda: tables.sum_up(results)
    )
    if refusal is not None:
        raise refusal


def _compile_together(
    request: PlanRequest,
    report: ReportRequest,
    other: "SideProcess",
    stack: ExitStack,
) -> None:
    """Have the second process compile kernels too, if they are not on disk."""
    from kinematics.foundation.kernels import are_stored, compile_kernels
    from planner.parallel import NO_PROCESS, side_process

    order_3 = () if request.order == 2 else ORDER_3_KERNELS
    bound = () if report.bound_effort == "none" else BOUND_KERNELS
    names = (*order_3, *PROOF_KERNELS, *bound)
    if are_stored(names):
        return
    if other is NO_PROCESS:
        other = stack.enter_context(side_process())
    other.start(partial(compile_kernels, names))


def _refuse_conflicts(request: PlanRequest, report: ReportRequest) -> None:
    """Raise UsageError for options that exclude each other."""
    if report.bound == "none" and (request.gap is not None or report.worth):
        option = "--worth" if request.gap is None else "--gap"
        message = f"{option} needs a lower bound: omit --bound none."
        raise click.UsageError(message, click.get_current_context())
    if report.stream is False:
        _refuse_parts_options(report)


def _refuse_parts_options(report: ReportRequest) -> None:
    """Raise UsageError for an option that only a plan in parts has."""
    options = {"--keep-certified": report.keep_certified, "--cluster": report.cluster is not None}
    for option in (name for name, is_given in options.items() if is_given):
        raise click.UsageError(f"{option} is for --stream.", click.get_current_context())


def _read(
    source: InputRequest,
    report: ReportRequest,
    stack: ExitStack,
) -> tuple["Inputs", "SideProcess"]:
    """Read the inputs. Start the second process, if it will help, before slow modules load."""
    from planner.parallel import NO_PROCESS, side_process

    file = Path(source.program)
    size = file.stat().st_size if file.is_file() else 0
    in_parts = report.stream is True or (report.stream is None and size > LONG_FILE)
    timed = report.baselines is not False and size > SHORT_FILE
    helps = not in_parts and (report.figures or report.rig is not None or timed)
    other = NO_PROCESS

    def start() -> None:
        nonlocal other
        if helps:
            modules = [*WORK_MODULES, *(FIGURE_MODULES if report.figures else ())]
            other = stack.enter_context(side_process(modules))

    inputs = source.read(start)
    return inputs, other


def _dump(folder: Path, options: dict[str, Any], force: bool, as_json: bool) -> None:
    """Write the inputs with all defaults, and print the options with theirs."""
    from pulsepath.inputs import read_rig
    from pulsepath.output.dump import dump

    inputs = read_request(InputRequest, options).read()
    read_rig(options["rig"], inputs.machine)  # refuses one that does not fit
    request = read_request(PlanRequest, options).resolve(inputs.program, inputs.machine)
    options = {**options, "order": request.order}
    dump(folder, inputs, list_options(options, PlanRequest, ReportRequest), force, as_json)
