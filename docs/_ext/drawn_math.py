"""Formulas drawn by matplotlib's mathtext into the page itself: no script, no font and no picture to fetch.

It takes most of TeX's symbols, fractions, roots and accents. Rows of an aligned or gathered environment are drawn one
below the other; cases and matrices it cannot draw, and says so as a warning.
"""

import re
from functools import cache
from html import escape
from typing import Any

from docutils import nodes
from matplotlib import rc_context
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath, text_to_path
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.math import get_node_equation_number

EM = 100.0  # drawn units to an em of the text around
LETTERS = {1: "M", 2: "L", 3: "Q", 4: "C", 79: "Z"}
ROWS = re.compile(r"\\(?:begin|end)\{(?:aligned|gathered|split)\}|(?<!\\)&")
# What TeX knows and mathtext does not, in its words; "" is left out.
WORDS = dict.fromkeys(["limits", "nolimits", "bigl", "bigr", "Bigl", "Bigr", "big", "Big"], "") | {
    "le": r"\leq",
    "ge": r"\geq",
    "lVert": r"\Vert",
    "rVert": r"\Vert",
    "lvert": r"\vert",
    "rvert": r"\vert",
    "tfrac": r"\frac",
    "bm": r"\boldsymbol",
    "implies": r"\Rightarrow",
    "iff": r"\Leftrightarrow",
    "land": r"\wedge",
}
WORD = re.compile(r"\\([A-Za-z]+)")


@cache
def drawn(tex: str, size: float = 1.0) -> str:
    """One formula as an svg element, its base line on that of the text; ValueError where mathtext cannot read it."""
    primed = (
        " ".join(tex.split()).replace("'''", "‴").replace("''", "″").replace("'", "′")
    )  # mathtext's are tiny
    source = "$" + WORD.sub(lambda word: WORDS.get(word[1], word[0]), primed) + "$"
    with rc_context({"mathtext.fontset": "stix"}):
        font = FontProperties(size=EM)
        # the parser that draws the path as well, which keeps what it has parsed last
        parser = text_to_path.mathtext_parser
        width, height, depth, _, _ = parser.parse(source, text_to_path.DPI, font)
        path = TextPath((0, 0), source, prop=font)
    marks = []
    for points, code in path.iter_segments(curves=True, simplify=False):
        pairs = [] if code == 79 else [f"{x:.0f} {-y:.0f}" for x, y in points.reshape(-1, 2)]
        marks.append(LETTERS[int(code)] + " ".join(pairs))
    top = height - depth if height > depth else height
    box = f"0 {-top:.0f} {width:.0f} {top + depth:.0f}"
    wide, high, low = (size * length / EM for length in (width, top + depth, depth))
    style = f"width:{wide:.3f}em;height:{high:.3f}em;vertical-align:{-low:.3f}em"
    told = f'role="img" aria-label="{escape(tex.strip())}"'
    return f'<svg class="math" {told} viewBox="{box}" style="{style}"><path d="{"".join(marks)}"/></svg>'


def shown(writer: Any, node: nodes.Element, tex: str, size: float) -> str:
    try:
        return drawn(tex, size)
    except ValueError as error:
        logging.getLogger(__name__).warning("cannot draw %r: %s", tex, error, location=node)
        return f"<code>{escape(tex)}</code>"


def inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(shown(writer, node, node.astext(), 1.05))
    raise nodes.SkipNode


def block(writer: Any, node: nodes.math_block) -> None:
    tex = ROWS.sub("", node.astext()).replace(
        r"\frac", r"\dfrac"
    )  # as TeX has fractions on lines of their own
    rows = [row for row in re.split(r"\\\\", tex) if row.strip()]
    writer.body.append(writer.starttag(node, "div", CLASS="math"))
    if node["number"]:
        writer.body.append(f'<span class="eqno">({get_node_equation_number(writer, node)})</span>')
    writer.body.extend(f"<div>{shown(writer, node, row, 1.15)}</div>" for row in rows)
    writer.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_html_math_renderer("drawn", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
