"""What the thesis' program reads and how it ends: the card's rate as v(k − 1), and a stop after the
last sample.
"""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
import pytest

from controllers import Rig
from controllers.card import PCI_8164, TAMove, at_rest, current_speed, send
from controllers.drives.servo import leg_servo
from controllers.laws.closed_loop import ClosedErrorSpeed
from controllers.laws.open_loop import OpenPosition, OpenVelocity
from controllers.rig import Host
from controllers.simulate import sample, simulate

DT = 0.05
TOP = 4000.0
CARD = replace(PCI_8164, speed_range=1e5)


@dataclass(frozen=True)
class Noted:
    """A law that notes the feedback it is given, and sends those of another."""

    law: object
    seen: list = field(default_factory=list)
    host: ClassVar[str] = "counter"
    name: ClassVar[str] = "noted"

    def command(self, k, reference, feedback):
        self.seen.append(np.array(feedback.speed))
        return self.law.command(k, reference, feedback)


@pytest.fixture
def servo_rig(rig):
    return Rig(rig, tuple(leg_servo(axis) for axis in rig.axes), CARD)


def hosted(rig, card=None, **host):
    return replace(rig, host=Host(**host), card=card or rig.card)


def test_the_rate_is_that_of_the_move_under_way_and_nothing_where_it_stands():
    """Half-way up a ramp from 0 to 800 pulses/s it is 400; on the target 0; without its sign it is
    a magnitude.

    To a step of the speed registers, 1e5/65535 pulses/s.
    """
    move = TAMove([100, -100], [0.0, 0.0], [800.0, 800.0], 0.2, 0.0)
    state = send(CARD, at_rest([0, 0]), move, 0.0)
    unsigned = replace(CARD, current_speed="magnitude")
    for t, rate in ((0.1, 400.0), (0.21, 800.0), (1.0, 0.0)):
        np.testing.assert_allclose(
            current_speed(CARD, state, t), [rate, -rate], atol=CARD.least_speed
        )
        np.testing.assert_allclose(
            current_speed(unsigned, state, t), [rate, rate], atol=CARD.least_speed
        )


def test_a_law_is_given_the_cards_rate_where_the_host_reads_that(servo_rig, axis_motion):
    """Law 1 leaves the card at npuls(k) when step k begins, while the encoders lag by the servo's
    time constant.
    """
    motion = axis_motion("smooth", (TOP, -TOP, TOP / 2), 1.0)
    reference = sample(motion, servo_rig.machine, DT)
    rates, encoders = Noted(OpenVelocity()), Noted(OpenVelocity())
    simulate(reference, rates, [hosted(servo_rig, speed_from="card")], settle=0.0)
    simulate(reference, encoders, [servo_rig], settle=0.0)
    for k in range(1, reference.steps):
        np.testing.assert_allclose(rates.seen[k][0], reference.npuls(k), atol=CARD.least_speed)
    assert np.abs(encoders.seen[4][0] - reference.npuls(4)).max() > 0.02 * TOP


def test_runs_of_a_batch_read_what_their_own_hosts_read(servo_rig, axis_motion):
    reference = sample(axis_motion("smooth", (TOP, -TOP, TOP / 2), 1.0), servo_rig.machine, DT)
    law, alone = Noted(ClosedErrorSpeed()), Noted(ClosedErrorSpeed())
    rigs = [servo_rig, hosted(servo_rig, speed_from="card")]
    both = simulate(reference, law, rigs, settle=0.1)
    for b, rig in enumerate(rigs):
        own = simulate(reference, alone, [rig], settle=0.1)
        np.testing.assert_array_equal(own.command[:, 0], both.command[:, b])
    assert np.abs(both.command[:, 0] - both.command[:, 1]).max() > 0


@pytest.mark.parametrize("while_moving", ["replace", "queue"])
@pytest.mark.parametrize(
    "law", [OpenVelocity(), OpenVelocity("sleep"), OpenPosition()], ids=lambda law: law.name
)
def test_the_closing_stop_ends_every_axis_within_its_time_and_nothing_is_sent_behind_it(
    servo_rig, axis_motion, law, while_moving
):
    """A motion that ends at speed: without the stop the axes run on; with it no pulse falls later
    than its ramp.
    """
    motion = axis_motion("quarter-sine", (TOP, -TOP, TOP / 2), 1.0)
    reference = sample(motion, servo_rig.machine, DT)
    # cut off where it still runs
    cut = replace(reference, position=reference.position[:13], speed=reference.speed[:13])
    rig = hosted(
        servo_rig,
        replace(CARD, while_moving=while_moving),
        closing_stop=1e-3,
        granularity=5e-3,
        jitter=1e-3,
    )
    runs = simulate(cut, law, [rig], settle=0.3)
    end = runs.steps[cut.steps, 0]
    after = runs.command[runs.t >= end + 1e-3, 0]
    assert np.ptp(after, axis=0).max() == 0
    # of a ramp of 1 ms from npuls: half of it times 1 ms, and the pulse that falls within the
    # sample
    at = runs.command[runs.t <= end, 0][-1]
    assert np.abs(after[0] - at).max() <= 0.5e-3 * np.abs(cut.speed[-1]).max() + 2


def test_runs_of_a_batch_end_each_as_their_own_host_does(servo_rig, axis_motion):
    reference = sample(
        axis_motion("quarter-sine", (TOP, -TOP, TOP / 2), 1.0), servo_rig.machine, DT
    )
    cut = replace(reference, position=reference.position[:13], speed=reference.speed[:13])
    rigs = [servo_rig, *(hosted(servo_rig, closing_stop=tdec) for tdec in (1e-3, 0.04))]
    both = simulate(cut, OpenVelocity(), rigs, settle=0.3)
    for b, rig in enumerate(rigs):
        own = simulate(cut, OpenVelocity(), [rig], settle=0.3)
        np.testing.assert_array_equal(own.command[:, 0], both.command[:, b])
    first, second, third = (both.command[-1, b, 0] for b in range(3))
    assert second < third < first
