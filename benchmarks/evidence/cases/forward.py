"""Forward kinematics of the bundled hexapod: certificates put to the test, and times.

All calls start from home. *Inside the limits*: poses drawn evenly from a box that holds all poses
with travel and tilt within limits, of which these are retained. *Anywhere*: every angle within 60°,
and positions far beyond the reach of the legs. A Jacobian and a Newton iteration of this file's own
test the claim of each certificate: on the straight motion from home to the pose, det J keeps its
sign, and a machine that follows the lengths of this motion in small steps arrives there. None may
be wrong; inside the limits 95 % should be certified.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks.evidence.measuring import time_calls
from benchmarks.evidence.table import Row, Table
from kinematics import Hexapod, Pose, load_machine
from kinematics.analysis.singularity import prove_regular
from kinematics.foundation.arrays import Array

# Half ranges of x and y, range of z from home (m), half ranges of the rotation vector (rad). Of
# 4e6 poses within ±120 mm, −10 to 60 mm and ±60°, those inside the limits reach 93 mm, −1 to 47 mm,
# and 17°, 16°, 47°.
MAX_SHIFT_XY, SHIFT_RANGE_Z, MAX_TURN = 0.105, (-0.003, 0.052), np.deg2rad([19, 19, 55])
# Half ranges of positions (m) and angles (rad) of the other trial.
FAR_POSITION, WIDE_ANGLE = 0.3, np.deg2rad(60)
# m or rad up to which two poses are the same
SAME_POSE_TOLERANCE = 1e-9
INSTANTS = 129
# Steps that a machine follows; the second number where it is lost with the first, near a
# singularity.
STEPS = (200, 4000)
# Poses that are in memory together.
BATCH = 20_000
COUNTS = {
    "poses": "poses",
    "solved": "solved: the lengths of the answer are those asked for",
    "certified": "certified",
    "wrong": "certified, but det J changes its sign, or a machine that follows the lengths ends elsewhere",
    "elsewhere": "certified, but another pose than the lengths were made from",
    "beyond": "of those, the pose they were made from lies beyond a singularity",
    "free": "of those, the straight motion to the pose they were made from is proved regular, too",
}


def sample_within_limits(machine: Hexapod, count: int) -> Pose:
    """Draw poses within travel and tilt limits."""
    random = np.random.default_rng(0)
    poses: list[Array] = []
    size = 10 * min(count, BATCH)
    while len(poses) < count:
        shift = random.uniform(
            [-MAX_SHIFT_XY, -MAX_SHIFT_XY, SHIFT_RANGE_Z[0]],
            [MAX_SHIFT_XY, MAX_SHIFT_XY, SHIFT_RANGE_Z[1]],
            (size, 3),
        )
        turn = Rotation.from_rotvec(random.uniform(-MAX_TURN, MAX_TURN, (size, 3)))
        home = machine.home
        drawn = RigidTransform.from_components(home.translation + shift, turn * home.rotation)
        use = machine.check(drawn)
        poses.extend(drawn[(use.travel.max(1) <= 1) & (use.tilt.max(1) <= 1)].as_matrix())
    return RigidTransform.from_matrix(np.array(poses[:count]))


def sample_anywhere(machine: Hexapod, count: int) -> Pose:
    """Draw poses far from home, every angle about the moving axes in turn within 60°."""
    random = np.random.default_rng(0)
    position = machine.home.translation + random.uniform(-FAR_POSITION, FAR_POSITION, (count, 3))
    turn = Rotation.from_euler("XYZ", random.uniform(-WIDE_ANGLE, WIDE_ANGLE, (count, 3)))
    return RigidTransform.from_components(position, turn * machine.home.rotation)


def try_forward(machine: Hexapod, poses: Pose) -> Counter[str]:
    """Send poses through inverse and forward, and return the numbers of `COUNTS`."""
    answer = machine.forward(machine.inverse(poses))
    proved = np.flatnonzero(answer.certified)
    end, origin = answer.pose[proved], poses[proved]
    wrong = crosses_singularity(machine, end)
    counts = Counter(
        poses=len(poses),
        solved=int((answer.residual < SAME_POSE_TOLERANCE).sum()),
        certified=len(proved),
    )
    lost = others = np.flatnonzero(pose_distance(end, origin) > SAME_POSE_TOLERANCE)
    for steps in STEPS:
        if len(lost):
            arrived = follow_lengths(machine, end[lost], steps)
            lost = lost[~(pose_distance(arrived, end[lost]) <= SAME_POSE_TOLERANCE)]
    wrong[lost] = True
    counts["wrong"] = int(wrong.sum())
    if len(others):
        origin = origin[others]
        home = interpolate_from_home(machine, origin, 0.0)
        counts["elsewhere"] = len(others)
        counts["beyond"] = int(crosses_singularity(machine, origin).sum())
        counts["free"] = int(prove_regular(machine, home, origin).sum())
    return counts


def pose_distance(one: Pose, other: Pose) -> Array:
    """Return the larger of distance (m) and angle (rad) between poses."""
    apart = one.inv() * other
    distance = np.linalg.norm(apart.translation, axis=1)
    return np.asarray(np.maximum(distance, apart.rotation.magnitude()))


def interpolate_from_home(machine: Hexapod, end: Pose, share: float) -> Pose:
    """Return the poses at a share of the straight motions from home, which turn steadily."""
    home = machine.home
    shift = home.translation + share * (end.translation - home.translation)
    turn = Rotation.from_rotvec(share * (home.rotation.inv() * end.rotation).as_rotvec())
    return RigidTransform.from_components(shift, home.rotation * turn)


def leg_jacobian(machine: Hexapod, pose: Pose) -> tuple[Array, Array]:
    """Return lengths (N, 6) and Jacobian (N, 6, 6) of six vectors between joints: uᵢ, R aᵢ × uᵢ."""
    arm = np.stack([pose.rotation.apply(joint) for joint in np.array(machine.platform)], 1)
    leg = pose.translation[:, None] + arm - machine.base
    length = np.linalg.norm(leg, axis=2)
    u = leg / length[..., None]
    return length, np.concatenate([u, np.cross(arm, u)], 2)


def crosses_singularity(machine: Hexapod, end: Pose) -> np.ndarray:
    """Return whether det J has two signs on the straight motion from home, (N,) bool."""
    signs: list[Array] = []
    for share in np.linspace(0.0, 1.0, INSTANTS):
        _, jacobian = leg_jacobian(machine, interpolate_from_home(machine, end, share))
        signs.append(np.linalg.slogdet(jacobian)[0])
    return np.asarray((np.array(signs) != signs[0]).any(0))


def follow_lengths(machine: Hexapod, end: Pose, steps: int = STEPS[0]) -> Pose:
    """Return where machines arrive that follow the lengths of the straight motion in small
    steps.
    """
    pose = interpolate_from_home(machine, end, 0.0)
    for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
        target, _ = leg_jacobian(machine, interpolate_from_home(machine, end, share))
        for _ in range(3 if share < 1 else 8):
            length, jacobian = leg_jacobian(machine, pose)
            twist = np.linalg.solve(jacobian, (target - length)[..., None])[..., 0]
            turned = Rotation.from_rotvec(twist[:, 3:]) * pose.rotation
            pose = RigidTransform.from_components(pose.translation + twist[:, :3], turned)
    return pose


def time_rows(machine: Hexapod, poses: Pose) -> Iterator[Row]:
    """Yield µs a pose, the best of several calls after a first one, and the µs wanted."""
    q = machine.inverse(poses)
    few = q[:BATCH]
    works: list[tuple[str, int, int, Callable[[], object], float | None]] = [
        ("inverse, in batches", len(q), 5, lambda: machine.inverse(poses), 2.5),
        ("forward, in batches", len(q), 3, lambda: machine.forward(q, certify=False), 25),
        ("certified, in batches", len(few), 1, lambda: machine.forward(few), None),
        ("forward, one", 1, 50, lambda: machine.forward(q[0], certify=False), 1000),
        ("certified, one", 1, 20, lambda: machine.forward(q[0]), 1000),
    ]
    for name, count, repeats, work, target in works:
        _, times = time_calls(work, repeats + 1, perf_counter)
        yield [name, 1e6 * min(times[1:]) / count, target]


def measure(poses: int = 100_000) -> Iterator[Table]:
    """Yield the counts of both trials with `poses` poses each, and the times."""
    machine = load_machine("hexapod")
    assert isinstance(machine, Hexapod)
    inside = sample_within_limits(machine, poses)
    counts: list[Counter[str]] = []
    for drawn in (inside, sample_anywhere(machine, poses)):
        batches = [drawn[first : first + BATCH] for first in range(0, poses, BATCH)]
        counts.append(sum((try_forward(machine, batch) for batch in batches), Counter()))
    rows: list[Row] = [[text, *(count[name] for count in counts)] for name, text in COUNTS.items()]
    yield Table("Poses", ("poses", "inside the limits", "anywhere, within ±60°"), rows)
    columns = ("call", "time of a pose (µs)", "wanted (µs)")
    yield Table("Times", columns, time_rows(machine, inside))
