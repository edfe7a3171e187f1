"""Solvers that give up say so to us, not to the terminal; what others write meanwhile arrives."""

import sys
from threading import Thread

import numpy as np
import pytest

from planner.limits import Term
from planner.timing.problem import Block, Problem
from planner.timing.solvers.casadi_ import solve_by_casadi
from planner.timing.solvers.patience import silence_stderr


@pytest.mark.parametrize("solver", ["fatrop", "ipopt"])
def test_a_solve_that_is_given_up_prints_nothing(capfd, solver):
    """|s̈ + 3| ≤ 1 from rest to rest: impossible."""
    count = 40
    one = np.ones((count, 1))
    rows = [{Term.SD: one}, {Term.SDDD: one}, {Term.SDD: one, Term.ONE: 3 * one}]
    blocks = [Block(str(n), row, row, np.ones(count), np.zeros(1)) for n, row in enumerate(rows)]
    problem = Problem(np.linspace(0, 1, count + 1), np.zeros(count, int), tuple(blocks))
    guess = np.stack([np.full(count, 0.5), np.zeros(count), np.zeros(count), np.full(count, 2 / count)])
    found = solve_by_casadi(problem, guess, solver)
    assert found.status == "stopped"
    assert "stopped without an answer" in str(found.refusal)
    assert capfd.readouterr() == ("", "")


def test_only_the_callers_thread_is_quiet(capsys):
    with silence_stderr():
        sys.stderr.write("ours")
        other = Thread(target=lambda: sys.stderr.write("another's"))
        other.start()
        other.join()
        assert sys.stderr.isatty() in (True, False)
    sys.stderr.write(", after")
    assert capsys.readouterr().err == "another's, after"
