"""Every motion that is certified uses at most 1 of every limit, by the proof, and next to nothing
is lost by it.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PPoly

from benchmarks.evidence.random_problems import random_problem
from kinematics import Axis, Hexapod, Traverser, load_machine
from planner import Line, Program, plan, time_optimal
from planner.certificate import (
    LIMIT_ROUNDING,
    certify,
    forget_paths,
    prove_path_use,
    round_reached_use,
)
from planner.certificate.cells import Cells
from planner.certificate.limit_use import LimitProof
from planner.limits import limits_of
from planner.path.actuation import actuate
from planner.trajectory import unit_speed_trajectory

LINE = PPoly(np.array([[[1.0, 0.5]], [[0.0, 0.0]]]), [0.0, 1.0])
BEND = CubicSpline([0.0, 0.5, 1.0], [[0.0, 0.0], [0.6, 0.3], [1.0, 1.0]])
ENDS = [{}, {"start_speed": 0.5}, {"start_speed": 0.4, "end_speed": 0.5}]
ZOO = [
    *(random_problem(seed, 2) for seed in range(8)),
    *(random_problem(seed, 3) for seed in range(3)),
]


@pytest.fixture(scope="module")
def table():
    bundled = load_machine("traverser")
    axes = [
        replace(axis, max_speed=0.1, max_acceleration=0.5, max_jerk=10.0) for axis in bundled.axes
    ]
    return Traverser(axes=[replace(axis, max_pulse_rate=None) for axis in axes], home=bundled.home)


@pytest.mark.parametrize("problem", ZOO, ids=lambda problem: problem.name)
def test_no_proof_ends_above_one(problem):
    assert max(problem.solve().certificate.worst.values()) <= 1


@pytest.mark.parametrize("jerk", [None, 20.0])
@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize("path", [LINE, BEND], ids=["line", "bend"])
def test_neither_between_speeds(path, ends, jerk):
    found = time_optimal(path, max_speed=1.0, max_acceleration=2.0, max_jerk=jerk, **ends)
    assert max(found.certificate.worst.values()) <= 1


def test_a_speed_at_an_end_may_be_the_limit_itself():
    found = time_optimal(LINE, max_speed=1.0, max_acceleration=2.0, start_speed=1.0, end_speed=1.0)
    assert found.certificate.worst["speed"] == 1
    assert found.trajectory.duration == pytest.approx(1.0, rel=1e-12)


def test_closed_forms_give_away_a_billionth():
    """1 m at 1 m/s and 2 m/s²: 1.5 s."""
    found = time_optimal(LINE, max_speed=1.0, max_acceleration=2.0)
    assert found.methods == ("straight",)
    assert 0 < found.trajectory.duration / 1.5 - 1 < 1e-8
    assert 1 - 2e-9 < found.certificate.worst["speed"] < 1


@pytest.mark.parametrize("order", [2, 3])
def test_a_machine_keeps_it_at_constant_speed_and_at_the_end_of_its_travel(table, order):
    """The far end of the travel is reached exactly: 1, and not more."""
    far = table.axes[0].travel[1]
    made = plan(Program((Line([far, 0, 0], speed=0.05, speed_constant=True),)), table, order=order)
    assert made.certificate.worst["travel"] == 1
    assert max(made.certificate.worst.values()) <= 1


def test_smoothest_motions_too(hexapod, planned):
    made = planned("bare-circle", 3)
    slower = plan(made.program, hexapod, duration=1.1 * made.trajectory.duration)
    assert max(slower.certificate.worst.values()) <= 1


def test_what_a_timing_chooses_is_not_rounded_to_one():
    """A ten-billionth above 1 does not hold, where no path states it."""
    found = time_optimal(LINE, max_speed=1.0, max_acceleration=2.0)
    path = found.trajectory.path
    for speed, holds in ((found.certificate.worst["speed"] / (1 + 1e-10), False), (1.0, True)):
        axes = [Axis(name=name, max_speed=speed, max_acceleration=2.0) for name in path.names]
        assert certify(found.trajectory, limits_of(path, axes, 2)).holds is holds
    assert round_reached_use(
        np.array([1 + LIMIT_ROUNDING / 2, 1 + 2 * LIMIT_ROUNDING])
    ).tolist() == [
        1.0,
        1 + 2 * LIMIT_ROUNDING,
    ]


def test_what_geometry_uses_is_proved_once_for_equal_content(hexapod):
    """For another path of the same numbers, and for any other order; anew where any number
    differs.
    """

    def use(height=0.02, machine=hexapod, order=2):
        path = actuate(Program([Line([0.01, 0, height])]), machine)
        limits = [limit for limit in limits_of(path, machine.axes, order) if limit.geometric]
        return prove_path_use(path, limits)

    first = use()
    assert use(order=3) is first
    higher = use(0.02 + 1e-14)
    assert higher is not first
    shorter = Hexapod(
        hexapod.base,
        hexapod.platform,
        axes=[replace(axis, travel=(-0.06, 0.03)) for axis in hexapod.axes],
        home=hexapod.home,
    )
    assert (use(machine=shorter)["travel"] != first["travel"]).all()
    assert use() is first
    forget_paths()
    assert use() is not first
    assert not first["travel"].flags.writeable


def test_a_cell_that_is_too_short_to_split_leaves_the_others_to_refinement():
    """Both cells have a first bound of 2: the first one keeps it, the second one is proved anew."""
    path = time_optimal(BEND, max_speed=1.0, max_acceleration=2.0).trajectory.path
    motion = unit_speed_trajectory(path)
    ends = np.diff(motion.knots)[:2]
    cells = Cells(np.array([0, 1]), np.zeros(2), np.array([1e-9, 1.0]) * ends)
    axes = [Axis(name=name, max_speed=10.0, max_acceleration=2.0) for name in path.names]
    (speed,) = (limit for limit in limits_of(path, axes, 2) if limit.name == "speed")
    proof = LimitProof(motion, speed, order=2)
    proof.run(cells, (np.full(2, 2.0), np.zeros(2)))
    assert proof.use[0] == 2
    assert 0 < proof.use[1] < 0.3
