"""Compare motions, pulses, exported files and records with stored ones while the code is rebuilt.

    python -m pytest tests/test_unchanged.py         # compare
    python -m tests.test_unchanged --record          # print and store what left its tolerance
    python -m tests.test_unchanged --record plans    # write the stored plan directories again

This file goes when the rebuilding is done: it protects outputs, whether they are right or not.

Everything is called through the front door: names of `pulsepath`, and the command line.

The data are in tests/unchanged:

inputs/       programs and machines, as users write them
values.json   numbers of freshly planned motions. Each is compared within a tolerance, since an
              optimum depends on the processor in its last digits (BLAS, vector instructions).
plans/        plan directories. Commands that read one start from its stored motion, so that no
              solver is between it and the exported file.
exports/      files exported from `plans`, binary ones decoded to text: every word and number
              is compared.

What may be recorded anew, and when:

- A change that is meant (a fault corrected, a faster motion): `--record`; review each line.
- A new format of the plan directory: `--record plans`. The files in `exports` must still agree:
  they do not depend on that format.
- A new key of a record: `--record`. A key that goes, or another exit code, changes what users read.
"""

import json
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from scipy.interpolate import CubicSpline

import pulsepath as pp
from pulsepath.cli import main

DATA = Path(__file__).parent / "unchanged"
INPUTS = DATA / "inputs"
PLANS = DATA / "plans"
EXPORTS = DATA / "exports"
VALUES = DATA / "values.json"

# The tolerances leave room for another processor: all values were within them with kernels compiled
# for a generic one (NUMBA_CPU_NAME=generic, OPENBLAS_CORETYPE=Prescott, NumPy and glibc without
# AVX2 and FMA; 27 November 2026).

# Relative. Solvers stop when they are within 1e-9 of their limits; a limit that is off by 1e-5 of
# itself shows.
DURATION = 1e-6
# Of the path's length or an axis' range: where the motion is at a stated share of its duration.
PLACE = 1e-6
# Of a limit, absolute: a proved bound is refined until it is within 1e-6 of what is attained.
USE = 2e-6
# Relative. A proved lower bound depends on where its optimizer stops.
BOUND = 1e-4
# Relative: errors of a simulated drive, parameters of a fit.
RESULT = 1e-6
# Absolute, SI: what is smaller is rounding (1 nm, 1 ns, 1 nrad).
NOISE = 1e-9
# Instants at which a motion is sampled.
SAMPLES = 20


# --- values and their comparison


@dataclass(frozen=True)
class Checked:
    """A value, or a list of numbers, and its largest absolute deviation (0: equal).

    share: of a list, the share of numbers that may deviate at all; the others are equal.
    """

    value: Any
    tolerance: float = 0.0
    share: float = 1.0

    def differs_from(self, stored: Any) -> str:
        """Describe how the stored value differs; "" if it is within the tolerance."""
        if stored == self.value:
            return ""
        if isinstance(stored, bool) or not _are_numbers(stored, self.value):
            return f"{_shorten(stored)} -> {_shorten(self.value)}"
        old, new = np.atleast_1d(stored), np.atleast_1d(self.value)
        if old.shape != new.shape:
            return f"{len(old)} numbers -> {len(new)}"
        deviation = np.abs(new - old)
        many = np.count_nonzero(deviation) > self.share * len(old)
        if not many and (deviation <= self.tolerance).all():
            return ""
        worst = int(np.argmax(deviation))
        place = f" (number {worst + 1} of {len(old)})" if len(old) > 1 else ""
        place += f", {np.count_nonzero(deviation)} differ" if many else ""
        change = f"{old[worst]:.12g} -> {new[worst]:.12g}{place}"
        return (
            f"{change}, difference {new[worst] - old[worst]:+.3g}, tolerance {self.tolerance:.3g}"
        )


Values = dict[str, Checked]


def _are_numbers(*values: Any) -> bool:
    """Return whether all are finite numbers, or lists of them."""
    for value in values:
        array = np.atleast_1d(np.asarray(value))
        if array.dtype.kind not in "iuf" or not np.isfinite(array.astype(float)).all():
            return False
    return True


def _shorten(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 120 else f"{text[:120]}…"


def exact(value: Any) -> Checked:
    """A value that must be equal."""
    return Checked(value.tolist() if isinstance(value, np.ndarray) else value)


def near(value: Any, relative: float, absolute: float = 0.0) -> Checked:
    """A number or an array, within a share of its largest magnitude or an absolute deviation."""
    array = np.asarray(value, float)
    size = float(np.abs(array).max(initial=0.0))
    tolerance = max(relative * size, absolute)
    rounded = [float(f"{number:.9g}") for number in array.ravel()]
    return Checked(rounded if array.ndim else rounded[0], tolerance)


def describe_motion(name: str, motion: Any) -> Values:
    """Return what must not change of a plan, a section of one, or a solution without a machine."""
    trajectory = motion.trajectory
    t = np.linspace(0.0, trajectory.duration, SAMPLES)
    state = trajectory.at(t)
    length = float(np.ptp(state.s))
    values = {
        f"{name}: duration": near(motion.trajectory.duration, DURATION),
        f"{name}: s": near(state.s, 0.0, PLACE * length),
        f"{name}: holds": exact(bool(motion.certificate.holds)),
        # a third of the instants is enough for the axes: they follow from s
        f"{name}: q": near(state.q[::3], 0.0, PLACE * float(np.ptp(state.q, axis=0).max())),
    }
    for limit, use in motion.certificate.worst.items():
        values[f"{name}: use of {limit}"] = describe_use(limit, use)
    if hasattr(motion, "pulses"):
        values |= describe_pulses(name, motion.pulses, t)
    return values


def describe_use(limit: str, use: float) -> Checked:
    """Return how much of a limit is used.

    A constant speed may be off by 1e-9 of itself, which is rounding: only that it is kept is
    compared.
    """
    return exact(bool(use <= 1.0)) if limit == "constant speed" else near(use, 0.0, USE)


def describe_pulses(name: str, pulses: Any, t: np.ndarray) -> Values:
    """Return how many pulses there are, where they end, and the counts at instants.

    The number of pulses follows from where axes turn back, which the path alone states.
    """
    counts = pulses.counts(t)
    values = {
        f"{name}: clock": exact(pulses.clock_hz),
        f"{name}: pulses": exact([len(axis.ticks) for axis in pulses.axes]),
        f"{name}: start": exact([int(axis.start) for axis in pulses.axes]),
        f"{name}: final": exact(counts[-1]),
    }
    for k, axis in enumerate(pulses.axes):
        # an instant that falls on a pulse may be before or after it
        values[f"{name}: counts of {getattr(axis, 'name', k)}"] = near(counts[:, k], 0.0, 1.0)
    return values


# --- the cases: each returns its values

CASES: dict[str, Callable[[Path], Values]] = {}


def case(function: Callable[[Path], Values]) -> Callable[[Path], Values]:
    """Register a case by its name."""
    CASES[function.__name__] = function
    return function


@case
def bundled_programs(_: Path) -> Values:
    """Each kind of machine, both orders: motions, proofs, pulses and lower bounds."""
    values = {}
    for name, orders, bounded in (
        ("bare-circle", (2, 3), True),
        ("tripod-circle", (3,), True),
        ("arm-line", (2, 3), True),
        ("linkage-line", (2, 3), True),
        ("traverser-scan", (2,), True),
        ("blended", (3,), False),
        ("circle", (3,), False),
    ):
        program = pp.load_program(name)
        for order in orders:
            plan = pp.plan(program, program.machine, order=order)
            label = f"{name} order {order}"
            values |= describe_motion(label, plan)
            values[f"{label}: estimate"] = near(plan.lower_estimate, DURATION)
            if bounded:
                values[f"{label}: lower bound"] = near(plan.lower_bound, BOUND)
    return values


@case
def own_programs(_: Path) -> Values:
    """A delta, a SCARA robot, triggers, a dwell, a constant speed, a shaper."""
    values = {}
    for name, machine in (
        ("pick", None),
        ("bead", None),
        ("curved", "bench"),
        ("straight", "bench"),
        ("constant", "bench"),
        ("straight", "shaped-bench"),
    ):
        program = pp.load_program(INPUTS / f"{name}.toml")
        chosen = program.machine if machine is None else INPUTS / f"{machine}.toml"
        plan = pp.plan(program, chosen)
        label = f"{name} on {machine or chosen}"
        values |= describe_motion(label, plan)
        values[f"{label}: whole duration"] = near(plan.duration, DURATION)
        values[f"{label}: triggers"] = exact([trigger.name for trigger in plan.triggers])
        for trigger in plan.triggers:
            values[f"{label}: trigger {trigger.name}"] = near(trigger.time, DURATION)
    return values


@case
def goals(_: Path) -> Values:
    """A stated duration, the least of time and heat, a proved gap; and what limits are worth."""
    values = {}
    for label, options in (
        ("duration", {"duration": 3.0}),
        ("time and heat", {"objective": "time + 0.2 heat"}),
        ("gap", {"gap": 2e-4}),
        ("clock", {"clock_hz": 16_000_000}),
    ):
        plan = pp.plan("arm-line", "arm", **options)
        values |= describe_motion(label, plan)
    return values


@case
def baselines(_: Path) -> Values:
    """Durations of the timings that savings are measured against."""
    plan = pp.plan("arm-line", "arm")
    values = {}
    for kind in ("trapezoid", "s-curve", "quarter-sine", "synchronised", "independent"):
        timing = pp.classical(plan, kind)
        values[kind] = near(timing.duration, DURATION)
        values[f"{kind}: holds"] = exact(bool(timing.certificate.holds))
    return values


@case
def bare_paths(_: Path) -> Values:
    """Paths without a machine."""
    values = {}
    for axes, points in ((1, 4), (3, 9), (6, 15)):
        k = np.arange(points)[:, None] * (1 + np.arange(axes)) + 1
        path = CubicSpline(np.linspace(0, 1, points), np.sin(k), bc_type="natural")
        for order, jerk in ((2, None), (3, 200.0)):
            solution = pp.time_optimal(path, max_speed=1.5, max_acceleration=10.0, max_jerk=jerk)
            values |= describe_motion(f"{axes} axes order {order}", solution)
            values[f"{axes} axes order {order}: lower bound"] = near(solution.lower_bound, BOUND)
    return values


@case
def firing_rules(_: Path) -> Values:
    """All pulses of a motion that has a closed form, by each rule.

    Their times are rounded to ticks of 0.1 µs, so that another processor may move one in a thousand
    by a tick: one in 50 may be moved.
    """
    values = {}
    program = pp.load_program(INPUTS / "straight.toml")
    for rule in (
        "nearest",
        "nearest:hysteresis=0.3",
        "floor",
        "sampled:period=50us",
        "dda:spacing=5ms,pulses_per_count=2,rate=50kHz",
        "timer",
    ):
        plan = pp.plan(program, INPUTS / "bench.toml", rule=rule)
        for axis, name in zip(plan.pulses.axes, "XYZ", strict=True):
            values[f"{rule}: {name}: ticks"] = Checked(
                axis.ticks.tolist(), tolerance=1.0, share=0.02
            )
            values[f"{rule}: {name}: directions"] = exact(_write_signs(axis.direction))
            values[f"{rule}: {name}: bound"] = near(axis.bound, RESULT)
    return values


def _write_signs(directions: np.ndarray) -> str:
    """Return runs of equal directions, as "+100 -100"."""
    ends = np.flatnonzero(np.diff(directions, append=0))
    lengths = np.diff(ends, prepend=-1)
    return " ".join(f"{int(n * directions[end]):+d}" for n, end in zip(lengths, ends, strict=True))


@case
def hold_and_resume(_: Path) -> Values:
    """A stop, the way on from it at full and at half speed, of a stored motion."""
    plan = pp.load_plan(PLANS / "curved")
    values = {}
    stop = plan.hold(0.05)
    values |= describe_motion("stop", stop)
    values |= describe_motion("way on", plan.resume(stop))
    values |= describe_motion("way on at half speed", plan.resume(stop, 0.5))
    return values


# --- the command line


def call(*words: object) -> Result:
    """Run the command line in this process."""
    return CliRunner().invoke(main, [str(word) for word in words])


def call_json(*words: object) -> Any:
    """Run a command that must succeed and return its JSON."""
    result = call(*words, "--json")
    assert result.exit_code == 0, f"{words}: exit code {result.exit_code}: {result.stderr[-300:]}"
    return json.loads(result.stdout)


def write_plan(folder: Path, *words: object) -> Any:
    """Plan to a folder and return its record."""
    result = call("plan", *words, "--out", folder, "--no-figures", "-q")
    assert result.exit_code == 0, f"{words}: exit code {result.exit_code}: {result.stderr[-300:]}"
    return json.loads((folder / "plan.json").read_text())


def flatten(record: Any, skip: tuple[str, ...] = (), at: str = "") -> Iterator[tuple[str, Any]]:
    """Yield path and value of each leaf of a record."""
    if isinstance(record, dict):
        for key, value in record.items():
            if key not in skip:
                yield from flatten(value, skip, f"{at}.{key}" if at else key)
    elif isinstance(record, list) and not _are_numbers(record):
        for k, value in enumerate(record):
            yield from flatten(value, skip, f"{at}[{k}]")
    else:
        yield at, record


def outline(record: Any) -> list[str]:
    """Return the paths of a record's keys, each once."""
    return sorted({re.sub(r"\[\d+\]", "[]", path) for path, _ in flatten(record)})


def describe_record(name: str, record: Any, skip: tuple[str, ...] = ()) -> Values:
    """Return keys and numbers of a record; its texts may be reworded.

    skip: keys of what jumps when two values are almost equal, as the place of a largest value.
    """
    values = {}
    for path, value in flatten(record, skip):
        if isinstance(value, bool) or value is None:
            values[f"{name}: {path}"] = exact(value)
        elif not isinstance(value, str) and _are_numbers(value):
            values[f"{name}: {path}"] = near(value, RESULT, NOISE)
    keys = {re.sub(r"\[\d+\]", "[]", key.removeprefix(f"{name}: ")) for key in values}
    values[f"{name}: other keys"] = exact([key for key in outline(record) if key not in keys])
    return values


@case
def sources(folder: Path) -> Values:
    """G-code, a drawing with a fit, and a program, by the command line; whole and in parts."""
    bench = INPUTS / "bench.toml"
    values = {}
    for label, words in {
        "G-code": (INPUTS / "flower.nc", "--machine", bench),
        "G-code in parts": (INPUTS / "flower.nc", "--machine", bench, "--stream"),
        "drawing": (INPUTS / "part.dxf", "--machine", bench, "--fit", "0.05 mm"),
        "synchronised": (INPUTS / "curved.toml", "--machine", bench, "--motion", "synchronised"),
    }.items():
        target = folder / label.replace(" ", "-")
        record = write_plan(target, *words, "--no-worth", "--bound", "none", "--no-baselines")
        if "--stream" in words:  # those of a whole plan are in the case plan_record
            values[f"{label}: keys"] = exact(outline(record))
        values[f"{label}: duration"] = near(record["duration_s"], DURATION)
        values[f"{label}: length"] = near(record["path_length_m"], PLACE)
        values[f"{label}: pulses"] = exact(
            [[axis["pulses"], axis["final_count"]] for axis in record["pulses"]["axes"].values()]
        )
        for limit, proof in record["certificate"]["limits"].items():
            values[f"{label}: use of {limit}"] = describe_use(limit, proof["worst_ratio"])
        values |= describe_motion(f"{label}, read again", pp.load_plan(target))
    return values


@case
def commands(folder: Path) -> Values:
    """Records of the commands that read a stored plan, a machine or a program."""
    curved, arms, bench = PLANS / "curved", PLANS / "arms", INPUTS / "bench.toml"
    values = {}
    for label, words in {
        "check": ("check", INPUTS / "curved.toml", "--machine", bench),
        "check of a plan": ("check", curved),
        "hold": ("hold", arms, "--at", "0.1 s"),
        "stops": ("hold", arms, "--stops", 2),
        "pose of hexapod": ("pose", "hexapod", "5,5,35", "--turn", "3,-4,2"),
        "pose of arm": ("pose", "arm", "10,20,-30"),
        "pose of tripod": ("pose", "tripod", "10,20,-10"),
        "pose of linkage": ("pose", "linkage", "5,10,0"),
        "pose of traverser": ("pose", "traverser", "20,30,40"),
        "pose of delta": ("pose", "delta", "20,30,10"),
        "pose of five-axis": ("pose", "five-axis", "20,30,10", "--turn", "10,20,0"),
        "pose from lengths": ("pose", "tripod", "--travel", "1,2,3"),
    }.items():
        values |= describe_record(label, call_json(*words), skip=("where", "cost_s"))
    record = call_json("calibrate", "hexapod", "cmm", "--out", folder / "calibrated")
    values |= describe_record("calibrate", record, skip=("errors", "singular_values"))
    return values


@case
def tracking(folder: Path) -> Values:
    """Errors of two laws, on a rig without and a rig with feedback."""
    values = {}
    for program, rig in (("linkage-line", "linkage-steppers"), ("arm-line", "servo-rig")):
        target = folder / program
        write_plan(target, program, "--no-worth", "--bound", "none", "--no-baselines")
        words = "track", target, "--rig", rig, "--law", "3", "--law", "6:gain=0.7"
        values |= describe_record(f"{program} on {rig}", call_json(*words), skip=("where",))
    return values


@case
def plan_record(folder: Path) -> Values:
    """The whole record of one plan with everything that can be asked for, and the files beside
    it.
    """
    words = INPUTS / "curved.toml", "--machine", INPUTS / "bench.toml", "--baselines"
    record = write_plan(folder / "plan", *words, "--pulses", "csv")
    skip = "where", "provenance", "where_time_s", "shadow"
    values = describe_record("plan.json", record, skip)
    values["files"] = exact(sorted(path.name for path in (folder / "plan").iterdir()))
    heading = (folder / "plan/trajectory.csv").read_text().partition("\n")[0]
    values["trajectory.csv"] = exact(heading)
    values["triggers.csv"] = exact((folder / "plan/triggers.csv").read_text().partition("\n")[0])
    return values


@case
def lists(_: Path) -> Values:
    """Bundled data by name, and their keys."""
    values = {}
    for words in ("machines", "programs", "rigs", "laws", "rules", "figures"):
        record = call_json(words)
        values[f"{words}: keys"] = exact(outline(record))
        names = list(record) if isinstance(record, dict) else [entry["name"] for entry in record]
        values[f"{words}: names"] = exact(names)
    for name in pp.machine_names():
        machine = pp.load_machine(name)
        values[f"{name}: axes"] = exact([axis.name for axis in machine.axes])
        values[f"{name}: home"] = near(machine.home_q, DURATION)
        values[f"{name}: pulse"] = near([axis.pulse for axis in machine.axes], DURATION)
    return values


HEAD = 'schema = 1\nmachine = "hexapod"\nlength = "mm"\nangle = "deg"\n'


@case
def refusals(folder: Path) -> Values:
    """Exit codes, and that nothing is left behind.

    Messages are not compared: they will be reworded.
    """
    values = {}
    for label, body in {
        "out of reach": "[[segment]]\nline = { to = [0, 0, 500] }\n",
        "tilt": "[[segment]]\nturn = { to = [40, 0, 0] }\n",
        "unknown key": "[[segment]]\nlines = { to = [0, 0, 5] }\n",
        "no unit": "speed = 3\n[[segment]]\nline = { to = [0, 0, 5] }\n",
        "not a number": "[[segment]]\nline = { to = [0, 0, nan] }\n",
        "empty": "",
        "no TOML": "[[segment\n",
    }.items():
        file = folder / "refused.toml"
        file.write_text(HEAD + body)
        values |= describe_refusal(label, folder, "plan", file)
    plan, bench = PLANS / "curved", INPUTS / "bench.toml"
    for label, words in {
        "constant speed too high": ("plan", _write_fast(folder), "--machine", bench),
        "unknown rule": ("plan", "bare-circle", "--rule", "nearst"),
        "unknown program": ("plan", "bare-circl"),
        "too short a duration": ("plan", "arm-line", "--duration", "0.5 s"),
        "shaped G-code of another machine": ("plan", INPUTS / "flower.nc", "--machine", "none"),
        "unknown format": ("export", plan, "--format", "stepz"),
        "format of another machine": ("export", plan, "--format", "kmitl-arms"),
        "stop after the end": ("hold", plan, "--at", "9 s"),
        "no plan": ("export", folder, "--format", "steps"),
        "changed plan": ("export", _change_plan(folder), "--format", "steps"),
        "pose out of reach": ("pose", "hexapod", "0,0,900"),
    }.items():
        values |= describe_refusal(label, folder, *words)
    return values


def describe_refusal(label: str, folder: Path, *words: object) -> Values:
    """Return the exit code, what kind of error the JSON states, and that no file is left."""
    target = folder / "target"
    out = () if words[0] == "pose" else ("--out", target)
    result = call(*words, *out, "--json")
    return {
        f"{label}: exit code": exact(result.exit_code),
        f"{label}: left behind": exact(target.exists()),
        f"{label}: traceback": exact("Traceback" in result.output),
        f"{label}: kind": exact(json.loads(result.stdout).get("error", {}).get("kind")),
    }


def _write_fast(folder: Path) -> Path:
    """Write the program of a constant speed with one that the machine cannot reach on its way."""
    file = folder / "fast.toml"
    file.write_text((INPUTS / "constant.toml").read_text().replace('"10 mm/s"', '"29 mm/s"'))
    return file


def _change_plan(folder: Path) -> Path:
    """Copy a stored plan and change a file of it."""
    changed = folder / "changed"
    shutil.copytree(PLANS / "curved", changed, dirs_exist_ok=True)
    program = changed / "program.toml"
    program.write_text(program.read_text().replace("20 mm/s", "21 mm/s"))
    return changed


# --- exported files

FORMATS = {
    "curved": {
        "adlink": (),
        "adlink-csv": (),
        "binary": (),
        "byte": (),
        "csp": (),
        "g93": (),
        "galil": (),
        "halstreamer": (),
        "npz": (),
        "pmac": (),
        "pulses": (),
        "ros": ("--spacing", "20 ms"),
        "steps": (),
        "vcd": (),
        "xps": (),
        "zaber": ("--spacing", "10 ms"),
    },
    "straight": {
        "sahbaz": (),
        "sasidhar": (),
        "xps": (),
        "zaber": (),
        "g93": ("--spacing", "20 ms"),
    },
    "arms": {"kmitl-arms": (), "kmitl-positions": ("--chord", "0.1 mm")},
}
EXPORTED = [(plan, form) for plan, forms in FORMATS.items() for form in forms]
# What one tick of 0.1 µs is in files that state times otherwise than in ticks.
TICK = {"pulses": 1e-7, "vcd": 100.0}
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def write_export(plan: str, form: str, folder: Path) -> str:
    """Export a stored plan and return the file as text."""
    file = folder / f"{plan}.{form}"
    result = call("export", PLANS / plan, "--format", form, "--out", file, *FORMATS[plan][form])
    assert result.exit_code == 0, f"{plan} as {form}: {result.stderr[-300:]}"
    return decode(file, form)


def decode(file: Path, form: str) -> str:
    """Return a file as text: arrays as one number a line, bytes as hexadecimal digits, \\r as two
    letters.
    """
    if form == "npz":
        return "".join(f"{name}\n{_write_lines(value)}" for name, value in np.load(file).items())
    if form == "binary":
        axes = pp.read_pulses(file).axes
        return "".join(
            _write_lines(axis.ticks) + _write_signs(axis.direction) + "\n" for axis in axes
        )
    if form == "byte":
        return (
            "\n".join(
                file.read_bytes().hex(" ")[k : k + 96]
                for k in range(0, file.stat().st_size * 3, 96)
            )
            + "\n"
        )
    return file.read_bytes().decode().replace("\r", "\\r")


def _write_lines(value: Any) -> str:
    if isinstance(value, bytes):
        return value.decode() + "\n"
    return "".join(f"{number}\n" for number in np.asarray(value).ravel().tolist())


def compare_files(stored: str, text: str, tick: float) -> list[str]:
    """List the differences of two files.

    A stored motion is evaluated with + − × / and √, which processors agree on; sine and cosine may
    differ in the last bit. So a number that falls between two written ones may be rounded
    otherwise: one in 200 may be off by one in its last place, or by one tick. Numbers with 12
    digits and more are compared within 1e-9 of themselves. Small whole numbers, which are counts
    and settings, are equal.
    """
    if NUMBER.sub("0", stored) != NUMBER.sub("0", text):
        return _compare_lines(stored, text)
    old, new = NUMBER.findall(stored), NUMBER.findall(text)
    rounded, changes = [], []
    for before, after in zip(old, new, strict=True):
        if before == after:
            continue
        change = f"{before} -> {after}, difference {float(after) - float(before):+.6g}"
        decimals = len(before.partition(".")[2])
        digits = len(before.lstrip("-").replace(".", "").lstrip("0"))
        deviation = abs(float(after) - float(before))
        if digits >= 12 and deviation <= 1e-9 * max(1.0, abs(float(before))):
            continue
        step = max(tick, 10.0**-decimals) * 1.001
        small = decimals == 0 and digits < 3
        (changes if small or deviation > step else rounded).append(change)
    if len(rounded) > len(old) // 200:
        changes += rounded
    return changes


def _compare_lines(stored: str, text: str) -> list[str]:
    """List the lines that differ, the first of them in full."""
    old, new = stored.splitlines(), text.splitlines()
    changes = [
        f"line {k + 1}: {a} -> {b}"
        for k, (a, b) in enumerate(zip(old, new, strict=False))
        if a != b
    ]
    return [f"{len(old)} lines -> {len(new)}", *changes]


# --- pytest

MOST_SHOWN = 20


def compare_values(name: str, values: Values, stored: dict[str, Any]) -> list[str]:
    """List the values of a case that differ from the stored ones, went or came."""
    changes = [f"{name}: {key}: is gone" for key in stored if key not in values]
    for key, value in values.items():
        if key not in stored:
            changes.append(f"{name}: {key}: new: {_shorten(value.value)}")
        elif change := value.differs_from(stored[key]):
            changes.append(f"{name}: {key}: {change}")
    return changes


def fail_if(changes: list[str]) -> None:
    """Fail with the first changes."""
    shown = "\n".join(changes[:MOST_SHOWN])
    assert not changes, f"{len(changes)} changes; see the head of this file\n{shown}"


@pytest.mark.parametrize("name", CASES)
def test_values(name: str, tmp_path: Path) -> None:
    stored = json.loads(VALUES.read_text())[name]
    fail_if(compare_values(name, CASES[name](tmp_path), stored))


@pytest.mark.parametrize(("plan", "form"), EXPORTED)
def test_exports(plan: str, form: str, tmp_path: Path) -> None:
    stored = (EXPORTS / f"{plan}.{form}.txt").read_text()
    fail_if(compare_files(stored, write_export(plan, form, tmp_path), TICK.get(form, 0.0)))


def test_every_format_is_compared() -> None:
    help_text = call("export", "--help").stdout
    listed = re.findall(
        r"^  ([a-z0-9-]+) {2,}[A-Z]", help_text.partition("Formats:")[2], re.MULTILINE
    )
    assert sorted({form for _, form in EXPORTED}) == sorted(listed)


# --- recording

MADE_BY = {
    "curved": ("--machine", INPUTS / "bench.toml"),
    "straight": ("--machine", INPUTS / "bench.toml"),
    "arms": ("--machine", "tripod", "--order", 2),
}
# Files of a plan directory that no command reads.
UNREAD = {"report.html", "trajectory.csv", "certificate.json", "triggers.csv"}


def record_plans(folder: Path) -> None:
    """Write the plan directories again."""
    for plan, options in MADE_BY.items():
        made = folder / plan
        words = INPUTS / f"{plan}.toml", *options, "--no-worth", "--no-baselines"
        write_plan(made, *words, "--bound", "none", "--pulses", "none")
        shutil.rmtree(PLANS / plan, ignore_errors=True)
        shutil.copytree(made, PLANS / plan, ignore=lambda _, names: UNREAD & set(names))
        print(f"{plan}: {', '.join(sorted(path.name for path in (PLANS / plan).iterdir()))}")


def record_values(folder: Path) -> None:
    """Store values beyond their tolerance, and print them.

    A value within its tolerance keeps what is stored, so that small changes cannot add up
    unnoticed.
    """
    stored = json.loads(VALUES.read_text()) if VALUES.exists() else {}
    recorded = {}
    for name, function in CASES.items():
        target = folder / name
        target.mkdir()
        values, before = function(target), stored.get(name, {})
        for change in compare_values(name, values, before):
            print(change)
        recorded[name] = {
            key: before[key]
            if key in before and not value.differs_from(before[key])
            else value.value
            for key, value in values.items()
        }
    VALUES.write_text(_write_json(recorded))


def _write_json(recorded: dict[str, dict[str, Any]]) -> str:
    """Return JSON with one value a line, so that a difference of two versions reads well."""
    cases = []
    for name, values in recorded.items():
        rows = [f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in values.items()]
        cases.append(f'"{name}": {{\n' + ",\n".join(rows) + "\n}")
    return "{\n" + ",\n".join(cases) + "\n}\n"


def record_exports(folder: Path) -> None:
    """Store files that differ, and print their differences."""
    EXPORTS.mkdir(exist_ok=True)
    for plan, form in EXPORTED:
        file = EXPORTS / f"{plan}.{form}.txt"
        text = write_export(plan, form, folder)
        before = file.read_text() if file.exists() else ""
        changes = compare_files(before, text, TICK.get(form, 0.0))
        if changes:
            print(*(f"{file.name}: {change}" for change in changes), sep="\n")
            file.write_text(text)


if __name__ == "__main__":
    if sys.argv[1:] not in (["--record"], ["--record", "plans"]):
        sys.exit(f"{__doc__}")
    with TemporaryDirectory() as work:
        if sys.argv[2:]:
            record_plans(Path(work))
        else:
            record_values(Path(work))
            record_exports(Path(work))
