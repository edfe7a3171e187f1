"""Limits of a caller's own: kept and proved by one call, and by what follows from its plan; no
table knows of them.
"""

import sys
from pathlib import Path

import numpy as np
import pytest

from kinematics import MotionError, load_machine
from planner import Infeasible, Line, Program, check, classical, plan, plan_parts
from planner.limits import Limit, Term
from planner.limits.limit import Rows
from planner.limits.registry import AXIS_LIMITS, MACHINE_LIMITS
from planner.limits.tool import ToolSpeed

sys.path.insert(0, str(Path(__file__).parents[3] / "docs" / "examples"))
from payload_acceleration import CAP, PLACE, PayloadAcceleration

WAY = Program(
    [Line([0.02, 0, 0.02]), Line([0, 0.01, 0.02], rotate=[0.05, 0, 0])], start=[0, 0, 0.02]
)
NAME = PayloadAcceleration.name


@pytest.fixture(scope="module")
def machine():
    return load_machine("hexapod")


@pytest.fixture(scope="module", params=[2, 3])
def held(request, machine):
    return plan(WAY, machine, order=request.param, limits=[PayloadAcceleration()])


def felt(trajectory):
    """(N, 3) m/s² of the payload by finite differences of its place, without a line of the
    limit.
    """
    t = np.linspace(0, trajectory.duration, 40001)
    return np.diff(trajectory.at(t).pose.apply(PLACE), 2, axis=0) / t[1] ** 2


def test_a_plan_keeps_it_and_its_certificate_proves_it(held, machine):
    assert held.certificate.holds
    assert 0.99 < held.certificate.worst[NAME] <= 1
    assert np.abs(felt(held.trajectory)).max() == pytest.approx(CAP, rel=1e-3)
    free = plan(WAY, machine, order=held.order)
    assert NAME not in free.certificate.worst  # nothing of it stays behind
    assert np.abs(felt(free.trajectory)).max() > 1.5 * CAP
    assert free.trajectory.duration < held.trajectory.duration
    assert not {PayloadAcceleration} & {*AXIS_LIMITS, *MACHINE_LIMITS}


def test_what_is_made_from_the_plan_keeps_it(held):
    middle = held.trajectory.duration / 4
    for section in (held.hold(middle), held.resume(0.01), held.resume(0.0, 0.5)):
        assert section.certificate.holds
        assert section.certificate.worst[NAME] <= 1
        assert np.abs(felt(section.trajectory)).max() <= CAP * (1 + 1e-3)
    timing = classical(held, "trapezoid")
    assert timing.certificate.worst[NAME] <= 1
    if held.order == 2:  # at order 3 it takes twenty times as long, by the same rows
        assert held.lower_bound <= held.trajectory.duration * (1 + 1e-9)
        assert held.worth.of(NAME, "x") is not None


def test_plans_in_parts_keep_it(machine):
    parts = [*plan_parts(WAY, machine, order=2, limits=[PayloadAcceleration()])]
    assert parts[-1].standing.certificate.holds
    assert 0.99 < parts[-1].standing.certificate.worst[NAME] <= 1


class Loose(PayloadAcceleration):
    """What it tells the solvers is half of what it is."""

    name = "loose"

    def rows(self, points):
        rows = super().rows(points)
        return Rows({term: value / 2 for term, value in rows.coefficients.items()}, rows.bound)


def test_rows_that_say_too_little_cost_time_and_never_a_limit(machine):
    """The certificate looks at the value alone: the plan is refused, or holds."""
    try:
        held = plan(WAY, machine, order=2, limits=[Loose()])
    except MotionError:
        return
    assert np.abs(felt(held.trajectory)).max() <= CAP * (1 + 1e-3)


class Height(Limit):
    """How high the platform may be above the base: no timing can help it."""

    name = "height"
    channels = ("platform",)
    units = (("mm", 1e3),)

    def __init__(self, most):
        self.bounds = np.array([most])

    def value(self, motion):
        return motion.pose_rate(0)[:, [2]]

    def use(self, low, high, piece):
        return high / self.bounds


def test_a_limit_of_the_place_alone_is_refused_with_the_place(machine):
    high = machine.home.translation[2] + 0.02
    assert plan(WAY, machine, limits=[Height(high + 1e-6)]).certificate.worst[
        "height"
    ] == pytest.approx(1, abs=1e-4)
    with pytest.raises(Infeasible, match=r"height .*mm.*segment 1") as no:
        plan(WAY, machine, limits=[Height(high - 1e-3)])
    assert no.value.kind == "height"
    violations = check(WAY, machine, limits=[Height(high - 1e-3)]).violations
    assert {violation.kind for violation in violations} == {"height"}
    assert not check(WAY, machine, limits=[Height(high + 1e-6), PayloadAcceleration()]).violations


def test_what_depends_on_the_path_is_made_for_it(machine):
    def slow(machine, path):
        return ToolSpeed([5e-3] * len(path.pieces))

    held = plan(WAY, machine, limits=[slow])
    speed = np.linalg.norm(np.diff(held.trajectory.at(np.linspace(0, held.trajectory.duration, 5001)).pose.translation,
                                   axis=0), axis=1).max() / held.trajectory.duration * 5000  # fmt: skip
    assert speed == pytest.approx(5e-3, rel=1e-3)


class Unstated(Limit):
    name = "unstated"

    def value(self, motion):
        return motion.qd

    def use(self, low, high, piece):
        return high


class Jerky(PayloadAcceleration):
    name = "jerky"
    terms = frozenset({Term.SDDD})


class Same(PayloadAcceleration):
    name = "speed"


class Uneven(PayloadAcceleration):
    name = "uneven"

    def __init__(self):
        super().__init__()
        self.bounds = np.array([1.0, 2.0])


class Flat(PayloadAcceleration):
    name = "flat"

    def value(self, motion):
        return super().value(motion)[:, 0]


class Narrow(PayloadAcceleration):
    name = "narrow"

    def use(self, low, high, piece):
        return super().use(low, high, piece)[:, :2]


class Crooked(PayloadAcceleration):
    name = "crooked"

    def rows(self, points):
        made = super().rows(points)
        return Rows({term: each.T for term, each in made.coefficients.items()}, made.bound)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (
            PayloadAcceleration,
            "is no limit: give an instance of planner.limits.Limit, or a function",
        ),
        (0.3, "limits: 0.3 is no limit"),
        (lambda machine, path: None, "limits: None is no limit"),
        (Same(), 'there is a limit "speed" already'),
        (Unstated(), 'limits: Unstated "unstated" states no channels'),
        (
            Uneven(),
            r'"uneven": bounds and units must be 3, one for each of its channels \(x, y, z\)',
        ),
        (lambda path: Same(), "must take two arguments, the machine and the path"),
        (
            Flat(),
            r'limit "flat": its value is of shape \(4,\) at 4 places; expected \(4, 3\), a row for each place',
        ),
        (Narrow(), r'limit "narrow": its use is of shape \(4, 2\)'),
        (Crooked(), r'limit "crooked": its coefficient of .* is of shape'),
        (Jerky(), '"jerky" limits jerk, and the motion is of order 2; give order=3'),
    ],
)
def test_what_is_no_limit_is_refused(machine, given, told):
    with pytest.raises(MotionError, match=told):
        plan(WAY, machine, order=2, limits=[given])


@pytest.mark.parametrize("given", [PayloadAcceleration(), None, 0.3])
def test_limits_are_a_list(machine, given):
    for ask in (plan, check):
        with pytest.raises(MotionError, match="limits must be a list of limits"):
            ask(WAY, machine, limits=given)
    with pytest.raises(MotionError, match="limits must be a list of limits"):
        next(plan_parts(WAY, machine, limits=given))


def test_one_name_stands_for_one_limit(machine):
    with pytest.raises(MotionError, match="already"):
        plan(WAY, machine, order=2, limits=[PayloadAcceleration(), PayloadAcceleration()])
