"""The notebooks of notebooks/*.py as pages: docs/notebooks/NAME.md is a stub, whose text is made of NAME.py here.

What cells show is that of notebooks_executed/NAME.ipynb, which `make notebooks` writes, where its cells are the same as
they are now; else the page says that it has the code alone. Figures go into the page: there is nothing to fetch.
"""

import re
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from sphinx.application import Sphinx

if TYPE_CHECKING:
    from nbformat import NotebookNode

SOURCES = Path(__file__).parents[2] / "notebooks"
FOLDER = "notebooks/"
BARE = "This build shows the code alone: `make docs` runs it, and shows what comes out."
MAGIC = re.compile(r"^%.*\n?", re.MULTILINE)
LINK = re.compile(r"\]\((\w+)\.py\)")


def page(name: str, executed: Path) -> str:
    """A notebook as MyST."""
    import jupytext

    notebook = jupytext.read(SOURCES / f"{name}.py")
    ran = outputs(notebook, executed / f"{name}.ipynb")
    title, *cells = [part for cell in notebook.cells for part in shown(cell, ran)]
    head, _, rest = title.partition("\n")
    download = f"[{name}.py](../../notebooks/{name}.py) is this notebook; Jupyter opens it with the extra `notebooks`."
    note = download.replace("[", "{download}`").replace("](", " <").replace(")", ">`")
    return "\n\n".join([head, note if ran else f"{note} {BARE}", rest, *cells]) + "\n"


def outputs(notebook: "NotebookNode", file: Path) -> "dict[str, list[NotebookNode]] | None":
    """What each cell showed, by its source; None if these very cells were not run."""
    import nbformat

    if not file.exists():
        return None
    ran = nbformat.read(file, as_version=4)
    if [cell.source for cell in ran.cells] != [cell.source for cell in notebook.cells]:
        return None
    return {cell.source: cell.outputs for cell in ran.cells if cell.cell_type == "code"}


def shown(cell: "NotebookNode", ran: "dict[str, list[NotebookNode]] | None") -> Iterator[str]:
    if cell.cell_type == "markdown":
        yield LINK.sub(r"](\1.md)", cell.source)
        return
    yield fence("python", MAGIC.sub("", cell.source))
    for printed, some in groupby(
        (ran or {}).get(cell.source, []), key=lambda output: output.output_type == "stream"
    ):
        if printed:
            yield fence("text", "".join(output.text for output in some))
        else:
            yield from map(drawn, some)


def drawn(output: "NotebookNode") -> str:
    """A figure, a table, or the text of a value."""
    data = output["data"]
    if "image/png" in data:
        picture = data["image/png"].replace("\n", "")
        return raw(f'<img alt="What the cell above draws" src="data:image/png;base64,{picture}">')
    if "text/html" in data:
        return raw(f'<div class="pst-scrollable-table-container">{data["text/html"]}</div>')
    return fence("text", data["text/plain"])


def fence(language: str, text: str) -> str:
    return f"````{language}\n{text.strip(chr(10))}\n````"


def raw(html: str) -> str:
    return fence("{raw} html", html)


def replaced(app: Sphinx, name: str, source: list[str]) -> None:
    stem = name.removeprefix(FOLDER)
    if stem == name or not (SOURCES / f"{stem}.py").exists():
        return
    executed = Path(app.confdir) / app.config.notebooks_executed
    for file in (SOURCES / f"{stem}.py", executed / f"{stem}.ipynb"):
        app.env.note_dependency(file)
    source[0] = page(stem, executed)


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_config_value("notebooks_executed", "../out/notebooks", "env", str)
    app.connect("source-read", replaced)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
