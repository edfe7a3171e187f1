"""Forward kinematics of the preset hexapod, tried and timed: `python -m benchmarks.evidence.speed.forward [--poses N]`.

Two trials, both asked from home. *Inside the limits*: poses drawn evenly from a box that holds all of them, those with
travel and tilt within limits kept. *Anywhere*: poses with every angle within 60° and positions far beyond any reach of
the real legs. What is certified is held against the claim of the certificate by a Jacobian and a Newton of this file's
own: on the straight motion from home to the pose found, det J keeps its sign, and a machine that is led along the
lengths of this motion in small steps arrives there.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks.evidence.measuring import time_calls
from kinematics import Hexapod, Pose, load_machine
from kinematics.analysis.singularity import prove_regular
from kinematics.foundation.arrays import Array
from kinematics.machine.pose import to_numbers

# Half ranges of x and y, range of z from home (m), half ranges of the rotation vector (rad). Of 4e6 poses
# within ±120 mm, −10 to 60 mm and ±60°, those inside the limits reach 93 mm, −1 to 47 mm, and 17°, 16°, 47°.
MAX_SHIFT_XY, SHIFT_RANGE_Z, MAX_TURN = 0.105, (-0.003, 0.052), np.deg2rad([19, 19, 55])
# Half ranges of positions (m) and angles (rad) of the other trial.
FAR_POSITION, WIDE_ANGLE = 0.3, np.deg2rad(60)
SAME_POSE_TOLERANCE = 1e-9
"""m or rad up to which two poses are the same."""
INSTANTS = 129
# Steps that a machine is led in; the second where the first lose it, close to a singularity.
STEPS = (200, 4000)
BATCH = 20_000
# Wanted: share certified inside the limits; s per pose.
SHARE, INVERSE_TIME, FORWARD_TIME, SINGLE_TIME = 0.95, 2.5e-6, 25e-6, 1e-3


@dataclass(frozen=True, slots=True)
class ForwardTrial:
    """What became of poses sent through inverse and forward: how many of them were …

    solved      answered with the lengths asked for
    certified   proved
    elsewhere   proved, and not the pose that the lengths were made from
    beyond      of those, det J changes its sign on the straight motion to the pose the lengths were made from
    free        of those, that motion is proved regular too: two poses of the same lengths, both reached freely
    wrong       proved although det J changes its sign on the motion, or a machine led along it ends elsewhere
    """

    poses: int
    solved: int
    certified: int
    elsewhere: int
    beyond: int
    free: int
    wrong: int


def sample_within_limits(machine: Hexapod, count: int, seed: int = 0) -> Pose:
    """Poses within travel and tilt limits."""
    random = np.random.default_rng(seed)
    low, high = np.array([axis.travel for axis in machine.axes]).T
    kept: list[Array] = []
    while sum(map(len, kept)) < count:
        shift = random.uniform(
            [-MAX_SHIFT_XY, -MAX_SHIFT_XY, SHIFT_RANGE_Z[0]],
            [MAX_SHIFT_XY, MAX_SHIFT_XY, SHIFT_RANGE_Z[1]],
            (10 * BATCH, 3),
        )
        turn = Rotation.from_rotvec(random.uniform(-MAX_TURN, MAX_TURN, (10 * BATCH, 3)))
        pose = RigidTransform.from_components(machine.home.translation + shift, turn * machine.home.rotation)
        x = to_numbers(pose)
        stroke = machine.inverse_map(x) - machine.home_q
        reached = (stroke >= low).all(1) & (stroke <= high).all(1)
        reached &= (machine.tilt_map(x) >= np.cos(machine.max_tilt)).all(1)
        kept.append(pose[reached].as_matrix())
    return RigidTransform.from_matrix(np.concatenate(kept)[:count])


def sample_anywhere(machine: Hexapod, count: int, seed: int = 0) -> Pose:
    """Poses far from home, every angle about the moving axes in turn within 60°."""
    random = np.random.default_rng(seed)
    shift = random.uniform(-FAR_POSITION, FAR_POSITION, (count, 3))
    turn = Rotation.from_euler("XYZ", random.uniform(-WIDE_ANGLE, WIDE_ANGLE, (count, 3)))
    return RigidTransform.from_components(machine.home.translation + shift, turn * machine.home.rotation)


def try_forward(machine: Hexapod, poses: Pose) -> ForwardTrial:
    """Asked from home, in batches that fit into memory."""
    parts = [_try_batch(machine, poses[k : k + BATCH]) for k in range(0, len(poses), BATCH)]
    return ForwardTrial(*(sum(getattr(part, name) for part in parts) for name in ForwardTrial.__slots__))


def _try_batch(machine: Hexapod, poses: Pose) -> ForwardTrial:
    q = machine.inverse(poses)
    found = machine.forward(q)
    proved = np.flatnonzero(found.certified)
    other = _pose_distance(found.pose[proved], poses[proved]) > SAME_POSE_TOLERANCE
    wrong = _crosses_singularity(machine, found.pose[proved])
    solved, rest = int((found.residual < SAME_POSE_TOLERANCE).sum()), proved[other]
    if not len(rest):
        return ForwardTrial(len(poses), solved, len(proved), 0, 0, 0, int(wrong.sum()))
    lost = np.flatnonzero(other)
    for steps in STEPS:
        if len(lost):
            end = found.pose[proved[lost]]
            lost = lost[~(_pose_distance(follow_lengths(machine, end, steps), end) <= SAME_POSE_TOLERANCE)]
    wrong[lost] = True
    beyond = _crosses_singularity(machine, poses[rest])
    free = prove_regular(machine, interpolate_from_home(machine, poses[rest], 0.0), poses[rest])
    return ForwardTrial(
        len(poses), solved, len(proved), len(rest), int(beyond.sum()), int(free.sum()), int(wrong.sum())
    )


def _pose_distance(one: Pose, other: Pose) -> Array:
    apart = one.inv() * other
    return np.asarray(np.maximum(np.linalg.norm(apart.translation, axis=1), apart.rotation.magnitude()))


def interpolate_from_home(machine: Hexapod, end: Pose, share: float) -> Pose:
    """Poses at a share of the straight motions from home, turning steadily, by SciPy alone."""
    home = machine.home
    shift = home.translation + share * (end.translation - home.translation)
    turn = Rotation.from_rotvec(share * (home.rotation.inv() * end.rotation).as_rotvec())
    return RigidTransform.from_components(shift, home.rotation * turn)


def leg_jacobian(machine: Hexapod, pose: Pose) -> tuple[Array, Array]:
    """Lengths (N, 6) and Jacobian (N, 6, 6) of six vectors between joints: uᵢ and R aᵢ × uᵢ."""
    arm = np.stack([pose.rotation.apply(joint) for joint in np.array(machine.platform)], 1)
    leg = pose.translation[:, None] + arm - machine.base
    length = np.linalg.norm(leg, axis=2)
    u = leg / length[..., None]
    return length, np.concatenate([u, np.cross(arm, u)], 2)


def _crosses_singularity(machine: Hexapod, end: Pose) -> np.ndarray:
    """(N,) bool: det J has two signs on the way from home."""
    shares = np.linspace(0.0, 1.0, INSTANTS)
    signs = np.array(
        [np.linalg.slogdet(leg_jacobian(machine, interpolate_from_home(machine, end, share))[1])[0] for share in shares]
    )
    return np.asarray((signs != signs[0]).any(0))


def follow_lengths(machine: Hexapod, end: Pose, steps: int = STEPS[0]) -> Pose:
    """Where a machine arrives that starts at home and follows the lengths of the straight motion in small steps."""
    pose = interpolate_from_home(machine, end, 0.0)
    for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
        target = leg_jacobian(machine, interpolate_from_home(machine, end, share))[0]
        for _ in range(3 if share < 1 else 8):
            length, jacobian = leg_jacobian(machine, pose)
            twist = np.linalg.solve(jacobian, (target - length)[..., None])[..., 0]
            turned = Rotation.from_rotvec(twist[:, 3:]) * pose.rotation
            pose = RigidTransform.from_components(pose.translation + twist[:, :3], turned)
    return pose


def best_call_time(work: Callable[[], object], repeats: int) -> float:
    """s, of several calls after a first one."""
    return min(time_calls(work, repeats + 1, perf_counter)[1][1:])


def measure_pose_times(machine: Hexapod, poses: Pose) -> dict[str, tuple[float, float | None]]:
    """s per pose, and what is wanted."""
    q, count = machine.inverse(poses), len(poses)
    few = q[:BATCH]
    return {
        f"inverse, {count} poses at once": (best_call_time(lambda: machine.inverse(poses), 5) / count, INVERSE_TIME),
        f"forward without certificate, {count} at once": (
            best_call_time(lambda: machine.forward(q, certify=False), 3) / count,
            FORWARD_TIME,
        ),
        f"forward with certificate, {len(few)} at once": (
            best_call_time(lambda: machine.forward(few), 1) / len(few),
            None,
        ),
        "forward without certificate, one": (
            best_call_time(lambda: machine.forward(q[0], certify=False), 50),
            SINGLE_TIME,
        ),
        "forward with certificate, one": (best_call_time(lambda: machine.forward(q[0]), 20), SINGLE_TIME),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=100_000)
    count = parser.parse_args().poses
    machine = load_machine("hexapod")
    assert isinstance(machine, Hexapod)
    drawn = {
        "inside the limits": sample_within_limits(machine, count),
        "anywhere, within ±60°": sample_anywhere(machine, count),
    }
    for what, poses in drawn.items():
        trial = try_forward(machine, poses)
        share = trial.certified / trial.poses
        wanted = f" (wanted: {SHARE:.0%}: {_verdict(share >= SHARE)})" if what == "inside the limits" else ""
        print(f"{what}: {trial.poses} poses, {trial.solved} solved, {trial.certified} certified, {share:.2%}{wanted}")
        print(
            f"    certified and wrong: {trial.wrong} (wanted: 0: {_verdict(not trial.wrong)})\n"
            f"    certified, and another pose than the lengths were made from: {trial.elsewhere}; of those they were "
            f"made from, {trial.beyond} lie beyond a singularity on the straight way, {trial.free} are reached freely, "
            f"{trial.elsewhere - trial.beyond - trial.free} pass one too closely to tell"
        )
    print(f"{'time per pose':<52}{'µs':>10}{'wanted':>10}")
    for what, (time, target) in measure_pose_times(machine, drawn["inside the limits"]).items():
        wanted = "" if target is None else f"{1e6 * target:>10g}  {_verdict(time <= target)}"
        print(f"{what:<52}{1e6 * time:>10.2f}{wanted}")


def _verdict(kept: bool) -> str:
    return "met" if kept else "MISSED"


if __name__ == "__main__":
    main()
