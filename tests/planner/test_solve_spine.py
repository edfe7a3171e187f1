"""How far a program goes on its way to pulses: through how many files and how much code, and how
deep to the solver.

Whoever follows a plan through the code reads what is counted here; a change that makes it longer
shows that it does.
"""

import ast
import inspect
import io
import os
import sys
import textwrap
import tokenize
from pathlib import Path

import pytest

import planner
from kinematics import load_machine
from planner import load_program, plan

ROOT = Path(planner.__file__).parents[1]
PACKAGES = tuple(
    f"{ROOT / name}{os.sep}"
    for name in ("kinematics", "planner", "controllers", "benchmarks", "pulsepath")
)
# Reached with the circle at order 2; the rest of its way is no longer than this. Code is counted in
# tokens without docstrings and comments: cutting a function in two does not make its reader read
# more. The goal of a motion and the table of attempts, both plug points, are one frame each.
MOST_FILES, MOST_TOKENS, DEEPEST = 72, 61_700, 10

RUN_WITHIN_RUN = 5
"""Frames from a feed-limited run to that of one of its ramps."""


@pytest.fixture(scope="module")
def entered():
    """What the circle's plan enters of our code, and the chains of our functions that lead to the
    order-2 solver.

    The plan is made once before: what is built once for a machine and kept is not on every
    program's way. Comprehensions and lambdas belong to the function that they stand in, so that the
    count is that of any Python.
    """
    program, machine = load_program("circle"), load_machine("hexapod")
    plan(program, machine, order=2)
    functions, chains = {}, []

    def note(frame, event, _):
        if event != "call" or not frame.f_code.co_filename.startswith(PACKAGES):
            return
        if not frame.f_code.co_name.startswith("<"):
            functions[frame.f_code.co_filename, frame.f_code.co_qualname] = frame.f_code
        if frame.f_code.co_name == "largest_speeds":
            chain = []
            while frame.f_code.co_name != "plan":
                if frame.f_code.co_filename.startswith(
                    PACKAGES
                ) and not frame.f_code.co_name.startswith("<"):
                    chain.append(frame.f_code.co_qualname)
                frame = frame.f_back
            chains.append(("plan", *reversed(chain)))

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        plan(program, machine, order=2)
    finally:
        sys.setprofile(before)
    return functions, chains


def count_tokens(code):
    """Names, numbers, strings and operators of a function, without docstring and comments."""
    (function,) = ast.parse(textwrap.dedent("".join(inspect.getsourcelines(code)[0]))).body
    if ast.get_docstring(function) is not None:
        function.body[0] = ast.Pass()
    kinds = {tokenize.NAME, tokenize.NUMBER, tokenize.STRING, tokenize.OP}
    return sum(
        token.type in kinds
        for token in tokenize.generate_tokens(io.StringIO(ast.unparse(function)).readline)
    )


def test_a_program_reaches_its_pulses_through_few_files_and_little_code(entered):
    functions, _ = entered
    files = {Path(file).relative_to(ROOT).as_posix() for file, _ in functions}
    assert len(files) <= MOST_FILES, sorted(files)
    outer = [code for (_, name), code in functions.items() if "<locals>" not in name]
    assert sum(map(count_tokens, outer)) <= MOST_TOKENS


def test_the_solver_is_near(entered):
    """plan → make_plan → certified_solve → solve_goal → a part's worth of runs → a run → an attempt
    → its solver.
    """
    _, chains = entered
    first = min(chains, key=len)
    assert len(first) <= DEEPEST, " > ".join(first)
    assert first[-2:] == ("second_order", "largest_speeds")
    # one frame more where a motion is tightened, or its lower bound is estimated; and a ramp of a
    # feed-limited run is a run within a run
    assert max(map(len, chains)) <= DEEPEST + 2 + RUN_WITHIN_RUN
