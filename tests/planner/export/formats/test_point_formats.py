"""Zaber, XPS, PMAC, G-code and ROS files: each decoded here by other code, and held against the
motion itself.
"""

import csv
import re
import tracemalloc
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly, CubicHermiteSpline

from kinematics import Axis, FileError, MotionError
from kinematics.machine.axis import directional_bounds
from planner import Dwell, Line, Program, import_program, plan
from planner.export.format import ExportSource, find_format

FORMATS = ("zaber", "xps", "pmac", "g93", "ros")
EPS = 1e-6  # pulses, of decoding and interpolating positions of up to a million pulses in floats


class Stops:
    """From place to place (K, axes) in times (K-1,), at rest at each; equal places are a rest.

    q = p + Δ f(u); smooth: f = 10u³ - 15u⁴ + 6u⁵, of which q̈ is continuous; else bang-bang, halves
    of constant q̈.
    """

    def __init__(self, places, times, smooth):
        self.places, self.times, self.smooth = (
            np.asarray(places, float),
            np.asarray(times, float),
            smooth,
        )
        ends = np.concatenate([[0.0], np.cumsum(self.times)])
        halves = [] if smooth else (ends[:-1] + ends[1:]) / 2
        self.knots, self.ends, self.duration = np.union1d(ends, halves), ends, ends[-1]

    def at(self, t):
        k = np.clip(np.searchsorted(self.ends, t, side="right") - 1, 0, len(self.times) - 1)
        h = self.times[k]
        u = np.clip((t - self.ends[k]) / h, 0, 1)
        if self.smooth:
            f = (
                u**3 * (10 - 15 * u + 6 * u**2),
                30 * u**2 * (1 - u) ** 2,
                60 * u * (1 - 3 * u + 2 * u**2),
            )
        else:
            late = u >= 0.5
            f = (
                np.where(late, 1 - 2 * (1 - u) ** 2, 2 * u**2),
                np.where(late, 4 - 4 * u, 4 * u),
                4 - 8.0 * late,
            )
        way = np.diff(self.places, axis=0)[k]
        q, qd, qdd = (way * (part / h**n)[:, None] for n, part in enumerate(f))
        return SimpleNamespace(q=self.places[k] + q, qd=qd, qdd=qdd)


def source_of(motion, axes, home=None, name="made up"):
    machine = SimpleNamespace(
        axes=axes, home_q=np.zeros(len(axes)) if home is None else np.asarray(home, float)
    )
    return ExportSource(name, machine, motion, None)


@st.composite
def sources(draw, most=8):
    """One to eight axes, of any pulse and home, that start anywhere, rest, or never move; 1 ms to
    minutes.
    """
    n, count = draw(st.integers(1, most)), draw(st.integers(1, 4))
    kinds = draw(st.lists(st.sampled_from(["linear", "rotary"]), min_size=n, max_size=n))
    pulses = draw(st.lists(st.sampled_from([1e-3, 0.75e-6, 1e-5, 3.3e-8]), min_size=n, max_size=n))
    signs = draw(st.lists(st.sampled_from([1, -1]), min_size=n, max_size=n))
    axes = tuple(Axis(f"axis{k}", kinds[k], pulse=pulses[k], direction=signs[k]) for k in range(n))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    times = 10 ** random.uniform(-3, draw(st.sampled_from([0, 1, 2])), count)
    ways = np.minimum(times**2 * 1e6, 1e5)  # pulses: accelerations as machines have them
    ways = ways[:, None] * random.uniform(-1, 1, (count, n)) * random.integers(0, 2, n)
    ways[random.uniform(size=count) < 0.3] = 0
    places = np.vstack([random.normal(size=n) * 1e5, ways]).cumsum(0) * pulses
    home = places[0] + random.normal(size=n) * np.array(pulses) * 1e3
    return source_of(Stops(places, times, draw(st.booleans())), axes, home)


@dataclass
class Decoded:
    """A file as read: instants (K,), and q, q̇, q̈ there where stated, in m and rad."""

    t: np.ndarray
    rows: list

    def at(self, when):
        """What the reader makes of it: after the end it stays."""
        when = np.minimum(when, self.t[-1])
        if len(self.rows) == 1:
            return np.stack([np.interp(when, self.t, column) for column in self.rows[0].T], 1)
        if len(self.rows) == 2:
            return CubicHermiteSpline(self.t, *self.rows)(when)
        return BPoly.from_derivatives(self.t, np.stack(self.rows, 1))(when)

    def accelerations_at(self, when):
        """Of polynomials that meet more than positions."""
        return BPoly.from_derivatives(self.t, np.stack(self.rows, 1)).derivative(2)(when)


def factors(axes):
    return np.array([1e-3 if axis.kind == "linear" else np.pi / 180 for axis in axes])


def from_moves(source, times, moves, speeds):
    axes, start = source.machine.axes, source.trajectory.at(np.zeros(1)).q
    q = np.concatenate([start, start + np.cumsum(np.array(moves), 0) * factors(axes)])
    qd = np.concatenate([0 * start, np.array(speeds) * factors(axes)])
    return Decoded(np.concatenate([[0.0], np.cumsum(times)]), [q, qd])


def zaber(path, source):
    axes, home = source.machine.axes, source.machine.home_q
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    units = ["mm" if axis.kind == "linear" else "deg" for axis in axes]
    letters = "XYZABCUVW"
    expected = [f"{letter} {kind}" for letter, u in zip(letters, units, strict=False)
                for kind in (f"Position ({u})", f"Velocity ({u}/s)")]  # fmt: skip
    assert header == ["Time (ms)", *expected, "Relative"]
    assert float(rows[0][0]) == 0
    assert {row[-1] for row in rows} == {"false"}
    table = np.array([row[:-1] for row in rows], float)
    assert not table[[0, -1], 2::2].any()
    return Decoded(
        np.cumsum(table[:, 0]) / 1e3,
        [table[:, 1::2] * factors(axes) + home, table[:, 2::2] * factors(axes)],
    )


def xps(path, source):
    rows = [
        [float(cell) for cell in line.split(", ")]
        for line in path.read_bytes().decode("ascii").splitlines()
    ]
    assert not any(rows[-1][2::2])
    return from_moves(source, *zip(*[(row[0], row[1::2], row[2::2]) for row in rows], strict=True))


def pmac(path, source):
    mode, lasting, found = None, None, []
    for line in path.read_text(encoding="ascii").splitlines():
        text = line.partition(";")[0].strip()
        if text == "INC":
            mode = text
        elif text.startswith("PVT"):
            lasting = float(text.removeprefix("PVT"))
            assert lasting <= 4095.9998
            assert lasting * 4e3 == pytest.approx(round(lasting * 4e3), abs=1e-6)
        elif text:
            assert mode == "INC"
            words = re.findall(r"([XYZABCUVW])(-?\d+\.\d+):(-?\d+\.\d+)(?: |$)", text)
            assert "".join(word[0] for word in words) == "XYZABCUVW"[: len(source.machine.axes)]
            found.append(
                (lasting / 1e3, [float(w[1]) for w in words], [float(w[2]) for w in words])
            )
    assert not any(found[-1][2])
    return from_moves(source, *zip(*found, strict=True))


def g93(path, source):
    axes, letters = source.machine.axes, "XYZABCUVW"[: len(source.machine.axes)]
    place = dict(zip(letters, (source.trajectory.at(np.zeros(1)).q[0] - source.machine.home_q) / factors(axes),
                     strict=True))  # fmt: skip
    t, mode, points = [0.0], None, [list(place.values())]
    lines = path.read_text(encoding="ascii").splitlines()
    assert lines[-2:] == ["G94", "M2"]
    for line in lines[:-2]:
        assert line.count("(") == line.count(")") == line.startswith("(")
        words = dict(re.findall(r"([A-Z])(-?[\d.e+]+)", re.sub(r"\([^()]*\)", "", line)))
        code = words.pop("G", None)
        if line.startswith("G21"):
            mode = line
        elif code == "4":
            t.append(t[-1] + float(words["P"]))
            points.append(points[-1])
        elif code == "1":
            assert mode == "G21 G90 G93"
            t.append(t[-1] + 60 / float(words.pop("F")))
            place |= {letter: float(number) for letter, number in words.items()}
            points.append(list(place.values()))
    return Decoded(np.array(t), [np.array(points) * factors(axes) + source.machine.home_q])


def ros(path, source):
    yaml = pytest.importorskip("yaml")
    message = yaml.load(
        path.read_bytes(), yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader
    )
    assert message["joint_names"] == [axis.name for axis in source.machine.axes]
    points = message["points"]
    assert all(point["effort"] == [] for point in points)
    t = [
        point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"]
        for point in points
    ]
    names = ("positions", "velocities", "accelerations")
    return Decoded(
        np.array(t),
        [np.array([point[name] for point in points]) for name in names if points[0][name]],
    )


READERS = dict(zip(FORMATS, (zaber, xps, pmac, g93, ros), strict=True))


def off(decoded, source, count=4001):
    """Pulses, the largest by which an axis of a decoded file is from the motion."""
    motion, pulse = source.trajectory, np.array([axis.pulse for axis in source.machine.axes])
    middles = (decoded.t[1:] + decoded.t[:-1]) / 2
    t = np.union1d(
        np.linspace(0, max(motion.duration, decoded.t[-1]), count),
        np.union1d(motion.knots, middles),
    )
    return (abs(decoded.at(t) - motion.at(t).q) / pulse).max()


@pytest.mark.parametrize("name", FORMATS)
@settings(max_examples=12, deadline=None, derandomize=True)
@given(source=sources(), tolerance=st.sampled_from([None, 0.1, 3.0]))
def test_the_reader_stays_within_the_tolerance(name, source, tolerance, tmp_path_factory):
    path = tmp_path_factory.mktemp("export") / "file"
    told = find_format(name)(tolerance=tolerance).write(source, path)
    decoded = READERS[name](path, source)
    assert decoded.t[-1] >= source.trajectory.duration - 1e-7
    assert (np.diff(decoded.t) >= 0).all()
    found = off(decoded, source)
    assert found <= told.error + EPS
    assert told.error <= (tolerance or 0.5)


@pytest.mark.parametrize("name", FORMATS)
def test_an_even_spacing_makes_the_error_that_is_told(name, tmp_path):
    motion = Stops(
        [[0.0, 1.0], [0.05, 1.2], [0.05, 1.2], [-0.02, 1.2]], [0.8, 0.3, 1.1], smooth=True
    )
    source = source_of(
        motion, (Axis("one", pulse=1e-6), Axis("two", "rotary", pulse=1e-5)), [0.01, 1.0]
    )
    told = find_format(name)(spacing=0.05).write(source, tmp_path / "file")
    decoded = READERS[name](tmp_path / "file", source)
    assert np.diff(decoded.t) == pytest.approx(0.05)
    found = off(decoded, source, 40_001)
    assert found <= told.error + EPS
    assert told.error <= 1.1 * found + 0.002  # no looser than probing 1/16 of a segment makes it
    assert told.notes[0] == "segments: 44, of 50 ms"


@pytest.mark.parametrize("name", ["zaber", "xps", "pmac", "g93"])
def test_rounding_does_not_add_up(name, tmp_path):
    """Ten thousand points, each rounded to a thousandth of the tolerance: the end is as near as the
    start.
    """
    motion = Stops([[0.0], [1.0]], [100.0], smooth=True)
    source = source_of(motion, (Axis("one", pulse=1e-5 / 3),))
    find_format(name)(spacing=0.01).write(source, tmp_path / "file")
    decoded = READERS[name](tmp_path / "file", source)
    assert len(decoded.t) == 10_001
    assert abs(decoded.rows[0][-1, 0] - 1.0) <= 1e-3 * source.machine.axes[0].pulse
    assert decoded.t[-1] == pytest.approx(100.0, abs=1e-8)


@pytest.mark.parametrize("name", FORMATS)
def test_a_real_plan_with_a_dwell(name, hexapod, tmp_path):
    """A line, a rest and a line on six legs: few segments for the rest, each within half a
    pulse.
    """
    program = Program((Line([0, 0, 0.02]), Dwell(3.0), Line([0.01, 0, 0.025])), name="rest")
    made = plan(program, hexapod, order=2)
    source = ExportSource(program.name, hexapod, made.trajectory, made.pulses)
    told = find_format(name)().write(source, tmp_path / "file")
    decoded = READERS[name](tmp_path / "file", source)
    assert off(decoded, source, 20_001) <= told.error + EPS <= 0.5
    assert np.diff(decoded.t).max() == pytest.approx(
        3.0, abs=2e-4
    )  # whole steps of 0.1 ms at either end


@settings(max_examples=20, deadline=None, derandomize=True)
@given(source=sources(most=3), letters=st.permutations("XYZ"))
def test_our_gcode_reader_takes_g93_as_it_is_meant(source, letters, tmp_path_factory):
    """As a program: its lines at the speeds that F caps, and its dwells, last as long as the motion
    and lead its way.

    A block of less than a nanometre is joined to the next (planner.sources), so 1 nm more than the
    error that is told. Read without the header, by which it would be known for joint axes
    (test_gcode_joints).
    """
    axes = tuple(Axis(axis.name, pulse=axis.pulse) for axis in source.machine.axes)
    motion = replace_start(source.trajectory)
    told_source = source_of(motion, axes)
    path = tmp_path_factory.mktemp("g93") / "file.ngc"
    chosen = "".join(letters[: len(axes)])
    told = find_format("g93")(letters=chosen).write(told_source, path)
    path.write_text(re.sub(r"^\(.*\)\n", "", path.read_text(), flags=re.MULTILINE))
    if not np.ptp(motion.places, axis=0).any():
        with pytest.raises(FileError, match="nothing moves"):
            import_program(path)
        return
    program = import_program(path).program
    t, here, points = [0.0], np.zeros(3), [np.zeros(3)]
    for part in program.segments:
        lasts = (
            part.duration
            if isinstance(part, Dwell)
            else np.linalg.norm(part.to - here) / part.speed
        )
        here = here if isinstance(part, Dwell) else part.to
        t.append(t[-1] + lasts)
        points.append(here)
    columns = ["XYZ".index(letter) for letter in chosen]
    decoded = Decoded(np.array(t), [np.array(points)[:, columns]])
    assert off(decoded, told_source) <= told.error + 1e-9 / min(axis.pulse for axis in axes) + EPS


def replace_start(motion):
    """The same from where the axes are at home, as programs start."""
    return Stops(
        motion.places - motion.places[0], motion.times, bool(len(motion.knots) == len(motion.ends))
    )


def test_zaber_reads_its_file(tmp_path):
    """The library of the maker loads the file: its numbers and units are those that were
    written.
    """
    ascii_ = pytest.importorskip("zaber_motion.ascii")
    motion = Stops([[0.01, 1.0], [0.02, 1.5], [0.02, 1.5]], [0.5, 0.1], smooth=True)
    source = source_of(
        motion, (Axis("one", pulse=1e-6), Axis("two", "rotary", pulse=1e-5)), [0.01, 0.5]
    )
    find_format("zaber")(letters="PT").write(source, tmp_path / "sequence.csv")
    data = ascii_.PvtSequence.load_sequence_data(str(tmp_path / "sequence.csv"))
    assert data.series_names == ["P", "T"]
    points = data.sequence_data
    units = [measured.unit.value for measured in points[0].positions + points[0].velocities]
    assert units == ["Length:millimetres", "Angle:degrees",
                     "Velocity:millimetres per second", "Angular Velocity:degrees per second"]  # fmt: skip
    assert points[0].time.unit.value == "Time:milliseconds"
    assert not any(point.relative for point in points)
    t = np.cumsum([point.time.value for point in points]) / 1e3
    q, qd = (
        np.array([[measured.value for measured in getattr(point, name)] for point in points])
        * factors(source.machine.axes)
        for name in ("positions", "velocities")
    )
    assert off(Decoded(t, [q + source.machine.home_q, qd]), source) <= 0.5


FLOAT_EPSILON = 2.0**-23  # joint_trajectory_controller's least end speed that is one


def accept_trajectory(message, names):
    """What validate_trajectory_msg of joint_trajectory_controller asks for, as its documentation
    states it.

    With its defaults: no partial goals, and no speed at the end. Returns the points' times in ns.
    """
    assert sorted(message["joint_names"]) == sorted(names)
    points = message["points"]
    assert points
    times = []
    for point in points:
        stamp = point["time_from_start"]
        assert 0 <= stamp["nanosec"] < 10**9
        times.append(stamp["sec"] * 10**9 + stamp["nanosec"])
        assert len(point["positions"]) == len(names)
        assert len(point["velocities"]) in (0, len(names))
        assert len(point["accelerations"]) in (0, len(names))
        assert point["effort"] == []  # there is no effort interface to take it
    assert (np.diff(times) > 0).all()
    assert max(map(abs, points[-1]["velocities"])) <= FLOAT_EPSILON
    return np.array(times)


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("tolerance", [None, 3.0])
def test_joint_trajectory_controller_takes_the_file_and_follows_the_plan(
    order, tolerance, hexapod, tmp_path
):
    """By its own rules and polynomials, at ten thousand instants: as far off as the export states,
    and no farther.

    Order 2 jumps from limit to limit: quintics told of that would exceed it by 0.374 times 2
    limits, as the controller itself was seen to do, but cubics with a point at the jump hardly
    bend. 4 %: most that was seen on presets.
    """
    program = Program((Line([0, 0, 0.02]), Dwell(0.2), Line([0.01, 0, 0.025])), name="rest")
    made = plan(program, hexapod, order=order)
    source = ExportSource(program.name, hexapod, made.trajectory, made.pulses)
    told = find_format("ros")(tolerance=tolerance).write(source, tmp_path / "file")
    message = pytest.importorskip("yaml").safe_load((tmp_path / "file").read_text())
    times = accept_trajectory(message, [axis.name for axis in hexapod.axes])
    decoded = ros(tmp_path / "file", source)
    assert len(decoded.rows) == order
    assert decoded.t == pytest.approx(1e-9 * times, abs=1e-12)
    t = np.linspace(0, made.trajectory.duration, 10_000)
    error = (
        abs(decoded.at(t) - made.trajectory.at(t).q) / [axis.pulse for axis in hexapod.axes]
    ).max()
    assert f"{['cubic', 'quintic'][order - 2]} between the points" in told.against
    assert 0.3 * told.error <= error <= told.error + EPS
    assert told.error <= (tolerance or 0.5)
    limits = [max(directional_bounds(axis.max_acceleration)) for axis in hexapod.axes]
    if tolerance is None:
        assert (abs(decoded.accelerations_at(t)) / limits).max() < 1.04


def test_natural_coordinates_are_the_axes_own(tmp_path):
    motion = Stops([[0.3], [0.31]], [0.5], smooth=True)
    source = source_of(motion, (Axis("X", pulse=1e-6),), [0.25])
    for origin, first in (("home", 50.0), ("natural", 300.0)):
        find_format("zaber")(origin=origin).write(source, tmp_path / "z")
        assert float((tmp_path / "z").read_text().splitlines()[1].split(",")[1]) == first
        find_format("g93")(origin=origin).write(source, tmp_path / "g")
        assert f"stand at X{first:.6f})" in (tmp_path / "g").read_text()
        find_format("ros")(origin=origin, ros="1").write(source, tmp_path / "r")
        assert f"positions: [{first / 1e3:.9f}]" in (tmp_path / "r").read_text()
        assert "time_from_start: {secs: 0, nsecs: 0}" in (tmp_path / "r").read_text()


def test_counts_of_pmac_are_those_of_the_wiring(tmp_path):
    motion = Stops([[0.3, 0.3], [0.31, 0.31]], [0.5], smooth=True)
    axes = Axis("U", pulse=1e-6), Axis("V", pulse=2e-6, direction=-1)
    find_format("pmac")(unit="counts").write(source_of(motion, axes, [0.25, 0.25]), tmp_path / "p")
    words = re.findall(r"([UV])(\S+):", (tmp_path / "p").read_text().partition("INC")[2])
    for letter, total in (("U", 10_000), ("V", -5_000)):
        assert sum(float(way) for key, way in words if key == letter) == pytest.approx(
            total, abs=1e-3
        )


def test_a_reversal_that_is_not_the_motions_is_told(tmp_path):
    """A quick hop at the end of a long even segment: its end speed is too high for its way."""
    motion = Stops([[0.0], [0.0], [0.01]], [0.98, 0.1], smooth=True)
    source = source_of(motion, (Axis("X", pulse=1e-6),))
    told = find_format("xps")(spacing=0.51).write(source, tmp_path / "t")
    decoded = xps(tmp_path / "t", source)
    q = decoded.at(np.linspace(0, 1.1, 100_001))
    back = (np.maximum.accumulate(q) - q).max() / 1e-6
    assert float(
        re.search(r"run back .* by up to (\S+) pulses", " ".join(told.notes))[1]
    ) == pytest.approx(back, rel=5e-3)
    assert back > 100
    chosen = find_format("xps")().write(source, tmp_path / "t")
    q = xps(tmp_path / "t", source).at(np.linspace(0, 1.1, 100_001))
    assert (np.maximum.accumulate(q) - q).max() / 1e-6 <= 0.02
    assert "run back" not in " ".join(chosen.notes)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    names=st.lists(st.text(min_size=1, max_size=8), min_size=1, max_size=4),
    program=st.text(max_size=20),
)
def test_names_never_break_a_file(names, program, tmp_path_factory):
    path = tmp_path_factory.mktemp("names") / "file"
    motion = Stops([[0.0] * len(names), [1e-4] * len(names)], [0.2], smooth=True)
    axes = tuple(Axis(name, pulse=1e-6) for name in names)
    source = source_of(motion, axes, name=program)
    usual = "XYZABCUVW"[: len(names)]
    for format_ in FORMATS:
        if format_ == "ros" and any("\ud800" <= c <= "\udfff" for c in "".join(names)):
            continue  # half a character, which YAML does not know
        own = {} if format_ in ("xps", "ros") else {"letters": usual}
        find_format(format_)(**own).write(source, path)
        assert off(READERS[format_](path, source), source, 101) <= 0.5
        assert b"\r" not in path.read_bytes()


def nine(count=9, **own):
    axes = tuple(Axis(f"axis{k}", pulse=1e-6) for k in range(count))
    return source_of(Stops(np.outer([0.0, 1e-3], np.ones(count)), [0.2], smooth=True), axes, **own)


@pytest.mark.parametrize("name", ["zaber", "pmac", "g93", "ros"])
def test_nine_axes_fit(name, tmp_path):
    find_format(name)().write(nine(), tmp_path / "file")
    assert off(READERS[name](tmp_path / "file", nine()), nine()) <= 0.5


def test_letters_are_the_names_where_these_are_letters(tmp_path):
    motion = Stops([[0.0, 0.0], [1e-3, 1e-3]], [0.2], smooth=True)
    source = source_of(motion, (Axis("b", pulse=1e-6), Axis("X", pulse=1e-6)))
    told = find_format("g93")().write(source, tmp_path / "g")
    assert "B = b, X = X" in told.notes
    assert "G1 B" in (tmp_path / "g").read_text()


@pytest.mark.parametrize(
    ("name", "options", "source", "told"),
    [
        ("xps", {}, nine(), "axis axis8: 9 axes, but an XPS has at most 8"),
        ("pmac", {}, nine(10), "axis axis9: 10 axes, but a PMAC coordinate system has at most 9"),
        ("g93", {}, nine(10), "axis axis9: 10 axes, but G-code has at most 9"),
        ("g93", {"letters": "XY"}, nine(), "letters XY: G-code needs 9"),
        ("g93", {"letters": "XYZABCUVX"}, nine(), "needs 9 different"),
        ("pmac", {"letters": "R"}, nine(1), "letters R"),
        ("pmac", {"spacing": 4.096}, nine(1), "spacing 4.096 s.* at most 4.09599975 s"),
        ("zaber", {"step": 0.0}, nine(1), "step 0.0 s"),
        ("zaber", {"tolerance": 1e-12}, nine(1), "no spacing of whole 0.0001 s"),
    ],
)
def test_what_a_format_cannot_hold_is_refused_before_a_file_is_there(
    name, options, source, told, tmp_path
):
    with pytest.raises(MotionError, match=told):
        find_format(name)(**options).write(source, tmp_path / "file")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", FORMATS)
def test_a_motion_that_ends_at_a_speed(name, tmp_path):
    """Those that are from rest to rest refuse it; the others hold it."""

    class Half(Stops):
        def __init__(self):
            super().__init__([[0.0], [1.0]], [1.0], smooth=True)
            self.knots, self.duration = np.array([0.0, 0.5]), 0.5

        def at(self, t):
            state = super().at(np.minimum(t, 0.5))
            state.qd[t > 0.5] = 0.0
            return state

    source = source_of(Half(), (Axis("X", pulse=1e-6),))
    if name == "ros":
        told = find_format(name)().write(source, tmp_path / "file")
        assert off(READERS[name](tmp_path / "file", source), source) <= told.error + EPS <= 0.5
        assert ("allow_nonzero_velocity" in " ".join(told.notes)) == (name == "ros")
    else:
        with pytest.raises(MotionError, match=r"axis X: ends at 1\.875 m/s"):
            find_format(name)().write(source, tmp_path / "file")


def test_memory_does_not_grow_with_the_rows(tmp_path):
    """Three thousand more points: more only by what the instants themselves take, some 8 bytes each."""
    peaks = []
    for rows in (5_000, 8_000):
        motion = Stops([[0.0] * 6, [0.05] * 6], [rows * 1e-3], smooth=True)
        source = source_of(motion, tuple(Axis(f"leg{k}", pulse=1e-6) for k in range(6)))
        tracemalloc.start()
        find_format("g93")(spacing=1e-3).write(source, tmp_path / "file")
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] - peaks[0] < 3_000 * 8 * 8
    assert peaks[1] < 64e6


def test_long_names_keep_lines_short(tmp_path):
    """RS-274 lines have at most 256 characters."""
    source = nine(name="p" * 1000)
    axes = tuple(Axis(f"{k}" * 500, pulse=1e-9) for k in range(9))
    source = source_of(source.trajectory, axes, name="(" * 1000)
    find_format("g93")(spacing=0.01).write(source, tmp_path / "g")
    assert max(map(len, (tmp_path / "g").read_text().splitlines())) < 256
    assert off(g93(tmp_path / "g", source), source) > 0.5  # as 10 ms are too long for nanometres
