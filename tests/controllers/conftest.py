"""Machines and motions that the controllers are tested on."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Axis, Hexapod, joint_circle
from kinematics.machine.pose import to_numbers
from planner import Trajectory
from planner.path.actuation import MachinePath
from planner.path.shape import NO_TURN, arc, line

PULSE = 0.75e-6
HEIGHT = 0.2336362


@dataclass(frozen=True)
class AxisMotion:
    """Axis positions over time without a path: q = home + stroke · shape(t/duration)."""

    home: np.ndarray
    stroke: np.ndarray
    duration: float
    shape: object

    def at(self, t):
        place, speed = self.shape(np.clip(np.asarray(t, float) / self.duration, 0.0, 1.0))
        q = self.home + np.multiply.outer(place, self.stroke)
        return SimpleNamespace(q=q, qd=np.multiply.outer(speed, self.stroke) / self.duration)


def smooth(u):
    """Rest to rest with speed, acceleration and jerk continuous: u⁴(35 − 84u + 70u² − 20u³)."""
    return u**4 * (35 - 84 * u + 70 * u**2 - 20 * u**3), 140 * u**3 * (1 - u) ** 3


def quarter_sine(u, ramp=0.2):
    """The speed is a quarter of a sine up, held, and down again: concave throughout.

    [Sahbaz 2007, Appendix B]
    """
    w = np.pi / 2 / ramp
    top = 1 / (2 / w + 1 - 2 * ramp)
    rising, falling = u < ramp, u > 1 - ramp
    late = u - (1 - ramp)
    speed = np.where(rising, np.sin(w * u), np.where(falling, np.cos(w * late), 1.0))
    level = 1 / w + np.where(falling, 1 - 2 * ramp + np.sin(w * late) / w, u - ramp)
    return np.where(rising, (1 - np.cos(w * u)) / w, level) * top, speed * top


def there_and_back(u):
    """Out and back to the start, at rest at both ends: sin²(πu)."""
    return np.sin(np.pi * u) ** 2, np.pi * np.sin(2 * np.pi * u)


SHAPES = {"smooth": smooth, "quarter-sine": quarter_sine, "there and back": there_and_back}


@pytest.fixture(scope="session")
def rig():
    """Three axes of 0.75 µm per pulse: all that tracking needs to know of a machine."""
    axes = tuple(Axis(name, pulse=PULSE) for name in ("x", "y", "z"))
    return SimpleNamespace(name="rig", axes=axes, home_q=np.array([0.2, -0.1, 0.3]))


@pytest.fixture(scope="session")
def axis_motion(rig):
    """(shape's name, strokes in pulses, duration) -> a motion of the rig."""

    def make(shape, pulses=(20_000, -9_000, 4_321), duration=1.0):
        return AxisMotion(rig.home_q, np.asarray(pulses) * PULSE, duration, SHAPES[shape])

    return make


@pytest.fixture(scope="session")
def hexapod():
    """[Sahbaz 2007, chapter 5]."""
    axes = tuple(Axis(f"leg{i + 1}", pulse=PULSE) for i in range(6))
    base, platform = (
        joint_circle(0.149, np.deg2rad(30), 0.0115),
        joint_circle(0.1, np.deg2rad(60), -0.011),
    )
    return Hexapod(
        base,
        platform,
        axes=axes,
        home=RigidTransform.from_components([0, 0, HEIGHT], Rotation.identity()),
    )


def pose(x, y, z, angles=(0, 0, 0)):
    """mm from home and degrees about the moving axes."""
    position = np.array([x, y, z]) * 1e-3 + [0, 0, HEIGHT]
    return RigidTransform.from_components(
        position, Rotation.from_euler("XYZ", angles, degrees=True)
    )


@pytest.fixture(scope="session")
def circle_trip(hexapod):
    """Up, round a circle of 15 mm, a turn on the spot, a line inwards: a trapezoid of speed on
    each.
    """
    rim, tilted = pose(15, 0, 10), pose(0, 15, 10, (4, -3, 0))
    pieces = [
        line(pose(15, 0, 6), rim, 4e-3, 1),
        arc(
            to_numbers(rim)[0],
            np.array([0, 0, HEIGHT + 10e-3]),
            np.array([0, 0, 1.0]),
            2.5 * np.pi,
            NO_TURN,
            2,
        ),
        line(pose(0, 15, 10), tilted, 7e-3, 3),
        line(tilted, pose(0, 8, 10, (4, -3, 0)), 7e-3, 4),
    ]
    path = MachinePath(hexapod, pieces, np.ones(len(pieces) + 1, bool), np.zeros(len(pieces) + 1))
    return trapezoids(path, speed=20e-3, acceleration=0.2)


def trapezoids(path, speed, acceleration):
    knots, s, v, a, piece = [0.0], [], [], [], []
    for i, (low, high) in enumerate(zip(path.breaks[:-1], path.breaks[1:], strict=True)):
        length = high - low
        ramp = min(speed / acceleration, np.sqrt(length / acceleration))
        way = acceleration * ramp**2 / 2
        cruise = (length - 2 * way) / (acceleration * ramp)
        for seconds, at, start, rate in (
            (ramp, low, 0.0, acceleration),
            (cruise, low + way, acceleration * ramp, 0.0),
            (ramp, high - way, acceleration * ramp, -acceleration),
        ):
            knots.append(knots[-1] + seconds)
            s.append(at), v.append(start), a.append(rate), piece.append(i)
    none = np.zeros(len(s))
    return Trajectory(
        path, np.array(knots), np.array(s), np.array(v), np.array(a), none, np.array(piece)
    )
