"""A request for a plan: everything that a caller can ask for, with its range and a line of help.

The fields of `PlanRequest` are the source of the command's options and of the record in plan.json.
The command line imports this module before anything that computes is loaded: so the modules that
check a request load only when they are needed.
"""

from abc import ABC
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from math import inf
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinematics.machine.machine import Machine
    from planner.limits import OwnLimit
    from planner.program.model import Program
    from planner.pulses import Rule
    from planner.timing.goals.objective import Objective
    from planner.timing.problem import Solver

# Ticks per second: of a faster clock, ten seconds are more ticks than int64 holds.
MAX_CLOCK_HZ = 10**18
# Rounds of refinement without --effort; and at most, since each has twice as many intervals as the
# one before.
EFFORT = 3
MAX_EFFORT = 6
# Pieces of path in a window: more take longer to certify together, fewer lose time at the ends.
PIECES = 120
# Segments up to which a program is planned as a whole, unless the caller chooses.
MOST_WHOLE = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """The facts about a field of a request that the command line, messages and records state.

    help           one line
    unit           SI unit of a quantity; "Hz": a whole number; "%": a share, written in per cent
    like           a usual value, for messages
    above, least, most
                   range of the value
    choices        the values that the field takes, if these are few
    refusal        what a message says of a value out of range; "": any value is allowed
    metavar        placeholder in the help
    flag           option, if it is not named as the field
    names          list of names that completion offers
    files          True if a file may be given instead of a name
    opposite       option that says no, as "no-figures"
    needs          field without which this one has no meaning
    """

    help: str
    unit: str = ""
    like: str | None = None
    above: float = -inf
    least: float = -inf
    most: float = inf
    choices: tuple[Any, ...] = ()
    refusal: str = ""
    metavar: str | None = None
    flag: str = ""
    names: str = ""
    files: bool = False
    opposite: str = ""
    needs: str = ""

    def allows(self, value: Any) -> bool:
        """Return whether a value is in the range."""
        if self.choices:
            return value in self.choices
        if not self.refusal:
            return True
        return bool(self.above < value < inf and self.least <= value <= self.most)


def option(default: Any, help: str, **facts: Any) -> Any:
    """Make a field of a request that the command line offers. facts: fields of `Option`."""
    return field(default=default, metadata={"option": Option(help=help, **facts)})


def find_options(kind: type[Any]) -> dict[str, Option]:
    """Return the options of a request's fields by name."""
    return {each.name: each.metadata["option"] for each in fields(kind) if each.metadata}


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanRequest:
    """Everything that a caller can ask of a plan, whole or in parts.

    Only Python offers the last three:

    solver  for order 2
    limits  the caller's own, in addition to those of machine and program
    pieces  pieces of path in the first window of a plan in parts
    """

    order: int | None = option(
        None,
        "2: limit speed and acceleration; 3: jerk too. Default: 3 if the machine limits jerk.",
        choices=(2, 3),
        refusal="is not known; 2 limits speed and acceleration, 3 jerk too",
    )
    clock_hz: int = option(
        10_000_000,
        'Clock frequency of the pulse times, in ticks/s, or as "16 MHz".',
        unit="Hz",
        above=0,
        most=MAX_CLOCK_HZ,
        refusal=f"must be above 0, and at most {MAX_CLOCK_HZ:g} ticks per second",
        metavar="FREQUENCY",
    )
    duration: float | None = option(
        None,
        'Plan the smoothest motion of this duration, as "12 s", not the fastest motion.',
        unit="s",
        above=0.0,
        refusal="s must be positive and finite",
        metavar="TIME",
    )
    objective: "str | Objective" = option(
        "time",
        'Sum to minimize: "time", or time and the heat of the motors, both in units of the fastest '
        'motion\'s, as "time + 0.2 heat".',
        metavar="SUM",
    )
    gap: float | None = option(
        None,
        'Refine until the motion is proved this close to the fastest, as "0.1 %".',
        unit="%",
        above=0.0,
        refusal="must be a positive share, as 0.001 for 0.1 %",
        metavar="PERCENT",
    )
    effort: int = option(
        EFFORT,
        "Refinement rounds for --gap at most; each takes several times as long as the previous.",
        least=0,
        most=MAX_EFFORT,
        refusal=f"must be 0 rounds or more, and at most {MAX_EFFORT}",
        metavar="ROUNDS",
        needs="gap",
    )
    rule: "str | Rule" = option(
        "nearest",
        'Firing rule, with options as sampled:period=50us; "pulsepath rules" lists them.',
        metavar="RULE",
        names="rules",
    )
    solver: "Solver" = "passes"
    limits: "Sequence[OwnLimit]" = field(default=(), repr=False)
    pieces: int = PIECES

    def check(self) -> None:
        """Raise MotionError for a value out of range, and for goals that exclude each other."""
        from kinematics.foundation.errors import MotionError

        for name, facts in find_options(PlanRequest).items():
            value = getattr(self, name)
            if value is not None and not facts.allows(value):
                raise MotionError(f"{name} {value!r:.60} {facts.refusal}")

        # The rules take a while to load, so that a name without options is checked in `resolve`.
        if isinstance(self.rule, str) and ":" in self.rule:
            from planner.pulses import find_rule

            find_rule(self.rule)
        heated = self.heat > 0
        if self.duration is not None and heated:
            raise MotionError(
                f'objective "{self.objective}" finds a duration of its own: '
                f"omit it, or the one of {self.duration:g} s, which was stated"
            )
        if self.gap is not None and (self.duration is not None or heated):
            raise MotionError(
                "a gap is one to the fastest motion: omit it, or the stated duration or objective"
            )
        if self.solver != "passes":
            self._check_solver(heated)

    def _check_solver(self, heated: bool) -> None:
        """Raise MotionError for a solver that is unknown, not installed, or not for this goal."""
        from kinematics.foundation.errors import MotionError
        from planner.timing.order2.toppra_ import require

        if self.solver != "toppra":
            raise MotionError(
                f"solver {self.solver!r} is not known; solvers: passes (our own) and toppra",
            )
        if self.order == 3:
            raise MotionError(
                "solver toppra has no jerk limits: give order=2, or omit the solver for order 3",
            )
        if self.duration is not None:
            raise MotionError(
                f"solver toppra finds the fastest motion, not one of {self.duration:g} s: "
                "omit the solver or the duration"
            )
        if heated:
            raise MotionError(
                f'solver toppra finds the fastest motion: omit it, or objective "{self.objective}"',
            )
        require("solver toppra")

    def resolve(self, program: "Program", machine: "Machine") -> "PlanRequest":
        """Return the request with order, duration and objective filled in, and checked.

        Raises MotionError as `check`, and Infeasible for a duration too long for the clock.
        """
        from planner.limits import usual_order
        from planner.pulses import find_rule
        from planner.pulses.generation.motion_parts import refuse_long
        from planner.timing.goals.objective import read_objective

        request = self
        if self.order is None:
            request = replace(request, order=usual_order(machine.axes, program))
        if self.duration is None:
            request = replace(request, duration=program.duration)
        if isinstance(self.objective, str):
            request = replace(request, objective=read_objective(self.objective))
        request.check()
        if isinstance(self.rule, str):
            find_rule(self.rule)
        if request.duration is not None:
            refuse_long(request.duration, int(self.clock_hz))
        return request

    @property
    def resolved_order(self) -> int:
        """Order of a request that was resolved."""
        assert self.order is not None
        return self.order

    @property
    def heat(self) -> float:
        """Weight of the motors' heat in the objective. Raises BadValue for an unknown objective."""
        if self.objective == "time":
            return 0.0
        from planner.timing.goals.objective import read_objective

        if isinstance(self.objective, str):
            return read_objective(self.objective).heat
        return self.objective.heat


def record_request(request: PlanRequest) -> dict[str, Any]:
    """Return what the command line can ask for as plain data, in SI units."""
    record = {}
    for name, key in _find_keys().items():
        value = getattr(request, name)
        is_plain = value is None or isinstance(value, int | float)
        record[key] = value if is_plain else str(value)
    return record


def read_request_record(record: Mapping[str, Any]) -> PlanRequest:
    """Return the request of a record. Raises MotionError for one that is invalid, and KeyError."""
    from planner.timing.goals.objective import read_objective

    values = {name: record[key] for name, key in _find_keys().items()}
    values["objective"] = read_objective(values["objective"])
    request = PlanRequest(**values)
    request.check()
    return request


def _find_keys() -> dict[str, str]:
    """Return the keys in a record, which name the unit, by the fields of a request."""
    options = find_options(PlanRequest).items()
    return {name: f"{name}_s" if facts.unit == "s" else name for name, facts in options}


class Requested(ABC):
    """The properties of a plan, fresh or loaded, that its request states.

    request: resolved, so that it has an order, and an objective that was read
    """

    __slots__ = ()

    request: PlanRequest

    @property
    def order(self) -> int:
        """Order of the limits. 2: to acceleration; 3: to jerk."""
        return self.request.resolved_order

    @property
    def stated_duration(self) -> float | None:
        """Duration (s) that was requested instead of the fastest motion, if any."""
        return self.request.duration

    @property
    def objective(self) -> "Objective":
        """Objective of the motion: time, or a weighted sum with heat."""
        objective = self.request.objective
        assert not isinstance(objective, str)  # the request is resolved
        return objective

    @property
    def own_limits(self) -> "tuple[OwnLimit, ...]":
        """Limits of the caller, in addition to those of machine and program."""
        return tuple(self.request.limits)

    @property
    def fastest(self) -> bool:
        """True if the goal is the fastest motion, without a stated duration or a weight of heat."""
        return self.request.duration is None and self.request.heat == 0

    def describe_objective(self) -> str:
        """Describe the goal of a motion that is not the fastest; "" for one that is."""
        if self.request.duration is not None:
            return "as stated"
        return "" if self.fastest else f"with the least {self.objective}"
