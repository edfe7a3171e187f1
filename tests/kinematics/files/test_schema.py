"""Schemas of files: good ones become values, bad ones are told every fault in one pass."""

from typing import Annotated, Literal

import pytest

from kinematics import FileError
from kinematics.files.keys import Chosen
from kinematics.files.schema import Direction, File, Number, TableSchema, build, one_of_tables
from kinematics.foundation.units import Length, Unit


def faults_of(refusal):
    return [(fault.line, fault.key) for fault in refusal.value.faults]


class Box(TableSchema):
    size: tuple[Length, Length]
    colour: Literal["red", "green"] = "red"


class Ball(TableSchema):
    radius: Annotated[float, Unit("m", above=0)]
    colour: Literal["red", "green"] = "red"


def one_or_two(value):
    return tuple[Length, Length] if isinstance(value, tuple) else Length


class Shelf(File):
    height: Annotated[float, Unit("m", plain="length")]
    room: Annotated[float, Unit("m", above=0)] | None = None
    count: int = 1
    up: Direction = (0.0, 0.0, 1.0)
    weight: Number = 1.0
    depth: Annotated[float | tuple[float, float], Chosen(one_or_two)] = 0.0
    item: tuple[Annotated[Box | Ball, one_of_tables(Box, Ball)], ...] = ()


def test_a_good_file_is_a_value(document):
    text = """
schema = 1
height = 25
depth = ["1 mm", "2 mm"]
[[item]]
size = ["1 mm", "2 in"]
[[item]]
radius = "3 mm"
colour = "green"
"""
    shelf = build(document(text), Shelf, plain={"length": 0.001})
    assert (shelf.height, shelf.room, shelf.depth) == (0.025, None, (0.001, 0.002))
    assert shelf.item == (Box(size=("1 mm", "2 in")), Ball(radius="3 mm", colour="green"))
    with pytest.raises(ValueError, match="frozen"):
        shelf.height = 1.0


BAD = """\
schema = 2
rom = "3 mm"
count = true
up = [0, 0, 0]
weight = nan
depth = ["1 mm", "2 kg", "3 mm"]
"bad key" = 1

[[item]]
size = [
  "1 mm",
  2,
]
colour = "rde"

[[item]]
radius = "-3 mm"
size = ["1 mm", "2 mm"]

[[item]]
raduis = "3 mm"

[[item]]
radius = "-3 mm"
shape = { round = true }
"""


def test_every_fault_is_reported_in_one_pass(document):
    with pytest.raises(FileError) as refusal:
        build(document(BAD), Shelf, lambda data: [(("item", 1), "two shapes")])
    assert faults_of(refusal) == [
        (1, "schema"),
        (1, "height"),
        (2, "rom"),
        (3, "count"),
        (4, "up"),
        (5, "weight"),
        (6, "depth"),
        (7, '"bad key"'),
        (12, "item[1].size[2]"),
        (14, "item[1].colour"),
        (16, "item[2]"),
        (16, "item[2]"),
        (20, "item[3]"),
        (24, "item[4].radius"),
        (25, "item[4].shape"),
    ]
    text = str(refusal.value)
    assert all(line.isprintable() for line in text.splitlines())
    for phrase in (
        'height: missing: write e.g. "20 mm"',
        "schema: 2 is newer than this version of pulsepath",
        'rom: unknown key, nearest is "room"; valid keys: schema, height, room',
        "count: true is not ",
        "must not be zero",
        "weight: nan is not a finite number",
        'size[2]: 2: a number without a unit: write e.g. "20 mm"',
        '"rde" is not "red" or "green", nearest is "red"',
        "size and radius exclude each other: give size or radius",
        "two shapes",
        'unknown key "raduis", nearest is "radius"',
        'radius: "-3 mm" must be above 0 mm',
        "shape: unknown key; valid keys: radius, colour",
    ):
        assert phrase in text
    assert text.splitlines()[0].startswith(f"{refusal.value.file}:1: schema")


def test_shapes_are_checked_like_any_key(document):
    text = 'schema = 1\nheight = "1 mm"\nsize = 1\ncount = 1.5\nup = [0, 1]\nitem = [3, { size = 4 }]\ndepth = "2 s"\n'
    with pytest.raises(FileError) as refusal:
        build(document(text), Shelf)
    assert faults_of(refusal) == [
        (3, "size"),
        (4, "count"),
        (5, "up"),
        (6, "item[1]"),
        (6, "item[2].size"),
        (7, "depth"),
    ]
    assert "3 is not a table" in str(refusal.value)
    assert "4 is not an array" in str(refusal.value)
    assert "up: [0, 1] has 2 entries instead of 3" in str(
        refusal.value
    )  # once, not for each that it lacks
