"""The pages of docs/ build into a site without a warning, and the site needs no network."""

import re
import subprocess
import sys
from html import unescape
from pathlib import Path

import pytest

from kinematics.machine.axis import DRIVES

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, built with every warning an error."""
    folder = tmp_path_factory.mktemp("docs")
    options = ["-W", "--keep-going", "-q", "-d", folder / "trees"]
    command = [sys.executable, "-m", "sphinx", *options, "docs", folder / "site"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return folder / "site"


def test_the_site_fetches_nothing(site):
    """Scripts, styles, fonts and pictures are all its own: only what a reader clicks on leads
    away.
    """
    pages = list(site.rglob("*.html"))
    assert len(pages) > 20
    for page in pages:
        tags = re.findall(
            r"<(?:script|link|img|iframe|source|object)\b[^>]*>", page.read_text(encoding="utf-8")
        )
        assert [
            tag for tag in tags if re.search(r"""(?:src|href|data)=["']?(?:https?:)?//""", tag)
        ] == [], page
    for style in (site / "_static").rglob("*.css"):
        assert not re.search(
            r"(?:url\(|@import )\s*[\"']?(?:https?:)?//", style.read_text(encoding="utf-8")
        ), style


def test_what_docstrings_set_in_columns_is_set_as_such(site):
    """A name with two spaces behind it, in a paragraph, is a list of meanings that was run
    together.
    """
    for page in (site / "api").glob("*.html"):
        article = (
            page.read_text(encoding="utf-8").partition("<article")[2].partition("</article>")[0]
        )
        for paragraph in re.findall(r"<p>(.*?)</p>", article, re.DOTALL):
            text = re.sub(r"<[^>]+>", "", paragraph)
            assert not re.search(r"^\w[\w, ]* {2,}\w", text, re.MULTILINE), (page.name, text)


def test_signatures_and_names_are_set_as_python_and_code(site):
    """What is no Python is shown as it is spelled: with ~, every module's name, and what units are
    checked by.
    """
    for page in (site / "api").glob("*.html"):
        article = (
            page.read_text(encoding="utf-8").partition("<article")[2].partition("</article>")[0]
        )
        for shown in re.findall(r"<dt [^>]*>(.*?)</dt>", article, re.DOTALL):
            text = unescape(re.sub(r"<[^>]+>", "", shown))
            assert not re.search(r"~\w|Annotated|Unit\(|object at|<factory>", text), (
                page.name,
                text,
            )
        prose = unescape(re.sub(r"<pre.*?</pre>|<[^>]+>", "", article, flags=re.DOTALL))
        assert "`" not in prose, (page.name, prose[max(0, prose.find("`") - 60) :][:120])


def test_a_plan_is_shown_with_all_that_it_can_be_asked_for(site):
    page = (site / "api" / "planning.html").read_text(encoding="utf-8")
    for name in ("pulses", "hold", "resume", "stops", "export"):
        assert f'id="pulsepath.Plan.{name}"' in page
    for name in ("q", "qd", "pose_rate", "tool_rate", "evaluate"):
        assert f'id="planner.limits.limit.LimitState.{name}"' in page


def test_the_known_drives_are_listed_with_their_times(site):
    page = (site / "reference" / "files.html").read_text(encoding="utf-8")
    for name, drive in DRIVES.items():
        row = next(row for row in page.split("<tr") if f'<span class="pre">{name}</span>' in row)
        cells = [
            re.sub(r"<[^>]+>", "", cell) for cell in re.findall(r"<td.*?</td>", row, re.DOTALL)
        ]
        assert [float(cell.split()[0]) * 1e-6 for cell in cells[1:5]] == pytest.approx(
            [drive.high, drive.low, drive.setup, drive.hold]
        )


def test_options_and_examples_can_be_copied(site):
    page = (site / "reference" / "commands.html").read_text(encoding="utf-8")
    article = unescape(page.partition("<article")[2].partition("</article>")[0])
    assert "pulsepath pose hexapod 5,5,35 --turn 3,-4,2" in re.sub(r"<[^>]+>", "", article)
    assert not re.findall("[\u2013\u2014\u2018\u2019\u201c\u201d]", article)


def test_every_command_and_every_key_is_there(site):
    from kinematics.kinds.axis_keys import LinearDefaults
    from planner.program.program_file import ProgramFile
    from pulsepath.cli import main

    commands = (site / "reference" / "commands.html").read_text(encoding="utf-8")
    for name in main.commands:
        assert f">pulsepath {name}<" in commands
    files = (site / "reference" / "files.html").read_text(encoding="utf-8")
    for table in (LinearDefaults, ProgramFile):
        for name, field in table.model_fields.items():
            assert f'<span class="pre">{field.alias or name}</span>' in files


def test_notebooks_are_pages_that_show_what_very_these_cells_showed(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "_ext"))
    import jupytext
    import nbformat
    from nbformat.v4 import new_output
    from notebook_pages import BARE, page

    ran = jupytext.read(ROOT / "notebooks" / "1_first_plan.py")
    cells = [cell for cell in ran.cells if cell.cell_type == "code"]
    cells[0].outputs = [
        new_output("stream", text="one\n"),
        new_output("stream", text="two\n"),
        new_output("display_data", {"image/png": "QUJD", "text/plain": "<Figure>"}),
        new_output("execute_result", {"text/html": "<table></table>", "text/plain": "a table"}),
        new_output("execute_result", {"text/plain": "<a value>"}),
    ]
    nbformat.write(ran, tmp_path / "1_first_plan.ipynb")
    text = page("1_first_plan", tmp_path)
    assert text.startswith("# A first plan\n")
    assert BARE not in text
    assert "```text\none\ntwo\n```" in text
    assert "data:image/png;base64,QUJD" in text
    assert "<table></table>" in text
    assert "<a value>" in text
    assert "<Figure>" not in text
    assert "](4_what_limits_the_speed.md)" in text  # the page, not the file
    cells[1].source += "\nprint(1)"  # other cells were run
    nbformat.write(ran, tmp_path / "1_first_plan.ipynb")
    assert BARE in page("1_first_plan", tmp_path)
    assert "QUJD" not in page("1_first_plan", tmp_path)
    assert BARE in page("1_first_plan", tmp_path / "nowhere")


def test_every_notebook_has_its_page(site):
    for notebook in (ROOT / "notebooks").glob("*.py"):
        page = (site / "notebooks" / f"{notebook.stem}.html").read_text(encoding="utf-8")
        assert ">The answer<" in page
        assert (ROOT / "docs" / "notebooks" / "index.md").read_text("utf-8").count(
            f"({notebook.stem}.md)"
        ) == 1


def test_formulas_are_drawn_into_the_page(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "_ext"))
    from drawn_math import drawn

    wide, narrow = drawn(r"\frac{a}{b} \le \lVert \dot q \rVert"), drawn("a")
    assert wide.startswith("<svg")
    assert wide.count("<path") == 1
    width = [float(re.search(r"width:([\d.]+)em", svg)[1]) for svg in (wide, narrow)]
    assert width[0] > 3 * width[1] > 0
    assert 'aria-label="a &lt; b"' in drawn("a < b")
    with pytest.raises(ValueError, match="nonsense"):
        drawn(r"\nonsense{a}")


def test_a_key_takes_what_its_annotation_says(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "_ext"))
    from file_keys import default, takes

    from kinematics.kinds.axis_keys import LinearDefaults
    from kinematics.kinds.load_keys import LoadedFile
    from planner.program.segment_tables import PathEntry

    def of(table, key):
        field = table.model_fields[key]
        return takes(field.annotation, tuple(field.metadata))

    assert of(LinearDefaults, "timing") == "table, or text"
    assert of(LinearDefaults, "pulse") == 'quantity, as `"0.75 um"`; above 0'
    # one number, or one for each way
    assert of(LinearDefaults, "max_speed") == (
        'quantity, as `"20 mm/s"`; above 0, or 2 × quantity, as `"20 mm/s"`; above 0'
    )
    assert of(PathEntry, "join") == '`"stop"` or `"through"` or table'
    assert of(LoadedFile, "gravity") == '3 × quantity, as `"20 mm/s^2"`'
    assert default(LoadedFile.model_fields["gravity"]) == "0, 0, -9806.65 mm/s^2"
    assert default(LinearDefaults.model_fields["travel"]) == "**needed**"
