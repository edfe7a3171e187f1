"""The exported call list on the virtual cards: path, calls, cards, pulses, poses, path."""

from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.evidence.trials.card_replay import replay, round_trip
from controllers.card import PCI_8132, PCI_8164, Refused
from kinematics import MotionError, load_machine
from planner import load_program, plan
from planner.export.card_calls import call_list
from planner.export.format import ExportSource
from planner.export.formats.adlink import AdlinkCsv, read_calls


@pytest.fixture(scope="module")
def source():
    machine = load_machine("hexapod")
    made = plan(load_program("circle"), machine)
    return ExportSource("circle", machine, made.trajectory, made.pulses)


@pytest.fixture(scope="module")
def written(source, tmp_path_factory):
    """What the file of calls 16 ms apart says of itself, and its calls."""
    file = tmp_path_factory.mktemp("calls") / "calls.csv"
    return AdlinkCsv(spacing=16e-3).write(source, file), read_calls(file)


@pytest.fixture(scope="module")
def replayed(source, written):
    return replay(source, written[1])


def test_round_trip_of_the_circle(source, written, replayed):
    """Within what the file states of itself and half a pulse of rounding; the platform within what that is of a leg."""
    done, calls = written
    found = round_trip(source, calls, replayed, instants=400)
    assert found.calls == len(calls)
    assert not found.counts.any()
    # beside a pulse the count is half a pulse before or behind, and a tick late: a thousandth at these speeds
    assert found.pulses <= done.error + 0.5 + 2e-3
    # ‖dx‖ ≤ ‖J⁺‖ ‖dq‖ with the translation rows of the inverse Jacobian, every leg being off by that at most
    machine, pose = source.machine, source.trajectory.at(np.linspace(0, source.trajectory.duration, 100)).pose
    gain = np.abs(np.linalg.inv(machine.jacobian(pose))[:, :3]).sum(-1)
    assert found.displacement <= np.linalg.norm(gain, axis=-1).max() * found.pulses * 0.75e-6 * 1.01
    assert 0 < found.path <= found.displacement < 5e-6


def test_pulses_of_the_replay(source, replayed):
    """Each leg on the clock of its card, its pulses adding up, and far from the fastest the card can do."""
    assert [card.name for card in replayed.cards] == ["PCI-8132"] * 2 + ["PCI-8164"] * 4
    for card, start, train, pulses, axis in zip(
        replayed.cards, replayed.starts, replayed.trains, source.pulses.axes, source.machine.axes, strict=True
    ):
        assert card.clock_hz in (PCI_8132.clock_hz, PCI_8164.clock_hz)
        assert train.ticks.dtype == np.int64
        assert np.diff(train.ticks).min() > 0
        assert start + train.direction.sum() == train.count[-1] == pulses.final * axis.direction
        # as many pulses as the plan fires, but for some where an axis turns round
        assert abs(len(train.ticks) - len(pulses.ticks)) <= 20


def test_options_that_make_no_difference(source, written, replayed):
    """Leg 1 on a card that queues, and with the speed range that the call list chose: every move is over in time."""
    calls = [call for call in written[1] if call.name == "leg1"]
    ranges = call_list(source, 16e-3, None).ranges
    for other in (replay(source, calls, while_moving="queue"), replay(source, calls, ranges)):
        one, two = replayed.trains[0], other.trains[0]
        np.testing.assert_array_equal(one.count, two.count)
        # a speed is rounded to half a step of its register, one in 131 070 of the fastest
        assert np.abs(one.ticks - two.ticks).max() <= 16e-3 * PCI_8132.clock_hz / 50


def test_refusals(source, written):
    call = written[1][0]
    with pytest.raises(Refused, match="no card has '_9_move'"):
        replay(source, [replace(call, function="_9_move")])
    with pytest.raises(Refused, match="134217728 is outside"):
        replay(source, [replace(call, position=2**27)])
    with pytest.raises(Refused, match=r"max speed .* is outside ±100 pulses/s of the speed register"):
        replay(source, [replace(call, top=101.0)], [100.0] * 6)


def test_motors_that_compensate_have_no_poses(source, written, replayed):
    compensating = copy(source)
    axes = [SimpleNamespace(name="leg1", compensate=("backlash",))]
    object.__setattr__(compensating, "machine", SimpleNamespace(axes=axes))
    with pytest.raises(MotionError, match="leg1 compensates backlash"):
        round_trip(compensating, written[1], replayed)
