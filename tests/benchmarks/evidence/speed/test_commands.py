"""What the times of commands are made of: a command that says what it should, and refusals within their time."""

import pytest

from benchmarks.evidence.speed.commands import ALLOWED, measure


@pytest.mark.parametrize("command", ["--version", "export missing --format vcd"])
def test_what_computes_nothing_is_quick(command):
    """On the fastest of three, with as much again for a busy machine."""
    said = "pulsepath" if command == "--version" else "missing"
    assert 0 < min(measure(command, said) for _ in range(3)) <= 2 * ALLOWED


def test_a_command_that_says_something_else_is_no_figure():
    with pytest.raises(RuntimeError, match="does not say nothing of the kind"):
        measure("--version", "nothing of the kind")
