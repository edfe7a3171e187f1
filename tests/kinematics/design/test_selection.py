import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform

from kinematics import (
    Actuator,
    ActuatorNeed,
    AxisMotion,
    Joint,
    JointNeed,
    MotionError,
    actuator_need,
    forces,
    joint_need,
    load_actuators,
    load_joints,
    load_machine,
    motion_of_poses,
    select_parts,
)

CHAPTER_2 = ActuatorNeed(stroke=47.58e-3, force=54.563)
"""What [Sahbaz 2007, chapter 2] asks for."""


def names(selection):
    return [choice.part.name for choice in selection.feasible]


def test_the_thesis_choice_comes_first():
    found = select_parts(load_actuators(), CHAPTER_2)
    assert names(found) == [
        "HSI",
        "Ultra Motion",
        "PI",
        "Servoram",
        "Linmot",
        "Iai",
    ]  # prices, then no price by reserve
    reasons = {refusal.part.name: refusal.reasons for refusal in found.refused}
    assert reasons == {
        "Oriental": ("stroke 40 mm < 47.58 mm",),
        "Intelidrives": ("stroke not stated, 47.58 mm needed",),
    }
    assert "cheapest first" in str(found)


def test_every_reason_is_given():
    need = ActuatorNeed(stroke=0.06, speed=0.1, force=100, precision=1e-6)
    refused = {
        refusal.part.name: refusal.reasons
        for refusal in select_parts(load_actuators(), need).refused
    }
    assert refused["Ultra Motion"] == (
        "stroke 50.8 mm < 60 mm", "speed 80 mm/s < 100 mm/s", "precision 10 um > 1 um",
    )  # fmt: skip
    assert set(refused) == {part.name for part in load_actuators()} - set(
        names(select_parts(load_actuators(), need))
    )


@pytest.mark.parametrize(
    ("by", "expected"),
    [
        ("mass", ["HSI", "Iai", "PI", "Linmot", "Servoram", "Ultra Motion"]),
        ("precision", ["PI", "HSI", "Ultra Motion", "Iai", "Linmot", "Servoram"]),
        ("reserve", ["Linmot", "Servoram", "Ultra Motion", "HSI", "Iai", "PI"]),
    ],
)
def test_other_criteria(by, expected):
    found = names(select_parts(load_actuators(), CHAPTER_2, by))
    if by == "reserve":  # the two with strokes of 50.8 mm and of 50 mm tie
        assert [found[0], found[1], set(found[2:4]), set(found[4:])] == [
            expected[0], expected[1], set(expected[2:4]), set(expected[4:]),
        ]  # fmt: skip
    else:
        assert found == expected


some = st.one_of(st.none(), st.floats(1e-3, 1e3))


@given(
    st.lists(st.tuples(some, some, some, some), min_size=1, max_size=8),
    st.tuples(some, some, some, some).filter(any),
)
def test_a_part_is_feasible_exactly_if_it_offers_everything(parts, needed):
    need = ActuatorNeed(*needed)
    catalogue = [
        Actuator(f"{k}", k, stroke=stroke, speed=speed, force=force, precision=precision)
        for k, (stroke, speed, force, precision) in enumerate(parts)
    ]

    def does(part):
        at_least = all(
            getattr(need, name) is None
            or (getattr(part, name) is not None and getattr(part, name) >= getattr(need, name))
            for name in ("stroke", "speed", "force")
        )
        return at_least and (
            need.precision is None
            or (part.precision is not None and part.precision <= need.precision)
        )

    found = select_parts(catalogue, need, "reserve")
    assert set(names(found)) == {part.name for part in catalogue if does(part)}
    assert len(found.feasible) + len(found.refused) == len(catalogue)
    reserves = [choice.reserve for choice in found.feasible]
    assert reserves == sorted(reserves, reverse=True)
    assert all(reserve >= 1 for reserve in reserves)
    assert all(refusal.reasons for refusal in found.refused)


def test_joints_by_tilt_and_force():
    found = select_parts(load_joints(), JointNeed(tilt=np.deg2rad(35), force=220))
    assert names(found) == ["Hephaist SRJ008C"]
    assert found.feasible[0].reserve == pytest.approx(45 / 35)
    assert select_parts(load_joints(), JointNeed(force=600)).feasible == ()
    assert names(select_parts([Joint("a", 1, tilt=0.5)], JointNeed(tilt=0.5))) == ["a"]


def test_need_of_motions_is_of_all_together():
    """One mounting serves all motions: ranges join before they are measured."""
    first = AxisMotion(
        [[0.0, 0.0], [0.01, 0.002]], [[0.1, 0.0], [0.0, -0.3]], [[5.0, 1.0], [1.0, -7.0]]
    )
    second = AxisMotion([[-0.02, 0.0]], [[0.2, 0.0]], [[6.0, 0.0]])
    need = actuator_need([first, second], precision=1e-6)
    assert need.stroke == pytest.approx(0.03)
    assert (need.speed, need.force, need.precision) == (0.3, 7.0, 1e-6)
    assert actuator_need([AxisMotion(first.q, first.qd)]).force is None


def test_joint_need_agrees_with_the_margins(preset):
    from scipy.spatial.transform import RigidTransform, Rotation

    pose = preset.home * RigidTransform.from_components(
        [[0, 0, 0.02]] * 2, Rotation.from_euler("x", [[0.0], [0.1]])
    )
    need = joint_need(preset, pose, force=[[-30.0, 12.0]])
    assert need.tilt == pytest.approx(preset.check(pose).tilt.max() * np.deg2rad(35), rel=1e-12)
    assert need.force == 30.0


def _motion(**changed):
    return AxisMotion(**{"q": [[0.0]], "qd": [[0.0]], **changed})


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: ActuatorNeed(stroke=-1.0), "needed stroke -1000 mm"),
        (lambda: ActuatorNeed(force=float("nan")), "needed force must be one finite number"),
        (lambda: JointNeed(tilt=0.0), "needed tilt 0 deg"),
        (lambda: select_parts(load_actuators(), ActuatorNeed()), "no requirement"),
        (lambda: select_parts(load_actuators(), CHAPTER_2, "price"), 'no criterion "price"'),
        (lambda: select_parts(load_actuators(), JointNeed(tilt=0.1)), "actuators have no tilt"),
        (lambda: _motion(q=[[np.nan]]), "q must be finite"),
        (lambda: _motion(qd=[[0.0, 1.0]]), r"qd is \(1, 2\), q is \(1, 1\)"),
        (lambda: actuator_need([]), "at least one motion"),
        (lambda: actuator_need([_motion(), _motion(force=[[1.0]])]), "1 of 2 motions have forces"),
    ],
)
def test_bad_needs(wrong, message):
    with pytest.raises(MotionError, match=message):
        wrong()


def test_catalogue_of_the_machine_that_was_built():
    """The preset's actuator is the one selected: its stroke and force are those of the
    catalogue.
    """
    chosen = select_parts(load_actuators(), CHAPTER_2).feasible[0].part
    axis = load_machine("hexapod").axes[0]
    assert (chosen.stroke, chosen.force) == (axis.travel[1], axis.max_force)


@pytest.mark.parametrize(
    ("stroke", "does"), [(50.8e-3, True), (np.nextafter(50.8e-3, 1), True), (50.801e-3, False)]
)
def test_a_stroke_that_is_needed_exactly_is_offered(stroke, does):
    """One unit of the last place is the rounding of max − min, not a longer stroke."""
    part = Actuator("exact", 1, stroke=50.8e-3)
    assert bool(select_parts([part], ActuatorNeed(stroke=stroke)).feasible) is does


def test_motions_and_forces_say_what_they_need_themselves():
    machine = load_machine("hexapod")
    pose = machine.home * RigidTransform.from_translation([[0, 0, 0.01], [0.01, 0, 0.02]])
    motion = motion_of_poses(machine, pose, [0.01, 0, 0, 0, 0, 0])
    pushed = forces(machine, motion, wrench=[0, 0, -50, 0, 0, 0])
    plain = actuator_need([AxisMotion(motion.q, motion.qd, pushed.force)])
    assert actuator_need([pushed]) == plain
    assert actuator_need([motion]) == ActuatorNeed(stroke=plain.stroke, speed=plain.speed)
