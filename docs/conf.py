"""How Sphinx builds the guide: `make docs`."""

import os
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent / "tools")]
# The help texts of the reference are wrapped at this width, whatever the terminal.
os.environ["COLUMNS"] = "94"

from groundwork import __version__  # noqa: E402 - the project is on the path only now

project = "Frontrunner"
author = "the authors of Frontrunner"
copyright = author
release = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "command_reference", "registries"]
exclude_patterns = ["tools", "_templates", "_static"]
templates_path = ["_templates"]

myst_heading_anchors = 3
nitpicky = True
# Types of NumPy, pandas and this project's internals, which the reference does not describe.
nitpick_ignore_regex = [("py:.*", r".*")]
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
python_use_unqualified_type_names = True

html_theme = "furo"
html_title = "Frontrunner's guide"
html_sidebars = {
    "**": [
        "sidebar/brand.html", "sidebar/site.html", "sidebar/search.html", "sidebar/scroll-start.html",
        "sidebar/navigation.html", "sidebar/scroll-end.html",
    ],
}  # fmt: skip
html_static_path = ["_static"]
html_favicon = "../crowd/dashboard/static/dashboard/mark.svg"
html_css_files = ["guide.css"]
html_js_files = [("scrolling.js", {"defer": "defer"})]
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False
html_domain_indices = False
html_use_index = False
pygments_style = "default"
pygments_dark_style = "monokai"


def leave_research_out_of_the_search(app: Any, doctree: Any) -> None:  # noqa: ARG001 - Sphinx passes it
    """Mark pages of research, so that the search does not find them."""
    page = app.env.docname
    if page.startswith(("research/", "decisions/")):
        app.env.metadata[page]["no-search"] = "yes"


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("doctree-read", leave_research_out_of_the_search, priority=900)  # after the page's own marks
