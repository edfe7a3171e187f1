"""The 28-bit counters of the cards: their last counts are accepted, and the next are refused,
before any file.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from kinematics import Axis, MotionError
from planner.export.format import ExportSource
from planner.export.formats.adlink import AdlinkC, AdlinkCsv
from planner.pulses import check, generate
from tests.planner.motions import through

LOW, HIGH = -134_217_728, 134_217_727  # ∓2²⁷, the latter less one
PULSE = 1e-5
WAY = 200  # counts of the motion

# Direction of the wiring, where it takes the counter, and from where; the last three do not move
# beyond their start.
REACHED = [
    (1, HIGH, HIGH - WAY), (1, LOW, LOW + WAY), (-1, HIGH, HIGH - WAY), (-1, LOW, LOW + WAY),
    (1, HIGH - WAY, HIGH), (1, LOW + WAY, LOW), (1, HIGH, HIGH),
]  # fmt: skip


def moved(direction, final, start):
    """An axis, its motion between two counts of its wiring, and its home, far from both."""
    axis = Axis("x", pulse=PULSE, direction=direction, card="PCI-8164", channel=0)
    motion = through(
        np.array([[0.0], [(final - start) * direction * PULSE]]), np.zeros((2, 1)), [0.0, 0.5]
    )
    return axis, motion, np.array([-start * direction * PULSE])


@pytest.mark.parametrize(("direction", "final", "start"), REACHED)
def test_a_schedule_takes_the_counter_to_its_last_counts(direction, final, start):
    axis, motion, home = moved(direction, final, start)
    schedule = generate(motion, [axis], home)
    assert schedule.axes[0].final * direction == final
    assert check(schedule, motion, [axis], home).holds


@pytest.mark.parametrize(("direction", "final", "start"), REACHED)
def test_and_no_further(direction, final, start):
    beyond = 1 if max(final, start) == HIGH else -1
    axis, motion, home = moved(direction, final + beyond, start + beyond)
    told = f"axis x: the motion counts to {HIGH + 1 if beyond > 0 else LOW - 1}, beyond .* of card PCI-8164"
    with pytest.raises(MotionError, match=told):
        generate(motion, [axis], home)
    generate(
        motion, [replace(axis, card=None, channel=None)], home
    )  # without a card nothing has to hold it


@pytest.mark.parametrize("format_", [AdlinkC, AdlinkCsv])
@pytest.mark.parametrize(("direction", "final", "start"), REACHED)
def test_calls_of_the_cards_reach_the_same_counts_and_no_further(
    tmp_path, format_, direction, final, start
):
    """Of pulses that `generate` made for no card, so that the format itself has to look."""
    for beyond in (0, 1 if max(final, start) == HIGH else -1):
        axis, motion, home = moved(direction, final + beyond, start + beyond)
        pulses = generate(motion, [replace(axis, card=None, channel=None)], home)
        machine = SimpleNamespace(name="slide", axes=(axis,), home_q=home)
        source = ExportSource("far", machine, Moved(motion), pulses)
        path = tmp_path / f"calls{beyond}"
        if beyond:
            with pytest.raises(
                MotionError,
                match=f"the motion counts to {HIGH + 1 if beyond > 0 else LOW - 1}, beyond",
            ):
                format_().write(source, path)
            assert not path.exists()
        else:
            assert format_().write(source, path).error <= 1
            assert str(final) in path.read_text() or final == start


class Moved:
    """A motion as the format looks at it: with the speed along its path."""

    def __init__(self, motion):
        self.motion, self.knots, self.duration = motion, motion.knots, motion.duration

    def at(self, t):
        state = self.motion.at(np.clip(t, 0.0, self.duration))
        state.sd = abs(state.qd[:, 0])
        return state
