"""Motions that the tests of pulses are made from: piecewise polynomials, certain and random."""

from types import SimpleNamespace

import numpy as np
from hypothesis import strategies as st
from scipy.interpolate import PPoly

PULSE = 0.75e-6


class Polynomials:
    """A motion of piecewise polynomials, coefficients (degree+1, pieces, axes); counts how often it
    is asked.
    """

    def __init__(self, coefficients, knots):
        self.knots = np.asarray(knots, float)
        self.duration = float(self.knots[-1])
        kept = np.diff(self.knots) > 0  # PPoly takes no empty pieces; a motion may have them
        breaks = np.append(self.knots[:-1][kept], self.knots[-1])
        curve = PPoly(np.asarray(coefficients, float)[:, kept], breaks)
        self.curves = [curve, *(curve.derivative(order) for order in (1, 2, 3))]
        self.asked = 0

    def at(self, t):
        t = np.atleast_1d(t)
        self.asked += len(t)
        q, qd, qdd, qddd = (curve(t) for curve in self.curves)
        return SimpleNamespace(s=t, t=t, q=q, qd=qd, qdd=qdd, qddd=qddd)


def one_axis(pieces, knots):
    return Polynomials(np.array(pieces, float).T[:, :, None], knots)


def through(q, v, knots):
    """The cubic Hermite motion through positions and speeds (M+1, axes) at the knots."""
    q, v, h = np.asarray(q, float), np.asarray(v, float), np.diff(knots)[:, None]
    r, s = q[1:] - q[:-1] - v[:-1] * h, v[1:] - v[:-1]
    return Polynomials(
        np.stack(((s * h - 2 * r) / h**3, (3 * r - s * h) / h**2, v[:-1], q[:-1])), knots
    )


def example(seed=0, size=1.0):
    """Three axes, three moves with a dwell of 20 ms between them, some 1500 pulses; every axis
    turns inside a move.

    size: of the ways and the times, at the same speeds.
    """
    rng = np.random.default_rng(seed)
    knots = size * np.cumsum([0, 0.05, 0.06, 0.02, 0.07])
    zigzag = np.array([0, 1, -1, -1, 1])[:, None] * rng.choice([-1, 1], 3)
    q = 0.2 + size * zigzag * rng.uniform(0.1e-3, 0.25e-3, (5, 3))
    q[3] = q[2]
    v = np.zeros((5, 3))
    v[1] = rng.uniform(-8e-3, 8e-3, 3)
    return through(q, v, knots)


def in_pulses(*pieces):
    """Pieces of one axis in pulses, each [highest power, …, constant], one second each; home is
    0.
    """
    return one_axis(np.array(pieces) * PULSE, np.arange(len(pieces) + 1)), [0.0]


@st.composite
def smooth_motions(draw, spans=(1e-4, 1e-3, 0.01, 0.013, 0.1), most=5):
    """Random C1 motions of two axes through random places, many of them levels, at random speeds,
    with dwells.
    """
    pieces = draw(st.integers(1, most))
    spans = draw(st.lists(st.sampled_from(spans), min_size=pieces, max_size=pieces))
    halves = st.integers(-60, 60).map(lambda n: n / 2 * PULSE)
    place = st.one_of(halves, st.floats(-60 * PULSE, 60 * PULSE))
    speed = st.sampled_from([0.0, 0.0, 1e-3, -1e-3, 0.02, -0.013])
    states = np.array(
        draw(
            st.lists(
                st.tuples(place, place, speed, speed), min_size=pieces + 1, max_size=pieces + 1
            )
        )
    )
    q, v = states[:, :2], states[:, 2:]
    for k in range(pieces):
        if draw(st.booleans()) and draw(st.booleans()):
            q[k + 1], v[k], v[k + 1] = q[k], 0.0, 0.0
    return through(q, v, np.concatenate(([0.0], np.cumsum(spans))))
