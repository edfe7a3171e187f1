"""Which rig is behind a machine: never one that nobody stated."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from controllers import find_law, load_rig, track
from controllers.rig import assumed_rig
from controllers.rig_choice import choose_rig, fit_rig, fitting_rigs, rig_hint
from kinematics import MotionError, calibrate, load_machine, load_measurements, machine_names
from planner import Line, Program, plan
from tests.kinematics.kinds.test_equations import OF_FORMULAS


@pytest.fixture(scope="module")
def hexapod():
    return load_machine("hexapod")


@pytest.fixture(scope="module")
def motion(hexapod):
    return plan(Program((Line((0.0, 0.0, 0.002)),)), hexapod).trajectory


# machines of formulas have assumed numbers: whoever owns such a one states its rig
@pytest.mark.parametrize("name", [name for name in machine_names() if name not in OF_FORMULAS])
def test_every_bundled_machine_has_one_bundled_rig(name):
    machine = load_machine(name)
    (rig,) = fitting_rigs(machine)
    chosen = choose_rig(machine, None)
    assert chosen.name == rig
    assert chosen.machine is machine
    assert len(chosen.drives) == len(machine.axes)
    assert rig in rig_hint(machine)


def test_a_stepper_machine_is_tracked_on_steppers(hexapod, motion):
    """The hexapod's rotors hang on to their fields: a servo of 30 1/s would come 20 mm/s / 30 1/s =
    0.7 mm behind.
    """
    tracking = track(motion, hexapod, find_law("3"), period=1e-3)
    assert tracking.rig == "hexapod-steppers"
    assert "hexapod-steppers" in str(tracking)
    screw = load_rig("hexapod-steppers").drives[0]
    # a rotor within a full step of its field, half the play, and half a pulse
    assert (
        np.abs(tracking.actual - tracking.reference).max()
        < screw.full_step + screw.play / 2 + 1e-6 + 20e-3 * 2e-3
    )


def test_no_servo_is_made_up(hexapod, motion):
    """Of other axes, other steps, or of another kind, no bundled rig is taken, and none is
    invented.
    """
    axes = tuple(replace(axis, pulse=2 * axis.pulse) for axis in hexapod.axes)
    home = hexapod.home_q
    for machine in (
        SimpleNamespace(name="own", axes=hexapod.axes, home_q=home),
        SimpleNamespace(name="own", axes=axes, home_q=home),
    ):
        assert fitting_rigs(machine) == ()
        with pytest.raises(
            MotionError, match=r"drives of own are not known: no bundled rig fits .* rig file"
        ):
            track(motion, machine, find_law("3"))


def test_what_does_not_fit_is_named(hexapod):
    traverser, rig = load_machine("traverser"), load_rig("hexapod-steppers")
    with pytest.raises(
        MotionError,
        match=r"hexapod-steppers does not fit traverser: .* hexapod, .* traverser; .*traverser-steppers",
    ):
        choose_rig(traverser, "hexapod-steppers")
    coarse = SimpleNamespace(**{name: getattr(hexapod, name) for name in ("name", "home_q")})
    coarse.axes = (*hexapod.axes[:5], replace(hexapod.axes[5], pulse=1.5e-6))
    own = replace(
        rig, machine=SimpleNamespace(name="mine", axes=hexapod.axes, home_q=hexapod.home_q)
    )
    with pytest.raises(
        MotionError, match=r"a pulse of leg6 is 0\.75 µm on it and 1\.5 µm on the machine"
    ):
        fit_rig(own, coarse)
    coarse.axes = hexapod.axes[:5]
    with pytest.raises(
        MotionError, match=r"it has drives for leg1, .*leg6; the machine's axes are leg1, .*leg5"
    ):
        fit_rig(own, coarse)
    coarse.axes = (*hexapod.axes[:5], replace(hexapod.axes[5], kind="rotary"))
    with pytest.raises(MotionError, match="its leg6 is linear, the machine's is rotary"):
        fit_rig(own, coarse)
    with pytest.raises(MotionError, match='no rig is called "servo-rik"'):
        choose_rig(hexapod, "servo-rik")


def test_a_calibrated_machine_keeps_its_rig(hexapod):
    """Its pulses are some per cent longer than drawn; the drives behind them are the same."""
    built = calibrate(hexapod, load_measurements("cmm")).machine
    assert built.axes != hexapod.axes
    assert fitting_rigs(built) == ("hexapod-steppers",)
    fitted = fit_rig(load_rig("hexapod-steppers"), built)
    assert fitted.machine is built
    assert fitted.tasks == ()


def test_a_rig_on_its_own_machine_is_itself():
    rig = load_rig("hexapod-steppers")
    assert fit_rig(rig, rig.machine) is rig


def test_a_stated_servo_is_taken(hexapod, motion):
    rig = assumed_rig(hexapod)
    tracking = track(motion, hexapod, find_law("3"), rig=rig, period=1e-3)
    assert tracking.rig == "assumed servos"
    assert np.abs(tracking.actual - tracking.reference).max() > 100e-6
