"""Generate pages at build time: reports, API reference, features, contents of the papers, examples."""

import re
import shutil
from pathlib import Path
from types import ModuleType

import matplotlib as mpl
from feature_pages import write_feature_pages
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from paper_page import write_paper_page
from pygments.lexers.special import TextLexer
from sphinx_gallery.scrapers import figure_rst, matplotlib_scraper

import texclass as tx
from texclass.reporting.figure_style import DPI, LOOKS, STYLE

ROOT = Path(__file__).parents[2]
GENERATED = ("reports", "features", "papers", "api", "ros2")
"""Folders below the source folder that each build generates."""
LINKS = {
    r"\]\(\.\./reports/README\.md\)": "](figures.md)",
    r"\]\(\.\./(reports|ros2)/": r"](\1/",
    r"\]\(\.\./docs/": "](../",
    r"\]\(\.\./examples/((?:surface|feature|certainty|robot|haptics)/\w+)\.py\)": r"](gallery/\1.rst)",
}
"""Pattern of a link between files of the repository -> link between pages."""
MARKUP = re.compile(r"``.*?``|\||\*\*?(?=\w)|(?<=\w)_(?![\w`])")
"""Quoted code, and text such as |k|, g**2, *args or classes_ that docutils would interpret as markup."""


def setup(app):
    """Generate pages before Sphinx lists them; convert links and docstrings while Sphinx reads them."""
    app.add_lexer("csv", TextLexer)  # Pygments has none
    app.connect("config-inited", generate_pages, priority=100)
    app.connect("source-read", link_pages)
    app.connect("autodoc-process-docstring", escape_markup, priority=100)
    app.connect("autodoc-skip-member", lambda app, what, name, *_: re.match("set_.*_request", name) or None)
    return {"parallel_read_safe": True}


def generate_pages(app, _config):
    """Write reports, feature pages, the page on the papers and API pages into the source folder."""
    source = Path(app.srcdir)
    for folder in GENERATED:
        shutil.rmtree(source / folder, ignore_errors=True)
    shutil.copytree(
        ROOT / "reports", source / "reports", ignore=shutil.ignore_patterns("README.md", "*.json")
    )
    for page in (source / "reports").glob("[ts]*/*.md"):  # several results get a common title
        text = page.read_text(encoding="utf-8")
        if len(re.findall(r"^# ", text, flags=re.M)) > 1 or page.parent.name == "tables":
            text = re.sub(r"^#", "##", text, flags=re.M)
            page.write_text(f"# {page.stem.capitalize()}\n\n{text}", encoding="utf-8")
    shutil.copytree(ROOT / "ros2", source / "ros2")
    write_feature_pages(source / "features")
    write_paper_page(source / "papers")
    write_subpackage(source / "api", "texclass", tx)


def write_subpackage(folder, name, package):
    """Write the page of the public names of a package, and the pages of its subpackages."""
    folder.mkdir(exist_ok=True)
    members = public_names(package)
    subpackages = {n: v for n, v in members.items() if isinstance(v, ModuleType)}
    if name == "texclass.features":
        subpackages = {}  # each feature has a page
    prefixes = {n: prefix_of(members[n], n, subpackages) for n in members if n not in subpackages}
    names = [n for n, prefix in prefixes.items() if not prefix]
    lines = [name, "=" * len(name), "", f".. automodule:: {name}", "", f".. currentmodule:: {name}", ""]
    if subpackages:
        lines += [".. toctree::", "   :maxdepth: 1", "", *(f"   {name}.{n}" for n in subpackages), ""]
    lines += [
        ".. autosummary::",
        "",
        *(f"   ~{prefix}{n}" for n, prefix in prefixes.items() if callable(members[n])),
        "",
    ]
    for n in names:
        kind = "class" if isinstance(members[n], type) else "function" if callable(members[n]) else "data"
        options = ["   :members:"] if kind == "class" else ["   :no-value:"] if kind == "data" else []
        lines += [f".. auto{kind}:: {n}", *options, ""]
    (folder / f"{name}.rst").write_text("\n".join(lines), encoding="utf-8")
    for n, subpackage in subpackages.items():
        write_subpackage(folder, f"{name}.{n}", subpackage)


def public_names(package):
    """Return the names in `__all__`, or the names that a module without `__all__` defines."""
    if names := getattr(package, "__all__", None):
        return {n: getattr(package, n) for n in names}
    return {
        n: v
        for n, v in vars(package).items()
        if n[0] != "_" and getattr(v, "__module__", "") == package.__name__
    }


def prefix_of(value, n, subpackages):
    """Return the subpackage (with a dot) whose page documents a name, or an empty string."""
    return next(
        (f"{name}." for name, inner in subpackages.items() if public_names(inner).get(n) is value), ""
    )


def link_pages(app, docname, source):
    """Turn links to files of the repository into links to their pages."""
    for pattern, link in LINKS.items():
        source[0] = re.sub(pattern, link, source[0])


def escape_markup(app, what, name, obj, options, lines):
    """Escape text in docstrings that docutils would interpret as markup."""
    lines[:] = [
        line if ">>>" in line else MARKUP.sub(lambda m: m[0] if m[0][0] == "`" else f"\\{m[0]}", line)
        for line in lines
    ]


def reset_style(gallery_conf, name):
    """Use the figure style of the reports in every example."""
    plt.close("all")
    mpl.rcdefaults()
    mpl.rcParams.update(STYLE)
    mpl.rcParams.update({"figure.constrained_layout.use": True, "savefig.dpi": DPI})
    mpl.rcParams["axes.prop_cycle"] = mpl.cycler(color=[colour for colour, _ in LOOKS])


def scrape_figures(block, block_vars, gallery_conf, **kwargs):
    """Save the figures of a code block: those of pyplot, and those returned by texclass."""
    paths = []
    for figure in block_vars["example_globals"].values():
        if isinstance(figure, Figure) and not hasattr(figure, "scraped"):
            figure.scraped = True
            if figure.canvas.manager is None:  # not created by pyplot
                paths.append(next(block_vars["image_path_iterator"]))
                figure.savefig(paths[-1], dpi=DPI)
    pyplot_figures = matplotlib_scraper(block, block_vars, gallery_conf, **kwargs)
    return figure_rst(paths, gallery_conf["src_dir"]) + pyplot_figures
