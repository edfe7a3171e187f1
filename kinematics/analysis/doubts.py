"""Doubts about a machine's file: statements that are possible, but more likely mistakes.

Each threshold has a physical reason, and no bundled machine comes near one.
"""

from collections.abc import Iterator
from math import degrees, isfinite

from kinematics.kinds.hexapod import Hexapod
from kinematics.kinds.leg_lengths import find_swapped_legs
from kinematics.machine.axis import Axis, directional_bounds
from kinematics.machine.machine import Machine

# Travels that an axis would need to attain its stated speed from rest, and to stop again. Many axes
# cannot attain theirs within one travel. Ten travels allow three times the speed that one allows.
MOST_TRAVELS = 10.0
# Pulses in the travel of an axis: fewer make steps that can be seen.
LEAST_PULSES = 1000


def find_doubts(machine: Machine) -> tuple[str, ...]:
    """Return the doubts about a machine: a line each, with its remedy; those of equal axes once."""
    lines: dict[str, list[str]] = {}
    for axis in machine.axes:
        for doubt in _doubt_axis(axis):
            lines.setdefault(doubt, []).append(axis.name)
    texts = [f"{', '.join(names)}: {doubt}" for doubt, names in lines.items()]
    swapped = find_swapped_legs(machine) if isinstance(machine, Hexapod) else ""
    return (*texts, swapped) if swapped else tuple(texts)


def _doubt_axis(axis: Axis) -> Iterator[str]:
    unit, scale = ("deg", degrees(1.0)) if axis.rotary else ("mm", 1e3)
    travel = axis.travel[1] - axis.travel[0]
    speed = min(directional_bounds(axis.max_speed))
    acceleration = max(directional_bounds(axis.max_acceleration))
    way = speed**2 / acceleration if isfinite(speed) and isfinite(acceleration) else 0.0
    stated = f"max_speed {scale * speed:.6g} {unit}/s"
    remedy = "check the units of both limits"
    if way > MOST_TRAVELS * travel:
        yield (
            f"{stated} takes {scale * way:.3g} {unit} to attain and to stop from "
            f"at max_acceleration, and the travel is {scale * travel:.6g} {unit}: {remedy}"
        )
    if 0 < way / 2 < axis.pulse:
        yield f"{stated} is attained within one pulse at max_acceleration: {remedy}"
    if axis.pulse > travel / LEAST_PULSES:
        yield (
            f"the travel of {scale * travel:.6g} {unit} has {travel / axis.pulse:.3g} pulses "
            f"of {scale * axis.pulse:.6g} {unit}: check the unit of pulse or drive"
        )
