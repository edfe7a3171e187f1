"""What shapers leave of vibrations: against cos(π f / 2 f₀) of two equal impulses half a period
apart.
"""

from dataclasses import replace
from math import cos, pi

import pytest

from kinematics import Shaper, load_machine
from kinematics.analysis.residual_vibration import find_residuals
from kinematics.machine.shaper import join_shapers


def shaped(*shapers):
    machine = load_machine("traverser")
    axes = [replace(axis, shaper=one) for axis, one in zip(machine.axes, shapers, strict=True)]
    return machine.driven_by(axes)


def test_undamped_residuals_are_those_of_two_impulses():
    zv, zvd = Shaper("zv", 22.0), Shaper("zvd", 35.0)
    first, second = find_residuals(shaped(zv, zvd, zv, None).axes)
    off = cos(1.1 * pi / 2)
    assert first.axes == ("X", "Z")
    assert (first.below, first.stated, first.above) == pytest.approx((-off, 0, -off), abs=1e-12)
    assert second.axes == ("Y",)
    assert (second.below, second.stated, second.above) == pytest.approx(
        (off**2, 0, off**2), abs=1e-12
    )
    assert first.describe() == "zv 22 Hz: 0.0 % at 22 Hz, 15.6 % at ±10 %"


def test_shapers_one_after_the_other_leave_the_product():
    """At 30 Hz the shaper of 20 Hz adds cos(π 30/40) to what its own leaves."""
    both = join_shapers([Shaper("zv", 20.0), Shaper("zv", 30.0)])
    slow, quick = find_residuals(shaped(both, None, None, None).axes)
    assert (slow.mode.frequency, quick.mode.frequency) == (20.0, 30.0)
    assert quick.below == pytest.approx(abs(cos(pi / 2 * 27 / 20) * cos(pi / 2 * 0.9)), rel=1e-9)
    assert quick.stated == pytest.approx(0, abs=1e-12)


def test_a_machine_tells_what_its_shapers_leave():
    assert "15.6" in str(shaped(Shaper("zv", 22.0), None, None, None))
    assert len(load_machine("traverser").tables()) == 1
