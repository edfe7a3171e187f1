"""Random machines on random programs, whose pulses are all checked.

`--pulses 1e7` is the full count (minutes on two cores). Each trial follows from its seed alone: a
hexapod, a tripod or a traverser of random geometry, scale, pulse, clock and wiring; drives with
timing, screws with errors and play; a program of lines, arcs, turns and rests; a firing rule. Its
motion is planned and certified. Its pulses are checked by code that shares none with the generator.
"""

from collections import Counter
from collections.abc import Iterator
from itertools import count
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks.evidence.table import Table
from kinematics import Axis, Hexapod, Machine, Traverser, Tripod
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import DRIVES
from planner import Arc, Dwell, Line, Program, Turn, plan
from planner.pulses import check

# How often each firing rule is taken; hysteresis in pulses.
RULES = ("nearest",) * 5 + ("floor", "timer", "nearest:hysteresis=0.2")
CLOCKS = (2_000_000, 10_000_000, 100_000_000)
PULSES_PER_REACH = 2e5
"""Pulses of an axis in a tenth of the machine's size, at most."""

Trial = tuple[str, str, int, str]
"""Machine, rule, number of pulses, and the fault, if there is one."""


def measure(pulses: float = 1e6) -> Iterator[Table]:
    """Yield the numbers of pulses of each kind of machine by each rule, and the faults."""
    trials = list(run_trials(pulses))
    numbers: Counter[tuple[str, str]] = Counter()
    for machine, rule, fired, _ in trials:
        numbers[machine, rule] += fired
    title = f"{numbers.total()} pulses of {len(trials)} trials"
    rows = [(*key, number) for key, number in numbers.items()]
    yield Table(title, ("machine", "rule", "pulses"), rows)
    faults = [(seed, *trial) for seed, trial in enumerate(trials) if trial[3]]
    if faults:
        yield Table("Refused or at fault", ("seed", "machine", "rule", "pulses", "reason"), faults)


def run_trials(pulses: float) -> Iterator[Trial]:
    """Yield trials until this number of pulses has been checked."""
    checked = 0
    for seed in count():
        trial = run_trial(seed)
        yield trial
        checked += trial[2]
        if checked >= pulses:
            return


def run_trial(seed: int) -> Trial:
    """Plan a random program on a random machine, and check its pulses."""
    rng = np.random.default_rng([seed, 11])
    machine = random_machine(rng)
    rule = str(rng.choice(RULES))
    name = type(machine).__name__
    program = random_program(rng, machine)
    try:
        planned = plan(program, machine, order=2, clock_hz=int(rng.choice(CLOCKS)), rule=rule)
    except MotionError as error:
        return name, rule, 0, str(error)
    verdict = check(planned.pulses, planned.counted, machine.axes, machine.home_q)
    fault = f"{verdict.fault_count} faults" if verdict.fault_count else ""
    return name, rule, planned.pulses.total, fault


def random_machine(rng: np.random.Generator) -> Machine:
    """Draw a hexapod, a tripod or a traverser between a centimetre and three metres in size."""
    size = 10.0 ** rng.uniform(-2, 0.5)
    kind = rng.integers(3)
    if kind == 2:
        axes = [random_axis(rng, name, size) for name in "XYZR"]
        return Traverser(axes=axes, home=RigidTransform.identity())
    legs = 6 if kind == 0 else 3
    axes = [random_axis(rng, f"leg{number}", size) for number in range(legs)]
    # pairs of legs on the hexapod
    middles = np.repeat(np.arange(3) * 2 * np.pi / 3, legs // 3)
    apart = np.tile([-1.0, 1.0], 3) if legs == 6 else np.zeros(3)
    base = place_joints(size, middles + apart * rng.uniform(0.2, 0.4))
    platform = place_joints(size * rng.uniform(0.5, 0.8), middles + apart * rng.uniform(0.7, 0.9))
    home = RigidTransform.from_translation([0, 0, size * rng.uniform(1.2, 2.0)])
    return (Hexapod if legs == 6 else Tripod)(base, platform, axes=axes, home=home)


def place_joints(radius: float, angles: Array) -> Array:
    """Return points (N, 3) on a circle."""
    return radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])


def random_axis(rng: np.random.Generator, name: str, size: float) -> Axis:
    """Draw an axis, which may have a drive with timing, and a screw with errors and play."""
    rotary = name == "R"
    size = 1.0 if rotary else size  # rad
    pulse = float(size / 10 / PULSES_PER_REACH * 10.0 ** rng.uniform(0, 2))
    speed = float(size * rng.uniform(0.05, 0.3))
    more: dict[str, Any] = {}
    if rng.random() < 0.3:
        more["timing"] = DRIVES[str(rng.choice(list(DRIVES)))]
    if rng.random() < 0.3:
        errors = 1e-3 * size * rng.normal(size=5) / 5
        more["lead_error"] = tuple(zip(size * np.linspace(-0.2, 0.2, 5), errors, strict=True))
        more["backlash"] = float(pulse * rng.uniform(0, 30))
        more["compensate"] = ("lead", "backlash")
        # with little, play is not taken up on the way, and most random motions are refused
        more["take_up_acceleration"] = 1e3 * speed
    return Axis(
        name,
        kind="rotary" if rotary else "linear",
        travel=(-size, size),
        pulse=pulse,
        direction=1 if rng.random() < 0.5 else -1,
        max_speed=speed,
        max_acceleration=speed * float(rng.uniform(2, 20)),
        **more,
    )


def random_program(rng: np.random.Generator, machine: Machine) -> Program:
    """Draw up to five segments near home, each with a stop at its end."""
    size = float(np.linalg.norm(machine.home.translation)) or 0.5
    reach = size * 10.0 ** rng.uniform(-3, -1)
    segments: list[Any] = []
    for _ in range(int(rng.integers(1, 6))):
        what = rng.integers(4)
        if what == 0 and "rz" in machine.freedom:
            free = [1, 1, 1] if "rx" in machine.freedom else [0, 0, 10]
            angles = rng.uniform(-0.05, 0.05, 3) * free
            segments.append(Turn(Rotation.from_euler("XYZ", angles)))
        elif what == 1:
            segments.append(Dwell(float(rng.uniform(0.01, 0.2))))
        elif what == 2 and segments and isinstance(segments[-1], Line):
            radius = reach * rng.uniform(0.1, 0.5)
            way = rng.uniform(0, 2 * np.pi)
            offset = radius * np.array([np.cos(way), np.sin(way), 0.0])
            normal = np.array([0.0, 0.0, 1.0])
            centre = np.asarray(segments[-1].to) + offset
            segments.append(Arc(centre, normal, float(rng.uniform(-7, 7))))
        else:
            segments.append(Line(to=reach * rng.uniform(-1, 1, 3)))
    if all(isinstance(segment, Dwell) for segment in segments):
        segments.append(Line(to=reach * rng.uniform(-1, 1, 3)))
    return Program(tuple(segments))
