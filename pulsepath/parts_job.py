"""The job of the command `plan` for a long program: the plan is written part by part."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import islice
from pathlib import Path
from time import perf_counter

from benchmarks.reports.plan_content import PlanReport
from kinematics import MotionError
from planner.limits import find_unkept_limits
from planner.needs_whole import find_whole_reason
from planner.parallel import LocalHelpers
from planner.plan_parts import PlanStanding, make_parts
from planner.request import MOST_WHOLE, PlanRequest
from planner.timing.order2.toppra_ import require
from planner.windows import Helpers
from pulsepath.inputs import Inputs, read_rig
from pulsepath.progress import note, step
from pulsepath.requests import ReportRequest
from pulsepath.store.write import write_parts


def choose_parts(inputs: Inputs, request: PlanRequest, report: ReportRequest) -> bool:
    """Return whether a program is planned in parts: as the report states, else by its length.

    Raises MotionError for --stream with a program that can only be planned as a whole.
    """
    program = inputs.program
    stream = report.stream
    why: str | None = None
    if stream is False or (stream is None and program.repeat * len(program.segments) <= MOST_WHOLE):
        return False
    if report.baselines:
        why = " with --baselines: omit that"
    elif report.pulses == "csv":
        why = " with --pulses csv: omit that, and run pulsepath export --format pulses on the plan later"
    elif (reason := find_whole_reason(request, program, inputs.machine)) is not None:
        why = f", because {reason}"
    if why is not None and stream:
        of = f"program {program.name} on {inputs.machine.name}"
        raise MotionError(f"--stream: {of} cannot be planned in parts{why}, or give --whole")
    if why is not None:
        note(
            f"note: planned as a whole, which takes long and much memory; it cannot be planned in parts{why}"
        )
    return why is None


@contextmanager
def open_helpers(cluster: str | None) -> Iterator[Helpers]:
    """Open the workers of a Dask scheduler by its address or file; None: processes of this
    computer.

    Raises as `planner.cluster.open_cluster`.
    """
    with ExitStack() as stack:
        if cluster is None:
            yield LocalHelpers(stack)
        else:
            from planner.cluster import open_cluster

            yield stack.enter_context(
                open_cluster(cluster, tell=lambda text: note(f"note: {text}"))
            )


def run_parts(
    inputs: Inputs,
    request: PlanRequest,
    report: ReportRequest,
    folder: Path,
    helpers: Helpers | None = None,
) -> tuple[PlanReport, MotionError | None]:
    """Plan into a folder. Return and raise as `write_parts`.

    helpers: processes that plan the stretches between stops; the result is the same without them.
    """
    program, machine = inputs.program, inputs.machine
    for field in find_unkept_limits(machine):
        note(f"note: {machine.name} states {field} but no masses, so no plan can respect it")
    read_rig(report.rig, machine)  # refuses one that does not fit before the work
    if report.cross_check:
        require("--cross-check")
    planned_until = 0.0
    planned, ahead, read = _Place(inputs), _Place(inputs), 0
    # Time at the end of the first part, its segments and its motion (s). Libraries are loaded and
    # kernels are built before that, which would spoil an estimate of the time left.
    first: tuple[float, int, float] | None = None

    def describe(done: int, of: int) -> str:
        if first is None:
            return f"{ahead.find(read, of)} read, the first part not planned yet"
        where = f"{planned.find(done, of)}, {planned_until:.1f} s of motion"
        if done == first[1]:
            return where
        spent = perf_counter() - first[0]
        left = spent * (of - done) / (done - first[1])
        speed = (planned_until - first[2]) / max(spent, 1e-9)
        return f"{where}, {speed:.1f} times real time, about {left:.0f} s left"

    with step(f"planning {program.name} on {machine.name} part by part", describe) as tell:

        def tell_standing(standing: PlanStanding, done: int) -> None:
            nonlocal planned_until, first
            if first is None:
                first = perf_counter(), done, standing.duration
            planned_until = standing.duration
            tell(done, program.repeat * len(program.segments))

        def tell_read(done: int, of: int) -> None:
            nonlocal read
            read = done
            if first is None:
                tell(0, of)

        parts = make_parts(request, program, machine, helpers, tell_read)
        with inputs.tell_lines():
            results, refusal = write_parts(folder, inputs, parts, report, tell_standing)
    if refusal is not None:
        inputs.tell_line(refusal)
    return results, refusal


class _Place:
    """Line of the program's file that planning has reached. The file is read once more for it."""

    def __init__(self, inputs: Inputs) -> None:
        self._repeats = inputs.program.repeat > 1
        self._lines = (segment.line_number for segment in inputs.program.segments)
        self._total = inputs.program_toml.rstrip().count(b"\n") + 1
        self._segment = 0
        self._line: int | None = None

    def find(self, segment: int, of: int) -> str:
        """Return the line of a segment, or its number if it has no line.

        Segments must come in order.
        """
        if self._repeats:
            return f"segment {segment} of {of}, all repetitions"
        for line in islice(self._lines, max(0, segment - self._segment)):
            self._segment, self._line = self._segment + 1, line
        return (
            f"segment {segment} of {of}"
            if self._line is None
            else f"line {self._line} of {self._total}"
        )
