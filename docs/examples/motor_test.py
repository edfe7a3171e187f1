"""The test program of [Sahbaz 2007, Figure 7.7], rebuilt: one servo motor on a PCI-8132, every motion, open loop.

    python motor_test.py "0 T-constant speed=10 tacc=0.2" "1 stop tdec=0.1" "2 T-absolute position=0 speed=20 tacc=0.1"

Each line: when (s), what, and the boxes of that motion, as the program on the screen had them; a box that a motion does
not have is locked. position is in degrees of the gear's output shaft, or in metres round a wheel on it if `radius` (m)
stands too; speeds and the velocity intervals of S-curves are in rev/min of the output shaft, times in s.
"""

import sys
from math import pi

import numpy as np

from controllers import load_rig
from controllers.card import (
    PCI_8132,
    Command,
    DStop,
    SAMove,
    SRMove,
    SVMove,
    TAMove,
    TRMove,
    TVMove,
    VChange,
    at_rest,
    current_speed,
    play,
)
from controllers.simulate import bank
from kinematics import MotionError

GEAR, COUNTS = 74, 2048
DEGREE, RPM = COUNTS * GEAR / 360, COUNTS * GEAR / 60
"""Pulses per degree, and pulses/s per rev/min, of the output shaft [Sahbaz 2007, equations 7.1 and 7.3]."""
CARD = PCI_8132
RAMPS = ("start", "speed", "tacc", "tdec")
MOTIONS = {
    "T-constant": (TVMove, ("start", "speed", "tacc")),
    "S-constant": (SVMove, ("start", "speed", "tacc", "curve")),
    "T-relative": (TRMove, ("position", *RAMPS)),
    "T-absolute": (TAMove, ("position", *RAMPS)),
    "S-relative": (SRMove, ("position", *RAMPS, "curve", "curve_dec")),
    "S-absolute": (SAMove, ("position", *RAMPS, "curve", "curve_dec")),
    "change-speed": (VChange, ("speed", "tacc")),
    "stop": (DStop, ("tdec",)),
}
"""Interpolation is the card's too, but takes two motors."""


def command(line: str) -> tuple[float, Command]:
    """When, and what: a line of the program."""
    when, name, *boxes = line.split()
    if name not in MOTIONS:
        raise MotionError(f"{line!r}: no motion {name!r}; motions: {', '.join(MOTIONS)}")
    kind, own = MOTIONS[name]
    values = {box: float(value) for box, value in (text.split("=") for text in boxes)}
    if locked := values.keys() - {*own, *(("radius",) if "position" in own else ())}:
        raise MotionError(
            f"{line!r}: {', '.join(sorted(locked))} is locked for {name}; its boxes: {', '.join(own)}"
        )
    return float(when), kind(*(pulses(box, values) for box in own))


def pulses(box: str, values: dict[str, float]) -> float | list[float]:
    """A box's value as the card takes it: pulses, pulses/s, or s."""
    value = values.get(box, 0.0)
    if box == "position":  # p = 2048/360 · n · θ, or 2048/(2π r) · n · x
        return [
            value * COUNTS * GEAR / (2 * pi * values["radius"])
            if "radius" in values
            else value * DEGREE
        ]
    if box in ("start", "speed"):
        return [value * RPM]
    return value * RPM if box.startswith("curve") else value


def main(lines: list[str]) -> None:
    sent = [command(line) for line in lines]
    until = sent[-1][0] + 5.0
    record = play(CARD, at_rest([0]), sent, until)
    servo = load_rig("servo-rig").drives[:1]
    pulse = np.deg2rad(1 / DEGREE)
    axes = bank([servo])
    t = np.arange(0.0, until, axes.sample)
    counts = np.rint(record.position(t))[:, None]
    response, _ = axes.run(axes.standing(counts[0] * pulse), counts * pulse, np.arange(len(t)))
    motor = response.reading[:, 0, 0] / pulse / DEGREE
    print("t [s]   card [deg]   motor [deg]   card [rev/min]")
    for at in [*(t for t, _ in sent[1:]), t[-1]]:
        n = min(int(np.searchsorted(t, at)), len(t) - 1)
        # as it is just before the next command
        state = record.states[int(np.searchsorted(record.since, t[n], side="left")) - 1]
        rate = current_speed(CARD, state, t[n])[0] / RPM
        print(f"{at:5.2f} {counts[n, 0, 0] / DEGREE:12.3f} {motor[n]:13.3f} {rate:16.3f}")
    print(f"{len(record.train(0).ticks)} pulses; the motor is at most "
          f"{np.abs(motor - counts[:, 0, 0] / DEGREE).max():.3f} deg behind the card")  # fmt: skip


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except MotionError as refusal:
        sys.exit(f"{refusal}")
