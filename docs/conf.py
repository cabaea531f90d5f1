"""The documentation as a site.  `python -m sphinx -W docs site` makes it, without a network."""

import sys
from pathlib import Path

import skyscatter

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project = "skyscatter"
author = "skyscatter developers"
copyright = author  # Sphinx' own name for it
version = release = skyscatter.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "numpydoc",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx-mathjax-offline",  # formulas without a network
    "outside",
    "reference",
    "equations",
    "literals",
    "live",
    "notebooks",
]
exclude_patterns = ["_build", "_extensions", "paper", "gallery/inversion", "gallery/surfaces"]
suppress_warnings = ["misc.highlighting_failure"]  # fences of several languages' shells

myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
myst_dmath_double_inline = True
nb_execution_mode = "off"  # notebooks are kept as they were run; -D nb_execution_mode=force runs them again
nb_execution_timeout = 600
nb_merge_streams = True

autodoc_typehints = "none"  # the docstrings say types, shapes and units
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
add_module_names = False
numpydoc_show_class_members = False  # the pages list them
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

html_theme = "pydata_sphinx_theme"
html_title = "skyscatter"
html_static_path = ["_static"]
html_css_files = ["skyscatter.css"]
html_sourcelink_suffix = ""
html_show_sourcelink = False
html_favicon = "_static/skyscatter.svg"
html_context = {"default_mode": "auto"}  # light or dark as the system is; the theme logs an error without
html_sidebars = {"gallery/README": []}
smartquotes_action = "qe"  # two hyphens begin an option
html_theme_options = {
    "logo": {"image_light": "_static/skyscatter.svg", "image_dark": "_static/skyscatter.svg", "text": "skyscatter"},
    "navbar_align": "left",
    "header_links_before_dropdown": 7,
    "navbar_end": ["theme-switcher"],
    "secondary_sidebar_items": ["page-toc"],
    "show_prev_next": True,
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "tango",
    "pygments_dark_style": "github-dark",
}
