"""What free segments turn by: a nonlinear programme in CasADi, solved by IPOPT.

Unknown are the Bernstein coefficients of what each free segment turns by (planner.path.shape) and,
for time, ṡ² on a grid of each segment. Travel and tilt are kept at the grid's points, and for time
speed and acceleration too. Where the motion runs through a joint, as in a blend, it is taken to be
no faster than a known motion is there, and what the segments turn by goes on with two continuous
derivatives: an estimate of what the plan then takes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Literal

import casadi as ca
import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import directional_bounds
from kinematics.machine.machine import Machine
from kinematics.machine.pose import column
from planner.orientation.evaluation_limit import EvaluationLimit
from planner.path.shape import CONTROL_COUNT, CONTROL_SLICE, DEGREE, Piece, Shape
from planner.program.modifiers import Free

Objective = Literal["time", "tilt", "feasible"]
# Grid intervals of a segment, closer together towards its ends.
INTERVALS = 48
# Share of travel and tilt that is left free, for what lies between the points of the grid; and for
# rounding.
LIMIT_MARGIN, ROOM_ROUNDING = 5e-4, 1e-9
# Weight of turning at all, against the objective: where several ways are as good, the calmest.
TURNING_WEIGHT = 1e-4
# Least ṡ² inside a segment, in a problem scaled to about one.
MIN_SQUARED_SPEED = 1e-8
# Room inside a cone, for the solver's tolerance.
CONE_MARGIN = 1e-6
MAX_ITERATIONS, MAX_EVALUATIONS = 300, 30_000


@dataclass(frozen=True, slots=True)
class FreePart:
    """One free segment: its grid s (N+1,), and what its shape takes there, s first, but for the
    controls (k, N+1).
    """

    shape: Shape
    s: Array
    numbers: Array
    free: Free
    speed: float | None

    @classmethod
    def from_pieces(cls, pieces: Sequence[Piece], free: Free) -> "FreePart":
        """A segment that is drawn as so many freed pieces."""
        ends = np.concatenate([[0.0], np.cumsum([piece.length for piece in pieces])])
        s = ends[-1] * (1 - np.cos(np.linspace(0, np.pi, INTERVALS + 1))) / 2
        of = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, len(pieces) - 1)
        own = np.array([np.delete(pieces[k].parameters, CONTROL_SLICE) for k in of]).T
        local = s - ends[of] + np.array([piece.start for piece in pieces])[of]
        return cls(
            pieces[0].shape, s, np.concatenate([local[None], own]), free, pieces[0].tool_speed
        )


@dataclass(frozen=True, slots=True)
class PartEnd:
    """An end of a part.

    speed  ṡ up to which it is passed (m/s); 0: the motion rests there, or nothing is known of it
    smooth  whether what the parts turn by goes on with two derivatives; given: with the orientation
            of the program
    """

    speed: float = 0.0
    smooth: bool = False
    given: bool = False


def solve_controls(
    machine: Machine,
    parts: Sequence[FreePart],
    joints: Sequence[PartEnd],
    objective: Objective,
    start: Array,
) -> Array:
    """Controls (P, 3, DEGREE + 1) of P parts that follow each other, from those to start from.

    joints (P+1,): before, between and after them. Those to start from where the solver finds none
    for time or tilts; raises MotionError where it finds none that is feasible.
    """
    answer = _solve(machine, parts, joints, objective, start.reshape(len(parts), CONTROL_COUNT).T)
    return freeze_array(_join_parts(parts, joints, answer.T.reshape(start.shape)))


def _join_parts(parts: Sequence[FreePart], joints: Sequence[PartEnd], controls: Array) -> Array:
    """What the solver has to its tolerance, exactly: where one part ends, the next one begins."""
    found = controls.copy()
    for k, (a, b) in enumerate(pairwise(parts)):
        ratio = b.s[-1] / a.s[-1]
        before, after = found[k], found[k + 1]
        after[:, 0] = before[:, -1]
        if joints[k + 1].smooth:
            after[:, 1] = after[:, 0] + ratio * (before[:, -1] - before[:, -2])
            second = before[:, -1] - 2 * before[:, -2] + before[:, -3]
            after[:, 2] = 2 * after[:, 1] - after[:, 0] + ratio**2 * second
    return found


@lru_cache(maxsize=16)
def _geometry(machine: Machine, shape: Shape) -> ca.Function:
    """(numbers of a `FreePart` at a point, controls) -> q, q′, q″, cosines of the tilts."""
    numbers, controls = (
        ca.SX.sym("numbers", 1 + shape.size - CONTROL_COUNT),
        ca.SX.sym("controls", CONTROL_COUNT),
    )
    s, before = numbers[0], 1 + CONTROL_SLICE.start
    position, rotation = shape.motion(s, ca.vertcat(numbers[1:before], controls, numbers[before:]))
    q = machine.symbolic(column(position, rotation), ca.SX(machine.home_q))
    q1 = ca.jacobian(q, s)
    return ca.Function(
        "oriented",
        [numbers, controls],
        [q, q1, ca.jacobian(q1, s), machine.tilts(position, rotation)],
        {"cse": True},
    )


def _solve(
    machine: Machine,
    parts: Sequence[FreePart],
    joints: Sequence[PartEnd],
    objective: Objective,
    start: Array,
) -> Array:
    """Controls (k, P)."""
    high = _control_bounds(parts, joints)
    open_ = np.flatnonzero(high > 0)
    chosen, slack = ca.MX.sym("chosen", len(open_)), ca.MX.sym("slack")
    size = np.where(np.isfinite(high), high, 1.0)[open_]  # what is small is counted in its bound
    spread = ca.DM.triplet(
        open_.tolist(), list(range(len(open_))), ca.DM(size), high.size, len(open_)
    )
    controls = ca.reshape(spread @ chosen, CONTROL_COUNT, len(parts))
    unit = _unit(machine)
    speeds = [ca.MX.sym("speeds", INTERVALS - 1) for _ in parts]  # ṡ² between the ends, and at them
    most = np.array([(joint.speed / unit) ** 2 for joint in joints])
    passed = ca.MX.sym("passed", int((most > MIN_SQUARED_SPEED).sum()))
    given = iter(ca.vertsplit(passed))
    ends = [next(given) if each > MIN_SQUARED_SPEED else ca.MX(0) for each in most]
    at = [
        _geometry(machine, part.shape).map(INTERVALS + 1)(
            part.numbers, ca.repmat(controls[:, k], 1, INTERVALS + 1)
        )
        for k, part in enumerate(parts)
    ]
    below = [_cone_rows(part, controls[:, k]) for k, part in enumerate(parts) if part.free.tilt > 0]
    for q, _, _, cosines in at:
        below += _range_rows(machine, q, cosines, slack, objective)
    cost: ca.MX = slack
    if objective == "time":
        cost = ca.MX(0)
        whole = sum(part.s[-1] for part in parts)
        for k, (part, (_, q1, q2, _)) in enumerate(zip(parts, at, strict=True)):
            kept, duration = _timing_rows(
                machine, part, q1, q2, ca.vertcat(ends[k], speeds[k], ends[k + 1]).T * unit**2
            )
            below += kept
            cost += duration * unit / whole
    cost += TURNING_WEIGHT * ca.sumsqr(controls) / len(parts)
    joined = [
        row
        for k, _ in enumerate(pairwise(parts))
        for row in _continuity_rows(parts, joints[k + 1], controls, k)
    ]
    patience = EvaluationLimit(MAX_EVALUATIONS)
    rows, equal = ca.vertcat(*below) + patience(slack), ca.vertcat(*joined)
    timed = objective == "time"
    x = ca.vertcat(chosen, slack, *([*speeds, passed] if timed else []))
    fastest = np.concatenate(
        [np.full((INTERVALS - 1) * len(parts), np.inf), most[most > MIN_SQUARED_SPEED]]
    )[: None if timed else 0]
    solver = ca.nlpsol(
        "orient",
        "ipopt",
        {"x": x, "f": cost, "g": ca.vertcat(rows, equal)},
        {
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "max_iter": MAX_ITERATIONS,
                "tol": 1e-7,
                "acceptable_tol": 1e-5,
            },
            "print_time": False,
            # nobody asks for them, and where IPOPT gives up CasADi would warn of them
            "calc_lam_p": False,
            "error_on_fail": False,
            "show_eval_warnings": False,
        },
    )
    with patience.asked():
        found = solver(
            x0=np.concatenate(
                [
                    start.T.ravel()[open_] / size,
                    [0.0 if timed else 1.0],
                    np.minimum(0.01, fastest / 2),
                ]
            ),
            lbx=np.concatenate(
                [
                    -high[open_] / size,
                    [0.0 if timed else -np.inf],
                    np.full(len(fastest), MIN_SQUARED_SPEED),
                ]
            ),
            ubx=np.concatenate([high[open_] / size, [0.0 if timed else np.inf], fastest]),
            lbg=np.concatenate([np.full(rows.numel(), -np.inf), np.zeros(equal.numel())]),
            ubg=np.zeros(rows.numel() + equal.numel()),
        )
    answer = np.zeros(high.size)
    answer[open_] = np.asarray(found["x"]).ravel()[: len(open_)] * size
    if not (solver.stats()["success"] and np.isfinite(answer).all()):
        if objective == "feasible":
            raise MotionError(
                "no orientation could be found for the free segments: the solver gave up"
            )
        return start  # what is feasible, if anything is, stays
    return answer.reshape(len(parts), CONTROL_COUNT).T


def _continuity_rows(
    parts: Sequence[FreePart], joint: PartEnd, controls: ca.MX, k: int
) -> list[ca.MX]:
    """What is 0 where part k goes over into the next one."""
    ratio = parts[k + 1].s[-1] / parts[k].s[-1]
    rows = []
    for first, *free in zip(
        range(0, CONTROL_COUNT, DEGREE + 1),
        _max_angles(parts[k]),
        _max_angles(parts[k + 1]),
        strict=True,
    ):
        if not any(free):
            continue
        last = first + DEGREE
        a2, a1, a = (controls[last - back, k] for back in (2, 1, 0))
        b, b1, b2 = (controls[first + on, k + 1] for on in (0, 1, 2))
        rows.append(b - a)
        if joint.smooth:
            rows += [b1 - b - ratio * (a - a1), b2 - 2 * b1 + b - ratio**2 * (a - 2 * a1 + a2)]
    return rows


def _max_angles(part: FreePart) -> tuple[float, float, float]:
    """The largest α, β, ψ."""
    return part.free.tilt, part.free.tilt, np.inf if part.free.yaw else 0.0


def _control_bounds(parts: Sequence[FreePart], joints: Sequence[PartEnd]) -> Array:
    """The largest size of each control, one part after the other: 0 where none is free, and at ends
    that are given.
    """
    high = np.array([np.repeat(_max_angles(part), DEGREE + 1) for part in parts])
    each = high.reshape(len(parts), 3, DEGREE + 1)
    if joints[0].given:
        each[0, :, : 3 if joints[0].smooth else 1] = 0.0
    if joints[-1].given:
        each[-1, :, -3 if joints[-1].smooth else -1 :] = 0.0
    return high.ravel()


def _cone_rows(part: FreePart, controls: ca.MX) -> ca.MX:
    """α² + β² within the cone at every coefficient, so everywhere between; the axis tilts by √(α² +
    β²) at most.
    """
    alpha, beta = controls[: DEGREE + 1], controls[DEGREE + 1 : 2 * (DEGREE + 1)]
    return (alpha**2 + beta**2) / part.free.tilt**2 - (1 - CONE_MARGIN)


def _range_rows(
    machine: Machine, q: ca.MX, cosines: ca.MX, slack: ca.MX, objective: Objective
) -> list[ca.MX]:
    """At most 0 within travel and tilt: by as much less as `slack` is below 0 for what is to be
    made small.

    The ends keep no room: their orientation may be given, and a machine may stand at an end of its
    travel.
    """
    lo, hi = np.array([axis.travel for axis in machine.axes]).T
    bounded = np.flatnonzero(np.isfinite(hi))
    half = (hi - lo)[bounded] / 2
    off = (q[bounded.tolist(), :] - ca.DM((machine.home_q + lo)[bounded] + half)) / ca.DM(half)
    room = np.full(INTERVALS + 1, LIMIT_MARGIN)
    room[[0, -1]] = -ROOM_ROUNDING
    moved = slack if objective == "feasible" else 0.0
    travel = ca.DM(np.tile(1 - room, (len(bounded), 1))) + moved
    least = np.cos(np.outer(machine.max_tilt, 1 - room))
    rows = [ca.vec(off - travel), ca.vec(-off - travel), ca.vec(ca.DM(least) - cosines - moved)]
    if objective == "tilt" and cosines.numel():
        rows.append(1 - ca.vec(cosines) - slack)  # the least cosine as large as can be
    return rows


def _unit(machine: Machine) -> float:
    """m/s in which ṡ is counted."""
    stated = [
        each
        for axis in machine.axes
        if np.isfinite(each := min(directional_bounds(axis.max_speed)))
    ]
    return min(stated, default=1.0)


def _timing_rows(
    machine: Machine, part: FreePart, q1: ca.MX, q2: ca.MX, z: ca.MX
) -> tuple[list[ca.MX], ca.MX]:
    """Speed and acceleration of every axis on both sides of every interval, at most 0; the
    duration. z: ṡ² (1, N+1).
    """
    # of limits that differ by direction the smaller: an estimate is all that is wanted
    speed = np.array([min(directional_bounds(axis.max_speed)) for axis in machine.axes])
    push = np.array([min(directional_bounds(axis.max_acceleration)) for axis in machine.axes])
    step = ca.DM(np.diff(part.s)).T
    u = (z[1:] - z[:-1]) / (2 * step)
    rows = []
    if part.speed is not None:
        rows.append((z / part.speed**2 - 1).T)
    for k in np.flatnonzero(np.isfinite(speed)).tolist():
        rows.append((q1[k, :] ** 2 * z / speed[k] ** 2 - 1).T)
    for k in np.flatnonzero(np.isfinite(push)).tolist():
        for side in (slice(None, -1), slice(1, None)):
            value = ((q1[k, side] * u + q2[k, side] * z[side]) / push[k]).T
            rows += [value - 1, -value - 1]
    root = ca.sqrt(z)
    return rows, ca.sum2(2 * step / (root[1:] + root[:-1]))
