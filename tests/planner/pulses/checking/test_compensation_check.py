"""The check of compensation: a bug in what is counted is seen, since the counts are carried through
play and screw.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import Axis
from planner.export.formats import pulse_csv
from planner.pulses import check, check_file, generate
from planner.pulses.compensation import compensate
from planner.pulses.compensation.compensate import counted_motion
from tests.planner.motions import PULSE, example

TABLE = ((0.0, 0.0), (1e-4, 3e-6), (2e-4, -2e-6), (4e-4, 1e-6))
BOTH = ("lead", "backlash")


def made(seed, kinds=BOTH, **more):
    motion = example(seed)
    home = motion.at(np.zeros(1)).q[0] - 1e-4
    stated = {
        "pulse": PULSE,
        "max_speed": 0.05,
        "max_acceleration": 5.0,
        "backlash": 5e-6,
        "lead_error": TABLE,
    }
    axes = [Axis(f"leg{k}", compensate=kinds, **(stated | more)) for k in range(3)]
    return counted_motion(motion, axes, home), axes, home


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 1000),
    st.sampled_from([("lead",), ("backlash",), BOTH]),
    st.sampled_from(["+", "-"]),
    st.sampled_from(["nearest", "nearest:hysteresis=0.2", "floor", "sampled", "timer"]),
)
def test_honest_counts_leave_the_axes_where_they_are_planned(seed, kinds, pushed, rule):
    motors, axes, home = made(seed, kinds, pushed=pushed)
    found = check(generate(motors, axes, home, rule=rule), motors, axes, home)
    assert found.holds, found.faults
    assert all(axis.behind > 0 for axis in found.axes)


def half(steps, t, true=compensate.taken_up):
    return 0.5 * true(steps, t)


def none(steps, t):
    return np.zeros((4, len(t)))


def twice(steps, t, true=compensate.taken_up):
    return 2 * true(steps, t)


def late(steps, t, true=compensate.taken_up):
    return true(steps, t - 3e-3)


@pytest.mark.parametrize("bug", [half, none, twice, late])
def test_a_bug_in_taking_up_the_play_is_no_proof_of_itself(monkeypatch, bug):
    monkeypatch.setattr(compensate, "taken_up", bug)
    motors, axes, home = made(1)
    found = check(generate(motors, axes, home), motors, axes, home)
    assert not found.holds
    assert all(
        fault.what.startswith("behind play and screw, far from its count: ")
        for fault in found.faults
    )


@pytest.mark.parametrize(
    "table",
    [
        tuple((at, -error) for at, error in TABLE),
        tuple((at, 0.5 * error) for at, error in TABLE),
        tuple((at + 2e-5, error) for at, error in TABLE),
    ],
)
def test_a_table_that_is_mistaken_is_seen(table):
    """What was counted is another screw's; the check carries the counts through the machine's."""
    _, axes, home = made(1)
    wrong, others, _ = made(1, lead_error=table)
    schedule = generate(wrong, others, home)
    assert check(schedule, wrong, others, home).holds
    assert not check(schedule, wrong, axes, home).holds


def test_play_that_is_pushed_to_the_other_side_is_seen():
    motors, axes, home = made(1)
    assert not check(
        generate(motors, axes, home), motors, [replace(axis, pushed="-") for axis in axes], home
    ).holds


def test_the_file_of_a_mistaken_compensation_is_no_proof(monkeypatch, tmp_path):
    for bug in (None, half):
        if bug is not None:
            monkeypatch.setattr(compensate, "taken_up", bug)
        motors, axes, home = made(1)
        schedule = generate(motors, axes, home)
        plan = SimpleNamespace(
            machine=SimpleNamespace(axes=axes, home_q=home), counted=motors, pulses=schedule
        )
        pulse_csv.write(schedule, tmp_path / "p.csv", [1, 1, 1])
        assert check_file(tmp_path / "p.csv", plan).holds == (bug is None)
        (tmp_path / "p.csv").unlink()
