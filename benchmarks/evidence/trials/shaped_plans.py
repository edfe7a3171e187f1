"""Plans behind input shapers, held against samples: `python -m benchmarks.evidence.trials.shaped_plans [--plans 20]`.

Preset programs on their machines under each of the four shapers. A row for each plan: the largest share of a limit that
is proved behind the shapers, and that is seen at 10⁵ instants; the tool's deviation from the path, proved and seen; and
what is left of the vibration of a load behind the axes, of the unshaped, at the stated frequency and 10 % beside it.

With `--holds` the plans are stopped: a row for each stop, with the largest share of an axis' limit that is proved and
seen, and how far its pulses are from where its axes ought to be, of their bound. With `--rigs` the loads swing behind
the drives of emulated rigs, cards and pulses included.

Nothing of the proof takes part: axes are convolved here copy by copy, poses come from forward kinematics, the tool's
speed from differences of them.
"""

from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import process_time

import numpy as np

from benchmarks.evidence.flexible_load import FlexibleLoad
from controllers import track
from controllers.rig import assumed_rig
from controllers.rig_choice import choose_rig
from kinematics import Machine, load_machine
from kinematics.foundation.arrays import Array
from kinematics.machine.axis import directional_bounds
from kinematics.machine.pose import Pose, to_numbers
from kinematics.machine.shaper import IMPULSES, Shaper
from planner import Plan, load_program, plan
from planner.interruption.section import Section
from planner.limits import limits_of, usual_order
from planner.limits.tool import ToolSpeed
from planner.path.actuation import MachinePath, actuate
from planner.shaping.keep_limits import solve_shaped
from planner.shaping.shaped_motion import reached_poses, shape_motion
from planner.shaping.shaped_proof import ShapedProof
from planner.timing.certified_solve import certified_solve
from planner.trajectory import Trajectory

PROGRAMS = ("bare-circle", "blended", "tripod-circle", "linkage-line", "arm-line", "traverser-scan")
FREQUENCIES = {"traverser-scan": 8.0}
FREQUENCY, DAMPING = 30.0, 0.05
"""Hz and damping ratio of the mode that is shaped, where nothing else is said."""
MODES = Shaper("zv", 35.0, 0.05), Shaper("mzv", 22.0, 0.1)
"""Of a vibration along x and of one along y, both at once."""
MODES_OF = ("bare-circle", "tripod-circle", "linkage-line", "arm-line")
SAMPLES, BATCH = 100_000, 10_000
HOLDS = 3
"""Of each plan, at random instants."""
SETTLING = 0.2
"""s that the drives are given: their loops of 30 1/s take as long."""
STEP = 2e-4
"""s between the samples of an axis that moves a flexible load; and from which differences are taken, a twentieth."""


@dataclass(frozen=True, slots=True)
class ShapedPlan:
    """A plan behind shapers, and what is proved of it."""

    name: str
    machine: Machine
    path: MachinePath
    order: int
    trajectory: Trajectory
    proof: ShapedProof
    time: float

    @property
    def shaper(self) -> Shaper:
        """That of all axes."""
        found = self.machine.axes[0].shaper
        assert isinstance(found, Shaper)  # as they are made
        return found


def choose_plans(count: int) -> Iterator[tuple[str, Machine, int]]:
    """Programs, machines and orders of so many plans: all shapers in turn, until each program has had each of them.

    Where the machine limits jerk, every other one is without.
    """
    kinds = tuple(IMPULSES)
    for done in range(min(count, len(kinds) * len(PROGRAMS))):
        again, k = divmod(done, len(PROGRAMS))
        name = PROGRAMS[k]
        bare = load_machine(load_program(name).machine or "hexapod")
        shaper = Shaper(kinds[(k + again) % len(kinds)], FREQUENCIES.get(name, FREQUENCY), DAMPING)
        machine = bare.driven_by([replace(axis, shaper=shaper) for axis in bare.axes])
        yield name, machine, max(2, usual_order(machine.axes) - (k + again) % 2)


def make_plans(count: int) -> Iterator[ShapedPlan]:
    """So many, as they are chosen."""
    for name, machine, order in choose_plans(count):
        begun = process_time()
        path = actuate(load_program(name), machine)
        limits = limits_of(path, machine.axes, order)
        solve = partial(certified_solve, path, order=order)
        found, _, proof, _ = solve_shaped(solve, path, limits, machine.axes)
        assert proof is not None  # all axes have shapers
        yield ShapedPlan(name, machine, path, order, found.trajectory, proof, process_time() - begun)


def measure_axes(machine: Machine, order: int, q: Array, rates: Sequence[Array]) -> float:
    """The largest share of an axis' limit on speed, acceleration, jerk (of order 3) or travel that is seen."""
    most = 0.0
    for values, name in zip(rates[:order], ("max_speed", "max_acceleration", "max_jerk"), strict=False):
        for k, axis in enumerate(machine.axes):
            low, high = directional_bounds(getattr(axis, name))
            most = max(most, values[:, k].max() / high, -values[:, k].min() / low)
    for k, axis in enumerate(machine.axes):
        lo, hi = axis.travel
        if np.isfinite(lo):
            most = max(most, np.abs(q[:, k] - machine.home_q[k] - (lo + hi) / 2).max() / ((hi - lo) / 2))
    return most


def measure_stop(made: Plan, held: Section) -> tuple[float, float]:
    """Of a stop, the largest share of an axis' limit that is seen, and how far its pulses are, of their bound.

    A copy of the motion is on the plan up to its own instant of the stop, and on the stop from there on.
    """
    most, off, clock = 0.0, 0.0, held.pulses.clock_hz
    begin, shaper = held.at or 0.0, made.machine.axes[0].shaper
    assert shaper is not None  # as they are chosen
    ticks = np.unique(np.linspace(0, int(held.duration * clock), SAMPLES).astype(np.int64))
    for some in np.array_split(ticks, -(-len(ticks) // BATCH)):
        t, sums = some / clock, np.zeros((4, len(some), len(made.machine.axes)))
        for amplitude, delay in zip(*shaper.impulses, strict=True):
            late = t - delay
            before, after = made.trajectory.at(begin + late), held.trajectory.at(late)
            for row, name in zip(sums, ("q", "qd", "qdd", "qddd"), strict=True):
                row += amplitude * np.where((late < 0)[:, None], getattr(before, name), getattr(after, name))
        q, *rates = sums
        most = max(most, measure_axes(made.machine, made.order, q, rates))
        for k, axis in enumerate(held.pulses.axes):
            away = np.abs(axis.counts(some) - (q[:, k] - axis.home) / axis.pulse)
            tick = np.abs(rates[0][:, k]).max() / (clock * axis.pulse)
            off = max(off, float(away.max()) / (axis.bound + tick))
    return most, off


def convolve(plan: ShapedPlan, t: Array) -> tuple[Array, Array, Array, Array]:
    """q, q̇, q̈, q⃛ (N, n) of the shaped axes at t (N,), copy by copy."""
    amplitudes, times = plan.shaper.impulses
    sums = np.zeros((4, len(t), len(plan.machine.axes)))
    for amplitude, time in zip(amplitudes, times, strict=True):
        state = plan.trajectory.at(t - time)
        for row, values in zip(sums, (state.q, state.qd, state.qdd, state.qddd), strict=True):
            row += amplitude * values
    return sums[0], sums[1], sums[2], sums[3]


def reach(plan: ShapedPlan, t: Array) -> tuple[Pose, Pose]:
    """The poses that the shaped axes reach at t (N,), and those on the path, as late as the shaper makes them."""
    about = plan.trajectory.at(np.clip(t - plan.shaper.delay, 0.0, plan.trajectory.duration)).pose
    assert about is not None  # of a machine's path
    return plan.machine.forward(convolve(plan, t)[0], about, certify=False).pose, about


def tool_place(plan: ShapedPlan, poses: Pose) -> Array:
    """(N, 3) m where the tool is."""
    x = to_numbers(poses)
    return np.asarray((x if plan.path.tool is None else plan.path.tool(x))[:, :3])


def measure(plan: ShapedPlan) -> tuple[float, float]:
    """The largest share of a limit that is seen, and the largest deviation of the tool (m), at 10⁵ instants."""
    most, away = 0.0, 0.0
    caps = ToolSpeed(piece.tool_speed for piece in plan.path.pieces).caps
    duration = plan.trajectory.duration + float(plan.shaper.impulses[1][-1])
    for t in np.array_split(np.linspace(0.0, duration, SAMPLES), -(-SAMPLES // BATCH)):
        q, *rates = convolve(plan, t)
        most = max(most, measure_axes(plan.machine, plan.order, q, rates))
        poses, about = reach(plan, t)
        here = tool_place(plan, poses)
        away = max(away, float(np.linalg.norm(here - tool_place(plan, about), axis=1).max()))
        if np.isfinite(caps).any():
            inside = (t > STEP) & (t < duration - STEP)
            h = STEP / 20
            speed = (tool_place(plan, reach(plan, t + h)[0]) - tool_place(plan, reach(plan, t - h)[0])) / (2 * h)
            on = [
                np.clip(t + d - time, 0.0, plan.trajectory.duration)
                for time in plan.shaper.impulses[1]
                for d in (-h, h)
            ]
            cap = np.max([caps[plan.trajectory.at(own).piece] for own in on], axis=0)
            most = max(most, float((np.linalg.norm(speed, axis=1) / cap)[inside].max()))
        tilt = plan.machine.check(poses).tilt
        most = max(most, float(np.max(tilt, initial=0.0)))
    return most, away


def measure_vibration(plan: ShapedPlan, frequency: float) -> float:
    """The largest vibration left by an axis' load, over the largest that the unshaped motion leaves."""
    load, left = FlexibleLoad(frequency, plan.shaper.damping), []
    length = float(plan.shaper.impulses[1][-1])
    for shaped in (True, False):
        end = plan.trajectory.duration + length * shaped
        t = np.arange(0.0, end + 2 * STEP, STEP)
        q = convolve(plan, t)[0] if shaped else plan.trajectory.at(t).q
        left.append(max(load.residual(q[:, k], STEP, end) for k in range(q.shape[1])))
    return left[0] / left[1]


def swing_on_rig(
    trajectory: Trajectory, machine: Machine, shaper: Shaper, rig: str, play: float | None = None
) -> tuple[Array, Array]:
    """(n,) m that a load behind each axis is left with on a rig under law 1, before and behind the shaper.

    They are measured once the drives have settled. play: of each drive, m; None: the rig's own
    """
    load, left = FlexibleLoad(shaper.frequency, shaper.damping), []
    for own in (None, shaper):
        driven = machine.driven_by([replace(axis, shaper=own) for axis in machine.axes])
        motion = shape_motion(trajectory, driven.axes) or trajectory
        bench = assumed_rig(driven) if rig == "servos" else replace(choose_rig(machine, rig), machine=driven)
        if play is not None:
            bench = replace(bench, drives=tuple(replace(drive, play=play) for drive in bench.drives))
        tracked = track(motion, driven, "1", rig=bench)
        step, end = float(tracked.t[1] - tracked.t[0]), motion.duration + SETTLING
        left.append([load.residual(q, step, end) for q in tracked.actual.T])
    before, behind = np.array(left)
    return before, behind


def solve_circle() -> tuple[Machine, Trajectory]:
    """The hexapod, and its bare circle without jerk limits."""
    machine = load_machine("hexapod")
    path = actuate(load_program("bare-circle"), machine)
    return machine, certified_solve(path, limits_of(path, machine.axes, 2), 2).trajectory


def show_rigs() -> None:
    """What loads are left with on emulated rigs of the hexapod, before and behind a shaper."""
    machine, trajectory = solve_circle()
    print_row("rig", "play (µm)", "shaper", "left before (µm)", "behind (µm)", "of it")
    print_row(*("---" for _ in range(6)))
    for rig, play in (("servos", 0.0), ("hexapod-steppers", 0.0), ("hexapod-steppers", 5e-6)):
        for shaper in (Shaper("zvd", frequency, 0.01) for frequency in (6.0, 12.0)):
            before, behind = swing_on_rig(trajectory, machine, shaper, rig, play)
            most = 1e6 * before.max(), 1e6 * behind.max()
            print_row(rig, 1e6 * play, shaper, *(f"{each:.2f}" for each in most), f"{(behind / before).max():.1%}")


def measure_directions(name: str) -> tuple[float, float]:
    """The share of the vibration left along x and along y, which have shapers of their own, after a program."""
    program, left = load_program(name), []
    machine = load_machine(program.machine or "hexapod")
    for direction, mode in zip(np.eye(3), MODES, strict=False):
        machine = machine.shape_along(direction, mode)
    path = actuate(program, machine)
    limits = limits_of(path, machine.axes, 2)
    found, _, proof, _ = solve_shaped(partial(certified_solve, path, order=2), path, limits, machine.axes)
    assert proof is not None  # axes have shapers
    shaped, bare = proof.motion, found.trajectory
    for k, mode in enumerate(MODES):
        load = FlexibleLoad(mode.frequency, mode.damping)
        t, t_bare = (np.arange(0.0, end + 2 * STEP, STEP) for end in (shaped.duration, bare.duration))
        about = bare.at(t_bare).pose
        assert about is not None  # of a machine's path
        x, x_bare = to_numbers(reached_poses(bare, shaped, t, shaped.at(t).q)), to_numbers(about)
        rest = load.residual(x[:, k], STEP, shaped.duration)
        left.append(rest / load.residual(x_bare[:, k], STEP, bare.duration))
    return left[0], left[1]


def show_holds(count: int) -> None:
    """A row for each stop of so many plans at random instants, and how many are as they are proved."""
    rng, told = np.random.default_rng(23), []
    print_row("program", "order", "shaper", "held at (s)", "proved", "seen", "pulses off, of their bound", "s")
    print_row(*("---" for _ in range(8)))
    for name, machine, order in choose_plans(count):
        made = plan(load_program(name), machine, order=order)
        for t in np.sort(rng.uniform(0, made.duration, HOLDS)).tolist():
            begun = process_time()
            held = made.hold(t)
            took, (seen, off) = process_time() - begun, measure_stop(made, held)
            assert held.shaped is not None  # all axes have shapers
            proved = max(held.shaped.worst.values())
            told.append((held.shaped.holds and held.certificate.holds, seen <= 1 + 1e-9, off <= 1 + 1e-6))
            uses = f"{proved:.7f}", f"{seen:.7f}", f"{off:.4f}"
            print_row(name, order, machine.axes[0].shaper, f"{t:.4f}", *uses, f"{took:.2f}")
    holds, kept, near = (np.sum(each) for each in zip(*told, strict=True))
    print(f"{len(told)} stops, {holds} proved: limits kept by {kept}, pulses within their bound {near}")


def main() -> None:
    """A row for each plan, and the worst of all."""
    parser = ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else None)
    parser.add_argument("--plans", type=int, default=20)
    parser.add_argument("--rigs", action="store_true", help="loads on emulated rigs instead")
    parser.add_argument("--holds", action="store_true", help="stops of the plans instead")
    asked = parser.parse_args()
    if asked.rigs:
        return show_rigs()
    if asked.holds:
        return show_holds(asked.plans)
    count = asked.plans
    heads = ("program", "order", "shaper", "proved", "seen", "deviation ≤ (µm)", "seen (µm)", "left at f", "±10 %", "s")
    print_row(*heads)
    print_row(*("---" for _ in heads))
    kept = held = quiet = 0
    for made in make_plans(count):
        seen, away = measure(made)
        f = made.shaper.frequency
        left, beside = measure_vibration(made, f), max(measure_vibration(made, share * f) for share in (0.9, 1.1))
        proved = max(made.proof.worst.values())
        kept += made.proof.holds and seen <= 1 + 1e-9
        held += away <= made.proof.deviation
        quiet += left <= 0.05
        uses = f"{proved:.7f}", f"{seen:.7f}", f"{1e6 * made.proof.deviation:.3f}", f"{1e6 * away:.3f}"
        shares = f"{100 * left:.2f} %", f"{100 * beside:.1f} %"
        print_row(made.name, made.order, made.shaper, *uses, *shares, f"{made.time:.2f}")
    for name in MODES_OF:
        x, y = measure_directions(name)
        print(f"{name}: modes along x ({MODES[0]}) and y ({MODES[1]}): {100 * x:.3f} % and {100 * y:.3f} % left")
    print(f"{count} plans: limits kept by {kept}, deviations within their bound {held}, at most 5 % left of {quiet}")


def print_row(*cells: object) -> None:
    """A row of a table in Markdown."""
    print(f"| {' | '.join(map(str, cells))} |", flush=True)


if __name__ == "__main__":
    main()
