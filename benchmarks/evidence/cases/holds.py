"""Stops at some instants of plans, and motions on from there at a random share of the speed.

Plans of the bundled programs on their machines, of two straight moves and of a pocket on a CoreXY,
at both orders where jerk is limited. Each stop is to be proved. The largest use of a limit is that
at 10⁵ instants. The pulses that are sent before a stop and its own are joined and checked as those
of one motion. The duration of a stop is compared with those of the soonest of 13 ends, each solved
for on a fine grid, and of two stops that begin later.

`--only corexy-pocket` takes the plans of one program, and `--even` instants at equal distances.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import chain, islice
from math import ceil
from pathlib import Path
from time import process_time

import numpy as np

from benchmarks.evidence.limit_use import measure_rates
from benchmarks.evidence.table import Table, quantile_table
from kinematics import load_machine
from kinematics.foundation.errors import MotionError, attempt
from planner import Line, Plan, Program, import_program, load_program, plan, program_names
from planner.interruption.instant import look
from planner.interruption.section import Section
from planner.limits import usual_order
from planner.pulses import AxesMotion, PulseSchedule, check
from planner.pulses.generation.motion_parts import JoinedMotion, MotionSpan
from planner.timing import REST, Continuation, EndCondition, Run, Task, solve_once

EXAMPLES = Path(__file__).parents[3] / "docs/examples"
SAMPLES = 100_000
ENDS = (0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 1.0, 1.05, 1.15, 1.3)
LATER = (0.07, 0.25)
"""Shares of a stop's way at which other stops end, and of its time by which others begin later."""
SHARES = (0.05, 0.95)
"""Range of the share of the plan's speed at which a motion goes on."""
PERIOD = 1e-6
"""s, of which instants are whole multiples, so that they lie on ticks of any clock."""

Sent = tuple[AxesMotion, PulseSchedule, float]
"""A motion, its pulses, and the instant (s) until which they are sent."""


def measure(
    instants: int = 10,
    plans: int = 24,
    only: str = "",
    even: bool = False,
) -> Iterator[Table]:
    """Yield the figures of all stops and motions on, and the faults."""
    rng = np.random.default_rng(19)
    figures: dict[str, list[float]] = defaultdict(list)
    faults: list[tuple[str, float, str]] = []
    for name, planned in islice(make_plans(only), plans):
        drawn = np.sort(rng.uniform(0, planned.duration, instants))
        spread = np.linspace(0, planned.duration, instants + 2)[1:-1]
        times = np.round((spread if even else drawn) / PERIOD) * PERIOD
        moving = planned.trajectory.at(times).sd > 0
        for t in times[moving].tolist():
            share = float(rng.uniform(*SHARES))
            faults += [(name, t, fault) for fault in try_instant(planned, t, share, figures)]
    yield quantile_table("Stops and motions on", figures)
    if faults:
        columns = ("plan", "at (s)", "fault")
        yield Table("Refused, unproved, or with pulses at fault", columns, faults)


def make_plans(only: str) -> Iterator[tuple[str, Plan]]:
    """Yield the plans of all programs, or of one, with their names."""
    lines = (Line(np.array([0.045, 0.045, 0.0])), Line(np.zeros(3)))
    straight = Program(lines, machine="corexy")
    pocket = import_program(EXAMPLES / "corexy-pocket.nc").program
    programs = {"straight": straight, "corexy-pocket": replace(pocket, machine="corexy")}
    programs |= {name: load_program(name) for name in program_names()}
    for name, program in programs.items():
        if program.machine is None or only not in ("", name):
            continue
        machine = load_machine(program.machine)
        for order in range(2, usual_order(machine.axes) + 1):
            yield f"{name}, order {order}", plan(program, machine, order=order)


def try_instant(
    planned: Plan,
    t: float,
    share: float,
    figures: dict[str, list[float]],
) -> list[str]:
    """Stop a plan at t (s), and go on from there: add the figures of both, return their faults."""
    faults: list[str] = []

    def add(kind: str, begin: Callable[[], Section], *sent: Sent) -> Section | None:
        start = process_time()
        section = attempt(begin)
        seconds = process_time() - start
        if isinstance(section, MotionError):
            faults.append(str(section))
            return None
        figures[f"{kind}: processor time (s)"].append(seconds)
        figures[f"{kind}: 1 - largest use of a limit"].append(1 - measure_use(planned, section))
        faults.extend(find_faults(section, *sent)[:1])
        if not section.certificate.holds:
            faults.append(f"{kind}: not proved")
        return section

    sent = planned.counted, planned.pulses, t
    stop = add("stop", partial(planned.hold, t), sent)
    if stop is not None:
        ratio = stop.duration / find_soonest(planned, stop)
        figures["stop: duration, of the soonest"].append(ratio)
        if stop.until < planned.path.breaks[-1]:
            add("motion on", partial(planned.resume, stop, share), sent, rest_after(stop))
    return faults


def rest_after(stop: Section) -> Sent:
    """Return a stop with a rest after it, until an instant at which the next motion may begin."""
    return stop.counted, stop.pulses, ceil(stop.duration / PERIOD + 1) * PERIOD


def find_faults(section: Section, *sent: Sent) -> list[str]:
    """Return the faults of the pulses that are sent before a section, and its own, joined."""
    clock = section.pulses.clock_hz
    runs = (*sent, (section.counted, section.pulses, section.duration))
    ends = [*(round(until * clock) for _, _, until in sent), np.iinfo(np.int64).max]
    begins = np.cumsum([0, *ends[:-1]])
    axes = []
    moves = []
    for k, axis in enumerate(section.pulses.axes):
        parts = [pulses.axes[k] for _, pulses, _ in runs]
        count = parts[-2].counts([ends[-2] - 1])[0]
        if axis.start != count:
            return [f"{axis.name} starts at {axis.start}, and {count} were sent"]
        ticks = [part.ticks[part.ticks < end] for part, end in zip(parts, ends, strict=True)]
        direction = [part.direction[: len(sent)] for part, sent in zip(parts, ticks, strict=True)]
        moved = [[move for move in pulses.moves if move.axis == axis.name] for _, pulses, _ in runs]
        errors = [sum(move.error for move in each) for each in moved]
        # what keeping pulses apart costs widens the bound of the rule
        bound = min(part.bound - error for part, error in zip(parts, errors, strict=True))
        axes.append(
            replace(
                parts[0],
                ticks=np.concatenate([*map(np.add, ticks, begins)]),
                direction=np.concatenate(direction),
                bound=bound + max(errors),
            )
        )
        every = list(chain(*moved))
        if every:
            pulses = sum(move.pulses for move in every)
            time = max(move.time for move in every)
            moves.append(replace(every[0], pulses=pulses, time=time, error=max(errors)))
    joined = JoinedMotion.of(*(MotionSpan(motion, 0.0, until) for motion, _, until in runs))
    schedule = PulseSchedule(clock, tuple(axes), joined.duration, section.pulses.rule, tuple(moves))
    verdict = check(schedule, joined, section.machine.axes, section.machine.home_q)
    faults = chain(*(axis.faults for axis in verdict.axes))
    return [f"{fault.axis} at tick {fault.tick}: {fault.what}" for fault in faults]


def measure_use(planned: Plan, section: Section) -> float:
    """Return the largest share of an axis' limit at 10⁵ instants."""
    state = section.trajectory.at(np.linspace(0.0, section.duration, SAMPLES)[:-1])
    return measure_rates(planned.machine, planned.order, (state.qd, state.qdd, state.qddd))


def find_soonest(planned: Plan, stop: Section) -> float:
    """Return s to rest at the soonest of many ends, and of stops that begin later."""
    whole = planned.whole()
    begin = stop.at or 0.0
    now = look(planned.trajectory, begin)
    going = Continuation(np.zeros(1), np.zeros((4, 0)), {}) if planned.order == 3 else None
    soonest = np.inf
    for share in ENDS:
        until = stop.since + share * stop.distance
        if until > planned.path.breaks[-1]:
            break
        path = whole.draw(now, until)
        if path.stops(planned.order)[1:-1].any():
            continue
        run = Run(0, len(path.pieces) - 1, (EndCondition(now.v, now.a), REST), continuation=going)
        solution = solve_once(Task(path, whole.limits(path), run, planned.order))
        if solution.solved:
            soonest = min(soonest, solution.duration)
    for wait in stop.duration * np.array(LATER):
        later = attempt(partial(planned.hold, begin + wait))
        if isinstance(later, Section):
            soonest = min(soonest, wait + later.duration)
    return float(soonest)
