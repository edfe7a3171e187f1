"""Tables as they are printed: words and cells stay whole, and long lists are cut short with a word of the rest."""

import json

import click
import numpy as np

from kinematics.foundation.table import MAX_SHOWN_ROWS, Column, Table
from pulsepath.output.tables import show, show_plan
from pulsepath.progress import VERBOSE, WIDTH


def test_words_are_not_broken_and_no_cell_is_cut(capsys):
    names, filler = ["shoulder, elbow, wrist"] * 2, ["x" * 22, "y" * 22]
    show([Table("t", (Column("axes", names), *(Column(f"c{k}", filler, whole=True) for k in range(4))))])
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= WIDTH
    assert "shoulder," in printed
    assert "y" * 22 in printed
    show(
        [Table("t", (Column("axes", names), *(Column(f"c{k}", filler, whole=True) for k in range(6))))]
    )  # too wide for all of it
    assert max(map(len, capsys.readouterr().out.splitlines())) <= WIDTH


def test_a_long_list_says_how_much_more_there_is_and_where(tmp_path, capsys):
    (tmp_path / "plan.json").write_text(json.dumps({"pulses": {"axes": {}}}))
    rows = Column("segment", np.arange(300)), Column("length", np.arange(300.0), ["m", "rad"] * 150)
    with click.Context(click.Command("plan")) as context:
        context.meta["pulsepath.progress"] = VERBOSE
        show_plan(tmp_path, False, lambda: [Table("segments", rows), Table("few", (Column("a", [1, 2]),))], list)
    printed = capsys.readouterr().out
    assert f"{MAX_SHOWN_ROWS} of 300 rows: all are in {tmp_path / 'plan.json'}" in " ".join(printed.split())
    half = MAX_SHOWN_ROWS // 2
    assert all(f"\n     {row} " in printed or f" {row}   " in printed for row in (half - 1, 300 - half))
    assert not any(f" {row}   " in printed for row in (half + 1, 150))
