"""CiA 402 files: decoded here by other code, and held against the motion and the limits of its
axes.
"""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from kinematics import Axis, Body, Load, MotionError, load_machine
from planner import Line, Program, plan
from planner.export.format import ExportSource, find_format
from tests.planner.export.formats.test_streamed_formats import Swing, off_motion


def cycles_of(path):
    """Cycle time, and positions, velocity offsets and torque offsets (K, axes) of a csp file, by
    its header's words.
    """
    lines = path.read_bytes().decode("ascii").split("\n")
    assert lines.pop() == ""
    told = [line for line in lines if line[0] == "#"]
    heads, *rows = lines[len(told) :]
    each = float(re.search(r"a row every (\S+) ms", told[0])[1]) / 1e3
    table = np.array([row.split(",") for row in rows], np.int64)
    assert table[:, 0].tolist() == list(range(len(rows)))
    names = heads.split(",")[1:]
    parts = [table[:, [k + 1 for k, name in enumerate(names) if name.startswith(code)]]
             for code in ("0x607A", "0x60B1", "0x60B2")]  # fmt: skip
    return each, *parts


@pytest.mark.parametrize(("cycle", "increments"), [(0.25e-3, 1), (1e-3, 16), (4e-3, 1)])
def test_csp_positions_are_the_motion_within_half_an_increment(tmp_path, cycle, increments):
    source = resting([0.02, -0.007], 0.04, signs=[1, -1], home=[0.2, 0.0])
    done = find_format("csp")(cycle=cycle, increments=increments).write(source, tmp_path / "p.csv")
    each, q, qd, torque = cycles_of(tmp_path / "p.csv")
    assert each == cycle
    head = (tmp_path / "p.csv").read_text().split("\n")[0]
    assert head.endswith("; set 0x60C2 to it; 0x607A in increments, 0x60B1 in increments/s")
    assert not torque.size
    t = np.minimum(np.arange(len(q)) * each, np.pi)
    assert t[-1] == np.pi > t[-2]
    state = source.trajectory.at(t)
    scale = np.array([1, -1]) * increments / 1e-6
    assert abs(q - (state.q - source.machine.home_q) * scale).max() <= 0.5 + 1e-6
    assert abs(qd[1:-1] - (state.qd * scale)[1:-1]).max() <= 0.5 + 1e-6
    assert not qd[[0, -1]].any()
    # |q̈| <= 2 · reach: straight lines are off by A T²/8 and half an increment at most, and not by much less
    most = 2 * 0.02 * each**2 * increments / 1e-6
    off = off_motion(source, q / scale + source.machine.home_q, each) * increments
    assert off <= done.error * increments + 1e-6 <= most / 8 * 1.05 + 0.55
    assert abs(np.diff(q, 2, axis=0)).max() <= most + 2


class Stop(Swing):
    """The same, from rest to rest: sin² from 0 to π, at rest there and before and after."""

    knots, duration = np.linspace(0.0, np.pi, 31), np.pi


def resting(reach, acceleration, signs=(1, 1), home=(0.0, 0.0)):
    axes = tuple(
        Axis(f"axis{k}", pulse=1e-6, max_acceleration=acceleration, direction=signs[k])
        for k in range(len(reach))
    )
    home = np.array(home[: len(reach)])
    machine = SimpleNamespace(axes=axes, home_q=home, name="made up", loaded=False)
    return ExportSource("stop", machine, Stop(reach, home), None)


def test_csp_states_the_second_difference_and_the_way_between_rows(tmp_path):
    """A drive that goes along parabolas of three rows, evaluated here by Lagrange's formula, keeps
    what is stated.
    """
    source = resting([0.02, 0.01], 0.04)
    done = find_format("csp")(cycle=4e-3).write(source, tmp_path / "p.csv")
    each, q, _, _ = cycles_of(tmp_path / "p.csv")
    twice = abs(np.diff(np.concatenate([q[:1], q, q[-1:]]), 2, axis=0)).max()
    notes = " ".join(done.notes)
    stated, allowed = map(
        int, re.search(r"at most (\d+) increments a cycle² .* allow (\d+)", notes).groups()
    )
    assert stated == twice <= allowed == int(0.04 * each**2 / 1e-6 + 2)
    assert f"second difference at most {allowed} increments" in (tmp_path / "p.csv").read_text()
    straight, parabola = map(
        float, re.search(r"straight within (\S+) .* parabolas within (\S+)", notes).groups()
    )
    measured = float(re.search(r"measured along parabolas: within (\S+) ", notes)[1])
    u = np.linspace(0, 1, 41)[:, None, None]
    p = np.concatenate([q[:1], q])
    way = p[:-2] * u * (u - 1) / 2 + p[1:-1] * (1 - u**2) + p[2:] * u * (u + 1) / 2
    t = each * (np.arange(len(q) - 1) + u[..., 0])
    exact = source.trajectory.at(np.minimum(t, np.pi).ravel()).q.reshape(way.shape) / 1e-6
    off = abs(way - exact).max()
    assert off <= measured * 1.005 <= parabola + 0.01
    assert measured <= 1.1 * off + 0.05
    assert done.error <= straight * 1.01


def test_csp_torque_offsets_are_the_forces_of_the_motion(tmp_path):
    """Against m q̈: a level slide with 3 kg, in 0.1 % of the 50 mN that its motor is rated for."""
    machine = load_machine("traverser").carrying(Load(platform=Body(3.0)))
    made = plan(Program([Line([0, 0.01, 0])]), machine, order=2)
    source = ExportSource("line", machine, made.trajectory, made.pulses)
    with pytest.raises(
        MotionError,
        match=r"axis X: torque offset 0x60B2 of \d+ at 0 s, limit 32767 .* a larger rated",
    ):
        find_format("csp")(rated="0.05").write(source, tmp_path / "p.csv")
    find_format("csp")(rated="50,0.05,50,50").write(source, tmp_path / "p.csv")
    each, q, _, torque = cycles_of(tmp_path / "p.csv")
    t = np.minimum(each * np.arange(len(q)), made.trajectory.duration)
    y = machine.axes[1]
    wanted = y.direction * 3.0 * made.trajectory.at(t).qdd[:, 1] / 0.05 * 1000
    assert abs(wanted).max() > 200
    assert abs(torque[:, 1] - wanted).max() <= 0.5 + 1e-6
    assert (
        abs(abs(torque[:, 0]) - 3.0 * 9.80665 / 50 * 1000).max() <= 0.5 + 1e-6
    )  # it holds the weight


@pytest.mark.parametrize(
    ("options", "source", "told"),
    [
        ({"cycle": 0.2e-3}, resting([0.01], 1.0), "cycle 0.2 ms: must be from 0.25 to 4 ms"),
        ({"cycle": 5e-3}, resting([0.01], 1.0), "cycle 5 ms"),
        ({"increments": 0}, resting([0.01], 1.0), "increments 0 per pulse"),
        (
            {"increments": 1 << 20},
            resting([0.02], 1.0),
            r"axis0: target position 0x607A of \d+ at .* s, limit 2147483647",
        ),
        (
            {"rated": "5,6"},
            resting([0.01], 1.0),
            'rated "5,6": give one number above 0 in N or N m, or 1',
        ),
        ({"rated": "50"}, resting([0.01], 1.0), "machine made up: it states no masses"),
    ],
)
def test_csp_refuses_what_its_objects_do_not_hold(tmp_path, options, source, told):
    with pytest.raises(MotionError, match=told):
        find_format("csp")(**options).write(source, tmp_path / "p.csv")


def test_csp_of_a_plan_keeps_every_axis_limit(planned, hexapod, tmp_path):
    made = planned("bare-circle", 3)
    source = ExportSource("bare-circle", hexapod, made.trajectory, made.pulses)
    find_format("csp")().write(source, tmp_path / "p.csv")
    each, q, _, _ = cycles_of(tmp_path / "p.csv")
    exact = (
        made.trajectory.at(np.minimum(each * np.arange(len(q)), made.trajectory.duration)).q
        - hexapod.home_q
    )
    signs, pulse = (
        np.array([getattr(axis, name) for axis in hexapod.axes]) for name in ("direction", "pulse")
    )
    assert abs(q - exact * signs / pulse).max() <= 0.5 + 1e-6
    most = np.array([np.max(axis.max_acceleration) for axis in hexapod.axes]) * each**2 / pulse
    assert (abs(np.diff(q, 2, axis=0)).max(0) <= most + 2).all()
    fast = np.flatnonzero(
        (abs(np.diff(q, axis=0)) > 4 * (most + 2)).any(1)
    )  # neighbours do not hide such a step
    assert len(fast) > len(q) / 2
    for row in fast:
        assert (abs(np.diff(np.delete(q, row, 0), 2, axis=0)).max(0) > most + 2).any()
        assert (abs(np.diff(np.insert(q, row, q[row], 0), 2, axis=0)).max(0) > most + 2).any()
