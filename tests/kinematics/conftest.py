"""The machines that every test of the kinematics runs on, and poses to put them in."""

import numpy as np
import pytest
from numpy.polynomial import chebyshev
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks.evidence.published.conformance import PUBLISHED, published_hexapod, table_4_3
from kinematics import Axis, Hexapod, Load, joint_circle, load_machine, motion_of_poses
from kinematics.files.toml_document import read
from kinematics.machine.kind import columns
from kinematics.machine.pose import COMPONENTS, from_numbers, to_numbers


def hexapod(base, platform, home, **options):
    return Hexapod(
        base, platform, axes=[Axis(f"leg{n}") for n in range(1, 7)], home=home, **options
    )


def irregular(seed):
    """Joints off every plane and circle, frames anywhere, a rest axis of its own for every
    joint.
    """
    random = np.random.default_rng(seed)
    base = joint_circle(0.3, 0.5, 0) + random.uniform(-0.05, 0.05, (6, 3))
    platform = joint_circle(0.15, 1.0, 0) + random.uniform(-0.03, 0.03, (6, 3))
    home = RigidTransform.from_components(
        [0.02, -0.03, 0.35], Rotation.from_rotvec(random.uniform(-0.15, 0.15, 3))
    )
    below, above = (
        RigidTransform.from_components(random.uniform(-0.1, 0.1, 3), Rotation.random(rng=random))
        for _ in range(2)
    )
    legs = home.apply(platform) - base
    base_rest = below.rotation.apply(legs + random.uniform(-0.05, 0.05, (6, 3)))
    platform_rest = (above.rotation * home.rotation.inv()).apply(
        legs + random.uniform(-0.05, 0.05, (6, 3))
    )
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
    "mini tetra": lambda: published_hexapod("mini_tetra"),
    "rubin": lambda: published_hexapod("rubin_simulink"),
    "irregular": lambda: irregular(1),
}
# Machines with singularities a way off home that every pose has lengths for, however far away it
# is.
LEGGED = HEXAPODS | {"tripod": lambda: load_machine("tripod")}
# Machines with lengths that close in no pose.
PARALLEL = LEGGED | {"linkage": lambda: load_machine("linkage")}
ZOO = PARALLEL | {
    "traverser": lambda: load_machine("traverser"),
    "arm": lambda: pytest.importorskip("pinocchio") and load_machine("arm"),
}


@pytest.fixture(scope="session", params=ZOO)
def machine(request):
    return ZOO[request.param]()


@pytest.fixture(scope="session")
def zoo_names():
    return {make().name for make in ZOO.values()}


@pytest.fixture(scope="session", params=LEGGED)
def legged(request):
    return LEGGED[request.param]()


@pytest.fixture(scope="session", params=PARALLEL)
def parallel(request):
    return PARALLEL[request.param]()


@pytest.fixture(scope="session", params=HEXAPODS)
def any_hexapod(request):
    return HEXAPODS[request.param]()


@pytest.fixture(scope="session")
def preset():
    """The bundled hexapod without its masses: what moves it is each test's own."""
    return load_machine("hexapod").carrying(Load())


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
        return max(
            np.linalg.norm(apart.translation, axis=-1).max(), np.max(apart.rotation.magnitude())
        )

    return largest


# m that poses of share 1 lie from home in each direction, where that is not the machine's size.
ROOM = {"arm": 0.25, "tripod": 0.2, "linkage": 0.15}


@pytest.fixture(scope="session")
def room():
    """machine -> how far (m) share 1 leads."""
    return lambda machine: ROOM.get(machine.name, machine.characteristic_length)


@pytest.fixture(scope="session")
def poses_about(room):
    """(pose, machine, count, share, seed) -> poses shifted by up to `share` of the machine's size,
    turned by rad.

    Only in what the machine controls; what follows goes along. share: one for both, or (shift,
    turn).
    """

    def make(pose, machine, count, share, seed=0):
        free = np.isin(COMPONENTS, machine.freedom).reshape(2, 1, 3)
        size = np.reshape(share * np.array([room(machine), 1.0]), (2, 1, 1))
        shift, turn = free * size * np.random.default_rng(seed).uniform(-1, 1, (2, count, 3))
        poses = RigidTransform.from_components(
            pose.translation + shift, Rotation.from_rotvec(turn) * pose.rotation
        )
        if not machine.follows:
            return poses
        return from_numbers(machine.carried_map(machine.inputs(to_numbers(poses), machine.home_q)))

    return make


class Spectrum:
    """Motions known at Chebyshev nodes of [0, 0.8 s], where what is smooth is differentiated to
    nearly rounding.
    """

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
        """Kinetic and potential energy of a body whose frame is at place (nodes, 3), rotation
        (nodes, 3, 3).
        """
        centre = place + rotation @ body.centre
        spin = np.einsum("nji,nj->ni", rotation, self.turning(rotation))
        kinetic = (
            body.mass * (self.rate(centre) ** 2).sum(1)
            + np.einsum("ni,ij,nj->n", spin, body.inertia, spin)
        ) / 2
        return kinetic + body.mass * self.gravity * centre[:, 2]

    def smooth(self, machine, shift, turn, seed=0):
        """A motion by up to shift (m) and turn (rad) about home in all that the machine
        controls.
        """
        random, off = np.random.default_rng(seed), np.zeros((self.nodes, 6))
        phase, pace = (
            random.uniform(0, 6, len(machine.freedom)),
            random.uniform(2, 5, len(machine.freedom)),
        )
        sizes = np.array([shift] * 3 + [turn] * 3)[columns(machine)]
        off[:, columns(machine)] = sizes * np.sin(phase + pace * self.t[:, None])
        turned = Rotation.from_rotvec(off[:, 3:])
        pose = RigidTransform.from_components(
            machine.home.translation + off[:, :3], turned * machine.home.rotation
        )
        twist = np.concatenate([self.rate(off[:, :3]), self.turning(turned.as_matrix())], 1)
        acceleration = self.rate(twist)
        held = [k for k in range(6) if k not in columns(machine)]
        twist[:, held] = acceleration[:, held] = 0.0  # but for rounding they are
        return motion_of_poses(machine, pose, twist, acceleration)


@pytest.fixture(scope="session")
def spectrum():
    return Spectrum()


@pytest.fixture(scope="session")
def scaled_jacobian():
    """(machine, poses) -> (N, n, n) or (n, n) of what it controls, rotations at its characteristic
    length.
    """

    def scaled(machine, poses):
        jacobian = machine.jacobian(poses) * np.repeat([1.0, 1 / machine.characteristic_length], 3)
        return jacobian[..., columns(machine)]

    return scaled
