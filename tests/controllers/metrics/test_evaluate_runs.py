"""Batches: the same as one by one, the same as the proved poses, and what happens where a pose is
not known.
"""

from dataclasses import fields, replace

import numpy as np
import pytest

from controllers import Tracking, evaluate, find_law, load_rig
from controllers.card import PCI_8164
from controllers.metrics import FIGURES, evaluate_runs
from controllers.rig import Host, Sine, Task, assumed_rig
from controllers.simulate import Runs, sample, simulate

SETTLE = 0.25
ENDS = 1e-12
"""Relative: sums of the same numbers in another order."""


@pytest.fixture(scope="module")
def rig():
    """With speeds that are not rounded: the card's slowest brings the last of a law's rounding home
    at once.
    """
    stated = load_rig("servo-rig")
    return replace(stated, card=PCI_8164)


def cycles(rig, task, law, hosts):
    rigs = [replace(rig, host=host) for host in hosts]
    return simulate(
        sample(task.motion, rig.machine, task.dt), law, rigs, settle=SETTLE, period=1e-3
    ), rigs


@pytest.fixture(scope="module")
def sleeping(rig):
    """Five cycles of the thesis' reference whose hosts sleep, so that each ends at a time of its
    own.
    """
    return cycles(
        rig,
        rig.task("line"),
        find_law("3"),
        [Host("sleep", 1 / 64, 1e-3, seed) for seed in range(5)],
    )


def swing(rig):
    """Two joints out and back by 2.5 rad within two seconds."""
    return Task("swing", Sine(rig.machine.home_q, np.array([2.5, 2.5, 0]), np.pi / 2, 2.0), 50e-3)


def alone(runs, b):
    """What a simulation of this run alone gives: its record ends where it does."""
    until = int(np.searchsorted(runs.t, runs.end[b] - 1e-9))

    def own(name):
        values = getattr(runs, name)
        if name == "t":
            return values[:until]
        if name == "steps":
            return values[:, b : b + 1]
        return values[:until, b : b + 1] if len(values) == len(runs.t) else values[b : b + 1]

    return Runs(**{field.name: own(field.name) for field in fields(Runs)})


@pytest.mark.parametrize("name", ["line", "swing", "square"])
def test_a_batch_is_its_runs_one_by_one(rig, sleeping, name):
    task = swing(rig) if name == "swing" else rig.task(name)
    gains = np.array([0.2, 0.6, 0.9])[:, None]
    runs, rigs = (
        sleeping if name == "line" else cycles(rig, task, find_law("6", gain=gains), [rig.host] * 3)
    )
    together = evaluate_runs(runs, task, rigs)
    assert len(together) == len(rigs)
    for b, found in enumerate(together):
        one = evaluate_runs(alone(runs, b), task, rigs[b : b + 1])[0]
        for ours, theirs in zip(found.series, one.series, strict=True):
            # 1 m or rad: below, sums in another order leave rounding
            np.testing.assert_allclose(ours.value, theirs.value, rtol=ENDS, atol=1e-15)
        figures, expected = found.figures(), one.figures()
        assert figures == pytest.approx(expected, rel=ENDS, abs=1e-15, nan_ok=True)


def test_figures_are_those_that_are_stated(rig, sleeping):
    figures = evaluate_runs(sleeping[0], rig.task("line"), sleeping[1])[0].figures()
    names = [axis.name for axis in rig.machine.axes]
    expected = [figure.name for figure in FIGURES]
    per_axis = [f"{figure.name}.{axis}" for figure in FIGURES if figure.per_axis for axis in names]
    assert sorted(figures) == sorted(expected + per_axis)
    assert np.isfinite(list(figures.values())).all()
    for figure in FIGURES:
        if figure.per_axis:
            assert figures[figure.name] in [figures[f"{figure.name}.{axis}"] for axis in names]


def test_a_late_host_is_late(rig, sleeping):
    """Each run ends later by what its host slept too long, to a step: the last one brings the axes
    into the band.
    """
    runs, rigs = sleeping
    found = evaluate_runs(runs, rig.task("line"), rigs)
    counted, own = cycles(rig, rig.task("line"), find_law("3"), [rig.host])
    polled = evaluate_runs(counted, rig.task("line"), own)[0]
    for b, metrics in enumerate(found):
        slept = runs.steps[40, b] - 5.0
        assert slept > 0.25
        assert metrics.ending.late - polled.ending.late == pytest.approx(slept, abs=0.125)
        assert metrics.t[-1] < runs.end[b]


def test_poses_that_are_not_proved_are_those_that_are(circle_trip, hexapod, law):
    """The hexapod's circle: every error of the batch is that of `evaluate` with its certificate."""
    rig, task = assumed_rig(hexapod), Task("trip", circle_trip, 5e-3)
    runs = simulate(sample(circle_trip, hexapod, task.dt), law, [rig] * 2, settle=SETTLE)
    q = hexapod.home_q + runs.actual[:, 1] * [axis.pulse for axis in hexapod.axes]
    planned = circle_trip.at(np.minimum(runs.t, circle_trip.duration)).q
    alone = Tracking(
        law.name, task.dt, runs.t, planned, q, q, runs.pulses[1], (), rig.name, runs.lost[1]
    )
    proved = evaluate(alone, circle_trip, hexapod)
    found = evaluate_runs(runs, task, [rig] * 2, period=1e-3)[1]
    for ours, theirs in zip(found.series, proved.series, strict=True):
        # Newton leaves 1e-14 m; where the contour's nearest point jumps nothing jumps with it
        np.testing.assert_allclose(ours.value, theirs.value, atol=1e-12)
    assert (found.ending.late, found.ending.band) == (proved.ending.late, proved.ending.band)
    assert np.isnan(proved.figures()["torque_rms"])


def test_a_run_that_is_lost_leaves_the_others_alone(circle_trip, hexapod, law):
    rig, task = assumed_rig(hexapod), Task("trip", circle_trip, 5e-3)
    runs = simulate(
        sample(circle_trip, hexapod, task.dt), law, [rig] * 3, settle=SETTLE, period=5e-3
    )
    torn = np.array(runs.actual)
    torn[900:, 1, 0] += 0.5 / hexapod.axes[0].pulse
    found = evaluate_runs(replace(runs, actual=torn), task, [rig] * 3)
    figures = found[1].figures()
    assert np.isnan(
        [figures[name] for name in ("contour_rms", "tracking_max", "lag_rms", "orientation_rms")]
    ).all()
    assert figures["following_max"] > 0.4
    assert figures["end_time"] == np.inf
    assert found[0].figures() == pytest.approx(found[2].figures(), rel=ENDS, nan_ok=True)
    assert np.isfinite(found[0].contour.max)


def test_axes_that_lag_along_their_own_line_are_not_beside_it(rig):
    """Two servos on one sine run along a line there and back: equal lags are no contour error."""
    task = swing(rig)
    runs, rigs = cycles(rig, task, find_law("3"), [rig.host])
    state = task.motion.at(np.clip(runs.t - 0.03, 0, task.motion.duration))
    pulse = [axis.pulse for axis in rig.machine.axes]
    late = replace(runs, actual=((state.q - rig.machine.home_q) / pulse)[:, None])
    metrics = evaluate_runs(late, task, rigs)[0]
    assert metrics.orientation is None
    assert (metrics.tracking.unit, metrics.contour.unit) == ("rad", "rad")
    # both axes: √2 A ω · 30 ms at the top speed, to (ω · 30 ms)²/6
    assert metrics.tracking.max == pytest.approx(np.sqrt(2) * 2.5 * np.pi / 2 * 0.03, rel=1e-3)
    assert metrics.contour.max < 1e-13
    np.testing.assert_allclose(np.abs(metrics.lag.value), metrics.tracking.value, atol=1e-9)


@pytest.fixture(scope="module")
def law():
    return find_law("3")
