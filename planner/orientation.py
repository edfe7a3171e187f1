"""Orientation where a program leaves it free: chosen for time, for small tilts, or to make a path feasible at all.

A nonlinear programme in CasADi, solved by IPOPT. Unknown are the Bernstein coefficients of what each free segment turns
by (planner.path.free) and, for time, ṡ² on a grid of each segment. Travel and tilt are kept at the grid's points, and
for time speed and acceleration too, from rest to rest on each segment: an estimate of what the plan then takes. What is
chosen is proved afterwards like any other path.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby, pairwise
from typing import Any, Literal, get_args

import casadi as ca
import numpy as np

from kinematics.array import Array, frozen
from kinematics.axis import sides
from kinematics.errors import MotionError
from kinematics.machine import Machine
from kinematics.pose import column
from planner.path.chain import draw
from planner.path.free import CONTROLS, DEGREE, NUMBERS
from planner.path.shape import Piece, Shape
from planner.path.tool import carrying
from planner.program import Dwell, Free, Program

Objective = Literal["time", "tilt", "feasible"]
# Grid intervals of a segment, closer together towards its ends.
INTERVALS = 48
# Share of travel and tilt that is left free, for what lies between the points of the grid; and for rounding.
ROOM, ROUNDING = 5e-4, 1e-9
# Weight of turning at all, against the objective: where several ways are as good, the calmest.
CALM = 1e-4
# Least ṡ² inside a segment, in a problem scaled to about one.
MOVING = 1e-8
ITERATIONS = 300


def orient(program: Program, machine: Machine, objective: Objective = "time") -> Program:
    """The program with the orientation of its free segments chosen.

    "time": as fast as the machine's limits on speed and acceleration allow; "tilt": the largest tilt of any joint as
    small as can be; "feasible": as far inside travel and tilt as can be. Neighbouring free segments are chosen
    together; they begin, and unless they end the program also end, in the orientation that it says.
    Raises MotionError where the machine does not control what is left free.
    """
    if objective not in get_args(Objective):
        raise MotionError(f'no objective "{objective}"; objectives: {", ".join(get_args(Objective))}')
    segments: list[Any] = list(program.segments)
    once, _, _ = draw(replace(program, repeat=1), machine)
    drawn = {pieces[0].segment - 1: [_carried(piece, program) for piece in pieces] for pieces in once}
    last = max(drawn)
    for free, group in groupby(sorted(drawn), key=lambda k: _free(segments[k]) is not None):
        members = list(group)
        if not free:
            continue
        for k in members:
            _refuse(segments[k].free, k + 1, machine)
        parts = [_part(drawn[k], segments[k]) for k in members]
        for k, controls in zip(
            members, _chosen(machine, parts, members[-1] != last or program.repeat > 1, objective), strict=True
        ):
            segments[k] = replace(segments[k], free=replace(segments[k].free, controls=controls))
    return replace(program, segments=tuple(segments))


def oriented(program: Program, machine: Machine) -> Program:
    """The program with whatever is still open chosen for time."""
    still = any(free is not None and free.controls is None for free in map(_free, program.segments))
    return orient(program, machine) if still else program


def _carried(piece: Piece, program: Program) -> Piece:
    return piece if program.tool is None else carrying(piece, program.tool)


def _free(segment: Any) -> Free | None:
    return None if isinstance(segment, Dwell) else getattr(segment, "free", None)


def _refuse(free: Free, number: int, machine: Machine) -> None:
    wanted = (["rz"] if free.yaw else []) + (["rx", "ry"] if free.tilt > 0 else [])
    missing = [name for name in wanted if name not in machine.freedom]
    if missing:
        raise MotionError(
            f"segment {number} leaves free what machine {machine.name} does not control: {', '.join(missing)}; "
            f"it controls {', '.join(machine.freedom)}: leave free out"
        )


@dataclass(frozen=True, slots=True)
class _Part:
    """One free segment: its grid s (N+1,), and what its shape takes there, s first, but for the controls (k, N+1)."""

    shape: Shape
    s: Array
    numbers: Array
    free: Free
    speed: float | None


def _part(pieces: Sequence[Piece], segment: Any) -> _Part:
    ends = np.concatenate([[0.0], np.cumsum([piece.length for piece in pieces])])
    s = ends[-1] * (1 - np.cos(np.linspace(0, np.pi, INTERVALS + 1))) / 2
    of = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, len(pieces) - 1)
    own = np.array([np.delete(pieces[k].parameters, CONTROLS) for k in of]).T
    local = s - ends[of] + np.array([piece.start for piece in pieces])[of]
    return _Part(pieces[0].shape, s, np.concatenate([local[None], own]), segment.free, pieces[0].tool_speed)


@lru_cache(maxsize=16)
def _geometry(machine: Machine, shape: Shape) -> ca.Function:
    """(numbers of a `_Part` at a point, controls) -> q, q′, q″, cosines of the tilts."""
    numbers, controls = ca.SX.sym("numbers", 1 + shape.size - NUMBERS), ca.SX.sym("controls", NUMBERS)
    s, before = numbers[0], 1 + CONTROLS.start
    position, rotation = shape.motion(s, ca.vertcat(numbers[1:before], controls, numbers[before:]))
    q = machine.symbolic(column(position, rotation), ca.SX(machine.home_q))
    q1 = ca.jacobian(q, s)
    return ca.Function(
        "oriented", [numbers, controls], [q, q1, ca.jacobian(q1, s), machine.tilts(position, rotation)], {"cse": True}
    )


def _chosen(machine: Machine, parts: Sequence[_Part], returns: bool, objective: Objective) -> list[Array]:
    """Controls (3, DEGREE + 1) of each part: first as far inside the limits as can be, then for the objective."""
    controls = _solve(machine, parts, returns, "feasible", np.zeros((NUMBERS, len(parts))))
    if objective != "feasible":
        controls = _solve(machine, parts, returns, objective, controls)
    return [frozen(each.reshape(3, DEGREE + 1)) for each in controls.T]


def _solve(machine: Machine, parts: Sequence[_Part], returns: bool, objective: Objective, start: Array) -> Array:
    controls, slack = ca.MX.sym("controls", NUMBERS, len(parts)), ca.MX.sym("slack")
    speeds = [ca.MX.sym("speeds", INTERVALS - 1) for _ in parts]  # ṡ² between the ends, where it is 0
    at = [
        _geometry(machine, part.shape).map(INTERVALS + 1)(part.numbers, ca.repmat(controls[:, k], 1, INTERVALS + 1))
        for k, part in enumerate(parts)
    ]
    below = [_cone(part, controls[:, k]) for k, part in enumerate(parts)]
    for q, _, _, cosines in at:
        below += _inside(machine, q, cosines, slack, objective)
    cost: ca.MX = slack
    if objective == "time":
        cost = ca.MX(0)
        for part, (_, q1, q2, _), inner in zip(parts, at, speeds, strict=True):
            kept, duration = _timed(machine, part, q1, q2, inner)
            below += kept
            cost += duration
    cost += CALM * ca.sumsqr(controls) / len(parts)
    joined = [
        controls[(row + 1) * (DEGREE + 1) - 1, k] - controls[row * (DEGREE + 1), k + 1]
        for k, _ in enumerate(pairwise(parts))
        for row in range(3)
    ]
    low, high = _bounds(parts, returns)
    rows, equal = ca.vertcat(*below), ca.vertcat(*joined)
    timed = objective == "time"
    x = ca.vertcat(ca.vec(controls), slack, *(speeds if timed else []))
    count = (INTERVALS - 1) * len(parts) * timed
    solver = ca.nlpsol(
        "orient",
        "ipopt",
        {"x": x, "f": cost, "g": ca.vertcat(rows, equal)},
        {
            "ipopt": {"print_level": 0, "sb": "yes", "max_iter": ITERATIONS, "tol": 1e-7, "acceptable_tol": 1e-5},
            "print_time": False,
            "calc_lam_p": False,  # nobody asks for them, and where IPOPT gives up CasADi would warn of them
            "error_on_fail": False,
            "show_eval_warnings": False,
        },
    )
    found = solver(
        x0=np.concatenate([start.T.ravel(), [0.0 if timed else 1.0], np.full(count, 0.01)]),
        lbx=np.concatenate([low, [0.0 if timed else -np.inf], np.full(count, MOVING)]),
        ubx=np.concatenate([high, [0.0 if timed else np.inf], np.full(count, np.inf)]),
        lbg=np.concatenate([np.full(rows.numel(), -np.inf), np.zeros(equal.numel())]),
        ubg=np.zeros(rows.numel() + equal.numel()),
    )
    answer = np.asarray(found["x"]).ravel()[: NUMBERS * len(parts)]
    if not (solver.stats()["success"] and np.isfinite(answer).all()):
        if objective == "feasible":
            raise MotionError("no orientation could be found for the free segments: the solver gave up")
        return start  # what is feasible, if anything is, stays
    return answer.reshape(len(parts), NUMBERS).T


def _bounds(parts: Sequence[_Part], returns: bool) -> tuple[Array, Array]:
    """Of the controls: nothing where nothing is free, and at the ends that are given."""
    high = np.array([np.repeat([p.free.tilt, p.free.tilt, np.inf if p.free.yaw else 0.0], DEGREE + 1) for p in parts])
    ends = np.arange(3) * (DEGREE + 1)
    high[0, ends] = 0.0
    if returns:
        high[-1, ends + DEGREE] = 0.0
    return -high.ravel(), high.ravel()


def _cone(part: _Part, controls: ca.MX) -> ca.MX:
    """α² + β² within the cone at every coefficient, so everywhere between; the axis tilts by √(α² + β²) at most."""
    alpha, beta = controls[: DEGREE + 1], controls[DEGREE + 1 : 2 * (DEGREE + 1)]
    return alpha**2 + beta**2 - max(part.free.tilt, 1e-3) ** 2


def _inside(machine: Machine, q: ca.MX, cosines: ca.MX, slack: ca.MX, objective: Objective) -> list[ca.MX]:
    """At most 0 within travel and tilt: by as much less as `slack` is below 0 for what is to be made small.

    The ends keep no room: their orientation may be given, and a machine may stand at an end of its travel.
    """
    lo, hi = np.array([axis.travel for axis in machine.axes]).T
    bounded = np.flatnonzero(np.isfinite(hi))
    half = (hi - lo)[bounded] / 2
    off = (q[bounded.tolist(), :] - ca.DM((machine.home_q + lo)[bounded] + half)) / ca.DM(half)
    room = np.full(INTERVALS + 1, ROOM)
    room[[0, -1]] = -ROUNDING
    moved = slack if objective == "feasible" else 0.0
    travel = ca.DM(np.tile(1 - room, (len(bounded), 1))) + moved
    least = np.cos(np.outer(machine.max_tilt, 1 - room))
    rows = [ca.vec(off - travel), ca.vec(-off - travel), ca.vec(ca.DM(least) - cosines - moved)]
    if objective == "tilt" and cosines.numel():
        rows.append(1 - ca.vec(cosines) - slack)  # the least cosine as large as can be
    return rows


def _timed(machine: Machine, part: _Part, q1: ca.MX, q2: ca.MX, inner: ca.MX) -> tuple[list[ca.MX], ca.MX]:
    """Speed and acceleration of every axis on both sides of every interval, at most 0; and the duration (scaled)."""
    length = float(part.s[-1])
    # of limits that differ by direction the smaller: an estimate is all that is wanted
    speed = np.array([min(sides(axis.max_speed)) for axis in machine.axes])
    push = np.array([min(sides(axis.max_acceleration)) for axis in machine.axes])
    unit = np.nanmin(np.where(np.isfinite(speed), speed, np.nan)) if np.isfinite(speed).any() else 1.0
    z = ca.vertcat(0, inner, 0).T * unit**2
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
    return rows, ca.sum2(2 * step / (root[1:] + root[:-1])) * unit / length
