"""Plans after input shapers compared with samples: a small part of the case `shaped_plans` of the
evidence.
"""

from itertools import islice

import numpy as np
import pytest

from benchmarks.evidence.cases import shaped_plans
from benchmarks.evidence.cases.shaped_plans import STEP
from benchmarks.evidence.flexible_load import FlexibleLoad
from benchmarks.evidence.limit_use import measure_rates, measure_travel
from kinematics import load_machine
from kinematics.machine.pose import to_numbers
from kinematics.machine.shaper import IMPULSES, Shaper
from planner import load_program, plan
from planner.shaping.shaped_motion import reached_poses


@pytest.fixture(scope="module")
def plans():
    """Plans with each of the four shapers."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shaped_plans, "PROGRAMS", {"bare-circle": 30.0, "linkage-line": 30.0})
        return list(islice(shaped_plans.make_plans(), 4))


def test_limits_deviation_and_vibration_of_some_plans(plans, monkeypatch):
    monkeypatch.setattr(shaped_plans, "SAMPLES", 4000)
    assert {planned.machine.axes[0].shaper.kind for planned in plans} <= set(IMPULSES)
    for planned in plans:
        _, _, _, proved, use, deviation, away, left, _ = shaped_plans.compare(planned)
        assert float(use) <= float(proved) + 1e-7 <= 1 + 1e-7
        # samples come near to what is proved, so that a wrong bound would be exceeded
        assert float(use) > 0.99
        assert 0.5 * deviation < away <= deviation
        assert left <= 5


def test_limits_are_sampled_on_both_sides():
    machine = load_machine("hexapod")
    rest = np.zeros((2, len(machine.axes)))
    most = np.array([axis.max_acceleration for axis in machine.axes])
    for side in (-1.2, 1.2):
        acceleration = np.array([side * most, 0 * most])
        assert measure_rates(machine, 2, [rest, acceleration]) == pytest.approx(1.2)
    low, high = machine.axes[0].travel
    assert measure_travel(machine, machine.home_q + rest + high) == pytest.approx(1.0)
    assert measure_travel(machine, machine.home_q + rest + low) == pytest.approx(1.0)


def test_a_vibration_that_a_shaper_is_not_for_is_left(plans):
    shaper = plans[0].machine.axes[0].shaper
    assert shaped_plans.measure_vibration(plans[0], shaper, 1.0) < 0.01
    assert shaped_plans.measure_vibration(plans[0], shaper, 2.0) > 0.05


MODES = (Shaper("zv", 35.0, 0.05), Shaper("mzv", 22.0, 0.1))
"""Shapers of a vibration along x and of one along y."""


def plan_directions(name):
    """Plan a program on its machine with a shaper for each direction."""
    program = load_program(name)
    machine = load_machine(program.machine)
    for direction, mode in zip(np.eye(3), MODES, strict=False):
        machine = machine.shape_along(direction, mode)
    return plan(program, machine, order=2)


def measure_directions(planned, shares):
    """Return the larger share of the vibration left along x and along y, at each of some shares of
    the frequencies of their shapers.
    """
    bare, shaped = planned.trajectory, planned.shaped.motion

    def sample(end, find_poses):
        return to_numbers(find_poses(np.arange(0.0, end + 2 * STEP, STEP))).T

    before = sample(bare.duration, lambda t: bare.at(t).pose)
    after = sample(shaped.duration, lambda t: reached_poses(bare, shaped, t, shaped.at(t).q))

    def compare(k, load):
        left = load.residual(after[k], STEP, shaped.duration)
        return left / load.residual(before[k], STEP, bare.duration)

    return [
        max(
            compare(k, FlexibleLoad(share * mode.frequency, mode.damping))
            for k, mode in enumerate(MODES)
        )
        for share in shares
    ]


@pytest.mark.parametrize("program", ["tripod-circle", "linkage-line"])
def test_two_directions_are_still_with_shapers_of_axes_that_lie_along_neither(program):
    still, other = measure_directions(plan_directions(program), (1.0, 1.5))
    assert still < 0.002
    # the vibration that a shaper is not for is left
    assert other > 0.02


@pytest.fixture(scope="module")
def circle(plan_bundled):
    return plan_bundled("bare-circle", "hexapod", 2)


@pytest.mark.parametrize("frequency", [6.0, 12.0])
@pytest.mark.parametrize("rig", ["servos", "hexapod-steppers"])
def test_the_rig_swings_less_with_a_shaper(circle, rig, frequency):
    """Drives, a card and pulses between the plan and the axis: a load on a leg, without play."""
    before, after = shaped_plans.swing_on_rig(circle, Shaper("zvd", frequency, 0.01), rig, play=0.0)
    assert before.min() > 5e-6
    assert (after <= 0.015 * before).all(), after / before


def test_what_play_adds_is_not_shaped(circle):
    """The 5 µm of the nut are released at once where a leg turns back: a step, which swings the
    load.
    """
    shaper, play = Shaper("zvd", 12.0, 0.01), 5e-6
    _, without = shaped_plans.swing_on_rig(circle, shaper, "hexapod-steppers", play=0.0)
    _, after = shaped_plans.swing_on_rig(circle, shaper, "hexapod-steppers", play=play)
    assert (after > 4 * without).all()
    assert (after < 1.5 * play).all()
