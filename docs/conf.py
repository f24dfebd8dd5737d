"""Sphinx configuration; build with ``python -m sphinx -W -b html docs docs/_build/html``."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE), str(HERE.parent), str(HERE.parent / "src")]

from cartstiff import __version__  # noqa: E402

project = "cartstiff"
author = "The cartstiff authors"
copyright = "the cartstiff authors"
version = release = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "mathml",
    "docstrings",
    "generated",
    "notebooks",
]
root_doc = "index"
exclude_patterns = ["_build"]
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
myst_dmath_double_inline = True
myst_update_mathjax = False

# Formulas become MathML when the pages are built: nothing is loaded from outside.
html_math_renderer = "mathml"
math_number_all = False
math_eqref_format = "({number})"

autodoc_member_order = "bysource"
# The contents beside each page name pages and sections: members too take a quarter of the build.
toc_object_entries = False
autodoc_typehints = "none"
# Nobody writes types as comments; looking for them parses each function once more.
autodoc_use_type_comments = False
napoleon_numpy_docstring = True
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
smartquotes = False
default_role = "code"
# No faults: a key that only these pages cite, an attribute name that several classes have.
suppress_warnings = ["ref.citation", "ref.python"]

html_theme = "furo"
html_title = f"cartstiff {release}"
html_static_path = ["_static"]
html_css_files = ["cartstiff.css"]
html_show_sphinx = False
html_copy_source = False
