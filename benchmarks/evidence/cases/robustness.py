"""Random problems and programs: whether each is solved and certified, and how.

`--kind problems`  paths with limits
`--kind programs`  short segments with tiny blends on the hexapod and the linkage. A refusal by the
                   geometry is no fault. A motion that takes longer than with stops at every join
                   is one.
`--kind ratios`    programs whose lengths, feeds and limits differ by up to 10 000. Each must also
                   be as fast as the classical timing.

`--second 10000 --third 1000`, and `--programs 200`, are the full suites: one to several hours on
two cores.
"""

from collections.abc import Iterable, Iterator
from time import process_time
from typing import Literal

from benchmarks.evidence.random_problems import RandomProblem, random_problem, random_spline
from benchmarks.evidence.random_programs import (
    MACHINES,
    random_program,
    ratio_machine,
    ratio_program,
    stop_everywhere,
)
from benchmarks.evidence.table import Row, Table
from kinematics import load_machine
from kinematics.foundation.errors import MotionError, OutOfReach
from kinematics.machine.machine import Machine
from planner import Infeasible, Program, classical, plan
from planner.timing.solution import AVERAGED, WITH_RESTS

MAX_EXCESS = 0.01
"""Share by which a plan may take longer than one with stops at every join.

An order-3 grid leaves that open.
"""
BASELINES = {2: "trapezoid", 3: "s-curve"}
COLUMNS = (
    "suite",
    "number",
    "at fault",
    "runs",
    "averaged (%)",
    "slowed by more than 0.1 % (%)",
    "with extra rests (%)",
    "processor time (s)",
)

Answer = tuple[str, tuple[str, ...]]
"""What is wrong with a motion, or "", and the methods of its runs."""
Suite = tuple[str, Iterable[Answer]]


def measure(
    kind: Literal["problems", "programs", "ratios"] = "problems",
    second: int = 500,
    third: int = 100,
    paths: int = 300,
    programs: int = 10,
) -> Iterator[Table]:
    """Yield a row for each suite, and all faults."""
    problems = list_problems(second, third, paths)
    suites = problems if kind == "problems" else list_programs(kind, range(programs))
    faults: list[Row] = []
    yield Table(f"Random {kind}", COLUMNS, (summarise(*suite, faults) for suite in suites))
    if faults:
        yield Table("Faults", ("suite", "seed", "fault"), faults)


def summarise(name: str, answers: Iterable[Answer], faults: list[Row]) -> Row:
    """Return the row of a suite, and add its faults to the others."""
    begin = process_time()
    results = list(answers)
    seconds = process_time() - begin
    failed = [(name, seed, fault) for seed, (fault, _) in enumerate(results) if fault]
    faults += failed
    methods = [method for _, runs in results for method in runs]
    return name, len(results), len(failed), len(methods), *find_shares(methods), seconds


def find_shares(methods: list[str]) -> list[float]:
    """Return the shares (%) of runs that are averaged, slowed, and with extra rests."""
    flags = [(AVERAGED in method, is_slow(method), WITH_RESTS in method) for method in methods]
    return [100 * sum(column) / len(methods) for column in zip(*flags, strict=True)] or 3 * [0.0]


def is_slow(method: str) -> bool:
    """Return whether a motion, or a part of one, is slowed by more than 0.1 %."""
    return "slowed" in method.split(", ")


def list_problems(second: int, third: int, paths: int) -> Iterator[Suite]:
    """Yield the suites of paths with limits."""
    for order, count in ((2, second), (3, third)):
        problems = [random_problem(seed, order) for seed in range(count)]
        yield f"order {order}", map(try_problem, problems)
    yield "every kind and scale", map(try_problem, map(random_spline, range(paths)))


def try_problem(problem: RandomProblem) -> Answer:
    """Solve a problem."""
    try:
        solution = problem.solve()
    except MotionError as error:
        return str(error), ()
    return "" if solution.certificate.holds else "not certified", solution.methods


def list_programs(kind: str, seeds: Iterable[int]) -> Iterator[Suite]:
    """Yield the suites of programs of a kind."""
    for order in (2, 3):
        if kind == "ratios":
            yield f"order {order}", (plan_ratios(seed, order) for seed in seeds)
            continue
        for name in MACHINES:
            machine = load_machine(name)
            programs = [random_program(seed, name) for seed in seeds]
            yield f"{name}, order {order}", (plan_program(one, machine, order) for one in programs)


def plan_ratios(seed: int, order: int) -> Answer:
    """Plan a program of ratios, and compare it with the classical timing as well."""
    return plan_program(ratio_program(seed), ratio_machine(seed), order, BASELINES[order])


def plan_program(program: Program, machine: Machine, order: int, baseline: str = "") -> Answer:
    """Plan a program, and compare it with stops at every join and with a baseline."""
    try:
        planned = plan(program, machine, order=order)
    except (OutOfReach, Infeasible) as error:
        return "", (f"refused: {type(error).__name__}",)
    except MotionError as error:
        return f"{type(error).__name__}: {error}", ()
    duration = planned.trajectory.duration
    stopping = plan(stop_everywhere(program), machine, order=order).trajectory.duration
    most = {"with stops at every join": stopping * (1 + MAX_EXCESS)}
    if baseline:
        most[f"as {baseline}"] = classical(planned, baseline).duration
    faults = []
    for name, limit in most.items():
        if duration > limit:
            faults.append(f"takes {duration:.9g} s, {name} {limit:.9g} s")
    if not planned.certificate.holds:
        faults.append("not certified")
    return ", ".join(faults), planned.methods
