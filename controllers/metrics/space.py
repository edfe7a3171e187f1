"""Errors against the path: in space where the motion has a path there, else in the space of its axes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from controllers.contour import contour_error
from controllers.curve import directions
from controllers.metrics.attained import Planned, attained_poses
from kinematics.array import Array
from planner.actuation import MachinePath

if TYPE_CHECKING:
    from kinematics.machine import Machine

POSES = 1 << 17
"""Poses worked on together: they take some hundred megabytes."""


@dataclass(frozen=True, slots=True)
class SpaceErrors:
    """‖e‖, t̂ᵀe, ε and ‖log(R_rᵀ R)‖ of runs, (N, runs); no orientation where there is no pose.

    planned (N, d), attained (N, runs, d): where the platform's origin was to be and was, or the axes
    """

    planned: Array
    attained: Array
    tracking: Array
    lag: Array
    contour: Array
    orientation: Array | None


def space_errors(actual: Array, planned: Planned, machine: Machine, *, certify: bool) -> Iterator[SpaceErrors]:
    """Of axis positions (N, B, n), some runs at a time; certify as in `attained_poses`.

    A run with a pose that is not known has nan throughout.
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
    reference, attained, known = attained_poses(actual, planned, path, machine, certify=certify)
    turned = _angles(reference[:, None, 3:], attained[..., 3:])
    errors = _beside(attained[..., :3], reference[:, :3], planned, turned)
    sure = np.asarray(known.all(0))
    if sure.all():
        return errors
    figures = (np.where(sure, of, np.nan) for of in (errors.tracking, errors.lag, errors.contour, turned))
    return SpaceErrors(errors.planned, np.where(sure[:, None], errors.attained, np.nan), *figures)


def _beside(actual: Array, reference: Array, planned: Planned, orientation: Array | None) -> SpaceErrors:
    error = actual - reference[:, None]
    along = directions(planned.curve, planned.s, planned.piece)
    return SpaceErrors(
        reference,
        actual,
        np.linalg.norm(error, axis=2),
        np.einsum("nbd,nd->nb", error, along),
        contour_error(actual, planned.s, planned.curve).error,
        orientation,
    )


def _angles(reference: Array, actual: Array) -> Array:
    """‖log(R_rᵀ R)‖ = atan2(‖v‖, tr M − 1) with v = vee(M − Mᵀ), M = R_rᵀ R, of rotations by rows (…, 9).

    Exact for small angles too.
    """
    before, after = (of.reshape(*of.shape[:-1], 3, 3) for of in (reference, actual))
    turn = before.swapaxes(-1, -2) @ after
    v = (turn - turn.swapaxes(-1, -2))[..., [2, 0, 1], [1, 2, 0]]
    return np.asarray(np.arctan2(np.linalg.norm(v, axis=-1), np.trace(turn, axis1=-2, axis2=-1) - 1))
