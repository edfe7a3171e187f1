"""Bad input to machines: one clear MotionError that names what and where, whatever the kind."""

from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import (
    Axis,
    Disc,
    Hexapod,
    MotionError,
    OutOfReach,
    Traverser,
    Tripod,
    joint_circle,
    load_machine,
    workspace,
)
from kinematics.foundation.arrays import finite_array

BASE, PLATFORM = joint_circle(0.2, 0.4, 0.0), joint_circle(0.12, 1.2, 0.0)
HOME = RigidTransform.from_translation([0, 0, 0.3])
AXES = [Axis(f"leg{n}") for n in range(1, 7)]
ARMS = [Axis(f"arm{n}") for n in range(1, 4)]
SLIDES = [Axis("X"), Axis("Y"), Axis("Z"), Axis("R", kind="rotary")]
RAGGED = [[1, 2, 3], [1, 2]]


def hexapod(base=BASE, platform=PLATFORM, **options):
    return Hexapod(base, platform, **({"axes": AXES, "home": HOME, "name": "mine"} | options))


def tripod(base=BASE[::2], platform=PLATFORM[::2], **options):
    return Tripod(base, platform, **({"axes": ARMS, "home": HOME, "name": "mine"} | options))


def traverser(**options):
    return Traverser(**({"axes": SLIDES, "home": HOME, "name": "mine"} | options))


# arrays


@given(
    st.sampled_from(
        [
            "a",
            1j,
            RAGGED,
            [[None] * 3] * 6,
            HOME,
            np.nan * BASE,
            1j * BASE,
            BASE[:5, :2],
            np.full((6, 3), 9.0),
        ]
    )
)
def test_what_are_no_such_numbers_is_told(values):
    with pytest.raises(
        MotionError, match=r"^points must be finite numbers \(N, 3\) or \(6, 3\) .* at most 8, not "
    ):
        finite_array(values, "points", (None, 3), (6, 3), unit="m", least=0, most=8)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: hexapod(base=[["a"] * 3] * 6), "mine: base must be finite numbers .6, 3. in m"),
        (lambda: hexapod(platform=RAGGED * 3), "mine: platform must be finite numbers .6, 3. in m"),
        (lambda: hexapod(base=1j * BASE), "mine: base must be finite numbers .6, 3. in m"),
        (lambda: hexapod(home=None), "mine: home must be a pose: a scipy"),
        (lambda: hexapod(home=np.eye(4)), "mine: home must be a pose: a scipy"),
        (lambda: hexapod(home=Rotation.identity()), "mine: home must be a pose: a scipy"),
        (lambda: traverser(home=None), "mine: home must be a pose: a scipy"),
        (
            lambda: traverser(home=RigidTransform.from_translation(np.zeros((0, 3)))),
            "mine: home must be one pose, not 0",
        ),
        (lambda: hexapod(axes=None), "mine: axes must be 6 of Axis, not None"),
        (lambda: hexapod(axes=["a"] * 6), "mine: axes must be 6 of Axis, not 'a'"),
        (
            lambda: hexapod(axes=[Axis(f"a{k}", kind="rotary") for k in range(6)]),
            "a0 is rotary; a hexapod has a linear",
        ),
        (lambda: traverser(axes=[*SLIDES[:3], Axis("R")]), "R is linear; a traverser has a rotary"),
        (lambda: hexapod(name=5), "needs a name"),
        (lambda: traverser(name=""), "needs a name"),
        (
            lambda: hexapod(max_tilt="45 deg"),
            "mine: max_tilt .*must be one finite number in rad .*not '45 deg'",
        ),
        (lambda: hexapod(max_tilt=(1, "a")), "mine: max_tilt .*must be .*not 'a'"),
        (lambda: hexapod(max_tilt=np.ones(12)), "mine: max_tilt .*must be one angle or"),
        (lambda: hexapod(base_rest="z"), "mine: base_rest must be"),
        (
            lambda: hexapod(base_rest=[0, 0, 1e-320]),
            "mine: base_rest .*must be a direction, not zero",
        ),
        (lambda: hexapod(leg_radius="a"), "leg_radius must be .*not 'a'"),
        (lambda: hexapod(leg_radius=0.01, base_disc=5), "base_disc must be a Disc, not 5"),
        (
            lambda: tripod(platform_disc="a", leg_radius=0.01),
            "platform_disc must be a Disc, not 'a'",
        ),
        (lambda: Disc("a", 0.1), "radius must be .*not 'a'"),
        (lambda: Disc(None, 0.1), "radius must be .*not None"),
        (lambda: Disc(0.1, 0.1, centre=RAGGED), "centre must be finite numbers"),
        (
            lambda: tripod(platform=PLATFORM[:3, :2]),
            "mine: platform must be finite numbers .3, 3. in m, not of shape .3, 2.",
        ),
        (lambda: tripod(tool="abc"), "mine: tool must be finite numbers"),
        (lambda: traverser(directions=RAGGED), "mine: directions must be finite numbers"),
        (lambda: traverser(length="a"), "mine: length must be .*not 'a'"),
        (
            lambda: hexapod().check(RigidTransform.from_translation(np.zeros((0, 3)))).worst(),
            "margins of no poses",
        ),
        (lambda: hexapod().forward(["a"] * 6), "mine: forward takes finite coordinates"),
        (lambda: hexapod().forward(RAGGED), "mine: forward takes finite coordinates"),
        (
            lambda: hexapod().forward(hexapod().home_q, hexapod().home_q),
            "mine: near must be a pose: a scipy",
        ),
        (lambda: traverser().inverse(HOME, HOME), "mine: near must be finite numbers .4,."),
        (lambda: traverser().inverse(HOME, "a"), "mine: near must be finite numbers .4,."),
        (lambda: workspace(hexapod(), cells=2.5), "cells is 2.5; expected a whole number"),
        (
            lambda: workspace(hexapod(), x=(0, 1, 2)),
            "x, held or from low to high, must be finite numbers",
        ),
        (lambda: workspace(hexapod(), x="a"), 'x is "a"; expected a tuple or a number'),
        (lambda: workspace(hexapod(), rotation=np.eye(3)), "rotation is array"),
        (
            lambda: workspace(hexapod(), rotation=Rotation.identity(2)),
            "mine: the workspace's rotation must be one",
        ),
        (
            lambda: workspace(hexapod(), x=0, y=0, z=0.3, cells=1).contains("a", [0, 0, 0]),
            "low must be finite numbers",
        ),
    ],
)
def test_what_makes_no_machine_or_no_question_is_refused(make, told):
    with pytest.raises(MotionError, match=told):
        make()


def test_what_a_caller_may_well_give_is_taken():
    """Sequences of any kind, axes from a generator, and directions however long they are."""
    machine = hexapod(
        base=BASE.tolist(),
        axes=(axis for axis in AXES),
        max_tilt=[1, None],
        base_rest=[0, 0, 1e200],
        platform_rest=(0, 0, 1e-200),
    )
    assert machine.axes == tuple(AXES)
    assert machine.max_tilt.tolist() == [1.0] * 6 + [np.pi] * 6
    assert machine.base_rest.tolist() == machine.platform_rest.tolist() == [[0, 0, 1]] * 6


def test_two_axes_on_one_channel_are_named():
    def wired(*channels):
        return [Axis(f"arm{n}", card="one", channel=channel) for n, channel in enumerate(channels)]

    with pytest.raises(MotionError, match="mine: arm0 and arm2 are both on channel 1 of card one"):
        tripod(axes=wired(1, 0, 1))
    tripod(axes=wired(1, 0, 2))
    tripod(axes=[*wired(1, 0), Axis("other", card="two", channel=1)])


# joints that coincide


def moved(points, **changed):
    points = points.copy()
    for k, point in changed.items():
        points[int(k[1:])] = point
    return points


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (
            lambda: hexapod(moved(BASE, _1=BASE[0]), moved(PLATFORM, _1=PLATFORM[0])),
            "leg1 and leg2 coincide",
        ),
        (lambda: hexapod(base=np.zeros((6, 3))), "all base joints are the same point"),
        (lambda: hexapod(platform=np.full((6, 3), 0.1)), "all platform joints are the same point"),
        (lambda: tripod(base=np.zeros((3, 3))), "all base joints are the same point"),
        (
            lambda: tripod(moved(BASE[::2], _1=BASE[0]), moved(PLATFORM[::2], _1=PLATFORM[0])),
            "arm1 and arm2 coincide",
        ),
        # parallel arms of the same length: the plate, which does not turn, is held by two of them
        # alone
        (
            lambda: tripod(
                moved(BASE[::2], _1=BASE[0] + 0.01), moved(PLATFORM[::2], _1=PLATFORM[0] + 0.01)
            ),
            "home is singular .*: arm1, arm2 tog",
        ),
        (lambda: hexapod(moved(BASE, _3=PLATFORM[3] + [0, 0, 0.3])), "leg4 has no length at home"),
        (
            lambda: hexapod(np.arange(6)[:, None] * [0.1, 0, 0]),
            "home is singular .*leg1, leg2, leg3, leg4, leg5, leg6",
        ),
        (lambda: hexapod(platform=BASE / 2), "home is singular"),
        (
            lambda: hexapod(home=RigidTransform.identity()),
            "home is singular",
        ),  # all legs in one plane
    ],
)
def test_joints_that_coincide_are_refused(make, told):
    with pytest.raises(MotionError, match=f"machine mine: {told}"):
        make()


def test_the_legs_that_a_singular_home_does_not_need_are_not_blamed():
    """Three legs that meet in one point in one plane; the other three stand free."""
    base, platform = BASE.copy(), PLATFORM.copy()
    meeting = np.array([0.0, 0.0, 0.8])
    for k, angle in enumerate((-0.2, 0.0, 0.3)):
        way = np.array([np.sin(angle), 0, -np.cos(angle)])
        base[k], platform[k] = meeting + 0.9 * way, meeting + 0.5 * way - [0, 0, 0.3]
    with pytest.raises(MotionError, match="leg1, leg2, leg3 together leave"):
        hexapod(base, platform)


def test_joints_may_meet_at_one_end():
    """As on Stewart's platform and on the Mini Tetra."""
    paired = moved(BASE, _1=BASE[0], _3=BASE[2], _5=BASE[4])
    assert hexapod(paired).check(HOME).conditioning > 0.01


def test_a_file_s_gaps_of_zero_are_refused(tmp_path):
    text = (files("kinematics") / "presets" / "hexapod.toml").read_text(encoding="utf-8")
    path = tmp_path / "rig.toml"
    for gaps, told in (((0, 0), "leg1 and leg6 coincide"), ((0, 60), None), ((120, 60), None)):
        base, platform = gaps
        path.write_text(
            text.replace('base_gap = "30 deg"', f'base_gap = "{base} deg"').replace(
                'platform_gap = "60 deg"', f'platform_gap = "{platform} deg"'
            ),
            encoding="utf-8",
        )
        if told:
            with pytest.raises(MotionError, match=told):
                load_machine(path)
        else:
            assert load_machine(path).axes


# poses


def doubled(machine):
    matrix = machine.home.as_matrix()
    matrix[:3, :3] *= 2
    return RigidTransform(matrix, normalize=False)


def mirrored(machine):
    matrix = machine.home.as_matrix()
    matrix[:3, 2] *= -1
    return RigidTransform(matrix, normalize=False)


def unnormalised(machine):
    return RigidTransform.from_rotation(
        Rotation(2 * machine.home.rotation.as_quat(), normalize=False)
    )


QUESTIONS = {
    "inverse": lambda machine, pose: machine.inverse(pose),
    "jacobian": lambda machine, pose: machine.jacobian(pose),
    "check": lambda machine, pose: machine.check(pose),
    "forward": lambda machine, pose: machine.forward(machine.home_q, near=pose),
}


@pytest.mark.parametrize("question", QUESTIONS)
def test_what_is_no_pose_is_refused(machine, question):
    ask = QUESTIONS[question]
    nothing = () if question == "forward" else (None,)  # there it is home
    for pose in (*nothing, np.eye(4), [0, 0.3], "home", Rotation.identity(), np.zeros(7)):
        with pytest.raises(
            MotionError, match=f"machine {machine.name}: (pose|near) must be a pose: a scipy"
        ):
            ask(machine, pose)
    for make, told in (
        (doubled, "R Rᵀ is 3 off"),
        (mirrored, "mirrored"),
        (unnormalised, "R Rᵀ is 15 off"),
    ):
        with pytest.raises(
            MotionError, match=f"machine {machine.name}: (pose|near) 0 has a rotation .*{told}"
        ):
            ask(machine, make(machine))
    matrix = np.stack([machine.home.as_matrix()] * 2)
    for place in ((1, 0, 3), (1, 0, 0)):
        lost = matrix.copy()
        lost[place] = np.nan
        if question != "forward":
            with pytest.raises(OutOfReach, match=f"machine {machine.name}: pose 1 must be finite"):
                ask(machine, RigidTransform(lost, normalize=False))


def test_rounding_is_no_fault(machine):
    """A thousand turns put together leave 1e-15; a matrix printed to ten digits is a pose."""
    matrix = machine.home.as_matrix()
    assert machine.inverse(RigidTransform(np.round(matrix, 10), normalize=False)) == pytest.approx(
        machine.home_q, abs=1e-8
    )


def test_jacobian_refuses_what_inverse_refuses(machine):
    far = RigidTransform.from_components(
        [1e3, 1e3, 1e3], Rotation.from_rotvec([0.1, 0.2, 0.3]) * machine.home.rotation
    )
    try:
        machine.inverse(far)
    except OutOfReach as error:
        with pytest.raises(OutOfReach, match="^" + str(error)[:40]):
            machine.jacobian(far)
    else:
        assert np.isfinite(machine.jacobian(far)).all()
