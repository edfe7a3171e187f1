"""Bytes into lines: however they are cut, whatever they are."""

from hypothesis import given
from hypothesis import strategies as st

from controllers.console import Partial, TextLine
from controllers.console.links import MAX_LINE_BYTES


def read(*chunks):
    partial, found = Partial(), []
    for chunk in chunks:
        partial, lines = partial.feed(chunk)
        found += lines
    return partial, found


def test_both_ends_of_lines_and_several_in_a_packet():
    assert read(b"P X + 1\rP X + 2\nP X + 3\r\n\r\n  \r")[1] == [
        TextLine(f"P X + {n}") for n in (1, 2, 3)
    ]
    # a packet that ends between CR and LF, and one within a word
    assert read(b"P X +", b" 1\r", b"\nP", b" X + 2\r")[1] == [
        TextLine("P X + 1"),
        TextLine("P X + 2"),
    ]


def test_a_line_without_its_end_is_none():
    partial, found = read(b"P X + 1")
    assert found == []
    assert partial.broken_off()[0].fault == "the input ended within a line"


def test_a_long_line_is_one_fault_and_the_next_is_read():
    _, found = read(*[b"P X + 1 " * 1000] * 3, b"\rP X + 2\r")
    assert [line.text for line in found] == ["", "P X + 2"]
    assert found[0].fault == f"a line is longer than {MAX_LINE_BYTES} characters"
    assert read(b"x" * MAX_LINE_BYTES + b"\r")[1][0].fault == ""
    assert read(b"x" * (MAX_LINE_BYTES + 1) + b"\r")[1][0].fault != ""


def test_a_noise_byte_spoils_its_line():
    assert read(b"P X + \xff1\r")[1] == [
        TextLine("", "byte 0xFF at 7 of a line is not a character of a command")
    ]
    assert read(b"P X\x00+ 1\rWHERE\r")[1][1] == TextLine("WHERE")


def test_the_key_theta_passes_whole_and_no_other_byte_does():
    whole = "POS θ CW 5 Θ\n".encode()
    for cut in range(len(whole)):
        assert read(whole[:cut], whole[cut:])[1] == [TextLine("POS θ CW 5 Θ")]
    assert read(b"POS \xce CW 5\r")[1] == [
        TextLine("", "byte 0xCE at 5 of a line is not a character of a command")
    ]
    assert read("POS θ CW 5 ä\r".encode())[1][0].fault.startswith("byte 0xC3 at 13")


@given(st.lists(st.binary(max_size=200)), st.data())
def test_lines_do_not_depend_on_how_bytes_are_cut_and_memory_is_bounded(chunks, data):
    whole = b"".join(chunks)
    partial, found = read(*chunks)
    assert read(whole) == (partial, found)
    assert len(partial.held) <= MAX_LINE_BYTES + 1
    for line in found:
        assert bool(line.text) != bool(line.fault)
        assert len(line.text) <= MAX_LINE_BYTES
        assert line.text.encode() in whole
