"""Where a motion plans the machine to be, and the poses that it really had."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from controllers.curve import MotionCurve, PathCurve, ReferenceCurve, piece_of
from kinematics.analysis.forward import RESIDUAL_TOLERANCE, iterate_newton
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.machine.pose import from_numbers, to_numbers
from planner.actuation import MachinePath
from planner.place import Place
from planner.pulses.motion import AxesMotion

if TYPE_CHECKING:
    from kinematics.machine.machine import Machine

SAME_BRANCH = 0.1
"""Share of the machine's characteristic length by which a platform on legs may be away from its planned place to be
taken for the one that Newton finds from there: other assemblies of the same legs are about that length away."""


@dataclass(frozen=True, slots=True)
class PlannedStates:
    """What a motion plans at instants t (N,): axis positions q (N, n); on its curve s (N,) and piece (N,).

    path   None: the curve is that of the axes' own positions
    unit   of distances on the curve, m or rad
    place  what to call the k-th instant
    """

    t: Array
    q: Array
    s: Array
    piece: np.ndarray
    curve: ReferenceCurve
    path: MachinePath | None
    unit: str
    place: Callable[[int], Place]


def sample_plan(motion: AxesMotion, machine: Machine, t: Array) -> PlannedStates:
    """Raises MotionError for a motion without a path in space whose axes are of two kinds: they have no distance."""
    state = motion.at(np.minimum(t, motion.duration))
    path = getattr(motion, "path", None)
    if isinstance(path, MachinePath):
        piece = state.piece  # type: ignore[attr-defined]  # of a trajectory
        return PlannedStates(
            t,
            state.q,
            state.s,
            piece,
            PathCurve(path),
            path,
            "m",
            lambda k: path.place(float(state.s[k]), int(piece[k]), float(t[k])),
        )
    units = {axis.unit for axis in machine.axes}
    if len(units) > 1:
        raise MotionError(
            f"metrics: the motion has no path in space, and axes of machine {machine.name} in m and in rad have no "
            "common distance; plan it on the machine, or take errors per axis"
        )
    curve, since = MotionCurve(motion), np.minimum(t, motion.duration)
    return PlannedStates(
        t,
        state.q,
        since,
        piece_of(curve, since),
        curve,
        None,
        units.pop(),
        lambda k: Place(float(getattr(state, "s", t)[k]), None, float(t[k])),
    )


def attained_poses(
    actual: Array, planned: PlannedStates, path: MachinePath, machine: Machine, *, certify: bool
) -> tuple[Array, Array, np.ndarray]:
    """Numbers of the planned poses (N, 12), of those attained at axis positions (N, B, n), (N, B, 12), and which (N, B)
    of them are known.

    certify  every pose is proved to be the one that the machine is in, and a MotionError names the first that is not.
             Otherwise what is checked is that the pose has the coordinates (to 1e-9 m or rad), and of machines on legs
             that the platform is near its planned place (`SAME_BRANCH`); what fails there is put at its planned pose.
    """
    n, runs, axes = actual.shape
    reference = path.pose_numbers(planned.s, planned.piece)
    # the planned pose is as near to the attained one as any: a short way to go, and to certify
    q, start = actual.reshape(-1, axes), np.repeat(reference, runs, axis=0)
    x, known = _prove_poses(q, start, planned, machine) if certify else _estimate_poses(q, start, machine)
    return reference, x.reshape(n, runs, 12), known.reshape(n, runs)


def _prove_poses(q: Array, start: Array, planned: PlannedStates, machine: Machine) -> tuple[Array, np.ndarray]:
    """Numbers (M, 12) of poses that are all proved."""
    found = machine.forward(q, near=from_numbers(start))
    lost = ~found.certified
    if lost.any():
        first = int(np.argmax(lost)) * len(planned.t) // len(q)
        raise MotionError(
            f"metrics: the axis positions at t = {planned.t[first]:.4g} s are no certain pose of machine "
            f"{machine.name}; the tracking left the machine's reach: slow the motion down, or take a law that follows"
        )
    return to_numbers(found.pose), found.certified


def _estimate_poses(q: Array, start: Array, machine: Machine) -> tuple[Array, np.ndarray]:
    """Numbers (M, 12) of the poses found, and which of them (M,) pass the checks; the others are as planned."""
    x, residual = iterate_newton(machine, q, start)
    sure = residual < RESIDUAL_TOLERANCE
    if machine.lengths:
        sure &= np.linalg.norm(x[:, :3] - start[:, :3], axis=1) < SAME_BRANCH * machine.characteristic_length
    return np.where(sure[:, None], x, start), sure
