"""Times of commands: refusals within their time, and a cold plan that takes little of a
processor.
"""

import pytest

from benchmarks.evidence.cases.commands import ALLOWED, PLANS, run_command
from kinematics import MotionError
from tests.pace import slowness

ENOUGH = 6.0
"""s of processor time: 3.6 measured; 5.2 before anything was done about it, and 7.3 with
figures.
"""


@pytest.mark.parametrize(
    ("command", "message"),
    [("--version", "pulsepath"), ("export missing --format vcd", "missing")],
)
def test_a_command_that_computes_nothing_is_quick(command, message):
    """The fastest of three, with as much again for a busy machine."""
    assert 0 < min(run_command(command, message).processor for _ in range(3)) <= 2 * ALLOWED


def test_a_command_that_says_something_else_is_refused():
    with pytest.raises(MotionError, match="does not say nothing of the kind"):
        run_command("--version", "nothing of the kind")


def test_a_bare_circle_without_figures_takes_little_of_a_processor():
    """The least of three where it is more: caches that others fill make a processor slower too."""
    bare, _ = PLANS
    for _ in range(3):
        run = run_command(bare)
        if run.processor < ENOUGH or run.processor < ENOUGH * slowness():
            break
    else:
        pytest.fail(f"{run.processor:.2f} s of CPU")
    # nobody asked for it
    assert "tracking" not in run.result.stdout + run.result.stderr
