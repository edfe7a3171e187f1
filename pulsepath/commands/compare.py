"""`pulsepath compare`: compare tracking laws and gains on a rig, or saved runs, in one report."""

from collections import Counter
from collections.abc import Callable
from itertools import product
from math import ceil, prod
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import click

from pulsepath import known_names
from pulsepath.known_names import make_completer
from pulsepath.options import refuse_unknown
from pulsepath.process.exits import INFEASIBLE
from pulsepath.process.intent import writes
from pulsepath.progress import QUIET, level, say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.reports.gain import Condition
    from benchmarks.sweep import Grid, SavedRuns, Setting
    from controllers.rig import Rig, Task

DEFAULT_RIG = "servo-rig"
STEP_COST, DRIVE_COST = 1.3e-3, 4.5e-7
"""s of one core for a step of a batch, and for a sample of one drive of one run, with its figures."""
FIXED_COST, SAVING_COST = 8.0, 0.012
"""s for starting and for the report, and for saving a run, which one core does for all."""
TIMED_RUNS, TIMED_STEPS = 8, 3
"""Runs and steps that show how long a law takes for a command."""
THESIS_LAWS = ("1", "2", "3", "4", "5", "6", "7")
"""The algorithms of [Sahbaz 2007, Table 7.5]."""
MODEL_LAWS = ("ff", "mpc")
"""Laws with a model of the drives. One setting of each is quick to compute, and shows the limit of the others."""


@click.command()
@click.argument("rig", required=False, shell_complete=make_completer(known_names.rigs, files=True))
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Output directory.")
@click.option(
    "--law",
    "laws",
    multiple=True,
    metavar="LAW",
    help='Law to run over its gain grid, or with given gains as "6:gain=0.7"; repeatable. '
    "Default: the seven published laws, and feedforward and predictive with their usual gains.",
    shell_complete=make_completer(known_names.laws),
)
@click.option("--task", "tasks", multiple=True, metavar="TASK", help="Task of the rig; repeatable. Default: all.")
@click.option(
    "--seeds",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Random seeds per run, of laws and hosts that sleep; others draw nothing and run once.",
)
@click.option(
    "--from",
    "saved",
    multiple=True,
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Compare the runs saved in DIR instead of running new ones; repeatable.",
)
@click.option(
    "--against",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Compare each setting with its own runs saved in DIR, too; --fail-if ratios are then of these. Default laws "
    "and tasks: those in DIR.",
)
@click.option(
    "--baseline",
    metavar="LAW",
    help='Setting to compare against. Default: "6:gain=0.7" if it was run, else the first setting.',
)
@click.option(
    "--fail-if",
    "conditions",
    multiple=True,
    metavar="CONDITION",
    help="Exit with code 1 if CONDITION holds on any path for the setting that the verdict calls the best, or the "
    'closest to the baseline, by all criteria weighed. "contour_rms > 1.1x" judges its mean over rigs and seeds, times '
    'the baseline\'s, on each ranked path; "contour_max > 250 um" each of its runs on every path. With --against, a '
    "ratio judges every setting, times its own saved runs. Repeatable; the report has a table of them.",
)
@click.option("--address", metavar="ADDRESS", help="Dask scheduler to use. Default: the cores of this computer.")
@click.option("--force", is_flag=True, help="Replace an earlier comparison in DIR; saved runs are kept.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
def compare(
    rig: str | None,
    out: Path,
    laws: tuple[str, ...],
    tasks: tuple[str, ...],
    seeds: int,
    saved: tuple[Path, ...],
    against: Path | None,
    baseline: str | None,
    conditions: tuple[str, ...],
    address: str | None,
    force: bool,
    as_json: bool,
) -> None:
    """Compare tracking laws and their gains on RIG.

    RIG is a bundled rig or a TOML file. Default: servo-rig.

    Every law runs over its gain grid on every task, with inertia and friction as stated and 30 % off; by default the
    published ones, and feedforward and predictive with their usual gains, in about a minute on two cores. Prints first
    the number of runs and about how long they take, then the time left, by their own pace. Runs are saved in DIR and
    are not repeated if they are already there; `--from DIR` compares them later, and `--against DIR` runs the same
    settings anew and guards against regression.

    Example: pulsepath compare servo-rig --law 3 --law 6 --out out/laws
    """
    writes(out / "compare.json", kept="" if saved else f"finished runs are kept in {out} and reused next time")
    refuse_unknown(rig=rig, laws=laws)
    from kinematics.foundation.errors import MotionError
    from kinematics.foundation.names import find
    from pulsepath.output import compare_directory

    if saved and (rig or laws or tasks or address or seeds != 1):
        raise MotionError(
            "compare: with --from nothing is run, so give no RIG, --law, --task, --seeds or --address; "
            "to run RIG and compare it with saved runs, give --against DIR"
        )
    asked: Sequence[Condition] = []
    if conditions:  # what is mistaken in them is told before anything that --force would get over
        from benchmarks.reports.gain import read_condition

        asked = [read_condition(text) for text in conditions]
    to = compare_directory.destinations(out, force)
    if rig is not None and rig not in known_names.rigs():  # a bundled one has no faults
        from controllers.rig_file import validate_rig_file

        validate_rig_file(find("controllers", "rig", rig))
    from benchmarks.sweep import load_runs, read_setting

    for text in (*laws, *filter(None, [baseline])):
        read_setting(text)
    runs, old = [load_runs(folder) for folder in saved], None if against is None else load_runs(against)
    from benchmarks.reports import gain
    from controllers.rig_file import load_rig
    from pulsepath.output import record
    from pulsepath.output.directory import REPORT
    from pulsepath.progress import note, step

    for condition, one in product(asked, [*runs, *filter(None, [old])]):
        condition.check(one.record)
    if not saved:
        if old is not None and rig is None and old.record["rig"] != DEFAULT_RIG:
            raise MotionError(f"compare: the runs in {against} are of rig {old.record['rig']}: give the RIG to run")
        chosen = load_rig(rig or DEFAULT_RIG)
        settings, tasks = _choose_runs(chosen, laws, tasks, baseline, old)
        runs = [_run(chosen, out, settings, tasks, seeds, address, asked)]
    with step("comparing runs"):
        found = gain.compare(runs, baseline)
        changes = {} if old is None else gain.guard(found, gain.compare([old]), asked)
        every = [one for each in changes.values() for one in each]
        verdict = gain.verdict_of(found)
        judged = gain.judge(asked, found, verdict.best, changes)
        compare_directory.write(to, found, every, judged)
    met = [
        reason
        for condition in asked
        if condition not in changes
        for reason in condition.list_reasons(found, verdict.best)
    ]
    for told in gain.describe_unjudged(judged, found):
        note(told)
    if asked and len(saved) > 1 and old is None and verdict.best is not None:
        note(
            f"--fail-if judges the best setting of all, which is of {runs[verdict.best.source].name}; to guard every "
            "setting of other runs give them alone by --from, and --against DIR"
        )
    met += [reason for condition, each in changes.items() for reason in gain.list_regressions(condition, each)]
    report = str(out / REPORT)
    if as_json:
        data: dict[str, Any] = {"verdict": verdict.text, "gains": verdict.gains, "report": report, "failed": met}
        if old is not None:
            data["against_saved"] = [one.as_record() for one in every]
        click.echo(record.as_json(data), nl=False)
    elif level() == QUIET:
        say(report)
    else:
        say("\n  ".join(verdict.told))
        for each in changes.values():
            say(f"against {against}, the worst of {len(each)}: {each[0]}")
        say(f"{verdict.gains}\nreport: {report}" if verdict.gains else f"report: {report}")
    if not as_json:
        for reason in met:
            say(f"failed: {reason}", err=True)
    if met:
        click.get_current_context().exit(INFEASIBLE)


def _choose_runs(
    rig: "Rig", laws: tuple[str, ...], tasks: tuple[str, ...], baseline: str | None, old: "SavedRuns | None"
) -> "tuple[list[Setting], tuple[str, ...]]":
    """The settings and tasks to run: those asked for, else those of the saved runs that are to be compared with."""
    from benchmarks.sweep import read_setting, settings_of
    from kinematics import MotionError

    known = tuple(task.name for task in rig.tasks)
    if old is not None and not laws:
        settings = list(dict.fromkeys(run.cell.setting for run in old.results.values()))
    else:
        settings = [
            setting
            for law in laws or THESIS_LAWS
            for setting in ([read_setting(law)] if ":" in law else settings_of(law))
        ]
        settings += [] if laws else map(read_setting, MODEL_LAWS)
    if baseline is not None and read_setting(baseline) not in settings:
        run = ", ".join(setting.text for setting in settings)
        raise MotionError(f"compare: the baseline {baseline} is not among the settings to run: {run}")
    if old is not None and not tasks:
        tasks = tuple(task for task in old.record["tasks"] if task in known)
    return settings, tasks or known


def _run(
    rig: "Rig",
    out: Path,
    settings: "Sequence[Setting]",
    tasks: tuple[str, ...],
    seeds: int,
    address: str | None,
    asked: "Sequence[Condition]",
) -> "SavedRuns":
    """The runs of a rig, after all options have been checked; saved runs are reused."""
    from benchmarks.sweep import Grid, described, sweep
    from pulsepath.progress import note, step

    grid = Grid(tuple(settings), tasks, seeds=tuple(range(seeds)))
    facts = described(grid, rig)
    for condition in asked:
        condition.check(facts)
    note(_announce(grid, rig, out))
    with step(f"running {rig.name}", _make_pace(perf_counter)) as tell:
        return sweep(grid, rig, out, address=address, progress=tell, tell=note)


def _announce(grid: "Grid", rig: "Rig", out: Path) -> str:
    """Describe the runs to do and their approximate time, without the saved runs."""
    from benchmarks.sweep import list_cells
    from kinematics.foundation.names import count_noun
    from planner.parallel import cores as count_cores
    from pulsepath.output.directory import CELLS

    cells, cores = list_cells(grid, rig), count_cores()
    lanes = Counter((cell.setting.law, cell.task) for cell in cells)
    tasks = {name: rig.task(name) for name in grid.tasks}
    sampled = DRIVE_COST * sum(1 / drive.sample for drive in rig.drives)
    work = 0.0
    for (law, task), runs in lanes.items():
        setting = next(cell.setting for cell in cells if cell.setting.law == law)
        step = STEP_COST + runs * _time_command(setting, rig, tasks[task])
        work += tasks[task].motion.duration * (step / tasks[task].dt + sampled * runs)
    seconds = FIXED_COST + SAVING_COST * len(cells) + work / cores
    time = f"{seconds / 60:.0f} min" if seconds > 90 else f"{10 * ceil(seconds / 10)} s"
    counts = {
        "settings": len({cell.setting for cell in cells}),
        "tasks": len({cell.task for cell in cells}),
        "variations of the rig": len({cell.variation for cell in cells}),
        "seeds": len({cell.seed for cell in cells}),
    }
    # seeds multiply the runs of those laws only that draw anything by chance
    whole = prod(counts.values()) == len(cells)
    factors = " × ".join(
        f"{'up to ' if what == 'seeds' and not whole else ''}{count} {what}"
        for what, count in counts.items()
        if count > 1
    )
    equal = len(list(grid)) - len(cells)
    alike = f"; {equal} more would equal one of these and are not run" if equal else ""
    saved = "; runs that are saved there are reused" if (out / CELLS).is_dir() else ""
    amount = count_noun(len(cells), "run") + (factors and f" ({factors})")
    return f"{amount}: about {time} on {cores} idle cores{alike}{saved}"


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
    """Return a function that reports the runs done, and the time left by their pace since the first call."""
    begin: tuple[float, int] | None = None

    def describe(done: int, of: int) -> str:
        nonlocal begin
        now = clock()
        begin = begin or (now, done)
        passed, fresh = now - begin[0], done - begin[1]
        if fresh <= 0 or done == of:
            return f"{done} of {of}"
        seconds = passed / fresh * (of - done)
        time = f"{seconds / 60:.0f} min" if seconds > 90 else f"{ceil(seconds)} s"
        return f"{done} of {of}, about {time} left"

    return describe
