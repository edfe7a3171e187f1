"""The schema of a rig's TOML, and the motions of its tasks."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from controllers.card import PCI_8132, PCI_8164, Card
from controllers.drives.drive_tables import ServoTable, StepperTable
from controllers.reference_file import Recorded, read_reference
from controllers.rig import Sine, Task, time_path
from kinematics.files.keys import Chosen, key
from kinematics.files.schema import File, TableSchema, one_of_tables
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import BadValue, MotionError, validation_error
from kinematics.foundation.names import closest, find, nearest, presets
from kinematics.foundation.units import Unit, describe_value
from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine


def _require_name(name: str) -> str:
    if not name:
        raise validation_error("empty: give the task a name")
    return name


class TaskRate(TableSchema):
    """How often the host commands: every `step`, or so that there are `samples`."""

    name: Annotated[str, AfterValidator(_require_name)] = key("name of the task")
    step: Annotated[float, Unit("s", above=0, like="125 ms")] | None = key(
        "sampling time of the host", default=None
    )
    samples: Annotated[int, Field(ge=2)] | None = key(
        "number of samples of the host, both ends included", default=None
    )

    @model_validator(mode="after")
    def _one_rate(self) -> Self:
        if (self.step is None) == (self.samples is None):
            raise validation_error('give either step, e.g. "125 ms", or samples, e.g. 41')
        return self

    def divide(self, duration: float) -> float:
        """Return the host's step in s, for a motion of a duration."""
        return self.step if self.step is not None else duration / ((self.samples or 2) - 1)


class TaskTiming(TaskRate):
    """How long a task lasts, and how often the host commands."""

    duration: Annotated[float, Unit("s", above=0, like="5 s")] = key("duration of the motion")

    @property
    def dt(self) -> float:
        """Step of the host, in s."""
        return self.divide(self.duration)


@contextmanager
def _locate_program() -> Iterator[None]:
    """What is refused inside is a fault of the key `program`."""
    try:
        yield
    except MotionError as error:
        raise BadValue(
            str(error), nearest=getattr(error, "nearest", ""), key=("program",)
        ) from error


class PathTask(TaskTiming):
    """A program's path, run by one profile from end to end."""

    program: str = key("name of a bundled program, or path of its file")
    profile: Literal["quarter-sine", "trapezoid"] = key(
        "profile of the speed along the path", default="quarter-sine"
    )
    ramp: Annotated[float, Unit("s", above=0, like="1 s")] = key(
        "duration of acceleration, and of deceleration"
    )

    def refuse_unknown(self, axes: Sequence[Axis], folder: Path | None) -> None:
        """Raise BadValue for a program that is not there, or whose file shows a fault; a bundled
        one's shows none.
        """
        with _locate_program():
            program = resolve_path(folder, self.program)
            find("planner", "program", program)
            if program not in presets("planner"):
                from planner.program.program_file import read_program_file

                read_program_file(program)

    def make_task(self, machine: Machine, folder: Path | None) -> Task:
        from planner.path.actuation import actuate
        from planner.program.program_file import load_program

        with _locate_program():
            path = actuate(load_program(resolve_path(folder, self.program)), machine)
        return Task(
            self.name,
            time_path(path, self.profile, self.ramp / self.duration, self.duration),
            self.dt,
        )


class SineTable(TableSchema):
    """Of the axes named: amplitude · sin(2π t/period)."""

    axes: tuple[str, ...] = key("names of rotary axes")
    amplitude: Annotated[float, Unit("rad", above=0, like="90 deg")] = key("amplitude of the sine")
    period: Annotated[float, Unit("s", above=0)] = key("period of the sine")


class SineTask(TaskTiming):
    """Axes on their own, beyond any travel of the machine; the others rest."""

    sine: SineTable

    def refuse_unknown(self, axes: Sequence[Axis], folder: Path | None) -> None:
        """Raise BadValue for a name that is none of the rotary axes'."""
        kinds = {axis.name: axis.kind for axis in axes}
        for n, name in enumerate(self.sine.axes):
            if kinds.get(name) != "rotary":
                told = "is a linear axis" if name in kinds else f"is no axis{nearest(name, kinds)}"
                rotary = [axis for axis, kind in kinds.items() if kind == "rotary"]
                known = ", ".join(rotary) or "none"
                raise BadValue(
                    f"{describe_value(name)} {told}; rotary axes: {known}",
                    allowed=known,
                    nearest=closest(name, rotary),
                    key=("sine", "axes", n),
                )

    def make_task(self, machine: Machine, folder: Path | None) -> Task:
        amplitude = freeze_array(
            [self.sine.amplitude * (axis.name in self.sine.axes) for axis in machine.axes], float
        )
        omega = 6.283185307179586 / self.sine.period
        return Task(self.name, Sine(machine.home_q, amplitude, omega, self.duration), self.dt)


class FileTask(TaskRate):
    """Positions of axes over time, from a CSV file (`controllers.reference_file`); it lasts as long
    as its times.
    """

    reference: str = key(
        'path of a CSV file: "time [s], yaw [deg]", and "yaw speed [deg/s]" if known'
    )

    def refuse_unknown(self, axes: Sequence[Axis], folder: Path | None) -> None:
        """Raise MotionError for a file that is not there or has faults, or lacks an axis by its
        name.
        """
        self._read(axes, np.zeros(len(axes)), folder)

    def make_task(self, machine: Machine, folder: Path | None) -> Task:
        motion = self._read(machine.axes, machine.home_q, folder)
        return Task(self.name, motion, self.divide(motion.duration))

    def _read(self, axes: Sequence[Axis], home: Array, folder: Path | None) -> Recorded:
        try:
            path = Path(self.reference) if folder is None else folder / self.reference
            return read_reference(path, axes, home)
        except MotionError as error:
            raise BadValue(str(error), key=("reference",)) from error


TaskTable = Annotated[PathTask | SineTask | FileTask, one_of_tables(PathTask, SineTask, FileTask)]


def resolve_path(folder: Path | None, name_or_path: str) -> str | Path:
    """A name as it is; a path from the folder of the file that gives it."""
    path = Path(name_or_path)
    named = not path.suffix and path.name == name_or_path
    return name_or_path if named or folder is None else folder / path


CARDS = {card.name: card for card in (PCI_8132, PCI_8164)}


def _card(name: str) -> str:
    if name not in CARDS:
        told = f"{describe_value(name)} is not a known card{nearest(name, CARDS)}; cards: {', '.join(CARDS)}"
        raise validation_error(
            BadValue(told, allowed=", ".join(CARDS), nearest=closest(name, CARDS))
        )
    return name


CardName = Annotated[str, AfterValidator(_card)]


class CardTable(TableSchema):
    """A model of card, and how it is set: see `Card`."""

    model: CardName = key("model of the motion card")
    while_moving: Literal["replace", "queue"] = "replace"
    start_from: Literal["commanded", "current"] = "commanded"
    short_moves: Literal["keep rate", "keep time"] = "keep rate"
    current_speed: Literal["signed", "magnitude"] = "signed"
    speed_range: Annotated[float, Unit("1/s", above=0, like="100000 1/s")] | None = None

    @property
    def card(self) -> Card:
        return replace(CARDS[self.model], **self.model_dump(exclude={"model"}))


CardEntry = Annotated[
    CardName | CardTable, Chosen(lambda value: CardTable if isinstance(value, dict) else CardName)
]


class HostTable(TableSchema):
    """See `Host`."""

    timer: Literal["counter", "sleep"] = "counter"
    granularity: Annotated[float, Unit("s", least=0, like="10 ms")] = 0.0
    jitter: Annotated[float, Unit("s", least=0, like="2 ms")] = 0.0
    seed: Annotated[int, Field(ge=0)] = 0
    speed_from: Literal["encoder", "card"] = "encoder"
    closing_stop: Annotated[float, Unit("s", least=0, like="1 ms")] | None = None


class RigAxisTable(TableSchema):
    """What one axis has of its own: its kind of drive, and how that differs from all of its
    kind.
    """

    name: str
    servo: ServoTable | None = None
    stepper: StepperTable | None = None


class RigFile(File):
    """A rig, key by key. [servo] and [stepper] are what all drives of the kind have."""

    what: ClassVar[str] = "rig"
    machine: str = key(
        "name of a bundled machine, or path of its file",
        remedy='write the name of a machine, e.g. "arm", or the path of its file',
    )
    card: CardEntry = key("model and settings of the motion card", default=PCI_8132.name)
    host: HostTable = key("timing of the host", default=HostTable())
    servo: ServoTable | None = key("values that all servo drives share", default=None)
    stepper: StepperTable | None = key("values that all stepper drives share", default=None)
    axis: tuple[RigAxisTable, ...] = key(
        "`[[axis]]` tables by `name`: the `servo` or `stepper` of one axis", default=()
    )
    task: tuple[TaskTable, ...] = key("motions on which laws are compared", default=())
