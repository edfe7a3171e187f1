"""The certificate against motions whose largest values are known: never below them, and at most
1e-6 above.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from scipy.interpolate import PPoly

from kinematics import Axis, MotionError
from planner import Place, Trajectory, time_optimal
from planner.certificate import ProvedUse, certify
from planner.limits import limits_of
from planner.limits.axis import Acceleration, Jerk, Speed
from planner.path.polynomial import PolynomialPath


def line(length):
    return PolynomialPath([0.0, length], np.array([[[1.0]], [[0.0]]]), ["x"])


LINE = line(1.6)


def bounded(names, speed=None, acceleration=None, jerk=None):
    """Limits on axes; each argument a number for all, or one per axis."""
    axes = [Axis(name) for name in names]
    kinds = {Speed: speed, Acceleration: acceleration, Jerk: jerk}
    return [
        kind(axes, np.broadcast_to(bound, len(axes)))
        for kind, bound in kinds.items()
        if bound is not None
    ]


def s_curve(path=LINE, ramp=0.1, jerk=200.0):
    """Seven pieces of `ramp` seconds each, from rest to rest: the peaks are J r, 2 J r², and 8 J r³
    of way.
    """
    j = jerk * np.array([1.0, 0, -1, 0, -1, 0, 1])
    a = jerk * ramp * np.array([0.0, 1, 1, 0, 0, -1, -1])
    v = jerk * ramp**2 * np.array([0, 0.5, 1.5, 2, 2, 1.5, 0.5])
    s = jerk * ramp**3 * np.array([0, 1 / 6, 7 / 6, 3, 5, 41 / 6, 47 / 6])
    return Trajectory(path, ramp * np.arange(8.0), s, v, a, j, np.zeros(7, int))


def true_extremes(trajectory, order):
    """Largest |d^k q/dt^k| (axes,) for k = order: at ends of time pieces, or where the next
    derivative has a root.
    """
    path, found = trajectory.path, []
    for k, h in enumerate(np.diff(trajectory.knots)):
        powers = [trajectory.s[k], trajectory.v[k], trajectory.a[k] / 2, trajectory.j[k] / 6]
        x = Polynomial(powers) - path.breaks[trajectory.piece[k]]
        per_axis = []
        for coefficients in path.coefficients[:, trajectory.piece[k]].T:
            value = Polynomial(coefficients[::-1])(x).deriv(order)
            slope = value.deriv()
            # the real part of any root is a point of the piece at worst: none can raise the maximum
            # wrongly
            turns = np.clip(slope.trim(1e-14 * np.abs(slope.coef).max()).roots().real, 0, h)
            per_axis.append(np.abs(value(np.concatenate([[0.0, h], turns]))).max())
        found.append(per_axis)
    return np.max(found, 0)


numbers = st.floats(-2, 2).map(lambda x: round(x, 4))


@st.composite
def motions(draw):
    """Any s(t), piece by piece, along any polynomials: it may jump, and leave the path; the bounds
    hold there too.
    """
    pieces, axes, degree = draw(st.integers(1, 3)), draw(st.integers(1, 2)), draw(st.integers(1, 5))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    path = PolynomialPath(
        np.arange(pieces + 1.0), rng.normal(size=(degree + 1, pieces, axes)), ["x", "y"][:axes]
    )
    count = draw(st.integers(1, 6))
    motion = np.array([[draw(numbers) for _ in range(count)] for _ in range(4)])
    lengths = [draw(st.sampled_from([1e-6, 0.02, 0.3, 1.0])) for _ in range(count)]
    piece = np.sort(rng.integers(0, pieces, count))
    return Trajectory(
        path,
        np.concatenate([[0.0], np.cumsum(lengths)]),
        path.breaks[piece] + motion[0] / 4,
        *motion[1:],
        piece,
    )


@settings(max_examples=60, deadline=None)
@given(trajectory=motions(), target=st.sampled_from([0.1, 0.999, 1.0, 1.5]))
def test_worst_is_the_true_maximum_or_up_to_a_millionth_above(trajectory, target):
    extremes = [true_extremes(trajectory, order) for order in (1, 2, 3)]
    bounds = [np.where(peak > 1e-3, peak, 1.0) / target for peak in extremes]
    certificate = certify(trajectory, bounded(trajectory.path.names, *bounds))
    for name, peak, bound in zip(("speed", "acceleration", "jerk"), extremes, bounds, strict=True):
        truth = (peak / bound).max()
        # 1e-12: the roots of a polynomial of degree 13, in double precision
        assert truth - 1e-12 <= certificate.worst[name] <= truth + 1e-6, name
        assert certificate.use[name].max() == certificate.worst[name]


class Lorentz:
    """q = 1/(1 + ((s − c)/w)²) for |s| ≤ 1: a spike of width w that samples 100 w apart miss.

    Its own ActuatorPath.

    A second axis does the same, free of limits.
    """

    names = ("spike", "free")
    breaks = np.array([-1.0, 1.0])
    dwells = np.zeros(2)
    tool, end_speeds, end_accelerations, turns = None, (0.0, 0.0), (0.0, 0.0), np.zeros(1)

    def __init__(self, place, width):
        self.centre, self.width = place, width

    def stops(self, order):
        return np.ones(2, bool)

    def constant(self, piece):
        return None

    def segment(self, piece):
        return None

    def place(self, s, piece, t=None, axis=""):
        return Place(s, None, t, axis)

    def derivatives(self, s, piece, highest=3):
        x = np.repeat(((s - self.centre) / self.width)[:, None], 2, 1)
        q, w = 1 / (1 + x * x), self.width
        third = 24 * x * (1 - x**2) * q**4 / w**3
        return (q, -2 * x * q**2 / w, (6 * x**2 - 2) * q**3 / w**2, third)[: highest + 1]

    def pose_numbers(self, s, piece):
        return None

    pose_derivatives = pose_numbers

    def enclose(self, s, piece):
        x = ((s - self.centre) * (1 / self.width))[:, None]
        with np.errstate(invalid="ignore"):  # unbounded where the cell is too wide for a bound
            return 1.0 / (1.0 + x * x) * np.ones((1, 2))


@pytest.mark.parametrize("place", [0.0, 0.123456, -0.777])
@pytest.mark.parametrize("width", [1e-2, 1e-4])
@pytest.mark.parametrize("share", [1.0, 0.5])
def test_a_spike_between_samples_is_found(place, width, share):
    """One time piece over the whole: q̇ peaks at √27/8w, q̈ at 2/w², at known places."""
    path = Lorentz(place, width)
    trajectory = Trajectory(
        path, *(np.array(x) for x in ([0.0, 2.0], [-1.0], [1.0], [0.0], [0.0])), np.zeros(1, int)
    )
    peaks = np.array([np.sqrt(27) / (8 * width), 2 / width**2]) / share
    certificate = certify(trajectory, bounded(path.names, [peaks[0], np.inf], [peaks[1], np.inf]))
    for name in ("speed", "acceleration"):
        assert share - 1e-12 <= certificate.worst[name] <= share + 1e-6, name


def test_a_jerk_of_a_microsecond_is_found():
    path = PolynomialPath([0.0, 1.0], np.array([[[0.2]], [[1.0]], [[0.0]]]), ["x"])
    calm = s_curve(path, 0.1, 100.0)
    knots = np.insert(calm.knots, 4, [calm.knots[3] + 0.04, calm.knots[3] + 0.04 + 1e-6])
    again = np.array([0, 1, 2, 3, 3, 3, 4, 5, 6])
    s, v, a, j = (getattr(calm, name)[again].copy() for name in ("s", "v", "a", "j"))
    for n in (4, 5):
        tau = knots[n] - calm.knots[3]
        s[n], v[n] = s[n] + v[n] * tau, v[n]
    j[4] = 1000.0
    certificate = certify(
        Trajectory(path, knots, s, v, a, j, np.zeros(9, int)), bounded(["x"], jerk=700.0)
    )
    at = s[4]
    # q⃛ = q′ s⃛ + 3 q″ ṡ s̈ + q‴ ṡ³ with q′ = 1 + 0.4 s, q″ = 0.4, and s̈ = 1e-3 at the end of the
    # spike
    peak = (1 + 0.4 * at) * 1000 + 3 * 0.4 * v[4] * 1e-3
    assert certificate.worst["jerk"] == pytest.approx(
        peak / 700, rel=1e-5
    )  # s moves on by 2e-6 meanwhile
    assert certificate.where["jerk"].t == pytest.approx(knots[4], abs=2e-6)
    assert certificate.use["jerk"].argmax() == 4


def test_a_smooth_motion_at_its_limits_holds_and_is_placed():
    """At 1e-9 less: what a timing chooses is never above 1, and not at 1 either, which rounding
    tells from neither.
    """
    near = 1 + 1e-9
    certificate = certify(s_curve(), bounded(["x"], 4.0 * near, 20.0 * near, 200.0 * near))
    assert certificate.holds
    assert set(certificate.worst) == {"speed", "acceleration", "jerk"}
    for value in certificate.worst.values():
        assert 1 - 1e-8 <= value <= 1
    assert 0.3 <= certificate.where["speed"].t <= 0.4
    assert certificate.where["speed"].axis == "x"
    assert certificate.where["speed"].s == pytest.approx(
        0.6 + 4 * (certificate.where["speed"].t - 0.3), abs=1e-12
    )
    assert certificate.where["acceleration"].t <= 0.2 or certificate.where["acceleration"].t >= 0.5
    assert "the certificate holds" in str(certificate)


@pytest.mark.parametrize("name", ["speed", "acceleration", "jerk"])
def test_two_millionths_too_much_do_not_hold(name):
    peaks = {"speed": 4.0, "acceleration": 20.0, "jerk": 200.0}
    certificate = certify(s_curve(), bounded(["x"], **(peaks | {name: peaks[name] / (1 + 2e-6)})))
    assert not certificate.holds
    assert certificate.worst[name] == pytest.approx(1 + 2e-6, abs=1e-6)
    assert "DOES NOT HOLD" in str(certificate)


@pytest.mark.parametrize("order", [2, 3])
def test_a_plan_two_millionths_beyond_a_limit_does_not_hold(hexapod, planned, order):
    """The plan's own motion under limits so lowered that it exceeds each of them, in turn, by
    2e-6.
    """
    plan = planned("bare-circle", order)
    fields = {"speed": "max_speed", "acceleration": "max_acceleration", "jerk": "max_jerk"}
    for limit in plan.limits:
        if limit.name in fields:
            field, use = fields[limit.name], dense_use(plan.trajectory, limit, 65).max()
            lowered = [
                replace(axis, **{field: getattr(axis, field) * use / (1 + 2e-6)})
                for axis in hexapod.axes
            ]
            certificate = certify(plan.trajectory, limits_of(plan.path, lowered, order))
            assert not certificate.holds
            assert 1 + 2e-6 - 1e-12 <= certificate.worst[limit.name] <= 1 + 3e-6


@pytest.mark.parametrize("gap", [1e-2, 1e-7])
@pytest.mark.parametrize(
    ("field", "name"), [("s", "position"), ("v", "speed"), ("a", "acceleration")]
)
def test_jumps_are_found_and_named(field, name, gap):
    motion = s_curve()
    values = getattr(motion, field).copy()
    values[4] += gap * np.ptp(values)
    jumping = certify(replace(motion, **{field: values}), bounded(["x"], 9.0, 90.0, 900.0))
    assert not jumping.holds
    assert jumping.worst[f"{name} jump"] == float("inf")
    assert jumping.where[f"{name} jump"].axis == "x"
    # where piece 4 starts; a jump inherited by its end may be as large
    assert np.abs(jumping.where[f"{name} jump"].t - motion.knots[4:6]).min() < 1e-12


def test_rounding_is_no_jump():
    motion = s_curve()
    noise = 1 + 1e-12 * np.random.default_rng(3).normal(size=(3, 7))
    shaken = replace(motion, s=motion.s * noise[0], v=motion.v * noise[1], a=motion.a * noise[2])
    assert certify(shaken, bounded(["x"], 9.0, 90.0, 900.0)).holds


def test_acceleration_may_jump_where_no_jerk_is_limited():
    steps = Trajectory(
        line(0.1),
        [0.0, 0.1, 0.2],
        np.array([0.0, 0.05]),
        np.array([0.0, 1]),
        np.array([10.0, -10]),
        np.zeros(2),
        np.zeros(2, int),
    )
    assert certify(steps, bounded(["x"], 1.0 + 1e-9, 10.0 + 1e-8)).holds
    limited = certify(steps, bounded(["x"], 1.0, 10.0, 1e9))
    assert not limited.holds
    assert list(limited.worst)[3:] == ["acceleration jump"]


@pytest.mark.parametrize(("kept", "end"), [(slice(1, None), 0), (slice(None, -1), 1)])
def test_not_resting_at_an_end_is_found(kept, end):
    motion = s_curve()
    knots = motion.knots[1:] - motion.knots[1] if end == 0 else motion.knots[:-1]
    cut = Trajectory(
        LINE, knots, *(getattr(motion, name)[kept] for name in ("s", "v", "a", "j", "piece"))
    )
    certificate = certify(cut, bounded(["x"], 9.0, 90.0, 900.0))
    assert not certificate.holds
    assert certificate.where["speed jump"].t == [0.0, cut.duration][end]
    assert "acceleration jump" in certificate.worst
    assert "position jump" not in certificate.worst


@pytest.mark.parametrize(
    ("fault", "spoiled"),
    [
        ("end off the path's", lambda m: replace(m, path=line(1.6 + 1e-7))),
        ("start off the path's", lambda m: replace(m, s=m.s + 1e-7)),
        ("motion backwards", lambda m: replace(m, s=1.6 - m.s, v=-m.v, a=-m.a, j=-m.j)),
        ("place off its piece", lambda m: replace(m, path=line(1.5))),
    ],
)
def test_a_motion_that_is_not_the_path_once_forwards_does_not_hold(fault, spoiled):
    certificate = certify(spoiled(s_curve()), bounded(["x"], 9.0, 90.0, 900.0))
    assert not certificate.holds
    assert certificate.worst[fault] == float("inf")


def test_backing_up_between_two_knots_is_found():
    """ṡ is 0 at both ends of each piece and falls to −1/8 within: s comes back to where it was."""
    motion = Trajectory(
        line(1.0),
        np.array([0.0, 1.0, 2.0]),
        np.array([0.0, 1 / 6]),
        np.array([0.0, 0.5]),
        np.array([0.0, 1.0]),
        np.array([1.0, -3.0]),
        np.zeros(2, int),
    )
    assert "motion backwards" not in certify(motion, bounded(["x"], 9.0)).worst
    back = replace(motion, v=np.array([0.0, 0.0]), a=np.array([0.0, -1.0]), j=np.array([0.0, 2.0]))
    assert "motion backwards" in certify(back, bounded(["x"], 9.0)).worst


def test_each_axis_is_held_against_its_own_size():
    """A corner and a gap of the small axis are 1e-10 of the large one's range, and count all the
    same.
    """
    c = np.zeros((2, 2, 2))
    c[0, :, 0], c[1, 1, 0] = 1e6, 1e6
    c[0, 0, 1], c[0, 1, 1], c[1, 1, 1] = 2e-4, -2e-4, 2e-4
    path = PolynomialPath([0.0, 1.0, 2.0], c, ["large", "small"])
    assert path.stops(2).tolist() == [True, True, True]
    steady = Trajectory(
        path, np.array([0.0, 1.0, 2.0]), [0.0, 1.0], [1.0, 1.0], [0.0, 0.0], [0.0, 0.0], [0, 1]
    )
    found = certify(steady, bounded(path.names, 2e6))
    assert found.where["speed jump"].axis in path.names
    gap = c.copy()
    gap[1, 1, 1] += 5e-4
    with pytest.raises(MotionError, match=r"jumps by 0\.0005 in axis2"):
        time_optimal(PPoly(gap, [0.0, 1.0, 2.0]), max_speed=1.0, max_acceleration=1.0)


@pytest.mark.parametrize("field", ["s", "v", "a", "j"])
def test_what_is_not_a_number_holds_nothing(field):
    motion = s_curve()
    values = getattr(motion, field).copy()
    values[2] = np.nan
    assert not certify(replace(motion, **{field: values}), bounded(["x"], 9.0, 90.0, 900.0)).holds


def dense_use(trajectory, limit, points=9):
    """Largest use of a limit (M,) at evenly spaced instants of each time piece, its ends and middle
    among them.
    """
    lengths = np.diff(trajectory.knots)
    k = np.repeat(np.arange(len(lengths)), points)
    state = trajectory.within(k, lengths[k] * np.tile(np.linspace(0, 1, points), len(lengths)))
    value = limit.value(state)
    return limit.use(value, value, state.piece).max(1).reshape(-1, points).max(1)


@pytest.mark.parametrize(("program", "order"), [("bare-circle", 3), ("circle", 2)])
def test_use_dominates_dense_samples_of_every_piece(planned, program, order):
    """All limits of a plan, tilt, travel and tool speed among them.

    The whole's worst is near the largest sample: as tight as the limit asks (5e-7, a distance
    1e-3), and 5e-7 for what lies between samples.
    """
    plan = planned(program, order)
    for limit in plan.limits:
        sampled, use = (
            dense_use(plan.trajectory, limit, 9 if order == 2 else 65),
            plan.certificate.use[limit.name],
        )
        moves = np.diff(plan.trajectory.knots) > 0
        assert (use[moves] >= sampled[moves] - 1e-12).all(), limit.name
        near = sampled.max() + limit.tight(sampled.max()) + 5e-7
        assert sampled.max() - 1e-12 <= plan.certificate.worst[limit.name] <= near, limit.name


@pytest.mark.parametrize("order", [2, 3])
def test_what_is_attained_is_really_met(planned, order):
    """The truth lies between attained and use: what is called attained must not lie above it."""
    plan = planned("bare-circle", order)
    for limit in plan.limits:
        attained = plan.certificate.attained[limit.name]
        # ends and middles of pieces, and of their eighths, are among the samples; peaks lie
        # between, 1e-8 above
        assert attained.max() <= dense_use(plan.trajectory, limit, 65).max() + 1e-8, limit.name
        assert (attained <= plan.certificate.use[limit.name] + 1e-12).all(), limit.name


def test_what_is_known_is_kept_and_the_rest_is_proved(planned):
    plan = planned("bare-circle", 2)
    fresh = plan.certificate
    unknown = np.zeros(len(plan.trajectory.s), bool)
    unknown[100:400] = True
    told = [
        {name: np.where(unknown, np.nan, values) for name, values in kind.items()}
        for kind in (fresh.use, fresh.attained)
    ]
    motion = plan.trajectory
    numbers = np.stack(
        [motion.s, motion.v, motion.a, motion.j, np.diff(motion.knots), motion.piece]
    )
    again = certify(motion, plan.limits, ProvedUse(*told, numbers))
    assert again.holds
    for limit in plan.limits:
        name = limit.name
        assert (again.use[name][~unknown] == fresh.use[name][~unknown]).all()
        # cells may be put together elsewhere: both are bounds, and tight where they are largest
        assert (again.use[name] >= fresh.attained[name] - 1e-12).all()
        assert again.worst[name] == pytest.approx(fresh.worst[name], abs=1e-6)
        assert (again.use[name] >= dense_use(plan.trajectory, limit) - 1e-12).all()
    # a lie about what is known shows in the result: nothing else is looked at there
    told[0]["speed"][50] = 1.5
    assert not certify(motion, plan.limits, ProvedUse(*told, numbers)).holds
    # but what was proved of other numbers is not believed, be they ever so near
    numbers[1, 50] = np.nextafter(numbers[1, 50], 1.0)
    assert certify(motion, plan.limits, ProvedUse(*told, numbers)).holds
    told[0]["speed"][50], told[0]["acceleration"][50] = (
        0.1,
        np.nan,
    )  # of one limit something, of another nothing
    numbers[1, 50] = motion.v[50]
    again = certify(motion, plan.limits, ProvedUse(*told, numbers))
    for limit in plan.limits:
        assert (again.use[limit.name] >= dense_use(motion, limit) - 1e-12).all()
