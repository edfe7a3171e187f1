"""What a calibration found, how well the measured poses show it, and what its pulse lengths mean.

Observability, from the singular values σ_1 ≥ … ≥ σ_m of the identification Jacobian (errors divided
by their noise, by parameters), its columns scaled to unit length so that units drop out, with N
fitted poses:

    O1 = (σ_1 … σ_m)^(1/m) / √N    [Borm and Menq 1991]
    O2 = σ_m / σ_1                 [Driels and Pathre 1990]
    O3 = σ_m                       [Nahvi, Hollerbach and Hayward 1994]
    O4 = σ_m² / σ_1                [Nahvi and Hollerbach 1996]

More is better; all are 0 where a combination of parameters is not shown at all.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.calibration.measurements import AXIS, POSITION, ROTATION, Measurements, Noise
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun, nearest
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.machine.machine import Machine
from kinematics.machine.pose import Pose

MIN_SINGULAR_SHARE = 1e-9
"""σ / σ_1 below which a combination has no effect: far above the rounding of the Jacobian, below
any measurement.
"""
MIN_NAMED_SHARE = 0.05
"""Share of its largest coefficient from which on a parameter is named in a combination."""


MAX_CHANCE_SIGMAS = 5.0
"""Standard deviations of √(χ²/ν) that chance may account for."""
MIN_EVENNESS = 1 / 30
"""σ_m / σ_1 of unit columns below which they are nearly dependent [Belsley, Kuh and Welsch
1980].
"""


@dataclass(frozen=True, slots=True)
class Observability(Result):
    """singular (m,) σ falling; scale (m,) 1 / length of the columns; combinations (m, m) of scaled
    columns, in rows.
    """

    singular: Array
    scale: Array
    combinations: Array
    poses: int

    def tables(self) -> tuple[Table, ...]:
        """The indices: more is better."""
        seen = f"{self.rank} of {len(self.singular)} combinations of parameters are identifiable"
        return (
            Table(
                seen,
                tuple(Column(name, [value], form=".4g") for name, value in self.indices.items()),
            ),
        )

    def data(self) -> Table:
        """The singular value of each combination, the last seen worst."""
        numbered = Column("combination", range(1, len(self.singular) + 1))
        return Table(
            "singular values of the identification Jacobian", (numbered, Column("σ", self.singular))
        )

    @property
    def rank(self) -> int:
        """How many combinations of parameters the data show."""
        return int((self.singular > MIN_SINGULAR_SHARE * self.singular[0]).sum())

    @property
    def indices(self) -> dict[str, float]:
        """O1 to O4."""
        if self.rank < len(self.singular):
            return dict.fromkeys(("O1", "O2", "O3", "O4"), 0.0)
        first, last = float(self.singular[0]), float(self.singular[-1])
        mean = float(np.exp(np.log(self.singular).mean()))
        return {"O1": mean / self.poses**0.5, "O2": last / first, "O3": last, "O4": last**2 / first}

    @property
    def observable_changes(self) -> Array:
        """(m, rank) changes of the parameters that give independent errors of unit length."""
        kept = slice(0, self.rank)
        return np.asarray(self.scale[:, None] * self.combinations[kept].T / self.singular[kept])

    @property
    def unobservable_changes(self) -> Array:
        """(m − rank, m) changes of the parameters, in their own units, that no measured pose
        shows.
        """
        return np.asarray(self.combinations[self.rank :] * self.scale)

    @property
    def separate(self) -> np.ndarray:
        """(m,) bool: which parameters take part in no combination that is not shown."""
        return np.asarray(np.abs(self.combinations[self.rank :]).max(0, initial=0.0) < 1e-6)

    @property
    def weakest(self) -> Array:
        """(m,) the least visible change of the parameters, in their own units, as large as its
        standard error.
        """
        return np.asarray(self.combinations[-1] * self.scale / self.singular[-1])


def observe(jacobian: Array, poses: int) -> Observability:
    """Observability of a Jacobian (rows ≥ m, m) of errors divided by their noise.

    Raises MotionError for no numbers.
    """
    if not np.isfinite(jacobian).all():
        raise MotionError(
            "the identification Jacobian holds no numbers: a pose is singular, or cannot be closed"
        )
    length = np.linalg.norm(jacobian, axis=0)
    scale = np.divide(
        1.0, length, out=np.ones_like(length), where=length > 0
    )  # a column of zeros stays one
    _, singular, combinations = np.linalg.svd(jacobian * scale, full_matrices=False)
    return Observability(
        freeze_array(singular), freeze_array(scale), freeze_array(combinations), poses
    )


def describe_combination(change: Array, names: Sequence[str]) -> str:
    """A combination in words: its largest parameters with their coefficients, the largest first."""
    share = change / change[np.abs(change).argmax()]  # its sign means nothing
    order = [
        k for k in np.argsort(-np.abs(share), kind="stable") if abs(share[k]) >= MIN_NAMED_SHARE
    ]
    text = " ".join(
        f"{'−' if share[k] < 0 else '+'} {abs(share[k]):.2g}·{names[k]}" for k in order[:8]
    )
    return text.removeprefix("+ ") + (f" and {len(order) - 8} more" if len(order) > 8 else "")


GROUPS = {"position": POSITION, "rotation": ROTATION, "axis": AXIS}
"""Components that share a unit: position (m), rotation (rad), direction of the platform's z axis
(rad).
"""


def check_group(name: str) -> str:
    """A group's name. Raises MotionError for what is none."""
    if name not in GROUPS:
        raise MotionError(
            f'calibration: no group "{name}"{nearest(str(name), GROUPS)}; groups: {", ".join(GROUPS)}'
        )
    return name


def error_scale(noise: Noise | None, scale: float) -> float:
    """What standard errors of a noise are multiplied by: see `calibrate`.

    scale NaN: there are no data to spare.
    """
    if noise is None:
        return scale
    return 1.0 if np.isnan(scale) else max(1.0, scale)


@dataclass(frozen=True, slots=True)
class Estimate:
    """A parameter: value and nominal value in `unit` ("" for a factor).

    error  standard error, same unit; infinite: the data do not show it apart from others; NaN: no
           data to spare for it
    """

    name: str
    unit: str
    nominal: float
    value: float
    error: float


@dataclass(frozen=True, slots=True, repr=False)
class Calibration(Result):
    """The calibrated machine, the parameters, and the errors (N, 8), predicted − measured, NaN
    where not measured.

    machine     calibrated; its home is the pose at zero counts, so that offsets need no place of
                their own. Estimates of the measuring frame are among the parameters, but no part of
                it
    measurements  without the checks that were skipped
    predicted   poses (N) with the estimates, as seen in the measuring frame, relative to the
                nominal home pose
    before      errors with nominal parameters
    after       errors with the estimates
    left_out    errors of each fitted pose with the estimates that the other poses alone give, to
                first order (I − H_kk)⁻¹ e_k; NaN where the others do not suffice, and for poses
                that are checks
    used        (N, 8) bool: what the parameters were fitted to
    scale       √(χ² / degrees of freedom): root of residuals over stated noise; NaN without degrees
                of freedom
    degrees     of freedom
    skipped     why each check was left out that the machine cannot be sent to
    unseen      warning of combinations of parameters that the fitted poses do not show but others
                do; "" if none
    """

    machine: Machine
    nominal: Machine
    measurements: Measurements
    parts: tuple[str, ...]
    parameters: tuple[Estimate, ...]
    observability: Observability
    predicted: Pose
    before: Array
    after: Array
    left_out: Array
    used: np.ndarray
    scale: float
    degrees: int
    skipped: tuple[str, ...] = ()
    unseen: str = ""

    @property
    def stages(self) -> dict[str, Array]:
        """The errors by name: before, after, leave-one-out."""
        return {"before": self.before, "after": self.after, "leave-one-out": self.left_out}

    def rms(self, errors: Array, group: str = "position", *, fitted: bool = True) -> float:
        """Root mean square per component of a group of errors, over the fitted poses or the checks;
        NaN for none.
        """
        chosen = errors[self.measurements.fit == fitted][:, GROUPS[check_group(group)]]
        known = chosen[np.isfinite(chosen)]
        return float(np.sqrt(np.mean(known**2))) if known.size else np.nan

    def tables(self) -> tuple[Table, ...]:
        """The parameters with their standard errors, the errors before and after, and what the data
        show.
        """
        groups = [group for group in GROUPS if np.isfinite(self.rms(self.before, group))]
        units = ["m" if group == "position" else "rad" for group in groups]
        rms = (
            Column(
                stage,
                [self.rms(of, group) for group in groups],
                units,
                "micro",
                ".3f",
                words={"nan": "not fitted"},
            )
            for stage, of in self.stages.items()
            if any(np.isfinite(self.rms(of, group)) for group in groups)
        )
        errors = Table(
            f"calibration of {self.nominal.name} by {', '.join(self.parts)}: RMS per component at the fitted poses",
            (Column("error", groups), *rms),
            (
                *(f"warning: {text}" for text in self.warnings),
                *(f"skipped: {reason}" for reason in self.skipped),
            ),
        )
        own, unknown = (
            [one.unit for one in self.parameters],
            {"inf": "not identifiable", "nan": "unknown"},
        )
        parameters = (
            Column("parameter", self.names),
            Column("nominal", [one.nominal for one in self.parameters], own, "human", ".6f"),
            Column("identified", [one.value for one in self.parameters], own, "human", ".6f"),
            Column(
                "standard error",
                [one.error for one in self.parameters],
                own,
                "human",
                ".6f",
                words=unknown,
            ),
        )
        return errors, Table("parameters", parameters), *self.observability.tables()

    def data(self) -> Table:
        """The parameters."""
        return self.tables()[1]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons not to trust the estimates, a sentence each.

        - The residuals exceed the stated noise by more than chance: √(χ²/ν) scatters by 1/√(2ν)
          about 1.
        - A group of errors that was fitted is larger than with the nominal parameters.
        - There are fewer values to spare than parameters, so that a wrong model would not show.
        - The fitted poses do not show combinations of parameters that have an effect at other
          poses.
        - The columns of the Jacobian are nearly dependent, σ_m / σ_1 < 1/30 [Belsley, Kuh and
          Welsch 1980].
        """
        spare = self.degrees
        reasons = [self.unseen] if self.unseen else []
        limit = 1 + MAX_CHANCE_SIGMAS / np.sqrt(2 * max(spare, 1))
        faults = []
        if self.measurements.noise is not None and self.scale > limit:
            faults.append(f"the residuals are {self.scale:.2g} times the stated noise")
        for group, part in GROUPS.items():
            before, after = (self.rms(errors, group) for errors in (self.before, self.after))
            if (
                self.used[:, part].any()
                and after > limit * before
                and after > limit * self._noise_of(group)
            ):
                unit = "µm" if group == "position" else "µrad"
                faults.append(
                    f"the errors of the {group} got worse, {1e6 * before:.3g} to {1e6 * after:.3g} {unit}"
                )
        if faults:
            remedy = "identify other parameters (--model), or check the stated noise"
            reasons.append(
                f"the model does not explain the data: {', and '.join(faults)}; {remedy}"
            )
        count, poses = len(self.parameters), int(self.measurements.fit.sum())
        if spare < count:
            reasons.append(
                f"{int(self.used.sum())} values of {poses} pose{'s' if poses > 1 else ''} leave {spare} to spare for "
                f"{count} parameters, so a wrong model would not show; measure more poses"
            )
        evenness = self.observability.indices["O2"]
        if 0 < evenness < MIN_EVENNESS:
            weakest = describe_combination(self.observability.weakest, self.names)
            reasons.append(
                f"the parameters are hardly told apart (O2 {evenness:.2g}, below 1/30), least {weakest}; "
                "measure poses farther apart, or identify fewer parameters"
            )
        return tuple(reasons)

    def _noise_of(self, group: str) -> float:
        """Stated noise of a component of a group; 0 where none is stated."""
        noise = self.measurements.noise
        return 0.0 if noise is None else noise.position if group == "position" else noise.rotation

    def __repr__(self) -> str:
        return (
            f"<Calibration of {self.nominal.name}: {count_noun(len(self.parameters), 'parameter')}>"
        )

    def __getitem__(self, name: str) -> Estimate:
        found = {parameter.name: parameter for parameter in self.parameters}
        if name not in found:
            raise MotionError(
                f'calibration: no parameter "{name}"{nearest(name, found)}; parameters: {", ".join(found)}'
            )
        return found[name]

    @property
    def names(self) -> Sequence[str]:
        """Names of the parameters, in the order of the observability's columns."""
        return [parameter.name for parameter in self.parameters]


INCH = 0.0254
MAX_STEP_MISMATCH = 0.005
"""Share of a published step by which an identified pulse may differ from it and still be worth a
comparison.
"""


@dataclass(frozen=True, slots=True)
class Step:
    """A length per pulse (m) that a catalogue states, and of what."""

    length: float
    name: str


CATALOGUE = (
    Step(0.0000600 * INCH, "full step of the Haydon 43K4U-05 linear stepper, 0.00006 in"),
    Step(
        0.0000600 * INCH / 2, "half step of the Haydon 43K4U-05 linear stepper, half of 0.00006 in"
    ),
)
"""Steps of linear actuators, by their catalogues [Sahbaz 2007 has this one].

Which actuators a machine has, its file does not say: a step near an identified pulse is a hint, no
more.
"""


@dataclass(frozen=True, slots=True)
class Pulse:
    """What one pulse of an axis (or of every axis) moves it by, in `unit`; step: the catalogue's
    that it is near.
    """

    axis: str
    unit: str
    nominal: float
    value: float
    error: float
    step: Step | None


def identified_pulses(calibration: Calibration) -> tuple[Pulse, ...]:
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
    """The catalogue's step that a pulse (m) is nearest to; None where none is within half a
    percent.
    """
    step = min(CATALOGUE, key=lambda step: abs(pulse / step.length - 1))
    return step if abs(pulse / step.length - 1) < MAX_STEP_MISMATCH else None
