"""The source's timing [Sasidhar 1981; SEEDS.md, section 4] on the console's drives."""

import numpy as np
import pytest

from controllers.console.motion import machine_drives, trapezoid_motion
from kinematics import load_machine

INCH = 0.0254
STEP = 0.000625 * INCH


@pytest.fixture(scope="module")
def drives():
    return machine_drives(load_machine("traverser"))


def moved(drives, steps, axis=0):
    target = np.zeros(4, np.int64)
    target[axis] = steps
    return trapezoid_motion(drives, np.zeros(4, np.int64), target, drives.speed, 0.0)


def test_a_step_is_0_000625_in_and_1200_full_steps_a_second_are_2400_half_steps(drives):
    machine = load_machine("traverser")
    assert [axis.pulse for axis in machine.axes[:3]] == pytest.approx([STEP] * 3, rel=1e-12)
    assert drives.speed[:3] == pytest.approx([2 * 1200] * 3, rel=1e-12)
    assert drives.speed[:3] * STEP == pytest.approx([1.5 * INCH] * 3, rel=1e-12)
    assert (drives.low[:3].tolist(), drives.high[:3].tolist()) == ([0] * 3, [76800, 76800, 115200])


@pytest.mark.parametrize(("inches", "seconds"), [(48, 37.0), (72, 53.0)])
def test_a_traverse_takes_the_way_at_full_speed_and_one_ramp(drives, inches, seconds):
    """Trapezoid: D/v + v/a; 48 in: 32 + 5 s, within the 40 s asked for; 72 in: 48 + 5 s, which is
    not.
    """
    steps = round(inches / 0.000625)
    took = moved(drives, steps).end
    # the start speed, one step of the speed register, 2400/65535 steps/s, saves less than v0/a at
    # either end
    assert took == pytest.approx(seconds, abs=2 * 2400 / 65535 / 480)
    assert (took <= 40) == (inches == 48)


def test_the_ramp_is_5_s_and_x_a_3_75_in(drives):
    assert drives.speed[0] / drives.acceleration[0] == pytest.approx(5.0)
    assert drives.ramp[0] * STEP / INCH == pytest.approx(3.75)
    half = moved(drives, 76800).state.moves[-1].position(np.array([2.5, 5.0]))[:, 0]
    assert half == pytest.approx(
        [6000 / 4, 6000], abs=0.2
    )  # a t²/2, but for the start speed: v0 t = 0.18


@pytest.mark.parametrize("steps", [1, 2, 3, 100, 11_999, 12_000])
def test_a_way_up_to_twice_x_a_is_a_triangle_of_two_equal_halves(drives, steps):
    """T = 2 √(D/a), the peak √(a D) half way."""
    motion = moved(drives, steps)
    move = motion.state.moves[-1]
    up, held, down = move.lengths[:, 0]
    assert up == pytest.approx(down)
    assert (
        held <= 1.001 * (2400 / 65535) ** 2 / 480 / 2400
    )  # at 2 X_a: the start speed leaves v0²/(a v)
    # the start speed v0 shortens it by less than 2 v0/a
    assert motion.end == pytest.approx(2 * np.sqrt(steps / 480), abs=2 * 2400 / 65535 / 480)
    assert move.position(np.array([up]))[0, 0] == pytest.approx(steps / 2, rel=1e-9)
    assert len(motion.directions_between(0.0, np.inf)[0]) == steps


def test_beyond_twice_x_a_the_speed_is_held(drives):
    assert moved(drives, 12_100).state.moves[-1].lengths[1, 0] == pytest.approx(
        100 / 2400, rel=1e-2
    )


def test_axes_start_together_and_end_when_they_end(talk):
    console = talk()
    console.say("POS X CW 48000 Y CW 1200 Z CW 12000")
    motion = console.desk.session.motion
    alone = [
        moved(machine_drives(load_machine("traverser")), steps, axis).end
        for axis, steps in enumerate((48000, 1200, 12000))
    ]
    move = motion.state.moves[-1]
    assert move.begin[:3].tolist() == [0.0] * 3
    assert move.end[:3] == pytest.approx(alone, rel=1e-12)
    assert len(set(np.round(move.end[:3], 3))) == 3
    assert console.wait() == ["DONE"]
    assert console.registers() == [48000, 1200, 12000, 0]
