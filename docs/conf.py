"""The site: `make docs` builds it into target/site, where it opens without a server and without a network."""

from __future__ import annotations

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "extensions"))

import fleetfoot  # noqa: E402

project = "fleetfoot"
author = "The fleetfoot developers"
copyright = "The fleetfoot developers"
version = release = fleetfoot.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "mathml",
]
exclude_patterns = ["requirements.txt", "examples"]
language = "en"
html_math_renderer = "mathml"

# -- text

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 4
# Blocks `console` are prompts and what is said to them; `text` and `sh` need no colours.
highlight_language = "none"
# A script of several lines within quotes is beyond the lexer of consoles, which then goes on without.
suppress_warnings = ["config.cache", "misc.highlighting_failure"]

# -- Python

autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_default_options = {"members": True, "inherited-members": True}
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True

# -- pictures: every script of examples/ is run, and what it draws is shown

sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"plot_",
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "min_reported_time": 10_000,
    "image_scrapers": ("matplotlib",),
    "remove_config_comments": True,
}
# Where the scripts put what they generate.
os.environ.setdefault("FLEETFOOT_GALLERY", str(HERE.parent / "target" / "gallery"))

# -- pages

html_theme = "pydata_sphinx_theme"
html_title = "fleetfoot"
html_static_path = ["static"]
html_extra_path = ["llms.txt"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False
html_theme_options = {
    "logo": {"text": "fleetfoot"},
    "navbar_align": "left",
    "navbar_end": ["theme-switcher"],
    "secondary_sidebar_items": ["page-toc"],
    "show_prev_next": True,
    "footer_start": ["sphinx-version"],
    "footer_end": [],
    "show_toc_level": 2,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
