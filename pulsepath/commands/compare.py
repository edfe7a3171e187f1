"""`pulsepath compare`: compare tracking laws and gains on a rig, or saved runs, in one report."""

from collections import Counter
from collections.abc import Callable
from dataclasses import MISSING, dataclass
from math import ceil, prod
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import click

from planner.request import option
from pulsepath import known_names
from pulsepath.commands.common import print_json
from pulsepath.known_names import make_completer
from pulsepath.options import json_option, refuse_unknown
from pulsepath.process.exits import INFEASIBLE
from pulsepath.process.intent import writes
from pulsepath.progress import QUIET, level, note, say, step
from pulsepath.request_options import with_request

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from benchmarks.reports.gain import Change, Comparison, Condition, Verdict
    from benchmarks.sweep import Cell, Grid, SavedRuns, Setting
    from controllers.rig import Rig, Task

DEFAULT_RIG = "servo-rig"
# s of one core for a step of a batch, and for a sample of one drive of one run, with its figures.
STEP_COST = 1.3e-3
DRIVE_COST = 4.5e-7
# s for starting and for the report, and for saving a run, which one core does for all.
FIXED_COST = 8.0
SAVING_COST = 0.012
# Runs and steps that show how long a law takes for a command.
TIMED_RUNS = 8
TIMED_STEPS = 3
# The algorithms of [Sahbaz 2007, Table 7.5].
THESIS_LAWS = ("1", "2", "3", "4", "5", "6", "7")
# Laws with a model of the drives. One setting of each is quick to compute, and shows the limit of
# the others.
MODEL_LAWS = ("ff", "mpc")


@dataclass(frozen=True, slots=True, kw_only=True)
class CompareRequest:
    """The runs to do or to read, and the conditions on their errors."""

    rig: str | None = None
    out: Path = option(MISSING, "Output directory.", metavar="DIR")
    laws: tuple[str, ...] = option(
        (),
        'Law to run over its gain grid, or with given gains as "6:gain=0.7"; repeatable. Default: '
        "the seven published laws, and feedforward and predictive with their usual gains.",
        flag="--law",
        metavar="LAW",
        names="laws",
    )
    tasks: tuple[str, ...] = option(
        (),
        "Task of the rig; repeatable. Default: all.",
        flag="--task",
        metavar="TASK",
    )
    seeds: int = option(
        1,
        "Random seeds per run, of laws and hosts that sleep; others draw nothing and run once.",
        least=1,
    )
    saved: tuple[Path, ...] = option(
        (),
        "Compare the runs saved in DIR instead of running new ones; repeatable.",
        flag="--from",
        metavar="DIR",
    )
    against: Path | None = option(
        None,
        "Compare each setting with its own runs saved in DIR, too; --fail-if ratios are then of "
        "these. Default laws and tasks: those in DIR.",
        metavar="DIR",
    )
    baseline: str | None = option(
        None,
        'Setting to compare against. Default: "6:gain=0.7" if it was run, else the first setting.',
        metavar="LAW",
    )
    conditions: tuple[str, ...] = option(
        (),
        "Exit with code 1 if CONDITION holds on any path for the setting that the verdict calls "
        "the best, or the closest to the baseline, by all criteria weighed. "
        '"contour_rms > 1.1x" judges its mean over rigs and seeds, times the baseline\'s, on each '
        'ranked path; "contour_max > 250 um" each of its runs on every path. With --against, a '
        "ratio judges every setting, times its own saved runs. Repeatable; the report has a table "
        "of them.",
        flag="--fail-if",
        metavar="CONDITION",
    )
    address: str | None = option(
        None,
        "Dask scheduler to use. Default: the cores of this computer.",
        metavar="ADDRESS",
    )

    @property
    def runs_anything(self) -> bool:
        """True if an option is given that only new runs have."""
        return bool(self.rig or self.laws or self.tasks or self.address or self.seeds != 1)


@click.command()
@click.argument("rig", required=False, shell_complete=make_completer(known_names.rigs, files=True))
@with_request(CompareRequest)
@click.option(
    "--force",
    is_flag=True,
    help="Replace an earlier comparison in DIR; saved runs are kept.",
)
@json_option
def compare(request: CompareRequest, force: bool, as_json: bool) -> None:
    """Compare tracking laws and their gains on RIG.

    RIG is a bundled rig or a TOML file. Default: servo-rig.

    Every law runs over its gain grid on every task, with inertia and friction as stated and 30 %
    off; by default the published ones, and feedforward and predictive with their usual gains, in
    about a minute on two cores. Prints first the number of runs and about how long they take, then
    the time left, by their own pace. Runs are saved in DIR and are not repeated if they are already
    there; `--from DIR` compares them later, and `--against DIR` runs the same settings anew and
    guards against regression.

    Example: pulsepath compare servo-rig --law 3 --law 6 --out out/laws
    """
    out = request.out
    reused = "" if request.saved else f"finished runs are kept in {out} and reused next time"
    writes(out / "compare.json", kept=reused)
    refuse_unknown(rig=request.rig, laws=request.laws)
    from kinematics.foundation.errors import MotionError
    from pulsepath.inputs import refuse_faulty_rig
    from pulsepath.output import compare_directory

    if request.saved and request.runs_anything:
        raise MotionError(
            "compare: with --from nothing is run, so give no RIG, --law, --task, --seeds or "
            "--address; to run RIG and compare it with saved runs, give --against DIR",
        )
    # Wrong conditions are reported before anything that --force would remove.
    conditions: Sequence[Condition] = []
    if request.conditions:
        from benchmarks.reports.gain import read_condition

        conditions = [read_condition(text) for text in request.conditions]
    destinations = compare_directory.destinations(out, force)
    refuse_faulty_rig(request.rig)
    from benchmarks.sweep import load_runs, read_setting

    for text in request.laws:
        read_setting(text)
    if request.baseline is not None:
        read_setting(request.baseline)
    runs = [load_runs(folder) for folder in request.saved]
    old = None if request.against is None else load_runs(request.against)
    for condition in conditions:
        for each in [*runs, *([] if old is None else [old])]:
            condition.check(each.record)
    if not runs:
        runs = [_run(request, old, conditions)]
    from benchmarks.reports import gain

    with step("comparing runs"):
        comparison = gain.compare(runs, request.baseline)
        changes = {}
        if old is not None:
            changes = gain.guard(comparison, gain.compare([old]), conditions)
        every_change = [change for each in changes.values() for change in each]
        verdict = gain.verdict_of(comparison)
        judged = gain.judge(conditions, comparison, verdict.best, changes)
        compare_directory.write(destinations, comparison, every_change, judged)
    for text in gain.describe_unjudged(judged, comparison):
        note(text)
    if conditions and len(request.saved) > 1 and old is None and verdict.best is not None:
        note(
            f"--fail-if judges the best setting of all, which is of "
            f"{runs[verdict.best.source].name}; to guard every setting of other runs give them "
            "alone by --from, and --against DIR",
        )
    failed = _list_failures(conditions, comparison, verdict, changes)
    _print(request, verdict, changes, failed, as_json)
    if failed:
        click.get_current_context().exit(INFEASIBLE)


def _list_failures(
    conditions: "Sequence[Condition]",
    comparison: "Comparison",
    verdict: "Verdict",
    changes: "Mapping[Condition, Sequence[Change]]",
) -> list[str]:
    """Return why conditions hold. Those in `changes` are of each setting's own saved runs."""
    from benchmarks.reports.gain import list_regressions

    failed = []
    for condition in conditions:
        if condition not in changes:
            failed += condition.list_reasons(comparison, verdict.best)
    for condition, each in changes.items():
        failed += list_regressions(condition, each)
    return failed


def _print(
    request: CompareRequest,
    verdict: "Verdict",
    changes: "Mapping[Condition, Sequence[Change]]",
    failed: list[str],
    as_json: bool,
) -> None:
    """Print the verdict, the changes against saved runs, and the conditions that hold."""
    from pulsepath.output.directory import REPORT

    report = str(request.out / REPORT)
    if as_json:
        data: dict[str, Any] = {
            "verdict": verdict.text,
            "gains": verdict.gains,
            "report": report,
            "failed": failed,
        }
        if request.against is not None:
            every_change = [change for each in changes.values() for change in each]
            data["against_saved"] = [change.as_record() for change in every_change]
        print_json(data)
        return
    if level() == QUIET:
        say(report)
    else:
        say("\n  ".join(verdict.told))
        for each in changes.values():
            say(f"against {request.against}, the worst of {len(each)}: {each[0]}")
        if verdict.gains:
            say(verdict.gains)
        say(f"report: {report}")
    for reason in failed:
        say(f"failed: {reason}", err=True)


def _run(
    request: CompareRequest,
    old: "SavedRuns | None",
    conditions: "Sequence[Condition]",
) -> "SavedRuns":
    """Run a rig after all options have been checked. Runs that are saved are reused.

    old: saved runs to compare with
    """
    from benchmarks.sweep import described, sweep
    from controllers.rig_file import load_rig
    from kinematics.foundation.errors import MotionError

    if old is not None and request.rig is None and old.record["rig"] != DEFAULT_RIG:
        raise MotionError(
            f"compare: the runs in {request.against} are of rig {old.record['rig']}: give the RIG to run",
        )
    rig = load_rig(request.rig or DEFAULT_RIG)
    grid = _choose_runs(rig, request, old)
    facts = described(grid, rig)
    for condition in conditions:
        condition.check(facts)
    note(_announce(grid, rig, request.out))
    with step(f"running {rig.name}", _make_pace(perf_counter)) as progress:
        return sweep(grid, rig, request.out, address=request.address, progress=progress, tell=note)


def _choose_runs(rig: "Rig", request: CompareRequest, old: "SavedRuns | None") -> "Grid":
    """Return the runs of a request. Laws and tasks that it omits are those of saved runs."""
    from benchmarks.sweep import Grid, read_setting, settings_of
    from kinematics.foundation.errors import MotionError

    settings: list[Setting] = []
    if old is not None and not request.laws:
        settings += dict.fromkeys(run.cell.setting for run in old.results.values())
    else:
        for law in request.laws or THESIS_LAWS:
            settings += [read_setting(law)] if ":" in law else settings_of(law)
        if not request.laws:
            settings += map(read_setting, MODEL_LAWS)
    baseline = request.baseline
    if baseline is not None and read_setting(baseline) not in settings:
        names = ", ".join(setting.text for setting in settings)
        raise MotionError(
            f"compare: the baseline {baseline} is not among the settings to run: {names}",
        )
    tasks = request.tasks
    known = tuple(task.name for task in rig.tasks)
    if old is not None and not tasks:
        tasks = tuple(task for task in old.record["tasks"] if task in known)
    return Grid(tuple(settings), tasks or known, seeds=tuple(range(request.seeds)))


def _announce(grid: "Grid", rig: "Rig", out: Path) -> str:
    """Describe the runs to do and their approximate time, without the saved runs."""
    from benchmarks.sweep import list_cells
    from kinematics.foundation.names import count_noun
    from planner.parallel import cores
    from pulsepath.output.directory import CELLS

    cells = list_cells(grid, rig)
    seconds = FIXED_COST + SAVING_COST * len(cells) + _estimate_work(cells, rig) / cores()
    time = f"{seconds / 60:.0f} min" if seconds > 90 else f"{10 * ceil(seconds / 10)} s"
    counts = {
        "settings": len({cell.setting for cell in cells}),
        "tasks": len({cell.task for cell in cells}),
        "variations of the rig": len({cell.variation for cell in cells}),
        "seeds": len({cell.seed for cell in cells}),
    }
    factors = [f"{count} {kind}" for kind, count in counts.items() if count > 1]
    # Seeds multiply the runs of those laws only that draw anything by chance.
    if counts["seeds"] > 1 and prod(counts.values()) != len(cells):
        factors[-1] = f"up to {factors[-1]}"
    amount = count_noun(len(cells), "run")
    if factors:
        amount += f" ({' × '.join(factors)})"
    text = f"{amount}: about {time} on {cores()} idle cores"
    equal = len(list(grid)) - len(cells)
    if equal:
        text += f"; {equal} more would equal one of these and are not run"
    if (out / CELLS).is_dir():
        text += "; runs that are saved there are reused"
    return text


def _estimate_work(cells: "Sequence[Cell]", rig: "Rig") -> float:
    """Return the time in s that runs take on one core."""
    samples = DRIVE_COST * sum(1 / drive.sample for drive in rig.drives)
    settings: dict[str, Setting] = {}
    for cell in cells:
        settings.setdefault(cell.setting.law, cell.setting)
    work = 0.0
    for (law, name), runs in Counter((cell.setting.law, cell.task) for cell in cells).items():
        task = rig.task(name)
        step_time = STEP_COST + runs * _time_command(settings[law], rig, task)
        work += task.motion.duration * (step_time / task.dt + samples * runs)
    return work


def _time_command(setting: "Setting", rig: "Rig", task: "Task") -> float:
    """Return the time in s that a law takes for a command of one run, beyond that of a usual step.

    Most laws command all runs of a batch at once and take none; a law that solves a problem for
    each run does.
    """
    import numpy as np

    from controllers.laws.law import Feedback, begin_law, step_law
    from controllers.simulate import sample
    from kinematics.foundation.errors import MotionError

    reference = sample(task.motion, rig.machine, task.dt)
    lanes = TIMED_RUNS, len(rig.machine.axes)
    times = []
    try:
        law = setting.make_law(rig)
        memory = begin_law(law, lanes)
        for k in range(TIMED_STEPS + 1):
            position = reference.ang(k) + np.zeros(lanes)
            speed = reference.npuls(k) + np.zeros(lanes)
            begin = perf_counter()
            _, memory = step_law(law, k, reference, Feedback(position, speed, position), memory)
            times.append(perf_counter() - begin)
    except MotionError:  # its runs fail likewise, at once
        return 0.0
    # the first command also builds what the others use
    return max(min(times[1:]) - STEP_COST, 0.0) / TIMED_RUNS


def _make_pace(clock: Callable[[], float]) -> Callable[[int, int], str]:
    """Return a function that reports the runs done, and the time left at their pace so far."""
    begin: tuple[float, int] | None = None

    def describe(done: int, of: int) -> str:
        nonlocal begin
        now = clock()
        begin = begin or (now, done)
        elapsed = now - begin[0]
        finished = done - begin[1]
        if finished <= 0 or done == of:
            return f"{done} of {of}"
        seconds = elapsed / finished * (of - done)
        time = f"{seconds / 60:.0f} min" if seconds > 90 else f"{ceil(seconds)} s"
        return f"{done} of {of}, about {time} left"

    return describe
