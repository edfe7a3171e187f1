"""The site: `python -m sphinx -W docs out/docs`, or `make docs`. It needs no network, to be built or to be read."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE / "_ext")]

from pulsepath import __version__  # noqa: E402  found by the line before

project = "pulsepath"
author = "the pulsepath authors"
copyright = author
release = version = __version__

extensions = ["myst_parser", "docstrings", "drawn_math", "command_line", "extras", "notebook_pages"]
myst_enable_extensions = ["attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
smartquotes = False  # options and quoted arguments are there to be copied
exclude_patterns = ["examples"]

html_theme = "pydata_sphinx_theme"
html_title = "pulsepath"
html_static_path = ["_static"]
templates_path = ["_templates"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_math_renderer = "drawn"
html_sidebars = {"installing": [], "tutorial": [], "help": [], "architecture": [], "changelog": []}
html_theme_options = {
    "header_links_before_dropdown": 9,
    "navbar_align": "left",
    "show_prev_next": True,
    "footer_start": ["copyright"],
    "footer_end": ["licence"],
    "secondary_sidebar_items": ["page-toc"],
}
