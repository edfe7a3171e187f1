"""Legs by their shortest and longest length, as tables of joint coordinates state them.

The length of leg i at home, L_i(z) = √(d_i² + (z + c_i)²), is a function of the height z of home:
d_i is the horizontal distance between its joints, and c_i the height of its platform joint minus
that of its base joint at z = 0. From it follow the heights at which all legs fit.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import AfterValidator

from kinematics.files.keys import key
from kinematics.foundation.errors import BadValue
from kinematics.foundation.units import Unit, describe
from kinematics.kinds.axis_keys import TRAVEL_KEYS, LinearAxis, check_range

if TYPE_CHECKING:
    from kinematics.kinds.legged import Legged

HOME_TOLERANCE = 1e-9
"""Excess of a leg's length at home, m, that is rounding."""
FAR_JOINTS = 2.0
"""Radii between platform joints and the platform's origin that suggest the base frame."""
LENGTH_DECIMALS = 6
"""Decimals in mm that a proposed height may have; the fewest that fit are taken."""

# The legs of a symmetric machine are equally long at home. Two rows are suspected to be swapped if
# the lengths differ by more than this share, and to exchange them makes the differences this many
# times smaller. On random symmetric geometries with errors of 0.1 % of their radius this names the
# pair of 596 of 600 swaps, and none without a swap (tests/kinematics/analysis/test_doubts.py).
UNEQUAL_LENGTHS = 0.01
EQUALIZED = 4.0

LegLength = Annotated[float, Unit("m", above=0, plain="length", unit_written=True)]


class LegAxis(LinearAxis):
    """The table of a leg: a linear axis whose travel may also be stated by its lengths."""

    leg_length: Annotated[tuple[LegLength, LegLength], AfterValidator(check_range)] | None = key(
        "shortest and longest leg, between the centres of its joints",
        '["250 mm", "300 mm"]',
        None,
        instead=["travel"],
    )


def refuse_unreachable_home(
    machine: Legged,
    common: LegAxis,
    single: Mapping[str, LegAxis],
) -> None:
    """Raise BadValue for a home pose at which a leg is shorter or longer than its `leg_length`.

    common, single  tables of all legs, and of single legs by their names
    """
    excess: dict[int, float] = {}
    for n, axis in enumerate(machine.axes):
        table = single.get(axis.name, common)
        stated = table if TRAVEL_KEYS & table.model_fields_set else common
        beyond = max(axis.travel[0], -axis.travel[1])
        if stated.leg_length and beyond > HOME_TOLERANCE:
            excess[n] = beyond
    if not excess:
        return
    worst = max(excess, key=lambda n: excess[n])
    axis, length = machine.axes[worst], machine.home_q[worst]
    shortest, longest = (describe(length + end, "mm") for end in axis.travel)
    raise BadValue(
        f"machine {machine.name}: {len(excess)} of {machine.legs} legs do not reach home: "
        f"{axis.name} is {describe(length, 'mm')} long there, and its leg_length is "
        f"{shortest} to {longest}; "
        f"{_suspect_order(machine, len(excess))}{_suggest_height(machine)}{_suspect_frame(machine)}",
        key=("home",),
    )


def find_swapped_legs(machine: Legged) -> str:
    """Return a message that names two legs whose joints are likely swapped; "" for none."""
    home = machine.home_numbers[0]
    ends = home[:3] + machine.platform @ home[3:].reshape(3, 3).T
    between = np.linalg.norm(ends[None] - machine.base[:, None], axis=2)
    lengths = between.diagonal()
    spread = np.ptp(lengths)
    if spread < UNEQUAL_LENGTHS * lengths.mean():
        return ""
    for one, other in combinations(range(machine.legs), 2):
        exchanged = lengths.copy()
        exchanged[[one, other]] = between[one, other], between[other, one]
        if np.ptp(exchanged) < spread / EQUALIZED:
            first, second = (machine.axes[leg].name for leg in (one, other))
            stated = [describe(length, "mm") for length in (lengths[one], lengths[other])]
            extremes = [describe(length, "mm") for length in (exchanged.min(), exchanged.max())]
            return (
                f"{first} and {second} are {stated[0]} and {stated[1]} long at home. With their "
                f"platform joints exchanged, all legs would be {extremes[0]} to {extremes[1]} long: "
                "check whether their rows are swapped in one of the lists"
            )
    return ""


def _suspect_order(machine: Legged, count: int) -> str:
    """Return a remedy if some legs reach home: a wrong height would leave out all alike."""
    if count == machine.legs:
        return ""
    order = "two rows may be swapped, so check the order of the legs first"
    return f"the others do: {find_swapped_legs(machine) or order}; else "


def _suggest_height(machine: Legged) -> str:
    """Return a remedy: the heights of home at which all legs fit, or what else may be wrong."""
    between = machine.home.rotation.apply(np.array(machine.platform)) - machine.base
    aside = np.hypot(*(between + machine.home.translation)[:, :2].T)
    lengths = machine.home_q[:, None] + np.array([axis.travel for axis in machine.axes])
    nothing = "no z of home.to changes that: check the units, and the order of the legs"
    if (lengths[:, 1] <= aside).any():
        return nothing

    lowest, highest = np.sqrt(np.maximum(lengths**2 - aside[:, None] ** 2, 0.0)).T
    above = (lowest - between[:, 2]).max(), (highest - between[:, 2]).min()
    below = (-highest - between[:, 2]).max(), (-lowest - between[:, 2]).min()
    height = machine.home.translation[2]
    hangs = height < 0 or (height == 0 and machine.base_rest[:, 2].sum() < 0)
    sides = (below, above) if hangs else (above, below)
    ranges = [(low, high) for low, high in sides if low < high]
    if not ranges:
        return nothing

    low, high = ranges[0]
    middle = 500 * (low + high)  # mm
    rounded = [round(middle, decimals) for decimals in range(LENGTH_DECIMALS)]
    proposed = next((each for each in rounded if low < each / 1e3 < high), middle)
    span = f"between {describe(low, 'mm')} and {describe(high, 'mm')}"
    return f"give home.to a z {span}, such as {proposed:.9g} mm, or check the units"


def _suspect_frame(machine: Legged) -> str:
    """Return a remedy if the platform joints may be in the base frame; else nothing."""
    centre = machine.platform.mean(0)
    radius = np.linalg.norm(machine.platform - centre, axis=1).max()
    away = float(np.linalg.norm(centre))
    if away <= FAR_JOINTS * radius:
        return ""
    return (
        f"; platform_joints are {describe(away, 'mm')} from the platform's origin: "
        "if they are in the base frame, state them in the platform's own"
    )
