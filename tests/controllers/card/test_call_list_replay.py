"""The exported call list on the virtual cards: path, calls, cards, pulses, poses, path."""

from dataclasses import replace

import numpy as np
import pytest

from controllers.card.model import PCI_8132, PCI_8164
from controllers.card.record import play
from controllers.card.state import at_rest
from controllers.card.trapezoid import TAMove
from controllers.metrics.contour import PathCurve, contour_error
from kinematics import load_machine
from planner import load_program, plan
from planner.export.card_calls import SPEED_HEADROOM, call_list, wired_counts
from planner.export.format import ExportSource
from planner.export.formats.adlink import AdlinkCsv, read_calls

CARDS = {"_8132_ta_move": PCI_8132, "_8164_start_ta_move": PCI_8164}
SPACING = 16e-3
SETTLING = 0.1
"""s after the last call at which the counts are final."""


@pytest.fixture(scope="module")
def source():
    machine = load_machine("hexapod")
    planned = plan(load_program("circle"), machine)
    return ExportSource("circle", machine, planned.trajectory, planned.pulses)


@pytest.fixture(scope="module")
def written(source, tmp_path_factory):
    """What the file of calls 16 ms apart states, and its calls."""
    file = tmp_path_factory.mktemp("calls") / "calls.csv"
    return AdlinkCsv(spacing=SPACING).write(source, file), read_calls(file)


def replay(source, calls, ranges=None, **options):
    """Return the card of each axis, its count before the first call, and its pulses.

    ranges: pulses/s that the speed registers are set to; None: just above the fastest call of each
    axis
    """
    until = max([source.trajectory.duration, *(call.time + call.tacc for call in calls)]) + SETTLING
    axes = zip(source.machine.axes, source.pulses.axes, strict=True)
    for k, (axis, pulses) in enumerate(axes):
        own = [call for call in calls if call.name == axis.name]
        fastest = SPEED_HEADROOM * max(max(call.start, call.top) for call in own)
        card = replace(
            CARDS[own[0].function], speed_range=fastest if ranges is None else ranges[k], **options
        )
        moves = []
        for call in own:
            position, start, top = (
                np.array([value]) for value in (call.position, call.start, call.top)
            )
            moves.append((call.time, TAMove(position, start, top, call.tacc, call.tdec)))
        start = pulses.start * axis.direction
        yield card, start, play(card, at_rest([start]), moves, until).train(0)


@pytest.fixture(scope="module")
def replayed(source, written):
    return list(replay(source, written[1]))


def count(card, start, train, t):
    """Return the counts up to instants t (N,)."""
    fired = np.searchsorted(train.ticks, t * card.clock_hz, side="right")
    return np.concatenate([[start], train.count])[fired]


def test_round_trip_of_the_circle(source, written, replayed):
    """Within what the file states and half a pulse of rounding; the platform within what that is of
    a leg.
    """
    machine, trajectory = source.machine, source.trajectory
    t = np.linspace(0.0, trajectory.duration, 400)
    worst = 0.0
    for k, axis in enumerate(replayed):
        card, _, train = axis
        fires = np.minimum(train.ticks / card.clock_hz, trajectory.duration)
        for instants, shift in ((t, 0.0), (fires, -1.0), (fires, 0.0)):
            # a pulse is counted from its own tick on: before and after it
            counts = count(*axis, instants + shift / card.clock_hz)
            worst = max(worst, np.abs(counts - wired_counts(source, k, instants)[0]).max())
    # the count next to a pulse is half a pulse less or more, and a tick late: a thousandth at these
    # speeds
    assert worst <= written[0].error + 0.5 + 2e-3

    scale = np.array([axis.direction * axis.pulse for axis in machine.axes])
    counts = np.stack([count(*axis, t) for axis in replayed], -1)
    state = trajectory.at(t)
    reached = machine.forward(
        machine.home_q + scale * counts, near=state.pose, certify=False
    ).pose.translation
    displacement = np.linalg.norm(reached - state.pose.translation, axis=1).max()
    # ‖dx‖ ≤ ‖J⁺‖ ‖dq‖ with the translation rows of the inverse Jacobian, every leg being off by
    # that at most
    gain = np.abs(np.linalg.inv(machine.jacobian(state.pose[::4]))[:, :3]).sum(-1)
    assert displacement <= np.linalg.norm(gain, axis=-1).max() * worst * 0.75e-6 * 1.01
    contour = contour_error(reached, state.s, PathCurve(trajectory.path)).error.max()
    assert 0 < contour <= displacement < 5e-6


def test_pulses_of_the_replay(source, replayed):
    """Each leg on the clock of its card, with pulses that add up."""
    assert [card.name for card, _, _ in replayed] == ["PCI-8132"] * 2 + ["PCI-8164"] * 4
    for (card, start, train), pulses, axis in zip(
        replayed, source.pulses.axes, source.machine.axes, strict=True
    ):
        assert card.clock_hz in (PCI_8132.clock_hz, PCI_8164.clock_hz)
        assert train.ticks.dtype == np.int64
        assert np.diff(train.ticks).min() > 0
        assert start + train.direction.sum() == train.count[-1] == pulses.final * axis.direction
        # as many pulses as the plan fires, but for some where an axis turns round
        assert abs(len(train.ticks) - len(pulses.ticks)) <= 20


def test_options_that_make_no_difference(source, written, replayed):
    """A card that queues, and the speed ranges that the call list chose: every move is over in
    time.
    """
    ranges = call_list(source, SPACING, None).ranges
    one = replayed[0][2]
    for other in (
        replay(source, written[1], while_moving="queue"),
        replay(source, written[1], ranges),
    ):
        _, _, two = next(other)
        np.testing.assert_array_equal(one.count, two.count)
        # a speed is rounded to half a step of its register, one in 131 070 of the fastest
        assert np.abs(one.ticks - two.ticks).max() <= SPACING * PCI_8132.clock_hz / 50
