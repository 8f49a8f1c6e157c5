"""Tell a result once, as a document of blocks, and show it on a terminal, in Markdown and on an HTML page."""

from typing import TYPE_CHECKING

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "blocks": ["Document", "Figure", "Finding", "Folded", "Heading", "Heat", "Shade", "Table"],
        "figure_style": ["new_figure", "save_figure"],
        "markdown": ["render_markdown", "write_document"],
        "page": ["render_page"],
        "terminal": ["print_document", "render_terminal"],
    },
)

if TYPE_CHECKING:
    from texclass.document.blocks import (
        Document,
        Figure,
        Finding,
        Folded,
        Heading,
        Heat,
        Shade,
        Table,
    )
    from texclass.document.figure_style import new_figure, save_figure
    from texclass.document.markdown import render_markdown, write_document
    from texclass.document.page import render_page
    from texclass.document.terminal import print_document, render_terminal
