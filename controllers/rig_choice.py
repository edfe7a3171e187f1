"""Which rig stands behind a machine's axes: the one that is given, or the bundled one that fits."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import replace
from os import PathLike

from controllers.rig import Rig
from controllers.rig_file import load_rig
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import add_article, find, presets
from kinematics.machine.machine import Machine
from kinematics.machine.machine_file import load_machine

MAX_PULSE_MISMATCH = 0.05
"""By what share a machine's pulse may differ from that of a rig's own machine: calibration changes
it by some per cent, another screw or other steps by much more.
"""
WRITE_REMEDY = 'write a rig file for it, as the guide "Choose gains on a rig" shows'


def choose_rig(machine: Machine, rig: Rig | str | PathLike[str] | None) -> Rig:
    """The rig that is given, by itself, its name or its file, behind this machine; else the bundled
    one that fits it.

    Raises MotionError where the given one does not fit, and where none is given and not exactly one
    bundled rig fits: drives that nobody stated are never made up.
    """
    if rig is not None:
        return fit_rig(rig if isinstance(rig, Rig) else load_rig(rig), machine)
    fitting = fitting_rigs(machine)
    if len(fitting) != 1:
        raise MotionError(
            f"no rig is given, so the drives of {machine.name} are not known: {rig_hint(machine)}"
        )
    return fit_rig(load_rig(fitting[0]), machine)


def fit_rig(rig: Rig, machine: Machine) -> Rig:
    """The rig with this machine in place of its own, and without its tasks if that is another.

    It fits a machine of the same kind, whose axes have the same names and kinds, and pulses of the
    same length to 5 %: so a calibrated machine, or one with other limits. Raises MotionError with
    what differs first.
    """
    if rig.machine is machine:
        return rig
    differs = next(_differences(rig.machine, machine), None)
    if differs is not None:
        raise MotionError(
            f"rig {rig.name} does not fit {machine.name}: {differs}; {rig_hint(machine)}"
        )
    return replace(rig, machine=machine, tasks=())


def fitting_rigs(machine: Machine) -> tuple[str, ...]:
    """Names of the bundled rigs that fit a machine."""
    return tuple(
        name
        for name, own in _list_bundled()
        if _kind(own) == _kind(machine) and _fits(own, machine)
    )


def rig_hint(machine: Machine) -> str:
    """What rig to take for this machine."""
    fitting = fitting_rigs(machine)
    if not fitting:
        return f"no bundled rig fits its axes; {WRITE_REMEDY}"
    several = len(fitting) > 1
    return f"the bundled rig{'s' if several else ''} {', '.join(fitting)} fit{'' if several else 's'} it"


def _list_bundled() -> Iterator[tuple[str, str]]:
    """Every bundled rig's name, and that of its machine."""
    for name, file in presets("controllers").items():
        yield name, tomllib.loads(file.read_text(encoding="utf-8"))["machine"]


def _kind(machine: Machine | str) -> str:
    """From the file of a bundled machine alone, since some cannot be loaded everywhere."""
    if isinstance(machine, str):
        return str(
            tomllib.loads(find("kinematics", "machine", machine).read_text(encoding="utf-8"))[
                "kind"
            ]
        )
    return type(machine).__name__.lower()


def _fits(own: str, machine: Machine) -> bool:
    return next(_differences(load_machine(own), machine), None) is None


def _differences(own: Machine, machine: Machine) -> Iterator[str]:
    """How a machine differs from a rig's own in what matters to drives."""
    if type(own) is not type(machine):
        yield f"its machine {own.name} is {add_article(_kind(own))}, this is {add_article(_kind(machine))}"
        return
    names, others = ([axis.name for axis in of.axes] for of in (own, machine))
    if names != others:
        yield f"it has drives for {', '.join(names)}; the machine's axes are {', '.join(others)}"
        return
    for axis, other in zip(own.axes, machine.axes, strict=True):
        if axis.kind != other.kind:
            yield f"its {axis.name} is {axis.kind}, the machine's is {other.kind}"
        elif abs(axis.pulse - other.pulse) > MAX_PULSE_MISMATCH * axis.pulse:
            unit, scale = ("µm", 1e6) if axis.unit == "m" else ("mrad", 1e3)
            own_pulse, pulse = scale * axis.pulse, scale * other.pulse
            yield f"a pulse of {axis.name} is {own_pulse:.6g} {unit} on it and {pulse:.6g} {unit} on the machine"
