"""Tables of tasks in a rig's TOML, and the motions they ask for."""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from controllers.motions import Sine, along
from controllers.task import Task
from kinematics.array import frozen
from kinematics.errors import BadValue, MotionError
from kinematics.machine import Machine
from kinematics.registry import closest, nearest
from kinematics.schema import Table, either, wrong
from kinematics.units import Unit, shown
from planner.actuation import actuate
from planner.files import load_program


def _not_empty(name: str) -> str:
    if not name:
        raise wrong("empty: give the task a name")
    return name


class Timed(Table):
    """How long a task lasts, and how often the host commands: every `step`, or so that there are `samples`.

    name      of the task
    duration  of the motion
    step      of the host
    samples   of the host, both ends included
    """

    name: Annotated[str, AfterValidator(_not_empty)]
    duration: Annotated[float, Unit("s", above=0, like="5 s")]
    step: Annotated[float, Unit("s", above=0, like="125 ms")] | None = None
    samples: Annotated[int, Field(ge=2)] | None = None

    @model_validator(mode="after")
    def _one_rate(self) -> Self:
        if (self.step is None) == (self.samples is None):
            raise wrong('give either step, e.g. "125 ms", or samples, e.g. 41')
        return self

    @property
    def dt(self) -> float:
        return self.step if self.step is not None else self.duration / ((self.samples or 2) - 1)


class PathTask(Timed):
    """A program's path, run by one profile from end to end.

    program  a program's name, or the path of its file
    profile  of the speed along it
    ramp     time of speeding up, and of slowing down
    """

    program: str
    profile: Literal["quarter-sine", "trapezoid"] = "quarter-sine"
    ramp: Annotated[float, Unit("s", above=0, like="1 s")]

    def on(self, machine: Machine, folder: Path | None) -> Task:
        try:
            path = actuate(load_program(beside(folder, self.program)), machine)
        except MotionError as error:
            raise BadValue(str(error), nearest=getattr(error, "nearest", ""), key=("program",)) from error
        return Task(self.name, along(path, self.profile, self.ramp / self.duration, self.duration), self.dt)


class SineTable(Table):
    """Of the axes named: amplitude · sin(2π t/period).

    axes       names of rotary axes
    amplitude  of the sine
    period     of the sine
    """

    axes: tuple[str, ...]
    amplitude: Annotated[float, Unit("rad", above=0, like="90 deg")]
    period: Annotated[float, Unit("s", above=0)]


class SineTask(Timed):
    """Axes on their own, beyond any travel of the machine; the others rest."""

    sine: SineTable

    def on(self, machine: Machine, folder: Path | None) -> Task:
        kinds = {axis.name: axis.kind for axis in machine.axes}
        for n, name in enumerate(self.sine.axes):
            if kinds.get(name) != "rotary":
                told = "is a linear axis" if name in kinds else f"is no axis{nearest(name, kinds)}"
                rotary = [axis for axis, kind in kinds.items() if kind == "rotary"]
                known = ", ".join(rotary) or "none"
                raise BadValue(
                    f"{shown(name)} {told}; rotary axes: {known}",
                    allowed=known,
                    nearest=closest(name, rotary),
                    key=("sine", "axes", n),
                )
        amplitude = frozen([self.sine.amplitude * (axis.name in self.sine.axes) for axis in machine.axes], float)
        omega = 6.283185307179586 / self.sine.period
        return Task(self.name, Sine(machine.home_q, amplitude, omega, self.duration), self.dt)


TaskTable = Annotated[PathTask | SineTask, either(PathTask, SineTask)]


def beside(folder: Path | None, name_or_path: str) -> str | Path:
    """A name as it is; a path from the folder of the file that gives it."""
    path = Path(name_or_path)
    named = not path.suffix and path.name == name_or_path
    return name_or_path if named or folder is None else folder / path
