"""How Sphinx builds these pages: `make docs` writes HTML to docs/_build, from local files only, warnings as errors."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from generate import mathtext, reference  # noqa: E402

import seatrial  # noqa: E402

project = "seatrial"
author = "the seatrial authors"
version = release = seatrial.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]

highlight_language = "text"
myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "description"
autodoc_preserve_defaults = True
autodoc_typehints_format = "short"
napoleon_numpy_docstring = False
napoleon_use_ivar = True

html_theme = "furo"
html_title = "seatrial"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_math_renderer = mathtext.NAME
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False


def setup(app):
    """Equations drawn without a network, and the reference written from the package itself."""
    mathtext.register(app)
    app.connect("builder-inited", lambda app: reference.write_pages(HERE))
