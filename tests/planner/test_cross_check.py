"""toppra beside our own solver: a plan by it, a cross-check, and what is refused."""

import sys

import pytest

from kinematics import MotionError, NotInstalled
from planner import Line, Program, load_program, plan
from planner.cross_check import cross_check
from planner.timing.order2 import toppra_


@pytest.fixture(scope="module")
def program():
    return load_program("bare-circle")


@pytest.fixture(scope="module")
def own(program, hexapod):
    return plan(program, hexapod, order=2)


@pytest.fixture
def without_toppra(monkeypatch):
    toppra_._toppra.cache_clear()
    monkeypatch.setitem(sys.modules, "toppra.algorithm", None)
    yield
    toppra_._toppra.cache_clear()


def test_a_plan_by_toppra_is_certified_and_as_fast(program, hexapod, own):
    made = plan(program, hexapod, order=2, solver="toppra")
    assert made.certificate.holds
    assert all("toppra" in method for method in made.methods)
    assert made.trajectory.duration == pytest.approx(own.trajectory.duration, rel=1e-5)
    assert (
        made.trajectory.duration != own.trajectory.duration
    )  # it is another solver's, not ours once more
    assert made.pulses.total == own.pulses.total
    again = cross_check(made)  # ours is then made for it
    assert again.ours.trajectory.duration == own.trajectory.duration
    assert again.theirs is not None
    assert again.theirs.trajectory.duration == made.trajectory.duration


def test_both_motions_stand_side_by_side(own):
    found = cross_check(own)
    assert found.theirs is not None
    assert found.theirs.certificate.holds
    assert found.ours.trajectory is own.trajectory
    assert abs(found.difference) < 1e-5
    times, uses = found.tables()
    assert dict(zip(times.columns[0].values, times.columns[1].values, strict=True)) == {
        "pulsepath": own.trajectory.duration,
        "toppra": found.theirs.trajectory.duration,
    }
    assert list(uses.columns[2].values) == [
        found.theirs.certificate.worst[name] for name in uses.columns[0].values
    ]


def test_a_plan_of_order_3_is_checked_at_order_2(hexapod):
    made = plan(Program((Line([0, 0, 0.01]), Line([0.004, 0, 0.01]))), hexapod, order=3)
    found = cross_check(made)
    assert found.theirs is not None
    assert "jerk" not in found.theirs.certificate.worst
    assert found.ours.trajectory.duration < made.trajectory.duration
    assert abs(found.difference) < 1e-4


def test_where_toppra_gives_no_motion_that_is_told(monkeypatch, own, program, hexapod):
    def gives_up(*_):
        return MotionError("toppra found no motion over 1000 intervals")

    monkeypatch.setattr(toppra_, "largest_speeds", gives_up)
    found = cross_check(own)
    assert found.theirs is None
    assert found.difference is None
    assert "toppra gave no motion: toppra found no motion over 1000 intervals" in str(found)
    with pytest.raises(MotionError, match="toppra found no motion"):
        plan(program, hexapod, order=2, solver="toppra")


@pytest.mark.parametrize(
    ("asked", "phrase"),
    [
        ({"order": 3}, "order=2"),
        ({}, "order=2"),  # the hexapod limits jerk
        ({"order": 2, "duration": 9.0}, "fastest motion, not one of 9 s"),
        ({"order": 2, "solver": "ipopt"}, 'solver is "ipopt"; expected "passes" or "toppra"'),
    ],
)
def test_what_it_is_not_for_is_refused(program, hexapod, asked, phrase):
    with pytest.raises(MotionError, match=phrase):
        plan(program, hexapod, **{"solver": "toppra", **asked})


def test_without_toppra_both_are_refused_and_nothing_else(without_toppra, program, hexapod, own):
    with pytest.raises(NotInstalled, match="solver toppra needs toppra"):
        plan(program, hexapod, order=2, solver="toppra")
    with pytest.raises(NotInstalled, match="cross-check needs toppra"):
        cross_check(own)
