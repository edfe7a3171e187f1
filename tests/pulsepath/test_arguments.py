"""Wrong arguments of the public functions: each refusal is ours, and names the argument and what is expected."""

from inspect import signature

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import pulsepath as pp
from kinematics import MotionError

RIG = "hexapod-steppers"
BY_ITSELF = {"program", "machine", "limits", "plan", "law", "rig"} | {
    "max_speed", "max_acceleration", "max_jerk", "pose", "q", "state", "motion",
}  # fmt: skip
"""What their own functions refuse, in words of its own."""


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """Arguments of public functions, all as they should be."""
    machine, plan = pp.load_machine("hexapod"), pp.plan("circle", "hexapod", order=2)
    tracking = pp.track(plan, machine, "6", rig=RIG)
    folder = tmp_path_factory.mktemp("arguments")
    state = plan.trajectory.at([0.1])
    both = {"program": "circle", "machine": "hexapod"}
    return {
        "plan": {**both, "order": 2, "clock_hz": 10**7, "duration": None, "gap": None, "effort": 3, "rule": "nearest",
                 "objective": "time", "solver": "passes", "limits": (), "progress": None},
        "plan_many": {"programs": ["circle"], "machine": "hexapod", "order": 2, "limits": (), "clock_hz": 10**7},
        "check": {**both, "limits": ()},
        "orient": {**both, "objective": "time", "order": 2},
        "synchronise": both,
        "classical": {"plan": plan, "kind": "trapezoid"},
        "realised": {"plan": plan, "pulses": None, "stride": 1},
        "track": {"plan": plan, "machine": machine, "law": "6", "rig": RIG, "dt": 0.005, "settle": 0.5, "period": None},
        "evaluate": {"tracking": tracking, "plan": plan, "machine": machine, "period": 1e-3, "band": 10.0},
        "find_law": {"name": "6", "gain": 0.7},
        "animate": {"plan": plan, "path": folder / "a.html", "frames": 3, "magnify": None},
        "four_views": {"plan": plan, "t": 0.1, "magnify": None},
        "forces": {"machine": "hexapod", "motion": state},
        "motion_of_axes": {"machine": machine, "state": state},
        "motion_of_poses": {"machine": machine, "pose": machine.home},
        "read_setting": {"text": "6"},
        "settings_of": {"name": "6"},
        "compare": {"sources": [], "baseline": None},
        "sweep": {"grid": pp.Grid((pp.read_setting("6"),), ("circle",)), "rig": RIG, "folder": folder},
        "time_optimal": {"path": CubicSpline([0, 1, 2], np.eye(3)), "max_speed": 1.0, "max_acceleration": 1.0},
        "load_machine": {"name_or_path": "hexapod"},
        "load_program": {"name_or_path": "circle"},
        "load_rig": {"name_or_path": RIG},
        "load_plan": {"folder": folder},
        "import_program": {"path": folder / "part.nc", "format": None},
        "machine_toml": {"machine": machine, "comment": ""},
    }  # fmt: skip


FUNCTIONS = sorted(
    ("plan", "plan_many", "check", "orient", "synchronise", "classical", "realised", "track", "evaluate", "find_law",
     "animate", "four_views", "forces", "motion_of_axes", "motion_of_poses", "read_setting", "settings_of", "compare",
     "sweep", "time_optimal", "load_machine", "load_program", "load_rig", "load_plan", "import_program",
     "machine_toml")
)  # fmt: skip


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("wrong", [object(), {}, int, [1, "a"], b"x"], ids=lambda wrong: type(wrong).__name__)
def test_an_argument_of_a_wrong_kind_is_refused(given, name, wrong):
    function, arguments = getattr(pp, name), given[name]
    for argument in arguments:
        if argument == "progress" and callable(wrong):  # `int` can be called
            continue
        with pytest.raises(MotionError) as refused:
            function(**{**arguments, argument: wrong})
        if (
            hasattr(function, "__wrapped__")
            and argument not in BY_ITSELF
            and argument in signature(function).parameters
        ):
            assert argument in str(refused.value)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: pp.plan("circle", "hexapod", order="2"), 'plan: order is "2"; expected a whole number or None'),
        (lambda: pp.plan("circle", "hexapod", effort=True), "plan: effort is True; expected a whole number"),
        (lambda: pp.find_law(6), "find_law: name is 6; expected a text"),
        (lambda: pp.find_law("6", gain="much"), "law 6: gain"),
        (lambda: pp.animate("x", "a.html"), 'animate: plan is "x"; expected'),
        (lambda: pp.classical(None), "classical: plan is None; expected a plan"),
        (lambda: pp.plan_many("circle", "hexapod"), 'programs is "circle"; expected a list'),
        (lambda: pp.sweep(3, RIG, "x"), "sweep: grid is 3; expected a grid"),
    ],
)
def test_refusals_say_what_was_given_and_what_is_expected(call, words):
    with pytest.raises(MotionError) as refused:
        call()
    assert words in str(refused.value)


def test_a_law_is_an_instance_and_no_class(given):
    with pytest.raises(MotionError, match="a law is needed"):
        pp.track(**{**given["track"], "law": type(pp.find_law("6"))})


def test_names_do_where_machines_and_programs_are_asked_for(given):
    assert pp.forces("hexapod", given["forces"]["motion"]).power.shape[0] == 1
    assert pp.synchronise("circle", "hexapod")[0].segments
