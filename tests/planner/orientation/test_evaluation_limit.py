"""The end of a CasADi solver after a number of evaluations, or at a Ctrl-C."""

import os
import signal

import casadi as ca
import pytest

from planner.orientation.evaluation_limit import EvaluationLimit


class Interrupted(EvaluationLimit):
    """A Ctrl-C comes with the third evaluation."""

    def eval(self, arguments):
        if self.used == 2:
            os.kill(os.getpid(), signal.SIGINT)
        return super().eval(arguments)


def rosenbrock(patience):
    """The least of (1 - x)² + 100 (y - x²)², which is at (1, 1); |x| + |y| is free."""
    x = ca.MX.sym("x", 2)
    cost = (1 - x[0]) ** 2 + 100 * (x[1] - x[0] ** 2) ** 2
    quiet = {"print_time": False, "error_on_fail": False, "show_eval_warnings": False}
    options = quiet | {"ipopt": {"print_level": 0, "sb": "yes"}}
    programme = {"x": x, "f": cost, "g": x[0] + patience(x[0])}
    solver = ca.nlpsol("rosenbrock", "ipopt", programme, options)
    with patience.asked():
        answer = solver(x0=[-1.2, 1.0], lbg=-10, ubg=10)
    return answer["x"].full().ravel(), solver.stats()["success"]


@pytest.mark.parametrize(("most", "solved"), [(1000, True), (5, False)])
def test_a_solver_gives_up_after_the_last_evaluation(most, solved):
    patience = EvaluationLimit(most)
    answer, success = rosenbrock(patience)
    assert success == solved
    assert (patience.used <= most) == solved
    if solved:
        assert answer == pytest.approx([1, 1], abs=1e-6)


def test_ctrl_c_ends_the_solver_and_is_raised(capfd):
    patience = Interrupted(1000)
    with pytest.raises(KeyboardInterrupt):
        rosenbrock(patience)
    assert patience.used >= 3
    assert "KeyboardInterrupt" not in capfd.readouterr().err
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_whoever_ignores_ctrl_c_still_does():
    previous = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with EvaluationLimit(1).asked():
            os.kill(os.getpid(), signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, previous)
