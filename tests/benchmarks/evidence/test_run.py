"""The runner of the evidence: it lists cases, reads options off a signature, and writes all or
nothing.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Literal

import pytest

from benchmarks.evidence import run
from benchmarks.evidence.table import Table
from kinematics.foundation.errors import MotionError

CASE_FILES = sorted(Path(run.__file__).parent.glob("cases/*.py"))


@pytest.fixture
def start(monkeypatch, capsys):
    """Run the command line with some words; return its exit code and its output."""

    def start(*words):
        monkeypatch.setattr(sys, "argv", ["evidence", *map(str, words)])
        code = 0
        try:
            run.main()
        except SystemExit as end:
            # a text is printed by the interpreter, which then exits with 1
            code = end.code if isinstance(end.code, int) else 1
            if isinstance(end.code, str):
                print(end.code, file=sys.stderr)
        output = capsys.readouterr()
        return code, output.out, output.err

    return start


@pytest.fixture
def use_measure(monkeypatch):
    """Put a function into the place of the measurement of every case."""

    def use(measure):
        case = SimpleNamespace(measure=measure, __doc__="A case of this test.")
        monkeypatch.setattr(run, "find_case", lambda name: case)

    return use


def test_each_case_is_a_file_with_a_measurement_and_each_file_is_a_case():
    names = {file.stem for file in CASE_FILES} - {"__init__"}
    assert names == set(run.CASES)
    for name in names:
        case = run.find_case(name)
        assert callable(case.measure), name
        assert case.__doc__, name
        # every option has a type that the command line can read
        run.build_parser(name, case)


@pytest.mark.parametrize("words", [(), ("--help",)])
def test_without_a_name_all_cases_are_listed(start, words):
    code, out, _ = start(*words)
    assert code == 0
    for name, line in run.CASES.items():
        assert f"  {name} " in out
        assert line in out


def test_an_unknown_name_is_refused_with_the_list(start):
    code, out, err = start("no-such-case")
    assert code == 2
    assert out == ""
    assert "'no-such-case'" in err
    assert all(name in err for name in run.CASES)


def test_options_are_the_parameters_of_the_measurement(start, use_measure):
    calls = []

    def measure(
        file: Path,
        count: int = 3,
        share: float | None = None,
        order: Literal[2, 3] = 3,
        long_name: bool = False,
    ) -> Iterator[Table | str]:
        calls.append((file, count, share, order, long_name))
        yield "done"

    use_measure(measure)
    assert start("circle", "--file", "a.txt")[:2] == (0, "done\n")
    words = ("--file", "a.txt", "--count", 5, "--share", 0.5, "--order", 2, "--long-name")
    assert start("circle", *words)[0] == 0
    assert calls == [(Path("a.txt"), 3, None, 3, False), (Path("a.txt"), 5, 0.5, 2, True)]
    for wrong in ((), ("--file", "a", "--count", "x"), ("--file", "a", "--order", 4)):
        assert start("circle", *wrong)[0] == 2
    assert len(calls) == 2


def measure_rows(fail: bool) -> Iterator[Table | str]:
    """Yield two blocks; the second one may fail after its first row."""

    def rows():
        yield ("a|b", 1.23456789, None)
        if fail:
            raise MotionError("the second row has no value")

    yield "first"
    yield Table("title", ("name", "value (s)", "note"), rows(), "text")


TEXT = """\
first

## title

text

| name | value (s) | note |
| --- | --- | --- |
| a\\|b | 1.23457 |  |
"""


def test_the_text_is_printed_or_written_to_a_file(start, use_measure, tmp_path):
    use_measure(lambda: measure_rows(fail=False))
    assert start("circle") == (0, TEXT, "")
    file = tmp_path / "new" / "page.md"
    assert start("circle", "--out", file) == (0, "", "")
    assert file.read_text(encoding="utf-8") == TEXT


def test_a_measurement_that_fails_leaves_the_file_as_it_was(start, use_measure, tmp_path):
    use_measure(lambda: measure_rows(fail=True))
    file = tmp_path / "page.md"
    file.write_text("before")
    code, out, err = start("circle", "--out", file)
    assert (code, out) == (1, "")
    assert err == "circle: the second row has no value\n"
    assert file.read_text() == "before"


def test_a_file_that_cannot_be_written_is_named(start, use_measure, tmp_path):
    use_measure(lambda: measure_rows(fail=False))
    code, _, err = start("circle", "--out", tmp_path)
    assert code == 1
    assert str(tmp_path) in err


def test_a_file_that_cannot_be_written_is_refused_before_the_measurement(
    start, use_measure, tmp_path
):
    (tmp_path / "file").write_text("")
    rows = []

    def measure() -> Iterator[Table | str]:
        rows.append("measured")
        yield "text"

    use_measure(measure)
    assert start("circle", "--out", tmp_path / "file" / "page.md")[0] == 1
    assert rows == []


def test_an_interrupt_leaves_no_traceback(start, use_measure, tmp_path):
    def measure() -> Iterator[Table | str]:
        yield "first"
        raise KeyboardInterrupt

    use_measure(measure)
    assert start("circle") == (130, "first\n", "")
    assert start("circle", "--out", tmp_path / "page.md") == (130, "", "")
    assert list(tmp_path.iterdir()) == []
