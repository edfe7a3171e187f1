"""What machine files say of a drive: its timing, by name or in full, its gear, and what its pulses
make up for.
"""

from importlib.resources import files

import pytest

from kinematics import load_machine, machine_toml
from kinematics.machine.axis import StepTiming, find_drive

HEXAPOD = (files("kinematics") / "presets" / "hexapod.toml").read_text()


@pytest.fixture
def with_line(tmp_path):
    def read(line):
        path = tmp_path / "mine.toml"
        path.write_text(HEXAPOD.replace("direction = -1", f"direction = -1\n{line}"))
        return load_machine(str(path))

    return read


@pytest.mark.parametrize(
    ("written", "timing"),
    [
        ('"DRV8825"', find_drive("DRV8825")),
        (
            '{ high = "1 us", low = "2 us", setup = "0 us", hold = "0.5 us" }',
            StepTiming(1e-6, 2e-6, 0, 0.5e-6),
        ),
        (
            '{ high = "1 us", low = "1 us", setup = "5 us", hold = "0 us", max_rate = "400 kHz" }',
            StepTiming(1e-6, 1e-6, 5e-6, 0, 4e5),
        ),
    ],
)
def test_it_is_read_and_written_back(with_line, tmp_path, written, timing):
    read = with_line(f"timing = {written}")
    assert {axis.timing for axis in read.axes} == {timing}
    (tmp_path / "again.toml").write_text(machine_toml(read))
    assert load_machine(str(tmp_path / "again.toml")).axes == read.axes


def test_a_gear_and_a_factor_make_the_pulse_longer(with_line, tmp_path):
    read = with_line(
        'electronic_gear = [3, 2]\npulse_factor = 1.0178\n[[axis]]\nname = "leg2"\npulse = "1 um"'
    )
    assert read.axes[0].pulse == pytest.approx(0.75e-6 * 1.5 * 1.0178, rel=1e-15)
    assert read.axes[1].pulse == pytest.approx(1e-6 * 1.5 * 1.0178, rel=1e-15)
    (tmp_path / "again.toml").write_text(machine_toml(read))
    assert load_machine(str(tmp_path / "again.toml")).axes == read.axes


def test_compensation_is_read_and_written_back(with_line, tmp_path):
    read = with_line(
        'compensate = ["lead", "backlash"]\nbacklash = "5 um"\ntake_up_acceleration = "2 m/s^2"\npushed = "-"'
    )
    assert {axis.pushed for axis in read.axes} == {"-"}
    assert {(axis.compensate, axis.take_up_acceleration) for axis in read.axes} == {
        (("lead", "backlash"), 2.0)
    }
    (tmp_path / "again.toml").write_text(machine_toml(read))
    assert load_machine(str(tmp_path / "again.toml")).axes == read.axes
