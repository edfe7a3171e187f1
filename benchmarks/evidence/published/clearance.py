"""Why the thesis chose a gap of 30°: the smallest clearance of the legs, `python -m
benchmarks.evidence.published.clearance`.

The final design with joint gaps of 20° and 30° at the base: legs against each other at the ends of travel, where the
thesis observed its parts, and over the whole travel; with joints up to the program's limit of tilt (35°) and the data
sheet's (45°). [Sahbaz 2007, chapter 4] prints no dimension of a leg: the two radii are assumptions. They are those of
the round bars that fit into the actuator's body, 43 mm square in its data sheet, and around it; between two spherical
joints it can turn about its axis, so the outer one counts.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from kinematics import Hexapod, load_machine
from kinematics.analysis.clearance import Bodies
from kinematics.foundation.arrays import Array
from kinematics.kinds.hexapod import joint_circle
from kinematics.machine.pose import to_numbers

GAPS = (20, 30)
TILTS = (35, 45)
# Assumption: half the side and half the diagonal of the actuator's body.
RADII = (0.0215, 0.0304)
# Joint circles of base and platform: radius and height in their frames (m) [Sahbaz 2007, chapter 5].
BASE, PLATFORM = (0.149, 0.0115), (0.100, -0.011)


@dataclass(frozen=True, slots=True)
class NearestLegs:
    """The smallest distance (m) between the axes of two legs, which two, and among how many poses."""

    distance: float
    legs: str
    poses: int


def hexapod_with_gap(gap: float) -> Hexapod:
    """The preset with another gap (degrees) of its base joints, its tilt limit lifted; retracted legs of their own."""
    preset = load_machine("hexapod")
    base, platform = (
        joint_circle(BASE[0], np.deg2rad(gap), BASE[1]),
        joint_circle(PLATFORM[0], np.deg2rad(60), PLATFORM[1]),
    )
    return Hexapod(base, platform, axes=preset.axes, home=preset.home, name=f"gap {gap}°")


def travel_corners(machine: Hexapod) -> Array:
    """(64, 6) lengths: every leg in or out."""
    lo, hi = np.array([axis.travel for axis in machine.axes]).T
    return np.asarray(machine.home_q + np.where(np.array(list(product((False, True), repeat=6))), hi, lo))


def sample_travel(machine: Hexapod, count: int, seed: int = 0) -> Array:
    """(count, 6) random lengths inside the travel."""
    lo, hi = np.array([axis.travel for axis in machine.axes]).T
    return np.asarray(machine.home_q + np.random.default_rng(seed).uniform(lo, hi, (count, 6)))


def find_nearest_legs(machine: Hexapod, q: Array, tilt: float) -> NearestLegs:
    """Over the poses of lengths q that are reached from home with no joint beyond `tilt` (degrees)."""
    found = machine.forward(q)
    x = to_numbers(found.pose)[found.certified]
    x = x[(machine.tilt_map(x) >= np.cos(np.deg2rad(tilt))).all(1)]
    # axes from joint centre to joint centre: the legs' ends count in full
    legs = Bodies(machine.base, machine.platform, tuple(axis.name for axis in machine.axes), RADII[1], leg_ends=0.0)
    distance = legs.distances(x)
    pose, pair = np.unravel_index(int(np.argmin(distance)), distance.shape)
    return NearestLegs(float(distance[pose, pair]), legs.names[pair], len(x))


def main(count: int = 40_000) -> None:
    print("smallest clearance of two legs (mm) for assumed radii of " + " and ".join(f"{1e3 * r:g} mm" for r in RADII))
    print(f"{'gap':>5}{'tilt up to':>12}{'where':>18}{'poses':>8}{'axes':>8}" + f"{'':>4}clearance, nearest legs")
    for gap in GAPS:
        machine = hexapod_with_gap(gap)
        for where, q in (("ends of travel", travel_corners(machine)), ("whole travel", sample_travel(machine, count))):
            for tilt in TILTS:
                least = find_nearest_legs(machine, q, tilt)
                clear = "".join(f"{1e3 * (least.distance - 2 * radius):>8.1f}" for radius in RADII)
                print(
                    f"{gap:>4}°{tilt:>11}°{where:>18}{least.poses:>8}{1e3 * least.distance:>8.1f}{clear}  {least.legs}"
                )
    print("below zero the legs overlap; gap 20° was given up because of collisions, 30° was built [Sahbaz 2007]")


if __name__ == "__main__":
    main()
