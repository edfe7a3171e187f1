"""The call list of the motion cards: replayed by lines of its own, by the virtual card, and by a C
compiler.
"""

import csv
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from controllers.card import Card, TAMove, at_rest, send
from kinematics import Axis, MotionError, Traverser
from planner import Arc, Dwell, Line, Program, plan
from planner.export.format import ExportSource
from planner.export.formats.adlink import HEADER, AdlinkC, AdlinkCsv

NASTY = 'a */ b /* "c" \\ \n d, ☃ ??/'


@pytest.fixture(scope="module")
def source(hexapod):
    """Up, a rest, and a small circle on which every leg turns round."""
    bend = Arc([0.0, 0.001, 0.003], [0, 0, 1], 2 * np.pi)
    made = plan(Program((Line([0, 0, 0.003]), Dwell(0.1), bend)), hexapod)
    return ExportSource(NASTY, hexapod, made.trajectory, made.pulses)


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == HEADER
    return [
        (float(t), name, function, int(axis), int(pos), *map(float, rest))
        for t, name, function, axis, pos, *rest in rows
    ]


def motion(source, k, t):
    """Position in counts of the wiring at t (N,)."""
    axis = source.machine.axes[k]
    return (
        (source.trajectory.at(t).q[:, k] - source.machine.home_q[k]) / axis.pulse * axis.direction
    )


def replay(rows, t, start=0.0):
    """Position at t (N,) of one axis' rows, time step by time step: the running move is replaced by
    the next.
    """
    p, now, out = start, 0.0, np.empty(len(t))
    move = None
    pending = list(rows)
    for i, instant in enumerate(t):
        while pending and pending[0][0] <= instant:
            if move is not None:
                p = at(move, p, pending[0][0] - now)
            move, now = pending[0], pending[0][0]
            pending.pop(0)
        out[i] = p if move is None else at(move, p, instant - now)
    return out


def at(move, p, tau):
    """Where an absolute move from p is after tau: start to max within tacc, held, a dead stop on
    the target.
    """
    _, _, _, _, target, start, top, tacc, tdec = move
    assert tdec == 0
    ramp = min(tau, tacc)
    way = start * ramp + (top - start) * ramp**2 / (2 * tacc) + top * (tau - ramp)
    return p + np.sign(target - p) * min(way, abs(target - p))


def test_the_calls_replayed_stay_as_near_to_the_motion_as_is_said(source, tmp_path):
    done = AdlinkCsv().write(source, tmp_path / "calls.csv")
    rows = rows_of(tmp_path / "calls.csv")
    assert [row[0] for row in rows] == sorted(row[0] for row in rows)
    t = np.linspace(0, source.trajectory.duration + 0.01, 3000)
    worst = 0.0
    for k, axis in enumerate(source.machine.axes):
        own = [row for row in rows if row[1] == axis.name]
        position = replay(own, t)
        worst = max(worst, abs(position - motion(source, k, t)).max())
        # what was sent last is where the pulses end; extension is sent as negative counts
        assert own[-1][4] == position[-1] == -source.pulses.axes[k].final
    assert 0.4 < worst <= done.error <= 1.0
    assert "8 ms" in done.notes[0] or "16 ms" in done.notes[0] or "4 ms" in done.notes[0]


@pytest.mark.parametrize("options", [{}, {"spacing": 0.05}, {"speed_range": 2e5}])
def test_the_stated_error_is_never_passed_and_reached(source, tmp_path, options):
    """Looked at every 4 µs around where a coarse look finds it largest: there a parabola of the
    fastest leg's bend, some 1e5 pulses/s², is 2e-7 pulse deep; and just before every call, where
    the error may have a corner; what is stated holds ten times what rounding of s makes of the
    quintics near a rest, some 2e-6 pulse, beside.
    """
    done = AdlinkCsv(**options).write(source, tmp_path / "calls.csv")
    rows = rows_of(tmp_path / "calls.csv")
    coarse = np.linspace(0, source.trajectory.duration + 0.01, 20_000)
    worst = 0.0
    for k, axis in enumerate(source.machine.axes):
        own = [row for row in rows if row[1] == axis.name]
        away = abs(replay(own, coarse) - motion(source, k, coarse))
        corners = np.array([row[0] for row in own]) - 1e-9
        worst = max(worst, abs(replay(own, corners) - motion(source, k, corners)).max())
        for peak in coarse[np.argsort(away)[-15:]]:
            t = np.append(
                coarse[coarse < peak - 5e-4][::40],
                np.linspace(max(peak - 5e-4, 0), peak + 5e-4, 251),
            )
            worst = max(worst, abs(replay(own, t) - motion(source, k, t)).max())
    assert done.error - 5e-5 <= worst <= done.error


def test_every_axis_is_sent_to_its_own_card(source, tmp_path):
    AdlinkCsv().write(source, tmp_path / "calls.csv")
    sent = {
        (name, function, axis) for _, name, function, axis, *_ in rows_of(tmp_path / "calls.csv")
    }
    assert sent == {
        ("leg1", "_8132_ta_move", 0), ("leg2", "_8132_ta_move", 1), ("leg3", "_8164_start_ta_move", 0),
        ("leg4", "_8164_start_ta_move", 1), ("leg5", "_8164_start_ta_move", 2), ("leg6", "_8164_start_ta_move", 3),
    }  # fmt: skip


@pytest.mark.parametrize("mode", ["replace", "queue"])
def test_the_virtual_card_runs_it_whatever_it_does_with_a_command_during_a_move(
    source, tmp_path, mode
):
    done = AdlinkCsv().write(source, tmp_path / "calls.csv")
    rows = [row for row in rows_of(tmp_path / "calls.csv") if row[1] == "leg4"]
    top = max(max(row[5], row[6]) for row in rows)
    card, state, t0 = Card("test", top * 1.01, 19_660_800, mode), at_rest([0]), 0.0
    for t, _, _, _, position, start, limit, tacc, tdec in [
        *rows,
        (source.trajectory.duration + 0.1,) + (None,) * 8,
    ]:
        instants = np.linspace(t0, t, 7)[:-1]
        x = motion(source, 3, instants)
        assert abs(state.position(instants)[:, 0] - x).max(initial=0) <= done.error
        assert abs(state.counter(instants)[:, 0] - x).max(initial=0) <= done.error + 0.5
        if position is not None:
            state, t0 = send(card, state, TAMove([position], [start], [limit], tacc, tdec), t), t
    assert state.counter(t)[0, 0] == -source.pulses.axes[3].final


def test_nothing_is_sent_during_a_rest_and_no_move_turns_round(source, tmp_path):
    AdlinkCsv(spacing=0.016).write(source, tmp_path / "calls.csv")
    rows = rows_of(tmp_path / "calls.csv")
    knots = source.trajectory.knots
    rest = knots[:-1][np.diff(knots) > 0.099][0]
    times = np.array([row[0] for row in rows])
    assert not ((times > rest + 1e-6) & (times < rest + 0.1 - 1e-6)).any()
    for k, axis in enumerate(source.machine.axes):
        for t, *_, tacc, _ in (row for row in rows if row[1] == axis.name):
            way = np.diff(motion(source, k, np.linspace(t, t + tacc, 50)))
            # turning points are known to the microsecond: what is beyond them is far below a
            # thousandth of a pulse
            assert (way >= -1e-3).all() or (way <= 1e-3).all()


def test_speeds_are_whole_steps_of_a_register(source, tmp_path):
    AdlinkCsv(speed_range=100_000.0).write(source, tmp_path / "calls.csv")
    speeds = np.array([row[5:7] for row in rows_of(tmp_path / "calls.csv")]) * 65535 / 100_000
    assert abs(speeds - np.rint(speeds)).max() < 1e-6
    assert 1 <= speeds.min() <= speeds.max() <= 65535


def test_closer_calls_leave_the_rounding_of_targets_alone(source, tmp_path):
    assert (
        AdlinkCsv(spacing=0.002).write(source, tmp_path / "calls.csv").error <= 0.505
    )  # ½, and what a ramp is off


def test_both_files_hold_the_same_calls(source, tmp_path):
    """The C source is compiled, and run against cards that print what they are told."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    one = AdlinkC(spacing=0.016).write(source, tmp_path / "calls.c")
    two = AdlinkCsv(spacing=0.016).write(source, tmp_path / "calls.csv")
    assert one.error == two.error
    stub = "short {}(short a, double p, double s, double m, double u, double d)\n"
    stub += '{{ printf("%.6f {} %d %.17g %.17g %.17g %.17g %.17g\\n", now, a, p, s, m, u, d); return 0; }}\n'
    (tmp_path / "main.c").write_text(
        "#include <stdio.h>\nstatic double now;\nshort pulsepath_run(void (*wait_until)(double));\n"
        "static void wait(double t) { now = t; }\n"
        + "".join(stub.format(name, name) for name in ("_8132_ta_move", "_8164_start_ta_move"))
        + "int main(void) { return pulsepath_run(wait); }\n"
    )
    build = [
        compiler,
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        "calls.c",
        "main.c",
        "-o",
        "calls",
    ]
    subprocess.run(build, cwd=tmp_path, check=True)
    said = subprocess.run(
        [tmp_path / "calls"], capture_output=True, text=True, check=True
    ).stdout.split("\n")[:-1]
    rows = rows_of(tmp_path / "calls.csv")
    assert len(said) == len(rows)
    for line, (t, _, function, *numbers) in zip(said, rows, strict=True):
        told = line.split()
        assert (float(told[0]), told[1]) == (t, function)
        assert [float(n) for n in told[2:]] == [float(n) for n in numbers]


def slides(**wiring):
    limits = {"max_speed": 0.1, "max_acceleration": 2.0, "pulse": 1e-5}
    axes = [Axis(name, card="PCI-8164", channel=k, **limits) for k, name in enumerate("XYZ")]
    axes.append(
        Axis(
            "R",
            "rotary",
            card="PCI-8164",
            channel=3,
            max_speed=1.0,
            max_acceleration=2.0,
            pulse=1e-4,
        )
    )
    axes = [replace(axis, **wiring.get(axis.name, {})) for axis in axes]
    made = plan(
        Program((Line([0.01, 0, 0]),)), Traverser(axes=axes, home=RigidTransform.identity())
    )
    return ExportSource("slides", made.machine, made.trajectory, made.pulses)


def test_axes_that_rest_get_no_calls_and_names_survive(tmp_path):
    made = slides(X={"name": NASTY})
    AdlinkCsv().write(made, tmp_path / "calls.csv")
    assert {row[1] for row in rows_of(tmp_path / "calls.csv")} == {NASTY}
    done = AdlinkC().write(made, tmp_path / "calls.c")
    text = (tmp_path / "calls.c").read_bytes().decode("ascii")
    assert done.error <= 1
    assert text.count("/*") == text.count("*/")
    assert "\r" not in text
    assert "??" not in text


@pytest.mark.parametrize(
    ("wiring", "options", "told"),
    [
        ({"Y": {"card": None, "channel": None}}, {}, "axis Y of machine traverser has no card"),
        ({"Y": {"card": "PCI-7856"}}, {}, "axis Y .* is wired to 'PCI-7856'"),
        ({"Y": {"card": "PCI-8164 (2)"}}, {}, "two cards of one type"),
        ({"Y": {"channel": 48}}, {}, "axis Y: channel 48; limit 47"),
        ({"X": {"pulse": 1.25e-8}}, {}, r"axis X needs 8e\+06 pulses/s .* the card's 6\.55e\+06"),
        ({"X": {"card": "PCI-8132", "channel": 1, "pulse": 4e-8}}, {}, r"and the card's 2\.4e\+06"),
        ({}, {"speed_range": 5000.0}, "its speed range is 5000"),
        ({}, {"spacing": 0.0}, "spacing 0.0 s"),
        ({}, {"spacing": float("nan")}, "spacing nan s"),
    ],
)
def test_what_the_cards_cannot_do_is_refused_before_anything_is_written(
    tmp_path, wiring, options, told
):
    made = slides(**wiring)
    for format_ in (AdlinkCsv, AdlinkC):
        with pytest.raises(MotionError, match=told):
            format_(**options).write(made, tmp_path / "calls")
    assert not list(tmp_path.iterdir())
