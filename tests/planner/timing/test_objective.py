"""Time against heat: the parabola in closed form, no motion better by another's objective, and what
is refused.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from kinematics import MotionError
from planner import Line, Program, plan, time_optimal
from planner.timing import Objective, certified_solve, measure_heat, read_objective, solve_objective


@pytest.fixture(scope="module")
def circle(plan_bundled):
    return plan_bundled("bare-circle", "hexapod", 3)


@pytest.mark.parametrize("length", [1.0, 0.03])
@pytest.mark.parametrize("weight", [2.0, 20.0])
def test_a_straight_move_is_a_parabola_of_speed(length, weight):
    """Least T/T₀ + w/H₀ · 12 L²/(A² T³): T⁴ = 36 p L²/A² with p = w T₀/H₀."""
    path = PPoly(np.array([[[length]], [[0.0]]]), np.array([0.0, 1.0]))
    fastest = time_optimal(path, max_speed=50.0, max_acceleration=2.0, max_jerk=400.0)
    axes = [SimpleNamespace(max_acceleration=2.0)]
    found = solve_objective(fastest, axes, Objective(weight))
    of = np.array([2.0])
    price = weight * fastest.trajectory.duration / measure_heat(fastest.trajectory, of)
    best = (36 * price * length**2 / 4) ** 0.25
    # s̈ cannot begin at its largest: the jerk takes a little, in time and in heat
    assert found.certificate.holds
    assert found.trajectory.duration == pytest.approx(best, rel=2e-2)
    cost = found.trajectory.duration + price * measure_heat(found.trajectory, of)
    least = best + price * 12 * length**2 / (4 * best**3)
    assert least * (1 - 1e-4) <= cost <= least * (1 + 1e-2)


def test_no_motion_is_better_by_another_s_objective(circle):
    weights = (0.0, 0.2, 1.0, 5.0)
    accelerations = np.array([axis.max_acceleration for axis in circle.machine.axes])
    fastest = certified_solve(circle.path, circle.limits, circle.order)
    solutions = [
        solve_objective(fastest, circle.machine.axes, Objective(weight)) for weight in weights
    ]
    motions = [solution.trajectory for solution in solutions]
    time = np.array([motion.duration for motion in motions]) / motions[0].duration
    heat = np.array([measure_heat(motion, accelerations) for motion in motions])
    heat /= heat[0]
    assert (np.diff(time) > 0).all()
    assert (np.diff(heat) < 0).all()
    for own, weight in enumerate(weights):
        sums = time + weight * heat
        assert sums[own] <= sums.min() + 1e-4
        slowed = max(1.0, (3 * weight) ** 0.25)
        assert sums[own] <= slowed + weight / slowed**3 + 1e-9
    assert all(solution.certificate.holds for solution in solutions)


def test_the_plan_has_it_and_its_bound_stays_one_of_time(circle):
    found = plan(circle.program, circle.machine, objective="time + 0.5 heat")
    assert found.certificate.holds
    assert (
        circle.lower_bound * (1 - 2e-3)
        < found.lower_bound
        <= circle.trajectory.duration
        < found.trajectory.duration
    )
    assert found.gap is None
    assert found.worth is None
    assert "0.5 heat" in str(found)
    assert (
        plan(circle.program, circle.machine, objective="time").trajectory.duration
        == circle.trajectory.duration
    )


def test_objectives_are_read_and_told():
    assert read_objective("time") == Objective() == read_objective(" time ")
    assert read_objective("time + heat") == Objective(1.0) == read_objective("time+1*heat")
    for weight in (0.2, 1e-3, 123.456, 1 / 3):
        assert read_objective(str(Objective(weight))).heat == pytest.approx(weight, rel=1e-14)
    for wrong in (
        "",
        "heat",
        "time - heat",
        "time + -1 heat",
        "time + 1.2.3 heat",
        "time + 2000 heat",
        "time + 0.2",
        "time + * heat",
        "speed",
    ):
        with pytest.raises(MotionError, match=r"objective"):
            read_objective(wrong)


def test_what_leaves_no_choice_is_refused(circle):
    program, machine = circle.program, circle.machine
    constant = Program(
        (Line(to=np.array([0, 0, 0.003]), speed=0.004, speed_constant=True),), name="constant"
    )
    for words, own, options in (
        ("order 3", program, {"order": 2}),
        ("of its own", program, {"duration": 5.0}),
        ("constant speed", constant, {}),
        ("toppra", program, {"order": 2, "solver": "toppra"}),
    ):
        with pytest.raises(MotionError, match=words):
            plan(own, machine, objective="time + heat", **options)
