"""Circles whose radius, centre and form are known."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from controllers.drives.servo import leg_servo
from controllers.laws.open_loop import OpenPosition
from controllers.metrics import Circle, circular_test, evaluate_runs
from controllers.metrics.circular_test import full_turn
from controllers.rig import Task, assumed_rig
from controllers.simulate import sample, simulate
from kinematics import MotionError

TILT = Rotation.from_rotvec([0.3, -0.5, 0.2])
CENTRE = np.array([0.1, -0.2, 0.35])
CIRCLE = Circle(CENTRE, TILT.apply([0, 0, 1]), 50e-3, 30e-3)
PULSE = 0.75e-6
ROUNDING = 1e-15
TURN = np.linspace(0, 2 * np.pi, 721)


def turn(radius, sense=1, offset=(0.0, 0.0), start=0.4):
    """Points of a full turn in the circle's plane: radius(φ) about a centre that is off by `offset`
    there.
    """
    angle = start + sense * TURN
    r = radius(angle) if callable(radius) else radius
    flat = np.stack([offset[0] + r * np.cos(angle), offset[1] + r * np.sin(angle), 0 * angle], 1)
    return CENTRE + TILT.apply(flat)


def both(radius, **more):
    return circular_test(turn(radius, 1, **more), turn(radius, -1, **more), CIRCLE)


def test_a_perfect_circle_deviates_by_nothing():
    for value in both(50e-3).figures().values():
        assert abs(value) < ROUNDING


def test_a_shrunken_circle_is_round():
    found = both(50e-3 - 12e-6)
    assert found.mean_radial == pytest.approx(-12e-6, abs=ROUNDING)
    assert found.ccw.radial_max == pytest.approx(-12e-6, abs=ROUNDING)
    assert max(found.ccw.circular, found.cw.circular, found.both) < 2 * ROUNDING


def test_an_offset_circle_is_round_but_radially_off():
    """F = ±e about the programmed centre, to e²/2R; G = 0 about its own, which is found, to the
    interpolation of r between points half a degree apart: e (0.5°)²/8.
    """
    found = both(50e-3, offset=(30e-6, -40e-6))
    between = 50e-6 * np.deg2rad(0.5) ** 2 / 8
    assert found.ccw.circular < between
    assert np.linalg.norm(found.cw.centre) == pytest.approx(50e-6, abs=between)
    assert found.ccw.radial_max == pytest.approx(
        50e-6, abs=(50e-6) ** 2 / 100e-3 + 50e-6 * (np.pi / 720) ** 2
    )
    assert found.ccw.radial_min == pytest.approx(
        -50e-6, abs=(50e-6) ** 2 / 100e-3 + 50e-6 * (np.pi / 720) ** 2
    )


def test_an_oval_deviates_by_twice_its_amplitude():
    """r = R + a cos 2φ: G = 2a, the samples hit the extremes to a (1°)²/2; D = 0 but for the point
    counted twice.
    """
    a = 8e-6
    found = both(lambda angle: 50e-3 + a * np.cos(2 * angle))
    coarse = a * np.deg2rad(1) ** 2
    for direction in (found.ccw, found.cw):
        assert direction.circular == pytest.approx(2 * a, abs=coarse + 2 * a / 700)
        assert direction.radial_max == pytest.approx(a, abs=coarse)
        assert direction.radial_min == pytest.approx(-a, abs=coarse)
    assert abs(found.mean_radial) < a / 700


def test_two_directions_of_two_radii():
    """As with play: each direction is round, together they are apart by the difference; D is the
    mean.
    """
    found = circular_test(turn(50e-3 + 5e-6, 1), turn(50e-3 - 9e-6, -1), CIRCLE)
    assert max(found.ccw.circular, found.cw.circular) < 2 * ROUNDING
    assert found.both == pytest.approx(14e-6, abs=14e-6 / 700)
    assert found.mean_radial == pytest.approx(-2e-6, abs=ROUNDING)


@pytest.mark.parametrize("omega", [0.5, 3.0, 20.0])
def test_equal_lags_change_the_radius_and_nothing_else(omega):
    """x and y behind equal first-order lags T, in steady state: D = R (1/√(1 + (ωT)²) − 1) and G =
    0.
    """
    lag, radius = 1 / 30, 50e-3
    response = radius / (1 + 1j * omega * lag)
    turns = []
    for sense in (1, -1):
        # the slower the lag turns the point, the later it comes to the same place: a full turn it
        # is all the same
        z = response * np.exp(1j * TURN)
        turns.append(CENTRE + TILT.apply(np.stack([z.real, sense * z.imag, 0 * TURN], 1)))
    found = circular_test(*turns, CIRCLE)
    change = radius * (1 / np.sqrt(1 + (omega * lag) ** 2) - 1)
    assert found.mean_radial == pytest.approx(change, abs=2 * ROUNDING)
    assert max(found.ccw.circular, found.cw.circular, found.both) < 3 * ROUNDING
    assert found.ccw.radial_max == pytest.approx(change, abs=2 * ROUNDING)


def test_the_least_squares_centre_is_stationary():
    """At the minimum of Σ(‖p − c‖ − ρ)² its gradient by c and ρ vanishes: an independent check of
    the fit.
    """
    random = np.random.default_rng(3)
    points = turn(lambda angle: 50e-3 + 1e-6 * random.normal(size=len(angle)), offset=(2e-6, 1e-6))
    found = circular_test(points, points[::-1], CIRCLE).ccw
    flat = (
        np.stack([np.cos(found.angle), np.sin(found.angle)], 1) * (50e-3 + found.deviation)[:, None]
    )
    away = flat - found.centre
    r = np.linalg.norm(away, axis=1)
    misfit = r - found.radius
    gradient = [*(misfit[:, None] * away / r[:, None]).mean(0), misfit.mean()]
    assert np.abs(gradient).max() < 1e-13


def test_what_is_no_full_turn_is_refused():
    with pytest.raises(MotionError, match=r"clockwise record turns by 270°.*full turn"):
        circular_test(turn(50e-3), turn(50e-3, -1)[:541], CIRCLE)
    with pytest.raises(MotionError, match=r"counter-clockwise record turns by 0°"):
        circular_test(turn(50e-3, -1), turn(50e-3, 1), CIRCLE)
    with pytest.raises(MotionError, match="radius 0"):
        Circle(CENTRE, [0, 0, 1], 0.0, 1.0)


def test_figure_says_how_much_it_magnifies():
    ax = both(lambda angle: 50e-3 + 8e-6 * np.cos(2 * angle)).plot()
    assert "× 1000" in ax.get_title(), "8 µm on a quarter of 50 mm: 1562, rounded down to 1, 2 or 5"


def test_a_record_is_resampled_by_angle():
    """A lap and a half that starts slowly, shakes and rests: what counts is the first turn,
    evenly.
    """
    u = np.concatenate([np.linspace(0, 1, 4000) ** 2 * 3 * np.pi, np.full(1000, 3 * np.pi)])
    shaking = u + 1e-3 * np.sin(40 * u)
    for sense in (1, -1):
        angle = 0.4 + sense * shaking
        r = 50e-3 + 8e-6 * np.cos(2 * angle)
        flat = np.stack([r * np.cos(angle), r * np.sin(angle), 0 * r], 1)
        record = CENTRE + TILT.apply(flat)
        found = full_turn(record, CIRCLE, sense)
        assert len(found) == 720
        # the plane's own axes are turned against those of the tilt by what the first point tells
        turned = 0.4 - np.arctan2(found[0, 1], found[0, 0])
        where = np.arctan2(found[:, 1], found[:, 0]) + turned
        # linear between samples 5 mrad apart: 4 a (5e-3)²/8
        np.testing.assert_allclose(
            np.linalg.norm(found, axis=1) - 50e-3, 8e-6 * np.cos(2 * where), atol=1.5e-10
        )
        np.testing.assert_allclose(np.diff(np.unwrap(where)), sense * 2 * np.pi / 720, rtol=1e-9)


@dataclass(frozen=True)
class Round:
    """Axes x and y on two turns of a circle, at full speed from the start."""

    centre: np.ndarray
    omega: float
    knots = np.array([0.0, 4.0])
    duration = 4.0

    def at(self, t):
        a = self.omega * np.clip(t, 0, self.duration)
        flat = 15e-3 * np.stack([np.cos(a), np.sin(a), 0 * a], -1)
        speed = 15e-3 * self.omega * np.stack([-np.sin(a), np.cos(a), 0 * a], -1)
        return SimpleNamespace(q=self.centre + flat, qd=speed)


def test_the_rig_shrinks_a_circle_by_the_gain_of_its_loops(rig):
    """Two equal servos behind the card: D = R (|G(jω)| − 1), with the loop's table G = K ωs (s +
    1/T)/(s³ + (ωs + b) s² + (ωs/T) s + K ωs (s + 1/T)), b = 5 1/s, to a pulse of card and encoder;
    G, the circular deviation, is pulses: play, friction and unequal loops are not there.
    """
    omega, turns = np.pi, []
    servo = leg_servo(rig.axes[0])
    for sense in (1, -1):
        motion = Round(rig.home_q, sense * omega)
        runs = simulate(sample(motion, rig, 5e-3), OpenPosition(), [assumed_rig(rig)], settle=0.0)
        found = evaluate_runs(runs, Task("circle", motion, 5e-3), [assumed_rig(rig)], period=1e-3)[
            0
        ]
        # a turn to forget the start, and the next one
        turns.append(found.attained[found.t > 1.5])
    s, ws, integral = 1j * omega, 2 * np.pi * servo.speed_loop, 1 / servo.integral_time
    loop = servo.position_gain * ws * (s + integral)
    gain = abs(loop / (s**3 + (ws + servo.friction) * s**2 + ws * integral * s + loop))
    test = circular_test(*turns, Circle(rig.home_q, [0, 0, 1], 15e-3, 15e-3 * omega))
    assert test.mean_radial == pytest.approx(15e-3 * (gain - 1), abs=0.5 * PULSE)
    assert max(test.ccw.circular, test.cw.circular) < 3 * PULSE
    assert abs(test.mean_radial) > 20 * PULSE
