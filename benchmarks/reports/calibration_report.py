"""The report of a calibration: one self-contained HTML page, and its figures as PNG files."""

from math import isfinite
from pathlib import Path

import numpy as np

from benchmarks.reports.page import NARROW, Picture, draw_figure, render, save_figures, style
from kinematics.calibration import Calibration
from kinematics.calibration.checks import axis_checks
from kinematics.calibration.measurements import COMPONENTS
from kinematics.calibration.result import (
    GROUPS,
    Estimate,
    Pulse,
    describe_combination,
    identified_pulses,
)

MICRO_UNITS = {"m": ("µm", 1e6), "rad": ("µrad", 1e6), "": ("", 1.0)}
HUMAN_UNITS = {"m": ("mm", 1e3), "rad": ("mrad", 1e3), "": ("", 1.0)}
GROUP_UNITS = {"position": "µm", "rotation": "µrad", "axis": "µrad"}
MEANINGS = {
    "O1": (
        "how well the parameters are shown on the whole, for the number of poses",
        "(σ₁ … σₘ)^(1/m) / √N [Borm and Menq 1991]",
    ),
    "O2": (
        "how evenly: 1 where all combinations are shown alike, below 1/30 some are hardly told apart",
        "σₘ / σ₁ [Driels and Pathre 1990]",
    ),
    "O3": ("how well the weakest combination is shown", "σₘ [Nahvi, Hollerbach and Hayward 1994]"),
    "O4": ("how well and how evenly in one, O2 · O3", "σₘ² / σ₁ [Nahvi and Hollerbach 1996]"),
}


def write_calibration_report(calibration: Calibration, path: Path) -> None:
    """Write the page to `path`, and its figures as `figures/*.png` in the same folder."""
    figures = draw(calibration)
    path.write_text(_page(calibration, figures), encoding="utf-8")
    save_figures(figures, path)


def draw(calibration: Calibration) -> dict[str, Picture]:
    """Draw every figure of the page, by name, narrow enough for the screen of a telephone."""
    from kinematics.figures import singular_values
    from kinematics.foundation.figure import new_axes

    with style():
        groups = [
            group for group in GROUPS if np.isfinite(calibration.rms(calibration.before, group))
        ]
        figures = {
            group: draw_figure(calibration.plot(new_axes(None, (NARROW, 3.6)), group=group))
            for group in groups
        }
        singular = singular_values(calibration.observability, new_axes(None, (NARROW, 2.8)))
        return figures | {"singular": draw_figure(singular)}


def rms_by_stage(calibration: Calibration) -> dict[str, tuple[float, float, float]]:
    """RMS per component of the fitted poses, by group: before, after, leave-one-out (µm or µrad;
    NaN: not fitted).
    """
    errors = calibration.stages.values()
    rows = {group: [1e6 * calibration.rms(stage, group) for stage in errors] for group in GROUPS}
    return {group: (row[0], row[1], row[2]) for group, row in rows.items() if isfinite(row[0])}


def explain_pulse(pulse: Pulse) -> str:
    """Describe an identified pulse in a sentence or two."""
    unit, scale = MICRO_UNITS[pulse.unit]
    excess = pulse.value / pulse.nominal - 1
    error = f" ± {scale * pulse.error:.4f}" if isfinite(pulse.error) else ""
    text = (
        f"One pulse moves {pulse.axis} by {scale * pulse.value:.4f}{error} {unit}, {100 * abs(excess):.2f} % "
        f"{'more' if excess > 0 else 'less'} than the {scale * pulse.nominal:g} {unit} of the machine file."
    )
    if pulse.step is None:
        return text
    rest = pulse.value / pulse.step.length - 1
    errors = (
        abs(pulse.value - pulse.step.length) / pulse.error if 0 < pulse.error < np.inf else np.nan
    )
    times = f", {errors:.1f} standard errors" if isfinite(errors) else ""
    return (
        f"{text} Near it is {scale * pulse.step.length:g} {unit} ({pulse.step.name}), "
        f"{100 * (pulse.step.length / pulse.nominal - 1):+.2f} % against the machine file: if these are the machine's "
        f"actuators, {100 * rest:+.2f} %{times}, remain."
    )


def _row(estimate: Estimate) -> tuple[str, str, str, str, str, str]:
    """Name, nominal, estimate, change, standard error and unit, as the table shows them."""
    (unit, scale), (small, micro) = HUMAN_UNITS[estimate.unit], MICRO_UNITS[estimate.unit]
    change = micro * (estimate.value - estimate.nominal)
    if isfinite(estimate.error):
        error = (
            f"{micro * estimate.error:.6f}" if not unit else f"{micro * estimate.error:.2f} {small}"
        )
    else:
        error = "not identifiable" if estimate.error == np.inf else "unknown"
    nominal, value = (
        f"{scale * number:.{4 if unit else 6}f}" for number in (estimate.nominal, estimate.value)
    )
    return (
        estimate.name,
        nominal,
        value,
        f"{change:+.2f} {small}" if unit else f"{change:+.6f}",
        error,
        unit,
    )


def _page(calibration: Calibration, figures: dict[str, Picture]) -> str:
    observed, data = calibration.observability, calibration.measurements
    names = calibration.names
    return render(
        "calibration.html.j2",
        figures,
        calibration=calibration,
        source=Path(data.name).name,
        stages=rms_by_stage(calibration),
        group_units=GROUP_UNITS,
        values=int(calibration.used.sum()),
        parameters=[_row(estimate) for estimate in calibration.parameters],
        meanings=[explain_pulse(pulse) for pulse in identified_pulses(calibration)],
        indices=[(name, value, *MEANINGS[name]) for name, value in observed.indices.items()],
        unseen=[describe_combination(change, names) for change in observed.unobservable_changes],
        weakest=describe_combination(observed.weakest, names),
        errors={group: _errors(calibration, group) for group in rms_by_stage(calibration)},
        components={group: COMPONENTS[part] for group, part in GROUPS.items()},
        checks=axis_checks(calibration),
        degrees=np.rad2deg,
        isfinite=isfinite,
    )


def _errors(
    calibration: Calibration, group: str
) -> tuple[list[str], list[tuple[str, bool, list[str]]]]:
    """The stages that have errors; of each pose where the group was measured its label, whether it
    was fitted, and its errors stage by stage.
    """
    part, data = GROUPS[group], calibration.measurements
    stages = {
        name: stage[:, part]
        for name, stage in calibration.stages.items()
        if np.isfinite(stage[:, part]).any()
    }
    errors = np.concatenate(list(stages.values()), 1)
    return list(stages), [
        (
            data.labels[k],
            bool(data.fit[k]),
            [f"{1e6 * value:.1f}" if isfinite(value) else "–" for value in errors[k]],
        )
        for k in np.flatnonzero(np.isfinite(calibration.before[:, part]).any(1))
    ]
