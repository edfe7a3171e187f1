"""Comparisons with peers in small: their problems by their rules, and answers that are known."""

import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from benchmarks.evidence.cases import peers, random_splines, ruckig_moves, toppra_suite
from benchmarks.evidence.peers import copp_, ruckig_
from benchmarks.evidence.peers.copp_ import Grid
from benchmarks.evidence.peers.ours import (
    pose_reference,
    solve_certified,
    solve_general,
    solve_passes,
)
from benchmarks.evidence.peers.problems import slow_to_hold, spline, straight
from benchmarks.evidence.peers.random_splines import Suite, chacha_numbers
from kinematics import MotionError

# Of the shape of COPP's tests/test_random_spline.rs.
SPLINES = """
fn test_topp() {
    let config = TestConfig {
        dim: 3,
        num_waypoints: 6,
        s_len: 1001,
        velocity_max: 1.0,
        acceleration_max: 5.0,
        jerk_max: 50.0,
        seed: 7,
        n_exp: 2,
    };
"""
# Of the shape of toppra's problem_suite_1.yaml, and of the record next to it.
PROBLEMS = """
there_and_back:
  waypoints: [[0, 0], [0, 2e-6], [0, 0]]
  ss_waypoints: [0, 1]
  nb_gridpoints: [51, 101]
  vlim: [100, 1000]
  alim: [100, 1000]
  desired_duration: [0, 1.0]
  solver_wrapper: ['hotqpoases', 'seidel']
"""
RECORD = """,status,duration,desired_duration,name,solver_wrapper,nb_gridpoints
0,FAIL,,0.0,there_and_back,hotqpoases,51
1,SUCCESS,0.5,0.0,there_and_back,hotqpoases,101
"""


def test_a_motion_is_slowed_until_its_samples_respect_the_limits():
    """k times as long, speed falls by k, acceleration by k² and jerk by k³."""
    assert slow_to_hold(2.0, [1.1, 1.21, 1.331]) == pytest.approx(2.2)
    assert slow_to_hold(2.0, [0.5, 4.0]) == pytest.approx(4.0)
    assert slow_to_hold(2.0, [0.5, 0.9, 1.0]) == 2.0


def test_a_straight_move_is_the_seven_phases():
    """L = V (T - V/A - A/J) where all three limits bind; without jerk L = V (T - V/A)."""
    line = straight()
    speed, acceleration, jerk = line.bounds[:, 1, 0]
    certified, general = solve_certified(line, 3)(), solve_general(line)()
    exact = line.length / speed + speed / acceleration + acceleration / jerk
    assert certified.duration == pytest.approx(exact, rel=1e-8)
    assert certified.uses(line.bounds) == pytest.approx([1, 1, 1], abs=1e-6)
    assert general.duration == pytest.approx(exact, rel=3e-4)
    bare = solve_passes(line, 1000)()
    assert bare.duration == pytest.approx(line.length / speed + speed / acceleration, rel=1e-3)
    assert bare.uses(line.bounds)[2] == np.inf


def test_ipopt_finds_what_ours_finds():
    problem = spline(count=6, axes=3)
    _, solve = pose_reference(problem, 300)
    assert solve()().duration == pytest.approx(solve_general(problem)().duration, rel=2e-3)


def test_copp_is_sampled_as_it_moves():
    """d(q̇²/2) = q̈ dq and q̇ dq̈ = q⃛ dq by the trapezoidal rule, worst next to a rest."""
    pytest.importorskip("copp_py")
    problem = spline(count=6, axes=3)
    for order in (2, 3):
        motion = copp_.solve(problem, order, Grid(200, 0.9, 3))()
        slowed = slow_to_hold(motion.duration, motion.uses(problem.bounds)[:order])
        assert solve_certified(problem, order)().duration < slowed < 1.2 * motion.duration
        sampled = (motion.q, motion.qd, motion.qdd, motion.qddd)
        q, v, a, j = (values.reshape(200, -1, 3) for values in sampled)
        energy = np.diff(v**2, axis=1) / 2
        error = np.abs(energy - mean(a) * np.diff(q, axis=1))
        assert error[3:-3].max() < 1e-4 * np.abs(energy).max()
        assert error.max() < 0.03 * np.abs(energy).max()
        if order == 3:
            change = mean(v) * np.diff(a, axis=1)
            error = np.abs(change - mean(j) * np.diff(q, axis=1))
            assert error[3:-3].max() < 1e-4 * np.abs(change).max()


def mean(values):
    """Return the means of neighbouring samples within each interval."""
    return (values[:, 1:] + values[:, :-1]) / 2


def test_an_absent_peer_has_a_row_that_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "ruckig", None)
    line = straight()
    method = (3, "ruckig", None, partial(ruckig_.solve, line))
    *_, duration, _, _, _, slowed, remark = peers.measure_row(line, method)
    assert duration == slowed == "nan"
    assert "ruckig" in remark
    with pytest.raises(MotionError, match="ruckig"):
        list(ruckig_moves.compare(count=1, general=0))


def test_chacha_is_that_of_rust():
    """First numbers of `StdRng::seed_from_u64(20260414)`: COPP's mean durations confirm them."""
    numbers = [0.00758292, 0.64121419, 0.65376199, 0.58787359, 0.77813972]
    assert chacha_numbers(20260414, 5) == pytest.approx(numbers, abs=1e-8)
    assert (chacha_numbers(5, 24)[:9] == chacha_numbers(5, 9)).all()


def test_random_splines_rest_at_their_ends(tmp_path):
    """The certified motion respects its limits; copp-py's, slowed until it does, is longer."""
    file = tmp_path / "test_random_spline.rs"
    file.write_text(SPLINES)
    assert Suite.read(file) == Suite(3, 6, (1.0, 5.0, 50.0), 7, 2)
    path, bounds = next(Suite.read(file).problems())
    assert np.abs([path(end, nu) for end in (0.0, 1.0) for nu in (1, 2)]).max() < 1e-9
    assert bounds.shape == (3, 2, 3)
    assert (np.abs(bounds / np.array([1.0, 5.0, 50.0])[:, None, None] - 1) < 0.1).all()
    rows = list(random_splines.solve_suite(replace(Suite.read(file), count=1)))
    assert [row[2] for row in rows] == ["1 of 1"] * len(rows)
    ours, *theirs = (row for row in rows if row[1] == "3")
    assert 0.999 < float(ours[7]) < 1 + 1e-6
    assert all(float(ours[8]) < float(row[8]) for row in theirs)


def test_a_suite_of_hard_problems_is_solved(tmp_path):
    """There and back: 2 √(L/A) each way."""
    file = tmp_path / "suite.yaml"
    file.write_text(PROBLEMS)
    (tmp_path / "test_robustness_main.py.result").write_text(RECORD)
    least, stated = toppra_suite.solve_suite(file)
    assert float(least[2]) == pytest.approx(4 * np.sqrt(2e-6 / 1000), abs=2e-9)
    assert float(least[3]) == pytest.approx(1.0, abs=1e-6)
    assert least[-1] == "0.500000000, hotqpoases"
    assert float(stated[2]) == pytest.approx(1.0, abs=1e-9)
    assert stated[-1] == ""


def test_straight_moves_take_the_time_that_ruckig_finds():
    """The closed form to its 1e-9 of room; a refusal where ruckig has to move backwards."""
    pytest.importorskip("ruckig")
    rest, moving, general = ruckig_moves.compare(count=12, general=2)
    assert rest[2] == 0
    assert moving[2] > 0
    assert max(abs(float(row[4])) for row in (rest, moving)) < 1.1e-9
    assert 0 < float(general[4]) < 1e-3
