"""A loaded plan is a plan: it has what a fresh one has, to the last bit, whatever it was made
of.
"""

import numpy as np
import pytest

import pulsepath as pp
from kinematics.foundation.names import presets
from planner.certificate import certify
from tests.windows import small_windows

SQUARE = """schema = 1
angle = "deg"
length = "mm"
start = [0, 0, 25]
[[segment]]
line = { to = [2, 0, 26] }
join = { blend = 0.05 }
trigger = "half"
[[segment]]
line = { to = [2, 2, 25] }
[[segment]]
dwell = "20 ms"
[[segment]]
turn = { to = [0, 0, 1] }
"""
SHAPER = 'shaper = { kind = "zv", frequency = "35 Hz", damping = 0.05 }\n'
PLAY = 'backlash = "5 um"\ncompensate = ["backlash"]\ntake_up_acceleration = "1 m/s^2"\n'
CASES = {
    "order 3": ("hexapod", "", [], {}),
    "in a stated time, by another rule": (
        "hexapod",
        "",
        ["--order", "2", "--duration", "3 s", "--rule", "dda"],
        {"order": 2, "duration": 3.0, "rule": "dda"},
    ),
    "with less heat, without pulses": (
        "hexapod",
        "",
        ["--objective", "time + heat", "--pulses", "none"],
        {"objective": "time + heat"},
    ),
    "after shapers, pulses as CSV": (
        "traverser",
        SHAPER,
        ["--order", "2", "--pulses", "csv"],
        {"order": 2},
    ),
    "with play": ("hexapod", PLAY, ["--order", "2"], {"order": 2}),
}
LATER = ("lower_bound", "gap", "worth")
"""What takes long, and is looked at of one case alone."""


@pytest.fixture
def stored(tmp_path, call):
    """Plans on the command line, and loads it; the same planned here."""

    def make(preset, axes, options, named):
        machine, program = tmp_path / "machine.toml", tmp_path / "square.toml"
        text = presets("kinematics")[preset].read_text(encoding="utf-8")
        machine.write_text(text.replace("[axes]\n", f"[axes]\n{axes}"), encoding="utf-8")
        program.write_text(SQUARE, encoding="utf-8")
        out = tmp_path / "out"
        given = ("--machine", machine, "--no-figures", "--no-baselines", "--no-worth", "--out", out)
        done = call("plan", program, *given, *options)
        assert done.exit_code == 0, done.stderr
        return pp.load_plan(out), pp.plan(str(program), str(machine), **named)

    return make


@pytest.mark.parametrize(("preset", "axes", "options", "named"), CASES.values(), ids=CASES)
def test_a_loaded_plan_has_all_that_a_fresh_one_has(stored, preset, axes, options, named):
    loaded, fresh = stored(preset, axes, options, named)
    assert isinstance(loaded, pp.Plan)
    public = {name for name in dir(fresh) if not name.startswith("_")}
    assert public <= set(dir(loaded))

    assert loaded.certificate.holds
    # Proved without what the solver has proved already, as a loaded plan is.
    again = certify(fresh.trajectory, fresh.limits)
    assert (
        loaded.certificate.worst == again.worst == pytest.approx(fresh.certificate.worst, rel=1e-6)
    )
    assert loaded.certificate.where == again.where
    same = (
        "duration",
        "fastest",
        "stated_duration",
        "objective",
        "order",
        "rounds",
        "methods",
        "own_limits",
        "left_out",
    )
    for name in (*same, "lower_estimate", "exceeded", "conditioning", "departures"):
        assert getattr(loaded, name) == getattr(fresh, name), name
    assert (loaded.shaped is None) == (fresh.shaped is None)
    if fresh.shaped is not None:
        assert loaded.shaped.worst == pytest.approx(fresh.shaped.worst, rel=1e-6)
    for one, other in zip(loaded.pulses.axes, fresh.pulses.axes, strict=True):
        assert np.array_equal(one.ticks, other.ticks)
    assert [event.where.t for event in loaded.triggers] == [
        event.where.t for event in fresh.triggers
    ]

    errors = [each.realised(stride=40) for each in (loaded, fresh)]
    assert str(errors[0]) == str(errors[1])
    assert str(pp.realised(loaded, stride=40)) == str(errors[1])
    assert 0 < errors[0]["position"].max <= errors[0]["position"].bound
    assert str(loaded.axis_bounds) == str(fresh.axis_bounds)
    assert str(loaded.data()) == str(fresh.data())


def test_its_tables_figure_bound_and_worth_are_those_of_a_fresh_one(stored):
    loaded, fresh = stored("hexapod", "", ["--order", "2"], {"order": 2})
    tables = [
        [table for table in plan.tables() if "certificate" not in table.title]
        for plan in (loaded, fresh)
    ]
    assert len(tables[0]) > 4
    assert [str(table) for table in tables[0]] == [str(table) for table in tables[1]]
    figure, other = (plan.plot().get_figure(root=True) for plan in (loaded, fresh))
    drawn = [
        collection.get_array()
        for each in (figure, other)
        for collection in each.axes[0].collections[:1]
    ]
    assert np.array_equal(*drawn)
    for name in LATER:
        assert str(getattr(loaded, name)) == str(getattr(fresh, name)), name
    assert pp.classical(loaded).duration == pp.classical(fresh).duration
    stop, same = loaded.hold(0.1), fresh.hold(0.1)
    assert stop.duration == pytest.approx(same.duration, rel=1e-9)
    assert stop.certificate.holds


def test_one_that_was_planned_in_parts_has_a_certificate_and_a_realised_path(tmp_path, call):
    program, out = tmp_path / "part.nc", tmp_path / "out"
    program.write_text(
        "G21 G90 G64 P0.05 F1200\nG1 X5 Y5\nX10 Y0\nG4 P0.1\nX20 Y3\n", encoding="utf-8"
    )
    given = ("--machine", "corexy", "--order", "2", "--stream", "--no-figures", "--out", out)
    with small_windows(1):
        assert call("plan", program, *given).exit_code == 0
    loaded = pp.load_plan(out)
    assert loaded.source.in_parts
    assert loaded.certificate.holds
    assert 0.99 < max(loaded.certificate.worst.values()) <= 1
    error = pp.realised(loaded)["position"]
    assert 0 < error.max <= error.bound
    assert loaded.plot() is not None
    assert "lower bound" not in str(loaded)
    assert len(list(loaded.follow())) > 1

    # The joined motion has the bound and the worth of a plan that was made as a whole.
    whole = pp.plan(pp.import_program(program).program, "corexy", order=2)
    assert loaded.lower_bound == pytest.approx(whole.lower_bound, rel=1e-6)
    assert 0 <= loaded.gap < whole.gap + 1e-3
    assert loaded.worth.best == whole.worth.best
    assert loaded.path.fit == whole.path.fit
