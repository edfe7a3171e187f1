"""Random machines on random programs, every pulse of them checked: `python -m benchmarks.evidence.trials.pulse_trials`.

`--pulses 1e7` is the full count (minutes on two cores). Each trial follows from its seed alone: a hexapod, a tripod or
a traverser of random geometry, scale, pulse, clock and wiring; drives with timing, screws with errors and play; a
program of lines, arcs, turns and rests; a firing rule. Its motion is planned and certified, its pulses are made and
checked by code that shares nothing with their maker.
"""

from argparse import ArgumentParser
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Axis, Hexapod, Machine, Traverser, Tripod
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import DRIVES
from planner import Arc, Dwell, Line, Program, Turn, plan
from planner.pulses import check

# How often each firing rule is taken; hysteresis in pulses.
RULES = ("nearest",) * 5 + ("floor", "timer", "nearest:hysteresis=0.2")
CLOCKS = (2_000_000, 10_000_000, 100_000_000)
PULSES_PER_REACH = 2e5
"""Pulses of an axis in a tenth of the machine's size, at most."""


@dataclass(frozen=True, slots=True)
class Trial:
    """What became of one: its pulses, and the faults of them; refused: why there is no motion or no schedule."""

    seed: int
    machine: str
    rule: str
    pulses: int = 0
    faults: int = 0
    refused: str = ""


def run_trial(seed: int) -> Trial:
    rng = np.random.default_rng([seed, 11])
    machine, rule = random_machine(rng), str(rng.choice(RULES))
    kind = type(machine).__name__
    try:
        planned = plan(random_program(rng, machine), machine, order=2, clock_hz=int(rng.choice(CLOCKS)), rule=rule)
    except MotionError as no:
        return Trial(seed, kind, rule, refused=str(no))
    verdict = check(planned.pulses, planned.counted, machine.axes, machine.home_q)
    return Trial(seed, kind, rule, planned.pulses.total, verdict.fault_count)


def random_machine(rng: np.random.Generator) -> Machine:
    """A hexapod, a tripod or a traverser between a centimetre and three metres in size."""
    size = 10.0 ** rng.uniform(-2, 0.5)
    kind = rng.integers(3)
    names = [("leg1", "leg2", "leg3", "leg4", "leg5", "leg6"), ("arm1", "arm2", "arm3"), ("X", "Y", "Z", "R")][kind]
    axes = [_axis(rng, name, size) for name in names]
    if kind == 2:
        return Traverser(axes=axes, home=RigidTransform.identity())
    sides = np.repeat(np.arange(3) * 2 * np.pi / 3, 2) if kind == 0 else np.arange(3) * 2 * np.pi / 3
    gap = np.tile([-1.0, 1.0], 3) if kind == 0 else np.zeros(3)
    base = _circle(size, sides + gap * rng.uniform(0.2, 0.4))
    platform = _circle(size * rng.uniform(0.5, 0.8), sides + gap * rng.uniform(0.7, 0.9))
    home = RigidTransform.from_translation([0, 0, size * rng.uniform(1.2, 2.0)])
    return (Hexapod if kind == 0 else Tripod)(base, platform, axes=axes, home=home)


def random_program(rng: np.random.Generator, machine: Machine) -> Program:
    """Up to five segments within a tenth of the machine's size about home, each stopping at its end."""
    size = float(np.linalg.norm(machine.home.translation)) or 0.5
    reach = size * 10.0 ** rng.uniform(-3, -1)
    segments: list[Any] = []
    for _ in range(int(rng.integers(1, 6))):
        what = rng.integers(4)
        if what == 0 and "rz" in machine.freedom:
            angles = rng.uniform(-0.05, 0.05, 3) * ([1, 1, 1] if "rx" in machine.freedom else [0, 0, 10])
            segments.append(Turn(Rotation.from_euler("XYZ", angles)))
        elif what == 1:
            segments.append(Dwell(float(rng.uniform(0.01, 0.2))))
        elif what == 2 and segments and isinstance(segments[-1], Line):
            stands = np.asarray(segments[-1].to, float)
            normal = np.array([0.0, 0.0, 1.0])
            radius = reach * rng.uniform(0.1, 0.5)
            way = rng.uniform(0, 2 * np.pi)
            centre = stands + radius * np.array([np.cos(way), np.sin(way), 0.0])
            segments.append(Arc(centre=centre, normal=normal, angle=float(rng.uniform(-7, 7))))
        else:
            segments.append(Line(to=reach * rng.uniform(-1, 1, 3)))
    if not any(isinstance(segment, (Line, Arc, Turn)) for segment in segments):
        segments.append(Line(to=reach * rng.uniform(-1, 1, 3)))
    return Program(tuple(segments))


def _axis(rng: np.random.Generator, name: str, size: float) -> Axis:
    if name == "R":
        size = 1.0  # rad
    pulse = float(size / 10 / PULSES_PER_REACH * 10.0 ** rng.uniform(0, 2))
    speed = float(size * rng.uniform(0.05, 0.3))
    more: dict[str, Any] = {}
    if rng.random() < 0.3:
        more["timing"] = DRIVES[str(rng.choice(list(DRIVES)))]
    if rng.random() < 0.3:
        ends = size * np.linspace(-0.2, 0.2, 5)
        more["lead_error"] = tuple(zip(ends.tolist(), (1e-3 * size * rng.normal(size=5) / 5).tolist(), strict=True))
        more["backlash"] = float(pulse * rng.uniform(0, 30))
        more["compensate"] = ("lead", "backlash")
        # plenty, so that the play is taken up on the way: with little, most random motions are refused
        more["take_up_acceleration"] = 1e3 * speed
    return Axis(
        name,
        kind="rotary" if name == "R" else "linear",
        travel=(-size, size),
        pulse=pulse,
        direction=1 if rng.random() < 0.5 else -1,
        max_speed=speed,
        max_acceleration=speed * float(rng.uniform(2, 20)),
        **more,
    )


def _circle(radius: float, angles: np.ndarray) -> np.ndarray:
    return radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])


def run_trials(pulses: float, seed: int = 0) -> Iterator[Trial]:
    """Trials from a seed on, until so many pulses have been checked."""
    done = 0
    while done < pulses:
        made = run_trial(seed)
        done, seed = done + made.pulses, seed + 1
        yield made


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--pulses", type=float, default=1e6)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    began, seen = perf_counter(), []
    for one in run_trials(options.pulses, options.seed):
        seen.append(one)
        if one.faults or one.refused:
            print(f"seed {one.seed}, {one.machine}, {one.rule}: {one.refused or f'{one.faults} FAULTS'}", flush=True)
    kinds, rules = (Counter(getattr(one, name) for one in seen if one.pulses) for name in ("machine", "rule"))
    print(f"{sum(one.pulses for one in seen)} pulses of {len(seen)} trials in {perf_counter() - began:.0f} s")
    print(f"faults: {sum(one.faults for one in seen)}; refused: {sum(bool(one.refused) for one in seen)}")
    print(f"machines {dict(kinds)}; rules {dict(rules)}")


if __name__ == "__main__":
    main()
