"""How Sphinx makes the documentation.

Its sources are those files of the project that `include_patterns` lists, from the top, so that a link from page to page
is the same for Sphinx and for whoever reads the files themselves.
"""

import os
import re
import shutil
from datetime import date
from pathlib import Path

from sphinx.ext.mathjax import html_visit_displaymath, html_visit_math

TOP = Path(__file__).parents[1]
#: Debian's copy of KaTeX, so that formulas need no network; without it they are MathJax's, from its server.
KATEX = Path("/usr/share/javascript/katex")

project = "fx_contact"
author = "the fx_contact developers"
copyright = f"{date.today():%Y}, {author}"
release = version = re.search(r'^__version__ = "(.*)"', (TOP / "src/fx_contact/__init__.py").read_text(), flags=re.M)[
    1
]

root_doc = "docs/index"
include_patterns = ["docs/**.md", "docs/generated/*", "notebooks/*.ipynb", "studies/README.md", "studies/*/README.md"]
include_patterns += ["demos/README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md"]
exclude_patterns = ["results"]
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon", "sphinx_copybutton"]

# Pages, and what is run on them.
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
nb_execution_mode = "cache"
nb_execution_cache_path = str(TOP / "results" / "docs" / "cache")
nb_execution_timeout = 240  # seconds of a cell
nb_execution_raise_on_error = True
nb_merge_streams = True
copybutton_exclude = ".linenos, .gp, .go"

# The reference, from the docstrings: plain text in Google's form, names in single backticks.
default_role = "code"
autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autoclass_content = "class"
napoleon_use_ivar = True
templates_path = [str(TOP / "docs" / "templates")]  # also for autosummary, which looks from the top
#: Types of other libraries, and of what users need not know of this one.
nitpick_ignore_regex = [(r"py:.*", r"(?!fx_contact).*"), (r"py:class", r"fx_contact\.\w+\.\w+\..*")]

if os.environ.get("FX_CONTACT_ONLINE"):
    extensions.append("sphinx.ext.intersphinx")
    intersphinx_mapping = {
        "python": ("https://docs.python.org/3", None),
        "numpy": ("https://numpy.org/doc/stable", None),
        "dolfinx": ("https://docs.fenicsproject.org/dolfinx/v0.9.0/python", None),
    }

html_theme = "pydata_sphinx_theme"
html_title = f"fx_contact {release}"
html_static_path = ["static"]
html_css_files = ["pages.css"]
#: Pages without others below them have nothing to show at the left.
ALONE = "install engineers gallery verification effectivity performance partitions limits".split()
ALONE += "faq choosing glossary records new citation".split()
html_sidebars = {f"docs/{page}": [] for page in ALONE} | {"CHANGELOG": []}
html_show_sourcelink = False
html_theme_options = {
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "header_links_before_dropdown": 6,
    "footer_start": ["copyright"],
    "footer_end": [],
}


def _with_katex(app):
    """Copy KaTeX beside the pages."""
    shutil.copytree(KATEX, Path(app.outdir) / "_static" / "katex", dirs_exist_ok=True)


def _escaped(app, what, name, obj, options, lines):
    """Bars and stars of a docstring's formulas are no markup, but in literals."""
    for i, line in enumerate(lines):
        parts = re.split(r"(``?[^`]*``?)", line)
        parts[::2] = [re.sub(r"(?<!\\)([|*])", r"\\\1", part) for part in parts[::2]]
        lines[i] = "".join(parts)


def setup(app):
    """What the settings above cannot say."""
    app.connect("autodoc-process-docstring", _escaped, priority=400)  # before napoleon
    if KATEX.is_dir():
        app.connect("builder-inited", _with_katex)
        app.add_html_math_renderer("katex", (html_visit_math, None), (html_visit_displaymath, None))
        app.config.html_math_renderer = "katex"
        app.add_css_file("katex/katex.min.css")
        for script in ("katex/katex.min.js", "formulas.js"):
            app.add_js_file(script)
