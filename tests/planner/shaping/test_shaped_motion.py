"""The shaped motion against a direct convolution, and its pulses against a checker that works it
out its own way.
"""

from dataclasses import replace

import numpy as np
import pytest

from kinematics import load_machine
from kinematics.machine.shaper import Shaper
from planner import load_program
from planner.pulses import check, generate
from planner.pulses.checking.convolution import rebuild_motion
from planner.shaping.shaped_motion import find_copies, shape_motion

SHAPERS = (
    Shaper("zv", 20.0, 0.1),
    None,
    Shaper("mzv", 35.0),
    Shaper("ei", 50.0, 0.05),
    Shaper("zvd", 12.0),
    None,
)


def give(machine, *shapers):
    """The machine whose axes have these shapers in turn."""
    own = [replace(axis, shaper=shapers[n % len(shapers)]) for n, axis in enumerate(machine.axes)]
    return machine.driven_by(own)


@pytest.fixture(scope="module")
def bare(planned):
    """An unshaped plan at either order."""
    return {order: planned("bare-circle", order) for order in (2, 3)}


def convolve(trajectory, axes, t):
    """q_s (N, n) at t: each axis delayed so that the centroids of all agree, and each copy asked by
    itself.
    """
    impulses = [
        (np.ones(1), np.zeros(1)) if axis.shaper is None else axis.shaper.impulses for axis in axes
    ]
    latest = max(a @ times for a, times in impulses)
    out = np.zeros((len(t), len(axes)))
    for k, (amplitudes, times) in enumerate(impulses):
        for amplitude, time in zip(amplitudes, times, strict=True):
            at = np.clip(t - time - (latest - amplitudes @ times), 0.0, trajectory.duration)
            out[:, k] += amplitude * trajectory.at(at).q[:, k]
    return out


@pytest.mark.parametrize("order", [2, 3])
def test_it_is_the_sum_of_its_copies(bare, order):
    plan, machine = bare[order], give(bare[order].machine, *SHAPERS)
    shaped = shape_motion(plan.trajectory, machine.axes)
    copies = find_copies(machine.axes)
    assert np.allclose(copies.delays @ copies.weights, copies.centre, rtol=0, atol=1e-15)
    assert shaped.duration == pytest.approx(plan.trajectory.duration + copies.delays[-1], abs=1e-15)
    t = np.linspace(-0.01, shaped.duration + 0.01, 4001)
    state = shaped.at(t)
    wanted = convolve(plan.trajectory, machine.axes, t)
    assert np.allclose(state.q, wanted, rtol=0, atol=1e-15)
    assert np.allclose(shaped.positions_at(t), wanted, rtol=0, atol=1e-15)
    assert not state.qd[(t < 0) | (t > shaped.duration)].any()
    # rates against finite differences, inside the intervals between knots
    middle = (shaped.knots[:-1] + shaped.knots[1:]) / 2
    wide = np.diff(shaped.knots) > 2e-4
    middle = middle[wide]
    here, h = shaped.at(middle), 5e-5
    before, after = (convolve(plan.trajectory, machine.axes, middle + sign * h) for sign in (-1, 1))
    assert np.allclose((after - before) / (2 * h), here.qd, rtol=0, atol=1e-7)
    assert np.allclose((after - 2 * here.q + before) / h**2, here.qdd, rtol=0, atol=2e-5)


def test_the_checker_works_out_the_same_motion(bare):
    plan = bare[2]
    shaped = shape_motion(plan.trajectory, give(plan.machine, *SHAPERS).axes)
    other = rebuild_motion(shaped)
    assert type(other) is not type(shaped)
    assert np.array_equal(np.unique(np.append(other.knots, 0.0))[-1:], shaped.knots[-1:])
    # at knots, one after and one before them: the sides of jumps of q̈ are told alike
    t = np.concatenate([shaped.knots[:-1], np.nextafter(shaped.knots[1:], 0)])
    one, two = shaped.at(t), other.at(t)
    scale = np.abs(one.qdd).max()
    for name, tolerance in (("q", 1e-15), ("qd", 1e-13), ("qdd", 1e-10 * scale)):
        assert np.allclose(getattr(one, name), getattr(two, name), rtol=0, atol=tolerance), name
    single = other.axis_at(t, 3)
    assert np.allclose(single.q[:, 0], two.q[:, 3], rtol=0, atol=1e-15)


@pytest.mark.parametrize("order", [2, 3])
def test_pulses_are_those_of_the_shaped_motion(bare, order):
    plan = bare[order]
    machine = give(plan.machine, Shaper("zv", 20.0, 0.1), Shaper("ei", 35.0))
    pulses = generate(plan.trajectory, machine.axes, machine.home_q)
    shaped = shape_motion(plan.trajectory, machine.axes)
    assert pulses.duration == pytest.approx(shaped.duration)
    assert check(pulses, shaped, machine.axes, machine.home_q).holds
    assert not check(pulses, plan.trajectory, machine.axes, machine.home_q).holds
    other = shape_motion(
        plan.trajectory, give(plan.machine, Shaper("zv", 20.1, 0.1), Shaper("ei", 35.0)).axes
    )
    assert not check(pulses, other, machine.axes, machine.home_q).holds
    # the counts follow a direct convolution to half a pulse and one tick's travel
    t = np.linspace(0, shaped.duration, 2001)
    off = (
        pulses.counts(t)
        - (convolve(plan.trajectory, machine.axes, t) - machine.home_q) / machine.axes[0].pulse
    )
    assert np.abs(off).max() <= 0.5 + 0.02


def test_axes_that_compensate_are_shaped_first():
    machine = load_machine("traverser")
    axes = [
        replace(
            axis,
            shaper=Shaper("zv", 10.0, 0.05),
            compensate=("lead", "backlash") if axis.lead_error else (),
        )
        for axis in machine.axes
    ]
    from planner import plan

    made = plan(load_program("traverser-scan"), machine.driven_by(axes))
    assert made.shaped.holds
    assert check(made.pulses, made.counted, made.machine.axes, machine.home_q).holds
