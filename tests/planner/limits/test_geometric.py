"""Clearance along a path: proved over all of it, refused before solving, and measured again without
the machine.
"""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Hexapod
from planner import Arc, Infeasible, Line, Program, Trajectory, Turn, check, plan
from planner.certificate import Cells, bound_series, enclose
from planner.limits.geometric import Clearance
from planner.path.actuation import actuate
from planner.trajectory import unit_speed_trajectory

LIFTED = RigidTransform.from_components([0, 0, 0.03], Rotation.identity())
VECTOR = np.deg2rad(80) * np.array([0.05, 0.1, 1.0])
TURNED = Program([Turn(Rotation.from_rotvec(VECTOR))], start=LIFTED)
"""A turn at which neighbouring legs cross."""


@pytest.fixture(scope="module")
def loose(hexapod):
    """The hexapod with nothing but its bodies in the way."""
    axes = [replace(axis, travel=(-0.1, 0.2)) for axis in hexapod.axes]
    discs = {"base_disc": hexapod.bodies.base_disc, "platform_disc": hexapod.bodies.platform_disc}
    return Hexapod(
        hexapod.base, hexapod.platform, axes=axes, home=hexapod.home, leg_radius=0.0304, **discs
    )


def apart(first, second):
    """Least distance of two segments, each (2, 3), by bounded least squares."""
    u, v, w = first[1] - first[0], second[1] - second[0], second[0] - first[0]
    found = lsq_linear(np.stack([u, -v], 1), w, bounds=(0, 1), tol=1e-14)
    return np.sqrt(2 * found.cost)


def surfaces(own_legs, machine, pose, i, j, radius=0.0304):
    """How far apart legs i and j are: bars with round tips that end in the joints."""
    legs = own_legs(pose.translation[None], pose.rotation.as_matrix()[None])[0]
    cut = radius * legs / np.linalg.norm(legs, axis=1, keepdims=True)
    return (
        apart(
            *(
                np.stack([machine.base[k] + cut[k], machine.base[k] + legs[k] - cut[k]])
                for k in (i, j)
            )
        )
        - 2 * radius
    )


def test_legs_that_collide_are_refused_by_name_place_and_amount(loose, own_legs, limit_search):
    limit_search(0.0)
    standing = check(TURNED, loose)
    assert {no.kind for no in standing.violations} == {"clearance"}
    assert all(no.unit == "mm" and no.limit == 0.0 and no.value < 0 for no in standing.violations)
    broken = {no.axis: no for no in standing.violations if no.axis.count("leg") == 2}
    s = np.linspace(0, actuate(TURNED, loose).breaks[-1], 101)
    start = (loose.home * LIFTED).translation
    poses = [
        RigidTransform.from_components(start, Rotation.from_rotvec(share * VECTOR))
        for share in s / s[-1]
    ]
    sampled = {
        f"leg{i + 1}–leg{j + 1}": np.array(
            [surfaces(own_legs, loose, pose, i, j) for pose in poses]
        )
        for i, j in combinations(range(6), 2)
        if surfaces(own_legs, loose, poses[-1], i, j) < 0.02  # all others stay far apart
    }
    collide = {pair: values for pair, values in sampled.items() if values.min() < 0}
    assert collide, "the turn must make legs collide"
    assert collide.keys() == broken.keys()
    for pair, values in collide.items():
        worst = int(np.argmin(values))
        # 65 points are looked at in an eighth of the turn at least, 101 here in all
        assert broken[pair].value == pytest.approx(values[worst] * 1e3, abs=0.05)
        assert broken[pair].place.segment == 1
        assert broken[pair].place.s == pytest.approx(s[worst], abs=s[1])
    with pytest.raises(
        Infeasible,
        match=r"clearance -.* mm is below the 0 mm minimum at leg\d–leg\d, .*keeps .* mm more",
    ):
        plan(TURNED, loose, order=2)


def test_bars_thin_enough_pass(loose, own_legs, limit_search):
    """Refused just above the radius at which sampled poses touch, taken just below."""
    limit_search(0.0)
    start = loose.home * LIFTED
    poses = [
        RigidTransform.from_components(
            start.translation, Rotation.from_euler("z", angle, degrees=True)
        )
        for angle in np.linspace(0, 12, 60)
    ]
    turn = Program([Turn(Rotation.from_euler("z", 12, degrees=True))], start=LIFTED)

    def machine(radius):
        return Hexapod(
            loose.base,
            loose.platform,
            axes=loose.axes,
            home=loose.home,
            leg_radius=radius,
            leg_ends=0.0304,
        )

    def least(radius):
        found = []
        for pose in poses:
            legs = own_legs(pose.translation[None], pose.rotation.as_matrix()[None])[0]
            cut = 0.0304 * legs / np.linalg.norm(legs, axis=1, keepdims=True)
            ends = [
                np.stack([loose.base[k] + cut[k], loose.base[k] + legs[k] - cut[k]])
                for k in range(6)
            ]
            found.append(min(apart(ends[k], ends[(k + 1) % 6]) for k in range(6)))
        return min(found) - 2 * radius

    touch = least(0.0) / 2
    # a thousandth of the contact is what a proof may leave open, and 60 poses miss a little less
    assert not check(turn, machine(touch * (1 - 1e-4))).violations
    assert check(turn, machine(touch * (1 + 1e-3))).violations


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.floats(1e-6, 1.0))
def test_no_distance_in_a_cell_is_outside_its_enclosure(loose, seed, share):
    random = np.random.default_rng(seed)
    program = Program(
        [
            Line(random.uniform(-0.03, 0.03, 3), Rotation.from_rotvec(random.normal(0, 0.3, 3))),
            Line([0, 0, 0.03], Rotation.identity()),
        ],
        start=RigidTransform.from_components(
            [0.01, 0.02, 0.03], Rotation.from_rotvec(random.normal(0, 0.2, 3))
        ),
    )
    path = actuate(program, loose)
    piece = random.integers(0, 2, 6)
    lengths = np.diff(path.breaks)[piece]
    v, a = random.uniform(0.1, 1, 6), random.normal(0, 0.1, 6)
    walk = Trajectory(
        path, np.arange(7.0) * lengths.max(), path.breaks[piece], v, a, np.zeros(6), piece
    )
    low = random.uniform(0, 0.5, 6) * lengths / 2
    cells = Cells(np.arange(6), low, low + share * lengths / 2)
    limit = Clearance(loose)
    least, most = bound_series(limit.value(enclose(walk, cells, 6)), 6)
    for part in np.linspace(0, 1, 41):
        value = limit.value(walk.within(cells.k, cells.lo + part * (cells.hi - cells.lo)))
        assert (value >= least - 1e-15).all()
        assert (value <= most + 1e-15).all()
    # and it closes in on them: no wider than the way that a cell goes, and what it turns at the arm
    # of a joint
    way = np.abs(cells.hi - cells.lo) * (v + np.abs(a) * lengths)
    assert (
        most - least
        <= 2 * way[:, None] * (1 + path.turns.max() / np.diff(path.breaks).min()) + 1e-12
    ).all()


def test_a_distance_falls_below_both_ends_of_a_cell_by_a_square(loose):
    """The bound of a cell half as long is four times as near to the least that is met there."""
    limit, walk = Clearance(loose), unit_speed_trajectory(actuate(TURNED, loose))
    gaps = []
    for count in (16, 32, 64):
        cells = Cells(np.zeros(1, int), np.zeros(1), walk.knots[1:2]).parts(count)
        least, _ = bound_series(limit.value(enclose(walk, cells, 6)), count)
        places = (cells.lo[:, None] + (cells.hi - cells.lo)[:, None] * np.linspace(0, 1, 9)).ravel()
        met = (
            limit.value(walk.within(np.zeros(len(places), int), places))
            .reshape(count, 9, -1)
            .min(1)
        )
        gaps.append((met - least).max())
    assert gaps[0] > 3.5 * gaps[1] > 3.5**2 * gaps[2] > 0


def test_the_certificate_covers_every_sample(hexapod, own_legs):
    program = Program(
        [
            Line([0.02, 0.01, 0.03], Rotation.from_euler("XYZ", [4, -5, 6], degrees=True)),
            Arc([0, 0, 0.03], [0, 0, 1], 2.0),
            Turn(Rotation.identity()),
        ]
    )
    made = plan(program, hexapod, order=2)
    t = np.linspace(0, made.trajectory.duration, 3001)
    poses = made.trajectory.at(t).pose
    margins = hexapod.check(poses)
    use = margins.contact / (margins.clearance + margins.contact)
    proved = made.certificate.use["clearance"][made.trajectory.locate(t)]
    assert (proved >= use.max(1) - 1e-12).all()
    # a thousandth of the contact at most, and what lies between samples
    assert use.max() <= made.certificate.worst["clearance"] <= use.max() + 1.1e-3
    assert (
        made.certificate.where["clearance"].axis
        == margins.clearance_names[int(use.max(0).argmax())]
    )
    worst = np.unravel_index(int(np.argmin(margins.clearance[:, :15])), (3001, 15))
    i, j = (int(name[-1]) - 1 for name in margins.clearance_names[worst[1]].split("–"))
    assert surfaces(own_legs, hexapod, poses[int(worst[0])], i, j) == pytest.approx(
        margins.clearance[worst], abs=1e-7
    )


def test_a_machine_without_bodies_has_no_such_limit(hexapod):
    bare = Hexapod(hexapod.base, hexapod.platform, axes=hexapod.axes, home=hexapod.home)
    made = plan(Program([Line([0, 0, 0.01])]), bare, order=2)
    assert "clearance" not in made.certificate.worst
    assert "clearance" in check(Program([Line([0, 0, 0.01])]), hexapod).largest
