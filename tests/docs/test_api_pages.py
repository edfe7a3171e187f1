"""Every public name stands on exactly one page of the API, and docstrings come out as they were written."""

import re
import sys
from collections import Counter
from pathlib import Path

import pytest

import pulsepath

DOCS = Path(__file__).parents[2] / "docs"
DOCUMENTED = re.compile(r"^\.\. auto\w+:: pulsepath\.(\w+)$", re.MULTILINE)
sys.path.append(str(DOCS / "_ext"))

from docstrings import as_rest  # noqa: E402


def test_every_public_name_is_on_exactly_one_page():
    pages = (page.read_text(encoding="utf-8") for page in (DOCS / "api").glob("*.md"))
    assert Counter(name for page in pages for name in DOCUMENTED.findall(page)) == Counter(pulsepath.__all__)


@pytest.mark.parametrize(
    ("text", "rest"),
    [
        ("q* and |x|, a_b and name_ of `J`.", r"q\* and \|x\|, a\_b and name\_ of ``J``."),
        ("What:\n\n    x = s * t_0\n\nand so on", "What:\n\n::\n\n   x = s * t_0\n\nand so on"),
        ("s    path length\nq_i  axes,\n     of each", "s\n    path length\nq\\_i\n    axes,\n    of each"),
        ("s      path length\nlength of it", "s\n    path length\nlength\n    of it"),
        ("s    path length\n     of it\nRaises it.", "s\n    path length\n    of it\n\nRaises it."),
        ("It is so:\ns    path length", "It is so:\n\ns\n    path length"),
        ("a = b;  c = d", "a = b;  c = d"),
        ("- one\n  more\n- two", "- one\n  more\n- two"),
        ("odd\n  shape", "::\n\n   odd\n     shape"),
    ],
)
def test_docstrings_become_what_rest_shows_as_they_stand(text, rest):
    assert as_rest(text) == rest
