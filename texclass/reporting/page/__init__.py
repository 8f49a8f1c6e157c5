"""Results as one self-contained HTML page."""

from texclass.reporting.page.read import Result, read_result
from texclass.reporting.page.render import render_page, write_page

__all__ = ["Result", "read_result", "render_page", "write_page"]
