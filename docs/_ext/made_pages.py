"""Pages that are made at build time, of what stands elsewhere: reports, public names, features, examples."""

import re
import shutil
from pathlib import Path
from types import ModuleType

import matplotlib as mpl
from feature_pages import write_feature_pages
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst, matplotlib_scraper

import texclass as tx
from texclass.reporting.figure_style import DPI, LOOKS, STYLE

ROOT = Path(__file__).parents[2]
MADE = ("reports", "features", "api")
"""Folders below the source that are written anew by each build."""
LINKS = {
    r"\]\(\.\./reports/README\.md\)": "](figures.md)",
    r"\]\(\.\./reports/": "](reports/",
    r"\]\(\.\./examples/((?:surface|feature|certainty|robot|haptics)/\w+)\.py\)": r"](gallery/\1.rst)",
}
"""Links between files of the repository -> links between pages."""
MARKUP = re.compile(r"``.*?``|\||\*\*?(?=\w)|(?<=\w)_(?![\w`])")
"""Quoted code, which stays; and what is |k|, g**2, *args or classes_ to a reader, and markup to docutils."""


def setup(app):
    """Write what is made before Sphinx looks for pages; mend links and docstrings as they are read."""
    app.connect("config-inited", make_pages, priority=100)
    app.connect("source-read", link_pages)
    app.connect("autodoc-process-docstring", quote_markup, priority=100)
    app.connect("autodoc-skip-member", lambda app, what, name, *_: re.match("set_.*_request", name) or None)
    return {"parallel_read_safe": True}


def make_pages(app, _config):
    """Write reports, feature pages and indexes of public names into the source folder."""
    source = Path(app.srcdir)
    for folder in MADE:
        shutil.rmtree(source / folder, ignore_errors=True)
    shutil.copytree(
        ROOT / "reports", source / "reports", ignore=shutil.ignore_patterns("README.md", "*.json")
    )
    for page in (source / "reports").glob("[ts]*/*.md"):  # of several results: one title above theirs
        told = page.read_text(encoding="utf-8")
        if len(re.findall(r"^# ", told, flags=re.M)) > 1 or page.parent.name == "tables":
            told = re.sub(r"^#", "##", told, flags=re.M)
            page.write_text(f"# {page.stem.capitalize()}\n\n{told}", encoding="utf-8")
    write_feature_pages(source / "features")
    write_room(source / "api", "texclass", tx)


def write_room(folder, name, room):
    """Write the page of a room's public names, and those of the rooms in it."""
    folder.mkdir(exist_ok=True)
    found = public_names(room)
    rooms = {n: v for n, v in found.items() if isinstance(v, ModuleType)}
    if name == "texclass.features":
        rooms = {}  # each feature has a page
    at_home = {n: home_of(found[n], n, rooms) for n in found if not isinstance(found[n], ModuleType)}
    names = [n for n, home in at_home.items() if not home]
    lines = [name, "=" * len(name), "", f".. automodule:: {name}", "", f".. currentmodule:: {name}", ""]
    if rooms:
        lines += [".. toctree::", "   :maxdepth: 1", "", *(f"   {name}.{n}" for n in rooms), ""]
    lines += [
        ".. autosummary::",
        "",
        *(f"   ~{home}{n}" for n, home in at_home.items() if callable(found[n])),
        "",
    ]
    for n in names:
        kind = "class" if isinstance(found[n], type) else "function" if callable(found[n]) else "data"
        members = ["   :members:"] if kind == "class" else ["   :no-value:"] if kind == "data" else []
        lines += [f".. auto{kind}:: {n}", *members, ""]
    (folder / f"{name}.rst").write_text("\n".join(lines), encoding="utf-8")
    for n, inner in rooms.items():
        write_room(folder, f"{name}.{n}", inner)


def public_names(room):
    """Return the names of a room's index, or what a module without one defines itself."""
    if named := getattr(room, "__all__", None):
        return {n: getattr(room, n) for n in named}
    return {
        n: v for n, v in vars(room).items() if n[0] != "_" and getattr(v, "__module__", "") == room.__name__
    }


def home_of(value, n, rooms):
    """Return the inner room that a name is told in, with a dot; nothing, if it is told here."""
    return next((f"{room}." for room, inner in rooms.items() if public_names(inner).get(n) is value), "")


def link_pages(app, docname, source):
    """Turn links to files of the repository into links to their pages."""
    for written, read in LINKS.items():
        source[0] = re.sub(written, read, source[0])


def quote_markup(app, what, name, obj, options, lines):
    """Let docutils print what is no markup in our docstrings."""
    lines[:] = [
        line if ">>>" in line else MARKUP.sub(lambda m: m[0] if m[0][0] == "`" else f"\\{m[0]}", line)
        for line in lines
    ]


def reset_style(gallery_conf, name):
    """Draw every example in the style of the reports."""
    plt.close("all")
    mpl.rcdefaults()
    mpl.rcParams.update(STYLE)
    mpl.rcParams.update({"figure.constrained_layout.use": True, "savefig.dpi": DPI})
    mpl.rcParams["axes.prop_cycle"] = mpl.cycler(color=[colour for colour, _ in LOOKS])


def scrape_figures(block, block_vars, gallery_conf, **kwargs):
    """Save the figures of a block: those of pyplot, and those that our functions return."""
    paths = []
    for figure in block_vars["example_globals"].values():
        if isinstance(figure, Figure) and not hasattr(figure, "scraped"):
            figure.scraped = True
            if figure.canvas.manager is None:  # not one of pyplot's
                paths.append(next(block_vars["image_path_iterator"]))
                figure.savefig(paths[-1], dpi=DPI)
    of_pyplot = matplotlib_scraper(block, block_vars, gallery_conf, **kwargs)
    return figure_rst(paths, gallery_conf["src_dir"]) + of_pyplot
