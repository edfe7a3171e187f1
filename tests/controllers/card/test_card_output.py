"""The two lines of a channel, decoded by another hand: the pulses on them are those that were
fired.
"""

from dataclasses import replace

import numpy as np
import pytest

from controllers.card import PCI_8164, Refused, TAMove, at_rest, play, wires
from controllers.card.model import MODES
from kinematics import MotionError

CARD = replace(PCI_8164, speed_range=1e5)
SENT = [
    (0.0, TAMove([40], [500.0], [2000.0], 0.05, 0.05)),
    (0.2, TAMove([-25], [500.0], [2000.0], 0.05, 0.05)),
    (0.4, TAMove([3], [500.0], [500.0], 0.0, 0.0)),
]


def fired():
    return play(CARD, at_rest([0]), SENT, 1.0).train(0)


def decoded(mode, found):
    """(ticks, signs) as a drive of that wiring reads them: edge by edge, one line after the
    other.
    """
    kind, _, *rest = mode.split("_")
    pulses = []
    for n, tick in enumerate(found.ticks):
        before, after = found.levels[n], found.levels[n + 1]
        for k in range(2):
            began = (0, 1) if "RISING" in mode else (1, 0)
            if (before[k], after[k]) != began:
                continue
            if kind == "OUT" and k == 0:
                pulses.append((tick, 1 if after[1] == (rest[-1] == "HIGH") else -1))
            elif kind == "CW":
                pulses.append((tick, -1 if k else 1))
    return tuple(np.array(of, np.int64) for of in zip(*pulses, strict=True))


@pytest.mark.parametrize("mode", MODES)
def test_a_drive_reads_the_pulses_that_were_fired(mode):
    train = fired()
    found = wires(replace(CARD, output_mode=mode), train, 40)
    ticks, signs = decoded(mode, found)
    np.testing.assert_array_equal(ticks, train.ticks)
    np.testing.assert_array_equal(signs, train.direction)
    assert np.all(np.diff(found.ticks) > 0)
    # at the end as at the beginning no pulse stands
    assert found.levels[-1, 0] == found.levels[0, 0] == ("FALLING" in mode)


def test_direction_is_there_its_set_up_before_a_pulse_and_widths_are_kept():
    train = fired()
    found = wires(replace(CARD, output_mode="OUT_RISING_DIR_LOW"), train, 40, 100)
    turns = found.ticks[np.diff(found.levels[:, 1].astype(int)) != 0]
    first = train.ticks[1:][np.diff(train.direction) != 0]
    np.testing.assert_array_equal(first - turns, 100)
    changes = np.diff(found.levels[:, 0].astype(int))
    np.testing.assert_array_equal(found.ticks[changes < 0] - found.ticks[changes > 0], 40)


def test_a_channel_that_stands_keeps_its_levels():
    still = play(CARD, at_rest([0]), [], 1.0).train(0)
    for mode, level in (
        ("OUT_RISING_DIR_LOW", [0, 0]),
        ("OUT_FALLING_DIR_HIGH", [1, 1]),
        ("CW_CCW_FALLING", [1, 1]),
    ):
        np.testing.assert_array_equal(
            wires(replace(CARD, output_mode=mode), still, 1).levels, [level]
        )


def test_pulses_too_fast_for_their_width_are_refused_with_the_place():
    with pytest.raises(
        Refused, match=r"pulses \d+ and \d+ are \d+ ticks apart; width 16000 need 16001"
    ):
        wires(CARD, fired(), 16_000)
    turn = r"pulses 40 and 41 are \d+ ticks apart; width 40 and direction set-up 4000000 need"
    with pytest.raises(Refused, match=turn):
        wires(CARD, fired(), 40, 4_000_000)
    wires(
        replace(CARD, output_mode="CW_CCW_RISING"), fired(), 40, 4_000_000
    )  # has no DIR to set up
    with pytest.raises(Refused, match="pulse width of 0 ticks"):
        wires(CARD, fired(), 0)


def test_an_unknown_mode_is_refused_with_the_nearest():
    with pytest.raises(MotionError, match="OUT_RISING_DIR_LOW"):
        replace(CARD, output_mode="OUT_RISING_DIR_LO")
