"""Seeded motions that cannot be: each refusal names what, whose, where, how much, and what
would make room.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from kinematics import Axis, Hexapod
from planner import Infeasible, Line, Program, check
from planner.limits import limits_of
from planner.path.polynomial import PolynomialPath
from planner.timing import Run, Task, at_speeds, solve_run

STROKE, TILT = 0.0508, np.deg2rad(12.0)


def machine(hexapod, stroke=STROKE, tilt=None):
    axes = [replace(axis, travel=(-0.2, stroke)) for axis in hexapod.axes]
    return Hexapod(
        hexapod.base, hexapod.platform, axes=axes, home=hexapod.home, max_tilt=tilt, name="own"
    )


@pytest.fixture(autouse=True)
def impatient(limit_search):
    """How far a path must shrink or move is tested in test_remedies."""
    limit_search(0.0)


def named(no, kind, axes):
    assert no.kind == kind
    assert no.axis in axes
    assert no.place is not None
    assert no.value > no.limit > 0
    assert no.relaxation == pytest.approx(no.value / no.limit)
    assert no.unit
    assert no.remedy


@pytest.mark.parametrize("seed", range(4))
def test_beyond_travel(hexapod, seed):
    rng = np.random.default_rng(seed)
    program = Program([Line([*rng.uniform(-0.012, 0.012, 2), rng.uniform(0.06, 0.085)])])
    no = check(program, machine(hexapod)).violations[0]
    named(no, "travel", {axis.name for axis in hexapod.axes})
    assert no.place.segment == 1
    assert not check(program, machine(hexapod, STROKE * no.relaxation * 1.001)).violations
    assert check(program, machine(hexapod, STROKE * no.relaxation * 0.99)).violations


@pytest.mark.parametrize("seed", range(4))
def test_beyond_tilt(hexapod, seed):
    rng = np.random.default_rng(100 + seed)
    across = rng.uniform(0.045, 0.06) * np.array(
        [np.cos(angle := rng.uniform(0, 6.28)), np.sin(angle)]
    )
    program = Program([Line([*across, rng.uniform(0.0, 0.02)])])
    wide = machine(hexapod, 0.2, TILT)
    no = check(program, wide).violations[0]
    named(no, "tilt", set(wide.tilt_names))
    assert not check(program, machine(hexapod, 0.2, TILT * no.relaxation * 1.001)).violations
    assert check(program, machine(hexapod, 0.2, TILT * no.relaxation * 0.99)).violations


@pytest.mark.parametrize(("seed", "order"), [*((seed, 2) for seed in range(6)), (0, 3), (1, 3)])
def test_too_fast_at_an_end(seed, order):
    """A speed beyond what a random curve, or the way to its other end, allows."""
    rng = np.random.default_rng(200 + seed)
    points = np.cumsum(rng.uniform(0.2, 1.0, (4, 2)), axis=0)
    spline = CubicSpline(np.arange(4.0), points, bc_type="natural")
    path = PolynomialPath(spline.x, spline.c, ["x", "y"])
    axes = [
        Axis(name, max_speed=2.0, max_acceleration=rng.uniform(0.5, 2), max_jerk=20.0)
        for name in path.names
    ]
    limits = limits_of(path, axes, order)
    asked, end = rng.uniform(5, 20), int(rng.integers(2))

    def tried(speed):
        return solve_run(
            Task(
                path,
                limits,
                Run(0, 2, at_speeds(*((speed, 0.0) if end == 0 else (0.0, speed)))),
                order,
            )
        ).require_profile()

    with pytest.raises(Infeasible) as refused:
        tried(asked)
    no = refused.value
    named(no, ("start speed", "end speed")[end], {"path"})
    assert no.place.s == (0.0, 3.0)[end]
    tried(asked / (no.relaxation * 1.001))
    with pytest.raises(Infeasible):
        tried(asked / (no.relaxation * 0.99))
