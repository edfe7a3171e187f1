"""Keys into lines."""

import pytest

from pulsepath.terminal import Editor

WORDS = ("JOG", "POS", "MOVE", "MAN", "EXIT", "CW", "CCW", "X", "Y")


def typed(keys, editor=None):
    editor = Editor(WORDS, leave="EXIT") if editor is None else editor
    return [line for line in map(editor.press, keys) if line is not None], editor


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        (b"WHERE\r", "WHERE"),
        (b"WHERX\x7fE\n", "WHERE"),
        (b"\x7f\x08WHERE\n", "WHERE"),
        (b"junk\x15WHERE\n", "WHERE"),
        (b"jo\tx cw\n", "JOG x cw"),
        (b"m\t\n", "M"),  # MOVE or MAN: what they share
        (b"pos x c\t1\n", "pos x C1"),
        (b"q\t\n", "q"),
        (b"A\xc3\xa4\x00B\n", "AB"),
        (b"A\x1b[DB\x1b[3~C\x1bOPD\n", "ABCD"),  # keys that mean nothing here
        ("jog θ cw\n".encode(), "jog θ cw"),
        (b"jog \xceA\xb8 \xce\xceB\n", "jog A B"),  # halves of the key, which are none
        (b"\x04", "EXIT"),
    ],
)
def test_keys_make_a_line(keys, line):
    assert typed(keys)[0] == [line]


def test_the_history_is_walked_and_what_was_being_typed_kept():
    up, down = b"\x1b[A", b"\x1b[B"
    assert typed(b"ONE\nTWO\nTWO\n" + up + b"\n")[0][-1] == "TWO"
    assert typed(b"ONE\nTWO\nTWO\n" + up * 2 + b"\n")[0][-1] == "ONE"
    assert typed(b"ONE\nTWO\nhal" + up * 5 + down * 7 + b"f\n")[0][-1] == "half"
    assert typed(b"ONE\n\n" + b"\x1bOA" + b"\n")[0] == ["ONE", "", "ONE"]


def test_a_half_typed_line_is_not_left_and_its_memory_is_bounded():
    found, editor = typed(b"WH\x04")
    assert (found, editor.text) == ([], "WH")
    assert len(typed(b"x" * 10_000)[1].text) < 130
