"""Laws that remember: what the memory does is what the equations say, and no run finds that of
another.
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import PPoly

from controllers import evaluate, find_law, load_rig, track
from controllers.card import TAMove
from controllers.laws.law import Feedback, Reference, begin_law, step_law
from controllers.rig import Host
from controllers.simulate import sample, simulate
from controllers.tracking import track_each
from kinematics import MotionError
from planner import time_optimal

sys.path.insert(0, str(Path(__file__).parents[3] / "docs" / "examples"))
from leaky_integral import LeakyIntegral

DT, SPEED = 5e-3, 0.2
GAINS = np.array([[0.0], [2.0], [6.0]])


@pytest.fixture(scope="module")
def rig():
    return load_rig("servo-rig")


def move_evenly(rig, way):
    """Return a motion of every axis by so many rad at one speed, but for short ramps."""
    home = rig.machine.home_q
    path = PPoly(np.stack([np.full((1, len(home)), 1.0), home[None]]), [0.0, way])
    return time_optimal(path, max_speed=SPEED, max_acceleration=5.0).trajectory


@pytest.fixture(scope="module")
def steady(rig):
    """Two seconds, after which each integral is at its end: the slowest has 0.2 s."""
    return move_evenly(rig, 0.4)


@pytest.fixture(scope="module")
def brief(rig):
    return move_evenly(rig, 0.1)


def final_error(rig, motion, law):
    """(n,) following error at the end of the constant speed."""
    tracked = track(motion, rig.machine, law, rig=rig, dt=DT, period=1e-3)
    k = np.searchsorted(tracked.t, motion.duration - 0.2)
    return (tracked.reference - tracked.actual)[k - 200 : k].mean(0)


@pytest.fixture(scope="module")
def lag(rig, steady):
    """(n,) error without an integral."""
    return final_error(rig, steady, LeakyIntegral(gain=0.0))


def test_it_leaves_of_a_lag_what_the_leak_lets_through(rig, steady, lag):
    """At constant speed I = gain leak e, and the drive is K (r + I − x) = v: e = (v/K)/(1 + gain
    leak).

    Half of the play is behind that, where an encoder at the motor does not see it.
    """
    play = np.array([drive.play / 2 for drive in rig.drives])
    bare = lag - play
    np.testing.assert_allclose(
        bare, SPEED / np.array([drive.position_gain for drive in rig.drives]), rtol=0.02
    )
    for gain, leak in ((3.0, 0.5), (10.0, 0.3)):
        law = LeakyIntegral(gain=gain, leak=leak, most=1e6)
        np.testing.assert_allclose(
            final_error(rig, steady, law) - play, bare / (1 + gain * leak), rtol=0.02
        )


def test_what_is_clamped_stays_so(rig, steady, lag):
    pulse = np.array([axis.pulse for axis in rig.machine.axes])
    clamped = final_error(rig, steady, LeakyIntegral(gain=20.0, most=10.0))
    np.testing.assert_allclose(lag - clamped, 10 * pulse, rtol=0.1)


def test_the_same_run_twice_is_the_same(rig, brief):
    law = LeakyIntegral(gain=6.0)
    one, other = (track(brief, rig.machine, law, rig=rig, dt=DT, period=1e-2) for _ in range(2))
    np.testing.assert_array_equal(one.actual, other.actual)
    figures = [evaluate(each, brief, rig.machine).tracking.rms for each in (one, other)]
    assert figures[0] == figures[1]


def test_runs_of_a_batch_have_memories_of_their_own(rig, brief):
    """Gains of their own, and hosts that come to their steps at other times: each as it is
    alone.
    """
    hosts = [rig.host, Host("sleep", 5e-3, 1e-3, seed=1), Host("sleep", 5e-3, 1e-3, seed=2)]
    rigs = [replace(rig, host=host) for host in hosts]
    reference = sample(brief, rig.machine, DT)
    law = replace(LeakyIntegral(gain=GAINS), most=1e6)
    together = simulate(reference, law, rigs, period=1e-2)
    for b, (own, gain) in enumerate(zip(rigs, GAINS[:, 0], strict=True)):
        alone = simulate(reference, replace(law, gain=float(gain)), [own], period=1e-2)
        rows = min(len(alone.t), len(together.t))
        np.testing.assert_allclose(
            together.actual[:rows, b], alone.actual[:rows, 0], rtol=1e-9, atol=1e-6
        )


def test_it_runs_beside_laws_without_memory(rig, brief):
    laws = [find_law("3"), LeakyIntegral(gain=6.0), LeakyIntegral(gain=2.0)]
    for law, found in zip(
        laws, track_each(brief, rig.machine, laws, rig=rig, period=1e-2), strict=True
    ):
        alone = track(brief, rig.machine, law, rig=rig, period=1e-2)
        np.testing.assert_allclose(found.actual, alone.actual, rtol=1e-12)


@dataclass(frozen=True)
class Forgetful(LeakyIntegral):
    """What it returns is none of its memory."""

    first: object = (np.zeros((1, 3)),)
    after: object = None

    def begin(self, lanes):
        return self.first

    def step(self, k, reference, feedback, memory):
        send = TAMove(
            reference.ang(k + 1), reference.npuls(k), reference.npuls(k + 1), reference.dt, 0.0
        )
        return send if self.after is None else (send, self.after)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (
            {"first": np.zeros((1, 3))},
            r"begin must return a tuple of arrays \(1, 3\), runs and axes first",
        ),
        ({"first": (np.zeros(2),)}, "begin must return a tuple of arrays"),
        ({"first": None}, "begin must return a tuple of arrays"),
        ({}, "step must return the command and the memory"),
        ({"after": ()}, r"step returned memory of shapes \[\]; it got \[\(1, 3\)\]"),
        ({"after": ("sum",)}, "step must return a tuple of arrays"),
    ],
)
def test_memory_that_is_none_is_refused(rig, brief, given, told):
    with pytest.raises(MotionError, match=told):
        track(brief, rig.machine, Forgetful(**given), rig=rig, dt=DT)


class InPlace(LeakyIntegral):
    def step(self, k, reference, feedback, memory):
        memory[0][...] = 99.0
        return super().step(k, reference, feedback, memory)


def test_memory_written_in_place_is_of_the_step_alone():
    zeros = np.zeros((1, 3))
    reference, law = Reference(DT, np.zeros((5, 3)), np.zeros((5, 3))), InPlace(gain=1.0)
    memory = begin_law(law, (1, 3))
    step_law(law, 0, reference, Feedback(zeros, zeros, zeros), memory)
    assert not memory[0].any()  # of a run that is not due, it stays


def test_progress_of_tracking_and_evaluating_is_told_to_the_end(rig, brief):
    told, errors = [], []
    tracked = track(
        brief, rig.machine, "3", rig=rig, period=1e-2, progress=lambda *step: told.append(step)
    )
    plain = track(brief, rig.machine, "3", rig=rig, period=1e-2)
    np.testing.assert_array_equal(tracked.actual, plain.actual)
    evaluate(tracked, brief, rig.machine, progress=lambda *step: errors.append(step))
    for steps in (told, errors):
        shares = [done / of for done, of in steps]
        assert shares == sorted(shares)
        assert shares[-1] == 1
    assert len(told) > 10
