"""TOML files: the line of every key, and every fault in one pass."""

import json
import tomllib
from typing import Annotated, Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics.errors import FileError
from kinematics.files import MAX_BYTES, Direction, File, Number, Table, build, chosen, either, read
from kinematics.units import Length, Unit

TRICKY = '''\
# a comment with [brackets] and "quotes"
a.b = 1 # x = 2
"q\\"k.x" = """
not = a key ] }
[nor, a, table]
"""
array = [
  1, # one
  [2, 3],
  { x = "],}", y = [ 4,
    5 ] },
]

[t.u]
v = 'literal # no comment'
[[s]]
date = 1979-05-27 07:32:00
[[s]]
[[s.n]]
k = true
[[s.n]]
k = \'\'\'two
lines\'\'\'\'
  [s.m]
  z = { p.q = 1, r = {} }
empty = []
'''

LINES = {
    ("a",): 2,
    ("a", "b"): 2,
    ('q"k.x',): 3,
    ("array",): 7,
    ("array", 0): 8,
    ("array", 1): 9,
    ("array", 1, 1): 9,
    ("array", 2, "x"): 10,
    ("array", 2, "y", 0): 10,
    ("array", 2, "y", 1): 11,
    ("t",): 14,
    ("t", "u", "v"): 15,
    ("s",): 16,
    ("s", 0): 16,
    ("s", 0, "date"): 17,
    ("s", 1): 18,
    ("s", 1, "n", 0): 19,
    ("s", 1, "n", 0, "k"): 20,
    ("s", 1, "n", 1, "k"): 22,
    ("s", 1, "m"): 24,
    ("s", 1, "m", "z", "p", "q"): 25,
    ("s", 1, "m", "z", "r"): 25,
    ("s", 1, "m", "empty"): 26,
}


@pytest.fixture
def document(tmp_path):
    def made(text):
        path = tmp_path / "file.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read(path)

    return made


def faults_of(refusal):
    return [(fault.line, fault.key) for fault in refusal.value.faults]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_every_key_has_its_line(document, end):
    found = document(TRICKY.replace("\n", end))
    assert {key: found.lines[key] for key in LINES} == LINES


def test_a_key_that_is_not_there_has_the_line_of_what_is_around_it(document):
    found = document(TRICKY)
    assert found.line(("s", 1, "n", 1, "missing", 3)) == 21
    assert found.line(("missing",)) is None


KEYS = st.text("abzÀ \"'.]#=\\-_1", min_size=1, max_size=5)
TEXTS = st.text("ab]}[{,#\"'\\\n=\t é", max_size=8)
SCALARS = st.one_of(st.integers(-99, 99), st.booleans(), TEXTS)
VALUES = st.recursive(SCALARS, lambda v: st.lists(v, max_size=3) | st.dictionaries(KEYS, v, max_size=3), max_leaves=12)


class Writer:
    """An independent writer of TOML that counts the lines it writes."""

    def __init__(self, draw):
        self.draw, self.text, self.lines = draw, "", {}

    def gap(self):
        """Space, comments and new lines, wherever TOML allows them all."""
        self.text += self.draw(st.sampled_from(["", " ", "\n", " # ] } = \" '\n", "\n\n\t"]))

    def mark(self, key):
        self.lines[key] = self.text.count("\n") + 1

    def key(self, name):
        self.text += json.dumps(name)

    def value(self, value, key):
        if isinstance(value, dict):
            self.text += "{"
            for n, (name, entry) in enumerate(value.items()):
                self.text += ", " if n else " "
                self.mark((*key, name))
                self.key(name)
                self.text += " = "
                self.value(entry, (*key, name))
            self.text += "}"
        elif isinstance(value, list):
            self.text += "["
            for n, entry in enumerate(value):
                self.gap()
                self.mark((*key, n))
                self.value(entry, (*key, n))
                self.gap()
                self.text += ","
            self.gap()
            self.text += "]"
        elif isinstance(value, str) and self.draw(st.booleans()):
            escaped = value.replace("\\", "\\\\").replace('"', '\\"')
            self.text += f'"""\n{escaped}"""'
        else:
            self.text += json.dumps(value)

    def table(self, header, key, table):
        self.gap()
        self.text += "" if not self.text or self.text.endswith("\n") else "\n"
        if header:
            self.mark(key)
            self.text += f"{header}\n"
        for name, value in table.items():
            self.mark((*key, name))
            self.key(name)
            self.text += " = "
            self.value(value, (*key, name))
            self.text += "\n"


@settings(deadline=None)
@given(st.data(), st.lists(st.dictionaries(KEYS, VALUES, max_size=3), min_size=1, max_size=4))
def test_lines_agree_with_a_writer_that_counts_them(tmp_path_factory, data, tables):
    writer = Writer(data.draw)
    writer.table("", (), tables[0])
    for n, table in enumerate(tables[1:]):
        writer.table('[[ table . "of it" ]]', ("table", "of it", n), table)
    tomllib.loads(writer.text)
    path = tmp_path_factory.getbasetemp() / "written.toml"
    path.write_bytes(writer.text.encode())
    lines = read(path).lines
    assert {key: lines.get(key) for key in writer.lines} == writer.lines


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("a = 1\nb = \n", 2, "not TOML"),
        ("a = 1\na = 2\n", 2, "not TOML"),
        ("a = 1\n\nb = [1,\n", 4, "not TOML"),
        (b"a = 1\n\nb = '\xff'\n", 3, "not UTF-8"),
        ("a = " + "9" * 5000, None, "not TOML"),
        ("a = " + "[" * 3000 + "]" * 3000, None, "nested too deeply"),
        (b"#" * (MAX_BYTES + 1), None, "larger than 16 MB"),
    ],
)
def test_unreadable_text_is_a_fault_with_its_line(document, text, line, reason):
    with pytest.raises(FileError) as refusal:
        document(text)
    (fault,) = refusal.value.faults
    assert fault.line == line
    assert reason in fault.message


def test_unreadable_files_are_faults(tmp_path):
    for path in (tmp_path / "none.toml", tmp_path, tmp_path / "nul\0.toml"):
        with pytest.raises(FileError) as refusal:
            read(path)
        assert refusal.value.file == str(path)


def test_a_byte_order_mark_is_no_fault(document):
    assert document(b"\xef\xbb\xbfa = 1\n").data == {"a": 1}


class Box(Table):
    size: tuple[Length, Length]
    colour: Literal["red", "green"] = "red"


class Ball(Table):
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
    depth: Annotated[float | tuple[float, float], chosen(one_or_two)] = 0.0
    item: tuple[Annotated[Box | Ball, either(Box, Ball)], ...] = ()


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
"bad \\u001b[2J key" = 1

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
        (None, "height"),
        (1, "schema"),
        (2, "rom"),
        (3, "count"),
        (4, "up"),
        (5, "weight"),
        (6, "depth"),
        (7, '"bad \\x1b[2J key"'),
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
        "schema: 2 is not 1",
        'rom: unknown key, nearest is "room"; valid keys: schema, height, room',
        "count: true: ",
        "must not be zero",
        "weight: nan: ",
        'size[2]: 2: a number without a unit: write e.g. "20 mm"',
        '"rde" is not "red" or "green", nearest is "red"',
        "size and radius exclude each other: give size or radius",
        "two shapes",
        'unknown key "raduis", nearest is "radius"',
        'radius: "-3 mm" must be above 0 mm',
        "shape: unknown key; valid keys: radius, colour",
    ):
        assert phrase in text
    assert text.splitlines()[1].startswith(f"{refusal.value.file}:1: schema")


def test_shapes_are_checked_like_any_key(document):
    text = 'schema = 1\nheight = "1 mm"\nsize = 1\ncount = 1.5\nup = [0, 1]\nitem = [3, { size = 4 }]\ndepth = "2 s"\n'
    with pytest.raises(FileError) as refusal:
        build(document(text), Shelf)
    assert faults_of(refusal) == [
        (3, "size"),
        (4, "count"),
        (5, "up[3]"),
        (6, "item[1]"),
        (6, "item[2].size"),
        (7, "depth"),
    ]
    assert "3 is not a table" in str(refusal.value)
    assert "4 is not an array" in str(refusal.value)
