"""Tables: what is read is scaled and rounded, what is held is not."""

import json
from html.parser import HTMLParser

import numpy as np
import pytest

from kinematics import MotionError
from kinematics.foundation.result import Result
from kinematics.foundation.table import MAX_SHOWN_ROWS, Column, Table


class Fake(Result):
    def tables(self):
        one = Column("l", [0.0012345678901234567, float("inf"), None], "m", "human", ".3f")
        return (Table("<b>", (Column("name", ["a", "<i>", "c"]), one), ("note",)),)

    def plot(self, ax=None):
        raise NotImplementedError


def test_text_is_scaled_and_aligned():
    assert str(Fake()).splitlines() == [
        "<b>",
        "name  l (mm)",
        "a      1.235",
        "<i>        ∞",
        "c",
        "note",
    ]


def test_a_bound_is_rounded_upwards():
    assert Column("x", [1.00000001, 1.0, 0.5], form=".7f", up=True).cell(0) == "1.0000001"
    assert (
        float(Column("x", [1e305], form=".7f", up=True).cell(0)) == 1e305
    )  # times 1e7 it is no float


def test_rows_with_units_of_their_own_are_followed_by_a_column_of_them():
    table = Table("", (Column("x", [1e-6, 1e-3], ["m", "rad"], "micro", ".1f"),))
    assert [column.heading for column in table.full] == ["x", "unit"]
    assert table.cells() == [["1.0", "µm"], ["1000.0", "µrad"]]
    assert table.full[1].raw == ["m", "rad"]


def test_html_is_escaped_and_well_formed():
    text, open_ = Fake()._repr_html_(), []

    class Reader(HTMLParser):
        def handle_starttag(self, tag, attrs):
            open_.append(tag)

        def handle_endtag(self, tag):
            assert open_.pop() == tag

    Reader().feed(text)
    assert not open_
    assert "&lt;b&gt;" in text
    assert "<b>" not in text
    assert "<i>" not in text
    assert "background" not in text
    assert "color:#" not in text


def test_long_tables_are_cut_where_they_are_read_only():
    table = Table("", (Column("k", np.arange(1000)),))
    assert len(str(table).splitlines()) == MAX_SHOWN_ROWS + 2
    assert len(table.columns[0].raw) == 1000


def test_files_hold_what_is_told_exactly(tmp_path):
    fake = Fake()
    fake.save(tmp_path / "a.csv")
    fake.save(tmp_path / "a.json")
    rows = (tmp_path / "a.csv").read_text().splitlines()
    assert rows[0] == "name,l [m]"
    assert float(rows[1].split(",")[1]) == 0.0012345678901234567
    told = json.loads((tmp_path / "a.json").read_text())["tables"][0]
    assert told["rows"] == [["a", 0.0012345678901234567], ["<i>", "inf"], ["c", None]]


def test_saving_refuses(tmp_path):
    fake, there = Fake(), tmp_path / "a.csv"
    there.write_text("x")
    for path, said in (
        (there, "force"),
        (tmp_path / "a.xls", r"\.csv, \.json"),
        (tmp_path / "no" / "a.csv", "folder"),
    ):
        with pytest.raises(MotionError, match=said):
            fake.save(path)
    assert there.read_text() == "x"
    fake.save(there, force=True)
    assert there.read_text() != "x"


def test_tables_that_do_not_fit_are_refused():
    with pytest.raises(MotionError):
        Table("", (Column("a", [1]), Column("a", [2])))
    with pytest.raises(MotionError):
        Table("", (Column("a", [1]), Column("b", [2, 3])))


def test_rows_with_several_units_of_their_own_name_them_in_the_cells():
    speed = Column("speed", [0.001, None], ["m/s", "rad/s"], "human", ".1f")
    jerk = Column("jerk", [0.001, 1.0], ["m/s^3", "rad/s^3"], "human", ".1f", words={"1.0": "free"})
    table = Table("", (speed, jerk))
    assert table.cells() == [["1.0 mm/s", "1.0 mm/s³"], ["", "free"]]
    assert [column.heading for column in table.full] == [
        "speed",
        "unit of speed",
        "jerk",
        "unit of jerk",
    ]
