"""COPP's own test of torque limits, ours certified at order 3 beside copp-py: `python -m
benchmarks.evidence.peers.franka FILE`.

FILE is `tests/test_franka.rs` of COPP's sources: a quintic through eleven waypoints of a seven-axis arm, under limits
on speed, acceleration, jerk and torque. Read from it are the waypoints, the limits and the arm's identified parameters:
per link the inertia about its origin (6), mass times centre of mass (3), mass, Coulomb friction and offset. The torques
that follow are written anew here (Newton and Euler, in link frames), as expressions that the certificate encloses.
Friction turns with a joint's direction: a motion is held against it with the sign that the joint's speed has, against
both where it may have either. Times are processor time, from the path on; copp-py asks for torques through its Python
callback, and linearises as often as its test does.
"""

import re
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from time import process_time
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import make_interp_spline

from benchmarks.evidence.peers.case import Case, is_installed, sample_order3, worst
from benchmarks.evidence.published.compared import markdown
from kinematics.foundation.arrays import Array
from kinematics.foundation.casadi_function import Expression
from kinematics.machine.axis import Axis
from planner.limits import limits_of
from planner.limits.limit import Limit, LimitState, Quantity, Rows, Term
from planner.path.actuation import Points
from planner.path.polynomial import PolynomialPath, cut_sections, join_sections
from planner.time_optimal import polynomials
from planner.timing.certified_solve import certified_solve

JOINTS, LINK_NUMBERS = 7, 12
GRAVITY = 9.81
# From each link's frame to the next: along x, along z, about x [Craig's convention], of the arm's data sheet.
FRAMES = (
    (0.0, 0.333, 0.0), (0.0, 0.0, -np.pi / 2), (0.0, 0.316, np.pi / 2), (0.0825, 0.0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2), (0.0, 0.0, np.pi / 2), (0.088, 0.0, np.pi / 2),
)  # fmt: skip
INTERVALS, LINEARISATIONS, INSTANTS = 1000, 3, 20_001


@dataclass(frozen=True)
class ArmTest:
    """Waypoints (N, 7), limits (7,) on speed, acceleration, jerk and torque, and the links' numbers (7, 12)."""

    waypoints: Array
    limits: tuple[Array, Array, Array, Array]
    links: Array

    @staticmethod
    def read(path: Path) -> "ArmTest":
        text = path.read_text(encoding="utf-8")

        def numbers(begin: str, end: str) -> Array:
            return np.array([float(one) for one in re.findall(r"-?\d+\.\d+(?:[eE]-?\d+)?", _between(text, begin, end))])

        links = np.zeros(JOINTS * LINK_NUMBERS)
        for place, value in re.findall(r"\((\d+), (-?[\d.eE-]+)\)", _between(text, "FRANKA_NONZERO_PARAMS: ", "];")):
            links[int(place)] = float(value)
        speed, acceleration, jerk, torque = (numbers(f"const {name}MAX: [f64; FRANKA_DOF] = ", "];") for name in "VAJT")
        waypoints = numbers("let waypoints: &[[f64; FRANKA_DOF]] = ", "];").reshape(-1, JOINTS)
        return ArmTest(waypoints, (speed, acceleration, jerk, torque), links.reshape(JOINTS, LINK_NUMBERS))

    @cached_property
    def path(self) -> PolynomialPath:
        """Over [0, 1], at rest and without curvature at both ends."""
        still = [(1, np.zeros(JOINTS)), (2, np.zeros(JOINTS))]
        ends: Any = (still, still)  # which the stubs of SciPy do not know
        spline = make_interp_spline(np.linspace(0, 1, len(self.waypoints)), self.waypoints, k=5, bc_type=ends)
        drawn = polynomials(spline)
        real = np.diff(drawn.x) > 0
        breaks, names = np.append(drawn.x[:-1][real], drawn.x[-1]), [f"joint{k + 1}" for k in range(JOINTS)]
        return PolynomialPath(breaks, drawn.c[:, real], names)

    @cached_property
    def case(self) -> Case:
        speed, acceleration, jerk, _ = (bound.tolist() for bound in self.limits)
        axes = [
            Axis(name, kind="rotary", max_speed=v, max_acceleration=a, max_jerk=j)
            for name, v, a, j in zip(self.path.names, speed, acceleration, jerk, strict=True)
        ]
        return Case("arm", self.path, tuple(axes))

    @cached_property
    def torques(self) -> Expression:
        """q, q̇, q̈ → the torques (7,) without Coulomb friction."""
        inputs = ca.SX.sym("x", 3 * JOINTS)
        return Expression("torques", inputs, self._inverse(inputs))

    def _inverse(self, x: ca.SX) -> ca.SX:
        """[Craig, Introduction to Robotics, 6.5], about the links' origins, where l is mass times centre of mass.

        F = m a + ẇ × l + w × (w × l) and N = L ẇ + w × L w + l × a, with L the inertia about the origin.
        """
        q, qd, qdd = x[:JOINTS], x[JOINTS : 2 * JOINTS], x[2 * JOINTS :]
        up = ca.DM([0, 0, 1])
        w, turn, rise = ca.SX.zeros(3), ca.SX.zeros(3), ca.SX([0, 0, GRAVITY])
        frames, loads = [], []
        for k, (along, lift, twist) in enumerate(FRAMES):
            c, s, ct, st = ca.cos(q[k]), ca.sin(q[k]), round(np.cos(twist), 12), round(np.sin(twist), 12)
            rotation = ca.vertcat(ca.horzcat(c, -s, 0), ca.horzcat(s * ct, c * ct, -st), ca.horzcat(s * st, c * st, ct))
            origin = ca.DM([along, -lift * st, lift * ct])
            rise = rotation.T @ (rise + ca.cross(turn, origin) + ca.cross(w, ca.cross(w, origin)))
            carried = rotation.T @ w
            turn = rotation.T @ turn + ca.cross(carried, up * qd[k]) + up * qdd[k]
            w = carried + up * qd[k]
            xx, xy, xz, yy, yz, zz, lx, ly, lz, mass, _, _ = self.links[k].tolist()
            inertia, first = ca.DM([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), ca.DM([lx, ly, lz])
            force = mass * rise + ca.cross(turn, first) + ca.cross(w, ca.cross(w, first))
            moment = inertia @ turn + ca.cross(w, inertia @ w) + ca.cross(first, rise)
            frames.append((rotation, origin))
            loads.append((force, moment))
        torque = [ca.SX(0)] * JOINTS
        force, moment = ca.SX.zeros(3), ca.SX.zeros(3)
        for k in reversed(range(JOINTS)):
            own_force, own_moment = loads[k]
            force, moment = own_force + force, own_moment + moment
            torque[k] = moment[2] + self.links[k, 11]
            rotation, origin = frames[k]
            force = rotation @ force
            moment = rotation @ moment + ca.cross(origin, force)
        return ca.vertcat(*torque)

    def torque(self, q: Array, qd: Array, qdd: Array) -> Array:
        """With Coulomb friction (N, 7)."""
        found = self.torques(np.concatenate([q, qd, qdd], 1)) + self.links[:, 10] * np.sign(qd)
        return np.asarray(found)


def _between(text: str, begin: str, end: str) -> str:
    return text.partition(begin)[2].partition(end)[0]


class Torque(Limit):
    """|τ + f sign q̇| ≤ T. Channels: each joint's speed, then its torque with the friction of either direction."""

    name = "torque"
    terms = frozenset({Term.ONE, Term.SDD, Term.SD2})

    def __init__(self, test: ArmTest) -> None:
        self.test = test
        self.joint = np.repeat(np.arange(JOINTS), 3)
        self.way = np.tile([0.0, 1.0, -1.0], JOINTS)  # 0: the speed itself
        self.bounds = np.where(self.way == 0, np.inf, test.limits[3][self.joint])
        self.friction = self.way * test.links[self.joint, 10]
        self.channels = tuple(test.path.names[k] for k in self.joint)
        self.units = tuple((("N m", 1.0) if way else ("deg/s", 180 / np.pi)) for way in self.way)

    def value(self, motion: LimitState) -> Quantity:
        torque = motion.evaluate(self.test.torques, motion.q, motion.qd, motion.qdd)
        turns = np.abs(self.way)
        return torque[:, self.joint] * turns + motion.qd[:, self.joint] * (1 - turns) + self.friction

    def use(self, low: Array, high: Array, piece: np.ndarray) -> Array:
        speed = np.flatnonzero(self.way == 0)[self.joint]
        missed = np.where(self.way > 0, high[:, speed] < 0, low[:, speed] > 0) | (self.way == 0)
        return np.where(missed, 0.0, np.maximum(np.abs(low), np.abs(high)) / self.bounds)

    def rows(self, points: Points) -> Rows:
        q, q1, q2, *_ = points.derivatives
        none = np.zeros_like(q)
        held, pushed, carried = (
            self.test.torques(np.concatenate([q, *rates], 1))[:, self.joint]
            for rates in ((none, none), (none, q1), (q1, q2))
        )
        counts = (self.way != 0) & (q1[:, self.joint] * self.way >= 0)
        terms = {Term.ONE: held + self.friction, Term.SDD: pushed - held, Term.SD2: carried - held}
        return Rows(terms, np.where(counts, self.bounds, np.inf))


HEADER = ("method", "time (s)", "duration (s)", "speed", "acceleration", "jerk", "torque", "slowed to hold (s)")


def solve_ours(test: ArmTest, *, bounded: bool = True) -> list[str]:
    """Certified, with the torque limit or without."""
    begin = process_time()
    path = join_sections([part.resting for part in cut_sections(test.path, 3)])
    limits = [limit for limit in limits_of(path, test.case.axes, 3) if not limit.geometric]
    found = certified_solve(path, [*limits, Torque(test)] if bounded else limits, 3)
    took = process_time() - begin
    state = found.trajectory.at(np.linspace(0, found.trajectory.duration, INSTANTS))
    values = state.qd, state.qdd, state.qddd, test.torque(state.q, state.qd, state.qdd)
    use = [float((np.abs(value) / bound).max()) for value, bound in zip(values, test.limits, strict=True)]
    name = (
        f"ours, {'certified' if found.certificate.holds else 'not certified'}{'' if bounded else ', no torque limit'}"
    )
    return _cells(name, took, found.trajectory.duration, use)


def solve_theirs(test: ArmTest) -> list[str]:
    """As COPP's test does: TOPP2-RA, then three linearisations of its order-3 cone programme, on 1001 points."""
    import copp_py
    from copp_py.clarabel import ClarabelOptions

    case, share = test.case, np.linspace(0.0, 1.0, INTERVALS + 1)
    count, (speed, acceleration, jerk, torque) = len(share), test.limits
    begin = process_time()
    q, q1, q2, q3 = case.path.derivatives(share, case.piece(share))
    robot = copp_py.Robot(JOINTS, capacity=count)
    robot.set_inverse_dynamics(lambda q, qd, qdd: test.torque(*(np.asarray(one)[None] for one in (q, qd, qdd)))[0])
    robot.append_s(share)
    robot.set_q(q, q1, q2, 0, dddq=q3)
    robot.add_velocity_limits(speed, -speed, start_idx_s=0, length=count)
    robot.add_acceleration_limits(acceleration, -acceleration, start_idx_s=0, length=count)
    robot.add_jerk_limits(jerk, -jerk, start_idx_s=0, length=count)
    robot.add_torque_limits(torque, -torque, start_idx_s=0, length=count)
    ra, socp = copp_py.solver.topp2_ra, copp_py.solver.topp3_socp
    a = ra.solve(ra.Problem(robot.constraints, idx_s_interval=(0, INTERVALS), a_boundary=(0.0, 0.0)), ra.Options())
    for _ in range(LINEARISATIONS):
        problem = socp.Problem(robot.constraints, a, a_boundary=(0.0, 0.0), b_boundary=(0.0, 0.0), num_stationary_max=1)
        profile = socp.solve(problem, ClarabelOptions())
        a = profile.a
    took = process_time() - begin
    duration = float(copp_py.interpolation.s_to_t_topp3(share, profile)[0])
    samples = sample_order3(case, share, profile)
    q, q1, q2, _ = case.path.derivatives(samples.s, samples.piece)
    v, push = samples.v[:, None], samples.a[:, None]
    used = np.abs(test.torque(q, q1 * v, q1 * push + q2 * v**2)) / torque
    return _cells("copp-py TOPP3-SOCP", took, duration, [*worst(case, samples), float(used.max())])


def _cells(name: str, took: float, duration: float, use: Sequence[float]) -> list[str]:
    """Slowed to hold: speed, acceleration and jerk. Torque is not counted: what only holds does not fall with speed."""
    slowness = max(1.0, *(one**power for one, power in zip(use[:3], (1.0, 0.5, 1 / 3), strict=True)))
    return [name, f"{took:.2f}", f"{duration:.6f}", *(f"{one:.6f}" for one in use), f"{duration * slowness:.6f}"]


def main() -> None:
    parser = ArgumentParser(prog="python -m benchmarks.evidence.peers.franka", description=__doc__)
    parser.add_argument("suite", type=Path, help="tests/test_franka.rs of COPP's sources")
    test = ArmTest.read(parser.parse_args().suite)
    solve_ours(test)  # what is loaded and compiled once is no part of a solve
    rows = [solve_ours(test), solve_ours(test, bounded=False)]
    if is_installed("copp_py"):
        rows.append(solve_theirs(test))
    print(markdown(HEADER, rows))


if __name__ == "__main__":
    main()
