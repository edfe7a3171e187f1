"""The command `override`: pulses that go on with the plan's, and refusals before the plan is read."""

import json

import pytest

from tests import read_lines


def test_a_slowed_motion_ends_at_the_plans_counts(call, plan, job):
    file = plan / "slow.csv"
    done = call("override", plan, "--speed", "40 %", "--at", "0.6 s", "--format", "pulses", "--out", file, "--json")
    assert done.exit_code == 0, done.stderr
    told, pulses, machine = json.loads(done.stdout), job.plan.pulses, job.plan.machine
    assert told["certified"]
    assert (told["speed"], told["at_s"]) == pytest.approx((0.4, 0.6))
    left = job.plan.trajectory.duration - 0.6
    assert left < told["duration_s"] < left / 0.4  # it is not slow at once
    slow = read_lines.read(str(file), pulses.clock_hz, machine.axes, machine.home_q).schedule
    for before, own in zip(pulses.axes, slow.axes, strict=True):
        assert before.counts([6_000_000 - 1])[0] + own.direction.sum() == before.final


def test_as_a_whole_it_takes_as_much_longer_as_it_is_slower(call, plan, job):
    done = call("override", plan, "--speed", "50 %", "--json")
    assert json.loads(done.stdout)["duration_s"] == pytest.approx(2 * job.plan.trajectory.duration, rel=1e-9)


@pytest.mark.parametrize(
    ("command", "told"),
    [
        (("override", "--speed", "120 %"), 'up to "100 %"'),
        (("override", "--speed", "0.5"), "per cent"),
        (("override", "--speed", "50 %", "--format", "steps"), "go together"),
        (("override", "--speed", "50 %", "--at", "99 s"), "99 s"),
        (("hold", "--at", "0.6 s", "--format", "steps", "--out", "x.bin", "--resume", "x.bin"), "the same file"),
    ],
)
def test_what_cannot_be_is_refused(call, plan, command, told):
    done = call(command[0], plan, *command[1:])
    assert done.exit_code in (1, 2)
    assert told in done.stderr
    assert not (plan / "x.bin").exists()
