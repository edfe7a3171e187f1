"""Every public name stands on exactly one page of the API, and docstrings come out as they were
written.
"""

import inspect
import re
import sys
from collections import Counter
from pathlib import Path

import pytest

import pulsepath

DOCS = Path(__file__).parents[2] / "docs"
DOCUMENTED = re.compile(r"^\.\. auto\w+:: pulsepath\.(\w+)$", re.MULTILINE)
sys.path.append(str(DOCS / "_ext"))

from docstrings import _plain, as_rest  # noqa: E402


def test_every_public_name_is_on_exactly_one_page():
    pages = (page.read_text(encoding="utf-8") for page in (DOCS / "api").glob("*.md"))
    assert Counter(name for page in pages for name in DOCUMENTED.findall(page)) == Counter(
        pulsepath.__all__
    )


@pytest.mark.parametrize(
    ("text", "rest"),
    [
        ("q* and |x|, a_b and name_ of `J`.", r"q\* and \|x\|, a\_b and name\_ of ``J``."),
        ("What:\n\n    x = s * t_0\n\nand so on", "What:\n\n::\n\n   x = s * t_0\n\nand so on"),
        (
            "s    path length\nq_i  axes,\n     of each",
            "s\n    path length\nq\\_i\n    axes,\n    of each",
        ),
        ("s      path length\nlength of it", "s\n    path length\nlength\n    of it"),
        ("s    path length\n     of it\nRaises it.", "s\n    path length\n    of it\n\nRaises it."),
        ("It is so:\ns    path length", "It is so:\n\ns\n    path length"),
        ("a = b;  c = d", "a = b;  c = d"),
        ("- one\n  more\n- two", "- one\n  more\n- two"),
        ("odd\n  shape", "::\n\n   odd\n     shape"),
        ("`Section`s and pre`fix`.", r"``Section``\ s and pre\ ``fix``."),
        ('With `Card.x =\n"keep"` so.', 'With ``Card.x = "keep"`` so.'),
    ],
)
def test_docstrings_become_what_rest_shows_as_they_stand(text, rest):
    assert as_rest(text) == rest


UNIT = "~kinematics.foundation.units.Unit(unit=s, above=-inf, like=None, file_unit=)"


@pytest.mark.parametrize(
    ("spelled", "shown"),
    [
        (f"(at: ~typing.Annotated[float, {UNIT}] | None = None)", "(at: float | None = None)"),
        (f"(a: tuple[~typing.Annotated[float, {UNIT}], ...] = ())", "(a: tuple[float, ...] = ())"),
        (f"(a: Annotated[tuple[float, float], {UNIT}])", "(a: tuple[float, float])"),
        (
            "(f: Callable = <function told at 0x7f>, g: ~a.Host = <factory>)",
            "(f: Callable = ..., g: ~a.Host = ...)",
        ),
        (None, None),
    ],
)
def test_signatures_are_python_and_leave_out_how_units_are_checked(spelled, shown):
    assert _plain(spelled) == shown


TABLE = """One line.

Parameters
----------
a, b
    q* of it,
    in m.

Returns
-------
Thing
    What:

        x = s

Notes
-----
More."""


def test_sections_of_numpydoc_become_tables():
    shown = as_rest(TABLE)
    assert shown.startswith("One line.\n\n.. rubric:: Parameters\n\n.. list-table::\n")
    assert "   * - ``a, b``\n     - q\\* of it,\n       in m.\n" in shown
    assert "   * - ``Thing``\n     - What:\n\n       ::\n\n          x = s" in shown
    assert shown.endswith(".. rubric:: Notes\n\nMore.")


SECTION = re.compile(r"^Parameters\n-+\n(.*?)(?=^\w+\n-+$|\Z)", re.MULTILINE | re.DOTALL)


OURS = {"kinematics", "planner", "controllers", "benchmarks", "pulsepath"}


def described():
    """Public functions and methods of ours, and the parameters that the table of each has."""
    for value in (getattr(pulsepath, name) for name in pulsepath.__all__):
        functions = (
            [own for kind in value.__mro__ for own in vars(kind).values()]
            if inspect.isclass(value)
            else [value]
        )
        for function in filter(inspect.isfunction, functions):
            found = SECTION.search(inspect.getdoc(function) or "")
            if found and function.__module__.partition(".")[0] in OURS:
                names = re.findall(r"^\S.*$", found[1], re.MULTILINE)
                yield function, [each for line in names for each in line.split(", ")]


def test_tables_have_every_parameter_and_no_other():
    seen = {function.__qualname__: (function, names) for function, names in described()}
    assert len(seen) >= 25
    for function, names in seen.values():
        assert names == [
            name for name in inspect.signature(function).parameters if name != "self"
        ], function
