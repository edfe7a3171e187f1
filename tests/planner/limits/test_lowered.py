"""Shares of a limit along the path, against a search over the stretches that they were lowered
on.
"""

import numpy as np
import pytest

from kinematics import load_machine
from planner import Arc, Line, Program
from planner.limits import Term, limits_of
from planner.limits.lowered import ALL, Shares
from planner.path.actuation import actuate, make_points

RNG = np.random.default_rng(5)


def stretches(count):
    first = RNG.uniform(0, 1, count)
    return first, first + RNG.uniform(1e-4, 0.2, count), RNG.uniform(0.6, 1.0, count)


def test_what_is_lowered_is_the_least_factor_of_each_round_times_those_of_the_others():
    rounds = [stretches(count) for count in (1, 7, 30)]
    shares = ALL
    for each in rounds:
        shares = shares.lower(*each)
    s = RNG.uniform(-0.1, 1.3, 2000)
    wanted = np.ones(len(s))
    for first, last, factor in rounds:
        inside = (first <= s[:, None]) & (s[:, None] <= last)
        wanted *= np.where(inside, factor, 1.0).min(1)
    assert shares.at(s) == pytest.approx(wanted, rel=1e-12)
    assert shares.least == pytest.approx(shares.at((shares.ends[1:] + shares.ends[:-1]) / 2).min())
    assert (ALL.at(s) == 1).all()


def test_the_least_over_a_stretch_is_that_of_all_its_places_and_both_its_ends():
    shares = ALL.lower(*stretches(12))
    first = RNG.uniform(-0.1, 1.2, 300)
    first[:20] = RNG.choice(shares.ends, 20)
    last = first + RNG.uniform(0, 0.1, 300)
    for a, b, least in zip(first, last, shares.least_over(first, last), strict=True):
        inner = shares.ends[(shares.ends >= a) & (shares.ends <= b)]
        assert least == shares.at(np.concatenate([[a, b], inner])).min()


def test_no_grid_misses_a_stretch_between_its_points():
    shares = Shares(np.array([0.42, 0.43]), np.array([0.7]))
    grid = np.linspace(0, 1, 11)
    found = shares.on_grid(RNG.permutation(grid))
    assert sorted(found) == [0.7, 0.7] + [1.0] * 9
    assert shares.on_grid(grid)[[4, 5]].tolist() == [0.7, 0.7]


def test_rows_allow_the_share_of_the_limit_and_its_use_stays_that_of_the_limit():
    machine = load_machine("traverser")
    path = actuate(
        Program((Line([0.02, 0.05, 0]), Arc([0.05, 0.05, 0], [0, 0, 1], np.pi, speed=0.19))),
        machine,
    )
    cap = next(limit for limit in limits_of(path, machine.axes, 2) if limit.name == "tool speed")
    middle = float(path.breaks[1:].mean())
    lowered = cap.lower(Shares(np.array([middle, middle + 0.01]), np.array([0.8])))
    s = np.linspace(path.breaks[1], path.breaks[2], 400)
    points = make_points(path, s, np.ones(400, int), 2)
    with np.errstate(divide="ignore"):
        fastest = [
            (np.broadcast_to(rows.bound, (400, 1)) / rows.coefficients[Term.SD])[:, 0]
            for rows in (
                cap.rows(points),
                lowered.rows(points).scale(lowered.shares.on_grid(points.s)[:, None]),
            )
        ]
    inside = (s >= middle) & (s <= middle + 0.01)
    assert inside.sum() > 5
    assert fastest[0] == pytest.approx(0.19)
    assert fastest[1][inside] == pytest.approx(0.8 * 0.19)
    assert (fastest[1] < 0.189).sum() <= inside.sum() + 2  # a point more on either side
    square, piece = np.array([[0.19**2]]), np.ones(1, int)
    assert lowered.use(square, square, piece) == pytest.approx(1.0)
