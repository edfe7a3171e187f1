"""What an identified pulse length means: beside the machine file's, and the published step that it is near."""

from dataclasses import dataclass

from kinematics.calibration.result import Calibration

INCH = 0.0254
NEAR = 0.005
"""Share of a published step by which an identified pulse may differ from it and still be worth a comparison."""


@dataclass(frozen=True, slots=True)
class Step:
    """A length per pulse (m) that a catalogue states, and of what."""

    length: float
    name: str


CATALOGUE = (
    Step(0.0000600 * INCH, "full step of the Haydon 43K4U-05 linear stepper, 0.00006 in"),
    Step(0.0000600 * INCH / 2, "half step of the Haydon 43K4U-05 linear stepper, half of 0.00006 in"),
)
"""Steps of linear actuators, by their catalogues [Sahbaz 2007 has this one]. Which actuators a machine has, its file
does not say: a step near an identified pulse is a hint, no more."""


@dataclass(frozen=True, slots=True)
class Pulse:
    """What one pulse of an axis (or of every axis) moves it by, in `unit`; step: the catalogue's that it is near."""

    axis: str
    unit: str
    nominal: float
    value: float
    error: float
    step: Step | None


def pulses(calibration: Calibration) -> tuple[Pulse, ...]:
    """The pulse of each factor that was identified."""
    named = {f"{axis.name} factor": axis for axis in calibration.nominal.axes}
    found = []
    for parameter in calibration.parameters:
        if parameter.name == "factor":
            alike = {(axis.pulse, axis.unit) for axis in calibration.nominal.axes}
            # axes of different pulses share the factor, but no pulse
            owners = [("every axis", *pair) for pair in alike] if len(alike) == 1 else []
        else:
            axis = named.get(parameter.name)
            owners = [] if axis is None else [(axis.name, axis.pulse, axis.unit)]
        for name, nominal, unit in owners:
            value = nominal * parameter.value
            step = nearest_step(value) if unit == "m" else None
            found.append(Pulse(name, unit, nominal, value, nominal * parameter.error, step))
    return tuple(found)


def nearest_step(pulse: float) -> Step | None:
    """The catalogue's step that a pulse (m) is nearest to; None where none is within half a percent."""
    step = min(CATALOGUE, key=lambda step: abs(pulse / step.length - 1))
    return step if abs(pulse / step.length - 1) < NEAR else None
