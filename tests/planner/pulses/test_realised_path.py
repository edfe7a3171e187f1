"""The realised path: by other kinematics than the library's own, and within what theory allows, on
every machine.
"""

import sys
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Axis, MotionError, Traverser, load_machine
from planner import Arc, Dwell, Line, Program, PulseSchedule, Turn, plan, realised


def short(machine, step=1e-3):
    """A line of a few millimetres, a rest, and a quarter of a circle, as far as the machine can
    go.
    """
    flat = machine == "linkage"
    there = np.array([step, step / 2, 0.0 if flat else step])
    bend = Arc(np.add(there, [0, step, 0]), [0, 0, 1], np.pi / 2)
    return plan(Program((Line(there), Dwell(0.05), bend)), load_machine(machine))


@pytest.fixture(scope="module", params=["hexapod", "tripod", "linkage", "traverser", "arm"])
def made(request):
    program = short(request.param, {"traverser": 0.02, "tripod": 1e-4}.get(request.param, 1e-3))
    return program, program.realised()


def test_no_error_is_beyond_its_bound_on_any_machine(made):
    _, path = made
    for error in path.errors:
        # the bound is linear in the counts' errors: what it leaves out is their square over the
        # machine's size, 1e-5
        assert error.share <= 1 + 1e-4
        assert 0 <= error.rms <= error.max <= error.bound * (1 + 1e-4)
    assert path["position"].max > 0
    assert str(path).count("\n") == len(path.errors) + 1 + len(path.mechanics)


def test_only_what_moves_has_an_error(made):
    planned, path = made
    machine = planned.machine
    names = [error.name for error in path.errors]
    assert [name for name in names if name in ("x", "y", "z", "rx", "ry", "rz")] == sorted(
        machine.freedom + machine.follows, key=["x", "y", "z", "rx", "ry", "rz"].index
    )
    assert ("orientation" in names) == any(
        name.startswith("r") for name in machine.freedom + machine.follows
    )


def sampled(planned):
    """Every instant just before and just after a pulse: t (N,), and the counts there (N, n), by a
    loop of its own.
    """
    events = sorted({int(tick) for axis in planned.pulses.axes for tick in axis.ticks})
    count = np.array([axis.start for axis in planned.pulses.axes])
    pulses = {}
    for k, axis in enumerate(planned.pulses.axes):
        for tick, sign in zip(axis.ticks.tolist(), axis.direction.tolist(), strict=True):
            pulses.setdefault(tick, []).append((k, sign))
    t, counts = [], []
    for tick in events:
        t.append(tick)
        counts.append(count.copy())
        for k, sign in pulses[tick]:
            count[k] += sign
        t.append(tick)
        counts.append(count.copy())
    return np.array(t) / planned.pulses.clock_hz, np.array(counts)


def test_the_linkage_is_where_the_source_says_that_its_counts_put_it():
    """[Motion 2-D, SEEDS 5]: θ by the law of cosines from the lengths of the integer pulses, then
    the point.
    """
    planned = short("linkage")
    machine, path = planned.machine, planned.realised()
    t, counts = sampled(planned)
    la, lb = (machine.home_q + counts * [axis.pulse for axis in machine.axes]).T
    a, b, h, angle = np.zeros(2), np.array([0.4, 0.0]), 0.12, np.deg2rad(150)
    q = b[0] - a[0]
    theta = np.arccos((la**2 + q**2 - lb**2) / (2 * la * q))
    x = a[0] + la * np.cos(theta) + h * np.cos(np.pi + theta - angle)
    y = a[1] + la * np.sin(theta) + h * np.sin(np.pi + theta - angle)
    wanted = planned.trajectory.at(t).pose.translation
    # arccos of lengths to 1e-16 m: 1e-15 m of position
    assert np.hypot(x - wanted[:, 0], y - wanted[:, 1]).max() == pytest.approx(
        path["position"].max, abs=1e-13
    )
    assert abs(x - wanted[:, 0]).max() == pytest.approx(path["x"].max, abs=1e-13)


def test_the_hexapod_has_the_legs_that_its_counts_say_at_the_largest_error(own_lengths):
    """The planned pose is the thesis' own geometry's; the realised one is asked from home, and
    certified.
    """
    planned = short("hexapod")
    machine, worst = planned.machine, planned.realised()["position"]
    t, counts = sampled(planned)
    here = np.flatnonzero(t == worst.where.t)
    assert len(here) == 2
    q = machine.home_q + counts[here] * 0.75e-6
    found = machine.forward(q)
    assert found.certified.all()
    position, rotation = found.pose.translation, found.pose.rotation.as_matrix()
    assert abs(own_lengths(position, rotation) - q).max() < 1e-12
    away = np.linalg.norm(position - planned.trajectory.at(t[here]).pose.translation, axis=1)
    assert away.max() == pytest.approx(worst.max, abs=1e-13)


def test_the_bound_is_that_of_the_formula(hexapod):
    """Σⱼ |J⁻¹ᵢⱼ| q/2 [METRICS], at the start, where nothing travels within a tick."""
    path = short("hexapod").realised()
    inverse = np.linalg.inv(hexapod.jacobian(hexapod.home))
    found = [path[name].bounds[0] for name in ("x", "y", "z", "rx", "ry", "rz")]
    # a window's bound is the larger of its two ends', 1 ms apart
    assert found == pytest.approx(abs(inverse).sum(1) * 0.75e-6 / 2, rel=2e-3)


@pytest.fixture
def slides():
    limits = {"max_speed": 0.02, "max_acceleration": 1.0}
    axes = [Axis(name, pulse=1e-5, **limits) for name in "XYZ"] + [
        Axis("R", "rotary", pulse=1e-5, **limits)
    ]
    return Traverser(axes=axes, home=RigidTransform.identity())


def test_rounding_of_an_even_motion_is_q_over_root_twelve(slides):
    """The error of a uniform quantiser: its largest is ½ pulse, its RMS pulse/√12 [METRICS]."""
    path = plan(Program((Line([0.02, 0, 0]),)), slides).realised()
    x = path["x"]
    assert x.max == pytest.approx(
        0.5e-5, rel=1e-3
    )  # 0.02 m/s runs 2e-9 m, 4e-4 of that, in the tick of a pulse
    # the ramps, 4 % of the time, are no uniform motion
    assert x.rms == pytest.approx(1e-5 / np.sqrt(12), rel=1e-2)
    # nothing else moves
    assert path["y"].max == path["orientation"].max == 0.0
    assert path["position"].max == x.max


def test_a_tool_feels_the_turn(slides):
    """At the end of a lever r the error in space is r times the turn's."""
    arm = RigidTransform.from_translation([0.3, 0, 0])
    turned = plan(Program((Turn(Rotation.from_rotvec([0, 0, 0.04])),)), slides).realised()
    assert turned["position"].max == 0
    # the tool is turned about its own origin: three axes move, and the turn's error acts at the
    # lever
    carried = plan(
        Program((Turn(Rotation.from_rotvec([0, 0, 0.04])),), tool=arm), slides
    ).realised()
    assert carried.mover == "tool"
    assert carried["orientation"].bound == pytest.approx(0.5e-5, rel=1e-2)
    assert carried["position"].max <= carried["position"].bound
    # ω × r at the lever (0.3, 0, 0) adds to y, and what it adds to x while the tool turns is below
    # 0.04 · 0.3
    at_start = 0.5e-5 * np.linalg.norm([1, 1.3, 1])
    assert carried["position"].bound == pytest.approx(at_start, rel=1e-2)


def test_a_lost_pulse_is_seen_at_once_and_beyond_the_bound(slides):
    planned = plan(Program((Line([0.01, 0, 0]),)), slides)
    first, *rest = planned.pulses.axes
    lost = replace(
        first, ticks=np.delete(first.ticks, 300), direction=np.delete(first.direction, 300)
    )
    path = realised(
        planned, PulseSchedule(planned.pulses.clock_hz, (lost, *rest), planned.pulses.duration)
    )
    assert path["x"].max == pytest.approx(1.5e-5, rel=1e-3)
    assert path["x"].share == pytest.approx(3, rel=1e-2)
    # from there on to the end, where it is one pulse behind
    assert path["x"].series[-1] == pytest.approx(1e-5, rel=1e-6)


def test_a_stride_looks_at_less_and_finds_no_more(made):
    planned, whole = made
    thin = planned.realised(stride=7)
    assert thin.instants < whole.instants
    for error in whole.errors:
        assert thin[error.name].max <= error.max
        assert (thin[error.name].series <= error.series).all()
    # a seventh of some thousand instants; the mean of squares of a thousandth part is good to a few
    # per cent
    assert thin["position"].rms == pytest.approx(whole["position"].rms, rel=0.1)


def test_without_pulses_the_error_is_what_the_start_leaves(slides):
    """A motion too small to fire: the counts stand where they are, and the error is the whole
    motion.
    """
    planned = plan(Program((Line([0.3e-5, 0, 0]),)), slides)
    assert planned.pulses.total == 0
    path = planned.realised()
    assert path["x"].max == pytest.approx(0.3e-5, rel=1e-9)
    assert path["x"].where.t == pytest.approx(planned.trajectory.duration, abs=1e-6)


def test_blocks_change_nothing(made, monkeypatch):
    planned, whole = made
    monkeypatch.setattr(sys.modules[realised.__module__], "BLOCK_PULSES", 97)
    again = planned.realised()
    for error in whole.errors:
        assert again[error.name].max == error.max
        assert again[error.name].where == error.where
        assert again[error.name].rms == pytest.approx(error.rms, rel=1e-9)
        assert np.array_equal(again[error.name].series, error.series)


def test_refusals_say_what_is_wrong(slides):
    planned = plan(Program((Line([0.001, 0, 0]),)), slides)
    with pytest.raises(MotionError, match="stride 0"):
        planned.realised(stride=0)
    with pytest.raises(MotionError, match="3 axes of pulses for machine traverser with 4"):
        realised(planned, replace(planned.pulses, axes=planned.pulses.axes[:3]))
    with pytest.raises(MotionError, match="no error 'w'; it has x, y, z"):
        planned.realised()["w"]


def test_counts_that_stand_for_no_pose_are_told():
    planned = short("linkage")
    away = tuple(
        replace(axis, start=100_000 * (axis.name == planned.pulses.axes[0].name))
        for axis in planned.pulses.axes
    )
    with pytest.raises(MotionError, match="stand for no pose"):
        realised(planned, replace(planned.pulses, axes=away))


def test_the_figure_shows_the_error_under_its_bound(made):
    _, path = made
    ax = path.plot()
    assert ax.get_ylabel() == "position error (µm)"
    error, bound = (patch.get_data().values for patch in ax.patches)
    assert (error <= bound * (1 + 1e-4)).all()
    assert error == pytest.approx(1e6 * path["position"].series)


PLAY, TABLE = 4e-5, ((0.0, 0.0), (0.01, 3e-5), (0.04, -6e-5))
BACK = Program((Line([0.02, 0, 0]), Dwell(0.1), Line([0, 0, 0])))
"""Out to where the screw is at zero error again, a rest, and back."""


def behind_screws(slides, program=BACK, **mechanics):
    """A plan of the slides, of which X has mechanics, and the path that its pulses make."""
    first, *rest = slides.axes
    planned = plan(program, Traverser(axes=[replace(first, **mechanics), *rest], home=slides.home))
    return planned, planned.realised()


def at_rest(path, t):
    """The largest error in x in the window about t, where nothing moves."""
    return path["x"].series[np.searchsorted(path.edges, t) - 1]


def test_play_and_lead_error_that_are_not_made_up_for_are_in_the_path(slides):
    """Half a pulse, 5 µm, is what the counts themselves may add."""
    planned, path = behind_screws(slides, backlash=PLAY)
    assert at_rest(path, planned.trajectory.duration / 2) <= 0.5e-5 * 1.001
    assert at_rest(path, planned.trajectory.duration) == pytest.approx(PLAY, abs=0.501e-5)
    assert path["x"].max == pytest.approx(PLAY, abs=0.501e-5)
    # most of the way back the play is on the wrong side, with the uniform error of the counts about
    # it
    assert (path["x"].series[550:970] > PLAY - 0.501e-5).all()

    planned, path = behind_screws(slides, lead_error=TABLE)
    assert path["x"].max == pytest.approx(3e-5, abs=0.501e-5)
    assert path["x"].where.s == pytest.approx(0.01, abs=3e-3) or path["x"].where.s == pytest.approx(
        0.03, abs=3e-3
    )
    assert at_rest(path, planned.trajectory.duration / 2) <= 0.501e-5

    _, path = behind_screws(slides, backlash=PLAY, lead_error=TABLE)
    # on the way back they add up
    assert path["x"].max == pytest.approx(PLAY + 3e-5, abs=0.51e-5)
    assert path["x"].where.segment == 3
    assert 0.8 < path["x"].share <= 1 + 1e-4
    assert str(path).endswith("in error and bound, X: play 40 (not), lead error up to 60 (not) µm")


def test_made_up_for_they_are_within_the_bound_of_the_counts(slides):
    _, plain = behind_screws(slides)
    planned, path = behind_screws(
        slides, backlash=PLAY, lead_error=TABLE, compensate=("lead", "backlash")
    )
    assert planned.pulses.compensations[0].crossings == 1
    assert planned.pulses.compensations[0].off < 1e-12  # the rest is long enough
    assert path["x"].share <= 1 + 1e-4
    # the screw's slope, 0.3 %, is on the rounding of the counts
    assert path["x"].max == pytest.approx(plain["x"].max, rel=5e-3)
    assert path["x"].bound == pytest.approx(1.003 * plain["x"].bound, rel=1e-4)
    assert "made up for" in str(path)
    # one of the two alone leaves the other
    _, lead = behind_screws(slides, backlash=PLAY, lead_error=TABLE, compensate=("lead",))
    assert lead["x"].max == pytest.approx(1.003 * PLAY, abs=0.502e-5)
    _, play = behind_screws(slides, backlash=PLAY, lead_error=TABLE, compensate=("backlash",))
    assert play["x"].max == pytest.approx(3e-5, abs=0.502e-5)
    assert max(lead["x"].share, play["x"].share) <= 1 + 1e-4


def test_where_the_axis_turns_without_a_rest_it_is_off_as_compensation_says(slides):
    """Half a circle: x turns at its end. Nothing else crosses play there."""
    bend = Program((Arc([0, 0.005, 0], [0, 0, 1], np.pi),))
    kinds = {"backlash": PLAY, "compensate": ("backlash",), "take_up_acceleration": 10.0}
    planned, path = behind_screws(slides, bend, **kinds)
    (cost,) = [cost for cost in planned.pulses.compensations if cost.crossings]
    assert 0 < cost.off < PLAY
    assert cost.acceleration <= 10.0 * (1 + 1e-6)
    assert path["x"].share <= 1 + 1e-4
    assert path["x"].max <= cost.off + 0.501e-5
    # off is in the bound only while the play is crossed
    assert np.median(path["x"].bounds) < 0.501e-5
    assert path["x"].bounds.max() == pytest.approx(cost.off + 0.5e-5, rel=1e-2)


def test_a_stride_and_blocks_lose_no_turn_of_the_play(slides, monkeypatch):
    """What lies between the intervals that are looked at moves the play all the same."""
    planned, whole = behind_screws(slides, backlash=PLAY)
    thin = planned.realised(stride=200)
    assert (thin["x"].series <= whole["x"].series).all()
    assert thin["x"].series[-1] == pytest.approx(PLAY, abs=0.501e-5)
    monkeypatch.setattr(sys.modules[realised.__module__], "BLOCK_PULSES", 61)
    assert np.array_equal(planned.realised()["x"].series, whole["x"].series)


def test_pulses_that_compensate_are_as_near_to_the_plan_as_others(tmp_path):
    """A screw that is up to 48 µm beyond what it counts, and a play of 2 thousandths of an inch,
    would be seen.
    """
    text = (files("kinematics") / "presets" / "traverser.toml").read_text()
    found = {}
    for kinds, states in (("[]", ""), ("[]", "lead"), ('["lead", "backlash"]', "lead")):
        lines = [
            line
            for line in text.splitlines()
            if states or not line.startswith(("lead", "backlash"))
        ]
        path = tmp_path / f"mine{len(found)}.toml"
        path.write_text("\n".join(lines).replace("[axes]", f"[axes]\ncompensate = {kinds}"))
        program = Program((Line((0.02, 0.01, 0.03)), Dwell(0.25), Line((0.0, 0.0, 0.0))))
        found[len(found)] = plan(program, load_machine(str(path))).realised()
    plain, left, made = found.values()
    assert made["position"].max == pytest.approx(plain["position"].max, rel=0.02)
    assert made["position"].share <= 1 + 1e-3
    assert left["position"].max > 5 * plain["position"].max
