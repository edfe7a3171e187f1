"""Doubts about a machine's file: swapped rows of joints, and limits and pulses of an improbable
size.
"""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from kinematics import Axis, Hexapod, load_machine
from kinematics.analysis.doubts import find_doubts
from kinematics.foundation.names import presets
from kinematics.kinds.hexapod import joint_circle
from kinematics.kinds.leg_lengths import find_swapped_legs

AXIS = Axis(
    "x",
    travel=(-0.1, 0.1),
    pulse=1.5625e-6,
    max_speed=0.05,
    max_acceleration=0.5,
)


AXES = tuple(replace(AXIS, name=f"leg{n}") for n in range(1, 7))


def symmetric_hexapod(rng, error=1e-3):
    """A hexapod of random proportions, with joints that are off by a share `error` of its
    radius.
    """
    radius = rng.uniform(0.05, 1.0)
    base = joint_circle(radius, np.deg2rad(rng.uniform(5, 55)), 0.0)
    platform = joint_circle(radius * rng.uniform(0.3, 1.1), np.deg2rad(rng.uniform(65, 115)), 0.0)
    home = RigidTransform.from_translation([0, 0, radius * rng.uniform(0.5, 2.5)])
    off = rng.normal(0.0, error * radius, (2, 6, 3))
    return Hexapod(base + off[0], platform + off[1], axes=AXES, home=home)


@pytest.mark.parametrize("name", presets("kinematics"))
def test_bundled_machines_raise_no_doubts(name):
    if name == "arm":
        pytest.importorskip("pinocchio")
    assert find_doubts(load_machine(name)) == ()


def test_swapped_rows_are_suspected_and_others_are_not():
    """Of a symmetric machine, and with errors of its parts; both rows of the message are the
    swapped ones.
    """
    rng = np.random.default_rng(38)
    suspected = total = 0
    for _ in range(5):
        machine = symmetric_hexapod(rng)
        assert find_swapped_legs(machine) == ""
        for one, other in combinations(range(6), 2):
            platform = np.array(machine.platform)
            platform[[one, other]] = platform[[other, one]]
            swapped = Hexapod(machine.base, platform, axes=AXES, home=machine.home)
            text = find_swapped_legs(swapped)
            total += 1
            suspected += text.startswith(f"leg{one + 1} and leg{other + 1} are ")
    assert suspected > 0.95 * total


def test_unequal_legs_that_no_exchange_makes_equal_raise_no_doubt():
    rng = np.random.default_rng(39)
    suspected = sum(find_swapped_legs(symmetric_hexapod(rng, error=0.05)) != "" for _ in range(100))
    assert suspected <= 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"max_speed": 40.0}, "max_speed 40000 mm/s takes 3.2e+06 mm to attain and to stop from"),
        ({"max_speed": 0.04 / 60}, "max_speed 0.666667 mm/s is attained within one pulse"),
        ({"max_acceleration": 1000.0}, "max_speed 50 mm/s is attained within one pulse"),
        ({"pulse": 1.5625e-3}, "the travel of 200 mm has 128 pulses of 1.5625 mm"),
    ],
)
def test_limits_of_an_improbable_size_are_doubted(changes, message):
    """Each with the physical reason; the same axes without the change are not doubted."""
    machine = load_machine("hexapod")

    def drive(axes):
        return Hexapod(machine.base, machine.platform, axes=axes, home=machine.home)

    assert find_doubts(drive(AXES)) == ()
    (doubt,) = find_doubts(drive([replace(axis, **changes) for axis in AXES]))
    assert doubt.startswith(f"leg1, leg2, leg3, leg4, leg5, leg6: {message}")
