"""A result states its facts once: a record and a table have the same keys, values and units."""

from dataclasses import dataclass
from math import inf
from typing import Annotated

from kinematics.foundation.facts import Fact, record, tabulate
from kinematics.foundation.table import Column
from planner.place import Place


@dataclass(frozen=True)
class Gauge:
    where: Annotated[Place, Fact("where")]
    width: Annotated[float, Fact("width_m", "width", "m", "micro", ".1f")]
    note: Annotated[str, Fact("note", null="")] = ""
    parts: Annotated[tuple[Place, ...], Fact("parts")] = ()
    secret: float = 0.0


def test_a_record_has_the_facts_by_key_in_the_order_of_the_fields():
    place = Place(0.5, 2, 1.25, axis="X")
    shown = {"axis": "X", "segment": 2, "distance_m": 0.5, "time_s": 1.25}
    assert record(Gauge(place, 1e-6, parts=(place,))) == {
        "where": shown,
        "width_m": 1e-6,
        "note": None,
        "parts": [shown],
    }
    assert list(record(Gauge(place, inf))) == ["where", "width_m", "note", "parts"]
    assert record(Gauge(place, inf))["width_m"] is None
    assert record(None) is None
    assert record((1, "a")) == [1, "a"]


def test_a_place_states_its_repetition_only_if_there_are_several():
    assert "repetition" not in Place(0.0).record()
    assert Place(0.0, repetition=1).record()["repetition"] == 1


def test_a_table_has_a_row_for_each_result_in_the_units_that_people_read():
    gauges = [Gauge(Place(0.5, 2), 1.5e-6), Gauge(Place(1.0, 3), 2e-6)]
    (table,) = tabulate("gauges", gauges, Column("more", [1, 2]))
    assert [column.title for column in table.read] == ["segment", "s (mm)", "width (µm)", "more"]
    assert [*table.cells()] == [["2", "500.000", "1.5", "1"], ["3", "1000.000", "2.0", "2"]]
    assert tabulate("none", []) == ()
