"""The machines that every test of the kinematics runs on, and poses to put them in."""

import numpy as np
import pytest
from numpy.polynomial import chebyshev
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks.conformance import PUBLISHED, mini_tetra, rubin
from benchmarks.sahbaz_geometry import table_4_3
from kinematics import Axis, Hexapod, load_machine
from kinematics.document import read
from kinematics.freedom import columns
from kinematics.hexapod import joint_circle
from kinematics.motion import motion_of_poses


def hexapod(base, platform, home, **options):
    return Hexapod(base, platform, axes=[Axis(f"leg{n}") for n in range(1, 7)], home=home, **options)


def irregular(seed):
    """Joints off every plane and circle, frames anywhere, a rest axis of its own for every joint."""
    random = np.random.default_rng(seed)
    base = joint_circle(0.3, 0.5, 0) + random.uniform(-0.05, 0.05, (6, 3))
    platform = joint_circle(0.15, 1.0, 0) + random.uniform(-0.03, 0.03, (6, 3))
    home = RigidTransform.from_components([0.02, -0.03, 0.35], Rotation.from_rotvec(random.uniform(-0.15, 0.15, 3)))
    below, above = (
        RigidTransform.from_components(random.uniform(-0.1, 0.1, 3), Rotation.random(rng=random)) for _ in range(2)
    )
    legs = home.apply(platform) - base
    base_rest = below.rotation.apply(legs + random.uniform(-0.05, 0.05, (6, 3)))
    platform_rest = (above.rotation * home.rotation.inv()).apply(legs + random.uniform(-0.05, 0.05, (6, 3)))
    return hexapod(
        below.apply(base),
        above.apply(platform),
        below * home * above.inv(),
        base_rest=base_rest,
        platform_rest=platform_rest,
        max_tilt=(0.6, 0.7),
    )


HEXAPODS = {
    "preset": lambda: load_machine("hexapod"),
    "initial": lambda: load_machine("hexapod-initial"),
    "table 4.3": table_4_3,
    "mini tetra": mini_tetra,
    "rubin": rubin,
    "irregular 1": lambda: irregular(1),
    "irregular 2": lambda: irregular(2),
}
ZOO = HEXAPODS | {}  # machines of six freedoms of other kinds, one line each


@pytest.fixture(scope="session", params=ZOO)
def machine(request):
    return ZOO[request.param]()


@pytest.fixture(scope="session", params=HEXAPODS)
def any_hexapod(request):
    return HEXAPODS[request.param]()


@pytest.fixture(scope="session")
def preset():
    return load_machine("hexapod")


@pytest.fixture
def document(tmp_path):
    """Text (str or bytes) -> the document in a file that holds it."""

    def made(text):
        path = tmp_path / "file.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read(path)

    return made


@pytest.fixture(scope="session")
def published():
    """Numbers that others published, by name."""
    return PUBLISHED


@pytest.fixture(scope="session")
def distance():
    """(found, expected) poses -> the largest error of a position (m) or a rotation (rad)."""

    def largest(found, expected):
        apart = found.inv() * expected
        return max(np.linalg.norm(apart.translation, axis=-1).max(), np.max(apart.rotation.magnitude()))

    return largest


@pytest.fixture(scope="session")
def poses_about():
    """(pose, machine, count, share, seed) -> poses shifted and turned by up to `share` of the machine's size."""

    def make(pose, machine, count, share, seed=0):
        random = np.random.default_rng(seed)
        shift, turn = share * random.uniform(-1, 1, (2, count, 3))
        return RigidTransform.from_components(
            pose.translation + machine.characteristic_length * shift, Rotation.from_rotvec(turn) * pose.rotation
        )

    return make


class Spectrum:
    """Motions known at Chebyshev nodes of [0, 0.8 s], where what is smooth is differentiated to nearly rounding."""

    nodes, duration, gravity = 36, 0.8, 9.80665
    points = chebyshev.chebpts1(nodes)
    t = duration / 2 * (1 + points)

    def rate(self, values):
        """d/dt at the nodes of values (nodes, ...)."""
        fitted = chebyshev.chebfit(self.points, values.reshape(self.nodes, -1), self.nodes - 1)
        slopes = chebyshev.chebval(self.points, chebyshev.chebder(fitted)).T
        return (2 / self.duration * slopes).reshape(values.shape)

    def turning(self, rotation):
        """ω (nodes, 3) of Ṙ Rᵀ = ω×."""
        spin = self.rate(rotation) @ rotation.swapaxes(1, 2)
        return np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], 1)

    def energy(self, body, place, rotation):
        """Kinetic and potential energy of a body whose frame is at place (nodes, 3), rotation (nodes, 3, 3)."""
        centre = place + rotation @ body.centre
        spin = np.einsum("nji,nj->ni", rotation, self.turning(rotation))
        kinetic = (body.mass * (self.rate(centre) ** 2).sum(1) + np.einsum("ni,ij,nj->n", spin, body.inertia, spin)) / 2
        return kinetic + body.mass * self.gravity * centre[:, 2]

    def smooth(self, machine, shift, turn, seed=0):
        """A motion by up to shift (m) and turn (rad) about home in all that the machine controls."""
        random, off = np.random.default_rng(seed), np.zeros((self.nodes, 6))
        phase, pace = random.uniform(0, 6, len(machine.freedom)), random.uniform(2, 5, len(machine.freedom))
        sizes = np.array([shift] * 3 + [turn] * 3)[columns(machine)]
        off[:, columns(machine)] = sizes * np.sin(phase + pace * self.t[:, None])
        turned = Rotation.from_rotvec(off[:, 3:])
        pose = RigidTransform.from_components(machine.home.translation + off[:, :3], turned * machine.home.rotation)
        twist = np.concatenate([self.rate(off[:, :3]), self.turning(turned.as_matrix())], 1)
        acceleration = self.rate(twist)
        held = [k for k in range(6) if k not in columns(machine)]
        twist[:, held] = acceleration[:, held] = 0.0  # but for rounding they are
        return motion_of_poses(machine, pose, twist, acceleration)


@pytest.fixture(scope="session")
def spectrum():
    return Spectrum()
