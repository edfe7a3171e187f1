"""A stated duration: met, certified, and as smooth as it can be."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import RigidTransform

from kinematics import Axis, Hexapod, MotionError
from planner import Arc, Blend, Dwell, Infeasible, Line, Program, load_program, plan
from planner.limits import limits_of
from planner.path.polynomial import PolynomialPath
from planner.timing import Run, RunSolution, Task, certified_solve, solve_run, solve_stated
from planner.timing.goals import stated_duration
from planner.timing.goals.fallback import MAX_TRIES, SLOWED, weigh_slopes
from tests.planner.timing.smoothest_by_ipopt import smooth_by_ipopt


def straight(length, duration, speed=1e3, acceleration=1e3, jerk=1e4, order=3):
    path = PolynomialPath([0.0, length], np.array([[[1.0]], [[0.0]]]), ["x"])
    axes = [
        Axis(
            "x",
            max_speed=speed,
            max_acceleration=acceleration,
            max_jerk=jerk if order == 3 else None,
        )
    ]
    return solve_stated(certified_solve(path, limits_of(path, axes, order), order), axes, duration)


def roughness(trajectory):
    """∫ Σ q⃛² dt by Simpson's rule on every time piece: exact for straight moves, whose jerk is
    constant there.
    """
    k, h = np.arange(len(trajectory.s)), np.diff(trajectory.knots)
    at = [(trajectory.within(k, share * h).qddd ** 2).sum(1) for share in (0, 0.5, 1)]
    return float((h / 6 * (at[0] + 4 * at[1] + at[2])).sum())


def test_a_motion_that_fell_back_is_left_as_it_is():
    """Otherwise the same motion would be proved again and again."""
    path = PolynomialPath([0.0, 1.0], np.array([[[1.0]], [[0.0]]]), ["x"])
    limits = limits_of(path, [Axis("x", max_speed=1.0, max_acceleration=1.0, max_jerk=10.0)], 3)
    task = Task(path, limits, Run(0, 0), 3)
    slowed = solve_run(task).profile.slowed(1.1)
    spent = RunSolution(
        "solved",
        slowed,
        maker=SLOWED,
        problem=task.coarse,
        tries=MAX_TRIES,
        fallback=slowed,
    )
    use = {limit.name: np.full(len(slowed.h), 1.1) for limit in limits}
    goal = stated_duration.Smoothest({0: slowed})
    assert goal.tighten(task, spent, use) is spent
    better = replace(spent, profile=slowed.slowed(1.0), maker="smoothest")
    assert goal.tighten(task, better, use).profile is slowed


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize(("length", "duration"), [(1.0, 2.0), (1e-3, 0.5), (30.0, 40.0)])
def test_where_no_limit_binds_it_is_the_quintic(length, duration, order):
    """The least ∫ q⃛² dt from rest to rest is 720 L²/T⁵, of 10 τ³ − 15 τ⁴ + 6 τ⁵."""
    found = straight(length, duration, order=order)
    assert found.certificate.holds
    assert set(found.methods) == {"smoothest"}
    assert found.trajectory.duration == pytest.approx(duration, rel=1e-9)
    least = 720 * length**2 / duration**5
    # pieces of constant jerk: above the least by (1/N)² or so
    assert least * (1 - 1e-6) <= roughness(found.trajectory) <= least * (1 + 2e-3)
    tau = np.linspace(0, 1, 501)
    quintic = length * tau**3 * (10 - 15 * tau + 6 * tau**2)
    assert found.trajectory.at(tau * duration).q[:, 0] == pytest.approx(quintic, abs=2e-4 * length)


def test_under_a_speed_limit_it_cruises_and_is_rougher():
    """Half way between the quintic's largest speed, 1.875 L/T, and the least that is possible,
    L/T.
    """
    found = straight(1.0, 2.0, speed=0.7)
    assert found.certificate.holds
    assert found.methods == ("smoothest",)
    v = found.trajectory.at(np.linspace(0, 2, 2001)).qd[:, 0]
    assert v.max() == pytest.approx(0.7, rel=1e-3)
    assert (v > 0.699).mean() > 0.2
    assert roughness(found.trajectory) > 1.05 * 720 / 2**5


def cost_of(problem, jerks, profile):
    """What is minimised: Σ h/2 Σ (q⃛/w)² of both ends."""
    v, a, j, h = profile.v, profile.a, profile.j, profile.h
    ends = (v, a), (v + h * (a + h * j / 2), a + h * j)
    own = [np.stack([j, 3 * speed * push, speed**3], axis=-1) for speed, push in ends]
    sides = [(jerks[:, k] @ own[k][..., None])[..., 0] for k in (0, 1)]
    return sum((h / 2 * (side**2).sum(1)).sum() for side in sides)


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize(("seed", "share"), [(1, 1.05), (4, 1.05), (7, 1.5)])
def test_it_finds_what_fatrop_finds(monkeypatch, seed, share, order):
    """The same duration, and no more jerk than by a solver of others: 1e-6 is what their tolerances
    leave.
    """
    rng = np.random.default_rng(seed)
    curve = CubicSpline(np.arange(6.0), rng.uniform(-1, 1, (6, 3)))
    path = PolynomialPath(curve.x, curve.c, ["x", "y", "z"])
    axes = [
        Axis(name, max_speed=1.0, max_acceleration=3.0, max_jerk=30.0 if order == 3 else None)
        for name in "xyz"
    ]
    limits = limits_of(path, axes, order)
    posed = []
    solve = stated_duration.solve_smoothest
    monkeypatch.setattr(
        stated_duration, "solve_smoothest", lambda *given: posed.append(given) or solve(*given)
    )
    fastest = certified_solve(path, limits, order)
    found = solve_stated(fastest, axes, share * fastest.trajectory.duration)
    assert found.certificate.holds
    assert found.methods == ("smoothest",)
    path, problem, weights, guess = posed[0]
    jerks = weigh_slopes(path, problem, 3, weights)
    ours, theirs = solve(path, problem, weights, guess), smooth_by_ipopt(problem, jerks, guess)
    assert ours.duration == pytest.approx(guess[3].sum(), rel=1e-12)
    least = cost_of(problem, jerks, theirs.require_profile())
    assert cost_of(problem, jerks, ours.require_profile()) <= least * (1 + 1e-6)


@pytest.mark.parametrize("share", [1.01, 1.2, 3.0])
def test_the_circle_takes_as_long_as_stated_and_is_smoother_than_the_fastest_slowed(
    planned, share, hexapod
):
    best = planned("bare-circle", 3)
    duration = share * best.trajectory.duration
    made = plan(load_program("bare-circle"), hexapod, duration=duration)
    assert made.trajectory.duration == pytest.approx(duration, rel=1e-9)
    assert made.certificate.holds
    assert made.methods == ("smoothest",)
    t = np.linspace(0, 1, 20001)
    cost, slowed = (
        np.trapezoid((one.trajectory.at(t * one.trajectory.duration).qddd ** 2).sum(1), t)
        for one in (made, best)
    )
    assert cost < 0.99 * slowed / share**6  # the same motion slower has jerks share³ times as small


@pytest.mark.parametrize("order", [2, 3])
def test_the_longer_the_smoother(order, hexapod):
    """A half turn, a short blend, a line: on the blend, the motion without limits is far outside
    them until × 2.

    Compressed in time by k, a motion has k⁵ times its ∫ q⃛² dt and uses kᵐ times as much of a limit
    with 1/tᵐ. Where that is within the limits, the smoothest of the shorter duration is no rougher.
    """
    arc = Arc(np.array([0, 0, 0.025]), np.array([0, 0, 1.0]), np.pi, rise=3e-3, join=Blend(1e-4))
    program = Program(
        (arc, Line(np.array([0, 0, 0.028]))),
        start=RigidTransform.from_translation([0.015, 0, 0.025]),
    )
    shortest = plan(program, hexapod, order=order).trajectory.duration
    shares = (1.05, 1.5, 2.0, 3.0)
    made = [plan(program, hexapod, order=order, duration=share * shortest) for share in shares]
    assert all(one.certificate.holds for one in made)
    assert {method for one in made for method in one.methods} == {"smoothest"}
    rough = [roughness(one.trajectory) for one in made]
    compared = 0
    for k, (shorter, longer) in zip(
        np.divide(shares[1:], shares[:-1]), pairwise(range(len(shares))), strict=True
    ):
        assert rough[longer] < rough[shorter]
        worst = made[longer].certificate.worst
        if max(worst["speed"] * k, worst["acceleration"] * k**2, worst.get("jerk", 0.0) * k**3) < 1:
            # 1e-4: what the solver's tolerance leaves
            assert rough[shorter] <= rough[longer] * k**5 * (1 + 1e-4)
            compared += 1
    assert compared > 0


def test_runs_and_rests(hexapod):
    """Every run takes as much longer as the moving time does; the dwells stay."""
    program = Program((Line(np.array([0, 0, 5e-3])), Dwell(0.5), Line(np.array([4e-3, 0, 5e-3]))))
    best = plan(program, hexapod)
    made = plan(Program(program.segments, duration=2.0), hexapod)
    assert made.trajectory.duration == pytest.approx(2.0, rel=1e-9)
    assert made.certificate.holds

    def moving(one):
        return [np.diff(one.trajectory.knots)[one.trajectory.piece == k].sum() for k in (0, 1)]

    first, second = (moving(one) for one in (best, made))
    slower = 1.5 / (best.trajectory.duration - 0.5)
    assert second[1] == pytest.approx(slower * first[1], rel=1e-6)
    assert second[0] - 0.5 == pytest.approx(slower * (first[0] - 0.5), rel=1e-6)


def test_less_than_the_shortest_is_refused_and_named(planned, hexapod):
    shortest = planned("bare-circle", 2).trajectory.duration
    with pytest.raises(
        Infeasible, match=r"the fastest motion found within the limits takes 1\.20"
    ) as told:
        plan(load_program("bare-circle"), hexapod, order=2, duration=0.99 * shortest)
    assert told.value.limit == pytest.approx(shortest, abs=1e-6)
    made = plan(load_program("bare-circle"), hexapod, order=2, duration=told.value.limit)
    assert made.certificate.holds
    assert made.trajectory.duration == pytest.approx(told.value.limit, abs=2e-6)
    with pytest.raises(MotionError, match="positive"):
        plan(load_program("bare-circle"), hexapod, duration=float("nan"))


def test_a_program_file_states_it(tmp_path):
    file = tmp_path / "slow.toml"
    file.write_text(
        'schema = 1\nduration = "1.5 min"\n[[segment]]\nline = { to = ["0 mm", "0 mm", "5 mm"] }\n'
    )
    assert load_program(str(file)).duration == 90.0
    file.write_text(file.read_text().replace("1.5 min", "-1 s"))
    with pytest.raises(MotionError, match="duration"):
        load_program(str(file))


LENGTH, BAND, IN_TIME = 0.05, (0.003, 0.004), 0.05
LINE = PolynomialPath([0.0, LENGTH], np.array([[[1.0]], [[0.0]]]), ["x"])


def stepper(duration, order=3):
    stated = {
        "max_speed": 0.02,
        "max_acceleration": 0.225,
        "resonance": (BAND,),
        "resonance_time": IN_TIME,
    }
    axes = [Axis("x", max_jerk=4.0 if order == 3 else None, **stated)]
    return solve_stated(certified_solve(LINE, limits_of(LINE, axes, order), order), axes, duration)


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("duration", [3.0, 9.0, 12.4, 17.5, 25.0, 40.0])
def test_a_resonance_band_is_crossed_in_time_or_not_at_all(order, duration):
    """Above the band until L/high = 12.5 s, below it from L/low = 16.7 s on: the average is between
    its two edges.
    """
    found = stepper(duration, order)
    assert found.certificate.holds
    assert found.trajectory.duration == pytest.approx(duration, rel=1e-9)
    t = np.linspace(0, duration, 400_001)
    v = found.trajectory.at(t).qd[:, 0]
    assert (v.max() > BAND[1]) == (duration < LENGTH / BAND[1])
    edges = np.diff(np.concatenate([[0], (v >= BAND[0]) & (v <= BAND[1]), [0]]))
    longest = (np.flatnonzero(edges < 0) - np.flatnonzero(edges > 0)).max(initial=0) * t[1]
    assert longest <= IN_TIME + 2 * t[1]
    if duration >= 25:
        assert set(found.methods) == {"smoothest"}


@pytest.mark.parametrize("order", [2, 3])
def test_an_axis_at_rest_does_not_keep_another_from_its_band(order):
    """The second axis does not move at all. The first takes as long as it does alone."""
    path = PolynomialPath([0.0, LENGTH], np.array([[[1.0, 0.0]], [[0.0, 0.0]]]), ["x", "y"])
    stated = {
        "max_speed": 0.02,
        "max_acceleration": 0.225,
        "resonance": (BAND,),
        "resonance_time": IN_TIME,
    }
    axes = [Axis(name, max_jerk=4.0 if order == 3 else None, **stated) for name in path.names]
    found = solve_stated(certified_solve(path, limits_of(path, axes, order), order), axes, 9.0)
    assert found.certificate.holds
    assert found.methods == stepper(9.0, order).methods == ("paced",)
    assert found.trajectory.duration == pytest.approx(9.0, rel=1e-9)


@pytest.mark.parametrize("order", [2, 3])
def test_a_duration_whose_average_speed_is_in_the_band_is_refused_with_one_that_is_not(order):
    """16 s: 3.1 mm/s on average. The stated remedy succeeds."""
    with pytest.raises(
        Infeasible, match=r"crosses the band from 3 to 4 mm/s in time: state one 1\.\d+ times"
    ) as told:
        stepper(16.0, order)
    assert told.value.limit == IN_TIME
    assert told.value.value > IN_TIME
    factor = float(re.search(r"state one (\S+) times", str(told.value))[1])
    assert 1.0 < factor < 1.06
    assert stepper(16.0 * factor, order).certificate.holds


def test_of_many_axes_each_crosses_its_bands_in_time(hexapod):
    """The legs on a circle come to a rest and go back, each at another place: they stay below, or
    go through fast.
    """
    bands = {"resonance": ((2e-3, 2.5e-3),), "resonance_time": 0.2}
    axes = [replace(axis, **bands) for axis in hexapod.axes]
    machine = Hexapod(
        hexapod.base, hexapod.platform, axes=axes, home=hexapod.home, max_tilt=np.deg2rad(35)
    )
    program = Program([Line([0.01, 0, 0.02])], start=RigidTransform.from_translation([0, 0, 0.02]))
    shortest = plan(program, machine, order=2).trajectory.duration
    for duration in (1.3 * shortest, 8.0):
        made = plan(program, machine, order=2, duration=duration)
        assert made.certificate.holds
        assert made.trajectory.duration == pytest.approx(duration, rel=1e-9)
