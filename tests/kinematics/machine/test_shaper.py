"""Input shapers: their impulses against the literature, and what they leave of a vibration against
its equation.
"""

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from kinematics import load_machine
from kinematics.foundation.errors import MotionError
from kinematics.machine.machine_writer import machine_toml
from kinematics.machine.shaper import IMPULSES, Shaper, ShaperSeries

KINDS = sorted(IMPULSES)


def oscillation(shaper, frequency, damping):
    """Amplitude after the last impulse of ẍ + 2ζωẋ + ω²x = Σ Aᵢ δ(t − tᵢ), over that of one impulse
    at 0.

    By the motion's exact transition from impulse to impulse, as a matrix exponential: no formula of
    shapers takes part.
    """
    from scipy.linalg import expm

    omega = 2 * np.pi * frequency
    system = np.array([[0.0, 1.0], [-(omega**2), -2 * damping * omega]])
    amplitudes, times = shaper.impulses
    state = np.zeros(2)
    for n, amplitude in enumerate(amplitudes):
        state[1] += amplitude
        if n + 1 < len(times):
            state = expm(system * (times[n + 1] - times[n])) @ state
    root = np.sqrt(1 - damping**2)

    def envelope(x):
        return np.hypot(x[0], (x[1] + damping * omega * x[0]) / (omega * root))

    return envelope(state) / envelope(np.array([0.0, 1.0]))


@pytest.mark.parametrize(
    ("kind", "amplitudes", "periods"),
    [
        ("zv", (1 / 2, 1 / 2), (0, 1 / 2)),  # [Singer and Seering 1990], without damping
        ("zvd", (1 / 4, 1 / 2, 1 / 4), (0, 1 / 2, 1)),
        ("mzv", (1 - 0.5**0.5, 2**0.5 - 1, 1 - 0.5**0.5), (0, 3 / 8, 3 / 4)),
        ("ei", (1.05 / 4, 0.95 / 2, 1.05 / 4), (0, 1 / 2, 1)),  # [Singhose et al. 1994], of 5 %
    ],
)
def test_undamped_impulses_are_those_published(kind, amplitudes, periods):
    found, times = Shaper(kind, 20.0).impulses
    assert np.allclose(found, amplitudes, rtol=0, atol=1e-15)
    assert np.allclose(times * 20.0, periods, rtol=0, atol=1e-15)


def test_a_damped_zv_is_that_of_singer_and_seering():
    """K = exp(−ζπ/√(1 − ζ²)): 1/(1 + K) and K/(1 + K), half a damped period apart."""
    amplitudes, times = Shaper("zv", 10.0, 0.1).impulses
    k = np.exp(-0.1 * np.pi / np.sqrt(0.99))
    assert np.allclose(amplitudes, [1 / (1 + k), k / (1 + k)], rtol=1e-15)
    assert times[1] == pytest.approx(0.05 / np.sqrt(0.99), rel=1e-15)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("damping", [0.0, 0.05, 0.2])
def test_the_vibration_left_is_that_of_the_equation(kind, damping):
    shaper = Shaper(kind, 35.0, damping)
    amplitudes, times = shaper.impulses
    assert amplitudes.sum() == pytest.approx(1, abs=1e-15)
    assert (amplitudes > 0).all()
    assert times[0] == 0
    assert all(before < after for before, after in pairwise(times))
    for frequency in (28.0, 31.5, 35.0, 38.5, 50.0):
        assert shaper.vibration(frequency, damping) == pytest.approx(
            oscillation(shaper, frequency, damping), abs=1e-12
        )
    left = shaper.vibration(35.0, damping)
    assert left <= (0.05 + 1e-12 if kind == "ei" else 1e-12)


def test_the_longer_shapers_bear_a_wrong_frequency_better():
    left = {kind: max(Shaper(kind, 35.0).vibration(f, 0.0) for f in (31.5, 38.5)) for kind in KINDS}
    assert left["ei"] < 0.05 < left["mzv"] < left["zv"]
    assert left["zvd"] < left["mzv"]


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"kind": "ZV", "frequency": 35}, "'ZV' is none of zv, zvd, mzv, ei, nearest is \"zv\""),
        ({"kind": ["zv"], "frequency": 35}, "none of zv, zvd, mzv, ei"),
        ({"kind": "zv", "frequency": 0.0}, "frequency 0 Hz must be from 0.1 to 100000 Hz"),
        ({"kind": "zv", "frequency": -35}, "frequency -35 Hz must be from 0.1"),
        (
            {"kind": "zv", "frequency": float("nan")},
            "frequency must be one finite number in Hz, not nan",
        ),
        (
            {"kind": "zv", "frequency": float("inf")},
            "frequency must be one finite number in Hz, not inf",
        ),
        (
            {"kind": "zv", "frequency": "35 Hz"},
            "frequency must be one finite number in Hz, not '35 Hz'",
        ),
        (
            {"kind": "zv", "frequency": [35]},
            r"frequency must be one finite number in Hz, not of shape \(1,\)",
        ),
        ({"kind": "zv", "frequency": 35, "damping": 1.0}, "damping 1 must be from 0 to 0.9"),
        ({"kind": "zv", "frequency": 35, "damping": -0.1}, "damping -0.1 must be from 0 to 0.9"),
        (
            {"kind": "zv", "frequency": 35, "damping": "5 %"},
            "damping must be one finite number, not '5 %'",
        ),
        ({"kind": "ei", "frequency": 35, "tolerance": 0.7}, "tolerance 0.7 must be from 0 to 0.5"),
        (
            {"kind": "zvd", "frequency": 35, "tolerance": 0.1},
            "zvd: tolerance 0.1 is of the shaper ei alone: omit it",
        ),
    ],
)
def test_what_is_no_shaper_is_refused(given, told):
    with pytest.raises(MotionError, match=told):
        Shaper(**given)


@pytest.mark.parametrize(
    "given", [(), (Shaper("zv", 35.0),), ("zv", "zv"), Shaper("zv", 35.0), None]
)
def test_what_is_no_series_of_shapers_is_refused(given):
    with pytest.raises(MotionError, match="must be two or more of Shaper, not "):
        ShaperSeries(given)


@pytest.mark.parametrize(
    ("direction", "shaper", "told"),
    [
        (
            [1, 0],
            Shaper("zv", 35.0),
            r"direction must be finite numbers \(3,\), not of shape \(2,\)",
        ),
        ([0, 0, 0], Shaper("zv", 35.0), "must be a direction, not zero"),
        ([1, 0, 0], "zv", "shaper must be a Shaper, a ShaperSeries of several, or None, not 'zv'"),
        ([1, 0, 0], None, "shaper must be a Shaper, .* not None"),
    ],
)
def test_what_shapes_no_machine_is_refused(direction, shaper, told):
    with pytest.raises(MotionError, match=told):
        load_machine("hexapod").shape_along(direction, shaper)


@pytest.mark.parametrize(
    "shaper", [Shaper("zv", 35.5), Shaper("mzv", 12.0, 0.1), Shaper("ei", 80.0, 0.05, 0.1)]
)
def test_a_machine_file_keeps_it(shaper, tmp_path):
    machine = load_machine("tripod")
    axes = [replace(axis, shaper=shaper if n else None) for n, axis in enumerate(machine.axes)]
    file = tmp_path / "shaped.toml"
    file.write_text(machine_toml(machine.driven_by(axes)), encoding="utf-8")
    assert [axis.shaper for axis in load_machine(file).axes] == [axis.shaper for axis in axes]


def test_a_file_with_a_wrong_shaper_is_refused_by_line(tmp_path):
    text = machine_toml(load_machine("hexapod"))
    file = tmp_path / "wrong.toml"
    for given, told in (
        ('{ kind = "zvv", frequency = "35 Hz" }', "zvv"),
        ('{ kind = "zv" }', "frequency"),
        (
            '"zv"',
            'needs the frequency of the vibration: write { kind = "zv", frequency = "35 Hz" }',
        ),
        (
            '"off"',
            'shaper: "off" is neither "none" nor a table: write "none", or e.g. { kind = "zv", freq',
        ),
        (
            "[]",
            r'shaper: \[\] names no shaper: omit the key, or write "none" where all other axes have one',
        ),
        ("35", '35 is not a table: write e.g. { kind = "zv", frequency = "35 Hz" }'),
        (
            '["zv"]',
            r'shaper\[1\]: "zv" is not a table: write e.g. { kind = "zv", frequency = "35 Hz" }',
        ),
        ('[{ kind = "zv", frequency = "35 Hz" }, "none"]', r'shaper\[2\]: "none" is not a table'),
        ("[{}]", r"shaper\[1\].frequency: missing: write e.g. \"35 Hz\""),
        ('{ kind = "zv", frequency = 35 }', '35: a number without a unit: write e.g. "35 Hz"'),
        (
            '{ kind = "zv", frequency = "0 Hz" }',
            '"0 Hz" must be at least 0.1 Hz and at most 100000 Hz',
        ),
        ('{ kind = "zv", frequency = "-35 Hz" }', '"-35 Hz" must be at least 0.1 Hz'),
        (
            '{ kind = "zv", frequency = "nan Hz" }',
            '"nan Hz": not a finite number: write e.g. "35 Hz"',
        ),
        (
            '{ kind = "zv", frequency = "35 s" }',
            '"35 s": not convertible to Hz: write e.g. "35 Hz"',
        ),
        ('{ kind = "zv", frequency = "35 Hz", damping = 1 }', "damping: 1 must be at most 0.9"),
        (
            '{ kind = "zv", frequency = "35 Hz", damping = -0.1 }',
            "damping: -0.1 must be at least 0",
        ),
        (
            '{ kind = "zv", frequency = "35 Hz", damping = nan }',
            "nan is not a finite number: write e.g. 0.05",
        ),
        (
            '{ kind = "zv", frequency = "35 Hz", damping = "5 %" }',
            '"5 %" is not a number: write e.g. 0.05',
        ),
        (
            '{ kind = "zv", frequency = "35 Hz", tolerance = 0.1 }',
            "tolerance: 0.1: tolerance is of the shaper ei, not of zv: omit it",
        ),
        ('{ kind = "zv", frequency = "35 Hz", damp = 0.1 }', "damping"),
    ):
        file.write_text(text.replace("[axes]", f"[axes]\nshaper = {given}"), encoding="utf-8")
        with pytest.raises(MotionError, match=told) as refused:
            load_machine(file)
        line = file.read_text(encoding="utf-8").split("\n").index(f"shaper = {given}") + 1
        assert str(refused.value).startswith(f"{file}:{line}: axes.shaper")


def test_shapers_one_after_the_other_keep_the_zeros_of_each():
    """Against the exact motion of each mode, and the convolution of two trains of impulses on a
    fine grid.
    """
    one, other = Shaper("zv", 35.0, 0.05), Shaper("mzv", 22.0, 0.1)
    both = ShaperSeries((one, other))
    assert both == ShaperSeries((other, one))
    amplitudes, times = both.impulses
    assert amplitudes.sum() == pytest.approx(1, abs=1e-15)
    assert (np.diff(times) > 0).all()
    for mode in (one, other):
        assert oscillation(both, mode.frequency, mode.damping) < 1e-12
    assert both.vibration(28.0, 0.02) == pytest.approx(oscillation(both, 28.0, 0.02), abs=1e-12)
    assert both.delay == pytest.approx(amplitudes @ times, abs=1e-15)
    equal = ShaperSeries((Shaper("zv", 20.0), Shaper("zv", 20.0)))  # twice a zv is a zvd
    for found, wanted in zip(equal.impulses, Shaper("zvd", 20.0).impulses, strict=True):
        assert np.allclose(found, wanted, rtol=0, atol=1e-15)
    with pytest.raises(MotionError, match="81 impulses in all, and at most 64"):
        ShaperSeries((Shaper("ei", 20.0),) * 4)


COREXY = (Path(__file__).parents[3] / "kinematics" / "presets" / "corexy.toml").read_text(
    encoding="utf-8"
)
VIBRATION = '\n[[vibration]]\ndirection = {}\nkind = "zv"\nfrequency = "{} Hz"\n'


@pytest.fixture
def load(tmp_path):
    """A machine from the text of its file."""

    def load(text):
        (tmp_path / "machine.toml").write_text(text, encoding="utf-8")
        return load_machine(tmp_path / "machine.toml")

    return load


def test_a_vibration_along_a_direction_shapes_the_axes_that_move_along_it(load):
    machine = load(COREXY + VIBRATION.format("[2, 0, 0]", 35) + VIBRATION.format("[0, 1, 0]", 45))
    both = ShaperSeries((Shaper("zv", 35.0), Shaper("zv", 45.0)))
    assert [axis.shaper for axis in machine.axes] == [both, both, None]
    assert load(machine_toml(machine)).axes == machine.axes
    assert load(machine_toml(machine, complete=True)).axes == machine.axes
    lifted = load(COREXY + VIBRATION.format("[0, 0, 1]", 35))
    assert [axis.shaper for axis in lifted.axes] == [None, None, Shaper("zv", 35.0)]
    legs = load_machine("hexapod").shape_along([1, 0, 0], Shaper("zv", 35.0)).axes
    assert all(leg.shaper == Shaper("zv", 35.0) for leg in legs)


def test_an_arm_across_the_direction_at_home_is_shaped_where_it_moves_along_it_beside_home():
    """The arm's yaw moves its tool across its reach: at home, where it reaches along y say, not
    along y at all.
    """
    arm = load_machine("arm")
    inverse = np.linalg.inv(arm.jacobian(arm.home)[:, :3])
    across = np.cross(inverse[:, 0], [0, 0, 1])
    assert abs(inverse[:, 0] @ across) < 1e-15
    assert arm.shape_along(across, Shaper("zv", 35.0)).axes[0].shaper is not None


def test_one_axis_may_have_none_of_what_all_have(load):
    every = COREXY.replace("[axes]", '[axes]\nshaper = { kind = "zv", frequency = "20 Hz" }')
    own = '\n[[axis]]\nname = "z_screw"\nshaper = "none"\n'
    machine = load(every + own)
    assert [axis.shaper for axis in machine.axes] == [Shaper("zv", 20.0)] * 2 + [None]
    assert load(machine_toml(machine)).axes == machine.axes
    along = load(every + own + VIBRATION.format("[1, 0, 1]", 35))
    assert along.axes[0].shaper == ShaperSeries((Shaper("zv", 20.0), Shaper("zv", 35.0)))
    assert along.axes[2].shaper == Shaper("zv", 35.0)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            VIBRATION.format("[0, 0, 0]", 35),
            r"direction: \[0, 0, 0\]: must not be zero: write e.g. \[1, 0, 0\]",
        ),
        (VIBRATION.format("[1e-320, 0, 0]", 35), r"direction: \[1e-320, 0, 0\]: must not be zero"),
        (
            VIBRATION.format("[1, 0]", 35),
            r"direction: \[1, 0\] has 2 entries instead of 3: write e.g. \[1, 0, 0\]$",
        ),
        (VIBRATION.format("[1, 0, 0, 0]", 35), "has 4 entries instead of 3: write e.g."),
        (
            VIBRATION.format("[]", 35),
            r"direction: \[\] has 0 entries instead of 3: write e.g. \[1, 0, 0\]$",
        ),
        (
            VIBRATION.format("[nan, 0, 0]", 35),
            r"direction\[1\]: nan is not a finite number: as in direction = \[1, 0, 0\]",
        ),
        (VIBRATION.format('"x"', 35), r'direction: "x" is not an array: write e.g. \[1, 0, 0\]'),
        (VIBRATION.format("[1, 0, 0]", 35) + "damping = 1.5\n", "damping: 1.5 must be at most 0.9"),
        (
            '\n[[vibration]]\nkind = "zv"\nfrequency = "35 Hz"\n',
            r"direction: missing: write e.g. \[1, 0, 0\]",
        ),
        (
            VIBRATION.format("[1, 0, 0]", 35) + "tolerance = 0.1\n",
            r"vibration\[1\].tolerance: 0.1: tolerance is of the shaper ei, not of zv: omit it, or write kind = \"ei\"",
        ),
        (
            VIBRATION.format("[1, 0, 0]", 35).replace("direction", "directon"),
            'nearest is "direction"',
        ),
        (
            VIBRATION.format("[1, 0, 0]", 35).replace("[[vibration]]", "[vibration]"),
            r"write \[\[vibration\]\]",
        ),
        (
            "".join(
                VIBRATION.format("[1, 0, 0]", f).replace("zv", "zvd") for f in (20, 30, 40, 50)
            ),
            r"vibration\[4\]: .*81 impulses in all",
        ),
        ('\n[[axis]]\nname = "a"\nshaper = "non"\n', 'nearest is "none"'),
    ],
)
def test_a_wrong_vibration_is_refused_by_line(load, text, told):
    with pytest.raises(MotionError, match=told) as refused:
        load(COREXY + text)
    assert re.match(r".*machine\.toml:\d+: ", str(refused.value))


def test_a_direction_in_which_nothing_moves_is_refused():
    with pytest.raises(
        MotionError, match=r"no axis moves the platform along \[0.0, 0.0, 1.0\] .* it moves x, y"
    ):
        load_machine("linkage").shape_along([0, 0, 1], Shaper("zv", 35.0))


@pytest.mark.parametrize(
    ("again", "same"),
    [
        (("[1, 0, 0]", 35), True),
        (("[-1, 0, 0]", 35), True),  # the same direction
        (("[0.2, 1e-4, 0]", 35), True),
        (("[1, 0, 0]", 35.02), True),
        (("[1, 0, 0]", 35.1), False),
        (("[1, 0.01, 0]", 35), False),
    ],
)
def test_a_vibration_that_is_stated_twice_is_refused(load, again, same):
    text = COREXY + VIBRATION.format("[1, 0, 0]", 35) + VIBRATION.format(*again)
    first, second = (n + 1 for n, line in enumerate(text.split("\n")) if line == "[[vibration]]")
    if not same:
        assert load(text)
        return
    told = rf"machine\.toml:{second}: vibration\[2\]: the same vibration as vibration\[1\] in line {first}, .*: remove one"
    with pytest.raises(MotionError, match=told):
        load(text)
    assert load(text + "damping = 0.05\n")
    assert load(text.replace('"zv"', '"zvd"', 1))


def test_axes_that_two_vibrations_of_one_frequency_drive_are_shaped_against_it_once(load):
    """Both belts move the platform along x and along y: shaped against 35 Hz, they leave it in
    neither direction.
    """
    own = COREXY.replace("[axes]", '[axes]\nshaper = { kind = "zv", frequency = "35 Hz" }')
    for text in (COREXY + VIBRATION.format("[0, 1, 0]", 35), own):
        machine = load(text + VIBRATION.format("[1, 0, 0]", 35))
        assert [axis.shaper for axis in machine.axes[:2]] == [Shaper("zv", 35.0)] * 2
