"""Plans after input shapers, compared with samples.

`--kind plans`  bundled programs on their machines with each of the four shapers: the largest share
                of a limit that is proved after the shapers, and the largest of an axis at 10⁵
                instants; the deviation of the tool, proved and sampled; how much is left of the
                vibration of a load on the axes, at the stated frequency and 10 % from it. No code
                of the proof takes part: axes are convolved copy by copy, poses come from forward
                kinematics.
`--kind rigs`   loads that swing on the drives of emulated rigs, cards and pulses included, law 1
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice, product
from typing import Literal

import numpy as np

from benchmarks.evidence.flexible_load import FlexibleLoad
from benchmarks.evidence.limit_use import measure_rates, measure_travel
from benchmarks.evidence.table import Row, Table
from controllers import track
from controllers.rig import assumed_rig
from controllers.rig_choice import choose_rig
from kinematics import Machine, load_machine
from kinematics.foundation.arrays import Array
from kinematics.machine.pose import Pose, to_numbers
from kinematics.machine.shaper import IMPULSES, Shaper
from planner import Plan, load_program, plan
from planner.limits import usual_order
from planner.shaping.shaped_motion import shape_motion
from planner.trajectory import Trajectory

PROGRAMS = {
    "bare-circle": 30.0,
    "blended": 30.0,
    "tripod-circle": 30.0,
    "linkage-line": 30.0,
    "arm-line": 30.0,
    "traverser-scan": 8.0,
}
"""Programs, with the frequency (Hz) of the vibration that is shaped."""
DAMPING = 0.05
SAMPLES = 100_000
BATCH = 10_000
SETTLING = 0.2
"""s that the drives are given: their loops of 30 1/s take as long."""
STEP = 2e-4
"""s between the samples of an axis that moves a flexible load."""
COLUMNS = (
    "program",
    "order",
    "shaper",
    "proved use",
    "sampled",
    "deviation at most (µm)",
    "sampled (µm)",
    "left at f (%)",
    "±10 % (%)",
)
RIG_COLUMNS = ("rig", "play (µm)", "shaper", "left before (µm)", "after (µm)", "share (%)")


def measure(kind: Literal["plans", "rigs"] = "plans", plans: int = 20) -> Iterator[Table]:
    """Yield a row for each plan, or for each rig and shaper."""
    if kind == "plans":
        yield Table("Plans after shapers", COLUMNS, map(compare, islice(make_plans(), plans)))
    else:
        yield Table("Loads on emulated rigs of the hexapod", RIG_COLUMNS, compare_rigs())


def make_plans() -> Iterator[Plan]:
    """Yield plans of all programs, with all shapers in turn, every other one of order 2."""
    kinds = tuple(IMPULSES)
    for turn, (k, (name, frequency)) in product(range(len(kinds)), enumerate(PROGRAMS.items())):
        program = load_program(name)
        machine = load_machine(program.machine or "hexapod")
        shaper = Shaper(kinds[(k + turn) % len(kinds)], frequency, DAMPING)
        order = max(2, usual_order(machine.axes) - (k + turn) % 2)
        yield plan(program, set_shaper(machine, shaper), order=order)


def set_shaper(machine: Machine, shaper: Shaper | None) -> Machine:
    """Return a machine whose axes all have a shaper."""
    return machine.driven_by([replace(axis, shaper=shaper) for axis in machine.axes])


def compare(planned: Plan) -> Row:
    """Return the row of a plan."""
    shaper = planned.machine.axes[0].shaper
    proof = planned.shaped
    assert isinstance(shaper, Shaper)
    assert proof is not None
    use, deviation = sample(planned, shaper)
    left, *others = (100 * measure_vibration(planned, shaper, share) for share in (1.0, 0.9, 1.1))
    return (
        planned.program.name,
        planned.order,
        str(shaper),
        f"{max(proof.worst.values()):.7f}",
        f"{use:.7f}",
        1e6 * proof.deviation,
        1e6 * deviation,
        left,
        max(others),
    )


def sample(planned: Plan, shaper: Shaper) -> tuple[float, float]:
    """Return the largest share of an axis' limit, and the largest deviation of the tool (m)."""
    use = away = 0.0
    for t in np.array_split(np.linspace(0.0, planned.duration, SAMPLES), max(1, SAMPLES // BATCH)):
        q, *rates = convolve(planned.trajectory, shaper, t)
        use = max(use, measure_rates(planned.machine, planned.order, rates))
        use = max(use, measure_travel(planned.machine, q))
        late = np.clip(t - shaper.delay, 0.0, planned.trajectory.duration)
        pose = planned.trajectory.at(late).pose
        assert pose is not None
        shaped = planned.machine.forward(q, pose, certify=False).pose
        way = find_tool(planned, shaped) - find_tool(planned, pose)
        away = max(away, float(np.linalg.norm(way, axis=1).max()))
    return use, away


def convolve(trajectory: Trajectory, shaper: Shaper, t: Array) -> Array:
    """Return q, q̇, q̈, q⃛ (4, N, n) of the shaped axes at t (N,), copy by copy."""
    copies = zip(*shaper.impulses, strict=True)
    states = ((amplitude, trajectory.at(t - delay)) for amplitude, delay in copies)
    terms = (amplitude * np.stack([s.q, s.qd, s.qdd, s.qddd]) for amplitude, s in states)
    return np.asarray(sum(terms))


def find_tool(planned: Plan, poses: Pose) -> Array:
    """Return where the tool is, (N, 3) m."""
    x = to_numbers(poses)
    return np.asarray(x if planned.path.tool is None else planned.path.tool(x))[:, :3]


def measure_vibration(planned: Plan, shaper: Shaper, share: float) -> float:
    """Return the share of the vibration left, at a share of the shaper's frequency."""
    load = FlexibleLoad(share * shaper.frequency, shaper.damping)
    bare = planned.trajectory
    shaped = swing(load, lambda t: convolve(bare, shaper, t)[0], planned.duration)
    return float(shaped.max() / swing(load, lambda t: bare.at(t).q, bare.duration).max())


def swing(load: FlexibleLoad, find_axes: Callable[[Array], Array], end: float) -> Array:
    """Return the vibration (n,) that is left on each axis from `end` (s) on."""
    t = np.arange(0.0, end + 2 * STEP, STEP)
    return np.array([load.residual(q, STEP, end) for q in find_axes(t).T])


def compare_rigs() -> Iterator[Row]:
    """Yield a row for each rig and shaper."""
    circle = plan(load_program("bare-circle"), load_machine("hexapod"), order=2)
    rigs = (("servos", 0.0), ("hexapod-steppers", 0.0), ("hexapod-steppers", 5e-6))
    for (rig, play), frequency in product(rigs, (6.0, 12.0)):
        shaper = Shaper("zvd", frequency, 0.01)
        before, after = swing_on_rig(circle, shaper, rig, play)
        yield (
            rig,
            1e6 * play,
            str(shaper),
            1e6 * before.max(),
            1e6 * after.max(),
            100 * (after / before).max(),
        )


def swing_on_rig(planned: Plan, shaper: Shaper, rig: str, play: float) -> tuple[Array, Array]:
    """Return (n,) m that a load on each axis of a rig is left with, without the shaper and with it.

    They are measured when the drives have settled. play: of each drive, m
    """
    load = FlexibleLoad(shaper.frequency, shaper.damping)
    left = []
    for chosen in (None, shaper):
        machine = set_shaper(planned.machine, chosen)
        motion = shape_motion(planned.trajectory, machine.axes) or planned.trajectory
        bench = assumed_rig(machine) if rig == "servos" else choose_rig(planned.machine, rig)
        drives = tuple(replace(drive, play=play) for drive in bench.drives)
        tracked = track(motion, machine, "1", rig=replace(bench, machine=machine, drives=drives))
        step = float(tracked.t[1] - tracked.t[0])
        end = motion.duration + SETTLING
        left.append(np.array([load.residual(q, step, end) for q in tracked.actual.T]))
    return left[0], left[1]
