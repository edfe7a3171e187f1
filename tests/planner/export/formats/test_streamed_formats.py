"""VCD, step queue, halstreamer and Galil files: each decoded here by other code, and held against
what was exported.
"""

import json
import re
import shutil
import subprocess
import tracemalloc
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import unquote

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import Axis, MotionError
from planner import PulseSchedule
from planner.export.format import ExportSource, find_format
from planner.export.formats import pulse_csv, vcd
from planner.pulses import AxisPulses
from planner.pulses.generation.sent import SentPulses
from planner.pulses.generation.spacing import GivenPulse

NAMES = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12)


class Swing:
    """q = home + reach sin²(t) per axis: a smooth motion that reverses."""

    knots, duration = np.linspace(0.0, 3.0, 31), 3.0

    def __init__(self, reach, start=0.0):
        self.reach, self.start = np.asarray(reach, float), start

    def at(self, t):
        t = np.asarray(t)[:, None]
        return SimpleNamespace(
            q=self.start + self.reach * np.sin(t) ** 2,
            qd=self.reach * np.sin(2 * t),
            qdd=2 * self.reach * np.cos(2 * t),
        )


def sampled(reach, kinds=None, signs=None, home=None, pulse=1e-6):
    n = len(reach)
    axes = tuple(
        Axis(f"axis{k}", (kinds or ["linear"] * n)[k], pulse=pulse, direction=(signs or [1] * n)[k])
        for k in range(n)
    )
    home = np.zeros(n) if home is None else np.asarray(home, float)
    return ExportSource("swing", SimpleNamespace(axes=axes, home_q=home), Swing(reach, home), None)


def pulsed(clock=10_000_000, pulses=400, axes=3, seed=0, names=None, program="p", closest=60):
    random = np.random.default_rng(seed)
    signs = random.choice([-1, 1], axes)
    names = names or [f"leg{k + 1}" for k in range(axes)]
    found = []
    for name in names:
        gaps = np.rint(
            closest + 2000 * (1 + np.sin(np.linspace(0, 9, pulses) + random.uniform(0, 6)))
        )
        ways = 1 - 2 * (np.cumsum(random.random(pulses) < 0.02) % 2)
        found.append(
            AxisPulses(name, np.cumsum(gaps).astype(np.int64), ways.astype(np.int8), 0, 1e-6, 0.0)
        )
    machine = SimpleNamespace(
        axes=tuple(
            Axis(name, pulse=1e-6, direction=int(sign))
            for name, sign in zip(names, signs, strict=True)
        ),
        home_q=np.zeros(axes),
    )
    last = max((int(axis.ticks[-1]) for axis in found if len(axis)), default=0)
    return ExportSource(
        program, machine, None, PulseSchedule(clock, tuple(found), (last + 1000) / clock)
    )


def dump_by_rules(path):
    """Name -> the changes (time, level), and seconds per unit, by what sigrok and GTKWave take."""
    words = path.read_bytes().decode("ascii").split()
    names, changes, now, unit, at = {}, {}, None, None, 0
    while at < len(words):
        word = words[at]
        if word in ("$comment", "$timescale", "$scope", "$upscope", "$var", "$enddefinitions"):
            end = words.index("$end", at)
            if word == "$timescale":
                unit = float(words[at + 1]) * {"ns": 1e-9, "ps": 1e-12, "fs": 1e-15}[words[at + 2]]
            if word == "$var":
                kind, size, code, name = words[at + 1 : end]
                assert (kind, size) == ("wire", "1")
                assert code not in names
                names[code] = name
                changes[name] = []
            at = end
        elif word[0] == "#":
            assert now is None or int(word[1:]) > now
            now = int(word[1:])
        elif word[0] in "01":
            level = int(word[0])
            told = changes[names[word[1:]]]
            assert not told or told[-1][1] != level  # only what changes is told
            told.append((now, level))
        else:
            assert word in ("$dumpvars", "$end")
        at += 1
    return changes, unit, now


def dump_by_pyvcd(path):
    reader = pytest.importorskip("vcd.reader")
    names, changes, now, unit = {}, {}, None, None
    with path.open("rb") as file:
        for token in reader.tokenize(file):
            if token.kind is reader.TokenKind.TIMESCALE:
                scale = token.timescale
                unit = (
                    int(scale.magnitude) * {"ns": 1e-9, "ps": 1e-12, "fs": 1e-15}[scale.unit.value]
                )
            elif token.kind is reader.TokenKind.VAR:
                names[token.var.id_code] = token.var.reference
                changes[token.var.reference] = []
            elif token.kind is reader.TokenKind.CHANGE_TIME:
                now = token.time_change
            elif token.kind is reader.TokenKind.CHANGE_SCALAR:
                changes[names[token.scalar_change.id_code]].append(
                    (now, int(token.scalar_change.value))
                )
    return changes, unit, now


def assert_dump(source, changes, unit):
    """Rising STEP lines are the pulses, with DIR as the wiring counts."""
    for axis, driven in zip(source.pulses.axes, source.machine.axes, strict=True):
        mine = {unquote(name): told for name, told in changes.items()}
        step, way = mine[f"{axis.name}_STEP"], mine[f"{axis.name}_DIR"]
        rising = np.array([time for time, level in step if level], float)
        assert (np.rint(rising * unit * source.pulses.clock_hz) == axis.ticks).all()
        assert abs(rising * unit * source.pulses.clock_hz - axis.ticks).max(initial=0) <= 0.05
        turned, level = (np.array(part) for part in zip(*way, strict=True))
        levels = level[np.searchsorted(turned, rising, side="right") - 1]
        assert ((2 * levels - 1) * driven.direction == axis.direction).all()


@pytest.mark.parametrize("decode", [dump_by_rules, dump_by_pyvcd])
@pytest.mark.parametrize("clock", [10_000_000, 16_000_000, 19_660_000, 9_830_400, 1_000_000_000, 3])
def test_a_dump_holds_the_pulses_to_the_tick(tmp_path, clock, decode):
    source = pulsed(clock)
    done = find_format("vcd")(width=None).write(source, tmp_path / "p.vcd")
    changes, unit, end = decode(tmp_path / "p.vcd")
    assert_dump(source, changes, unit)
    assert done.error == 0
    assert end * unit == pytest.approx(source.pulses.duration, abs=unit)
    assert (unit == 1e-9) == (10**9 % clock == 0)


def test_a_dump_reads_as_viewers_want_it(tmp_path):
    axis = AxisPulses(
        "leg1", np.array([100, 200, 350]), np.array([1, 1, -1], np.int8), 0, 1e-6, 0.0
    )
    machine = SimpleNamespace(axes=(Axis("leg1"),), home_q=np.zeros(1))
    find_format("vcd")().write(
        ExportSource("p", machine, None, PulseSchedule(10**7, (axis,), 5e-5)), tmp_path / "p.vcd"
    )
    assert (tmp_path / "p.vcd").read_text() == (
        "$comment pulsepath p $end\n$timescale 1 ns $end\n$scope module pulsepath $end\n"
        '$var wire 1 ! leg1_STEP $end\n$var wire 1 " leg1_DIR $end\n$upscope $end\n$enddefinitions $end\n'
        '#0\n$dumpvars\n0!\n1"\n$end\n#10000\n1!\n#12000\n0!\n#20000\n1!\n#22000\n0!\n0"\n#35000\n1!\n#37000\n0!\n'
        "#50000\n"
    )


def steps_of(path, source):
    """Ticks and signs of each oid, by the words of FORMATS: positional numbers or named ones."""
    found = {k: ([], []) for k in range(len(source.machine.axes))}
    last, way = {}, {}
    for line in path.read_bytes().decode("ascii").split("\n"):
        if not line or line[0] == "#":
            continue
        name, *numbers = re.sub(r"\b(oid|interval|count|add|dir|clock)=", "", line).split(" ")
        oid, *numbers = map(int, numbers)
        if name == "reset_step_clock":
            (last[oid],) = numbers
        elif name == "set_next_step_dir":
            (way[oid],) = numbers
        else:
            assert name == "queue_step"
            interval, count, add = numbers
            for _ in range(count):  # as firmware does it
                last[oid] += interval
                interval += add
                found[oid][0].append(last[oid])
                found[oid][1].append((2 * way[oid] - 1) * source.machine.axes[oid].direction)
    return [tuple(np.array(part, np.int64) for part in pair) for pair in found.values()]


@pytest.mark.parametrize(
    "options", [{}, {"within": 0.0}, {"within": 25e-6, "named": True}, {"least": 6e-6}]
)
def test_a_step_queue_holds_the_pulses_within_its_tolerance(tmp_path, options):
    source = pulsed(pulses=3000)
    done = find_format("steps")(**options).write(source, tmp_path / "p.steps")
    tolerance = round(options.get("within", 1e-6) * 1e7)
    travel = 0.0
    for (ticks, signs), axis in zip(
        steps_of(tmp_path / "p.steps", source), source.pulses.axes, strict=True
    ):
        assert (signs == axis.direction).all()
        assert abs(ticks - axis.ticks).max() <= tolerance
        assert np.diff(ticks).min() >= (60 if "least" in options else 1)
        travel = max(
            travel,
            abs(np.interp(ticks, axis.ticks, np.arange(len(axis))) - np.arange(len(axis))).max(),
        )
    assert travel <= done.error <= tolerance / 60 + 1e-9
    first = next(line for line in (tmp_path / "p.steps").read_text().splitlines() if line[0] == "q")
    assert re.fullmatch(r"queue_step oid=\d interval=\d+ count=\d+ add=-?\d+" if options.get("named") else
                        r"queue_step \d \d+ \d+ -?\d+", first)  # fmt: skip


@pytest.fixture(scope="session")
def steps_decoder(tmp_path_factory):
    """The decoder in C of docs/examples, compiled with every warning."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler (cc)")
    program = tmp_path_factory.mktemp("c") / "steps_decoder"
    source = Path(__file__).parents[4] / "docs" / "examples" / "steps_decoder.c"
    subprocess.run(
        [compiler, "-std=c11", "-Wall", "-Wextra", "-Werror", "-O2", "-o", program, source],
        check=True,
    )
    return lambda file: subprocess.run(
        [program], stdin=file.open(), capture_output=True, text=True, check=False
    )


def test_whole_number_firmware_steps_as_the_queue_says(tmp_path, steps_decoder):
    source = pulsed(clock=12_000_000, pulses=2000)
    find_format("steps")(within=0.0).write(source, tmp_path / "a.steps")
    done = steps_decoder(tmp_path / "a.steps")
    assert (done.returncode, done.stderr) == (0, "")
    found = np.array([line.split() for line in done.stdout.splitlines()], np.int64)
    for k, (own, axis) in enumerate(zip(source.pulses.axes, source.machine.axes, strict=True)):
        mine = found[found[:, 0] == k]
        assert np.array_equal(mine[:, 1], own.ticks)
        assert np.array_equal(mine[:, 2], own.direction * axis.direction)


def test_a_motion_that_goes_on_resets_no_clock_of_a_stepper_that_moves(tmp_path, steps_decoder):
    """Klipper's firmware refuses that.

    Its first command counts from the pulse before, at a tick below 0.
    """
    source = pulsed(clock=12_000_000, pulses=2000)
    last = GivenPulse(-5, -5, -5, 1)
    far = replace(last, tick=-(1 << 30))
    sent = [
        SentPulses(0, last),
        SentPulses(0, far),
        SentPulses(0),
        *[SentPulses(0, last)] * (len(source.pulses.axes) - 3),
    ]
    source = replace(source, since=0.5, sent=tuple(sent))
    written = find_format("steps")(within=0.0).write(source, tmp_path / "a.steps")
    assert written.error == 0
    text = (tmp_path / "a.steps").read_text()
    assert re.findall(r"reset_step_clock (\d)", text) == [
        "1",
        "2",
    ]  # no pulse was sent there, or long ago
    assert "# oid 0 goes on, its last pulse at -5\n" in text
    first = int(re.search(r"queue_step 0 (\d+) 1 0", text)[1])
    assert first == source.pulses.axes[0].ticks[0] + 5
    done = steps_decoder(tmp_path / "a.steps")
    assert (done.returncode, done.stderr) == (0, "")
    found = np.array([line.split() for line in done.stdout.splitlines()], np.int64)
    for k, own in enumerate(source.pulses.axes):
        assert np.array_equal(found[found[:, 0] == k][:, 1], own.ticks)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("queue_step 0 100 1 0\n", "before the axis has a clock"),
        (
            "reset_step_clock 0 0\nset_next_step_dir 0 1\nqueue_step 0 10 3 -10\n",
            "line 3: steps that do not follow",
        ),
        ("reset_step_clock 0 0\nset_next_step_dir 0 1\nqueue_step 0 10 70000 0\n", "is no command"),
        ("reset_step_clock 0 9\nreset_step_clock 0 8\n", "goes back"),
        ("reset_step_clock 0 9", "ends within"),
    ],
)
def test_the_decoder_in_c_refuses_what_is_no_queue(tmp_path, steps_decoder, text, words):
    (tmp_path / "bad.steps").write_text(text)
    done = steps_decoder(tmp_path / "bad.steps")
    assert done.returncode == 1
    assert words in done.stderr


def test_steps_come_in_the_order_in_which_they_are_needed(tmp_path):
    source = pulsed(pulses=500)
    find_format("steps")().write(source, tmp_path / "p.steps")
    last, begun = {}, []
    for line in (tmp_path / "p.steps").read_text().splitlines():
        name, *numbers = line.split()
        if name == "reset_step_clock":
            last[int(numbers[0])] = int(numbers[1])
        if name == "queue_step":
            oid, interval, count, add = map(int, numbers)
            begun.append(last[oid])
            last[oid] += count * interval + add * count * (count - 1) // 2
    assert begun == sorted(begun)


def table_of(path):
    return np.array(
        [
            [float(cell) for cell in line.split(" ")]
            for line in path.read_text("ascii").split("\n")[:-1]
        ]
    )


def off_motion(source, positions, period):
    """pulses by which straight lines through positions (N, axes), m or rad, are off the motion."""
    t = np.linspace(0, source.trajectory.duration, 20_011)
    nodes = np.arange(len(positions)) * period
    held = np.column_stack([np.interp(t, nodes, column) for column in positions.T])
    return float(
        (abs(held - source.trajectory.at(t).q) / [axis.pulse for axis in source.machine.axes]).max()
    )


@pytest.mark.parametrize("origin", ["home", "natural"])
def test_halstreamer_samples_are_where_the_axes_are(tmp_path, origin):
    source = sampled([0.02, -0.3], kinds=["linear", "rotary"], home=[0.2, 1.0], pulse=1e-5)
    done = find_format("halstreamer")(period=4e-3, origin=origin).write(source, tmp_path / "p.txt")
    table = table_of(tmp_path / "p.txt")
    assert len(table) == 751  # 3 s
    q = table * [1e-3, np.pi / 180] + (source.machine.home_q if origin == "home" else 0)
    off = off_motion(source, q, 4e-3)
    assert off <= done.error <= off * 1.05 + 1e-3
    # q̈ of the second axis is 0.6 rad/s²: a chord is off by q̈ h²/8 at most
    assert off == pytest.approx(0.6 * 4e-3**2 / 8 / 1e-5, rel=0.05)


def test_halstreamer_counts_are_whole_and_in_the_wiring(tmp_path):
    source = sampled([0.02, 0.01], signs=[1, -1], home=[0.2, 0.0])
    find_format("halstreamer")(unit="counts").write(source, tmp_path / "p.txt")
    assert re.fullmatch(r"(-?\d+ -?\d+\n)+", (tmp_path / "p.txt").read_text())
    table = table_of(tmp_path / "p.txt")
    t = np.minimum(np.arange(len(table)) * 1e-3, 3.0)
    assert (
        abs(table * [1, -1] - (source.trajectory.at(t).q - source.machine.home_q) / 1e-6).max()
        <= 0.5 + 1e-6
    )


def contour_of(path):
    lines = path.read_bytes().decode("ascii").split("\n")
    assert lines[0] == "CM " + "ABCDEFGH"[: len(lines[0]) - 3]
    assert re.fullmatch(r"DT [1-8]", lines[1])
    width = len(lines[0]) - 3
    assert lines[-2:] == [f"CD {','.join('0' * width)}=0", ""]
    assert all(re.fullmatch(r"CD -?\d+(,-?\d+)*", line) for line in lines[2:-2])
    return 1e-3 * 2 ** int(lines[1][3:]), np.array(
        [[int(n) for n in line[3:].split(",")] for line in lines[2:-2]]
    )


@pytest.mark.parametrize("interval", [1, 3, 8])
def test_galil_increments_add_up_to_the_motion(tmp_path, interval):
    source = sampled([0.02, -0.007], signs=[1, -1], home=[0.2, 0.0])
    done = find_format("galil")(interval=interval).write(source, tmp_path / "p.dmc")
    each, increments = contour_of(tmp_path / "p.dmc")
    counts = np.concatenate([[[0, 0]], np.cumsum(increments, axis=0)]) * [1, -1]
    t = np.minimum(np.arange(len(counts)) * each, 3.0)
    exact = (source.trajectory.at(t).q - source.machine.home_q) / 1e-6
    assert abs(counts - exact).max() <= 0.5 + 1e-6  # the remainder never adds up
    assert t[-1] == 3.0
    off = off_motion(source, counts * 1e-6 + source.machine.home_q, each)
    assert off <= done.error + 1e-6
    assert done.error <= off * 1.05 + 0.05


@pytest.mark.parametrize(
    ("name", "options", "source", "told"),
    [
        ("galil", {}, sampled([0.01] * 9), "axis axis8: 9 axes, but contour mode has at most 8"),
        ("galil", {"interval": 0}, sampled([0.01]), "interval 0: must be from 1 to 8"),
        (
            "galil",
            {"interval": 8},
            sampled([0.3]),
            r"axis axis0: \d+ counts in 256 ms, limit 32767",
        ),
        (
            "halstreamer",
            {},
            sampled([0.01] * 22),
            "axis axis21: 22 axes, but a stream has at most 21",
        ),
        (
            "halstreamer",
            {"period": 0.0},
            sampled([0.01]),
            "period must be one finite number in s above 0",
        ),
        (
            "halstreamer",
            {"unit": "counts", "origin": "natural"},
            sampled([0.01]),
            "counts are from home",
        ),
        ("vcd", {}, pulsed(pulses=2, axes=48), "48 axes, but a dump has at most 47"),
        ("vcd", {"width": 1.0}, pulsed(), "pulse width"),
        ("vcd", {}, pulsed(clock=999_999_937, closest=100), "clock 999999937 Hz"),
        ("steps", {"within": -1e-6}, pulsed(), "within must be one finite number in s not below 0"),
        ("steps", {"within": float("inf")}, pulsed(), "within must be one finite number"),
        ("steps", {"least": 1.0}, pulsed(), "limit 10000000"),
    ],
)
def test_what_a_format_cannot_hold_is_refused(tmp_path, name, options, source, told):
    with pytest.raises(MotionError, match=told):
        find_format(name)(**options).write(source, tmp_path / "p")


@settings(deadline=None, max_examples=40)
@given(st.lists(NAMES, min_size=1, max_size=3, unique=True), NAMES)
def test_any_names_survive(tmp_path_factory, names, program):
    """Quotes, commas, newlines, white space, $end, other alphabets: no name breaks a file or is
    taken for another.
    """
    folder = tmp_path_factory.mktemp("names")
    source = pulsed(pulses=20, axes=len(names), names=names, program=program)
    find_format("vcd")().write(source, folder / "p.vcd")
    for decode in [dump_by_rules, *([dump_by_pyvcd] if find_spec("vcd") else [])]:
        changes, unit, _ = decode(folder / "p.vcd")
        assert len(changes) == 2 * len(names)
        assert_dump(source, changes, unit)
    comment = (folder / "p.vcd").read_text("ascii").splitlines()[0].split(" ")
    assert [comment[0], unquote(comment[2]), comment[3]] == ["$comment", program, "$end"]
    find_format("steps")(within=0.0).write(source, folder / "p.steps")
    lines = (folder / "p.steps").read_bytes().decode("ascii").split("\n")
    assert json.loads(re.match(r'# pulsepath ("(?:[^"\\]|\\.)*")', lines[0])[1]) == program
    for k, name in enumerate(names):
        assert json.loads(re.match(rf'# oid {k} = ("(?:[^"\\]|\\.)*")', lines[k + 1])[1]) == name
    for (ticks, _), axis in zip(
        steps_of(folder / "p.steps", source), source.pulses.axes, strict=True
    ):
        assert (ticks == axis.ticks).all()


@pytest.mark.parametrize("name", ["halstreamer", "galil"])
def test_memory_does_not_grow_with_the_samples(tmp_path, name):
    source = sampled([0.02] * 6)
    source.trajectory.duration, source.trajectory.knots = 20.0, np.linspace(0, 20, 61)
    tracemalloc.start()
    find_format(name)().write(source, tmp_path / "p")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # blocks of 2^12 samples, instants in parts of 2^16: some 30 MB however long
    assert peak < 60e6


def test_a_dump_is_written_and_read_in_pieces(tmp_path, monkeypatch):
    source = pulsed(pulses=3000)
    assert find_format("vcd")().write(source, tmp_path / "whole.vcd").error == 0
    monkeypatch.setattr(pulse_csv, "WINDOW", 100)
    monkeypatch.setattr(vcd, "PART_BYTES", 1000)
    assert find_format("vcd")().write(source, tmp_path / "pieces.vcd").error == 0
    assert (tmp_path / "pieces.vcd").read_bytes() == (tmp_path / "whole.vcd").read_bytes()


def test_axes_without_pulses_and_pulses_at_tick_zero(tmp_path):
    axes = (
        AxisPulses("silent", np.empty(0, np.int64), np.empty(0, np.int8), 0, 1e-6, 0.0),
        AxisPulses("early", np.array([0, 500]), np.array([1, -1], np.int8), 0, 1e-6, 0.0),
    )
    machine = SimpleNamespace(axes=(Axis("silent"), Axis("early")), home_q=np.zeros(2))
    source = ExportSource("p", machine, None, PulseSchedule(10**7, axes, 1.0))
    for name in ("vcd", "steps"):
        assert find_format(name)().write(source, tmp_path / name).error == 0
    (silent, _), (early, signs) = steps_of(tmp_path / "steps", source)
    assert (len(silent), early.tolist(), signs.tolist()) == (0, [0, 500], [1, -1])
    changes, unit, _ = dump_by_rules(tmp_path / "vcd")
    assert_dump(replace_silent(source), {k: v for k, v in changes.items() if "early" in k}, unit)


def replace_silent(source):
    """Without the axis that never fires."""
    pulses = PulseSchedule(source.pulses.clock_hz, source.pulses.axes[1:], source.pulses.duration)
    return ExportSource(
        source.name, SimpleNamespace(axes=source.machine.axes[1:], home_q=np.zeros(1)), None, pulses
    )
