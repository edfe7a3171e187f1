"""Triggers of a plan that is stopped and gone on with: each fires once, where the program has
it.
"""

from dataclasses import replace

import numpy as np
import pytest

from kinematics import load_machine
from kinematics.machine.shaper import Shaper
from planner import Dwell, Line, Program, Trigger, plan

PROGRAM = Program(
    (
        Line(to=(0.02, 0.0, 0.0), trigger=Trigger("a", 0.0)),
        Line(to=(0.04, 0.01, 0.0), trigger=Trigger("b", 0.5)),
        Dwell(0.1),
        Line(to=(0.04, 0.04, 0.0), trigger=Trigger("c", 0.0, after_rest=True)),
        Line(to=(0.0, 0.0, 0.0), trigger=Trigger("d", 1.0)),
    )
)


@pytest.fixture(scope="module", params=[False, True], ids=["", "shaped"])
def marked(request):
    machine = load_machine("corexy")
    if request.param:
        machine.axes = tuple(replace(axis, shaper=Shaper("zv", 15.0)) for axis in machine.axes)
    return plan(PROGRAM, machine, order=2)


def check_section(made, section):
    """Each trigger at its place, which the section's own motion passes then, with the counts of its
    pulses.
    """
    for event in section.triggers:
        assert 0 <= event.time <= section.duration + 1e-9
        assert event.counts.tolist() == section.pulses.counts(event.time)[0].tolist()
        planned = next(each for each in made.triggers if each.name == event.name)
        assert event.where.s == planned.where.s
        if section.shaped is None:
            passed = section.since + float(section.trajectory.at(event.time).along[0])
            assert passed == pytest.approx(event.where.s, abs=1e-9)


@pytest.mark.parametrize("share", [0.05, 0.3, 0.5, 0.62, 0.8, 0.9])
def test_each_fires_once(marked, share):
    held = marked.hold(share * marked.trajectory.duration)
    rest = marked.resume(held)
    before = [event.name for event in marked.triggers if event.time < held.at]
    fired = [before, *([event.name for event in section.triggers] for section in (held, rest))]
    assert [name for names in fired for name in names] == ["a", "b", "c", "d"]
    for section in (held, rest):
        check_section(marked, section)


def test_each_fires_once_with_a_stop_in_the_way_on(marked):
    first = marked.hold(0.1)
    on = marked.resume(first, share=0.5)
    held = marked.hold(0.3, during=on)
    last = marked.resume(held, share=0.7)
    for section in (on, held, last):
        check_section(marked, section)
    names = [event.name for event in marked.triggers if event.time < first.at]
    names += [event.name for event in first.triggers]
    names += [event.name for event in on.triggers if event.time < held.at]
    names += [event.name for section in (held, last) for event in section.triggers]
    assert names == ["a", "b", "c", "d"]


def test_all_of_a_slowed_plan_and_those_behind_a_place(marked):
    slower = marked.resume(0.0, 0.5)
    assert [event.name for event in slower.triggers] == ["a", "b", "c", "d"]
    check_section(marked, slower)
    third = next(event for event in marked.triggers if event.name == "c")
    assert [event.name for event in marked.resume(third.where.s).triggers] == [
        "c",
        "d",
    ]  # behind its dwell
    assert [event.name for event in marked.resume(third.where.s + 1e-3).triggers] == ["d"]
    assert [event.name for event in marked.resume(third.where.s - 1e-3).triggers] == ["c", "d"]


def test_a_stop_delays_what_comes_behind_it(marked):
    """By the time that the stop and the way up to speed take more than the plan."""
    start = next(event for event in marked.triggers if event.name == "d").time
    held = marked.hold(start - 0.3)  # on the way there, long before it would rest
    planned = {event.name: event.time for event in marked.triggers}
    again = {
        event.name: held.at + held.duration + event.time for event in marked.resume(held).triggers
    }
    assert again
    late = np.array([again[name] - planned[name] for name in again])
    assert (late > 0.05).all()
