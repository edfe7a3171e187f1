"""Errors against the path: in space where the motion has a path there, else in the space of its axes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from controllers.contour import contour_error
from controllers.curve import Curve, MotionCurve, PathCurve, directions, piece_of
from kinematics.array import Array
from kinematics.errors import MotionError
from kinematics.forward import CONVERGED
from kinematics.pose import from_numbers
from planner.actuation import MachinePath
from planner.place import Place
from planner.pulses.motion import Motion

if TYPE_CHECKING:
    from kinematics.machine import Machine

POSES = 1 << 16
"""Poses worked on together: they take some forty megabytes."""
SAME_BRANCH = 0.1
"""Share of the machine's characteristic length by which a platform on legs may be away from its planned place to be
taken for the one that Newton finds from there: other assemblies of the same legs are about that length away."""


@dataclass(frozen=True, slots=True)
class Planned:
    """What a motion plans at instants t (N,): axis positions q (N, n), and where on its curve s (N,) that is.

    path   None: the curve is that of the axes' own positions
    unit   of distances on the curve, m or rad
    place  what to call the k-th instant
    """

    t: Array
    q: Array
    s: Array
    curve: Curve
    path: MachinePath | None
    unit: str
    place: Callable[[int], Place]


@dataclass(frozen=True, slots=True)
class SpaceErrors:
    """‖e‖, t̂ᵀe, ε and ‖log(R_rᵀ R)‖ of runs, (N, runs); no orientation where there is no pose."""

    tracking: Array
    lag: Array
    contour: Array
    orientation: Array | None


def planned_at(motion: Motion, machine: Machine, t: Array) -> Planned:
    """Raises MotionError for a motion without a path in space whose axes are of two kinds: they have no distance."""
    state = motion.at(np.minimum(t, motion.duration))
    path = getattr(motion, "path", None)
    if isinstance(path, MachinePath):
        piece = state.piece  # type: ignore[attr-defined]  # of a trajectory
        return Planned(
            t,
            state.q,
            state.s,
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
    return Planned(
        t,
        state.q,
        np.minimum(t, motion.duration),
        MotionCurve(motion),
        None,
        units.pop(),
        lambda k: Place(float(getattr(state, "s", t)[k]), None, float(t[k])),
    )


def space_errors(actual: Array, planned: Planned, machine: Machine, *, certify: bool) -> Iterator[SpaceErrors]:
    """Of axis positions (N, B, n), some runs at a time.

    certify  every pose is proved to be the one that the machine is in, and a MotionError names the first that is not.
             Otherwise what is checked is that the pose has the coordinates (to 1e-9 m or rad), and of machines on legs
             that the platform is near its planned place (`SAME_BRANCH`); a run that fails there has nan throughout.
    """
    at_once, path = max(1, POSES // len(actual)), planned.path
    for start in range(0, actual.shape[1], at_once):
        some = actual[:, start : start + at_once]
        yield (
            _beside(some, planned.q, planned, None)
            if path is None
            else _in_space(some, planned, path, machine, certify)
        )


def _in_space(actual: Array, planned: Planned, path: MachinePath, machine: Machine, certify: bool) -> SpaceErrors:
    n, runs, axes = actual.shape
    numbers = path.pose_numbers(planned.s, piece_of(planned.curve, planned.s))
    # the planned pose is as near to the attained one as any: a short way to go, and to certify
    near = from_numbers(np.repeat(numbers, runs, axis=0))
    found = machine.forward(actual.reshape(-1, axes), near=near, certify=certify)
    position = found.pose.translation.reshape(n, runs, 3)
    if certify:
        lost = ~found.certified
        if lost.any():
            first = int(np.argmax(lost)) // runs
            raise MotionError(
                f"metrics: the axis positions at t = {planned.t[first]:.4g} s are no certain pose of machine "
                f"{machine.name}; the tracking left the machine's reach: slow the motion down, or take a law that "
                "follows"
            )
    reference = numbers[:, :3]
    turned = _angles(numbers[:, 3:].reshape(n, 1, 3, 3), found.pose.rotation.as_matrix().reshape(n, runs, 3, 3))
    known = (found.residual < CONVERGED).reshape(n, runs)
    if machine.lengths and not certify:
        away = np.linalg.norm(position - reference[:, None], axis=2)
        known &= away < SAME_BRANCH * machine.characteristic_length
    errors = _beside(np.where(known[..., None], position, reference[:, None]), reference, planned, turned)
    sure = known.all(0)
    if sure.all():
        return errors
    return SpaceErrors(*(np.where(sure, of, np.nan) for of in (errors.tracking, errors.lag, errors.contour, turned)))


def _beside(actual: Array, reference: Array, planned: Planned, orientation: Array | None) -> SpaceErrors:
    error = actual - reference[:, None]
    along = directions(planned.curve, planned.s, piece_of(planned.curve, planned.s))
    return SpaceErrors(
        np.linalg.norm(error, axis=2),
        np.einsum("nbd,nd->nb", error, along),
        contour_error(actual, planned.s, planned.curve).error,
        orientation,
    )


def _angles(reference: Array, actual: Array) -> Array:
    """‖log(R_rᵀ R)‖ = atan2(‖v‖, tr − 1) with v = vee(M − Mᵀ) of M = R_rᵀ R: exact for small angles too."""
    turn = np.swapaxes(reference, -1, -2) @ actual
    v = turn - np.swapaxes(turn, -1, -2)
    size = np.sqrt(v[..., 2, 1] ** 2 + v[..., 0, 2] ** 2 + v[..., 1, 0] ** 2)
    return np.asarray(np.arctan2(size, np.trace(turn, axis1=-2, axis2=-1) - 1))
