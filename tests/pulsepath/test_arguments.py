"""Wrong arguments of the public functions: each refusal is ours, and names the argument and what is
expected.
"""

from inspect import signature
from itertools import product
from operator import attrgetter

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import pulsepath as pp
from controllers.laws.law import Feedback, Reference
from kinematics import MotionError

RIG = "hexapod-steppers"
BY_ITSELF = {"program", "machine", "limits", "plan", "law", "rig"} | {
    "max_speed", "max_acceleration", "max_jerk", "pose", "q", "state", "motion",
}  # fmt: skip
"""What their own functions refuse, in words of its own."""


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """Arguments of public functions, all as they should be."""
    machine, plan = pp.load_machine("hexapod"), pp.plan("bare-circle", "hexapod", order=2)
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
@pytest.mark.parametrize(
    "wrong", [object(), {}, int, [1, "a"], b"x"], ids=lambda wrong: type(wrong).__name__
)
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


METHODS = {
    "hold": {"at": 0.5}, "resume": {"stop": 0.1}, "stops": {"count": 2},
    "realised": {"stride": 1}, "export": {"format": "csp", "path": "a.csv", "force": False},
    "save": {"path": "a.csv", "force": False}, "plot": {"ax": None}, "trajectory.at": {"t": 0.1},
    "trajectory.save": {"path": "a.csv"}, "pulses.counts": {"t": 0.1},
}  # fmt: skip
"""Methods of a plan and of what it holds, with arguments as they should be."""
VALUES = {
    "Line": {"to": [0, 0, 0], "rotate": None, "speed": None, "join": pp.Stop(), "acceleration": None, "free": None,
             "angular_speed": None, "speed_constant": False, "trigger": None, "line_number": None},
    "Arc": {"centre": [1, 0, 0], "normal": [0, 0, 1], "angle": 1.0, "rise": 0.0, "join": pp.Stop(), "rotate": None},
    "Spline": {"through": [[1, 0, 0], [2, 0, 0]], "rotate": None, "speed": None, "join": pp.Stop()},
    "Curve": {"position": ("t", "0", "0"), "begin": 0.0, "end": 1.0, "rotate": None, "constants": (), "length": 1.0},
    "Turn": {"to": [0.1, 0, 0], "join": pp.Stop(), "angular_speed": None, "trigger": None},
    "Synchronised": {"to": [0, 0, 0], "rotate": None, "speed": None, "join": pp.Stop(), "acceleration": None},
    "Dwell": {"duration": 1.0, "line_number": None},
    "Program": {"segments": [pp.Dwell(1.0)], "frame": "home", "start": None, "machine": None, "name": "p",
                "speed": None, "duration": None, "tool": None, "work": None, "repeat": 1, "start_speed": 0.0,
                "file": ""},
    "Axis": {"name": "a", "kind": "linear", "travel": (0.0, 0.1), "pulse": 1e-6, "direction": 1, "max_speed": 0.1,
             "max_jerk": 1.0, "max_force": 1.0, "pushed": "+", "compensate": ("lead",), "torque_speed": None},
    "Body": {"mass": 1.0, "centre": [0, 0, 0], "inertia": np.eye(3), "name": "b"},
    "Leg": {"barrel": pp.Body(1.0), "rod": pp.Body(1.0), "first_axis": [1, 0, 0]},
    "Shaper": {"kind": "zv", "frequency": 10.0, "damping": 0.1, "tolerance": 0.05},
    "cylinder": {"mass": 1.0, "radius": 0.1, "low": 0.0, "high": 0.1, "name": "c"},
    "joint_circle": {"radius": 0.1, "gap": 0.5, "height": 0.0},
    "Actuator": {"name": "a", "line": 1, "stroke": 0.1, "force": 1.0, "size": (0.1, 0.1), "mass": None, "cost": (1, 2)},
    "Joint": {"name": "j", "line": 1, "tilt": 0.1, "force": None},
    "ActuatorNeed": {"stroke": 0.1, "speed": None, "force": 1.0, "precision": 1e-6},
    "Backlash": {"width": 1e-6, "name": "b"}, "PulseLength": {"error": 1e-9, "common": False, "name": "p"},
    "Temperature": {"ambient": 1.0, "heating": 1.0, "axis_expansion": 1e-5, "name": "t"},
    "Noise": {"position": 1e-6, "rotation": 1e-6},
    "PositionList": {"poses": np.zeros((3, 6)), "order": "xyz", "frame": "home", "dwells": None},
    "Grid": {"settings": (pp.read_setting("6"),), "tasks": ("circle",), "seeds": (0,)},
    "Rig": {"machine": pp.load_machine("hexapod"), "drives": pp.load_rig(RIG).drives, "name": "r"},
    "Blend": {"tolerance": 1e-4, "angle": None}, "Fit": {"tolerance": 1e-4, "corner": 0.5, "stop": False},
    "Trigger": {"name": "t", "at": 0.5}, "Free": {"yaw": True, "tilt": 0.1}, "Objective": {"heat": 0.1},
}  # fmt: skip
WRONG = (object(), {}, int, [1, "a"], b"x", "0.5 mm")


@pytest.mark.parametrize("name", METHODS)
def test_methods_of_a_plan_refuse_what_they_cannot_take(given, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    method = attrgetter(name)(given["realised"]["plan"])
    for argument, wrong in product(METHODS[name], WRONG):
        if isinstance(wrong, str) and argument in ("format", "path"):
            continue
        with pytest.raises(MotionError, match=argument):
            method(**{**METHODS[name], argument: wrong})
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize("name", VALUES)
def test_segments_and_programs_refuse_what_they_cannot_hold(name):
    kind = getattr(pp, name)
    kind(**VALUES[name])
    for argument, wrong in product(VALUES[name], WRONG):
        is_a_text = (isinstance(wrong, str) and argument in ("name", "file")) or (
            name,
            argument,
        ) == (
            "Program",
            "machine",
        )
        if (is_a_text and isinstance(wrong, str)) or (argument, wrong) == ("constants", {}):
            continue
        with pytest.raises(MotionError, match=WORDS.get((name, argument), argument)):
            kind(**{**VALUES[name], argument: wrong})


@pytest.mark.parametrize("name", [name for name in VALUES if name not in ("Dwell", "Program")])
def test_numbers_that_no_float_holds_are_refused_where_they_are_given(name):
    """An integer of four hundred digits, NaN and infinity, where a number is asked for."""
    kind, given = getattr(pp, name), VALUES[name]
    numbers = [argument for argument, value in given.items() if type(value) is float]
    for argument, wrong in product(numbers, (10**400, float("nan"), float("inf"))):
        with pytest.raises(MotionError, match=WORDS.get((name, argument), argument)):
            kind(**{**given, argument: wrong})


WORDS = {("Program", "segments"): "segment|empty", ("Axis", "name"): "a name", ("Curve", "begin"): "begin|t from",
         ("Curve", "end"): "end|t from"}  # fmt: skip
"""What a refusal says of an argument where that is not its name."""


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda: pp.plan("circle", "hexapod", order="2"),
            'plan: order is "2"; expected a whole number or None',
        ),
        (
            lambda: pp.plan("circle", "hexapod", effort=True),
            "plan: effort is True; expected a whole number",
        ),
        (lambda: pp.Grid(3, 4), "grid: settings is 3; expected a tuple, each entry a setting"),
        (lambda: pp.Grid([3], ["circle"]), "grid: settings is (3,)"),
        (
            lambda: pp.Grid([pp.read_setting("6")], ["circle"], seeds=[-1]),
            "seeds [-1] must be whole numbers from 0",
        ),
        (lambda: pp.Rig("hexapod", ()), "rig: machine is 'hexapod'; expected a machine"),
        (lambda: pp.load_rig(RIG).task(3), "task: name is 3; expected a text"),
        (lambda: pp.Actuator("a", 1, stroke=-0.1), "actuator a: stroke -0.1 m must be above 0"),
        (
            lambda: pp.ActuatorNeed("long"),
            "needed stroke must be one finite number in SI units, not 'long'",
        ),
        (
            lambda: pp.select_parts([1], pp.ActuatorNeed(0.1)),
            "parts is [1]; expected a list, each entry an actuator",
        ),
        (lambda: pp.joint_need("hexapod", [0, 0, 0.3], []), "joint_need: force is empty"),
        (lambda: pp.Backlash([]), "backlash: width is empty"),
        (
            lambda: pp.joint_circle(-0.1, 0.5, 0),
            "joint_circle: radius must be one finite number in m above 0 and at most 100000",
        ),
        (
            lambda: pp.workspace("hexapod", cells=10**9),
            "cells must be a whole number from 1 to 1000",
        ),
        (
            lambda: pp.load_machine("hexapod").carrying("much"),
            'carrying: load is "much"; expected a load',
        ),
        (
            lambda: pp.load_machine("hexapod").assembly_modes("x"),
            "lengths of its legs must be finite numbers (6,) in m",
        ),
        (
            lambda: pp.PositionList(np.zeros((2, 6))).remove("1"),
            'remove: first is "1"; expected a whole number',
        ),
        (lambda: pp.read_pulses("no/pulses.ppb"), "there is no folder no"),
        (
            lambda: pp.save_positions(pp.PositionList(np.zeros((2, 6))), "no/a.csv"),
            "there is no folder no; make it",
        ),
        (
            lambda: pp.plan("circle", "hexapod", clock_hz=10**30),
            "must be above 0, and at most 1e+18 ticks per second",
        ),
        (
            lambda: pp.plan("circle", "hexapod", duration=1e300),
            "duration 1e+300 s is beyond 2.68435e+08 s",
        ),
        (
            lambda: pp.plan("circle", "hexapod", limits=np.zeros(3)),
            "limits must be a list of limits",
        ),
        (
            lambda: Feedback([[0.0]], [["fast"]], [[0.0]]),
            "feedback: speed must be finite numbers in pulses/s, not [['fast']]",
        ),
        (
            lambda: Feedback([[0.0]], [[0.0, 1.0]], [[0.0]]),
            "position, speed and counter are (1, 1), (1, 2) and (1, 1)",
        ),
        (lambda: Reference(0.0, [[0.0]], [[0.0]]), "reference: dt 0.0 s must be above 0"),
        (
            lambda: Reference(0.01, [0.0], [[0.0]]),
            "reference: position must be finite numbers (N, N)",
        ),
        (lambda: Reference(0.01, [[0.0]], [[0.0, 1.0]]), "give one speed for each position"),
        (lambda: pp.find_law(6), "find_law: name is 6; expected a text"),
        (lambda: pp.find_law("6", gain="much"), "law 6: gain"),
        (lambda: pp.animate("x", "a.html"), 'animate: plan is "x"; expected'),
        (lambda: pp.classical(None), "classical: plan is None; expected a plan"),
        (lambda: pp.plan_many("circle", "hexapod"), 'programs is "circle"; expected a list'),
        (lambda: pp.sweep(3, RIG, "x"), "sweep: grid is 3; expected a grid"),
        (
            lambda: pp.Line([0, 0, 0], speed="10 mm/s"),
            'line: speed is "10 mm/s"; expected a number in m/s or None',
        ),
        (lambda: pp.Dwell("1 s"), 'dwell: duration is "1 s"; expected a number in s'),
        (
            lambda: pp.Line([0, 0, 0], join=0.001),
            "line: join is 0.001; expected a stop or a through or a blend",
        ),
        (
            lambda: pp.calibrate("hexapod", "cmm", [3]),
            "calibration model: part 3 is not a text; parts: factor",
        ),
        (
            lambda: pp.calibrate("hexapod", "cmm", use=[1]),
            'calibrate: use [1] must be "position", "all" or None',
        ),
        (lambda: pp.load_positions(3), "load_positions: path is 3; expected a text or a path"),
        (lambda: pp.posture_of_axes("hexapod", "x"), "coordinates must be finite numbers"),
    ],
)
def test_refusals_say_what_was_given_and_what_is_expected(call, words):
    with pytest.raises(MotionError) as refused:
        call()
    assert words in str(refused.value)


def test_a_plan_says_what_its_methods_take(given, tmp_path):
    plan, hold = given["realised"]["plan"], given["realised"]["plan"].hold(0.5)
    for call, words in (
        (lambda: plan.hold("0.5 s"), 'hold: at is "0.5 s"; expected a number in s'),
        (lambda: plan.hold(True), "hold: at is True"),
        (lambda: plan.resume(plan), "expected a section or a number in m"),
        (lambda: plan.stops(2.5), "stops: count is 2.5; expected a whole number"),
        (
            lambda: plan.export("csp", tmp_path / "a.csv", cycel=1),
            'no option "cycel", nearest is "cycle"',
        ),
        (lambda: hold.export("csp", tmp_path / "no" / "a.csv"), "there is no folder"),
        (lambda: plan.trajectory.at(None), "at: t must be finite numbers"),
        (lambda: plan.worth.of(3), "of: limit is 3; expected a text"),
        (lambda: plan.worth.replan("speed", by="much"), 'replan: by is "much"; expected a number'),
        (lambda: pp.animate(plan, tmp_path / "no" / "a.html"), "there is no folder"),
        (lambda: pp.save_four_views(plan, tmp_path / "a\0.png"), "the path has a NUL in it"),
        (
            lambda: pp.track(plan, "hexapod", "6", rig=RIG, settle=1e9),
            "settle 1e+09 s must be from 0 to 3600 s",
        ),
        (
            lambda: pp.track(plan, "hexapod", "6", rig=RIG, dt=1e300),
            "dt 1e+300 s, the host's step, must be above 0",
        ),
        (
            lambda: pp.evaluate(
                pp.track(plan, "hexapod", "6", rig=RIG), plan, "hexapod", band=-1.0
            ),
            "band -1.0 must be 0",
        ),
    ):
        with pytest.raises(MotionError) as refused:
            call()
        assert words in str(refused.value)


def test_a_law_is_an_instance_and_no_class(given):
    with pytest.raises(MotionError, match="a law is needed"):
        pp.track(**{**given["track"], "law": type(pp.find_law("6"))})


def test_names_do_where_machines_and_programs_are_asked_for(given):
    assert pp.forces("hexapod", given["forces"]["motion"]).power.shape[0] == 1
    assert pp.synchronise("circle", "hexapod")[0].segments
    at_rest = pp.motion_of_poses("hexapod", [0, 0, 0.3])
    assert pp.motion_of_axes("hexapod", at_rest).qd.shape == (1, 6)


def test_limits_and_path_are_told_in_a_line(given):
    plan = given["realised"]["plan"]
    assert "<Speed of 6>" in repr(plan.limits)
    assert repr(plan.path).startswith("<MachinePath on hexapod: 94.2478 mm")
