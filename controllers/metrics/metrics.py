"""What is known of how one run tracked its motion: errors over time, their figures, and how the
motion ends.

The names under which the figures of a run go into tables and files, with what they are and in which
unit. What a motion costs the drives: torque, time at its limit; and how much the shafts shake: the
jerk of a shaft, and what of its error is faster than the host.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from controllers.rig import Rig
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from planner.place import Place

AT_LIMIT = 1 - 1e-9
"""Share of the limit from which a torque counts as being at it: rounding away from 1."""
TORQUE_BLOCK = 512
"""Samples looked at together: a few megabytes for a batch of a thousand runs."""


@dataclass(frozen=True, slots=True)
class Effort:
    """Torque (or force) over its limit in one run: RMS and peak; saturation, the share of time at
    the limit; (n,).
    """

    torque_rms: Array
    torque_peak: Array
    saturation: Array


def torque_limits(rigs: Sequence[Rig]) -> Array:
    """(B, n) N or N·m: of a servo its torque limit, of a stepper the largest of its curve, whatever
    its speed.
    """
    return np.array([[drive.torque_limit for drive in rig.drives] for rig in rigs])


def efforts(torque: Array, limit: Array) -> tuple[Effort, ...]:
    """Of B runs: torque (N, B, n) and its limit (B, n), N or N·m."""
    squares, at_limit, peak = np.zeros_like(limit), np.zeros_like(limit), np.zeros_like(limit)
    for start in range(0, len(torque), TORQUE_BLOCK):
        size = np.abs(torque[start : start + TORQUE_BLOCK])
        squares += np.einsum("tbn,tbn->bn", size, size)
        at_limit += np.count_nonzero(size >= AT_LIMIT * limit, axis=0)
        peak = np.maximum(peak, size.max(0))
    rms, peak, share = np.sqrt(squares / len(torque)) / limit, peak / limit, at_limit / len(torque)
    return tuple(Effort(*map(freeze_array, each)) for each in zip(rms, peak, share, strict=True))


BLOCK_SAMPLES = 1 << 20
"""Samples transformed together: a few times what a processor's cache holds."""
LOBE_BINS = 2
"""Half the width of a Hann window's main lobe, in bins."""


@dataclass(frozen=True, slots=True)
class Vibration:
    """Of the shafts of one run, from its record of true positions (no encoder, no rounding).

    sample    s between the samples
    above     Hz, 1/dt of the host
    jerk_rms  (n,) m/s³ or rad/s³: third differences over sample³, which see a tone at f as
              (sin(π f sample)/(π f sample))³ of its jerk
    power     (n,) m² or rad²: mean square of actual − planned position at frequencies from `above`
              on; nan where the samples are too far apart to see any
    """

    sample: float
    above: float
    jerk_rms: Array
    power: Array


def vibrations(
    t: Array, actual: Array, planned: Array, pulse: Array, host_step: float
) -> tuple[Vibration, ...]:
    """Of B runs: actual (N, B, n) and planned (N, n) positions in pulses at t (N,), s; pulse (n,),
    m or rad.

    Spectrum of the whole record, X = rfft(w (e − ē)) with Hann's window w: power = 2 Σ |X_k|² / (N
    Σ w²) over the bins with f_k ≥ 1/host_step, less the half width of the window's lobe: what
    repeats at every step of the host counts. A tone of amplitude A there has A²/2.
    """
    n, (runs, axes) = len(t), actual.shape[1:]
    sample, above = float(t[1] - t[0]), 1 / host_step
    first = int(np.ceil(above * n * sample - 1e-6)) - LOBE_BINS
    window = np.sin(np.pi * np.arange(n) / n) ** 2
    weight = np.full(n // 2 + 1, 2.0)
    weight[0], weight[-1] = 1.0, 1.0 if n % 2 == 0 else 2.0
    jerk, power = np.empty((runs, axes)), np.full((runs, axes), np.nan)
    at_once = max(1, BLOCK_SAMPLES // (n * axes))
    for start in range(0, runs, at_once):
        some = slice(start, start + at_once)
        lanes = np.ascontiguousarray(np.moveaxis(actual[:, some], 0, -1))
        jerk[some] = np.sqrt(np.mean(np.diff(lanes, 3) ** 2, -1)) / sample**3 if n > 3 else np.nan
        if LOBE_BINS < first < len(weight) - 1:
            error = lanes - planned.T
            error -= error.mean(-1, keepdims=True)
            spectrum = np.fft.rfft(error * window)[..., first:]
            power[some] = (
                (spectrum.real**2 + spectrum.imag**2) @ weight[first:] / (n * np.sum(window**2))
            )
    jerk, power = jerk * pulse, power * pulse**2
    return tuple(
        Vibration(sample, above, freeze_array(j), freeze_array(p))
        for j, p in zip(jerk, power, strict=True)
    )


END_BAND = 10.0
"""Pulses about the last planned position within which an axis counts as being there.

Assumed: no source states one; it is 0.024° of an output turn on the thesis' servo rig, 7.5 µm on
its hexapod.
"""
BLOCK_INSTANTS = 256
"""Samples looked at together, from the last one back."""


@dataclass(frozen=True, slots=True)
class Ending:
    """The end of one run, to a sample of its record.

    band       pulses
    end_time   s, from which all axes stay within the band to the end of the record; inf if they are
               not in it then
    late       s, end_time − planned duration
    settling   (n,) s of each axis after the planned duration, 0 or more
    overshoot  (n,) m or rad, 0 or more: beyond the last position, seen in the direction in which
               the plan came to it
    """

    band: float
    end_time: float
    late: float
    settling: Array
    overshoot: Array


def endings(
    t: Array, actual: Array, planned: Array, duration: float, pulse: Array, band: float = END_BAND
) -> tuple[Ending, ...]:
    """Of B runs: actual (N, B, n) and planned (N, n) positions in pulses at t (N,), s; pulse (n,),
    m or rad.

    A run is within the band where |q − q_end| ≤ band on every axis.
    """
    end = planned[-1]
    since = _settling_instants(t, actual, end, band)
    way = end - planned
    last = len(way) - 1 - np.argmax(way[::-1] != 0, axis=0)
    # a step has no way of its own: the axes tell where they came from
    way = np.where((way != 0).any(0), np.take_along_axis(way, last[None], 0)[0], end - actual[0])
    after = actual[t >= min(duration, t[-1])]
    beyond = np.where(way > 0, after.max(0) - end, np.where(way < 0, end - after.min(0), 0.0))
    overshoot = np.maximum(beyond, 0.0) * pulse
    ends = since.max(1)
    return tuple(
        Ending(
            band,
            float(ends[b]),
            float(ends[b] - duration),
            *map(freeze_array, (np.maximum(of - duration, 0.0), over)),
        )
        for b, (of, over) in enumerate(zip(since, overshoot, strict=True))
    )


def _settling_instants(t: Array, actual: Array, end: Array, band: float) -> Array:
    """(B, n) instants from which each axis stays within the band; looked for from the end back,
    where they are.
    """
    since = np.full(actual.shape[1:], t[0])
    open_ = np.ones(actual.shape[1:], bool)
    for stop in range(len(t), 0, -BLOCK_INSTANTS):
        start = max(stop - BLOCK_INSTANTS, 0)
        out = ~(np.abs(actual[start:stop] - end) <= band)
        found = open_ & out.any(0)
        first_in = stop - np.argmax(out[::-1], axis=0)
        since[found] = np.append(t, np.inf)[first_in[found]]
        open_ &= ~found
        if not open_.any():
            break
    return since


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure of a run; smaller is better in all of them.

    unit  SI; "axis" stands for the axis' own, m or rad, and "path" for m, or rad where the motion
          is of turning axes alone and has no path in space
    per_axis  it is there for each axis too, as `<name>.<axis>`: the plain name is then the worst
              axis' value
    """

    name: str
    unit: str
    meaning: str
    per_axis: bool = False


FIGURES = (
    Figure("contour_rms", "path", "distance to the path, RMS over time"),
    Figure("contour_p95", "path", "distance to the path that 95 % of the time stays under"),
    Figure("contour_max", "path", "largest distance to the path"),
    Figure("contour_max_at", "s", "when it is largest"),
    Figure("tracking_rms", "path", "distance to where the plan is at that time, RMS"),
    Figure("tracking_p95", "path", "that 95 % of the time stays under"),
    Figure("tracking_max", "path", "largest"),
    Figure("lag_rms", "path", "how far ahead or behind along the path, RMS"),
    Figure("lag_max", "path", "largest"),
    Figure("orientation_rms", "rad", "angle to the planned orientation, RMS"),
    Figure("orientation_max", "rad", "largest"),
    Figure("following_rms", "axis", "actual − planned position of an axis, RMS", per_axis=True),
    Figure("following_max", "axis", "largest", per_axis=True),
    Figure(
        "settling",
        "s",
        "from the planned end until an axis stays within the band about its last position",
        per_axis=True,
    ),
    Figure(
        "overshoot",
        "axis",
        "how far an axis goes beyond its last position after the planned end",
        per_axis=True,
    ),
    Figure(
        "end_time", "s", "instant from which all axes stay within the band; inf if they never do"
    ),
    Figure("late", "s", "end_time − planned duration; below 0 for a motion that is there early"),
    Figure("jerk_rms", "axis/s³", "jerk of the axis' shaft, RMS", per_axis=True),
    Figure(
        "vibration_power",
        "axis²",
        "mean square of the following error from the host's sample rate upwards",
        per_axis=True,
    ),
    Figure("torque_rms", "1", "torque over its limit, RMS", per_axis=True),
    Figure("torque_peak", "1", "torque over its limit, largest", per_axis=True),
    Figure("saturation", "1", "share of the time at the torque limit", per_axis=True),
    Figure("lost_steps", "full steps", "steps that a stepper has lost", per_axis=True),
)


@dataclass(frozen=True, slots=True)
class ErrorSeries:
    """An error over time: values (N,), m or rad, signed where it has a sign; its figures are of the
    magnitude.
    """

    name: str
    unit: str
    value: Array = field(repr=False)
    where: Place
    """Where the magnitude is largest."""

    @property
    def rms(self) -> float:
        """√(mean e²)."""
        return float(np.sqrt(np.mean(self.value**2)))

    @property
    def p95(self) -> float:
        """The magnitude that 95 % of the instants stay under."""
        return float(np.percentile(np.abs(self.value), 95))

    @property
    def max(self) -> float:
        """max |e|."""
        return float(np.abs(self.value).max())


@dataclass(frozen=True, slots=True)
class Metrics(Result):
    """Errors of one tracked motion at instants t (N,), s, settling included, with effort and
    vibration.

    following    actual − planned of each axis, m or rad
    tracking     ‖e‖, e = y(t) − r(t), of the platform's origin, m
    lag          t̂ᵀe along the path, signed: below 0 it is behind
    orientation  ‖log(R_rᵀ R)‖, rad; None where the motion has no path in space
    contour      ε = min over s of ‖y(t) − r(s)‖, m; never more than `tracking`
    pulse        (n,) m or rad per pulse: axes are compared by pulses
    planned, attained  (N, 3) m, where the platform's origin should have been and was
    effort       None where torques are not recorded
    lost_steps   (n,) full steps; None where they are not counted

    Of a motion that has no path in space, tracking, lag and contour error are those of its axes'
    positions together, (N, n) of which are planned and attained: m, or rad on turning axes.
    """

    law: str
    t: Array = field(repr=False)
    following: tuple[ErrorSeries, ...]
    tracking: ErrorSeries
    lag: ErrorSeries
    orientation: ErrorSeries | None
    contour: ErrorSeries
    ending: Ending
    vibration: Vibration
    pulse: Array
    planned: Array = field(repr=False)
    attained: Array = field(repr=False)
    effort: Effort | None = None
    lost_steps: Array | None = None

    @property
    def series(self) -> tuple[ErrorSeries, ...]:
        """All of them, axes first."""
        space = (self.tracking, self.lag, self.orientation, self.contour)
        return (*self.following, *(series for series in space if series is not None))

    def figures(self) -> dict[str, float]:
        """Every figure by its name, see `FIGURES`: nan where it is not known, inf where the motion
        never came to rest.

        Of what each axis has, `<name>.<axis>` is an axis' own and `<name>` the worst one's, by
        pulses.
        """
        of_axes = self._of_axes()
        found = {
            "contour_rms": self.contour.rms,
            "contour_p95": self.contour.p95,
            "contour_max": self.contour.max,
            "contour_max_at": np.nan if self.contour.where.t is None else self.contour.where.t,
            "tracking_rms": self.tracking.rms,
            "tracking_p95": self.tracking.p95,
            "tracking_max": self.tracking.max,
            "lag_rms": self.lag.rms,
            "lag_max": self.lag.max,
            "orientation_rms": np.nan if self.orientation is None else self.orientation.rms,
            "orientation_max": np.nan if self.orientation is None else self.orientation.max,
            "end_time": self.ending.end_time,
            "late": self.ending.late,
            **{
                name: values[int(np.argmax(values * own))]
                for name, (values, own) in of_axes.items()
            },
        }
        axes = [series.name for series in self.following]
        return {figure.name: float(found[figure.name]) for figure in FIGURES} | {
            f"{name}.{axis}": float(value)
            for name, (values, _) in of_axes.items()
            for axis, value in zip(axes, values, strict=True)
        }

    def _of_axes(self) -> dict[str, tuple[Array, Array]]:
        """Figures that each axis has (n,), and the factors (n,) by which axes compare."""
        alike, unknown = np.ones(len(self.following)), np.full(len(self.following), np.nan)
        effort = self.effort or Effort(unknown, unknown, unknown)
        counted = 1 / self.pulse
        return {
            "following_rms": (np.array([series.rms for series in self.following]), counted),
            "following_max": (np.array([series.max for series in self.following]), counted),
            "settling": (self.ending.settling, alike),
            "overshoot": (self.ending.overshoot, counted),
            "jerk_rms": (self.vibration.jerk_rms, counted),
            "vibration_power": (self.vibration.power, counted**2),
            "torque_rms": (effort.torque_rms, alike),
            "torque_peak": (effort.torque_peak, alike),
            "saturation": (effort.saturation, alike),
            "lost_steps": (unknown if self.lost_steps is None else self.lost_steps, alike),
        }

    def tables(self) -> tuple[Table, ...]:
        """The errors of each axis and in space; what they cost the drives."""
        units = [series.unit for series in self.series]
        errors = Table(
            self.law,
            (
                Column("error", [series.name for series in self.series]),
                *(
                    Column(
                        title,
                        [getattr(series, title.lower()) for series in self.series],
                        units,
                        "micro",
                        ".3f",
                    )
                    for title in ("RMS", "P95", "max")
                ),
                *Place.columns([series.where for series in self.series]),
            ),
        )
        figures = self.figures()
        costs = [
            figure
            for figure in FIGURES[[figure.name for figure in FIGURES].index("settling") :]
            if np.isfinite(figures[figure.name]) or figure.name == "end_time"
        ]
        cost = Table(
            "what it cost, the largest of the axes",
            (
                Column("figure", [figure.name for figure in costs]),
                Column("value", [figures[figure.name] for figure in costs], form=".4g"),
                Column("unit", [figure.unit for figure in costs]),
                Column("meaning", [figure.meaning for figure in costs]),
            ),
        )
        return errors, cost
