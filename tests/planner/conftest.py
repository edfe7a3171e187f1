"""What the tests of planning share: the hexapod, its plans (each made once), and its legs
recomputed without it.
"""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import RigidTransform

from kinematics import Axis, Body, Load, Traverser, load_machine
from kinematics.machine.load import GRAVITY
from planner import load_program, plan
from planner.pulses import generate
from tests.planner.motions import PULSE, example


@pytest.fixture(scope="session")
def laden():
    """The bundled hexapod with its masses, whose forces are proved as well."""
    return load_machine("hexapod")


@pytest.fixture(scope="session")
def hexapod(laden):
    """The bundled hexapod without its masses: no proof bounds a force, which takes as long as all
    else in it.
    """
    return laden.carrying(Load())


@pytest.fixture(scope="session")
def planned(hexapod):
    """(program's name, order) -> its plan on the hexapod."""

    @cache
    def make(name, order):
        return plan(load_program(name), hexapod, order=order)

    return make


@pytest.fixture(scope="session")
def own_legs():
    """(positions (N, 3), rotation matrices (N, 3, 3)) -> leg vectors (N, 6, 3), by the numbers of
    [Sahbaz 2007, 5].
    """

    def circle(radius, gap, height):
        azimuth = np.deg2rad(
            [gap / 2, 120 - gap / 2, 120 + gap / 2, 240 - gap / 2, 240 + gap / 2, -gap / 2]
        )
        return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), np.full(6, height)], 1)

    base, platform = circle(0.149, 30, 0.0115), circle(0.1, 60, -0.011)

    def legs(position, rotation):
        return position[:, None] + np.einsum("nij,kj->nki", rotation, platform) - base

    return legs


@pytest.fixture(scope="session")
def own_lengths(own_legs):
    """(positions (N, 3), rotation matrices (N, 3, 3)) -> leg lengths (N, 6)."""
    return lambda position, rotation: np.linalg.norm(own_legs(position, rotation), axis=2)


@pytest.fixture(scope="session")
def rodrigues():
    """(vector (3,), angles (N,)) -> the rotations (N, 3, 3) by these angles about the vector."""

    def matrices(vector, angles):
        x, y, z = np.asarray(vector, float) / np.linalg.norm(vector)
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        angles = np.asarray(angles, float)[:, None, None]
        return np.eye(3) + np.sin(angles) * cross + (1 - np.cos(angles)) * (cross @ cross)

    return matrices


@pytest.fixture(scope="session")
def three_legs():
    """A random motion of three legs, every second one wired the other way, and its pulses, as a
    plan has them.
    """
    motion = example(3)
    return count_three_legs(motion)


@pytest.fixture(scope="session")
def three_short_legs():
    """The same in a tenth of the way and of the time."""
    return count_three_legs(example(3, 0.1))


def count_three_legs(motion):
    home = motion.at(np.zeros(1)).q[0]
    axes = [Axis(f"leg{k}", pulse=PULSE, direction=1 - 2 * (k % 2)) for k in range(3)]
    machine = SimpleNamespace(axes=axes, home_q=home)
    return SimpleNamespace(machine=machine, counted=motion, pulses=generate(motion, axes, home))


@pytest.fixture(scope="session")
def seven_segments():
    """(length, speed, acceleration, jerk) -> least rest-to-rest time, by which limits the motion
    reaches.
    """

    def time(length, speed, acceleration, jerk):
        a = min(acceleration, np.sqrt(speed * jerk))  # reached on the way to V
        if length >= speed * (speed / a + a / jerk):
            return length / speed + speed / a + a / jerk  # V is reached
        a = acceleration
        top = (
            np.sqrt(a**4 / jerk**2 + 4 * a * length) - a**2 / jerk
        ) / 2  # of a motion that reaches A but not V
        if top >= a**2 / jerk:
            return 2 * (top / a + a / jerk)
        return 4 * np.cbrt(length / (2 * jerk))  # neither

    return time


@pytest.fixture(scope="session")
def slide():
    """(mass, **what the axis states) -> a machine whose upright slide Z alone has masses and limits
    that bind.
    """

    def make(mass, **own):
        free = {"max_speed": 1e3, "max_acceleration": 1e5, "max_jerk": 1e9}
        axes = [Axis("X", **free), Axis("Y", **free), Axis("Z", **own), Axis("R", "rotary", **free)]
        return Traverser(
            axes=axes, home=RigidTransform.identity(), load=Load(Body(mass), gravity=GRAVITY)
        )

    return make


@pytest.fixture(scope="session")
def bang_bang():
    """(length, v̇ up, v̇ down, top speed) -> the least time from rest to rest on one axis, by
    quadrature.

    As fast as possible up and down again, ds = v dv/v̇ and dt = dv/v̇; a step of 1/200 000 of the
    top speed.
    """

    def time(length, up, down, top):
        v = np.linspace(0, top, 200_001)
        s, t = (
            [cumulative_trapezoid(weight / rate(v), v, initial=0) for rate in (up, down)]
            for weight in (v, np.ones_like(v))
        )
        if s[0][-1] + s[1][-1] < length:
            return t[0][-1] + t[1][-1] + (length - s[0][-1] - s[1][-1]) / top
        return np.interp(length, s[0] + s[1], t[0] + t[1])

    return time
