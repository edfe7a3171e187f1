"""Limits that shaping breaks: lowered where they are exceeded, and along the whole path where that
is not enough.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from kinematics import Shaper, load_machine
from planner import Arc, Infeasible, Line, Place, Program, plan
from planner.active_limits import tabulate_segments
from planner.limits import limits_of
from planner.limits.lowered import Shares
from planner.shaping import keep_limits
from planner.shaping.shaped_proof import advise_shapers
from planner.shaping.shaping_cost import LoweredStretch, ShapingCost
from planner.timing import Settings, certified_solve

CAP = 0.19
SLOW = Shaper("zv", 5.0, 0.05)


def gantry(shaper=SLOW):
    machine = load_machine("traverser")
    own = {
        "travel": (-0.005, 0.2),
        "pulse": 5e-6,
        "max_speed": 0.2,
        "max_acceleration": 3.0,
        "max_pulse_rate": None,
    }
    axes = [
        replace(axis, **own, max_jerk=None) if axis.kind == "linear" else axis
        for axis in machine.axes
    ]
    return machine.driven_by([replace(axes[0], shaper=shaper), *axes[1:]])


# the tool's speed is a mean of what x did at two instants and what y does between them
CIRCLE = Program((Line([0.02, 0.05, 0]), Arc([0.05, 0.05, 0], [0, 0, 1], 4 * np.pi, speed=CAP)))


@pytest.fixture(scope="module")
def bare():
    return plan(CIRCLE, gantry(None))


@pytest.fixture(scope="module")
def local():
    return plan(CIRCLE, gantry())


@pytest.fixture(scope="module")
def everywhere():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(keep_limits, "LOCAL_ROUNDS", 0)
        return plan(CIRCLE, gantry())


def test_a_stated_duration_is_refused_by_that_of_the_fastest_behind_the_shapers(local):
    """What it says to state is planned; what is stated is said as it was."""
    stated = local.duration - 0.02
    assert stated > local.duration - local.shaped.cost.lowering - 0.05
    with pytest.raises(Infeasible) as no:
        plan(CIRCLE, gantry(), duration=stated)
    assert f"duration {stated:.6g} s is below the" in str(no.value)
    least = float(re.search(r"takes (\S+) s: state that or more", str(no.value))[1])
    assert local.duration <= least <= local.duration + 1e-6
    made = plan(CIRCLE, gantry(), duration=least)
    assert made.duration == pytest.approx(least, abs=2e-6)
    assert max(made.shaped.worst.values()) <= 1
    assert made.shaped.cost.lowered.keys() == local.shaped.cost.lowered.keys()


def test_the_parts_of_the_cost_add_up_as_they_are_shown():
    shares = {"tool speed": Shares(np.array([0.0, 0.9996, 1.0]), np.array([0.99896, 1.0]))}
    place = Place(0.0, 1)
    stretch = LoweredStretch("tool speed", 0.99896, place, place, place)
    for lowering in np.linspace(1e-5, 3e-4, 30).tolist():
        cost = ShapingCost(0.022738, 1.69, lowering, 1.0, shares, stretches=(stretch,))
        total, length, rest = (
            float(each) for each in re.findall(r"(\d+\.\d+) ms", cost.describe())
        )
        assert total == pytest.approx(length + rest, abs=1e-9)
        assert total == pytest.approx(1e3 * cost.total, abs=0.006)
        assert rest == pytest.approx(1e3 * lowering, abs=0.011)
    assert cost.describe_lowered() == "tool speed to 99.89 % near segment 1 (100 % of the path)"


def test_a_limit_is_lowered_where_it_is_exceeded_alone(bare, local, everywhere):
    cost, length = local.shaped.cost, float(local.path.breaks[-1])
    assert not cost.everywhere
    assert set(cost.lowered) == {"tool speed"}
    shares = cost.lowered["tool speed"]
    assert shares.lowered_length < 0.2 * length
    # most of the circle runs at its cap still
    fast = local.certificate.attained["tool speed"] > 0.999
    assert np.diff(local.trajectory.knots)[fast].sum() > 0.6 * local.trajectory.duration
    assert local.trajectory.duration - bare.duration < 0.2 * (
        everywhere.trajectory.duration - bare.duration
    )
    assert everywhere.shaped.cost.everywhere


@pytest.mark.parametrize("name", ["local", "everywhere"])
def test_all_of_the_limit_is_kept_and_no_more_than_that_behind_the_shapers(name, request):
    """By the speed of sums of copies, which are the tool's place: x, y and z are axes here."""
    made = request.getfixturevalue(name)
    shaped, base = made.shaped.motion, made.trajectory
    t = np.linspace(0, shaped.duration, 200_001)
    velocity, on_line = np.zeros((len(t), 3)), np.zeros(len(t), bool)
    for delay, weight in zip(shaped.copies.delays, shaped.copies.weights, strict=True):
        own = t - delay
        state = base.at(np.clip(own, 0, base.duration))
        velocity += weight[:3] * state.qd[:, :3] * ((own > 0) & (own < base.duration))[:, None]
        on_line |= state.piece == 0
    use = np.where(on_line, 0, np.linalg.norm(velocity, axis=1) / CAP).max()
    assert 0.99 < use <= made.shaped.worst["tool speed"] <= 1
    assert made.certificate.holds


@pytest.mark.parametrize("name", ["local", "everywhere"])
def test_the_cost_is_what_the_machine_takes_longer_than_without_shapers(name, request, bare):
    made = request.getfixturevalue(name)
    cost = made.shaped.cost
    # behind shapers a motion is solved on a grid; without them its cruises are in closed form
    limits = limits_of(bare.path, bare.machine.axes, bare.order)
    gridded = certified_solve(
        bare.path, limits, bare.order, settings=Settings(whole=True)
    ).trajectory.duration
    assert gridded == pytest.approx(bare.duration, rel=5e-5)
    assert cost.unlowered == pytest.approx(gridded, rel=1e-9)
    assert cost.total == pytest.approx(made.duration - gridded, abs=1e-8)
    assert cost.length == pytest.approx(gantry().axes[0].shaper.impulses[1][-1])
    assert cost.lowering > 0
    stretches = cost.stretches
    assert min(each.share for each in stretches) == cost.lowered["tool speed"].least
    assert all(each.since.s < each.lowest.s < each.until.s for each in stretches)
    assert stretches[0].lowest.segment == (2 if name == "local" else stretches[0].lowest.segment)
    assert f"{1e3 * cost.total:.2f} ms more" in cost.describe()
    assert ("whole path" in cost.describe_lowered()) == (name == "everywhere")


@pytest.mark.parametrize("name", ["local", "everywhere"])
def test_the_lowered_limit_is_what_holds_the_motion_back(name, request):
    told = {
        column.name: column.raw
        for column in tabulate_segments(request.getfixturevalue(name)).columns
    }
    assert told["held back by"][1] == "tool speed"
    assert told["for"][1] > 80


def test_a_machine_whose_shapers_break_nothing_pays_their_length():
    made = plan(Program((Line([0.02, 0.05, 0]),)), gantry())
    assert made.shaped.cost.lowering == 0
    assert made.shaped.cost.total == made.shaped.cost.length
    assert not made.shaped.cost.stretches
    assert made.shaped.cost.describe_lowered() == ""


def test_a_jerk_limited_motion_is_lowered_in_places_too(bare):
    machine = gantry()
    machine = machine.driven_by([replace(axis, max_jerk=100.0) for axis in machine.axes])
    made = plan(CIRCLE, machine)
    assert made.order == 3
    assert not made.shaped.cost.everywhere
    assert made.shaped.holds
    assert made.shaped.cost.lowering < 0.01 * bare.duration


@pytest.mark.parametrize(
    ("kind", "advice"), [("zv", "zv is the shortest"), ("zvd", "shorter shaper zv instead of zvd")]
)
def test_a_shorter_shaper_is_advised_only_where_there_is_one(kind, advice):
    assert advice in advise_shapers(gantry(Shaper(kind, 22.0)).axes)
