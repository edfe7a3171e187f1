"""The start/stop rate of a stepper: pulses that start, stop or turn beyond it are refused, and
found by the checker.
"""

from importlib.resources import files

import numpy as np
import pytest

from kinematics import Axis, MotionError, load_machine
from planner import Infeasible, Line, Program, plan
from planner.pulses import check, find_rule, generate
from planner.pulses.generation.stream import PulseStream
from tests.planner.motions import PULSE, one_axis

CLOCK = 10_000_000
ACCELERATION = 1e6
"""Pulses/s²."""
FIRST_RATE = np.sqrt(ACCELERATION) / (np.sqrt(3) - 1)
"""1/s: from rest the first pulses come at √(1/a) and √(3/a): crossings of ½ and 1½ = a t²/2."""


def there(ramp=0.02):
    """Up at constant acceleration from rest and down to rest, in pulses; 400 in all."""
    top = ACCELERATION * ramp
    return one_axis(
        np.array([[ACCELERATION / 2, 0.0, 0.0], [-ACCELERATION / 2, top, top * ramp / 2]]) * PULSE,
        np.array([0.0, ramp, 2 * ramp]),
    )


def axis(rate):
    return Axis("x", pulse=PULSE, start_stop_rate=rate)


@pytest.mark.parametrize("rule", ["nearest", "timer"])
def test_a_start_from_rest_is_refused_beyond_its_rate_alone(rule):
    """By the closed form of the first two crossings; what follows never doubles in rate."""
    motion = there()
    enough, little = axis(1.01 * FIRST_RATE), axis(0.98 * FIRST_RATE)
    schedule = generate(motion, [enough], [0.0], CLOCK, rule)
    assert check(schedule, motion, [enough], [0.0]).holds
    with pytest.raises(Infeasible, match="start/stop rate") as refusal:
        generate(motion, [little], [0.0], CLOCK, rule)
    assert refusal.value.value == pytest.approx(FIRST_RATE, rel=2e-3)
    assert refusal.value.limit == pytest.approx(0.98 * FIRST_RATE)
    # the checker finds it by itself
    found = check(schedule, motion, [little], [0.0])
    assert not found.holds
    assert all(fault.what.startswith("start/stop rate: ") for fault in found.faults)
    # at the start and at the stop
    assert found.fault_count == 2


def test_bursts_from_rest_are_refused():
    """A burst of pulses at one rate starts and stops with it."""
    motion = there(0.1)
    with pytest.raises(Infeasible, match="start/stop rate"):
        generate(
            motion, [axis(50_000.0)], [0.0], CLOCK, "dda:spacing=5ms,pulses_per_count=5,rate=1 MHz"
        )


def test_a_turn_is_a_stop_and_a_start():
    """Up by 10.7 pulses and back at 2000 pulses/s, turned round within 0.1 ms: pulses at full rate
    on both sides.
    """
    turn, speed = 1e-4, 2000.0
    level = 10.7 - speed * turn / 4
    pieces = np.array([[0.0, speed, 0.0], [-speed / turn, speed, level], [0.0, -speed, level]])
    knots = np.cumsum([0.0, level / speed, turn, level / speed])
    motion = one_axis(pieces * PULSE, knots)
    free = generate(motion, [Axis("x", pulse=PULSE)], [0.0], CLOCK)
    assert check(free, motion, [axis(2500.0)], [0.0]).holds
    (first, *_) = check(free, motion, [axis(500.0)], [0.0]).faults
    assert first.what.startswith("start/stop rate: 2000 1/s next to a rest")
    with pytest.raises(Infeasible, match=r"start/stop rate 2000 .* 500"):
        generate(motion, [axis(500.0)], [0.0], CLOCK)


def test_parts_of_a_motion_know_the_pace_of_the_part_before():
    """Half-way the axis is at full speed: the second part starts no motor."""
    motion = there()
    enough = axis(1.01 * FIRST_RATE)

    class Machine:
        axes = (enough,)
        home_q = np.zeros(1)

    stream = PulseStream(Machine(), CLOCK, find_rule("nearest"))
    first = one_axis(np.array([[ACCELERATION / 2, 0.0, 0.0]]) * PULSE, np.array([0.0, 0.02]))
    top = ACCELERATION * 0.02
    second = one_axis(
        np.array([[-ACCELERATION / 2, top, top * 0.01]]) * PULSE, np.array([0.0, 0.02])
    )
    total = len(stream.add(first).axes[0]) + len(stream.add(second, last=True).axes[0])
    assert total == len(generate(motion, [enough], [0.0], CLOCK).axes[0])


def test_a_machine_file_states_it_and_a_plan_keeps_to_it(tmp_path):
    text = (files("kinematics") / "presets" / "traverser.toml").read_text()
    assert text.count("[axes]") == 1

    def load(rate):
        file = tmp_path / "slides.toml"
        file.write_text(text.replace("[axes]", f'[axes]\nstart_stop_rate = "{rate} 1/s"'))
        return load_machine(file)

    program = Program((Line([0.01, 0.0, 0.0]),))
    machine = load(400)
    assert machine.axes[0].start_stop_rate == 400.0
    made = plan(program, machine, order=2)
    assert check(made.pulses, made.trajectory, machine.axes, machine.home_q).holds
    # 7.62 mm/s² are 480 pulses/s², and the first two pulses 1/30 s apart
    with pytest.raises(Infeasible, match=r"start/stop rate 29\.9\d* .* 20"):
        plan(program, load(20), order=2).pulses.total  # noqa: B018  # pulses are made when asked for
    with pytest.raises(MotionError, match="start_stop_rate"):
        load(-1)
