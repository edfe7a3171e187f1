"""What a saving is told against: a timing under the same limits where there is one, else what it
leaves out.
"""

from dataclasses import replace

import numpy as np
import pytest

from kinematics import load_machine
from planner import Blend, Fit, Line, Program, classical, plan
from planner.baselines import describe_differences, missing_limits, pick_baseline

LINE = Program([Line([0, 0, 0.02])])


@pytest.fixture(scope="module")
def timings(planned):
    found = planned("bare-circle", 3)
    return found, {
        kind: classical(found, kind) for kind in ("trapezoid", "s-curve", "quarter-sine")
    }


def test_with_a_jerk_limit_the_saving_is_told_against_the_s_curve(timings):
    """The only one that keeps jerk; the others are faster than the plan itself, which says nothing
    against it.
    """
    found, every = timings
    assert pick_baseline(found, tuple(every.values())) is every["s-curve"]
    assert (
        missing_limits(found, every["s-curve"])
        == describe_differences(found, every["s-curve"])
        == ()
    )
    assert found.trajectory.duration < every["s-curve"].duration
    for kind in ("trapezoid", "quarter-sine"):
        assert missing_limits(found, every[kind]) == ("jerk",)
        assert describe_differences(found, every[kind]) == ("without jerk",)
        assert every[kind].duration < found.trajectory.duration


def test_without_one_the_quickest_is_the_baseline(planned, timings):
    found, every = planned("bare-circle", 2), timings[1]
    best = pick_baseline(found, tuple(every.values()))
    assert best.duration == min(one.duration for one in every.values())
    assert missing_limits(found, best) == ()
    assert describe_differences(found, every["s-curve"]) == ("keeps jerk too",)


@pytest.mark.parametrize("order", [2, 3])
def test_a_resonance_band_that_only_the_plan_keeps_is_named(order, hexapod):
    axes = [
        replace(axis, resonance=((0.002, 0.015),), resonance_time=0.03) for axis in hexapod.axes
    ]
    found = plan(LINE, hexapod.driven_by(axes), order=order)
    baseline = pick_baseline(
        found, [classical(found), *([classical(found, "s-curve")] if order == 3 else [])]
    )
    assert missing_limits(found, baseline) == ("resonance",)
    assert found.trajectory.duration > baseline.duration  # the saving is negative, and this is why
    assert "without resonance" in describe_differences(found, baseline)


@pytest.mark.parametrize("kind", ["synchronised", "independent"])
def test_a_resonance_band_that_a_move_between_poses_lingers_in_is_named(kind):
    """Such a move is never slowed down for a band: its certificate finds it in there, and it is not
    kept.
    """
    machine = load_machine("traverser")
    slides = [
        axis if axis.kind == "rotary" else replace(axis, resonance=((0.005, 0.0125),))
        for axis in machine.axes
    ]
    found = plan(Program([Line([0.1, 0, 0])]), machine.driven_by(slides), order=2)
    quick = classical(found, kind)
    assert quick.duration < found.trajectory.duration / 2
    assert quick.certificate.worst["resonance"] > 1
    assert missing_limits(found, quick) == ("resonance",)
    assert describe_differences(found, quick)[:2] == ("without resonance", "not certified")
    assert missing_limits(found, classical(found)) == ()


def test_moves_between_poses_say_what_they_leave(plan_bundled):
    found = plan_bundled("circle", "hexapod", 3)
    between = classical(found, "synchronised")
    told = describe_differences(found, between)
    assert {"jerk", "tool speed", "tilt", "clearance", "force"} <= set(
        missing_limits(found, between)
    )
    assert told[-1] == f"leaves the path by up to {1e3 * between.deviation.distance:.3g} mm"
    assert pick_baseline(found, [between, classical(found)]).kind == "trapezoid"


def test_stops_that_the_plan_does_not_make_are_named(hexapod):
    """A blend is passed by the plan, and stopped at by every baseline timing."""
    ways = [Line([0.01, 0, 0.02], join=Blend(5e-4)), Line([0.01, 0.01, 0.02])]
    found = plan(Program(ways, start_speed=0.001), hexapod, order=2)
    told = describe_differences(found, classical(found))
    assert told == ("stops at every join", "from rest to rest")
    assert np.all(np.array(found.path.end_speeds) == (0.001, 0.0))


@pytest.mark.parametrize(
    ("turn", "told"), [(0.0, ()), (0.01, ("stops at 1 corner that the plan rounds",))]
)
def test_of_a_fitted_path_only_its_corners_are_stops(hexapod, turn, told):
    ways = [Line([0.005, 0, 0.02], join=Fit(5e-5)), Line([0.01, turn, 0.02], join=Fit(5e-5))]
    found = plan(Program([Line([0, 0, 0.02]), *ways]), hexapod, order=2)
    assert describe_differences(found, classical(found)) == told
