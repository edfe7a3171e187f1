"""What is said of the lines of STEP and DIR against what drives need of them."""

import pytest

from kinematics.foundation.table import Column, Table
from pulsepath.output.drive_tables import add_close_drives, tabulate_drives


def axis(low, setup, rate, **needs):
    kept = {"high": 2e-6, "low": low, "setup": setup, "hold": None}
    needed = {
        "high": 1.9e-6,
        "low": 1.9e-6,
        "setup": 0.65e-6,
        "hold": 0.65e-6,
        "max_rate": None,
        **needs,
    }
    return {
        "lines_s": kept,
        "drive_needs_s": needed,
        "highest_rate_hz": rate,
        "max_pulse_rate_hz": None,
    }


def first_screen():
    return [Table("plan", (Column("what", ["duration"]), Column("", ["1 s"])))]


def rows(tables):
    return dict(zip(*(column.values for column in tables[0].columns), strict=True))


def test_the_table_has_what_is_kept_and_what_is_needed():
    (table,) = tabulate_drives(
        {"axes": {"x": axis(10e-6, 5e-3, 80e3), "y": axis(10e-6, 5e-3, 80e3, max_rate=1e5)}}
    )
    cells = {column.name: list(column.values) for column in table.columns}
    assert cells["axis"] == ["x", "y"]
    assert cells["STEP low (µs)"] == ["10 / 1.9"] * 2
    assert cells["DIR hold (µs)"] == ["– / 0.65"] * 2  # never turns
    assert cells["highest rate (kHz)"] == ["80 / 263.158", "80 / 100"]  # 1/(1.9 µs + 1.9 µs)


def test_a_machine_without_drives_is_told_how_to_state_them():
    one = {**axis(10e-6, 5e-3, 80e3), "drive_needs_s": None}
    (table,) = tabulate_drives({"axes": {"x": one}})
    assert "timing" in table.notes[-1]
    assert tabulate_drives({"axes": {"x": {}}}) == []  # pulses that were not checked
    assert rows(add_close_drives(first_screen(), {"axes": {"x": one}})) == {"duration": "1 s"}


@pytest.mark.parametrize(
    ("one", "told"),
    [
        (axis(2.27e-6, 5e-3, 80e3), "STEP low of x 2.27 us, its drive needs 1.9"),
        (axis(9e-6, 0.7e-6, 80e3), "DIR set-up of x 0.7 us, its drive needs 0.65"),
        (axis(9e-6, 5e-3, 80e3, max_rate=90e3), "x up to 80 kHz, its drive takes 90"),
        (axis(2.29e-6, 0.79e-6, 80e3, max_rate=97e3), None),
    ],
)
def test_the_first_screen_names_what_is_close(one, told):
    found = rows(add_close_drives(first_screen(), {"axes": {"x": one}}))
    assert found.get("drive timing") == (told and f"{told}; all with -v")


def test_the_closest_of_several_is_named():
    both = {"axes": {"x": axis(2.2e-6, 5e-3, 80e3), "y": axis(2.0e-6, 5e-3, 80e3)}}
    assert rows(add_close_drives(first_screen(), both))["drive timing"].startswith(
        "STEP low of y 2 us"
    )
