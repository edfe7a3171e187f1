"""The table of the package's extras, from pyproject.toml: what each brings, and by its comment there what it is for."""

import re
import tomllib
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

PROJECT = Path(__file__).parents[2] / "pyproject.toml"


class Extras(SphinxDirective):
    """One row for each extra."""

    def run(self) -> list[nodes.Node]:
        text = PROJECT.read_text(encoding="utf-8")
        rows = ["| extra | what it is for | what it brings |", "| --- | --- | --- |"]
        for name, wanted in tomllib.loads(text)["project"]["optional-dependencies"].items():
            comment = re.search(rf"^{name} = \[[^\n]*\] # (.*)$", text, re.MULTILINE)
            packages = ", ".join(re.split(r"[\[<>=;]", package)[0] for package in wanted)
            told = (
                comment[1] if comment else "working on pulsepath itself: all that the checks need"
            )
            rows.append(f"| `{name}` | {told} | {packages} |")
        return self.parse_text_to_nodes("\n".join(rows))


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("extras", Extras)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
