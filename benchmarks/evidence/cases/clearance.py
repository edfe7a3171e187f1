"""Smallest clearance of the legs with joint gaps of 20° and 30°: why the thesis chose 30°.

The final design: legs against each other at the ends of travel, where the thesis observed its
parts, and over the whole travel, with joints up to the program's limit of tilt (35°) and the data
sheet's (45°). [Sahbaz 2007, chapter 4] prints no dimension of a leg: the two radii are assumptions.
They are those of the round bars that fit into the actuator's body, 43 mm square in its data sheet,
and around it. Between two spherical joints a leg can turn about its axis, so the outer one counts.
A gap of 20° was given up because of collisions, 30° was built. Below zero, legs overlap.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np

from benchmarks.evidence.table import Row, Table
from kinematics import Hexapod, load_machine
from kinematics.foundation.arrays import Array
from kinematics.kinds.hexapod import joint_circle

# Assumption: half the side and half the diagonal of the actuator's body (m).
INNER, OUTER = 0.0215, 0.0304


def measure(count: int = 40_000) -> Iterator[Table]:
    """Yield the clearances; `count` random lengths sample the travel."""
    columns = (
        "gap (°)",
        "tilt up to (°)",
        "where",
        "poses",
        "clearance, outer radius (mm)",
        "clearance, inner radius (mm)",
        "nearest legs",
    )
    yield Table("Smallest clearance of two legs", columns, measure_gaps(count))


def measure_gaps(count: int) -> Iterator[Row]:
    """Yield the rows: each gap, limit of tilt and set of lengths."""
    for gap, tilt in product((20, 30), (35, 45)):
        machine = hexapod_with_gap(gap, tilt)
        low, high = np.array([axis.travel for axis in machine.axes]).T
        samples = np.random.default_rng(0).uniform(low, high, (count, 6))
        for where, q in (("ends", travel_corners(machine)), ("all", machine.home_q + samples)):
            clearance, legs, poses = find_nearest_legs(machine, q)
            inner = clearance + 2 * (OUTER - INNER)
            yield [gap, tilt, where, poses, 1e3 * clearance, 1e3 * inner, legs]


def hexapod_with_gap(gap: float, tilt: float) -> Hexapod:
    """Return the preset with another gap and limit of tilt (degrees), and legs that count in full."""
    preset = load_machine("hexapod")
    # radii and heights of [Sahbaz 2007, chapter 5]
    return Hexapod(
        joint_circle(0.149, np.deg2rad(gap), 0.0115),
        joint_circle(0.100, np.deg2rad(60), -0.011),
        axes=preset.axes,
        home=preset.home,
        max_tilt=np.deg2rad(tilt),
        leg_radius=OUTER,
        leg_ends=0.0,
    )


def travel_corners(machine: Hexapod) -> Array:
    """Return the 64 sets of lengths with every leg at either end of its travel, as (64, 6)."""
    return np.asarray(machine.home_q + list(product(*(axis.travel for axis in machine.axes))))


def find_nearest_legs(machine: Hexapod, q: Array) -> tuple[float, str, int]:
    """Return the smallest clearance (m), its legs, and the number of poses.

    The poses are those of lengths q that are reached from home with no joint beyond its limit.
    """
    reached = machine.forward(q)
    margins = machine.check(reached.pose[reached.certified])
    clearance = margins.clearance[(margins.tilt <= 1).all(1)]
    pose, pair = np.unravel_index(int(np.argmin(clearance)), clearance.shape)
    return float(clearance[pose, pair]), margins.clearance_names[pair], len(clearance)
