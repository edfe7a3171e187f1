"""Order 3: against the closed-form seven-segment motion, FATROP and IPOPT, and what happens without
an answer.
"""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.evidence.peers.casadi_ import solve_by_casadi
from kinematics import Axis, MotionError
from planner import Trajectory
from planner.certificate import certify
from planner.limits import limits_of
from planner.path.polynomial import PolynomialPath
from planner.timing import (
    SOLVER_AIM,
    Run,
    RunSolution,
    Task,
    at_speeds,
    attempts,
    certified_solve,
    close_profile,
    jerk_problem,
    sample_limit_use,
    solve_jerk_limited,
    solve_once,
    solve_run,
    third_order,
)
from planner.timing.order3 import solve as solver_module
from planner.timing.order3.interior_point import TOLERANCE
from planner.timing.order3.peaks import SMALL_EXCESS


def line(length):
    return PolynomialPath([0.0, length], np.array([[[1.0]], [[0.0]]]), ["x"])


def curve(backwards=False):
    """x = s, y = s² − s³, z = s⁴/2 over [0, 1]: bends one way and then the other.

    Or the same, run from 1 to 0.
    """
    c = np.zeros((5, 1, 3))
    c[3, 0, 0] = 1.0
    c[2, 0, 1], c[1, 0, 1] = 1.0, -1.0
    c[0, 0, 2] = 0.5
    if backwards:
        for axis in range(3):
            c[:, 0, axis] = flipped(c[:, 0, axis])
    return PolynomialPath([0.0, 1.0], c, ["x", "y", "z"])


def flipped(coefficients):
    """p(1 − s), highest power first."""
    composed = np.poly1d([0.0])
    for c in coefficients:
        composed = composed * np.poly1d([-1.0, 1.0]) + c
    return np.pad(composed.coeffs, (len(coefficients) - len(composed.coeffs), 0))


def limits_on(path, speed, acceleration, jerk):
    axes = [
        Axis(name, max_speed=speed, max_acceleration=acceleration, max_jerk=jerk)
        for name in path.names
    ]
    return limits_of(path, axes, 3)


def solved(path, limits):
    """By the general solver, straight or not."""
    problem, start = jerk_problem(path, limits, Run(0, 0))
    return third_order(problem, start.on(problem.s)).require_profile()


CURVE = {"speed": 0.6, "acceleration": 1.5, "jerk": 8.0}


REGIMES = pytest.mark.parametrize(
    ("length", "speed", "acceleration", "jerk"),
    [
        pytest.param(1.0, 1.0, 2.0, 10.0, id="V and A are reached"),
        pytest.param(1.0, 10.0, 1.0, 10.0, id="A is reached"),
        pytest.param(1.0, 0.2, 100.0, 1.0, id="V is reached"),
        pytest.param(1.0, 10.0, 100.0, 1.0, id="neither is reached"),
        pytest.param(0.0508, 0.02, 0.225, 4.0, id="the hexapod's stroke"),
        pytest.param(1e-5, 0.02, 0.225, 4.0, id="ten microns"),
        pytest.param(10.0, 0.02, 0.225, 4.0, id="ten metres"),
        pytest.param(0.0508, 0.02, 0.225, 4000.0, id="jerk all but free"),
        pytest.param(5.0, 0.02, 2.25, 40.0, id="ramps of 50 000th of the way"),
    ],
)


@REGIMES
def test_the_grid_rises_from_end_to_end(length, speed, acceleration, jerk):
    """An interval of no length would divide by zero: the solvers then stop at once, or never."""
    path = line(length)
    problem, start = jerk_problem(path, limits_on(path, speed, acceleration, jerk), Run(0, 0))
    assert (problem.s[0], problem.s[-1]) == (0.0, length)
    assert (np.diff(problem.s) > 0).all()
    guess = start.on(problem.s)
    assert np.isfinite(guess).all()
    assert (guess[3] > 0).all()


@REGIMES
def test_a_line_takes_its_seven_segment_time(length, speed, acceleration, jerk, seven_segments):
    """240 intervals of constant jerk do not hit the seven segments' corners exactly: within 1e-3,
    and never faster.
    """
    path = line(length)
    profile = solved(path, limits_on(path, speed, acceleration, jerk))
    time = seven_segments(length, speed, acceleration, jerk)
    assert time * (1 - 1e-6) <= profile.duration <= time * (1 + 1e-3)


def test_the_motion_is_continuous_and_rests_at_both_ends():
    path = curve()
    profile = solve_run(Task(path, limits_on(path, **CURVE), Run(0, 0), 3)).profile
    s, v, a, j, h = profile.s, profile.v, profile.a, profile.j, profile.h
    ends = [s + h * (v + h * (a / 2 + h * j / 6)), v + h * (a + h * j / 2), a + h * j]
    for values, end, size in zip((s, v, a), ends, (1.0, v.max(), np.abs(a).max()), strict=True):
        assert np.abs(values[1:] - end[:-1]).max() <= 1e-12 * size
    assert (s[0], v[0], a[0]) == (0.0, 0.0, 0.0)
    # closed by least squares after the solver: rounding of sums over 240 intervals
    assert ends[0][-1] == pytest.approx(1.0, abs=1e-11)
    assert ends[1][-1] == pytest.approx(0.0, abs=1e-11 * v.max())
    assert ends[2][-1] == pytest.approx(0.0, abs=1e-11 * np.abs(a).max())
    assert (h > 0).all()


def test_every_limit_is_kept_and_some_limit_used_nearly_everywhere():
    """A time-optimal motion has a limit active at all times, but for the intervals in which the
    active one changes.
    """
    path = curve()
    limits = limits_on(path, **CURVE)
    profile = solve_run(Task(path, limits, Run(0, 0), 3)).profile
    knots = np.append(0.0, np.cumsum(profile.h))
    use = certify(
        Trajectory(path, knots, profile.s, profile.v, profile.a, profile.j, profile.piece), limits
    ).use
    together = np.max(list(use.values()), 0)
    assert together.max() < 1 + 1e-3  # between grid points; the rounds of certifying take that off
    assert profile.h[together < 0.99].sum() < 0.03 * profile.duration


def test_peaks_between_grid_points_are_heeded_while_it_is_solved():
    """A motion that keeps every row at the grid points exceeds limits between them; with a look at
    these it does not, and takes hardly longer: as long as a motion that exceeds them so little may
    be slower.
    """
    path = curve()
    limits = limits_on(path, **CURVE)
    problem, start = jerk_problem(path, limits, Run(0, 0))

    def look(motion, names):
        return sample_limit_use(path, [limit for limit in limits if limit.name in names], motion)

    blind, heeding = (
        solve_jerk_limited(problem, start.on(problem.s), look=each) for each in (None, look)
    )
    assert heeding.problem is not None
    assert heeding.use is not None
    excess, left = (
        max(float(use.max()) for use in sample_limit_use(path, limits, one.profile).values()) - 1
        for one in (blind, heeding)
    )
    assert excess > 1e-5
    assert left < SMALL_EXCESS
    assert max(float(use.max()) for use in heeding.use.values()) == pytest.approx(
        1 + left, abs=1e-7
    )
    assert blind.duration < heeding.duration < blind.duration * (1 + excess)
    assert any((block.room < SOLVER_AIM).any() for block in heeding.problem.blocks)
    assert all((block.room == SOLVER_AIM).all() for block in problem.blocks)


@pytest.mark.parametrize("solver", ["fatrop", "ipopt"])
def test_it_finds_what_others_find(solver):
    path = curve()
    problem, start = jerk_problem(path, limits_on(path, **CURVE), Run(0, 0))
    guess = start.on(problem.s)
    ours, reference = third_order(problem, guess), solve_by_casadi(problem, guess, solver)
    assert ours.duration == pytest.approx(reference.duration, rel=1e-6)
    assert np.abs(ours.profile.v - reference.profile.v).max() < 1e-2 * reference.profile.v.max()


def test_a_path_takes_as_long_backwards():
    forth, back = (
        solve_run(Task(path, limits_on(path, **CURVE), Run(0, 0), 3)).profile.duration
        for path in (curve(), curve(backwards=True))
    )
    assert back == pytest.approx(forth, rel=1e-3)


def test_slower_limits_by_powers_of_k_take_k_times_as_long():
    """V/k, A/k², J/k³: the same motion in another unit of time."""
    path, k = curve(), 1000.0
    slow = limits_on(path, CURVE["speed"] / k, CURVE["acceleration"] / k**2, CURVE["jerk"] / k**3)
    found = [
        solve_run(Task(path, limits, Run(0, 0), 3)).profile.duration
        for limits in (limits_on(path, **CURVE), slow)
    ]
    assert found[1] == pytest.approx(k * found[0], rel=1e-6)


@pytest.mark.parametrize("end", [0, 1])
def test_the_largest_speed_at_an_end_is_that_of_a_ramp(end):
    """From v to rest over L, with speed and acceleration out of reach: (J L²)^(1/3), found from
    half of it.
    """
    path, jerk, length = line(2.0), 3.0, 2.0
    speeds = [0.0, 0.0]
    speeds[end] = 0.5 * np.cbrt(jerk * length**2)
    run = Run(0, 0, at_speeds(*speeds))
    problem, start = jerk_problem(path, limits_on(path, 100.0, 100.0, jerk), run)
    speeds[end] = 100.0
    found = third_order(
        replace(problem, ends=at_speeds(*speeds)), start.on(problem.s), fast_end=end
    )
    profile = found.require_profile()
    largest = profile.last_speed if end else profile.v[0]
    assert largest == pytest.approx(np.cbrt(jerk * length**2), rel=1e-3)
    assert largest <= np.cbrt(jerk * length**2) * (1 + 1e-6)


def test_a_problem_the_other_way_has_the_same_answer():
    """Rows that heed the direction too: as forces do, asymmetric limits, and blocks that are kept
    at one end.
    """
    path = curve()
    axes = [
        Axis(n, max_speed=0.6, max_acceleration=(1.5, 1.0), max_jerk=(8.0, 10.0))
        for n in path.names
    ]
    problem, start = jerk_problem(path, limits_of(path, axes, 3), Run(0, 0))
    guess = start.on(problem.s)
    forth = third_order(problem, guess)
    v, a, j, h = guess[:, ::-1]
    back = third_order(problem.reversed(), np.stack([v + h * (a + h * j / 2), -(a + h * j), j, h]))
    # rows without s⃛ are kept at starts and middles: the ends of the other way
    assert back.duration == pytest.approx(forth.duration, rel=1e-4)
    twice = problem.reversed().reversed()
    assert all(
        np.array_equal(values, other.start[term])
        for block, other in zip(problem.blocks, twice.blocks, strict=True)
        for term, values in block.start.items()
    )


def test_less_room_is_kept():
    """Room taken off a limit on some intervals is kept there."""
    path = curve()
    problem, start = jerk_problem(path, limits_on(path, **CURVE), Run(0, 0))
    middle = slice(100, 140)
    rooms = np.ones(problem.intervals)
    rooms[middle] = 0.5
    tight = replace(
        problem,
        blocks=tuple(
            replace(b, room=rooms if b.name == "speed" else b.room) for b in problem.blocks
        ),
    )
    free, kept = (third_order(p, start.on(problem.s)).profile for p in (problem, tight))
    speed = np.abs(path.derivatives(kept.s, kept.piece)[1] * kept.v[:, None]).max(1)
    assert (speed[middle] <= 0.5 * CURVE["speed"] * (1 + 1e-6)).all()
    assert speed.max() > 0.5 * CURVE["speed"]
    assert kept.duration > free.duration


def test_what_a_solver_leaves_is_closed():
    """Columns a millionth off miss the end by as much; closed, they arrive, at rest, by a change of
    that size.
    """
    path = curve()
    problem, start = jerk_problem(path, limits_on(path, **CURVE), Run(0, 0))
    exact = third_order(problem, start.on(problem.s)).profile
    noise = 1 + 1e-6 * np.random.default_rng(5).normal(size=(4, problem.intervals))
    closed = close_profile(problem, np.stack([exact.v, exact.a, exact.j, exact.h]) * noise)
    s, v, a, j, h = (x[-1] for x in (closed.s, closed.v, closed.a, closed.j, closed.h))
    assert s + h * (v + h * (a / 2 + h * j / 6)) == pytest.approx(1.0, abs=1e-11)
    assert v + h * (a + h * j / 2) == pytest.approx(0.0, abs=1e-11 * closed.v.max())
    assert a + h * j == pytest.approx(0.0, abs=1e-11 * np.abs(closed.a).max())
    assert np.abs(closed.v - exact.v).max() < 1e-4 * exact.v.max()
    assert closed.duration == pytest.approx(exact.duration, rel=1e-5)


def fail(problem, guess, **_):
    return RunSolution.refused(MotionError("stopped without an answer"))


@pytest.mark.parametrize("path", [curve(), line(0.0508)], ids=["curve", "line"])
def test_without_solvers_the_averaged_motion_holds_its_certificate(monkeypatch, path):
    limits = limits_on(path, **CURVE)
    best = certified_solve(path, limits, 3)
    monkeypatch.setattr(solver_module, "third_order", fail)
    monkeypatch.setattr(attempts, "straight", lambda problem: None)
    found = certified_solve(path, limits, 3)
    assert found.methods == ("averaged, slowed",)
    assert found.certificate.holds
    # slowed as a whole until it holds: slower than the optimum, and at the limit somewhere
    assert best.trajectory.duration < found.trajectory.duration < 1.3 * best.trajectory.duration
    assert max(found.certificate.worst.values()) > 1 - 1e-3
    state = found.trajectory.at(np.array([0.0, found.trajectory.duration]))
    assert np.abs(np.stack([state.qd, state.qdd])).max() < 1e-9
    target = path.derivatives(path.breaks[-1:], np.zeros(1, int))[0]
    assert np.abs(state.q[1] - target[0]).max() < 1e-9


@pytest.mark.parametrize("missing", [["speed"], ["acceleration"], ["speed", "acceleration"]])
def test_other_limits_may_be_missing(missing, seven_segments):
    """What is left bounds the motion, jerk alone too: the closed forms with the missing ones out of
    reach.
    """
    bounds = {"speed": 0.5, "acceleration": 1.0, "jerk": 10.0}
    path = line(1.0)
    profile = solved(path, limits_on(path, **(bounds | dict.fromkeys(missing))))
    time = seven_segments(1.0, **(bounds | dict.fromkeys(missing, 1e9)))
    assert time * (1 - 1e-6) <= profile.duration <= time * (1 + 1e-3)


def test_without_a_limit_of_jerk_it_is_refused():
    path = line(1.0)
    with pytest.raises(MotionError, match=r"the motion is unbounded.*jerk"):
        solve_run(Task(path, limits_on(path, 1.0, 1.0, None), Run(0, 0), 3)).require_profile()


def test_a_motion_that_uses_little_of_every_limit_is_looked_at_no_more(monkeypatch):
    """Then nothing is left whose peaks could count: it was an internal error on axes held below
    resonance bands.
    """
    path = curve()
    problem, start = jerk_problem(path, limits_on(path, **CURVE), Run(0, 0))
    guess = start.on(problem.s)
    monkeypatch.setattr(solver_module, "REVISED_TOLERANCE", TOLERANCE)
    blind = solve_jerk_limited(problem, guess)
    looked = solve_jerk_limited(problem, guess, look=lambda motion, names: {})
    assert looked.solved
    assert looked.duration == pytest.approx(blind.duration, rel=1e-9)


def test_a_quick_solve_refuses_what_the_full_one_refuses():
    """An unbounded motion, and an end speed that the closed form of a straight run excludes
    exactly.
    """
    path = line(1.0)
    unbounded = solve_once(Task(path, limits_on(path, 1.0, 1.0, None), Run(0, 0), 3))
    assert "unbounded" in str(unbounded.refusal)
    limits = limits_on(path, 10.0, 1.0, 10.0)
    run = Run(0, 0, at_speeds(0.0, 2.0))
    quick, full = (solve(Task(path, limits, run, 3)).refusal for solve in (solve_once, solve_run))
    assert quick.kind == full.kind == "end speed"
    # from rest, v²/2A + v A/2J = L with A = 1, J = 10, L = 1
    largest = -0.05 + np.sqrt(0.05**2 + 2)
    assert quick.limit == full.limit == pytest.approx(largest, rel=1e-6)
