"""Play and screw: worked by hand, against a loop over every sample, and as hysteresis has to be."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics import Axis
from planner.pulses.motion import apply_screw, describe_mechanics, invert_screw, play_operator

places = st.lists(st.integers(-8, 8), min_size=1, max_size=60)


def loop(motor, width, before):
    found = []
    for m in motor:
        before = min(max(before, m), m + width)
        found.append(before)
    return found


def test_play_by_hand():
    """Play of 1.5: pushed up to 3, left there until the motor has crossed the play at 1.5, taken
    down, left again.
    """
    motor = np.array([0, 1, 2, 3, 2, 1, 0, 1, 2, 1], float)
    assert play_operator(motor, 1.5, 0.0).tolist() == [0, 1, 2, 3, 3, 2.5, 1.5, 1.5, 2, 2]


@given(places, st.sampled_from([0.0, 0.3, 1.0, 2.7, 100.0]), st.floats(-10, 10))
def test_run_by_run_is_sample_by_sample(motor, width, before):
    """Exactly: both only choose among the same numbers."""
    motor = np.array(motor, float)
    assert play_operator(motor, width, before).tolist() == loop(motor.tolist(), width, before)


@given(places, places, st.sampled_from([0.3, 1.0, 2.7]))
def test_one_part_goes_on_where_the_other_ended(first, second, width):
    whole = play_operator(np.array([*first, *second], float), width, 0.0)
    begun = play_operator(np.array(first, float), width, 0.0)
    assert whole.tolist() == [*begun, *play_operator(np.array(second, float), width, begun[-1])]


@given(places, st.integers(1, 9))
def test_how_finely_a_way_is_sampled_changes_nothing(motor, parts):
    """Play knows no time: only the turns count."""
    ends = np.array(motor, float)
    fine = np.interp(np.arange((len(ends) - 1) * parts + 1) / parts, np.arange(len(ends)), ends)
    assert play_operator(fine, 2.7, 0.0)[::parts] == pytest.approx(
        play_operator(ends, 2.7, 0.0), abs=1e-12
    )


def test_there_and_back_differ_by_the_play():
    up = np.linspace(0, 1, 101)
    round_trip = play_operator(np.concatenate([up, up[::-1], up]), 0.25, 0.0)
    assert round_trip[:101] == pytest.approx(up)
    assert round_trip[101:202][-50:] == pytest.approx(up[::-1][-50:] + 0.25)
    assert round_trip[-50:] == pytest.approx(up[-50:])
    assert len(play_operator(np.empty(0), 0.25, 0.0)) == 0


def test_the_screw_is_beyond_where_it_counts_by_its_error_and_back():
    axis = Axis("x", lead_error=((0.0, 0.0), (0.1, 1e-4), (0.2, -1e-4)))
    counted = np.array([-0.05, 0.0, 0.05, 0.15, 0.3])
    assert apply_screw(counted, axis) == pytest.approx(
        [-0.05, 0.0, 0.05005, 0.15, 0.2999], abs=1e-16
    )
    assert invert_screw(apply_screw(counted, axis), axis) == pytest.approx(counted, abs=1e-16)
    plain = Axis("x")
    assert apply_screw(counted, plain) is invert_screw(counted, plain) is counted


def test_what_an_axis_states_is_told():
    table = ((0.0, 0.0), (0.1, -2e-5))
    whole = Axis("x", backlash=5e-6, lead_error=table, compensate=("backlash",))
    assert (
        describe_mechanics(whole, 1e-6)
        == "play 5 (made up for, off by up to 1 while crossed), lead error up to 20 (not) µm"
    )
    assert describe_mechanics(Axis("x", kind="rotary", backlash=5e-6), 0.0) == "play 5 (not) µrad"
    assert describe_mechanics(Axis("x"), 0.0) == ""
