"""Tables as they are printed: words and cells stay whole, and long lists are cut short with a word
of the rest.
"""

import json

import click
import numpy as np
import pytest

from kinematics.foundation.table import MAX_SHOWN_ROWS, Column, Table
from planner.place import Infeasible, Place
from pulsepath.output.tables import show, show_plan, sum_up_violations
from pulsepath.progress import VERBOSE, WIDTH


def test_words_are_not_broken_and_no_cell_is_cut(capsys):
    names, filler = ["shoulder, elbow, wrist"] * 2, ["x" * 22, "y" * 22]
    show(
        [
            Table(
                "t",
                (Column("axes", names), *(Column(f"c{k}", filler, whole=True) for k in range(4))),
            )
        ]
    )
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= WIDTH
    assert "shoulder," in printed
    assert "y" * 22 in printed
    show(
        [
            Table(
                "t",
                (Column("axes", names), *(Column(f"c{k}", filler, whole=True) for k in range(6))),
            )
        ]
    )  # too wide for all of it
    assert max(map(len, capsys.readouterr().out.splitlines())) <= WIDTH


@pytest.mark.parametrize(
    "width", ["30", "57", "90", "112", "113", "114", "115", "116", "117", "118", "300"]
)
def test_no_number_is_broken_and_no_column_lost_at_any_width(width, capsys, monkeypatch):
    """Twelve columns of numbers and a text: what does not fit continues below, with the first
    column.
    """
    monkeypatch.setenv("COLUMNS", width)
    numbers = [[f"{1000 * k + row + 0.25:.3f}" for row in range(3)] for k in range(10, 21)]
    columns = [
        Column("pose", [1, 2, 3]),
        *(Column(f"arm{k}", own, whole=True) for k, own in enumerate(numbers)),
    ]
    columns += [Column(f"q{k}", [1e5 + k + 0.123456] * 3, form=".6f") for k in range(2)]
    show([Table("lengths", (*columns, Column("beyond", ["leg1", "", "leg2"])))])
    printed = capsys.readouterr().out
    lines = printed.splitlines()
    assert max(map(len, lines)) <= int(width)
    words = set(printed.split())
    assert {
        *(one for own in numbers for one in own),
        "100000.123456",
        "100001.123456",
        "leg1",
        "leg2",
    } <= words
    assert {"beyond", *(f"arm{k}" for k in range(11))} <= words
    if width == "300":
        assert sum("pose" in line for line in lines) == 1
        assert len(lines) == 1 + 1 + 2 + 3 + 1
    else:
        assert sum("pose" in line for line in lines) > 1


def test_no_column_is_lost_where_titles_wrap(capsys):
    """Titles of two words need 119 characters in one line, and 106 with line breaks: all columns
    are there in 112.
    """
    wide = [
        ("arm1", "793.983"),
        ("arm2", "1002.264"),
        ("arm3", "1002.264"),
        ("plate", "turned"),
        ("off", "0.370"),
    ]
    narrow = [("pose", "1"), ("x (mm)", "900"), ("y (mm)", "0"), ("z (mm)", "25.1235")]
    narrow += [(f"θ{axis} (°)", "0") for axis in "xyz"]
    columns = [
        Column(title, [float(cell)], form=f".{len(cell.partition('.')[2])}f")
        for title, cell in narrow
    ]
    columns += [
        Column(f"{title} (mm)" if title != "plate" else title, [cell]) for title, cell in wide
    ]
    show([Table("arms", (*columns, Column("beyond", ["1 2 3"])))])
    printed = capsys.readouterr().out
    assert {"beyond", "25.1235", *(cell for _, cell in wide)} <= set(printed.split())
    assert "1 2 3" in printed
    assert max(map(len, printed.splitlines())) <= WIDTH


def test_without_columns_lines_are_as_long_as_stated(capsys, monkeypatch):
    for text in ("", "0", "wide", "-3"):
        monkeypatch.setenv("COLUMNS", text)
        show([Table("t", (Column("a", ["word " * 100]),))])
        assert WIDTH - 6 < max(map(len, capsys.readouterr().out.splitlines())) <= WIDTH


def test_a_long_list_says_how_much_more_there_is_and_where(tmp_path, capsys):
    """And the path of the rest is whole, even if it is longer than a line."""
    folder = tmp_path / ("long" * 30)
    folder.mkdir()
    (folder / "plan.json").write_text(json.dumps({"pulses": {"axes": {}}}))
    rows = Column("segment", np.arange(300)), Column("length", np.arange(300.0), ["m", "rad"] * 150)
    with click.Context(click.Command("plan")) as context:
        context.meta["pulsepath.progress"] = VERBOSE
        show_plan(
            folder,
            False,
            lambda: [Table("segments", rows), Table("few", (Column("a", [1, 2]),))],
            list,
        )
    printed = capsys.readouterr().out
    assert f"{MAX_SHOWN_ROWS} of 300 rows: all are in {folder / 'plan.json'}" in " ".join(
        printed.split()
    )
    half = MAX_SHOWN_ROWS // 2
    assert all(
        f"\n     {row} " in printed or f" {row}   " in printed for row in (half - 1, 300 - half)
    )
    assert not any(f" {row}   " in printed for row in (half + 1, 150))


def test_the_summary_of_violations_names_a_few_of_many_axes():
    """One line for a limit: the number of violations, some of the axes, and the first segment."""
    violations = [
        Infeasible(
            "clearance", f"leg{n}–base", Place(0.1, segment), -1.0, 0.0, "mm", "move the path"
        )
        for segment in (3, 2)
        for n in range(10)
    ]
    worst, line = sum_up_violations(violations)
    assert worst is violations[0]
    named = ", ".join(f"leg{n}–base" for n in range(8))
    assert (
        line
        == f"clearance: 20 violations, at {named}, 2 more, in 2 segments, first in segment 2; -v lists them"
    )
    assert sum_up_violations(violations[:1]) == violations[:1]
    # along a path without a program no segment is known
    bare = [Infeasible("travel", "x", Place(0.1), 2.0, 1.0, "", "") for _ in range(2)]
    assert sum_up_violations(bare)[1] == "travel: 2 violations, at x; -v lists them"
