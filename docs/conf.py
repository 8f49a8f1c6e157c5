"""Configuration of the documentation: `python -m sphinx -W docs site`, without network."""

import sys
from pathlib import Path

from numpydoc.xref import DEFAULT_LINKS

import texclass

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "texclass"
author = "the texclass authors"
version = release = texclass.__version__
extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "sphinx.ext.viewcode",
    "numpydoc",
    "myst_parser",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
    "generated_pages",
]
exclude_patterns = ["_ext", "_build"]
default_role = "py:obj"
suppress_warnings = ["config.cache"]

myst_heading_anchors = 3
autosummary_generate = False
autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_xref_param_type = True
NOT_LINKED = {*DEFAULT_LINKS, "of", "optional", "or", "shape", "to"}
numpydoc_xref_ignore = NOT_LINKED
numpydoc_xref_aliases = {word: word for word in NOT_LINKED} | {
    "ndarray": "numpy.ndarray",
    "DataFrame": "pandas.DataFrame",
    "Series": "pandas.Series",
    "Figure": "matplotlib.figure.Figure",
    "Axes": "matplotlib.axes.Axes",
}

# The names that our pages link to, since the build needs no network.
intersphinx_mapping = {
    "numpy": ("https://numpy.org/doc/stable", "inventories/numpy.txt"),
    "scipy": ("https://docs.scipy.org/doc/scipy", "inventories/scipy.txt"),
    "sklearn": ("https://scikit-learn.org/stable", "inventories/sklearn.txt"),
    "pandas": ("https://pandas.pydata.org/docs", "inventories/pandas.txt"),
    "matplotlib": ("https://matplotlib.org/stable", "inventories/matplotlib.txt"),
}

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "ignore_pattern": r"stream_logic\.py",
    "subsection_order": [
        f"../examples/{group}" for group in ("surface", "feature", "certainty", "robot", "haptics")
    ],
    "image_scrapers": ("generated_pages.scrape_figures",),
    "reset_modules": ("generated_pages.reset_style",),
    "first_notebook_cell": "%matplotlib inline",
    "ignore_repr_types": r"matplotlib\.figure",
    "show_memory": False,
    "write_computation_times": False,  # their page asks a server for a script
    "show_signature": False,
    "min_reported_time": 5,
}

html_theme = "pydata_sphinx_theme"
html_title = "texclass"
html_show_sourcelink = False
html_copy_source = False
html_static_path = ["_static"]
html_css_files = ["texclass.css"]
html_sidebars = {"index": [], "papers/index": []}
html_theme_options = {
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
    "show_prev_next": False,
}
