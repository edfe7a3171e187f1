"""A rig: a machine, the drives behind its axes, the card that pulses them, the host that commands,
and its tasks.

Of the host: when it begins its steps, what it reads a speed from, and how it ends. A task is a
motion and how often the host commands: a path run by one classical profile of a stated duration,
sines of single axes, or positions over time from a file (controllers.reference_file).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np

from controllers.card import PCI_8132, Card
from controllers.drives.servo import Servo, leg_servo
from controllers.drives.stepper import Stepper
from kinematics.foundation.arrays import Array, freeze_array, freeze_fields
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun, nearest
from kinematics.foundation.options import check_arguments, check_fields
from kinematics.foundation.short_repr import short_repr
from kinematics.machine.machine import Machine

if TYPE_CHECKING:
    from planner.path.actuation import MachinePath
    from planner.pulses.motion import AxesMotion
    from planner.trajectory import Trajectory

Timer = Literal["counter", "sleep"]
"""How a host waits for its next step; a law says which it is meant for."""


@dataclass(frozen=True, slots=True)
class Task:
    """A motion to be tracked.

    motion  axis positions over time; where it is a `Trajectory` on a machine's path, errors in
            space are known too
    dt      s between the host's commands
    """

    name: str
    motion: AxesMotion
    dt: float


def time_path(path: MachinePath, shape: str, share: float, duration: float) -> Trajectory:
    """The path within `duration` seconds: between two stops one profile, its time in proportion to
    its length.

    share  of the time of each profile that a ramp lasts, up to 1/2
    No limit of the machine is looked at: the rig is told when to be where, as by [Sahbaz 2007].
    """
    from planner.baselines.shapes import quarter_sine, trapezoid
    from planner.timing.profile import Profile

    if not 0 < share <= 0.5:
        raise MotionError(
            f"a ramp of {share * duration:g} s does not fit twice into {duration:g} s; shorten it"
        )
    if path.dwells.any():
        raise MotionError(
            "a task's program has no dwells: its profile runs from end to end; omit them"
        )
    unit = {"quarter-sine": quarter_sine, "trapezoid": trapezoid}[shape](share)
    stops = np.flatnonzero(path.stops(2))
    profiles = []
    for a, b in pairwise(stops.tolist()):
        breaks = path.breaks[a : b + 1]
        profiles.append(
            unit.stretch(
                breaks, a, duration * float(breaks[-1] - breaks[0]) / float(path.breaks[-1])
            )
        )
    return Profile.joined(profiles).along(path)


@dataclass(frozen=True, slots=True)
class MotionSample:
    """q, q̇, q̈, q⃛ (N, n) of axes, and the parameter s (N,) of their motion: the angle of a sine,
    or the time.
    """

    s: Array
    q: Array
    qd: Array
    qdd: Array
    qddd: Array


@dataclass(frozen=True, slots=True)
class Sine:
    """q = home + A sin(ω t) for `duration` seconds, at rest before and after: it starts at speed A
    ω at once.

    home, amplitude  (n,) rad or m;  omega  rad/s
    """

    home: Array
    amplitude: Array
    omega: float
    duration: float

    def __post_init__(self) -> None:
        freeze_fields(self, "home", "amplitude", dtype=np.float64)

    @property
    def knots(self) -> Array:
        return freeze_array([0.0, self.duration])

    def at(self, t: Array, /) -> MotionSample:
        t = np.atleast_1d(np.asarray(t, float))
        angle = self.omega * np.clip(t, 0.0, self.duration)
        moving = ((t >= 0) & (t <= self.duration)).astype(float)
        a = self.amplitude
        q, qd, qdd, qddd = (
            np.multiply.outer(of, a * self.omega**n)
            for n, of in enumerate(
                (
                    np.sin(angle),
                    moving * np.cos(angle),
                    -moving * np.sin(angle),
                    -moving * np.cos(angle),
                )
            )
        )
        return MotionSample(angle, self.home + q, qd, qdd, qddd)


@dataclass(frozen=True, slots=True)
class Host:
    """How the host waits until its next step, what it reads, and how it ends.

    timer         "counter": the host polls the card's counter, so step k begins at k·dt, unless the
                  law requires "sleep". "sleep": for every law, the host calls sleep(dt) of the
                  operating system and continues at the first tick of the system's timer after dt,
                  plus the jitter. Delays accumulate.
    granularity   period of the system's timer, s; its phase is random. 0: a timer without ticks
    jitter        largest delay of each waking, s; delays are uniformly distributed from 0
    seed          seed of the random numbers
    speed_from    source of the speed v(k − 1) in a law's feedback: "encoder", the change of the
                  encoders over the last step; "card", the output rate of the card at its end, see
                  `Card.current_speed`. The program of [Sahbaz 2007, Appendix E] reads the rate
                  (`GetCurrentSpeed`)
    closing_stop  duration of the decelerated stop that is sent at the last sample, s; 0.001 in the
                  same program (`SDStop` in its last routine). None: the law continues, so that it
                  may settle
    """

    timer: Timer = "counter"
    granularity: float = 0.0
    jitter: float = 0.0
    seed: int = 0
    speed_from: Literal["encoder", "card"] = "encoder"
    closing_stop: float | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        for name in ("granularity", "jitter"):
            value = getattr(self, name)
            if not 0 <= value < float("inf"):
                raise MotionError(f"host: {name} {value} s must be zero or more")
        if self.seed < 0:
            raise MotionError(f"host: seed {self.seed} must be zero or more")
        if self.closing_stop is not None and not 0 <= self.closing_stop < float("inf"):
            raise MotionError(f"host: closing stop {self.closing_stop} s must be zero or more")

    def draws(self, asked: Timer) -> bool:
        """Return whether a run draws random numbers, under a law that asks for a timer."""
        return "sleep" in (self.timer, asked) and (self.granularity > 0 or self.jitter > 0)


def instants(hosts: Sequence[Host], asked: Timer, dt: float, steps: int) -> Array:
    """s at which steps 0 … steps begin under a law that asks for a timer, (steps + 1, B); by each
    host's own seed.

    counter: t(k) = k dt.  sleep, of ticks g apart with phase φ: t(k+1) = φ + g ⌈(t(k) + dt − φ)/g⌉
                           + jitter · u(k),
    u even in [0, 1); the work of a step takes no time.
    """
    out = np.empty((steps + 1, len(hosts)))
    for b, host in enumerate(hosts):
        out[:, b] = np.arange(steps + 1) * dt
        if "sleep" in (host.timer, asked):
            random = np.random.default_rng(host.seed)
            g, phase = host.granularity, random.random() * host.granularity
            late = random.random(steps) * host.jitter
            t = 0.0
            for k in range(steps):
                wanted = t + dt
                # a waking that falls on a tick is that tick's, whatever the rounding
                tick = phase + g * np.ceil((wanted - phase) / g - 1e-9) if g else wanted
                t = out[k + 1, b] = tick + late[k]
    return freeze_array(out)


Drive = Servo | Stepper


@dataclass(frozen=True, slots=True)
class Rig:
    """The test bench for tracking laws: machine, motion card, host, drives and tasks, as data.

    drives  one per axis of the machine
    card    one model; as many cards of it as the axes need
    host    when the law is asked
    tasks   what the rig is asked to do
    """

    __repr__ = short_repr

    machine: Machine
    drives: tuple[Drive, ...]
    card: Card = PCI_8132
    host: Host = field(default_factory=Host)
    name: str = "rig"
    tasks: tuple[Task, ...] = ()

    def __post_init__(self) -> None:
        for name in ("drives", "tasks"):
            if isinstance(given := getattr(self, name), list):
                object.__setattr__(self, name, tuple(given))
        check_fields(self, "machine")
        if not hasattr(self.machine, "axes"):
            raise MotionError(
                f"rig: machine is {self.machine!r:.60}; expected a machine, as load_machine gives it"
            )
        if len(self.drives) != len(self.machine.axes):
            raise MotionError(
                f"rig: {count_noun(len(self.drives), 'drive')} for the "
                f"{count_noun(len(self.machine.axes), 'axis')} of machine {self.machine.name}"
            )

    @property
    def about(self) -> str:
        """Name, drives and card: "hexapod-steppers: 6 steppers, card PCI-8132"."""
        kinds = [type(drive).__name__.lower() for drive in self.drives]
        drives = ", ".join(f"{kinds.count(kind)} {kind}s" for kind in dict.fromkeys(kinds))
        return f"{self.name}: {drives}, card {self.card.name}"

    @check_arguments()
    def task(self, name: str) -> Task:
        """The task of a name. Raises MotionError with the nearest and all known ones."""
        known = {task.name: task for task in self.tasks}
        if name not in known:
            told = ", ".join(known) or "none"
            raise MotionError(
                f'rig {self.name} has no task "{name}"{nearest(name, known)}; tasks: {told}'
            )
        return known[name]


def assumed_rig(machine: Machine) -> Rig:
    """Return a rig with `leg_servo` on every axis: an assumption, for callers that ask for it by
    this name.
    """
    return Rig(machine, tuple(leg_servo(axis) for axis in machine.axes), name="assumed servos")


def disturb_rig(rig: Rig, *, inertia: float = 1.0, friction: float = 1.0) -> Rig:
    """The same rig with other true inertias and frictions (factors), which its drives know nothing
    of.
    """

    return replace(rig, drives=tuple(drive.disturb(inertia, friction) for drive in rig.drives))
