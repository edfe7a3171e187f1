"""TOML documents: the line of every key, and text that is none."""

import json
import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import FileError
from kinematics.files.toml_document import MAX_BYTES, read

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


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_every_key_has_its_line(document, end):
    found = document(TRICKY.replace("\n", end))
    assert {key: found.lines[key] for key in LINES} == LINES


@pytest.mark.parametrize("place", ["middle", "end", "everywhere"])
@pytest.mark.parametrize("end", ["\r\r\n", "\r\r\r\n"])
def test_a_line_end_that_a_transfer_doubled_is_one(tmp_path, place, end):
    """tomllib takes CR CR LF, as it replaces CR LF again in text whose line ends are replaced
    already.
    """
    lines = ["a = 1", "[b]", "c = [1, [2, 3]]", "d = { e = 'x', f = 2 }", ""]
    ends = {"middle": "\n", "end": "\n", "everywhere": end}
    text = ends[place].join(lines)
    text = (
        text.replace("[b]\n", f"[b]{end}")
        if place == "middle"
        else text.rstrip("\n") + end
        if place == "end"
        else text
    )
    path = tmp_path / "doubled.toml"
    path.write_bytes(text.encode())
    found = read(path)
    assert found.data == {"a": 1, "b": {"c": (1, (2, 3)), "d": {"e": "x", "f": 2}}}
    assert [found.line(key) for key in (("a",), ("b", "c", 1, 0), ("b", "d", "f"))] == [1, 3, 4]


def test_a_key_that_is_not_there_has_the_line_of_what_is_around_it(document):
    found = document(TRICKY)
    assert found.line(("s", 1, "n", 1, "missing", 3)) == 21
    assert found.line(("missing",)) == 1


KEYS = st.text("abzÀ \"'.]#=\\-_1", min_size=1, max_size=5)
TEXTS = st.text("ab]}[{,#\"'\\\n=\t é", max_size=8)
SCALARS = st.one_of(st.integers(-99, 99), st.booleans(), TEXTS)
VALUES = st.recursive(
    SCALARS, lambda v: st.lists(v, max_size=3) | st.dictionaries(KEYS, v, max_size=3), max_leaves=12
)


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
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + bytes(range(1, 256)), 1, "a binary file"),
        ("a = " + "9" * 5000, 1, "not TOML"),
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


@pytest.mark.parametrize("end", ["\r\n", "\r\r\n", "\r\r\r\n"])
def test_line_ends_that_were_converted_twice_are_line_ends(document, end):
    """A program that turns LF into CR LF makes CR CR LF of CR LF."""
    text = document(end.join(["a = 1", "", "[b]", "c = [1,", "2]", "d = 3", ""]))
    assert text.data == {"a": 1, "b": {"c": (1, 2), "d": 3}}
    assert [text.line(key) for key in (("a",), ("b",), ("b", "c"), ("b", "c", 1), ("b", "d"))] == [
        1,
        3,
        4,
        5,
        6,
    ]
    with pytest.raises(FileError) as refusal:
        document(end.join(["a = 1", "b = ", ""]))
    assert refusal.value.faults[0].line == 2


def test_unreadable_files_are_faults(tmp_path):
    for path in (tmp_path / "none.toml", tmp_path, tmp_path / "nul\0.toml"):
        with pytest.raises(FileError) as refusal:
            read(path)
        assert refusal.value.file == str(path)


def test_a_byte_order_mark_is_no_fault(document):
    assert document(b"\xef\xbb\xbfa = 1\n").data == {"a": 1}
