"""A request for a plan: its ranges, its record, and the arguments that make it."""

import json
from dataclasses import replace
from inspect import signature

import pytest

from kinematics import MotionError
from planner import Objective, plan, plan_parts
from planner.request import PlanRequest, find_options, read_request_record, record_request

OUTSIDE = {
    "order": (1, 4, -2),
    "clock_hz": (0, -5, 10**18 + 1),
    "duration": (0.0, -1.0, float("inf"), float("nan")),
    "gap": (0.0, -0.1, float("inf"), float("nan")),
    "effort": (-1, 7),
}


def test_each_field_with_a_range_refuses_values_outside_it_and_names_itself():
    ranged = {name for name, facts in find_options(PlanRequest).items() if facts.refusal}
    assert ranged == OUTSIDE.keys()
    PlanRequest().check()
    for name, values in OUTSIDE.items():
        for value in values:
            with pytest.raises(MotionError, match=f"^{name} "):
                PlanRequest(**{name: value}).check()


@pytest.mark.parametrize(
    "goals",
    [
        {"duration": 9.0, "objective": "time + heat"},
        {"duration": 9.0, "gap": 0.1},
        {"gap": 0.1, "objective": Objective(0.2)},
        {"duration": 9.0, "solver": "toppra"},
        {"objective": "time + heat", "solver": "toppra"},
    ],
)
def test_goals_that_exclude_each_other_are_refused(goals):
    with pytest.raises(MotionError, match="omit"):
        PlanRequest(**goals).check()
    for name in goals:
        if goals[name] != "toppra":  # which may not be installed
            PlanRequest(**{name: goals[name]}).check()


@pytest.mark.parametrize(
    "request_",
    [
        PlanRequest(order=2, objective=Objective()),
        PlanRequest(order=3, clock_hz=16_000_000, duration=1 / 3, objective=Objective()),
        PlanRequest(order=3, gap=1e-3 / 7, effort=0, rule="dda:spacing=2ms", objective=Objective()),
        PlanRequest(order=3, objective=Objective(0.1 + 0.2)),
    ],
)
def test_a_record_states_all_that_the_command_line_can_ask_for(request_):
    record = json.loads(json.dumps(record_request(request_)))
    again = read_request_record(record)
    assert replace(again, objective=request_.objective) == request_
    assert again.heat == pytest.approx(request_.heat, rel=1e-14)  # written with 15 digits
    for name in record:
        with pytest.raises(KeyError):
            read_request_record({key: record[key] for key in record if key != name})
    with pytest.raises(MotionError):
        read_request_record(record | {"order": 5})


@pytest.mark.parametrize("function", [plan, plan_parts])
def test_arguments_have_the_defaults_of_the_request(function):
    request = PlanRequest()
    arguments = {
        name: parameter.default
        for name, parameter in signature(function).parameters.items()
        if parameter.kind is parameter.KEYWORD_ONLY and name not in ("progress", "helpers")
    }
    assert len(arguments) >= 5
    for name, default in arguments.items():
        assert str(getattr(request, name)) == str(default), name
