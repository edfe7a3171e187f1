"""Runs of a batch: none depends on the others, on what is recorded, nor on who simulates it."""

from dataclasses import replace

import numpy as np
import pytest

from controllers import find_law, load_rig
from controllers.card import PCI_8164
from controllers.rig import Host, disturb_rig, time_path
from controllers.simulate import bank, sample, simulate
from kinematics import MotionError

SAME = 1e-12
"""Of the largest value: what a run may differ by, in a batch and alone."""


@pytest.fixture(scope="module")
def rig():
    return load_rig("servo-rig")


@pytest.fixture(scope="module")
def short(rig):
    """The thesis reference, a tenth as long and of a tenth of the way."""
    line = sample(rig.task("line").motion, rig.machine, 0.125)
    position = np.rint(line.position[0] + (line.position - line.position[0]) / 10)
    return replace(line, dt=0.0125, position=position)


def others(rig):
    """Rigs that differ in whatever rigs of a batch may differ in."""
    sleepy = [replace(rig, host=Host("sleep", 5e-3, 1e-3, seed)) for seed in (1, 2)]
    late = replace(
        rig, drives=(*rig.drives[:2], replace(rig.drives[2], loop_delay=3, command_delay=0))
    )
    seen = replace(rig, drives=(replace(rig.drives[0], feedback="output"), *rig.drives[1:]))
    smooth = replace(
        rig, drives=tuple(replace(drive, coulomb=0.0, play=0.0) for drive in rig.drives)
    )
    return [rig, disturb_rig(rig, inertia=1.3, friction=0.7), *sleepy, late, seen, smooth, rig]


@pytest.mark.parametrize("law", ["1", "6r"])
def test_a_run_is_the_same_in_a_batch_and_alone(rig, short, law):
    rigs = others(rig)
    gains = np.linspace(0.3, 0.9, len(rigs))
    batch = simulate(
        short, find_law(law, **({} if law == "1" else {"gain": gains[:, None]})), rigs, settle=0.1
    )
    for b, own in enumerate(rigs):
        alone = simulate(
            short, find_law(law, **({} if law == "1" else {"gain": gains[b]})), [own], settle=0.1
        )
        until = len(alone.t)
        for name in ("command", "actual", "measured", "speed", "torque"):
            ours, theirs = getattr(batch, name)[:until, b], getattr(alone, name)[:, 0]
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=SAME * np.abs(theirs).max())
        np.testing.assert_array_equal(batch.pulses[b], alone.pulses[0])
        assert batch.end[b] == alone.end[0]


def test_the_records_are_the_instants_asked_for(rig, short):
    every = simulate(short, find_law("3"), [rig], settle=0.1)
    some = simulate(short, find_law("3"), [rig], settle=0.1, period=1e-3)
    np.testing.assert_allclose(some.t, every.t[::4], rtol=1e-15)
    for name in ("command", "actual", "measured", "speed", "torque"):
        np.testing.assert_array_equal(getattr(some, name), getattr(every, name)[::4])
    np.testing.assert_array_equal(some.pulses, every.pulses)
    with pytest.raises(MotionError, match="period"):
        simulate(short, find_law("3"), [rig], period=0.0)


def test_a_host_that_sleeps_ends_late_by_what_its_steps_were(rig, short):
    # at a slowest speed that brings the last of the law's rounding home at once
    polled = replace(rig, card=PCI_8164)
    sleepy = replace(polled, host=Host("sleep", granularity=5e-3, seed=4))
    runs = simulate(short, find_law("3"), [polled, sleepy], settle=0.1)
    # 12.5 ms wake after 15 ms from the second step on
    assert np.diff(runs.steps[1:, 1]) == pytest.approx(15e-3)
    assert runs.end[1] > runs.end[0] + 0.1
    ends = [runs.t[np.flatnonzero(np.diff(runs.command[:, b, 0]))[-1]] for b in (0, 1)]
    assert ends[1] > ends[0] + 30 * 2.5e-3


def test_steppers_follow_their_task_and_lose_steps_when_it_is_hurried():
    """In 1 s the legs run at 25.7 mm/s, in 0.8 s at 32.2: the motors' curve ends at 30.48 mm/s."""
    rig = load_rig("hexapod-steppers")
    task = rig.task("circle")

    def runs(duration):
        motion = time_path(task.motion.path, "quarter-sine", 1 / 6, duration)
        return simulate(sample(motion, rig.machine, task.dt), find_law("3"), [rig], settle=0.1)

    calm, hurried = runs(1.0), runs(0.8)
    half_play = 2.5e-6 / 0.75e-6
    assert not calm.lost.any()
    assert np.abs(calm.actual[-1] - calm.command[-1]).max() <= half_play + 1
    assert hurried.lost.all()
    assert not (hurried.lost % 4).any()
    # without an encoder the host reads what it sent; two pulses make a step: slips back and forth
    # may cancel
    np.testing.assert_array_equal(hurried.measured[-1], hurried.command[-1])
    missing = np.abs(hurried.actual[-1] - hurried.command[-1]) / 2.032
    assert (missing <= hurried.lost + 4).all()
    assert missing.max() > 16


def test_servos_and_steppers_share_a_machine(rig):
    """Each axis as it would be alone among its kind."""
    stepper = replace(
        load_rig("hexapod-steppers").drives[0], full_step=2 * np.pi / 200 / 74, inertia=3.0
    )
    stepper = replace(
        stepper, torque_speed=((0.0, 40.0), (3.0, 10.0)), damping=5.0, friction=0.0, coulomb=0.1
    )
    mixed = bank([(rig.drives[0], stepper, rig.drives[2])])
    command = np.linspace(0, 0.01, 200)[:, None, None] * np.array([1.0, -1.0, 0.5])
    told, state = mixed.run(mixed.standing(np.zeros((1, 3))), command, np.arange(200))
    for n, drive in enumerate((rig.drives[0], stepper, rig.drives[2])):
        own = bank([(drive,)])
        alone, after = own.run(own.standing(np.zeros((1, 1))), command[:, :, [n]], np.arange(200))
        np.testing.assert_array_equal(told.position[:, :, n], alone.position[:, :, 0])
        np.testing.assert_array_equal(mixed.reading(state)[:, n], own.reading(after)[:, 0])
    with pytest.raises(MotionError, match="kinds of their drives"):
        bank([(rig.drives[0],), (stepper,)])


def test_what_is_no_batch_is_refused(rig, short):
    law = find_law("3")
    with pytest.raises(MotionError, match="has none"):
        simulate(short, law, [])
    with pytest.raises(MotionError, match="machine or card"):
        simulate(short, law, [rig, replace(rig, card=replace(rig.card, while_moving="queue"))])
    with pytest.raises(MotionError, match="reference has 2 columns, the rig 3 axes"):
        simulate(
            replace(short, position=short.position[:, :2], speed=short.speed[:, :2]), law, [rig]
        )
