"""Inertia with friction against analytic motions and an integration by events."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from controllers.drives.axes import advance, apply_play, rotor


def after(h, x, v, torque, *, inertia=1.0, friction=0.0, coulomb=0.0, parts=1):
    """x and v after h, in so many equal steps."""
    model = rotor(*(np.full((1, 1), of) for of in (inertia, friction, coulomb)), h / parts)
    for _ in range(parts):
        x, v = advance(model.h, model.lanes[:, 0, 0], x, v, torque)
    return x, v


def test_coasting_stops_after_its_energy_is_spent():
    """v²J/2 = c x, and then it stays."""
    x, v = after(20.0, 0.0, 3.0, 0.0, inertia=2.0, coulomb=0.5)
    assert v == 0
    assert x == pytest.approx(2.0 * 3.0**2 / 2 / 0.5, rel=1e-14)


def test_coasting_stops_in_its_time_with_viscous_friction():
    """t = J/b log(1 + b v/c): just before it moves, just after it stands, at J/b (v − c t/J)."""
    J, b, c, v0 = 2.0, 0.7, 0.5, 3.0
    t = J / b * np.log1p(b * v0 / c)
    way = J / b * (v0 - c * t / J)
    before, moving = after(t * (1 - 1e-6), 0.0, v0, 0.0, inertia=J, friction=b, coulomb=c)
    x, v = after(t * (1 + 1e-6), 0.0, v0, 0.0, inertia=J, friction=b, coulomb=c)
    assert moving > 0
    assert v == 0
    assert before == pytest.approx(way, rel=1e-9)
    assert x == pytest.approx(way, rel=1e-12)


@pytest.mark.parametrize("torque", [0.5, -0.5, 0.499, 0.0])
def test_a_torque_up_to_the_friction_moves_nothing(torque):
    x, v = after(1.0, 0.25, 0.0, torque, coulomb=0.5)
    assert (x, v) == (0.25, 0.0)


@pytest.mark.parametrize("sign", [1, -1])
def test_breakaway_is_by_what_exceeds_the_friction(sign):
    x, v = after(0.3, 0.0, 0.0, sign * 0.9, inertia=2.0, coulomb=0.5)
    assert v == pytest.approx(sign * 0.2 * 0.3, rel=1e-14)
    assert x == pytest.approx(sign * 0.2 * 0.3**2 / 2, rel=1e-14)


LANES = st.fixed_dictionaries(
    {
        # the integration's search for a standstill fails where it begins some 1e-9 before one
        "v": st.floats(-2, 2).map(lambda v: round(v, 6)),
        "torque": st.floats(-3, 3),
        "inertia": st.floats(0.1, 5),
        "friction": st.floats(0, 4),
        "coulomb": st.floats(0, 2),
    }
)


@given(LANES, st.floats(0.01, 2.0), st.integers(2, 7))
def test_a_time_in_parts_is_the_time_as_a_whole(lane, h, parts):
    """The flow is exact, so it is one: also across a stop."""
    v, torque = lane.pop("v"), lane.pop("torque")
    whole, in_parts = (after(h, 0.0, v, torque, parts=n, **lane) for n in (1, parts))
    # rounding, of terms of ten; what hardly moves is lost against torques of order one
    np.testing.assert_allclose(whole, in_parts, atol=1e-11)


@given(LANES)
def test_it_is_the_differential_equation(lane):
    """Against an integration that stops at v = 0 and asks there whether it moves on."""
    h, v0, torque = 0.7, lane["v"], lane["torque"]
    J, b, c = lane["inertia"], lane["friction"], lane["coulomb"]

    def stop(t, y):
        return y[1]

    stop.terminal = True
    t, y = 0.0, np.array([0.0, v0])
    while t < h:
        way = np.sign(y[1]) or (np.sign(torque) if abs(torque) > c else 0.0)
        if not way:
            break
        stop.direction = -way
        done = solve_ivp(
            lambda _, y, way=way: [y[1], (torque - b * y[1] - c * way) / J],
            (t, h), y, events=stop if y[1] else None, rtol=1e-10, atol=1e-12,
        )  # fmt: skip
        t, y = done.t[-1], done.y[:, -1]
        if done.status == 1:
            y[1] = 0.0
    x, v = after(h, 0.0, v0, torque, inertia=J, friction=b, coulomb=c)
    # what the integration is asked for, over its steps
    np.testing.assert_allclose([x, v], y, atol=1e-7)


def test_the_output_loses_the_play_at_every_reversal():
    y, lost = 0.0, 0.3
    seen = []
    for x in [0.0, 1.0, 0.8, 0.5, 0.71, 2.0]:
        y = apply_play(y, x, lost / 2)
        seen.append(y)
    np.testing.assert_allclose(seen, [0.0, 0.85, 0.85, 0.65, 0.65, 1.85], atol=1e-15)
