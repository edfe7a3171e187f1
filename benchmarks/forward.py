"""Forward kinematics of the preset hexapod, tried and timed: `python -m benchmarks.forward [--poses N]`.

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

from kinematics import Hexapod, Pose, load_machine
from kinematics.array import Array
from kinematics.pose import numbers
from kinematics.regular import regular

# Half ranges of x and y, range of z from home (m), half ranges of the rotation vector (rad). Of 4e6 poses
# within ±120 mm, −10 to 60 mm and ±60°, those inside the limits reach 93 mm, −1 to 47 mm, and 17°, 16°, 47°.
ACROSS, UP, TURN = 0.105, (-0.003, 0.052), np.deg2rad([19, 19, 55])
# Half ranges of positions (m) and angles (rad) of the other trial.
FAR, WIDE = 0.3, np.deg2rad(60)
SAME = 1e-9
"""m or rad up to which two poses are the same."""
INSTANTS = 129
# Steps that a machine is led in; the second where the first lose it, close to a singularity.
STEPS = (200, 4000)
BATCH = 20_000
# Wanted: share certified inside the limits; s per pose.
SHARE, INVERSE, FORWARD, SINGLE = 0.95, 2.5e-6, 25e-6, 1e-3


@dataclass(frozen=True, slots=True)
class Trial:
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


def inside(machine: Hexapod, count: int, seed: int = 0) -> Pose:
    """Poses within travel and tilt limits."""
    random = np.random.default_rng(seed)
    low, high = np.array([axis.travel for axis in machine.axes]).T
    kept: list[Array] = []
    while sum(map(len, kept)) < count:
        shift = random.uniform([-ACROSS, -ACROSS, UP[0]], [ACROSS, ACROSS, UP[1]], (10 * BATCH, 3))
        turn = Rotation.from_rotvec(random.uniform(-TURN, TURN, (10 * BATCH, 3)))
        pose = RigidTransform.from_components(machine.home.translation + shift, turn * machine.home.rotation)
        x = numbers(pose)
        stroke = machine.inverse_map(x) - machine.home_q
        reached = (stroke >= low).all(1) & (stroke <= high).all(1)
        reached &= (machine.tilt_map(x) >= np.cos(machine.max_tilt)).all(1)
        kept.append(pose[reached].as_matrix())
    return RigidTransform.from_matrix(np.concatenate(kept)[:count])


def anywhere(machine: Hexapod, count: int, seed: int = 0) -> Pose:
    """Poses far from home, every angle about the moving axes in turn within 60°."""
    random = np.random.default_rng(seed)
    shift = random.uniform(-FAR, FAR, (count, 3))
    turn = Rotation.from_euler("XYZ", random.uniform(-WIDE, WIDE, (count, 3)))
    return RigidTransform.from_components(machine.home.translation + shift, turn * machine.home.rotation)


def tried(machine: Hexapod, poses: Pose) -> Trial:
    """Asked from home, in batches that fit into memory."""
    parts = [_batch(machine, poses[k : k + BATCH]) for k in range(0, len(poses), BATCH)]
    return Trial(*(sum(getattr(part, name) for part in parts) for name in Trial.__slots__))


def _batch(machine: Hexapod, poses: Pose) -> Trial:
    q = machine.inverse(poses)
    found = machine.forward(q)
    proved = np.flatnonzero(found.certified)
    other = _apart(found.pose[proved], poses[proved]) > SAME
    wrong = _crosses(machine, found.pose[proved])
    solved, rest = int((found.residual < SAME).sum()), proved[other]
    if not len(rest):
        return Trial(len(poses), solved, len(proved), 0, 0, 0, int(wrong.sum()))
    lost = np.flatnonzero(other)
    for steps in STEPS:
        if len(lost):
            end = found.pose[proved[lost]]
            lost = lost[~(_apart(led(machine, end, steps), end) <= SAME)]
    wrong[lost] = True
    beyond = _crosses(machine, poses[rest])
    free = regular(machine, way(machine, poses[rest], 0.0), poses[rest])
    return Trial(len(poses), solved, len(proved), len(rest), int(beyond.sum()), int(free.sum()), int(wrong.sum()))


def _apart(one: Pose, other: Pose) -> Array:
    apart = one.inv() * other
    return np.asarray(np.maximum(np.linalg.norm(apart.translation, axis=1), apart.rotation.magnitude()))


def way(machine: Hexapod, end: Pose, share: float) -> Pose:
    """Poses at a share of the straight motions from home, turning steadily, by SciPy alone."""
    home = machine.home
    shift = home.translation + share * (end.translation - home.translation)
    turn = Rotation.from_rotvec(share * (home.rotation.inv() * end.rotation).as_rotvec())
    return RigidTransform.from_components(shift, home.rotation * turn)


def legs(machine: Hexapod, pose: Pose) -> tuple[Array, Array]:
    """Lengths (N, 6) and Jacobian (N, 6, 6) of six vectors between joints: uᵢ and R aᵢ × uᵢ."""
    arm = np.stack([pose.rotation.apply(joint) for joint in np.array(machine.platform)], 1)
    leg = pose.translation[:, None] + arm - machine.base
    length = np.linalg.norm(leg, axis=2)
    u = leg / length[..., None]
    return length, np.concatenate([u, np.cross(arm, u)], 2)


def _crosses(machine: Hexapod, end: Pose) -> np.ndarray:
    """(N,) bool: det J has two signs on the way from home."""
    shares = np.linspace(0.0, 1.0, INSTANTS)
    signs = np.array([np.linalg.slogdet(legs(machine, way(machine, end, share))[1])[0] for share in shares])
    return np.asarray((signs != signs[0]).any(0))


def led(machine: Hexapod, end: Pose, steps: int = STEPS[0]) -> Pose:
    """Where a machine arrives that starts at home and follows the lengths of the straight motion in small steps."""
    pose = way(machine, end, 0.0)
    for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
        target = legs(machine, way(machine, end, share))[0]
        for _ in range(3 if share < 1 else 8):
            length, jacobian = legs(machine, pose)
            twist = np.linalg.solve(jacobian, (target - length)[..., None])[..., 0]
            turned = Rotation.from_rotvec(twist[:, 3:]) * pose.rotation
            pose = RigidTransform.from_components(pose.translation + twist[:, :3], turned)
    return pose


def fastest(work: Callable[[], object], repeats: int) -> float:
    """s, of several calls after a first one."""
    work()
    times = []
    for _ in range(repeats):
        begin = perf_counter()
        work()
        times.append(perf_counter() - begin)
    return min(times)


def speeds(machine: Hexapod, poses: Pose) -> dict[str, tuple[float, float | None]]:
    """s per pose, and what is wanted."""
    q, count = machine.inverse(poses), len(poses)
    few = q[:BATCH]
    return {
        f"inverse, {count} poses at once": (fastest(lambda: machine.inverse(poses), 5) / count, INVERSE),
        f"forward without certificate, {count} at once": (
            fastest(lambda: machine.forward(q, certify=False), 3) / count,
            FORWARD,
        ),
        f"forward with certificate, {len(few)} at once": (fastest(lambda: machine.forward(few), 1) / len(few), None),
        "forward without certificate, one": (fastest(lambda: machine.forward(q[0], certify=False), 50), SINGLE),
        "forward with certificate, one": (fastest(lambda: machine.forward(q[0]), 20), SINGLE),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=100_000)
    count = parser.parse_args().poses
    machine = load_machine("hexapod")
    assert isinstance(machine, Hexapod)
    drawn = {"inside the limits": inside(machine, count), "anywhere, within ±60°": anywhere(machine, count)}
    for what, poses in drawn.items():
        trial = tried(machine, poses)
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
    for what, (time, target) in speeds(machine, drawn["inside the limits"]).items():
        wanted = "" if target is None else f"{1e6 * target:>10g}  {_verdict(time <= target)}"
        print(f"{what:<52}{1e6 * time:>10.2f}{wanted}")


def _verdict(kept: bool) -> str:
    return "met" if kept else "MISSED"


if __name__ == "__main__":
    main()
