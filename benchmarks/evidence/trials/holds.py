"""Plans held and slowed at random instants: `python -m benchmarks.evidence.trials.holds [--instants 10] [--plans 24]`.

With `--even`, at instants one after the other, evenly, or with `--at` at some (s); with `--only corexy-pocket`, of the
plans of one program.

Of two straight moves and a pocket on a CoreXY, and of the preset programs on their machines, at both orders where jerk
is limited. Of each stop and change of speed: whether its proof holds; the largest share of a speed, acceleration or
jerk limit at 10⁵ instants; how far it leaves the path; its pulses beside those that were sent before. Of a stop its
duration beside the soonest to many ends, each solved for on a fine grid, and to those of stops that begin some later,
with the plan's own motion up to there.
"""

from argparse import ArgumentParser
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from time import process_time

import numpy as np

from kinematics import load_machine
from kinematics.foundation.errors import MotionError, attempt
from kinematics.machine.axis import directional_bounds
from kinematics.machine.machine import Machine
from planner import Line, Plan, Program, import_program, load_program, plan, program_names
from planner.interruption.section import Section
from planner.limits import usual_order
from planner.timing.problem import Continuation, Run
from planner.timing.run import solve_run

SAMPLES = 100_000
ENDS = (0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 1.0, 1.05, 1.15, 1.3)
LATER = (0.07, 0.25)
"""Of the way that a stop takes, those of the others; of its time, that by which others begin later."""
BATCH = 20_000
SHARES = (0.05, 0.95)
"""Of the plan's speed, between which a change is to one."""
EXAMPLES = Path(__file__).parents[3] / "docs/examples"


def list_programs() -> Iterator[tuple[str, Program, Machine]]:
    """What is planned, with its name and machine."""
    corexy = load_machine("corexy")
    yield "straight", Program((Line(to=np.array([0.045, 0.045, 0])), Line(to=np.zeros(3)))), corexy
    yield "corexy-pocket", import_program(EXAMPLES / "corexy-pocket.nc").program, corexy
    for name in program_names():
        program = load_program(name)
        if program.machine is not None:
            yield name, program, load_machine(program.machine)


def make_plans(count: int, only: str | None = None) -> Iterator[tuple[str, Plan]]:
    """So many, of the programs in turn, or of one."""
    for name, program, machine in list_programs():
        if only not in (None, name):
            continue
        for order in range(2, usual_order(machine.axes) + 1):
            if count == 0:
                return
            count -= 1
            yield f"{name}, order {order}", plan(program, machine, order=order)


def measure_use(held: Section, order: int) -> float:
    """The largest share of an axis' limit of speed, acceleration or jerk that is seen."""
    most = 0.0
    for t in np.array_split(np.linspace(0.0, held.duration, SAMPLES)[:-1], SAMPLES // BATCH):
        state = held.trajectory.at(t)
        rates = (state.qd, state.qdd, state.qddd)[:order]
        for values, name in zip(rates, ("max_speed", "max_acceleration", "max_jerk"), strict=False):
            for k, axis in enumerate(held.machine.axes):
                bound = getattr(axis, name)
                if bound is None:
                    continue
                low, high = directional_bounds(bound)
                most = max(most, values[:, k].max() / high, -values[:, k].min() / low)
    return most


def measure_distance(made: Plan, held: Section) -> float:
    """The most that a coordinate is off the plan's own path at the same place, as a share of the largest one."""
    state = held.trajectory.at(np.linspace(0.0, held.duration, 1000))
    place = held.since + state.along
    piece = np.clip(np.searchsorted(made.path.breaks, place, "right") - 1, 0, len(made.path.pieces) - 1)
    there = made.path.derivatives(place, piece, 0)[0]
    return float(np.abs(there - state.q).max() / np.abs(there).max())


def find_soonest(made: Plan, held: Section) -> float:
    """s to rest at the soonest of many ends, or of a stop that begins later; ∞ where none is found."""
    whole, now = made.whole(), made.trajectory.at(held.at or 0.0)
    speed, push, soonest = float(now.sd[0]), float(now.sdd[0]), np.inf
    for share in ENDS:
        until = held.since + share * held.distance
        if until > made.path.breaks[-1]:
            break
        path = whole.draw(held.since, until, speed, push, held.at or 0.0, now.q[0])
        if path.stops(made.order)[1:-1].any():
            continue
        going = Continuation(np.zeros(1), np.zeros((4, 0)), {}, push) if made.order == 3 else None
        run = Run(0, len(path.pieces) - 1, start_speed=speed, continuation=going)
        found = solve_run(path, whole.limits(path), run, made.order, probing=True)
        soonest = min(soonest, found.duration if found.solved else np.inf)
    for wait in held.duration * np.array(LATER):
        later = attempt(partial(made.hold, (held.at or 0.0) + wait))
        soonest = min(soonest, np.inf if isinstance(later, MotionError) else wait + later.duration)
    return soonest


def count_misfits(made: Plan, held: Section) -> int:
    """Axes whose pulses do not go on with those that were sent, or do not end where the stop does."""
    tick, wrong = round((held.at or 0.0) * made.pulses.clock_hz), 0
    end = held.counted.at(np.array([held.duration])).q[0]
    for k, (sent, own) in enumerate(zip(made.pulses.axes, held.pulses.axes, strict=True)):
        joined = np.concatenate([sent.ticks[sent.ticks < tick], own.ticks + tick])
        off = abs(own.final - (end[k] - own.home) / own.pulse)
        wrong += own.start != sent.counts([tick - 1])[0] or not (np.diff(joined) > 0).all() or off > own.bound + 1e-6
    return wrong


Row = tuple[bool, float, float, int, float, float]
"""Proved, the largest use, off the path, axes whose pulses do not go on, beside the soonest, s of processor time."""


def try_section(name: str, made: Plan, begin: Callable[[], Section], *, soonest: bool) -> Row | None:
    """What becomes of a stop or a change of speed; None where it is refused. What is amiss is printed."""
    start = process_time()
    found = attempt(begin)
    took = process_time() - start
    if isinstance(found, MotionError):
        print(f"{name}: {str(found).splitlines()[0]}", flush=True)
        return None
    row = (
        found.certificate.holds,
        measure_use(found, made.order),
        measure_distance(made, found),
        count_misfits(made, found),
        found.duration / find_soonest(made, found) if soonest else 1.0,
        took,
    )
    if not row[0] or row[1] > 1 or row[3] or row[4] > 1.05:
        print(f"{name}: proved {row[0]}, use {row[1]:.9f}, misfits {row[3]}, {row[4]:.3f} of soonest", flush=True)
    return row


def summarise(what: str, rows: list[Row]) -> None:
    proved, use, off, misfits, ratios, times = (np.array(each) for each in zip(*rows, strict=True))
    print(f"{len(rows)} {what}, {int(proved.sum())} proved; the largest use of a limit {use.max():.9f}")
    print(f"off the path by {off.max():.1e} of the coordinates; {int(misfits.sum())} axes whose pulses do not go on")
    if ratios.max() > 1:
        beside = f"the soonest of {len(ENDS)} ends and {len(LATER)} later stops"
        print(f"duration beside {beside}: median {np.median(ratios):.3f}, largest {ratios.max():.3f}")
    print(f"processor time of each, with its pulses: median {np.median(times):.2f} s, largest {times.max():.2f} s")


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--instants", type=int, default=10)
    parser.add_argument("--plans", type=int, default=24)
    parser.add_argument("--even", action="store_true")
    parser.add_argument("--at", type=float, nargs="+", metavar="T")
    parser.add_argument("--only", metavar="PROGRAM")
    asked = parser.parse_args()
    rng, stops, changes = np.random.default_rng(19), [], []
    for name, made in make_plans(asked.plans, asked.only):
        end = made.trajectory.duration
        even, drawn = np.linspace(0, end, asked.instants + 2)[1:-1], rng.uniform(0, end, asked.instants)
        for t in asked.at or np.sort(even if asked.even else drawn).tolist():
            share = float(rng.uniform(*SHARES))
            stops.append(try_section(f"{name}, {t:.4f} s", made, partial(made.hold, t), soonest=True))
            change = partial(made.override, share, t)
            changes.append(try_section(f"{name}, {t:.4f} s, {share:.2f}", made, change, soonest=False))
        print(f"{name}: {len(stops)} instants so far", flush=True)
    summarise("stops", [row for row in stops if row is not None])
    summarise("changes of speed", [row for row in changes if row is not None])


if __name__ == "__main__":
    main()
