"""Stops and the way on after input shapers, against copies that are summed here."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from kinematics import Load, load_machine
from kinematics.machine.shaper import Shaper
from planner import Blend, Dwell, Infeasible, Line, Program, load_program, plan
from planner.interruption import hold
from planner.pulses import check

INSTANTS = 5_001


CORNERS = (
    Line(to=(0.03, 0.01, 0)),
    Line(to=(0.03, 0.04, 0), join=Blend(5e-4)),
    Line(to=(0.0, 0.02, 0.01)),
)


def plan_circle():
    """A circle on the legs of the hexapod, no axis of which moves evenly; whose forces are not
    proved.
    """
    return load_program("bare-circle"), load_machine("hexapod").carrying(Load()), 3, "zvd"


def plan_corners():
    """Corners, one of which is rounded, at order 2, where the acceleration jumps."""
    return Program(CORNERS), load_machine("corexy"), 2, "zv"


@pytest.fixture(scope="module", params=[plan_circle, plan_corners], ids=["circle", "corners"])
def shaped(request):
    program, machine, order, kind = request.param()
    machine = machine.driven_by(
        [replace(axis, shaper=Shaper(kind, 25.0, 0.05)) for axis in machine.axes]
    )
    return plan(program, machine, order=order)


@pytest.fixture(scope="module")
def stop_at(shaped):
    """An instant (s) -> the stop from there, made once."""
    return cache(shaped.hold)


def convolve(shaped, held, t):
    """q (N, n) after the hold: a copy is on the plan up to its own instant of the hold, and on the
    stop after it.
    """
    impulses = shaped.machine.axes[0].shaper.impulses
    q = 0.0
    for amplitude, delay in zip(*impulses, strict=True):
        own = held.at + t - delay
        on_plan = shaped.trajectory.at(np.clip(own, 0, held.at)).q
        on_stop = held.trajectory.at(np.clip(own - held.at, 0, None)).q
        q = q + amplitude * np.where((own < held.at)[:, None], on_plan, on_stop)
    return q


def instants(shaped):
    """At the start, in the middle, near the end, and just after a rest, within the copies' delays.

    Of the circle without the one near the end: computing a stop of the hexapod takes four seconds.
    """
    motion = shaped.trajectory
    rests = motion.knots[:-1][(motion.v == 0) & (motion.knots[:-1] > 0)]
    moving = [rest + 0.01 for rest in rests if motion.at(rest + 0.01).sd[0] > 1e-3][:1]
    late = [0.9 * motion.duration] if shaped.order == 2 else []
    return [0.03, 0.37 * motion.duration, *late, *moving]


def test_a_stop_is_proved_behind_shapers_and_goes_on_with_the_pulses(shaped, stop_at):
    axes, home = shaped.machine.axes, shaped.machine.home_q
    for at in instants(shaped):
        held = stop_at(at)
        assert held.certificate.holds
        assert held.shaped.holds
        assert held.duration == pytest.approx(
            held.trajectory.duration + shaped.shaped.motion.copies.length
        )
        t = np.linspace(0, held.duration, INSTANTS)
        q = convolve(shaped, held, t)
        np.testing.assert_allclose(held.counted.at(t).q, q, rtol=0, atol=1e-12)
        # limits of the axes by differences; where the acceleration jumps these are off by no more
        # than a mean
        rate = np.diff(q, axis=0) / t[1]
        assert (
            np.abs(rate).max(0) <= np.array([axis.max_speed for axis in axes]) * (1 + 1e-6)
        ).all()
        most = np.array([axis.max_acceleration for axis in axes])
        assert (np.abs(np.diff(rate, axis=0) / t[1]).max(0) <= most * (1 + 1e-4)).all()
        # on the path, but for the deviation that is proved, and at its end exactly
        poses = shaped.machine.forward(
            q[::25], shaped.trajectory.at(np.full(len(q[::25]), held.at)).pose
        ).pose
        late = np.clip(held.at + t[::25] - shaped.shaped.delay, 0, None)
        about = np.where(
            (late < held.at)[:, None],
            shaped.trajectory.at(np.clip(late, 0, held.at)).pose.translation,
            held.trajectory.at(np.clip(late - held.at, 0, None)).pose.translation,
        )
        assert (
            np.linalg.norm(poses.translation - about, axis=1).max() <= held.shaped.deviation + 1e-9
        )
        # the tool goes as far as is told at most, which counts what the shapers make it late by
        way = np.linalg.norm(np.diff(poses.translation, axis=0), axis=1).sum()
        passed = shaped.trajectory.at(max(held.at - shaped.shaped.motion.copies.length, 0)).along[0]
        assert way <= held.distance
        assert held.distance == pytest.approx(held.until - passed, rel=1e-9)
        np.testing.assert_allclose(
            q[-1], held.trajectory.at(held.trajectory.duration).q[0], rtol=0, atol=1e-12
        )
        verdict = check(held.pulses, held.counted, axes, home)
        assert verdict.holds, verdict
        tick = round(held.at * shaped.pulses.clock_hz)
        for sent, own in zip(shaped.pulses.axes, held.pulses.axes, strict=True):
            assert own.start == sent.counts([tick - 1])[0]


def test_what_is_proved_of_a_stop_is_of_what_its_copies_do(shaped, stop_at):
    """Not of the whole plan: the most of each rate from the length of the shapers before the stop
    up to its rest.
    """
    length = shaped.shaped.motion.copies.length
    for at in instants(shaped)[:2]:
        held = stop_at(at)
        before = shaped.trajectory.at(np.linspace(max(held.at - length, 0), held.at, INSTANTS)[:-1])
        after = held.trajectory.at(np.linspace(0, held.trajectory.duration, INSTANTS))
        for name in ("speed", "acceleration"):
            rate, most = {"speed": "qd", "acceleration": "qdd"}[name], f"max_{name}"
            moved = np.concatenate(
                [np.abs(getattr(state, rate)).max(0) for state in (before, after)]
            ).reshape(2, -1)
            seen = (moved.max(0) / [getattr(axis, most) for axis in shaped.machine.axes]).max()
            # as fine as the instants are, and as tight as bounds are made
            assert seen <= held.shaped.worst[name] * (1 + 1e-9)
            assert held.shaped.worst[name] <= seen * (1 + 2e-3)
            place = held.shaped.where[name]
            assert max(held.at - length, 0) <= place.t <= held.at + held.trajectory.duration
            assert held.until - held.distance - 1e-9 <= place.s <= held.until + 1e-9
        if at == 0.03:
            assert held.shaped.worst["speed"] < 0.6 * shaped.certificate.worst["speed"]


def test_the_way_on_is_proved_behind_shapers(shaped, stop_at):
    axes, home = shaped.machine.axes, shaped.machine.home_q
    held = stop_at(instants(shaped)[1])
    for made in (shaped.resume(0.0, 0.5), shaped.resume(held, 0.5)):
        assert made.shaped.holds
        assert check(made.pulses, made.counted, axes, home).holds
        assert made.duration == pytest.approx(
            made.trajectory.duration + shaped.shaped.motion.copies.length
        )
    assert shaped.resume(0.0, 1.0).duration == pytest.approx(shaped.shaped.motion.duration)


@pytest.mark.parametrize("shaped", [plan_corners], indirect=True, ids=["corners"])
def test_the_way_on_can_be_held_behind_shapers(shaped, stop_at):
    """Copies of the way on are under way in its stop."""
    axes, home = shaped.machine.axes, shaped.machine.home_q
    on = shaped.resume(stop_at(instants(shaped)[1]), 0.6)
    held = shaped.hold(0.4 * on.duration, on)
    assert held.shaped.holds
    assert check(held.pulses, held.counted, axes, home).holds
    now, begin = on.counted.at(np.array([held.at])), held.counted.at(np.zeros(1))
    np.testing.assert_allclose(begin.q, now.q, rtol=0, atol=1e-12)
    last = shaped.resume(held)
    assert [axis.final for axis in last.pulses.axes] == [axis.final for axis in shaped.pulses.axes]


@pytest.mark.parametrize("shaped", [plan_corners], indirect=True, ids=["corners"])
def test_the_table_of_stops_is_of_what_is_shaped(shaped):
    found = shaped.stops(1)
    held = shaped.hold(found.t[-1])
    assert found.time[-1] == pytest.approx(held.duration, rel=1e-6)
    assert found.distance[-1] == pytest.approx(held.distance, rel=1e-6)


@pytest.mark.parametrize("shaped", [plan_corners], indirect=True, ids=["corners"])
def test_a_stop_that_is_not_proved_is_refused_and_in_no_table(shaped, monkeypatch):
    prove = hold.prove_shaped

    def break_one(*given, **named):
        proof = prove(*given, **named)
        return replace(proof, worst={**proof.worst, "speed": 1.2})

    monkeypatch.setattr(hold, "prove_shaped", break_one)
    for stop in (lambda: shaped.hold(0.37 * shaped.trajectory.duration), lambda: shaped.stops(1)):
        with pytest.raises(Infeasible, match="use of speed behind the input shapers"):
            stop()


def test_a_stop_goes_to_a_fieldbus_row_by_row(shaped, stop_at, tmp_path):
    held = stop_at(instants(shaped)[1])
    whole, done = (
        shaped.export("csp", tmp_path / "plan.csv"),
        held.export("csp", tmp_path / "stop.csv"),
    )
    # half an increment of rounding, and what a chord over a cycle T leaves of the hardest
    # acceleration: a T²/8
    chord = max(axis.max_acceleration / axis.pulse for axis in shaped.machine.axes) * 1e-6 / 8
    assert max(done.error, whole.error) <= 0.5 + chord + 1e-6
    # rows, second differences and parabolas between them: as those of the plan
    figures = [
        [float(x) for x in re.findall(r"(?:most|within) ([\d.]+)", " ".join(made.notes))]
        for made in (whole, done)
    ]
    assert len(figures[0]) == len(figures[1]) >= 4
    assert (np.array(figures[1]) <= np.array(figures[0]) + 1).all()
    with pytest.raises(
        Exception, match=r"starts at .* but Zaber PVT starts and ends at rest; .*csp"
    ):
        held.export("zaber", tmp_path / "stop.txt")
    with pytest.raises(Exception, match="but G-code in inverse time starts and ends at rest"):
        held.export("g93", tmp_path / "stop.ngc")


@pytest.mark.parametrize("shaped", [plan_corners], indirect=True, ids=["corners"])
def test_copies_that_still_move_run_out(shaped):
    """In what is a rest of the motion before the shapers, and behind its end: until every copy
    rests.
    """
    motion, copies = shaped.trajectory, shaped.shaped.motion.copies
    for at in (motion.duration - 1e-3, motion.duration + 0.4 * copies.length):
        held = shaped.hold(at)
        t = np.linspace(0, held.duration, 2001)
        q = 0.0
        for amplitude, delay in zip(*shaped.machine.axes[0].shaper.impulses, strict=True):
            q = q + amplitude * motion.at(np.clip(held.at + t - delay, 0, motion.duration)).q
        assert held.shaped.holds
        if at > motion.duration:  # where nothing can stop sooner
            np.testing.assert_allclose(held.counted.at(t).q, q, rtol=0, atol=1e-12)
            assert held.duration == pytest.approx(motion.duration + copies.length - held.at)
            assert held.until == pytest.approx(shaped.path.breaks[-1])
        assert held.distance > 0
    with pytest.raises(Exception, match="the plan lasts from 0 to"):
        shaped.hold(motion.duration + copies.length + 0.01)


def test_behind_a_short_move_and_a_dwell_copies_run_out():
    """The path that copies are on begins at rest, and ends where the program dwells: that dwell is
    not of the stop.
    """
    machine = load_machine("corexy")
    machine = machine.driven_by([axis.add_shaper(Shaper("zvd", 20.0)) for axis in machine.axes])
    program = Program((Line(to=(0.0006, 0.0005, 0)), Dwell(0.3), Line(to=(0.03, 0.01, 0))))
    made = plan(program, machine)
    end = made.trajectory.duration + made.shaped.motion.copies.length
    for at in (0.0353, 0.1, end - 1e-3):
        assert made.hold(at).shaped.holds
    assert made.hold(end - 3e-4).duration == 0  # a nanometre is left
    assert 1 <= len(made.stops(1).t) <= 2
